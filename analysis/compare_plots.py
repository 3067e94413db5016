"""Pictures of where a model fails, one question each: which record, when, at which tooth angle, at which frequency."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from analysis.compare import Comparison, tooth_angle
from analysis.inspection_plot import SEGMENT_COLOURS, envelope
from analysis.lines import amplitude_spectrum

SECTORS = 72
KINDS = tuple(SEGMENT_COLOURS)


def save(found: Comparison, folder: Path) -> list[Path]:
    """Every picture as PNG and SVG in an existing folder."""
    from matplotlib.figure import Figure

    pictures = {"residual_by_record": by_record, "worst_record": worst_record, "residual_spectrum": spectrum}
    if any(record.cut is not None for record in found.fitter.records):
        pictures["residual_by_tooth_angle"] = by_tooth_angle
    paths = []
    for name, draw in pictures.items():
        figure = Figure(figsize=(10, 5), layout="constrained")
        draw(figure, found)
        for ending in ("png", "svg"):
            paths.append(folder / f"{name}.{ending}")
            figure.savefig(paths[-1], dpi=120)
    return paths


def _worst(found: Comparison) -> int:
    """Index of the record with the largest residual in units of its noise."""
    return int(np.argmax([record.chi_square for record in found.records]))


def by_record(figure: Any, found: Comparison) -> None:
    """Residual over noise, a bar for each segment of each record."""
    axis = figure.subplots()
    kinds = [kind for kind in KINDS if any(part.kind == kind for one in found.records for part in one.segments)]
    place = np.arange(len(found.records))
    width = 0.8 / max(len(kinds), 1)
    for number, kind in enumerate(kinds):
        height = [max((part.chi_square for part in one.segments if part.kind == kind), default=np.nan) ** 0.5
                  for one in found.records]
        axis.bar(place - 0.4 + (number + 0.5) * width, height, width, label=kind, color=SEGMENT_COLOURS[kind],
                 edgecolor="#555555", linewidth=0.4)
    if not kinds:
        axis.bar(place, [one.chi_square**0.5 for one in found.records], color="#888888", label="whole record")
    axis.axhline(1.0, color="#d62728", linewidth=0.8, label="the noise")
    axis.set_yscale("log")
    axis.set_xticks(place, [one.name for one in found.records], rotation=45, ha="right")
    axis.set_ylabel("rms of residual / noise [1]")
    axis.set_title("Which records and segments does the model fail to predict?")
    axis.legend(fontsize=8, ncols=6)


def worst_record(figure: Any, found: Comparison) -> None:
    """Measured, predicted and their difference over time."""
    index = _worst(found)
    record, rest = found.fitter.records[index], found.errors[index].residual[0]
    time = record.start + np.arange(record.samples) / record.rate
    measured = record.data[0] - record.drift @ (record.drift.T @ record.data[0])
    above, below = figure.subplots(2, 1, sharex=True)
    above.plot(*envelope(time, measured), linewidth=0.6, color="#333333", label="measured")
    above.plot(*envelope(time, measured - rest), linewidth=0.6, color="#1f77b4", alpha=0.7, label="predicted")
    below.plot(*envelope(time, rest), linewidth=0.6, color="#d62728")
    for level in (-2, 2):
        below.axhline(level * record.noise[0], color="#888888", linewidth=0.6, linestyle="--")
    for segment in record.segments:
        for axis in (above, below):
            axis.axvspan(segment.start, segment.stop, color=SEGMENT_COLOURS[segment.kind], alpha=0.5, linewidth=0)
    above.set_title(f"How far is {record.name} from its prediction? (the worst record, held out of the fit)")
    above.set_ylabel(f"{record.channels[0]} [SI]")
    below.set_ylabel("measured - predicted; dashed: 2 x noise")
    below.set_xlabel("time [s]")
    above.legend(loc="upper right", fontsize=8)


def by_tooth_angle(figure: Any, found: Comparison) -> None:
    """Mean residual in sectors of the tooth's turn while cutting."""
    axis = figure.subplots()
    for index, record in enumerate(found.fitter.records):
        if record.cut is None:
            continue
        angle = tooth_angle(record, found.fit.state.angle, found.fit.state.nuisances[index])
        time = record.start + np.arange(record.samples) / record.rate
        cutting = np.zeros(record.samples, dtype=bool)
        for segment in record.segments:
            if segment.kind in ("entry", "steady"):
                cutting |= (time >= segment.start) & (time < segment.stop)
        pitch = 2 * np.pi / record.flutes
        place = (angle[cutting] / pitch * SECTORS).astype(int) % SECTORS
        count = np.bincount(place, minlength=SECTORS)
        mean = np.bincount(place, found.errors[index].residual[0][cutting] / record.noise[0], minlength=SECTORS)
        axis.plot((np.arange(SECTORS) + 0.5) / SECTORS * np.degrees(pitch), mean / np.maximum(count, 1), linewidth=1,
                  label=record.name)
    axis.set_xlabel("angle since the tooth's entry [deg]")
    axis.set_ylabel("mean residual / noise [1]")
    axis.set_title("Does what is left depend on the tooth's angle?")
    axis.legend(fontsize=7, ncols=4)


def spectrum(figure: Any, found: Comparison) -> None:
    """Amplitude spectrum of the worst record's residual, tooth-passing harmonics and natural frequency marked."""
    axis = figure.subplots()
    index = _worst(found)
    record = found.fitter.records[index]
    frequencies, amplitude = amplitude_spectrum(found.errors[index].residual[0], record.rate)
    axis.semilogy(*envelope(frequencies[1:], np.maximum(amplitude[1:], 1e-300)), linewidth=0.6, color="#333333")
    natural = found.fit.state.model.structure.natural_frequency
    highest = min(frequencies[-1], 8 * natural)
    axis.axvline(natural, color="#1f77b4", linewidth=1, label="natural frequency")
    if record.cut is not None:
        tooth = record.flutes / record.period
        for order in range(1, int(highest / tooth) + 1):
            axis.axvline(order * tooth, color="#2ca02c", linewidth=0.7, linestyle=":",
                         label="tooth passing and harmonics" if order == 1 else None)
    axis.set_xlim(0, highest)
    axis.set_xlabel("frequency [Hz]")
    axis.set_ylabel(f"residual {record.channels[0]} [SI]")
    axis.set_title(f"At which frequencies does the model miss {record.name}?")
    axis.legend(fontsize=8)
