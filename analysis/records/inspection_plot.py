"""Pictures of an inspected record: its channels over time with the segments shaded, and its spectrum."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np

from testbed.analysis.records.chatter_line import LineTrack
from testbed.analysis.records.lines import amplitude_spectrum
from testbed.analysis.records.noise import samples_of
from testbed.analysis.records.record_report import RecordReport
from testbed.analysis.records.segments import main_channel

SEGMENT_COLOURS = {
    "idle": "#d9d9d9",
    "entry": "#fdd49e",
    "steady": "#ccebc5",
    "exit": "#fbb4ae",
    "ring-down": "#b3cde3",
}
_LINE_COLOURS = {
    "hum": "#7f7f7f",
    "spindle": "#9467bd",
    "tooth-passing": "#2ca02c",
    "half tooth-passing": "#ff7f0e",
    "natural": "#1f77b4",
    "chatter": "#e377c2",
    "other": "#d62728",
}
_SHOWN = {"m": (1e6, "um"), "m/s": (1e3, "mm/s"), "s": (1.0, "s")}
_POINTS = 4000


def envelope(time: np.ndarray, values: np.ndarray, points: int = _POINTS) -> tuple[np.ndarray, np.ndarray]:
    """A long signal thinned for drawing: the lowest and the highest sample of every stretch, in order."""
    if len(values) <= 2 * points:
        return time, values
    length = -(-len(values) // points)
    rows = np.pad(values, (0, -len(values) % length), mode="edge").reshape(-1, length)
    places = np.sort(np.stack([rows.argmin(axis=1), rows.argmax(axis=1)], axis=1), axis=1)
    index = np.minimum((places + np.arange(len(rows))[:, None] * length).ravel(), len(values) - 1)
    return time[index], values[index]


def draw(report: RecordReport) -> Any:
    """A matplotlib Figure of one record."""
    from matplotlib.figure import Figure

    recording = report.recording
    names = list(recording.channels)
    panels = len(names) + 1 + (report.chatter_line is not None)
    figure = Figure(figsize=(10, 2.0 * (panels - 1) + 3.2), layout="constrained")
    axes = figure.subplots(panels, 1, squeeze=False)[:, 0]
    for axis, name in zip(axes, names, strict=False):
        factor, unit = _SHOWN.get(recording.units[name], (1.0, recording.units[name] or "?"))
        axis.plot(
            *envelope(recording.time, np.asarray(recording.channels[name]) * factor), linewidth=0.6, color="#333333"
        )
        axis.set_ylabel(f"{name} [{unit}]")
        axis.margins(x=0)
        for part in report.segments:
            axis.axvspan(
                part.start, part.stop, color=SEGMENT_COLOURS[part.kind], alpha=0.6, linewidth=0, label=part.kind
            )
    if report.segments:
        handles, labels = axes[0].get_legend_handles_labels()
        unique = dict(zip(labels, handles, strict=True))
        axes[0].legend(unique.values(), unique.keys(), loc="upper right", ncols=len(unique), fontsize=8)
    axes[0].set_title(_title(report))
    axes[len(names) - 1].set_xlabel("time [s]")
    _draw_spectrum(axes[len(names)], report)
    if report.chatter_line is not None:
        _draw_chatter(axes[-1], report.chatter_line)
    return figure


def _title(report: RecordReport) -> str:
    parts = [f"{report.name} ({report.kind})"]
    if report.speed_found:
        parts.append(f"{report.speed_found * 30 / np.pi:.1f} rpm from {report.speed_basis}")
    if report.noise:
        factor, unit = _SHOWN.get(
            report.recording.units[report.noise.channel], (1.0, report.recording.units[report.noise.channel])
        )
        parts.append(f"noise {report.noise.rms * factor:.3g} {unit} ({report.noise.basis})")
    return ", ".join(parts)


def _draw_spectrum(axis: Any, report: RecordReport) -> None:
    recording = report.recording
    name = main_channel(recording)
    values = np.asarray(recording.channels[name])
    chosen = [part for part in report.segments if part.kind == "steady"] or [
        part for part in report.segments if part.kind == "ring-down"
    ]
    if chosen:
        values = values[samples_of(recording, max(chosen, key=lambda part: part.duration))]
    factor, unit = _SHOWN.get(recording.units[name], (1.0, recording.units[name] or "?"))
    frequencies, amplitude = amplitude_spectrum(values, recording.sampling_rate)
    axis.semilogy(
        *envelope(frequencies[1:], np.maximum(amplitude[1:] * factor, 1e-300)), linewidth=0.6, color="#333333"
    )
    named = set()
    for line in report.lines:
        label = line.kind if line.kind not in named else None
        named.add(line.kind)
        axis.plot(
            line.frequency, line.amplitude * factor, "o", markersize=4, color=_LINE_COLOURS[line.kind], label=label
        )
    if named:
        axis.legend(loc="upper right", fontsize=8)
    top = float(amplitude[1:].max(initial=0.0)) * factor
    if top > 0:
        axis.set_ylim(top * 1e-6, top * 3)
    axis.set_xlabel(f"frequency [Hz] ({chosen[0].kind if chosen else 'whole record'})")
    axis.set_ylabel(f"{name} [{unit}]")
    axis.margins(x=0)


def _draw_chatter(axis: Any, track: LineTrack) -> None:
    size = 4 + 40 * track.amplitude / track.amplitude.max()
    axis.plot(track.time, track.frequency, linewidth=0.8, color=_LINE_COLOURS["chatter"])
    axis.scatter(track.time, track.frequency, size, color=_LINE_COLOURS["chatter"], label="chatter line, larger where louder")
    axis.set_xlabel("time [s]")
    axis.set_ylabel("frequency [Hz]")
    axis.legend(loc="upper right", fontsize=8)


def save(report: RecordReport, folder: Path) -> list[Path]:
    """PNG and SVG of one record in an existing folder, named after it."""
    stem = re.sub(r"[^\w.-]+", "_", report.name)
    figure = draw(report)
    paths = [folder / f"{stem}.png", folder / f"{stem}.svg"]
    for path in paths:
        figure.savefig(path, dpi=120)
    return paths
