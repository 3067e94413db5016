"""The page of `testbed tap`: measured and fitted responses, coherence, the poles that hold, the blows."""

from __future__ import annotations

from typing import Any

import numpy as np

from testbed.analysis.estimate import Estimate
from testbed.analysis.report.machine import interval, shown
from testbed.analysis.report.packed import listed
from testbed.analysis.report.page import Page, Panel
from testbed.analysis.tap.result import Group, TapResult

_POINTS = 1500  # of a curve
_MEASURED, _FITTED = "#2b7bba", "#d1495b"


def tap_page(found: TapResult, name: str = "") -> Page:
    """The whole page."""
    page = Page(f"Which modes does the tap show?{' ' + name if name else ''}")
    used = sum(blow.used for blow in found.blows)
    page.verdict(f"{len(found.modes)} modes; real modes leave {found.residual:.1%} of the measured responses unexplained.")
    page.tiles((("modes", str(len(found.modes))), ("residual", f"{found.residual:.1%}"),
                ("blows used", f"{used} of {len(found.blows)}")))
    for note in found.notes:
        page.text(note, small=True)
    page.heading("What are the modes?")
    names = ("natural_frequency", "damping_ratio", "mass", "direction")
    page.table(("mode", "on", *(one.replace("_", " ") for one in names), "intervals, 95 %"),
               [(str(number), mode.on, *(shown(getattr(mode, one).value, getattr(mode, one).unit) for one in names),
                 "; ".join(_told(getattr(mode, one)) for one in names[:3])) for number, mode in enumerate(found.modes)])
    if found.decays:
        _decays(page, found)
    if found.groups:
        page.heading("Do the modes explain the responses?")
    for group in found.groups:
        for place in range(len(group.responses)):
            _response(page, group, place)
    if found.groups:
        page.heading("Which poles hold?")
        page.answer("A pole that comes back, from order to order of the polynomial, is one of the structure's; others are "
                    "noise.")
        for group in found.groups:
            page.figure(_stabilisation(group), "poles over frequency and order")
        page.heading("How many modes?")
        page.table(("responses", "modes", "gain of BIC over the number kept before", "weighted misfit", "kept"),
                   [(", ".join(one.name for one in group.responses), str(count), f"{step.gain:.0f}", f"{step.fit.cost:.4g}",
                     "here" if count == len(group.fit.parameters) else "")
                    for group in found.groups for count, step in enumerate(group.steps)])
    if found.blows:
        page.heading("Which blows were used?")
        page.table(("record", "time", "force", "used"),
                   [(blow.tap, shown(blow.time, "s"), shown(blow.force, "N"), "yes" if blow.used else blow.why)
                    for blow in found.blows])
    return page


def _told(one: Estimate) -> str:
    return interval(one) if one.determined else "not determined"


def _decays(page: Page, found: TapResult) -> None:
    """What rings after each blow whose force nobody measured."""
    page.heading("What rings after each blow without force?")
    page.answer("Free decays tell frequencies, damping ratios and shapes; masses only a measured force tells.")
    page.table(("record", "from", "natural frequency", "damping ratio", "shape", "left"),
               [(one.tap, shown(one.ring.start, "s"), interval(mode.natural_frequency), interval(mode.damping_ratio),
                 ", ".join(f"{name} {part.value:+.3g}" for name, part in mode.shape.items()), f"{one.ring.residual:.1%}")
                for one in found.decays for mode in one.ring.modes])


def _line(x: np.ndarray, y: np.ndarray, name: str, colour: str, **more: Any) -> dict[str, Any]:
    return {"type": "scatter", "mode": "lines", "x": listed(x, 6), "y": listed(y), "name": name,
            "line": {"color": colour, "width": 1.3}, **more}


def _response(page: Page, group: Group, place: int) -> None:
    one, mask = group.responses[place], group.fit.lines.masks[place]
    frequency, fitted = one.frequency[mask], group.fit.fitted()[place]
    drawn = group.drawn(place)
    every = slice(drawn.start, drawn.stop, max(1, (drawn.stop - drawn.start) // _POINTS))
    fine = slice(None, None, max(1, len(frequency) // _POINTS))
    unit = 1e6  # um/N
    traces = [_line(one.frequency[every], np.abs(one.receptance[every]) * unit, "measured", _MEASURED),
              _line(frequency[fine], np.abs(fitted[fine]) * unit, "fitted", _FITTED)]
    layout: dict[str, Any] = {"xaxis": {"title": {"text": "frequency [Hz]"}},
                              "yaxis": {"title": {"text": "receptance [um/N]"}, "type": "log"}}
    parts = [_line(one.frequency[every], one.receptance.imag[every] * unit, "measured, imaginary part", _MEASURED),
             _line(frequency[fine], fitted.imag[fine] * unit, "fitted, imaginary part", _FITTED)]
    panels = {(0,): Panel(traces, layout), (1,): Panel(parts, {**layout, "yaxis": {"title": {"text": "receptance [um/N]"}}})}
    options = ["size", "imaginary part"]
    if one.coherence is not None:
        options.append("coherence")
        panels[(2,)] = Panel([_line(one.frequency[every], one.coherence[every], "coherence", _MEASURED)],
                             {**layout, "yaxis": {"title": {"text": "coherence"}, "range": [0.0, 1.02]}})
    page.answer(f"{one.name}, on the {one.on}: {group.residuals[place]:.1%} is left, from {frequency[0]:.5g} to "
                f"{frequency[-1]:.5g} Hz.")
    page.choices([("shown", options)], panels, describe=f"measured and fitted response of {one.name}")


def _stabilisation(group: Group) -> Panel:
    found = group.stabilisation
    dots = {"type": "scatter", "mode": "markers", "x": listed(found.frequency, 6), "y": listed(found.order),
            "name": "poles", "marker": {"size": 3, "color": _MEASURED}}
    modes = [{"type": "scatter", "mode": "lines", "x": [hertz, hertz], "y": [0, float(found.order.max(initial=1.0))],
              "name": f"{hertz:.5g} Hz", "line": {"color": _FITTED, "width": 1}, "showlegend": False}
             for hertz in np.sort(np.exp(group.fit.parameters[:, 0]) / (2.0 * np.pi))]
    return Panel([dots, *modes], {"xaxis": {"title": {"text": "frequency [Hz]"}}, "yaxis": {"title": {"text": "order"}}})
