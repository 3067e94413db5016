"""Whether the law of an effect that was named, or that the model has, has the exponent that the catalogue says.

Other laws are soon imitated: a damping by the cube of the velocity is nearly one by its square, with a little less of all other
damping. The error comes within a few parts in a thousand of the noise, and yet, with the exponent free, thousands of samples
are sure that it is three. Then the law is one that the catalogue does not hold.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from testbed.analysis.fit.effect_start import state_without
from testbed.analysis.fit.estimates import Estimate, estimates
from testbed.analysis.fit.evidence import DELTA_BIC, bic, effective_size
from testbed.analysis.fit.fit_state import FreeParameter, State, WaveformFit
from testbed.analysis.fit.held_out import errors_in_fit, pooled
from testbed.analysis.fit.model_fit import model_fit
from testbed.analysis.fit.solve import solve
from testbed.analysis.fit.waveform import Fitter
from testbed.analysis.search.candidate import ADEQUATE, Candidate
from testbed.analysis.search.candidate_round import candidate_of
from testbed.analysis.search.diagnosis import COMPLETE, Diagnosis, OtherForm
from testbed.effect import Effect, Parameter

ANOTHER = 0.25  # difference of an exponent from the law's own, from which it is another law's
STEEPER = 0.5  # by which it must be larger, to be believed before pairs of effects were tried: what those make up is not
DOUBTED = ("missing_effect", "unexplained", "adequate", "not_converged")  # verdicts under which a law may be another
REFERENCE = "reference_"  # before the name of a variable that a law is a power of
STEP = 0.1  # natural step of an exponent
ITERATIONS = 40
NEARLY = 1.5  # error over noise floor, of all records or of most, that may be left by passes which were right for the law's
# own exponent only


def with_form_asked(found: Diagnosis, catalogue: Mapping[str, Effect], progress: Callable[[str], None]) -> Diagnosis:
    """The diagnosis, unexplained where the law of an effect that it names, or that the model has, turns out to be another."""
    return with_other_form(found, other_form(found.best_fit, catalogue, progress)) if found.verdict in DOUBTED else found


def with_other_form(found: Diagnosis, other: OtherForm | None) -> Diagnosis:
    """The diagnosis, unexplained where there is another form of the law of an effect that it names, or that the model has."""
    if found.verdict not in DOUBTED or other is None:
        return found
    left = found.best.error_where_known / found.noise_floor
    first = f"The error is {left:.3f} of the noise floor, and yet:" if found.verdict == "adequate" else found.sentence
    return replace(found, verdict="unexplained", sentence=f"{first} {other.sentence}", form=other)


def other_form(one: Candidate, catalogue: Mapping[str, Effect], progress: Callable[[str], None]) -> OtherForm | None:
    """The other exponent of a law in a fitted set of effects, or in its model; None where the laws hold, or cannot be asked.

    Where the model states an exponent, its owner has chosen it, and it is not asked.
    """
    stated = one.fit.state.model.effects
    for name in dict.fromkeys((*one.effects, *stated)):
        exponent = _exponent(catalogue[name])
        if exponent is None or exponent.name in stated[name]:
            continue
        progress(f"is the exponent of {name} that of its law?")
        others = tuple(other for other in one.effects if other != name)
        for needless in dict.fromkeys((others, ())):
            state, fitter = one.fit.state, one.fitter
            for other in needless:
                state, fitter = state_without(state, other, catalogue), fitter.without(other)
            kept = tuple(other for other in one.effects if other not in needless)
            found = _freed(fitter, state, catalogue, name, exponent, kept, one)
            if found is not None:
                return replace(found, needless=needless)
    return None


def steeper_form(asked: Sequence[Candidate], tried: Sequence[Candidate], catalogue: Mapping[str, Effect],
                 progress: Callable[[str], None]) -> OtherForm | None:  # fmt: skip
    """The clearly larger exponent of a law, by which one of the sets `asked` leaves but noise, and less than all those `tried`.

    With it a search may end: two effects of the catalogue do not make up a steeper law than either has. The records of all
    sets are weighed by their noise.
    """
    return FormsAsked(catalogue, progress).steeper(asked, tried)


class FormsAsked:
    """Other forms of the laws of fitted sets; no set is asked twice."""

    def __init__(self, catalogue: Mapping[str, Effect], progress: Callable[[str], None]) -> None:
        self.catalogue, self.say = catalogue, progress
        self._known: list[tuple[State, OtherForm | None]] = []

    def steeper(self, asked: Sequence[Candidate], tried: Sequence[Candidate]) -> OtherForm | None:
        """See `steeper_form`."""
        for one in sorted(asked, key=lambda one: one.error_fit):
            other = self._of(one)
            if other is not None and other.value >= other.stated + STEEPER and other.left <= ADEQUATE and _beats(other, tried):
                return other
        return None

    def _of(self, one: Candidate) -> OtherForm | None:
        for state, form in self._known:
            if state is one.fit.state:
                return form
        form = other_form(one, self.catalogue, self.say)
        self._known.append((one.fit.state, form))
        return form


def _beats(other: OtherForm, tried: Sequence[Candidate]) -> bool:
    """Whether BIC prefers a law of another form to every set of effects."""
    assert other.fitted is not None
    size = effective_size(other.fitted.fit)
    return all(bic(other.fitted.fit, size) < bic(one.fit, size) - DELTA_BIC for one in tried)


def _exponent(effect: Effect) -> Parameter | None:
    return next((one for one in effect.form if one.name == "exponent"), None)


def _freed(
    fitter: Fitter, state: State, catalogue: Mapping[str, Effect], name: str, exponent: Parameter, kept: tuple[str, ...],
    one: Candidate,
) -> OtherForm | None:  # fmt: skip
    """What a fit of the effects `kept` with the exponent of one free finds, where that is another, and leaves but noise.

    one: the set as it was fitted with the law's own exponent, which must explain clearly less.
    """
    before = one.fit
    assert before is not None
    path = f"{name}.{exponent.name}"
    model = state.model.with_effect(name, exponent=exponent.neutral, **_references(catalogue[name], fitter))
    free = Fitter(fitter.engine, fitter.records, [*fitter.unknowns, FreeParameter(path, STEP, exponent.bounds)])
    fit = free.fit(replace(state, model=model), iterations=ITERATIONS, cost_limit=before.cost)
    told, left = _told(free, fit, path, catalogue)
    if left > ADEQUATE and not _is_another(exponent, before, fit, told):
        fit = _from_a_steeper_law(free, fit, path, exponent)
        told, left = _told(free, fit, path, catalogue)
    if left > ADEQUATE and _passes_alone(fit, left) and _is_another(exponent, before, fit, told):
        free, fit = min((free, fit), _anew(free, fit, catalogue), key=lambda one: one[1].cost)
        told, left = _told(free, fit, path, catalogue)
    if left > COMPLETE or not _is_another(exponent, before, fit, told):  # what leaves more is not the law either
        return None
    values = dict(fit.state.model.effects[name])
    fitted = candidate_of(free, fit, kept, before, effective_size(before))
    return OtherForm(name, exponent.neutral, told.value, told.low, told.high, fitted.delta_bic, left, values, fitted=fitted)


def _is_another(exponent: Parameter, before: WaveformFit, fit: WaveformFit, told: Estimate) -> bool:
    """Whether an exponent that was freed is another than the law's own, with which `before` was fitted."""
    size = effective_size(before)
    far = abs(told.value - exponent.neutral) >= ANOTHER and not told.low <= exponent.neutral <= told.high
    return far and bic(before, size) - bic(fit, size) > DELTA_BIC


def _from_a_steeper_law(free: Fitter, fit: WaveformFit, path: str, exponent: Parameter) -> WaveformFit:
    """The fit that begins one power higher, where that explains most records better and so all of them; else the fit as it is.

    One record may hold a fit at the law's own exponent: its passes, and how it began, are right for no other, and it
    outweighs all that the others would gain.
    """
    raised = min(exponent.neutral + 1.0, exponent.bounds[1])
    begun = replace(fit.state, model=fit.state.model.with_effect(path.partition(".")[0], exponent=raised))
    held = Fitter(free.engine, free.records, [one for one in free.unknowns if one.path != path])
    above = held.fit(begun, iterations=ITERATIONS)
    if not np.median(above.mean_squares) < np.median(fit.mean_squares):
        return fit
    _, found = solve(free, free.fit(above.state, iterations=ITERATIONS), ("best_half",))
    return min(fit, found, key=lambda one: one.cost)


def _passes_alone(fit: WaveformFit, left: float) -> bool:
    """Whether wrong passes may be all that a fit with another exponent lacks: most records it explains nearly."""
    return min(left, math.sqrt(float(np.median(fit.mean_squares)))) <= NEARLY


def _anew(fitter: Fitter, fit: WaveformFit, catalogue: Mapping[str, Effect]) -> tuple[Fitter, WaveformFit]:
    """The machine as it was fitted, fitted again from no entry, exit or angle known: those were of the law's own exponent."""
    return model_fit(fitter.engine, fitter.records, fit.state.model, catalogue, fitter.unknowns, cost_limit=fit.cost)


def _told(fitter: Fitter, fit: WaveformFit, path: str, catalogue: Mapping[str, Effect]) -> tuple[Estimate, float]:
    """(the exponent with its interval, error over noise floor in the fit)."""
    error, noise = pooled(errors_in_fit(fitter, fit))
    return estimates(fitter, fit, catalogue)[path], error / noise


def references(effect: Effect) -> dict[str, Parameter]:
    """By the name of the variable that a law is a power of: the parameter at whose value the exponent changes nothing."""
    return {one.name.removeprefix(REFERENCE): one for one in effect.form if one.name.startswith(REFERENCE)}


def _references(effect: Effect, fitter: Fitter) -> dict[str, float]:
    """What the law is a power of, as large as in the loudest record: there the exponent hardly changes the force."""
    loudest = max(fitter.records, key=lambda record: record.motion_size)
    rate = 1.0 if loudest.motion is None else loudest.motion[2]
    size = {"m": loudest.motion_size, "m/s": loudest.motion_size * rate}
    return {one.name: size[one.unit] for one in references(effect).values()}
