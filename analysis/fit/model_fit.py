"""A model, with whatever effects it has, fitted to records from what is believed of it."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace

from testbed.analysis.fit.basin_hopping import basin_hopping
from testbed.analysis.fit.effect_start import grown
from testbed.analysis.fit.fine_steps import kinked
from testbed.analysis.fit.fit_state import FreeParameter, WaveformFit
from testbed.analysis.fit.force_jumps import at_its_jumps
from testbed.analysis.fit.free_vibration_start import free_vibration_fit
from testbed.analysis.fit.growing_window import bends_frequency, grown_cuts
from testbed.analysis.fit.identifiable import Identifiable, identifiable_parameters, with_strayed_modes
from testbed.analysis.fit.length_cut import asks_length, carried_on, with_lengths_found
from testbed.analysis.fit.observed import Observed
from testbed.analysis.fit.prediction import Engine
from testbed.analysis.fit.record_hypotheses import asked_again
from testbed.analysis.fit.starts import arrived, at_a_bound, base_fit, with_courses, with_fronts_and_courses
from testbed.analysis.fit.structure_start import structure_start
from testbed.analysis.fit.waveform import Fitter
from testbed.effect import Effect
from testbed.machine import Model

EXPLAINED = 1.1  # mean square residual up to which coefficients are believed, whatever they are, and an arc of engagement
BEYOND = 2.0  # times as far from the believed arc as the fitted one: where a fit begins that comes from the other side


def model_fit(
    engine: Engine,
    records: Sequence[Observed],
    model: Model,
    catalogue: Mapping[str, Effect],
    free: Sequence[FreeParameter] | None = None,
    cost_limit: float = math.inf,
    known: float = math.nan,
    told: Identifiable | None = None,
) -> tuple[Fitter, WaveformFit]:
    """The model refitted with every nuisance; without `free`, all that these records can speak of is unknown: `told`, if that
    is of them.

    Laws with kinks have valleys beside the deepest, into which even the true scale may slip on the way from a wrong opening:
    theirs are looked for. So have free decays alone, whose phases run apart: those are fitted from their openings on.
    cost_limit: the cost above which the fit is of no use and given up; known: that of a fit at hand, whose basin is left alone.
    Where an effect asks for the length cut and no record states one, the fitter's records have that which explains them better,
    see `length_cut`; so with what the first teeth meet and with the feed, see `record_hypotheses`.
    """
    if free is None and (model.effects or model.structure.planar):
        known_of = told if told is not None and told.asked_of(records) else \
            identifiable_parameters(engine, records, model, catalogue, helps=False)
        free = known_of.free
    found = _fitted(engine, records, model, catalogue, free, cost_limit, known)
    done = found[1].cost > cost_limit or arrived(found[1], known)
    if not done and (beyond := _with_arc_beyond(found[1], model, catalogue)):
        found = min(found, _fitted(engine, records, beyond, catalogue, free, math.inf, known), key=lambda one: one[1].cost)
    if asks_length(model.effects, catalogue) and (longer := carried_on(records)) is not None:
        worn = _fitted(engine, longer, model, catalogue, free, cost_limit, known)
        found = with_lengths_found(*worn) if worn[1].cost < found[1].cost else found
    if found[1].cost > cost_limit or arrived(found[1], known):
        return found
    return with_strayed_modes(*asked_again(*found), model)


def _with_arc_beyond(fit: WaveformFit, model: Model, catalogue: Mapping[str, Effect]) -> Model | None:
    """The model as believed with an arc of engagement beyond the one fitted; None where that explains the records.

    Cuts whose first tooth met but a part of its arc hold a fit that comes from shorter arcs at one that makes them whole.
    """
    effect = next((catalogue[name] for name in model.effects if "immersion" in catalogue[name].hooks), None)
    switch = None if effect is None else next((one for one in effect.parameters if one.vanishes), None)
    if effect is None or switch is None or fit.mean_squares.max() <= EXPLAINED:
        return None
    found = fit.state.model.effects[effect.name][switch.name]
    far = switch.neutral + BEYOND * (found - switch.neutral)
    return model.with_effect(effect.name, **{switch.name: min(max(far, switch.bounds[0]), switch.bounds[1])})


def _fitted(engine: Engine, records: Sequence[Observed], model: Model, catalogue: Mapping[str, Effect],
            free: Sequence[FreeParameter] | None, cost_limit: float, known: float) -> tuple[Fitter, WaveformFit]:  # fmt: skip
    """The fit to the records with the lengths cut before as they have them."""
    swung = free_vibration_fit(engine, records, model, catalogue, free) if free is not None else None
    bent = bends_frequency(model.effects, catalogue)  # such a fit may come to its goal when it is grown
    fitter, fit = swung or base_fit(engine, records, model, free=free, cost_limit=cost_limit, patient=bent, known=known)
    if arrived(fit, known):
        return fitter, fit
    if bent:
        fit = grown_cuts(fitter, fit)
    if model.effects and all(record.kind == "ring-down" for record in records):
        believed = replace(fit.state, model=structure_start(records, model))
        fit = min(fit, grown(fitter, [believed, fit.state]), key=lambda one: one.cost)
    if fit.cost > cost_limit:
        return fitter, fit
    if at_a_bound(fitter.free, fit.state.model) or _cuts_like_no_tool(fit):
        fitter, fit = min((fitter, fit), _from_believed_coefficients(fitter, model), key=lambda one: one[1].cost)
    fit = basin_hopping(fitter, kinked(model.effects, catalogue), fit)
    without, fit = at_its_jumps(fitter, fit)
    if without is fitter:
        return fitter, fit
    return at_its_jumps(without, with_courses(without, fit))  # samples at jumps hid what entries and exits a pass off leave


def _cuts_like_no_tool(fit: WaveformFit) -> bool:
    """Whether a fit has a normal force that pulls, or is larger than the tangential one.

    Of one mode along the feed and equal teeth, only a fit that leaves more than noise: that is left of too few parameters.
    """
    model, cutting = fit.state.model, fit.state.model.cutting
    if cutting is None or fit.variance < EXPLAINED and not model.planar:
        return False
    return not 0.0 <= cutting.normal_coefficient <= cutting.tangential_coefficient


def _from_believed_coefficients(fitter: Fitter, model: Model) -> tuple[Fitter, WaveformFit]:
    """The fit begun where the cutting coefficients as believed lead: free from the beginning, they went to where no machine is.

    On the way there the passes of entries and exits have bent to suit them.
    """
    held = [one for one in fitter.unknowns if not one.path.endswith("_coefficient")]
    _, fit = base_fit(fitter.engine, fitter.records, model, free=held)
    return with_fronts_and_courses(fitter, fitter.fit(fit.state))
