"""`testbed inspect`: what was read, record by record, in rpm, Hz, mm and um, with pictures on request."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import click

from testbed.api.words import interval_shown
from testbed.cli._answer import Answer
from testbed.cli._options import shared
from testbed.cli._places import output_folder

if TYPE_CHECKING:
    from testbed.analysis.records.chatter import Chatter
    from testbed.analysis.records.record_report import RecordReport
    from testbed.analysis.records.ring_downs import RingDown
    from testbed.api.inspect import Inspection

KINDS = {"neimark_sacker": "Neimark-Sacker", "flip": "flip (period doubling)", None: "of a kind that this record does not tell",
         "flip_or_runout": "flip (period doubling), or runout: the flutes are even"}  # fmt: skip
_RPM = 30.0 / math.pi
_SHOWN = {"m": (1e6, "um"), "m/s": (1e3, "mm/s"), "m/s^2": (1.0, "m/s^2"), "N": (1.0, "N")}


@click.command(
    short_help="What was read: channels, units, conditions, speed, segments, noise floor.",
    epilog="Example: testbed inspect campaign.yaml -o pictures",
)
@click.argument("data", metavar="DATA")
@click.option("--folder", metavar="DIR", help="Where the files of a campaign are, if not beside it.")
@click.option("--rate", metavar="RATE", help="Sampling rate of a bare file that states none, such as '12800 Hz'.")
@click.option(
    "--records",
    "most",
    type=click.IntRange(min=1),
    default=12,
    show_default=True,
    help="How many records of a data set to look at.",
)
@click.option("-o", "--output", metavar="DIR", help="Draw every record as PNG and SVG into this folder.")
@shared
def command(
    data: str,
    folder: str | None,
    rate: str | None,
    most: int,
    output: str | None,
    json_file: str | None,
    seed: int | None,
    quiet: bool,
) -> None:
    """Show what was read: channels, units, conditions, speed from the tachometer, segments and noise floor.

    DATA is a campaign.yaml, an HDF5 data set (or the folder that `testbed run --shards` wrote), one measured file, or what
    `testbed export` wrote. Nothing here is random: --seed changes nothing.
    """
    from testbed.api.inspect import inspect, is_exported, sampling_rate

    answer = Answer(json_file, quiet)
    hertz = sampling_rate(rate, "--rate") if rate else None
    if is_exported(data):
        from testbed.cli.export import describe_export

        describe_export(data, answer)
        return
    pictures = output_folder(output) if output else None
    found = inspect(data, folder=folder, rate=hertz, records=most)
    for line in _text(found):
        answer.say(line)
    if pictures is not None:
        found.save_plots(pictures, answer.watch)
        answer.say(f"pictures of {len(found.records)} records are in {pictures}")
    answer.finish(found.to_dict())


def _text(found: Inspection) -> list[str]:
    lines = [
        f"{found.path}: {found.said['name']}, {found.total} records"
        + (f", the first {len(found.records)} shown" if found.total > len(found.records) else "")
    ]
    if found.columns:
        lines.append("columns: " + ", ".join(f"{name} [{unit or '?'}]" for name, unit in found.columns.items()))
    lines += [f"  note: {note}" for note in found.notes]
    for record in found.records:
        lines += ["", *_record(record)]
    return lines


def _record(record: RecordReport) -> list[str]:
    recording = record.recording
    lines = [
        f"{record.name} ({record.kind}, {recording.origin}): {len(recording)} samples at "
        f"{recording.sampling_rate:.7g} Hz, "
        f"{recording.start:.6g} to {recording.start + len(recording) / recording.sampling_rate:.6g} s"
    ]
    for name, channel in record.channels.items():
        factor, unit = _SHOWN.get(channel.unit, (1.0, channel.unit or "?"))
        clipped = f", {channel.clipped} samples clipped" if channel.clipped else ""
        place = " on the tool" if name in recording.on_tool else ""
        lines.append(
            f"  {name}{place}: {channel.low * factor:.5g} to {channel.high * factor:.5g} {unit}, rms about the mean "
            f"{channel.rms * factor:.4g} {unit}{clipped}"
        )
    conditions = _conditions(record.conditions)
    if conditions:
        lines.append("  conditions: " + ", ".join(conditions))
    nominal = record.conditions.get("spindle_speed")
    if record.speed_found is not None:
        against = (
            f" against {nominal * _RPM:.1f} rpm nominal ({100 * (record.speed_found / nominal - 1):+.2f} %)"
            if nominal
            else ""
        )
        marks = f", {len(recording.marks)} marks" if record.speed_basis == "tachometer" else ""
        lines.append(f"  speed: {record.speed_found * _RPM:.1f} rpm from {record.speed_basis}{marks}{against}")
    elif nominal:
        lines.append(f"  speed: {nominal * _RPM:.1f} rpm nominal, not confirmed by tachometer or spectrum")
    if record.segments:
        lines.append(
            "  segments: " + ", ".join(f"{part.kind} {_seconds(part.start, part.stop, recording)}" for part in record.segments)
        )
    if record.used is not None:
        lines.append(f"  used in a fit: {_seconds(*record.used, recording)}, {100 * record.share:.3g} % of the record")
    lines += [line for one in record.ring_downs for line in _ring_down(one, recording)]
    if record.noise is not None and record.noise.known:
        own = recording.units[record.noise.channel]
        factor, unit = _SHOWN.get(own, (1.0, own or "?"))
        lines.append(
            f"  noise floor: {record.noise.rms * factor:.4g} {unit} rms in {record.noise.channel}, "
            f"from {record.noise.basis}"
        )
    if record.lines:
        lines.append(
            "  lines: "
            + ", ".join(
                f"{_hertz(line.frequency)} Hz {line.kind}{f' x{line.order}' if line.order else ''}"
                for line in record.lines[:8]
            )
        )
    if record.chatter is not None:
        lines.append(f"  {_chatter(record.chatter)}")
    if record.chatter_line is not None:
        track, (loud, at) = record.chatter_line, record.chatter_line.loudest
        lines.append(
            f"  chatter line: {track.frequency[0]:.1f} to {track.frequency[-1]:.1f} Hz from {track.time[0]:.3f} to "
            f"{track.time[-1]:.3f} s, loudest {at:.1f} Hz at {loud:.3f} s"
        )
    lines.append(f"  dropped samples: {record.dropped}, repeated samples: {record.repeated}")
    return lines + [f"  note: {note}" for note in record.notes]


def _seconds(start: float, stop: float, recording: Any) -> str:
    """A stretch of time, as fine as its samples."""
    digits = max(4, math.ceil(math.log10(recording.sampling_rate)))
    return f"{start:.{digits}f}-{stop:.{digits}f} s"


def _hertz(frequency: float) -> str:
    return f"{frequency:.1f}" if frequency >= 100.0 else f"{frequency:.4g}"


def _ring_down(ring: RingDown, recording: Any) -> list[str]:
    """The modes of a ring-down with their 95 % intervals, and their shapes where several channels tell them."""
    lines = []
    for one in ring.modes:
        (frequency, *ends), (damping, *limits) = map(interval_shown, (one.natural_frequency, one.damping_ratio))
        shape = ", ".join(f"{name} {part.value:+.3g}" for name, part in one.shape.items()) if len(one.shape) > 1 else ""
        direction = "" if one.direction is None else f", {math.degrees(one.direction.value):.3g} deg from x towards y"
        lines.append(f"  free vibration {_seconds(ring.start, ring.stop, recording)}: {frequency} ({' to '.join(ends)}), "
                     f"damping ratio {damping} ({' to '.join(limits)})" + (f", shape: {shape}{direction}" if shape else ""))
    return lines


def _chatter(found: Chatter) -> str:
    """One sentence: chatter or not, of which kind, at which frequency, how strong against the tooth passing."""
    where = f" ({found.channel})" if found.channel else ""
    at = "" if found.frequency is None else f" at {found.frequency:.1f} Hz"
    times = "" if found.ratio is None else f", {found.ratio:.3g} times the line at tooth passing"
    if found.verdict == "none":
        return f"chatter: none{where}: {found.reason}"
    if found.verdict == "unknown":
        return f"chatter: not known{where}: " + (f"a line{at}{times}: " if at else "") + found.reason
    return f"chatter: yes, {KINDS[found.kind]}{at}{times}{where}" + (f" ({found.reason})" if found.reason else "")


def _conditions(known: Any) -> list[str]:
    """Conditions in the words of a campaign's file and the units of the shop floor."""
    shown = []
    for key, said, factor, unit in (
        ("spindle_speed", "spindle_speed", _RPM, "rpm"),
        ("axial_depth_of_cut", "depth_of_cut", 1e3, "mm"),
        ("feed_per_tooth", "feed", 1e3, "mm/tooth"),
        ("feed_per_revolution", "feed", 1e3, "mm/rev"),
        ("flutes", "flutes", 1, ""),
        ("length_cut_before", "length_cut_before", 1e3, "mm"),
    ):
        if known.get(key) is not None:
            shown.append(f"{said} {known[key] * factor:.6g} {unit}".rstrip())
    return shown
