"""Measured against predicted, with what is left below: whole records as envelopes, short stretches sample by sample."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from testbed.analysis.comparison.residual_views import shown_unit
from testbed.analysis.fit.held_out import RecordError
from testbed.analysis.fit.observed import Observed
from testbed.analysis.report.packed import thinned
from testbed.analysis.report.page import Page, Panel

MEASURED, PREDICTED, LEFT, BEFORE = "@ink", "#3b82c4", "#d1495b", "#e08e2b"
BUDGET = 350_000  # points of all waveforms of a page together: two bytes each, a third more as text
SHADES = {
    "idle": "rgba(140,140,140,.14)",
    "entry": "rgba(240,160,60,.18)",
    "steady": "rgba(80,170,90,.12)",
    "exit": "rgba(220,90,80,.18)",
    "ring-down": "rgba(70,130,200,.16)",
}
TURNS = 6  # revolutions of a stretch that is drawn sample by sample


@dataclass(frozen=True)
class Look:
    """One channel of one record: which, its unit as drawn, and what it is called in a chooser."""

    record: Observed
    index: int
    row: int
    factor: float
    unit: str
    label: str

    @property
    def channel(self) -> str:
        """What was measured."""
        return self.record.channels[self.row]


def looks(records: Sequence[Observed], units: Mapping[str, str]) -> list[Look]:
    """Every channel of every record. units: SI or own, by channel."""
    found = []
    for index, record in enumerate(records):
        for row, channel in enumerate(record.channels):
            factor, unit = shown_unit(units.get(channel, ""))
            label = record.name if len(record.channels) == 1 else f"{record.name}, {channel}"
            found.append(Look(record, index, row, factor, unit, label))
    return found


def worst_first(found: Sequence[Look], errors: Sequence[RecordError]) -> list[Look]:
    """Looks ordered by residual over noise, the worst first."""
    return sorted(found, key=lambda look: -_ratio(look, errors))


def _ratio(look: Look, errors: Sequence[RecordError]) -> float:
    return float(np.sqrt(np.mean(errors[look.index].residual[look.row] ** 2))) / float(look.record.noise[look.row])


def without_drift(look: Look) -> np.ndarray:
    """What was measured, less offset and slow drift, in the unit drawn."""
    values, drift = look.record.data[look.row], look.record.drift
    return (values - drift @ (drift.T @ values)) * look.factor


def stretches(record: Observed) -> dict[str, tuple[int, int]]:
    """(first, last sample) of stretches worth a close look: round the entry, amid steady cutting, round the exit."""
    turn = record.period * record.rate if record.cut is not None else 0.0
    length = int(min(max(TURNS * turn, 200), 1200, record.samples)) if turn else min(1200, record.samples)
    wanted: dict[str, float] = {}
    for segment in record.segments:
        first, last = ((time - record.start) * record.rate for time in (segment.start, segment.stop))
        if segment.kind == "entry":
            wanted.setdefault("entry", first - 0.15 * length)
        elif segment.kind == "steady":
            wanted.setdefault("steady cutting", 0.5 * (first + last - length))
        elif segment.kind == "ring-down":
            wanted.setdefault("exit" if record.cut is not None else "start of the decay", first - 0.3 * length)
    if not wanted and record.samples > 2 * length:
        loudest = int(np.argmax(np.abs(record.data[0] - record.data[0].mean())))
        wanted["largest motion"] = loudest - 0.5 * length
    found = {}
    for name, begin in wanted.items():
        first = int(min(max(begin, 0), record.samples - length))
        found[name] = (first, first + length)
    return found


def _lines(look: Look, rest: np.ndarray, part: tuple[int, int] | None, points: int) -> list[dict[str, Any]]:
    """Traces of measured, predicted and what is left, of a stretch or (None) of the whole record."""
    measured, rest = without_drift(look), rest * look.factor
    first, last = part or (0, len(measured))
    start = look.record.start + first / look.record.rate
    traces = []
    for name, values, colour, below in (
        ("measured", measured, MEASURED, ""),
        ("predicted", measured - rest, PREDICTED, ""),
        ("residual (measured - predicted)", rest, LEFT, "2"),
    ):
        time, row = thinned(values[first:last], start, look.record.rate, points if part is None else last - first)
        width = 2.2 if part and name == "measured" else 1.2
        traces.append(line_trace(name, time, row, f"y{below}", colour, width, 0.85 if name == "predicted" else 1.0))
    return traces


def line_trace(name: str, x: Any, y: Any, axis: str, colour: str, width: float, opacity: float) -> dict[str, Any]:
    """A line of a picture, against the vertical axis of that name."""
    return {
        "type": "scatter",
        "mode": "lines",
        "name": name,
        "x": x,
        "y": y,
        "yaxis": axis,
        "line": {"color": colour, "width": width},
        "opacity": opacity,
    }


def shading(look: Look, first: float, last: float) -> list[dict[str, Any]]:
    """The segments between two times (s) as shaded ground."""
    return [
        {
            "type": "rect",
            "xref": "x",
            "yref": "paper",
            "x0": max(part.start, first),
            "x1": min(part.stop, last),
            "y0": 0,
            "y1": 1,
            "line": {"width": 0},
            "fillcolor": SHADES[part.kind],
            "layer": "below",
        }
        for part in look.record.segments
        if part.stop > first and part.start < last
    ]


def _says(look: Look, error: RecordError) -> str:
    rest = error.residual[look.row] * look.factor
    place = int(np.argmax(np.abs(rest)))
    time = look.record.start + place / look.record.rate
    where = next((part.kind for part in look.record.segments if part.start <= time <= part.stop), "")
    return (
        f"{look.label}: {error.error:.1%} of its signal is unexplained (noise alone {error.noise_floor:.1%}). The largest "
        f"difference, {abs(rest[place]):.3g} {look.unit}, is at {time:.3f} s{', in ' + where if where else ''}."
    )


def add_waveforms(page: Page, found: Sequence[Look], errors: Sequence[RecordError]) -> None:
    """The section: a chooser of record and one of stretch."""
    page.heading("Does the prediction follow the measurement, and where does it not?")
    if not found:
        return
    parts = {name for look in found for name in stretches(look.record)}
    order = [
        "whole record",
        *(name for name in ("entry", "steady cutting", "exit", "start of the decay", "largest motion") if name in parts),
    ]
    close = sum(last - first for look in found for first, last in stretches(look.record).values()) * 3
    points = int(np.clip((BUDGET - min(close, BUDGET // 2)) / (3 * len(found)), 300, 3000)) // 2 * 2
    if close > BUDGET // 2:  # many records: no room for close looks at all of them
        order = order[:1]
    panels = {}
    for row, look in enumerate(found):
        error = errors[look.index]
        own = stretches(look.record)
        for column, name in enumerate(order):
            part = own.get(name) if column else None
            if column and part is None:
                panels[row, column] = Panel([], {}, f"{look.label} has no such stretch.")
                continue
            ends = part or (0, look.record.samples)
            first, last = (look.record.start + place / look.record.rate for place in ends)
            noise = 2 * float(look.record.noise[look.row]) * look.factor
            bars = [
                {
                    "type": "line",
                    "xref": "paper",
                    "yref": "y2",
                    "x0": 0,
                    "x1": 1,
                    "y0": level,
                    "y1": level,
                    "line": {"color": "@muted", "width": 1, "dash": "dot"},
                }
                for level in (-noise, noise)
            ]
            layout = {
                "shapes": [*shading(look, first, last), *bars],
                "yaxis": {"title": {"text": f"{look.channel} [{look.unit}]"}},
                "yaxis2": {"title": {"text": f"residual [{look.unit}]"}},
            }
            panels[row, column] = Panel(_lines(look, error.residual[look.row], part, points), layout, _says(look, error))
    shared = {
        "height": 480,
        "yaxis": {"domain": [0.42, 1]},
        "yaxis2": {"domain": [0, 0.34], "anchor": "x"},
        "xaxis": {"title": {"text": "time [s]"}, "anchor": "y2"},
    }
    page.choices(
        [("record", [look.label for look in found]), ("stretch", order)],
        panels,
        shared,
        "measured and predicted over time, the difference below",
    )
    shaded = any(look.record.segments for look in found)
    page.text(
        ("Shaded: idle grey, entry orange, steady green, exit red, ring-down blue. " if shaded else "")
        + "Dotted: twice the noise. A whole record is drawn as its envelope, a stretch sample by sample; offset and slow drift "
        "are taken out.",
        small=True,
    )
