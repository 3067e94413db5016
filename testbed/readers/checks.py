"""Value checks after any reader: damaged files mostly read without an error, so the numbers themselves must be asked.

What makes a channel useless raises InputProblem; what a user should know is returned as notes.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from testbed.problem import InputProblem
from testbed.readers.spikes import most_spikes, spikes
from testbed.recording import Recording

_FEW_LEVELS = 16
_FEW_BEATS = 3  # spikes of a force or an acceleration up to which they are no teeth's
_MANY_JUMPS = 8
_LEVELS = 2.5  # of the converter, by which a signal moves from sample to sample that stands still by no chance
_RARELY = 0.1  # share of samples that repeat the one before, where it does so
_FEWEST = 32  # samples of a record; fewer tell nothing
# beyond these a slip of the unit is likelier than such a machine (SI)
_DEEPEST, _FASTEST_FEED, _LARGEST_MOTION, _SLOWEST, _FASTEST = 0.05, 5e-3, 0.01, 0.5, 2e4


def equal_lengths(path: Path, channels: dict[str, np.ndarray]) -> None:
    """Raises InputProblem where channels differ in length."""
    lengths = {name: len(values) for name, values in channels.items()}
    if len(set(lengths.values())) > 1:
        said = ", ".join(f"{name} {length}" for name, length in lengths.items())
        raise InputProblem(
            path, f"channels of unequal length ({said})", "the file was cut off: measure or export it again"
        )


def usable(path: Path, name: str, values: np.ndarray, rate: float, start: float) -> None:
    """Raises InputProblem for no samples, numbers that are none, absurd ones, and a channel that never changes."""
    if len(values) < 2:
        raise InputProblem(
            path, f"channel {name}: {'no samples' if len(values) == 0 else 'one sample'}", "check from/to and the file"
        )
    bad = np.flatnonzero(~np.isfinite(values))
    if len(bad):
        raise InputProblem(
            path,
            f"channel {name}: {len(bad)} of {len(values)} samples are no number, the first is sample "
            f"{bad[0] + 1} at {start + bad[0] / rate:.6g} s",
            "mend the file, or read around it with from/to",
        )
    low, high = float(values.min()), float(values.max())
    if low == high:
        raise InputProblem(path, f"channel {name}: constant at {low:.6g}", "check the sensor and the column")
    if max(abs(low), abs(high)) > 1e30:
        place = int(np.argmax(np.abs(values)))
        raise InputProblem(
            path, f"channel {name}: sample {place + 1} is {values[place]:.6g}", "the file is damaged: export it again"
        )


def long_enough(path: Path, name: str, recording: Recording, speed: float | None) -> None:
    """Raises InputProblem for a record of a few samples, or a cut (its stated spindle speed in rad/s) of less than one turn."""
    if len(recording) < _FEWEST:
        raise InputProblem(path, f"record '{name}' holds only {len(recording)} samples", "record longer, or check from/to")
    if speed is None:
        return
    duration = len(recording) / recording.sampling_rate
    turns = duration * speed / (2 * np.pi)
    if turns < 1:
        raise InputProblem(
            path,
            f"record '{name}' lasts {duration:.4g} s, {turns:.2g} revolutions at {speed * 30 / np.pi:.6g} rpm",
            "record many revolutions, or correct sampling_rate or spindle_speed",
        )


def plausible_notes(recording: Recording, conditions: Mapping[str, Any]) -> list[str]:
    """Notes on conditions (SI) and motions so far from any machine's that a unit is likely to be wrong."""
    notes = []
    depth, speed = conditions.get("axial_depth_of_cut"), conditions.get("spindle_speed")
    feed = conditions.get("feed_per_tooth", conditions.get("feed_per_revolution"))
    if depth is not None and depth > _DEEPEST:
        notes.append(f"depth of cut {depth * 1e3:.6g} mm: is the unit right?")
    if feed is not None and feed > _FASTEST_FEED:
        notes.append(f"feed {feed * 1e3:.6g} mm: is the unit right?")
    if speed is not None and not _SLOWEST < speed < _FASTEST:
        notes.append(f"spindle speed {speed * 30 / np.pi:.6g} rpm: is the unit right?")
    for name, values in recording.channels.items():
        if name.startswith("displacement") and recording.units[name] == "m" and np.ptp(values) > _LARGEST_MOTION:
            notes.append(f"channel {name} moves by {np.ptp(values) * 1e3:.3g} mm: is the unit right?")
    return notes


def clipped(values: np.ndarray, full_scale: float | None = None) -> int:
    """Number of samples stuck at the channel's largest or smallest value, 0 where nothing is clipped."""
    return int(clipped_samples(values, full_scale).sum())


def clipped_samples(values: np.ndarray, full_scale: float | None = None) -> np.ndarray:
    """Which samples (samples,) are stuck at the channel's largest or smallest value.

    A clipped signal piles up at its extreme: runs of equal samples there, far more than in the neighbouring band.
    """
    stuck = np.zeros(len(values), dtype=bool)
    span = float(values.max() - values.min())
    for sign in (1.0, -1.0):
        signed = sign * values
        top = float(signed.max())
        if top == 0.0 or span == 0.0:
            continue
        at_top = signed == top
        count = int(at_top.sum())
        if full_scale is not None and count >= 2 and abs(top) >= 0.9999 * full_scale * (1 - 2**-15):
            stuck |= at_top
            continue
        below = np.unique(signed[(signed > top - 0.02 * span) & ~at_top])
        band = max(0.01 * span, 2 * (top - float(below[-1])) if len(below) else 0.0)
        near = int(((signed > top - band) & ~at_top).sum())
        if count >= 4 and _longest_run(at_top) >= 3 and count > 3 * near:
            stuck |= at_top
    return stuck


def _longest_run(mask: np.ndarray) -> int:
    edges = np.flatnonzero(np.diff(np.concatenate(([0], mask.astype(np.int8), [0]))))
    return int((edges[1::2] - edges[0::2]).max()) if len(edges) else 0


def jumps(values: np.ndarray) -> list[int]:
    """Samples at which the signal jumps to, alone among small steps: a hole, a doubled or a foreign piece of the file.

    Quiet before or behind for four steps and small on the other side, so that blows, teeth that enter and loud noise are
    none; where there are many, the signal is one that jumps.
    """
    steps = np.abs(np.diff(values))
    moving = steps[steps > 0]
    if len(steps) < 32 or not len(moving):
        return []
    usual = max(float(np.median(steps)), 2 * float(moving.min()), 1e-3 * float(np.ptp(values)))
    found = []
    for place in np.flatnonzero(steps > 12 * usual):
        before, after = (steps[max(place - 4, 0) : place] * 6 < steps[place], steps[place + 1 : place + 5] * 6 < steps[place])
        quiet = (before.size == 4 and before.all()) or (after.size == 4 and after.all())
        if not (quiet and before[-1:].all() and after[:1].all()):
            continue
        if steps[place] > 12 * np.median(steps[max(place - 100, 0) : place + 100]):  # the record's loud part has its own usual
            found.append(int(place) + 1)
    return found if len(found) <= _MANY_JUMPS else []


def stuck_stretch(values: np.ndarray) -> tuple[int, int] | None:
    """(first sample, length) of the longest run of equal samples, where the signal's resolution does not explain it."""
    places = np.flatnonzero(np.diff(values) != 0)
    if len(places) < 8:
        return None
    runs = np.diff(np.concatenate([[-1], places, [len(values) - 1]]))
    longest = int(np.argmax(runs))
    length = int(runs[longest])
    others = np.delete(runs, longest)
    share = float((others - 1).sum() / max(1, others.sum()))  # of samples that repeat the one before
    explained = np.log(1e-6 / len(values)) / np.log(share) if share > 0 else 1.0
    first, second = int(np.concatenate([[-1], places])[longest]) + 1, int(others.max())
    if length < max(5, explained) or length < 4 * second and not _amid_motion(values, first, length):
        return None
    return first, length


def _amid_motion(values: np.ndarray, first: int, length: int) -> bool:
    """Whether before and behind a run of equal samples the signal moves by levels of its converter from sample to sample.

    There, hardly one repeats the one before by chance, though the record's idling be full of such.
    """
    beside = [values[max(first - 2 * length, 0) : first], values[first + length : first + 3 * length]]
    steps = np.abs(np.concatenate([np.diff(part) for part in beside]))
    level = float(np.abs(np.diff(np.unique(values))).min())
    return len(steps) > 2 * length and float(np.mean(steps == 0)) < _RARELY and float(np.median(steps)) > _LEVELS * level


def broken_numbers(values: np.ndarray) -> np.ndarray:
    """Samples that no converter gives, indices: of a size that a float only has when bytes of it were lost (below 1e-300,
    not zero), beside one 1e250 times as large or more. A free vibration that fades below that does so by small steps."""
    size = np.abs(values)
    beside = np.maximum(np.concatenate([[0.0], size[:-1]]), np.concatenate([size[1:], [0.0]]))
    return np.flatnonzero((size > 0) & (size < 1e-300) & (beside > 1e-50))


def channel_notes(name: str, values: np.ndarray, full_scale: float | None = None) -> list[str]:
    """What is doubtful about one usable channel: clipping, spikes, hardly any resolution."""
    notes: list[str] = []
    if name.startswith("tachometer"):
        return notes
    stuck = clipped(values, full_scale)
    if stuck:
        notes.append(f"channel {name}: {stuck} samples are clipped at {values.min():.6g} or {values.max():.6g}: "
                     "no fit counts them")
    beats = name.startswith(("acceleration", "force"))  # every tooth that enters or leaves makes these jump

    lone = spikes(values)
    teeth = beats and len(lone) > _FEW_BEATS
    if not teeth and 0 < len(lone) <= most_spikes(len(values)):
        notes.append(
            f"channel {name}: {len(lone)} lone spike{'s' * (len(lone) > 1)}, the first is sample {lone[0] + 1} "
            f"({values[lone[0]]:.6g})"
        )
    broken = broken_numbers(values)
    if len(broken):
        notes.append(
            f"channel {name}: sample {broken[0] + 1} is {values[broken[0]]:.3g}, as if bytes of it were lost"
            + (f", and {len(broken) - 1} more" if len(broken) > 1 else "")
        )
    off = [] if beats or name.startswith("spindle_angle") else jumps(values)  # one that lacks samples looks like a tooth's
    if off:
        notes.append(
            f"channel {name}: jumps at sample {off[0] + 1} ({values[off[0] - 1]:.6g} to {values[off[0]]:.6g})"
            + (f" and {len(off) - 1} more" if len(off) > 1 else "")
            + ": are samples missing or foreign there?"
        )
    frozen = stuck_stretch(values)
    if frozen and not stuck:
        notes.append(
            f"channel {name}: {frozen[1]} samples stand still at {values[frozen[0]] + 0.0:.6g}, "
            f"from sample {frozen[0] + 1} on"
        )
    levels = len(np.unique(values[:200_000]))
    if levels < _FEW_LEVELS:
        notes.append(f"channel {name}: only {levels} different values")
    return notes


def repeated_samples(channels: list[np.ndarray]) -> int:
    """Rows equal to the row before in every channel, beyond what the resolution explains; 0 where it may be chance."""
    same = np.ones(len(channels[0]) - 1, dtype=bool)
    for values in channels:
        same &= values[1:] == values[:-1]
    count = int(same.sum())
    chance = 1.0
    for values in channels:
        steps = np.abs(np.diff(values))
        moving = steps[steps > 0]
        quantum = float(moving.min()) if len(moving) else 0.0
        typical = float(np.median(moving)) if len(moving) else 1.0
        chance *= min(1.0, quantum / typical)
    return count if count > 3 + 5 * chance * len(same) else 0


def rate_notes(rate: float, natural_frequency: float) -> list[str]:
    """A note where the sampling is too slow for a vibration of this frequency (Hz)."""
    if rate >= 2.5 * natural_frequency:
        return []
    return [f"sampled at {rate:.6g} Hz, less than 2.5 times the model's natural frequency {natural_frequency:.6g} Hz"]


def speed_notes(nominal: float | None, found: float | None, source: str) -> list[str]:
    """A note where the spindle speed found (rad/s) is not the nominal one (rad/s)."""
    if nominal is None or found is None or abs(found / nominal - 1) <= 0.01:
        return []
    rpm = 30 / np.pi
    return [f"nominal spindle speed {nominal * rpm:.6g} rpm, found {found * rpm:.6g} rpm ({source})"]
