"""A model, with whatever effects it has, fitted to records from what is believed of it."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace

from testbed.analysis.fit.fit_state import FreeParameter, WaveformFit
from testbed.analysis.fit.free_vibration_start import free_vibration_fit
from testbed.analysis.fit.identifiable import Identifiable, identifiable_parameters, with_strayed_modes
from testbed.analysis.fit.length_cut import asks_length, carried_on
from testbed.analysis.fit.moves import LAWS
from testbed.analysis.fit.moves.growing_decays import decays_alone
from testbed.analysis.fit.moves.growing_window import bends_frequency
from testbed.analysis.fit.observed import Observed
from testbed.analysis.fit.prediction import Engine
from testbed.analysis.fit.solve import Goal, arrived, solve
from testbed.analysis.fit.starts import base_fit
from testbed.analysis.fit.waveform import Fitter
from testbed.effect import Effect
from testbed.machine import Model

EXPLAINED = 1.1  # mean square residual up to which an arc of engagement is believed
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
    laws = tuple(catalogue[name] for name in model.effects)
    patient = bends_frequency(laws) or bool(laws) and decays_alone(records)  # phases have run apart until such a fit is grown
    goal = Goal(laws, model, cost_limit, patient, known)
    found = _fitted(engine, records, model, free, goal)
    done = found[1].cost > cost_limit or arrived(found[1], known)
    if not done and (beyond := _with_arc_beyond(found[1], model, catalogue)):
        further = _fitted(engine, records, beyond, free, replace(goal, prior=beyond, cost_limit=math.inf))
        found = min(found, further, key=lambda one: one[1].cost)
    if asks_length(model.effects, catalogue) and (longer := carried_on(records)) is not None:
        found = min(found, _fitted(engine, longer, model, free, goal), key=lambda one: one[1].cost)
    if found[1].cost > cost_limit or arrived(found[1], known):
        return found
    return with_strayed_modes(*found, model)


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


def _fitted(engine: Engine, records: Sequence[Observed], model: Model, free: Sequence[FreeParameter] | None, goal: Goal
            ) -> tuple[Fitter, WaveformFit]:  # fmt: skip
    """The fit to the records with the lengths cut before as they have them."""
    swung = free_vibration_fit(engine, records, model, goal.laws, free) if free is not None else None
    begun = swung or base_fit(engine, records, model, free=free, goal=goal)
    return solve(*begun, LAWS, replace(goal, records=tuple(records)))
