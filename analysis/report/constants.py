"""Sections on the machine's constants: are they constant test by test, and do they depend on amplitude?"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from testbed.analysis.comparison.amplitude import AmplitudeDependence
from testbed.analysis.comparison.constancy import COVARIATES, Constancy, said_p
from testbed.analysis.comparison.residual_views import drawn_units
from testbed.analysis.estimate import Estimate
from testbed.analysis.information import Z_95
from testbed.analysis.report.machine import shown
from testbed.analysis.report.packed import listed
from testbed.analysis.report.page import Page, Panel

COLOURS = ("#3b82c4", "#d1495b", "#2a9d6f", "#e08e2b", "#8b6fc0", "#5b9aa0", "#b5651d", "#c45ab3")
SYMBOLS = {"natural_frequency": "f_n", "damping_ratio": "ζ", "tangential_coefficient": "K_t", "normal_coefficient": "K_n"}
_COVARIATE_UNITS = {
    "spindle speed": (30 / math.pi, "rpm"),
    "depth of cut": (1e3, "mm"),
    "feed per tooth": (1e3, "mm"),
    "depth over speed": (1e6, "µm s/rad"),
}


def add_constancy(page: Page, found: Constancy, joint: Mapping[str, Estimate]) -> None:
    """Base parameters test by test against the conditions."""
    if not found.parameters or len(found.tests) < 2:
        return
    page.heading("Are the machine's constants constant, fitted test by test?")
    drifting = [name for name in found.parameters if found.drift(name) is not None]
    if drifting:
        page.answer("No: " + "; ".join(f"{name} {found.verdict(name)}" for name in drifting) + ".")
    else:
        loose = [name for name in found.parameters if "scatters by" in found.verdict(name)]
        slight = [name for name in found.parameters if "too little to matter" in found.verdict(name)]
        page.answer(
            f"Not all: {', '.join(loose)} differ from test to test by more than their intervals, without following a condition."
            if loose
            else "Nothing drifts with speed, depth or feed"
            + (f"; {', '.join(slight)} differ by more than their intervals, but too little to matter." if slight else ".")
        )
    page.table(("parameter", "verdict"), [(f"{name} ({SYMBOLS[name]})", found.verdict(name)) for name in found.parameters])
    varied = [
        name
        for name in COVARIATES
        if len({round(test.conditions[name], 12) for test in found.tests if name in test.conditions}) > 1
    ]
    against = varied or ["record"]
    panels = {
        (row, column): _constancy_panel(found, parameter, covariate, joint)
        for row, parameter in enumerate(found.parameters)
        for column, covariate in enumerate(against)
    }
    page.choices(
        [("parameter", [f"{name} ({SYMBOLS[name]})" for name in found.parameters]), ("against", against)],
        panels,
        {"height": 360, "showlegend": True},
        "parameters fitted test by test",
    )
    page.text(
        "Each dot is one record fitted alone, with 95 % intervals; the trends' errors are those of the scatter, and the "
        "false discoveries among all trends tried are held to 5 %.",
        small=True,
    )


def _constancy_panel(found: Constancy, parameter: str, covariate: str, joint: Mapping[str, Estimate]) -> Panel:
    tests = [
        test for test in found.tests if parameter in test.parameters and (covariate == "record" or covariate in test.conditions)
    ]
    if not tests:
        return Panel([], {}, f"no test speaks of {parameter} at a known {covariate}")
    unit = tests[0].parameters[parameter].unit
    factor, name = (1e-6, "N/mm²") if unit == "N/m^2" else (1.0, unit)
    values = np.array([test.parameters[parameter].value for test in tests]) * factor
    low, high = np.array([(test.parameters[parameter].low, test.parameters[parameter].high) for test in tests]).T * factor
    scale, x_unit = _COVARIATE_UNITS.get(covariate, (1.0, ""))
    place: list[Any] = [test.name for test in tests]
    if covariate != "record":
        place = listed(np.array([test.conditions[covariate] for test in tests]) * scale)
    digits = 7
    traces: list[dict[str, Any]] = [
        {
            "type": "scatter",
            "mode": "markers",
            "name": "one test, 95 %",
            "x": place,
            "y": listed(values, digits),
            "text": [test.name for test in tests],
            "hovertemplate": "%{text}: %{y}<extra></extra>",
            "marker": {"size": 9, "color": COLOURS[0]},
            "error_y": {
                "type": "data",
                "symmetric": False,
                "array": listed(high - values),
                "arrayminus": listed(values - low),
                "color": COLOURS[0],
                "thickness": 1.5,
                "width": 4,
            },
        }
    ]
    if parameter in joint and covariate != "record":
        level = joint[parameter].value * factor
        ends = [min(place), max(place)]
        traces.append(
            {
                "type": "scatter",
                "mode": "lines",
                "name": "all tests together",
                "x": ends,
                "y": [level, level],
                "line": {"color": "@muted", "dash": "dash", "width": 1.5},
            }
        )
    trend = next((one for one in found.trends if one.parameter == parameter and one.covariate == covariate), None)
    said = f"{SYMBOLS[parameter]}: {found.verdict(parameter)}."
    if trend is not None and trend is not found.drift(parameter):
        way = "also holds" if trend.holds else "is no trend that holds"
        said += f" Against {covariate}: {trend.change:+.1%} over the range, {said_p(trend.p_value)}, {way}."
    return Panel(
        traces,
        {
            "xaxis": {"title": {"text": f"{covariate} [{x_unit}]" if x_unit else covariate}},
            "yaxis": {"title": {"text": f"{SYMBOLS[parameter]} [{name}]"}},
        },
        said,
    )


def amplitude_says(found: Sequence[AmplitudeDependence]) -> str:
    """Frequency and damping of all free decays together in a sentence."""

    def leading(verdicts: list[str]) -> tuple[str, int]:
        speaking = [verdict for verdict in verdicts if verdict != "constant"]
        best = max(sorted(set(speaking)), key=speaking.count, default="constant")
        return best, speaking.count(best)

    many = len(found)
    frequency, times = leading([one.frequency_verdict for one in found])
    damping, of = leading([one.damping_verdict for one in found])
    if frequency == "constant":
        first = f"The frequency does not depend on amplitude in any of {many} free decays"
    else:
        largest = max((one for one in found if one.frequency_verdict == frequency), key=lambda one: abs(one.change_frequency))
        first = (
            f"The frequency {frequency} with amplitude in {times} of {many} free decays, by up to "
            f"{abs(largest.change_frequency):.2%}: a spring that {'hardens' if frequency == 'rises' else 'softens'}"
        )
    second = {
        "constant": "the damping is the same at all amplitudes",
        "dry friction": f"in {of} of {many} the amplitude drops by equal steps, as dry friction makes it",
        "quadratic damping": f"in {of} of {many} the damping grows in proportion to amplitude, as quadratic damping does",
        "rises": f"in {of} of {many} the damping rises with amplitude",
        "falls": f"in {of} of {many} the damping falls with amplitude",
    }[damping]
    return f"{first}; {second}."


def add_amplitude(page: Page, found: Sequence[AmplitudeDependence], units: Mapping[str, str]) -> None:
    """Frequency, damping and course of the free decays."""
    if not found:
        return
    page.heading("Do frequency and damping depend on the amplitude of free vibration?")
    page.answer(amplitude_says(found))
    panels = {
        (0,): _decays(found, units, "frequency"),
        (1,): _decays(found, units, "damping"),
        (2,): _decays(found, units, "course"),
    }
    page.choices(
        [("shown", ["frequency against amplitude", "damping against amplitude", "amplitude over time"])],
        panels,
        {"height": 400},
        "free decays",
    )
    rows = [
        (
            one.name,
            shown(one.small_frequency, "Hz", 6),
            one.frequency_verdict,
            f"{one.change_frequency:+.3%}",
            f"{one.p_frequency:.2g}",
            f"{float(one.damping_at(np.median(one.amplitude))):.5f}",
            one.damping_verdict,
            f"{one.change_damping:+.1%}",
            f"{one.p_damping:.2g}",
        )
        for one in found
    ]
    page.table(
        ("free decay of", "frequency, small", "frequency", "change", "p", "damping ratio", "damping", "change", "p"), rows
    )


def _decays(found: Sequence[AmplitudeDependence], units: Mapping[str, str], what: str) -> Panel:
    factors, labels, unit = drawn_units(found, units)
    traces: list[dict[str, Any]] = []
    for place, (one, factor, label) in enumerate(zip(found, factors, labels, strict=True)):
        colour = COLOURS[place % len(COLOURS)]
        group = {"name": label, "legendgroup": label}
        if what == "course":
            traces.append(
                group
                | {
                    "type": "scatter",
                    "mode": "lines+markers",
                    "x": listed(one.course.time),
                    "y": listed(one.course.amplitude * factor),
                    "marker": {"size": 5, "color": colour},
                    "line": {"color": colour, "width": 1},
                }
            )
            continue
        values, errors = (one.frequency, one.frequency_error) if what == "frequency" else (one.damping, one.damping_error)
        traces.append(
            group
            | {
                "type": "scatter",
                "mode": "markers",
                "x": listed(one.amplitude * factor),
                "y": listed(values, 7),
                "marker": {"size": 6, "color": colour},
                "error_y": {"type": "data", "array": listed(Z_95 * errors), "color": colour, "thickness": 1, "width": 2},
            }
        )
        fine = np.geomspace(one.amplitude.min(), one.amplitude.max(), 40)
        law = one.frequency_at(fine) if what == "frequency" else one.damping_at(fine)
        traces.append(
            group
            | {
                "type": "scatter",
                "mode": "lines",
                "x": listed(fine * factor),
                "y": listed(law, 7),
                "showlegend": False,
                "line": {"color": colour, "width": 1},
                "hoverinfo": "skip",
            }
        )
    name = {"frequency": "frequency [Hz]", "damping": "damping ratio", "course": f"amplitude [{unit}]"}[what]
    drawn = np.concatenate([one.amplitude * factor for one, factor in zip(found, factors, strict=True)])
    ends = float(drawn.min()), float(drawn.max())
    across = (
        {"title": {"text": f"amplitude [{unit}]"}, "type": "log", **log_ticks(*ends)}
        if what != "course"
        else {"title": {"text": "time [s]"}}
    )
    says = {
        "frequency": "Level: a linear spring. Rising: it hardens; falling: it softens.",
        "damping": "Level: viscous. Rising towards small amplitudes: dry friction; rising in proportion to amplitude: "
        "quadratic damping.",
        "course": "Exponential: viscous damping. A straight line, equal drops: dry friction.",
    }[what]
    return Panel(traces, {"xaxis": across, "yaxis": {"title": {"text": name}}}, says)


def log_ticks(low: float, high: float) -> dict[str, Any]:
    """Ticks at 1, 2 and 5 of every decade that a logarithmic axis from low to high spans."""
    decades = range(math.floor(math.log10(low)), math.ceil(math.log10(high)) + 1)
    values = [step * 10.0**decade for decade in decades for step in (1, 2, 5)]
    return {"tickvals": values, "ticktext": [f"{value:g}" for value in values]}
