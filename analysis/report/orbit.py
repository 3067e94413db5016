"""The section of orbits: motion along y over motion along x, measured and predicted."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from testbed.analysis.comparison.orbit import TURNS, Orbit
from testbed.analysis.report.packed import packed
from testbed.analysis.report.page import Page, Panel
from testbed.analysis.report.waveforms import MEASURED, PREDICTED, line_trace

MOST = 24  # orbits on one page, the worst first


def add_orbits(page: Page, found: Sequence[Orbit]) -> None:
    """Orbits with a chooser; nothing where no cut was measured along x and y alike."""
    if not found:
        return
    page.heading("Does the motion in the plane turn as predicted?")
    worst = found[0]
    page.answer(f"{worst.name}, {worst.quantity}: what is left is {worst.noise:.2f} times the noise, the most of all orbits.")
    shown = found[:MOST]
    panels: dict[tuple[int, ...], Panel] = {}
    for row, one in enumerate(shown):
        drawn = (("measured", one.measured, MEASURED, 2.0), ("predicted", one.predicted, PREDICTED, 1.2))
        lines: list[dict[str, Any]] = [line_trace(name, packed(values[0]), packed(values[1]), "y", colour, width, 0.85)
                                       for name, values, colour, width in drawn]
        layout = {"xaxis": {"title": {"text": f"along x, the feed [{one.unit}]"}},
                  "yaxis": {"title": {"text": f"along y [{one.unit}]"}, "scaleanchor": "x"}}
        panels[row,] = Panel(lines, layout, f"{one.name}, {one.quantity}: residual {one.noise:.2f} times the noise.")
    page.choices([("record", [f"{one.name}, {one.quantity}" for one in shown])], panels, {"height": 420},
                 "motion along y over motion along x")
    page.text(f"{TURNS} revolutions amid steady cutting, sample by sample; offset and slow drift are taken out.", small=True)
