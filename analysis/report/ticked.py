"""Effects to tick: measured against predicted, and the error, of every set of effects that was fitted; and what was left
before beside what is left after."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from testbed.analysis.comparison.residual_views import by_angle, by_frequency
from testbed.analysis.fit.fit_state import State
from testbed.analysis.fit.held_out import RecordError, pooled
from testbed.analysis.report.packed import even, packed, thinned
from testbed.analysis.report.page import Page, Panel
from testbed.analysis.report.waveforms import BEFORE, LEFT, MEASURED, PREDICTED, Look, line_trace, shading, without_drift

BUDGET = 350_000  # points of the page's waveforms together
MOST_SETS = 16
Sets = Mapping[frozenset[str], Sequence[RecordError]]


def named(effects: Sequence[str] | frozenset[str]) -> str:
    """A set of effects in words."""
    return " + ".join(sorted(effects)) or "no effect"


def points_for(found: Sequence[Look], sets: Sets) -> int:
    """Points of one trace, so that all of them together stay within the budget."""
    return int(np.clip(BUDGET / max(2 * len(found) * len(sets), 1), 200, 1600)) // 2 * 2


def leading(sets: Sets, keep: frozenset[str]) -> dict[frozenset[str], Sequence[RecordError]]:
    """The sets to be shown: none, the one named, and the best others."""
    order = sorted(sets, key=lambda one: (one != frozenset(), one != keep, pooled(sets[one])[0], sorted(one)))
    return {one: sets[one] for one in order[:MOST_SETS]}


def add_ticks(page: Page, found: Sequence[Look], sets: Sets, ticked: frozenset[str]) -> None:
    """Boxes for effects, a chooser for the record; each set that was fitted has its own prediction and error."""
    page.heading("What does each effect do to the error? Tick and see")
    shown = leading(sets, ticked)
    names = sorted({name for one in shown for name in one}, key=lambda name: (name not in ticked, name))
    points = points_for(found, shown)
    panels = {
        (one, place): _ticked_panel(look, errors, shown[frozenset()], one, points)
        for one, errors in shown.items()
        for place, look in enumerate(found)
    }
    fitted = "; ".join(named(one) for one in shown)
    page.ticks(
        "the model with",
        names,
        sorted(ticked),
        ("record", [look.label for look in found]),
        panels,
        f"This set was not fitted. Those that were: {fitted}.",
        {
            "height": 480,
            "yaxis": {"domain": [0.42, 1]},
            "yaxis2": {"domain": [0, 0.34], "anchor": "x"},
            "xaxis": {"title": {"text": "time [s]"}, "anchor": "y2"},
        },
    )


def _ticked_panel(
    look: Look, errors: Sequence[RecordError], without: Sequence[RecordError], effects: frozenset[str], points: int
) -> Panel:
    own, bare = errors[look.index], without[look.index]
    measured, rest = without_drift(look), own.residual[look.row] * look.factor
    rows = [
        ("measured", measured, MEASURED, "y"),
        ("predicted", measured - rest, PREDICTED, "y"),
        ("residual", rest, LEFT, "y2"),
    ]
    if effects:
        rows.insert(2, ("residual without the effects", bare.residual[look.row] * look.factor, BEFORE, "y2"))
    traces = []
    for name, values, colour, axis in rows:
        time, row = thinned(values, look.record.start, look.record.rate, points)
        traces.append(line_trace(name, time, row, axis, colour, 1, 0.55 if name.endswith("effects") else 0.9))
    end = look.record.start + look.record.samples / look.record.rate
    reach = 1.05 * float(np.abs(bare.residual[look.row]).max()) * look.factor
    layout = {
        "shapes": shading(look, look.record.start, end),
        "yaxis": {"title": {"text": f"{look.channel} [{look.unit}]"}},
        "yaxis2": {"title": {"text": f"residual [{look.unit}]"}, "range": [-reach, reach]},
    }
    change = f" ({own.error / bare.error - 1:+.0%} against {bare.error:.4f} without)" if effects else ""
    all_now, floor = pooled(errors)
    says = (
        f"With {named(effects)}: error {own.error:.4f}{change} on {look.label}, noise floor {own.noise_floor:.4f}. "
        f"All records: {all_now:.4f}, noise floor {floor:.4f}."
    )
    return Panel(traces, layout, says)


def add_before_after(
    page: Page,
    found: Sequence[Look],
    before: Sequence[RecordError],
    after: Sequence[RecordError],
    states: tuple[State, State],
    points: int,
    effects: frozenset[str],
) -> None:
    """Residuals side by side on one scale: over time, over the tooth's angle, over frequency.

    states: of the fit before and of the fit after; each residual is seen by the tooth angle, speed and natural frequency of
    its own fit.
    """
    page.heading("What was left before, and what is left after?")
    excess = [math.sqrt(max(error**2 - floor**2, 0.0)) for error, floor in (pooled(before), pooled(after))]
    page.answer(
        f"Beyond the noise {excess[0]:.2%} of the signal was unexplained before; with {named(effects)} "
        + (f"it is {excess[1]:.2%}." if excess[1] > 0 else "nothing is left beyond the noise.")
    )
    kinds = ["over time", "over the tooth's angle", "over frequency"]
    if all(look.record.cut is None for look in found):
        kinds.remove("over the tooth's angle")
    panels = {}
    for place, look in enumerate(found):
        pair = (before[look.index], after[look.index])
        for column, kind in enumerate(kinds):
            sides = [_side(look, error, state, kind, points) for error, state in zip(pair, states, strict=True)]
            panels[place, column] = _pair(look, sides, kind, pair)
    page.choices(
        [("record", [look.label for look in found]), ("shown", kinds)],
        panels,
        {"height": 340, "grid": {"rows": 1, "columns": 2, "pattern": "independent", "ygap": 0.25}, "yaxis2": {"matches": "y"}},
        "residual before and after",
    )


def _side(look: Look, error: RecordError, state: State, kind: str, points: int) -> tuple[Any, Any] | None:
    """(x, y) rows of one residual seen one way; None where the record cannot be seen so."""
    if kind == "over time":
        return thinned(error.residual[look.row] * look.factor, look.record.start, look.record.rate, points)
    if kind == "over frequency":
        view = by_frequency(look.record, error, state, look.index)[look.row]
        step = float(view.frequency[1] - view.frequency[0])
        return thinned(view.amplitude[1:] * look.factor, float(view.frequency[1]), 1.0 / step, 1200, logarithmic=True)
    views = by_angle(look.record, error, state, look.index)
    if not views:
        return None
    angle = views[look.row].angle
    return even(angle[0], angle[1] - angle[0], len(angle)), packed(views[look.row].mean)


def _pair(look: Look, sides: Sequence[tuple[Any, Any] | None], kind: str, pair: Sequence[RecordError]) -> Panel:
    label = {"over time": "time [s]", "over frequency": "frequency [Hz]"}.get(kind, "angle since the tooth's entry [deg]")
    unit = "mean residual / noise" if kind == "over the tooth's angle" else f"residual [{look.unit}]"
    traces = []
    for side, name, colour, axis in zip(sides, ("before", "after"), (BEFORE, LEFT), ("", "2"), strict=True):
        if side is None:
            return Panel([], {}, f"{look.label} is no cut.")
        line = {"color": colour, "width": 1}
        place = {"xaxis": f"x{axis}", "yaxis": f"y{axis}"}
        traces.append({"type": "scatter", "mode": "lines", "name": name, "x": side[0], "y": side[1], "line": line, **place})
    scale = "log" if kind == "over frequency" else "linear"
    layout = {
        "xaxis": {"title": {"text": label}},
        "xaxis2": {"title": {"text": label}},
        "yaxis": {
            "title": {"text": unit},
            "type": scale,
            "exponentformat": "power",
            **({"dtick": 1} if scale == "log" else {}),
        },
        "yaxis2": {"type": scale, "exponentformat": "power", **({"dtick": 1} if scale == "log" else {})},
    }
    return Panel(traces, layout, f"{look.label}: error {pair[0].error:.4f} before, {pair[1].error:.4f} after.")
