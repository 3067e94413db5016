"""The pages of `testbed diagnose` and `testbed add`: which effect was missing, and how the error fell."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

from testbed.analysis.comparison.residual_views import map_units
from testbed.analysis.estimate import Estimate
from testbed.analysis.fit.estimates import at_bound, estimates
from testbed.analysis.fit.held_out import RecordError, pooled
from testbed.analysis.fit.observed import Observed
from testbed.analysis.report.compare_page import INTRODUCTION, ForceMap
from testbed.analysis.report.force_map import add_force_map
from testbed.analysis.report.machine import AT_BOUND, far, interval, said_change, settled, shown
from testbed.analysis.report.page import Page
from testbed.analysis.report.steps import Step, add_candidates, add_rules, add_steps
from testbed.analysis.report.ticked import add_before_after, add_ticks, leading, points_for
from testbed.analysis.report.waveforms import looks, worst_first
from testbed.analysis.search.add_effect import Addition
from testbed.analysis.search.candidate import Candidate
from testbed.analysis.search.diagnosis import Diagnosis, judged_on, unaided
from testbed.effect import Effect
from testbed.machine import Model

LEAST_CHANGE = 5e-4  # relative change that is told


def add_changes(
    page: Page,
    believed: Model,
    bare: Model | None,
    after: Mapping[str, Estimate],
    converged: bool,
    stuck: Sequence[str] = (),
) -> None:
    """What each fitted parameter became: believed, refitted without, and with the effects, with intervals.

    stuck: parameters at a bound of the range searched.
    """
    page.heading("What did each fitted parameter become?")

    def of(model: Model | None, path: str) -> float | None:
        try:
            return None if model is None else model.value(path)
        except KeyError:
            return None

    rows = []
    for path, one in after.items():
        middle = [shown(of(bare, path), one.unit)] if bare is not None else []
        ends = interval(one) + (AT_BOUND if path in stuck else "")
        rows.append((path, shown(of(believed, path), one.unit), *middle, shown(one.value, one.unit), ends))
    moved = [
        (far(change), path, change)
        for path, one in after.items()
        if bare is not None and (old := of(bare, path)) and math.isfinite(change := one.value / old - 1.0)
    ]
    new = [path for path in after if of(believed, path) is None]
    text = f"New: {', '.join(f'{path} = {shown(after[path].value, after[path].unit, 4)}' for path in new)}. " if new else ""
    if moved and new:
        _, path, change = max(moved)
        text += (
            f"With the effect in place {path} moved most, by {said_change(change)} from where it had been bent without it. "
            if abs(change) >= LEAST_CHANGE
            else "With the effect in place no other parameter moved. "
        )
    page.answer(text + settled(converged, stuck))
    titles = (
        "parameter",
        "believed",
        *(("refitted without",) if bare is not None else ()),
        "with the effects",
        "95 % interval",
    )
    page.table(titles, rows)


def add_next_test(page: Page, said: Mapping[str, Any] | None, tied: Sequence[str]) -> None:
    """The cut that would tell the tied effects apart, where one is known."""
    if said is None and len(tied) < 2:
        return
    page.heading("Which cut would tell the leading effects apart?")
    if said is None:
        page.answer(f"None was found that separates {' and '.join(tied)} within the limits searched.")
        return
    apart = " and ".join(said.get("separates") or tied)
    page.answer(
        f"Cut at {said['spindle_speed'] * 30 / math.pi:.0f} rpm and {said['depth_of_cut'] * 1e3:.3g} mm: there the "
        f"predictions of {apart} differ most in units of the noise."
    )


def diagnosis_page(
    found: Diagnosis,
    said: Mapping[str, Any],
    believed: Model,
    catalogue: Mapping[str, Effect],
    units: Mapping[str, str],
    *,
    name: str = "",
    notes: Sequence[str] = (),
    next_step: str = "",
    steps: Sequence[Step] | None = None,
    force_maps: Sequence[ForceMap] = (),
) -> Page:
    """The whole page. said: the answer as JSON has it; units: SI or own, by channel; steps: the history, where it is known."""
    page = Page(f"Which effect is missing?{' ' + name if name else ''}")
    good = {"adequate": True, "missing_effect": None}.get(found.verdict, False)
    page.verdict(f"{found.verdict.replace('_', ' ').capitalize()}. {found.sentence}", good)
    page.tiles(
        (
            ("error of the believed model, refitted", f"{found.baseline:.4f}"),
            ("error with the effects named", f"{found.with_effects:.4f}"),
            ("noise floor", f"{found.noise_floor:.4f}"),
            ("error / noise floor, now", f"{found.with_effects / found.noise_floor:.2f}"),
        )
    )
    if next_step:
        page.code(next_step)
    page.text(INTRODUCTION, small=True)
    for note in notes:
        page.text(note, small=True)
    if not found.held_out:
        page.text("Nothing was held out, for there is only one operating condition: errors are those in the fit.", small=True)
    first = unaided(believed)
    own_steps = [
        (first if not one.effects else f"+ {one.effects[-1]}", one.error_held_out, pooled(one.errors)[1])
        for one in found.steps
    ]
    add_steps(page, steps or own_steps or [(first, found.baseline, found.noise_floor)], found.held_out)
    best, base = found.best, found.base
    if isinstance(best, Candidate):
        records: Sequence[Observed] = best.fitter.records
        sets: dict[frozenset[str], Sequence[RecordError]] = {}
        for one in sorted((*found.candidates, *found.steps, base, best), key=lambda one: one.error_held_out):
            if one.errors:
                sets.setdefault(frozenset(one.effects), one.errors)
        chosen = worst_first(looks(records, units), base.errors)
        key = frozenset(best.effects)
        add_ticks(page, chosen, sets, key)
        add_candidates(page, found, catalogue)
        add_rules(page, found)
        if key and isinstance(base, Candidate):
            points, states = points_for(chosen, leading(sets, key)), (base.fit.state, best.fit.state)
            add_before_after(page, chosen, base.errors, sets[key], states, points, key)
        bare = base.fit.state.model if isinstance(base, Candidate) and key else None
        found_values = estimates(best.fitter, best.fit, catalogue)
        add_changes(page, believed, bare, found_values, best.fit.converged, at_bound(best.fitter.free, found_values))
    for one_name, x, v, force in force_maps:
        add_force_map(page, one_name, x, v, force, shown=map_units(units))
    tied = found.effects if found.verdict == "undecided" else ()
    add_next_test(page, said.get("next_test"), tied)
    return page


def addition_page(
    found: Addition,
    records: Sequence[Observed],
    believed: Model,
    units: Mapping[str, str],
    *,
    name: str = "",
    notes: Sequence[str] = (),
) -> Page:
    """The page of one effect added: the error before and after, and what the parameters became."""
    page = Page(f"What does {found.effect} explain?{' ' + name if name else ''}")
    held = judged_on(found.held_out)
    helps = found.after < found.before * (1 - 1e-3)
    way = "falls" if helps else "does not fall"
    page.verdict(
        f"With {found.effect} the error {held} {way}: {found.before:.4f} before, {found.after:.4f} after, noise floor "
        f"{found.noise_floor:.4f}.",
        helps,
    )
    page.tiles(
        (
            ("error before", f"{found.before:.4f}"),
            ("error after", f"{found.after:.4f}"),
            ("noise floor", f"{found.noise_floor:.4f}"),
            ("error / noise floor, now", f"{found.after / found.noise_floor:.2f}"),
        )
    )
    for note in (*notes, *(f"Warning: {warning}" for warning in found.warnings)):
        page.text(note, small=True)
    steps = [(unaided(believed), found.before, found.noise_floor), (f"+ {found.effect}", found.after, found.noise_floor)]
    add_steps(page, steps, found.held_out)
    sets = {frozenset[str](): found.records_before, frozenset({found.effect}): found.records_after}
    chosen = worst_first(looks(records, units), found.records_before)
    add_ticks(page, chosen, sets, frozenset({found.effect}))
    add_before_after(
        page,
        chosen,
        found.records_before,
        found.records_after,
        (found.bare.state, found.fit.state),
        points_for(chosen, sets),
        frozenset({found.effect}),
    )
    rows = [
        (one.name, f"{one.error:.4f}", f"{two.error:.4f}", said_change(two.error / one.error - 1), f"{two.noise_floor:.4f}")
        for one, two in zip(found.records_before, found.records_after, strict=True)
    ]
    page.heading("On which records does the error fall?")
    fallen = sum(two.error < one.error for one, two in zip(found.records_before, found.records_after, strict=True))
    page.answer(f"On {fallen} of {len(rows)}.")
    page.table(("record", "error before", "error after", "change", "noise floor"), rows)
    add_changes(page, believed, found.bare.state.model, found.parameters, found.converged, found.at_bound)
    return page
