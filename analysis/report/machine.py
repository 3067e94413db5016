"""Sections on what was found: the machine's parameters, and what belongs to a record alone."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

from testbed.analysis.estimate import Estimate
from testbed.analysis.report.page import Page
from testbed.machine import Model
from testbed.units import format_quantity

MOST_CHANGE = 10.0  # relative change up to which it is told as a percentage
AT_BOUND = " (at a bound)"
_USUAL = {"rad/s": "rpm", "N/m^2": "N/mm^2", "rad": "deg"}


def shown(value: float | None, unit: str, digits: int = 5) -> str:
    """A quantity for people, in the unit that is usual for it."""
    if value is None or not math.isfinite(value):
        return "-"
    return format_quantity(value, _USUAL.get(unit, unit), digits)


def interval(one: Estimate) -> str:
    """An interval with as many digits as tell its ends apart."""
    half = 0.5 * (one.high - one.low)
    known = math.isfinite(half) and half > 0 and one.value != 0
    digits = min(max(5, math.ceil(math.log10(abs(one.value) / half)) + 2), 9) if known else 5
    return f"{shown(one.low, one.unit, digits)} to {shown(one.high, one.unit, digits)}"


def said_change(change: float, digits: int = 1) -> str:
    """A relative change for people: where a percentage would say nothing, in words."""
    if not math.isfinite(change):
        return "-"
    if abs(change) <= MOST_CHANGE:
        return f"{change:+.{digits}%}"
    return "more than ten times" if abs(change) <= 100.0 else "more than a hundred times"


def far(change: float) -> float:
    """How far a parameter moved, a fall to a tenth as far as a rise to ten times; relative change."""
    return abs(math.log1p(change)) if change > -1.0 else math.inf


def settled(converged: bool, stuck: Sequence[str]) -> str:
    """Whether the fit settled, and where."""
    if not converged:
        return "The fit did not settle: these are the values of its last step."
    from testbed.analysis.fit.estimates import said_at_bound

    return f"The fit settled, with {said_at_bound(stuck)}." if stuck else "The fit settled."


def add_parameters(
    page: Page, found: Mapping[str, Estimate], believed: Model, converged: bool, stuck: Sequence[str] = ()
) -> None:
    """Believed and found, with intervals. stuck: parameters at a bound of the range searched."""
    page.heading("What became of the believed parameters?")
    rows, moved = [], []
    for path, one in found.items():
        try:
            before: float | None = believed.value(path)
        except KeyError:
            before = None
        change = one.value / before - 1.0 if before else math.nan
        if math.isfinite(change):
            moved.append((far(change), path, change))
        rows.append(
            (
                path,
                shown(before, one.unit),
                shown(one.value, one.unit),
                said_change(change, 2),
                interval(one) + (AT_BOUND if path in stuck else ""),
            )
        )
    if moved:
        _, path, change = max(moved)
        page.answer(f"{path} moved most, by {said_change(change)}. {settled(converged, stuck)}")
    page.table(("parameter", "believed", "found", "change", "95 % interval"), rows)


def add_nuisances(page: Page, records: Sequence[Any], shared: Mapping[str, float], units: Mapping[str, str]) -> None:
    """What was estimated of each record and belongs to no machine: offset, drift, true speed, entry and exit."""
    from testbed.analysis.comparison.residual_views import shown_unit  # here: pages of taps need no fit of records

    page.heading("What was unknown about the records themselves, and what was it found to be?")
    cuts = [one for one in records if one.kind == "cut"]
    said = []
    if "mark_angle" in shared:
        spread = f" ± {math.degrees(shared['mark_angle_interval']):.2f}" if "mark_angle_interval" in shared else ""
        said.append(f"the tachometer's mark comes {math.degrees(shared['mark_angle']):.2f}{spread} deg after a tooth's entry")
    if cuts:
        off = max(cuts, key=lambda one: abs(one.nuisances["speed_error"]))
        said.append(
            f"the spindle's true speed differs from the stated by at most {abs(off.nuisances['speed_error']):.3%} ({off.name})"
        )
    text = "; ".join(said) or "offset and slow drift of each sensor"
    page.answer(text[0].upper() + text[1:] + ".")
    rows = []
    for one in records:
        own = one.nuisances
        for channel in one.channels:
            factor, unit = shown_unit(units.get(channel, ""))
            drift = own.get("drift", {}).get(channel)
            row = [
                one.name + (f", {channel}" if len(one.channels) > 1 else ""),
                f"{own['offset'][channel] * factor:.4g} {unit}",
                "-" if drift is None else f"{drift * factor:.3g} {unit}/s",
                f"{one.noise[one.channels.index(channel)] * factor:.3g} {unit} ({one.noise_basis})",
            ]
            if cuts:
                row += (
                    ["-"] * 4
                    if one.kind != "cut"
                    else [
                        shown(own["spindle_speed"], "rad/s", 6),
                        f"{own['speed_error']:+.3%}",
                        *("-" if own[key] is None else f"{own[key]:.4f} s" for key in ("entry_time", "exit_time")),
                    ]
                )
            rows.append(tuple(row))
    page.table(
        ("record", "offset", "drift", "noise", *(("true speed", "against stated", "entry", "exit") if cuts else ())), rows
    )
