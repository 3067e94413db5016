"""The story's sections: the error falling step by step, and the candidates ranked."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from testbed.analysis.fit.estimates import unit_of
from testbed.analysis.report.constants import COLOURS
from testbed.analysis.report.machine import shown
from testbed.analysis.report.packed import listed
from testbed.analysis.report.page import Page, Panel
from testbed.analysis.report.ticked import named
from testbed.analysis.report.waveforms import LEFT
from testbed.analysis.search.candidate import Candidate
from testbed.analysis.search.diagnosis import Diagnosis, judged_on
from testbed.analysis.search.rules import rules_of
from testbed.effect import Effect

Step = tuple[str, float, float]  # what was done, error, noise floor


def add_steps(page: Page, steps: Sequence[Step], held_out: bool) -> None:
    """The error falling, a bar a step, with the noise floor. held_out: whether on records left out of the fit."""
    page.heading("How did the error fall, step by step?")
    first, last = steps[0], steps[-1]
    if len(steps) == 1:
        page.answer(
            f"It did not: nothing was added. The error is {first[1]:.4f}, {first[1] / first[2]:.2f} times the noise floor."
        )
    else:
        page.answer(
            f"From {first[1]:.4f} to {last[1]:.4f} in {len(steps) - 1} step{'s' if len(steps) > 2 else ''}: from "
            f"{first[1] / first[2]:.2f} to {last[1] / last[2]:.2f} times the noise floor."
        )
    names = [f"{name}<br>{error:.4f}" for name, error, _ in steps]  # below its bar no line crosses a number
    values = np.array([error for _, error, _ in steps])
    bars = {
        "type": "bar",
        "x": names,
        "y": listed(values),
        "showlegend": False,
        "marker": {"color": [LEFT] + ["#3b82c4"] * (len(steps) - 1)},
    }
    floor = steps[-1][2]
    noise = {
        "type": "scatter",
        "mode": "lines",
        "name": f"noise floor {floor:.4f}",
        "x": names[:1],
        "y": listed(np.array([floor])),
        "line": {"color": "@ink", "dash": "dot"},
    }
    across = {"type": "line", "xref": "paper", "x0": 0, "x1": 1, "y0": floor, "y1": floor, "line": noise["line"]}
    height = {"title": {"text": "error, held out" if held_out else "error, in the fit"}, "rangemode": "tozero"}
    layout = {"height": 340, "yaxis": height, "bargap": 0.45, "shapes": [across]}
    page.figure(Panel([bars, noise], layout | {"xaxis": {"type": "category"}}), "error after each step")


def add_candidates(page: Page, found: Diagnosis, catalogue: Mapping[str, Effect]) -> None:
    """All sets fitted, ranked by their error on records held out, or in the fit where nothing could be."""
    page.heading("Which effects were tried, and which explains the records best?")
    fitted = found.fitted
    others = sorted({one.effects[-1] for one in found.candidates if not isinstance(one, Candidate) and one.effects})
    if not fitted:
        page.answer(
            "None was fitted in full: " + ("no first step lowered the misfit." if others else "there was nothing to explain.")
        )
    else:
        best, *rest = fitted
        text = (
            f"{named(best.effects)} {'predicts records it never saw' if found.held_out else 'fits'} best: "
            f"error {best.error_held_out:.4f}, "
            f"BIC lower by {best.delta_bic:.0f} for its last effect"
        )
        page.answer(text + (f"; next comes {named(rest[0].effects)} with {rest[0].error_held_out:.4f}." if rest else "."))
        _candidate_bars(page, found, fitted)
        held = ("error held out",) if found.held_out else ()
        page.table(
            ("effects", *held, "error in the fit", "gain in BIC", "converged", "parameters"),
            [
                (
                    named(one.effects),
                    *(f"{one.error_held_out:.4f}" for _ in held),
                    f"{one.error_fit:.4f}",
                    f"{one.delta_bic:.1f}",
                    "yes" if one.converged else "no",
                    ", ".join(
                        f"{path} = {shown(value, unit_of(path, catalogue), 4)}" for path, value in one.parameters.items()
                    ),
                )
                for one in fitted
            ],
        )
        page.text(
            "The gain in BIC is that of the last effect over the set without it, on the effective sample size.", small=True
        )
        page.text("Green bar: the set that the verdict names. Grey bars: the other sets. Red line: the model without any "
                  "effect. Dotted line: the noise floor.", small=True)
    if others:
        page.text(f"Ruled out by a first step: {', '.join(others)}.", small=True)
    tried = dict.fromkeys(name for one in found.candidates for name in one.effects if name in catalogue)
    if tried:
        page.text(f"What the names mean. {'; '.join(f'{name}: {catalogue[name].title}' for name in tried)}.", small=True)


def add_rules(page: Page, found: Diagnosis) -> None:
    """The rules that the verdict follows from, each with its limit and this campaign's number."""
    rules = rules_of(found)
    if not rules:
        return
    page.heading("By which rules does the verdict follow from these numbers?")
    page.answer("The model as it is comes first, then every effect alone, then the set that is named. Two effects that explain "
                "equally well are tied: the verdict is then 'undecided'.")
    page.table(("of", "rule", "limit", "here", "met"),
               [(named(one.effects) if one.effects else "the model", one.rule, f"{one.limit:.4g}", f"{one.value:.4g}",
                 "yes" if one.met else "no") for one in rules])


def _candidate_bars(page: Page, found: Diagnosis, fitted: Sequence[Candidate]) -> None:
    fitted = list(reversed(fitted[:14]))
    names = [named(one.effects) for one in fitted]
    values = np.array([one.error_held_out for one in fitted])
    bars = {
        "type": "bar",
        "orientation": "h",
        "x": listed(values),
        "y": names,
        "showlegend": False,
        "marker": {"color": [COLOURS[2] if set(one.effects) == set(found.effects) else "#8fa3b8" for one in fitted]},
    }
    marks = (("noise floor", found.noise_floor, "@ink", "dot"), ("without any effect", found.baseline, LEFT, "solid"))
    styles = [{"color": colour, "dash": dash, "width": 2} for _, _, colour, dash in marks]
    lines = [
        {"type": "scatter", "mode": "lines", "name": name, "x": [value], "y": names[:1], "line": style}
        for (name, value, _, _), style in zip(marks, styles, strict=True)
    ]
    shapes = [
        {"type": "line", "yref": "paper", "y0": 0, "y1": 1, "x0": value, "x1": value, "line": style}
        for (_, value, _, _), style in zip(marks, styles, strict=True)
    ]
    layout = {
        "height": 150 + 34 * len(names),
        "xaxis": {"title": {"text": f"error {judged_on(found.held_out)}"}, "rangemode": "tozero"},
        "yaxis": {"type": "category"},
        "margin": {"l": 130, "r": 60},
        "shapes": shapes,
        "annotations": [_beside(name, value) for name, value in zip(names, values, strict=True)],
    }
    page.figure(Panel([bars, *lines], layout), "error of each set of effects")


def _beside(name: str, error: float) -> dict[str, Any]:
    """A bar's number to the right of all bars and lines."""
    place = {"xref": "paper", "x": 1.0, "xanchor": "left", "xshift": 6, "yref": "y", "y": name}
    return place | {"text": f"{error:.4f}", "showarrow": False}
