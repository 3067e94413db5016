"""Add effects to a model, refit everything to the campaign, and say what that did to the error on held-out records."""

from __future__ import annotations

import math
from collections.abc import Callable, Container, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from testbed.analysis.estimate import Estimate
from testbed.analysis.fit.effect_start import ANCHOR, applicable, extended, origins_of, state_without
from testbed.analysis.fit.estimates import at_bound, clock_note
from testbed.analysis.fit.fine_steps import finely, has_kinks
from testbed.analysis.fit.fit_state import State, WaveformFit
from testbed.analysis.fit.free_parameters import at_a_bound
from testbed.analysis.fit.free_vibration_start import marks_show
from testbed.analysis.fit.held_guesses import with_guesses_held
from testbed.analysis.fit.held_out import RecordError, held_out_errors, holds_out, pooled
from testbed.analysis.fit.identifiable import Identifiable
from testbed.analysis.fit.model_fit import model_fit
from testbed.analysis.fit.moves import HYPOTHESES, TOLD
from testbed.analysis.fit.observed import Observed
from testbed.analysis.fit.plausible import remarks_on
from testbed.analysis.fit.prediction import Engine
from testbed.analysis.fit.record_hypotheses import taken_notes
from testbed.analysis.fit.solve import alternate_fit_and_passes, least_gain, solve, to_its_end
from testbed.analysis.fit.spindle_speed import at_modelled_speed
from testbed.analysis.fit.switched import switch_note
from testbed.analysis.fit.tooth_circles import at_least_strength, direction_notes
from testbed.analysis.fit.waveform import Fitter
from testbed.analysis.search.candidate import ADEQUATE, Candidate
from testbed.analysis.search.candidate_round import candidate_of, with_effect
from testbed.analysis.search.diagnosis import judged_on
from testbed.analysis.search.outlier_records import SOUND, agreed, misfit
from testbed.analysis.search.refit_from_prior import with_examples
from testbed.effect import Effect
from testbed.machine import Model, base_parameter
from testbed.units import format_quantity

WIDE = 0.5  # half an interval over its value from which the value is called poorly known


@dataclass(frozen=True)
class Addition:
    """The model with the effect, held-out errors without and with it, parameters with intervals, and warnings.

    effects: what was added, in that order. fit: with them; bare: the fit before, without, on the same records. unheard: names
    of records without a say in the fit with them. at_bound: parameters that ended where the range searched ends. held: paths of
    those that the records do not tell, which stay as believed.
    """

    effects: tuple[str, ...]
    model: Model
    before: float
    after: float
    noise_floor: float
    records_before: tuple[RecordError, ...]
    records_after: tuple[RecordError, ...]
    held_out: bool
    parameters: Mapping[str, Estimate]
    converged: bool
    warnings: tuple[str, ...]
    fit: WaveformFit
    bare: WaveformFit
    unheard: tuple[str, ...] = ()
    at_bound: tuple[str, ...] = ()
    held: tuple[str, ...] = ()

    @property
    def effect(self) -> str:
        """What was added, in words."""
        return " + ".join(self.effects)

    def in_fit(self) -> tuple[float, float, float]:
        """(error before, error after, noise floor) over the records that had a say in the fit."""
        before, after = ([one for one in some if one.name not in self.unheard]
                         for some in (self.records_before, self.records_after))
        return pooled(before)[0], *pooled(after)


def add_effect(engine: Engine, records: Sequence[Observed], model: Model, effect: Effect, catalogue: Mapping[str, Effect],
               progress: Callable[[str], None] = lambda text: None) -> Addition:
    """Fit the model without and with the effect, all parameters jointly, from several starts.

    ValueError where no record could show the effect.
    """
    return add_effects(engine, records, model, [effect], catalogue, progress)


def add_effects(engine: Engine, records: Sequence[Observed], model: Model, effects: Sequence[Effect],
                catalogue: Mapping[str, Effect], progress: Callable[[str], None] = lambda text: None,
                told: Identifiable | None = None) -> Addition:
    """Effects added one after the other, each as `add_effect` does it, and what all of them together do.

    Of several strong ones, one alone may lead the fit astray and raise the error: where the last leaves more than noise, they
    are fitted together from the model as it was, too. told: what the records tell of the model's parameters, if that is at
    hand. ValueError where no record could show one of them.
    """
    known = {**catalogue, **{one.name: one for one in effects}}
    first, *others = effects
    step = _with_one_more(engine, records, model, first, known, progress, told)
    before = step
    for effect in others:
        step = _with_one_more(engine, records, step.fit.state.model, effect, known, progress)
    names, found = tuple(one.name for one in effects), (step.fitter, step.fit)
    if others and misfit(*found)[1] > SOUND:
        progress(f"fitting with {' and '.join(names)} from the model as it was")
        found = min(found, agreed(*model_fit(engine, step.records, with_examples(model, names, known), known)),
                    key=lambda one: misfit(*one)[0])
    return _told(names, model, before, *solve(*found, TOLD), known)


@dataclass(frozen=True)
class _Step:
    """One effect more: the fit with it and its fitter, the fit without, and held-out errors of that, on the same records."""

    records: Sequence[Observed]
    fitter: Fitter
    fit: WaveformFit
    bare: WaveformFit
    errors: tuple[RecordError, ...]


def _with_one_more(engine: Engine, records: Sequence[Observed], model: Model, effect: Effect, catalogue: Mapping[str, Effect],
                   progress: Callable[[str], None], told: Identifiable | None = None) -> _Step:
    """The model fitted without and with one effect of the catalogue."""
    if not applicable(effect, records):
        raise ValueError(f"no record can show {effect.name}: it acts in the cut, and nothing is cut")
    records = at_modelled_speed(records, [*model.effects, effect.name], catalogue)
    progress("fitting the model as it is")
    fitter, fit = model_fit(engine, records, model, catalogue, told=told)
    bare = candidate_of(fitter, fit, (), None, 1.0)
    before = bare.errors
    progress(f"fitting with {effect.name}")
    wider, with_it = _best_fit_with(engine, model, catalogue, effect, bare, progress)
    wider, with_it = solve(wider, to_its_end(wider, with_it), HYPOTHESES)
    progress("looking again for a fit without it")
    reduced = state_without(with_it.state, effect.name, {effect.name: effect})
    again = alternate_fit_and_passes(fitter, reduced, rounds=1, iterations=8)
    if again.cost < fit.cost - least_gain(fit):  # the effect only helped to find a better place for the model without it
        fit, before = again, tuple(held_out_errors(fitter, again))
    return _Step(records, wider, with_it, fit, before)


def _told(names: tuple[str, ...], believed: Model, before: _Step, fitter: Fitter, fit: WaveformFit,
          catalogue: Mapping[str, Effect]) -> Addition:
    """What the effects of these names did to the believed model, whose fit without them is that of the step `before`."""
    records = before.records
    held = with_guesses_held(*at_least_strength(fitter, fit, catalogue), believed, catalogue)
    fitter, fit, found = held.fitter, held.fit, held.values
    after = held_out_errors(fitter, fit)
    result = Addition(names, held.model, pooled(before.errors)[0], pooled(after)[0], pooled(after)[1], before.errors,
                      tuple(after), holds_out(records), found, fit.converged, (), fit, before.bare,
                      tuple(record.name for record in fitter.records if not record.in_fit), at_bound(fitter.free, found),
                      held.held)
    return replace(result, warnings=(*_warnings(result, fitter, catalogue), *taken_notes(records, fitter.records),
                                     *clock_note(fitter, fit), *remarks_on(believed, held.model)))


def _best_fit_with(engine: Engine, model: Model, catalogue: Mapping[str, Effect], effect: Effect, bare: Candidate,
                   progress: Callable[[str], None]) -> tuple[Fitter, WaveformFit]:
    """The fit with the effect; where it leaves more than noise, the one from the believed machine if that explains more.

    What the model without a strong effect made up for can lead every start from its fit astray.
    """
    records = bare.fitter.records

    def anew(turned: Container[str] = ()) -> tuple[Fitter, WaveformFit]:
        return agreed(*model_fit(engine, records, with_examples(model, [effect.name], catalogue, turned), catalogue))

    if marks_show(effect, records):
        return anew()
    found = agreed(*solve(*_fit_with(engine, model, catalogue, effect, bare, progress), ("force_jumps",)))
    before, (likelihood, left) = pooled(bare.errors), misfit(*found)
    doubtful = before[0] > ANCHOR * before[1] or at_a_bound(found[0].free, found[1].state.model)
    if left <= SOUND or not doubtful:
        return found
    progress(f"fitting with {effect.name} from the believed machine")
    other = anew()
    if misfit(*other)[1] > SOUND and effect.other_side() is not None:
        other = min(other, anew([effect.name]), key=lambda one: misfit(*one)[0])
    return other if misfit(*other)[0] < likelihood else found


def _fit_with(engine: Engine, model: Model, catalogue: Mapping[str, Effect], effect: Effect, bare: Candidate,
              progress: Callable[[str], None]) -> tuple[Fitter, WaveformFit]:
    """The fit with the effect; never worse than without, since at its neutral values it contains that."""
    fitter, fit = bare.fitter, bare.fit
    error, noise = pooled(bare.errors)
    origins = origins_of(engine, model, fitter, fit, anchored=error > ANCHOR * noise)
    tried = with_effect(bare, effect.name, catalogue, origins, progress)
    wider = extended(fitter.on(tried.fitter.records), effect)
    if effect.name not in tried.fit.state.model.effects:
        found = alternate_fit_and_passes(wider, _with_neutral(fit.state, effect))
    else:
        found = tried.fit
    if found.cost > fit.cost and any(parameter.vanishes for parameter in effect.parameters):
        nested = alternate_fit_and_passes(wider, _with_neutral(fit.state, effect))
        found = min(found, nested, key=lambda one: one.cost)
    if has_kinks([*model.effects, effect.name], catalogue):
        return finely(wider, found, catalogue)
    return wider, found


def _with_neutral(state: State, effect: Effect) -> State:
    values = {one.name: one.neutral if one.vanishes else (one.example if one.start is None else one.start)
              for one in effect.parameters}
    return replace(state, model=state.model.with_effect(effect.name, **values))


def _warnings(result: Addition, fitter: Fitter, catalogue: Mapping[str, Effect]) -> list[str]:
    """What the data do not determine, in sentences."""
    said = []
    before, after, noise = result.in_fit()
    if names := result.unheard:
        said.append(f"{', '.join(names)}: not followed by a model that explains all other records down to their noise, and so "
                    "without a say in the fit (chaotic, disturbed, or alone in showing what else is missing); over the others "
                    f"the error goes from {before:.4f} to {after:.4f} (noise floor {noise:.4f})")
    if not result.converged:
        said.append("the fit did not converge: the values are those of its last step")
    if after > before * (1 - 1e-3):
        does, them = ("does", "it") if len(result.effects) == 1 else ("do", "them")
        said.append(f"{result.effect} {does} not lower the error {judged_on(result.held_out)}: nothing speaks for {them}")
    said += direction_notes(fitter, result.fit.state.model, catalogue)
    bounds = {one.path: one.bounds for one in fitter.free}
    for path, one in result.parameters.items():
        if path in result.held:
            said.append(f"{path} is not determined by these records, or only together with others: held at "
                        f"{format_quantity(one.value, one.unit, 5)}, as believed")
        if path not in bounds:  # held
            continue
        name, _, parameter = ("", "", "") if base_parameter(path) else path.partition(".")
        low, high = bounds[path]
        half = 0.5 * (one.high - one.low)
        nothing = half <= 0.0 or not math.isfinite(half) or not one.bounded
        if parameter and not nothing:
            known = catalogue[name].parameter(parameter)
            if known.vanishes and one.low <= known.neutral <= one.high:
                said.append(f"{path} cannot be told from {known.neutral:g}, where {name} vanishes")
                continue
        if nothing:
            said.append(f"{path} is not determined by these records, or only together with others: its value is a guess")
        elif one.low <= low or one.high >= high:
            said.append(f"the interval of {path} reaches the bound of what the law allows")
        elif half > WIDE * abs(one.value):
            said.append(f"{path} is poorly known: +-{half:.3g} {one.unit} on {one.value:.3g} {one.unit}")
    if after > ADEQUATE * noise:
        said += switch_note(fitter, result.fit.state, catalogue)
    return said


def as_json(result: Addition) -> dict[str, Any]:
    """The answer of `testbed add --json`, SI values."""
    return {
        "effect": result.effect, "effects": list(result.effects),
        "error": {"before": result.before, "after": result.after}, "noise_floor": result.noise_floor,
        "records": [{"name": one.name, "before": one.error, "after": other.error, "noise_floor": other.noise_floor,
                     "held_out": result.held_out}
                    for one, other in zip(result.records_before, result.records_after, strict=True)],
        "parameters": {path: one.as_json() for path, one in result.parameters.items()},
        "converged": result.converged, "at_bound": list(result.at_bound), "warnings": list(result.warnings),
    }
