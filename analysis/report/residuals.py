"""Sections on what is left: by record and segment, by the tooth's angle, by frequency."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any, TypeVar

import numpy as np

from testbed.analysis.comparison.adequacy import LEFT_EXPLAINED, Adequacy, said_left
from testbed.analysis.comparison.compare import RecordComparison
from testbed.analysis.comparison.residual_views import AngleView, SpectrumView, by_angle, by_frequency
from testbed.analysis.fit.fit_state import State
from testbed.analysis.fit.held_out import RecordError
from testbed.analysis.report.packed import even, packed, thinned
from testbed.analysis.report.page import Cell, Page, Panel
from testbed.analysis.report.waveforms import LEFT, Look

View = TypeVar("View", AngleView, SpectrumView)
KINDS = ("idle", "entry", "steady", "exit", "ring-down")
MULTIPLES = 30  # of a frequency that are drawn
SPECTRUM_BUDGET = 40_000  # points of all spectra of one page
CALM, HOT = 1.1, 10.0  # residual over noise at which a cell is palest and reddest


def heat(ratio: float) -> float:
    """0 where a residual is noise, 1 where it is ten times the noise, by the logarithm."""
    return math.log(max(ratio, 1e-9) / CALM) / math.log(HOT / CALM)


def add_records(page: Page, records: Sequence[RecordComparison], tests: Sequence[Adequacy]) -> None:
    """The table of records and segments: residual over noise, coloured."""
    page.heading("Which records and segments does the model fail to predict?")
    kinds = [kind for kind in KINDS if any(part.kind == kind for one in records for part in one.segments)]
    rows = []
    for one in records:
        ratio = math.sqrt(one.chi_square)
        worst = {kind: max((part.chi_square for part in one.segments if part.kind == kind), default=None) for kind in kinds}
        cells = ["-" if value is None else Cell(f"{math.sqrt(value):.2f}", heat(math.sqrt(value))) for value in worst.values()]
        rows.append(
            (
                one.name,
                f"{one.error:.4f}",
                f"{one.noise_floor:.4f}",
                f"{one.chi_square:.2f}",
                Cell(f"{ratio:.2f}", heat(ratio)),
                *cells,
                said_left(tests, one.name),
            )
        )
    worst_one = max(records, key=lambda one: one.chi_square)
    parts = sorted(worst_one.segments, key=lambda part: -part.chi_square)
    where = f", most in {parts[0].kind} ({math.sqrt(parts[0].chi_square):.1f} times)" if parts else ""
    failing_records = {test.record for test in tests if test.fails}
    hold = "hold" if len(records) > 1 else "holds"
    page.answer(
        f"{len(failing_records)} of {len(records)} records {hold} more than noise. The worst is {worst_one.name}: its "
        f"residual is {math.sqrt(worst_one.chi_square):.2f} times its noise{where}."
    )
    page.table(("record", "error", "noise floor", "chi-square", "residual / noise", *kinds, "what is left is"), rows)
    page.text(
        "error = rms(measured - predicted) / rms(measured about its mean); the columns from residual / noise on are in "
        f"units of the noise, 1 is nothing but noise. chi-square is the mean square of those. M{LEFT_EXPLAINED[1:]}: "
        "tests (rms, autocorrelation, tooth angle, parameters) with 5 % of false discoveries among them.",
        small=True,
    )


def _views(
    view_of: Callable[..., Sequence[View]], found: Sequence[Look], errors: Sequence[RecordError], state: State
) -> dict[tuple[int, int], View]:
    """One kind of view of every channel looked at, by (record, channel)."""
    return {
        (look.index, look.row): view
        for look in found
        for view in view_of(look.record, errors[look.index], state, look.index)
        if view.channel == look.record.channels[look.row]
    }


def add_angle(
    page: Page, found: Sequence[Look], errors: Sequence[RecordError], state: State, tests: Sequence[Adequacy] = ()
) -> None:
    """Residual unrolled over one turn of the spindle."""
    views = _views(by_angle, found, errors, state)
    if not views:
        return
    page.heading("Does what is left depend on the angle of the tooth?")
    all_tests = [test for test in tests if test.test == "tooth angle"]
    failing = [test for test in all_tests if test.fails]
    view = max(views.values(), key=lambda one: np.nanmax(np.abs(one.mean)))
    place, size = view.peak
    inside = (place % view.pitch) < view.engaged
    if all_tests and not failing:
        page.answer("No: in no record does the mean residual at any angle differ from zero by more than chance allows.")
    else:
        many = f"in {len(failing)} of {len(all_tests)} records. " if all_tests else ""
        page.answer(
            f"Yes, {many}It is largest in {view.name}, at {place:.0f} deg after entry, "
            f"{'with the tooth in the cut' if inside else 'with no tooth in the cut'}: "
            f"{size:+.1f} times the noise."
        )
    chosen = [look for look in found if (look.index, look.row) in views]
    panels = {(row,): _angle_panel(views[look.index, look.row]) for row, look in enumerate(chosen)}
    page.choices(
        [("record", [look.label for look in chosen])],
        panels,
        {
            "height": 340,
            "xaxis": {"title": {"text": "angle since the tooth's entry [deg]"}, "dtick": 45},
            "yaxis": {"title": {"text": "mean residual / noise"}},
        },
        "mean residual by tooth angle",
    )


def _angle_panel(view: AngleView) -> Panel:
    shade = [
        {
            "type": "rect",
            "xref": "x",
            "yref": "paper",
            "x0": first,
            "x1": first + view.engaged,
            "y0": 0,
            "y1": 1,
            "line": {"width": 0},
            "fillcolor": "rgba(224,142,43,.2)",
            "layer": "below",
        }
        for first in np.arange(0.0, 360.0 - 1e-9, view.pitch)
    ]
    band = 2.0 * view.error
    x = even(view.angle[0], view.angle[1] - view.angle[0], len(view.angle))
    edge: dict[str, Any] = {
        "type": "scatter",
        "mode": "lines",
        "x": x,
        "line": {"width": 0},
        "hoverinfo": "skip",
        "showlegend": False,
    }
    traces: list[dict[str, Any]] = [
        edge | {"y": packed(-band)},
        edge
        | {
            "y": packed(band),
            "fill": "tonexty",
            "fillcolor": "rgba(128,128,128,.3)",
            "showlegend": True,
            "name": "what chance leaves (95 %)",
        },
        {
            "type": "scatter",
            "mode": "lines",
            "name": "mean residual",
            "x": x,
            "y": packed(view.mean),
            "line": {"color": LEFT, "width": 2},
        },
    ]
    beyond = float(np.mean(np.abs(view.mean) > band))
    place, size = view.peak
    return Panel(
        traces,
        {"shapes": shade},
        f"{view.name}: {beyond:.0%} of the angles lie beyond what chance leaves (5 % would by "
        f"chance); the peak is {size:+.2f} times the noise at {place:.0f} deg. Shaded: a tooth in the cut.",
    )


def add_spectrum(page: Page, found: Sequence[Look], errors: Sequence[RecordError], state: State) -> None:
    """Residual spectrum with the lines it could have."""
    views = _views(by_frequency, found, errors, state)
    if not views:
        return
    page.heading("At which frequencies does the model miss?")
    loud = [view for view in views.values() if view.ratio > 1.05]
    if not loud:
        page.answer("At none in particular: every residual is as large as the noise.")
    else:
        weight = np.array([view.ratio**2 for view in loud])
        mean = {name: float(np.average([view.shares[name] for view in loud], weights=weight)) for name in loud[0].shares}
        first, second = sorted(mean, key=lambda name: -mean[name])[:2]
        page.answer(
            f"Of the residuals' power {mean[first]:.0%} is {_where(first)} and {mean[second]:.0%} {_where(second)} "
            f"(all records weighed by their residual)."
        )
    points = int(np.clip(SPECTRUM_BUDGET / len(found), 300, 2400)) // 2 * 2
    panels = {(row,): _spectrum_panel(views[look.index, look.row], look, points) for row, look in enumerate(found)}
    page.choices(
        [("record", [look.label for look in found])],
        panels,
        {
            "height": 380,
            "xaxis": {"title": {"text": "frequency [Hz]"}},
            "yaxis": {"type": "log", "exponentformat": "power", "dtick": 1},
        },
        "amplitude spectrum of the residual",
    )


def _where(share: str) -> str:
    return {
        "tooth passing": "at tooth-passing harmonics",
        "spindle, not tooth": "at other multiples of the spindle's turns",
        "natural frequency": "about the natural frequency",
        "elsewhere": "elsewhere",
    }[share]


def _multiples(base: float) -> tuple[float, ...]:
    """A frequency and its multiples, as many as are drawn; none of 0."""
    return tuple(order * base for order in range(1, MULTIPLES + 1)) if base > 0.0 else ()


def _spectrum_panel(view: SpectrumView, look: Look, points: int) -> Panel:
    step = view.frequency[1] - view.frequency[0]
    values = np.maximum(view.amplitude[1:] * look.factor, 1e-300)
    x, y = thinned(values, float(view.frequency[1]), 1.0 / step, points, logarithmic=True)
    measured = np.maximum(view.measured[1:] * look.factor, 1e-300)
    _, above = thinned(measured, float(view.frequency[1]), 1.0 / step, points, logarithmic=True)
    low, high = float(np.median(values)) * 0.1, float(max(values.max(), measured.max())) * 2.0
    line = {"type": "scatter", "mode": "lines", "x": x}
    traces: list[dict[str, Any]] = [
        line | {"name": "measured", "y": above, "line": {"color": "@muted", "width": 1}, "opacity": 0.5},
        line | {"name": "residual", "y": y, "line": {"color": LEFT, "width": 1}},
    ]
    top = float(view.frequency[-1])
    turns = () if view.spindle == view.tooth else _multiples(view.spindle)
    lines = (
        ("once per revolution and its multiples", turns, "#8b6fc0", "dot"),
        ("tooth passing and harmonics", _multiples(view.tooth), "#2a9d6f", "dash"),
        ("natural frequency" if len(view.natural) < 2 else "natural frequencies", view.natural, "#3b82c4", "solid"),
    )
    for name, drawn, colour, dash in lines:
        if not drawn:
            continue
        places = [one for one in drawn if one <= top]
        xs = [value for place in places for value in (place, place, None)]
        ys = [value for _ in places for value in (low, high, None)]
        traces.insert(
            0,
            {
                "type": "scatter",
                "mode": "lines",
                "name": name,
                "x": [None if v is None else round(v, 4) for v in xs],
                "y": ys,
                "line": {"color": colour, "width": 1.2, "dash": dash},
                "hoverinfo": "x",
            },
        )
    shares = "; ".join(f"{share:.0%} {_where(name)}" for name, share in view.shares.items() if share >= 0.005)
    return Panel(
        traces,
        {
            "yaxis": {"title": {"text": f"amplitude [{look.unit}]"}, "range": [math.log10(low), math.log10(high)]},
            "xaxis": {"range": [0, top]},
        },
        f"{look.label}: residual power {shares}.",
    )
