"""Which physical effect does the believed model lack: none, one, several, or something that is not in the catalogue.

The base model is refitted to everything with every nuisance. If that leaves more than noise, every candidate is tried: a
first Gauss-Newton step ranks them (a score test with a look at the true cost), the leaders are refitted in full, scored on
held-out conditions and by BIC on the effective sample size, and the strongest that passes both gates is added; then again.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from analysis.held_out import RecordError, held_out_errors, pooled, record_error
from analysis.lines import find_peaks
from analysis.observed import Observed, Plant
from analysis.starts import anchored_state, base_fit, polish
from analysis.waveform import Fitter, Free, Linearised, State, WaveformFit
from testbed.effect import Effect
from testbed.machine import BASE_UNITS, Model

ANCHOR = 1.5  # error over noise floor above which candidates also start from the small-amplitude structure
ADEQUATE = 1.02  # error over noise floor up to which nothing is looked for
COMPLETE = 1.15  # error over noise floor above which something is still missing
SHARES = (0.1, 0.4, 1.0)  # of an effect's example strength, tried as starts
SCREENED = 3  # records, the worst fitted, on which starting points are compared
LEADERS = 4  # candidates refitted in full
MOST_EFFECTS = 3
DELTA_BIC = 10.0
HOPE = 0.2  # share of the gain the gate asks for that the first step of a candidate must bring to be refitted at all
GAIN = 0.01  # share of the held-out excess over the noise that an effect must take away
EXPLAINED = 0.75  # share of the excess that named effects must take away, else the cause is said to be unknown


@dataclass(frozen=True)
class Candidate:
    """A set of effects tried: what it was fitted to and how well it predicts what it was not fitted to."""

    effects: tuple[str, ...]
    parameters: Mapping[str, float]
    error_fit: float
    error_held_out: float
    delta_bic: float
    converged: bool
    fit: WaveformFit | None = None
    fitter: Fitter | None = None
    errors: tuple[RecordError, ...] = ()


@dataclass(frozen=True)
class Diagnosis:
    """The verdict and the numbers behind it."""

    verdict: str
    effects: tuple[str, ...]
    sentence: str
    baseline: float
    with_effects: float
    noise_floor: float
    candidates: tuple[Candidate, ...]
    base: Candidate
    best: Candidate
    steps: tuple[Candidate, ...] = field(default_factory=tuple)


def _residual_peaks(records: Sequence[Observed], fit: WaveformFit, count: int = 6) -> list[float]:
    """Frequencies (Hz) of the strongest lines in the residuals."""
    found: list[tuple[float, float]] = []
    for record, rest in zip(records, fit.residuals, strict=True):
        values = rest.reshape(record.data.shape)[0]
        found += [(height, frequency) for frequency, height in find_peaks(values, record.rate, count=count)]
    kept: list[float] = []
    for _, frequency in sorted(found, reverse=True):
        if frequency > 5.0 and all(abs(frequency / other - 1) > 0.02 for other in kept):
            kept.append(frequency)
    return kept[:count]


def fitting_example(fitter: Fitter, effect: Effect, fit: WaveformFit) -> Effect:
    """The effect with examples that suit these records, where its own would swamp them (records in volts, say).

    Each parameter that switches the effect is lowered by tens until the prediction moves by less than a third of the record.
    """
    index = int(np.argmax([float(np.mean(rest**2)) for rest in fit.residuals]))
    record, state = fitter.records[index], fit.state
    size = float(np.sqrt(np.mean(record.project(record.data) ** 2)))
    base = fit.residuals[index]
    fitted = []
    for parameter in effect.parameters:
        example = parameter.example
        for _ in range(20 if parameter.vanishes else 0):
            values = {
                one.name: example if one is parameter else one.neutral if one.vanishes else one.example
                for one in effect.parameters
            }
            model = state.model.with_effect(effect.name, **values)
            moved = fitter.residual_of(index, replace(state, model=model))[: len(base)] - base
            if float(np.sqrt(np.mean(moved**2))) <= 0.3 * size:
                break
            example = parameter.neutral + 0.1 * (example - parameter.neutral)
        fitted.append(replace(parameter, example=example))
    return replace(effect, parameters=tuple(fitted))


def starting_points(effect: Effect, records: Sequence[Observed], fit: WaveformFit) -> list[dict[str, float]]:
    """Parameter values a fit of the effect starts from: frequencies at the residual's lines, angles all round, signs both."""
    choices: list[list[float]] = []
    for parameter in effect.parameters:
        low, high = parameter.bounds
        if not parameter.vanishes and parameter.unit == "Hz":
            peaks = [peak for peak in _residual_peaks(records, fit) if low <= peak <= high]
            choices.append(peaks or [parameter.start or parameter.example])
        elif not parameter.vanishes and parameter.unit == "rad":
            choices.append([low + (high - low) * (k + 0.5) / 4 for k in range(4)])
        elif parameter.vanishes:
            away = [share * (parameter.example - parameter.neutral) for share in SHARES]
            signed = [parameter.neutral + sign * size for size in away for sign in (1.0, -1.0)]
            choices.append([value for value in signed if low <= value <= high])
        else:
            choices.append([parameter.start if parameter.start is not None else parameter.example])
    names = [parameter.name for parameter in effect.parameters]
    return [dict(zip(names, values, strict=True)) for values in itertools.islice(itertools.product(*choices), 24)]


def effect_parameters(effect: Effect) -> list[Free]:
    """The effect's parameters as unknowns of a fit."""
    free = []
    for parameter in effect.parameters:
        size = abs(parameter.example - parameter.neutral) or abs(parameter.example) or 1.0
        if parameter.unit == "Hz":
            size = 0.02 * max(abs(parameter.example), 1.0)
        elif parameter.unit == "rad":
            size = 0.3
        free.append(
            Free(
                f"{effect.name}.{parameter.name}", 0.3 * size if parameter.unit not in ("Hz", "rad") else size, parameter.bounds
            )
        )
    return free


def applicable(effect: Effect, records: Sequence[Observed]) -> bool:
    """Whether these records could show the effect at all: without a cut, only the structure's and the sensor's effects can."""
    if any(record.cut is not None for record in records):
        return True
    places = set(effect.hooks)
    return bool(places & {"structure_force", "measure", "sensed_displacement"})


def effective_size(fit: WaveformFit) -> float:
    """Number of independent residuals, from their autocorrelation up to where it first dies away."""
    total = 0.0
    for rest in fit.residuals:
        values = rest - rest.mean()
        power = np.abs(np.fft.rfft(values, 2 * len(values))) ** 2
        correlation = np.fft.irfft(power)[: len(values)]
        correlation = correlation / correlation[0] if correlation[0] > 0 else correlation
        negative = np.flatnonzero(correlation <= 0.05)
        last = int(negative[0]) if len(negative) else len(values)
        total += len(values) / (1.0 + 2.0 * float(correlation[1:last].sum()))
    return max(total, 10.0)


def bic(fit: WaveformFit, size: float) -> float:
    """Bayesian information criterion with the noise's variance unknown, on `size` independent values."""
    count = sum(rest.size for rest in fit.residuals)
    return size * math.log(max(fit.squares, 1e-300) / count) + len(fit.names) * math.log(size)


def _extended(fitter: Fitter, effect: Effect) -> Fitter:
    return Fitter(fitter.plant, fitter.records, [*fitter.free, *effect_parameters(effect)])


@dataclass(frozen=True)
class Origin:
    """A state of the base model that candidates start from, with its slopes by the base's unknowns."""

    state: State
    parts: tuple[Linearised, ...]


def first_step(fitter: Fitter, effect: Effect, fit: WaveformFit, origins: Sequence[Origin]) -> tuple[float, State, Fitter]:
    """(cost, state, fitter) after the best single Gauss-Newton step from any of the effect's starting points.

    The slopes by the base's own unknowns are those of the origin; only the effect's are computed.
    """
    effect = fitting_example(fitter, effect, fit)
    wider = _extended(fitter, effect)
    best: tuple[float, State] = (math.inf, fit.state)
    places = [place for place, one in enumerate(wider.free) if one.path.startswith(f"{effect.name}.")]
    points = starting_points(effect, fitter.records, fit)
    worst = [int(place) for place in np.argsort([-float(np.mean(rest**2)) for rest in fit.residuals])[:SCREENED]]
    for origin in origins:
        tried = []
        for values in points:
            state = replace(origin.state, model=origin.state.model.with_effect(effect.name, **values))
            tried.append((wider.cost(state, worst), state))
        tried.sort(key=lambda pair: pair[0])
        tried = [(wider.cost(state), state) for _, state in tried[:2]]
        for cost, state in tried:
            parts = wider.with_slopes(origin.parts, state, places)
            for damping in (1e-3, 1.0):
                move, own = wider.step(parts, damping)
                trial = wider.with_own(wider.moved(state, move), own)
                new = wider.cost(trial)
                if new < cost:
                    cost, state = new, trial
                    break
            if cost < best[0]:
                best = (cost, state)
    if best[0] > fit.cost and all(record.cut is None for record in fitter.records):
        found = wider.fit(best[1], iterations=10)  # without a cut this is cheap, and one step may not turn the corner
        best = (found.cost, found.state)
    return best[0], best[1], wider


def _candidate(
    fitter: Fitter, fit: WaveformFit, effects: tuple[str, ...], reference: WaveformFit | None, size: float
) -> Candidate:
    errors = held_out_errors(fitter, fit)
    in_sample = [record_error(record, rest) for record, rest in zip(fitter.records, fit.residuals, strict=True)]
    parameters = {path: fit.state.model.value(path) for path in fit.names if "." in path}
    gain = 0.0 if reference is None else bic(reference, size) - bic(fit, size)
    return Candidate(
        effects, parameters, pooled(in_sample)[0], pooled(errors)[0], gain, fit.converged, fit, fitter, tuple(errors)
    )


def _excess(error: float, noise: float) -> float:
    return max(error**2 - noise**2, 0.0)


def _round(
    current: Candidate,
    catalogue: Mapping[str, Effect],
    origins: Sequence[Origin],
    say: Callable[[str], None],
) -> list[Candidate]:
    """Candidates that extend the current set by one effect, best held-out error first."""
    assert current.fit is not None and current.fitter is not None
    ranked = []
    for name, effect in catalogue.items():
        if name in current.effects or name in current.fit.state.model.effects or not applicable(effect, current.fitter.records):
            continue
        say(f"trying {name}")
        cost, state, fitter = first_step(current.fitter, effect, current.fit, origins)
        ranked.append((cost, name, state, fitter))
    ranked.sort(key=lambda entry: entry[0])
    size = effective_size(current.fit)
    floor = 0.5 * sum(rest.size for rest in current.fit.residuals)
    hopeful = current.fit.cost - HOPE * GAIN * max(current.fit.cost - floor, 0.0)
    found = []
    complete = 0  # once a candidate explains everything, only a rival close to it can still matter
    for place, (cost, name, state, fitter) in enumerate(ranked):
        if place >= LEADERS or complete > 1 or cost > hopeful:
            found.append(Candidate((*current.effects, name), {}, current.error_fit, current.error_held_out, 0.0, False))
            continue
        say(f"refitting with {name}")
        fit = polish(fitter, state, rounds=3, iterations=60 if not complete else 10)
        found.append(
            _candidate(
                fitter,
                fit,
                (*current.effects, name),
                current.fit,
                effective_size(fit) if fit.cost < 0.5 * current.fit.cost else size,
            )
        )
        complete += int(complete > 0 or found[-1].error_held_out <= ADEQUATE * pooled(found[-1].errors)[1])
    return sorted(found, key=lambda candidate: candidate.error_held_out)


def _nesting_guard(current: Candidate, tried: Sequence[Candidate]) -> Candidate:
    """The current set refitted from where the best larger set ended: a local minimum must not pass for missing physics."""
    assert current.fit is not None and current.fitter is not None
    best = current
    for one in sorted((one for one in tried if one.fit is not None), key=lambda one: one.error_fit)[:2]:
        assert one.fit is not None
        state = replace(one.fit.state, model=one.fit.state.model.without_effect(one.effects[-1]))
        fit = current.fitter.fit(state, iterations=12)
        assert best.fit is not None
        if fit.cost < best.fit.cost * (1.0 - 1e-4):
            best = _candidate(current.fitter, fit, current.effects, best.fit, effective_size(fit))
    return best


def _backward(current: Candidate, say: Callable[[str], None]) -> Candidate:
    """The set without every effect that the later ones made needless: refitted without it, the BIC is no worse."""
    for name in current.effects[:-1]:
        assert current.fit is not None and current.fitter is not None
        say(f"is {name} still needed?")
        free = [one for one in current.fitter.free if not one.path.startswith(f"{name}.")]
        fitter = Fitter(current.fitter.plant, current.fitter.records, free)
        state = replace(current.fit.state, model=current.fit.state.model.without_effect(name))
        fit = polish(fitter, state, rounds=2, iterations=15)
        size = effective_size(current.fit)
        if bic(fit, size) <= bic(current.fit, size) + DELTA_BIC:
            effects = tuple(other for other in current.effects if other != name)
            current = replace(_candidate(fitter, fit, effects, current.fit, size), delta_bic=current.delta_bic)
    return current


def _against(one: Candidate, reference: Candidate) -> Candidate:
    """A candidate's gain counted from a better reference."""
    if one.fit is None or reference.fit is None:
        return one
    size = effective_size(one.fit)
    return replace(one, delta_bic=bic(reference.fit, size) - bic(one.fit, size))


def _passes(candidate: Candidate, current: Candidate, noise: float) -> bool:
    before, after = _excess(current.error_held_out, noise), _excess(candidate.error_held_out, noise)
    return candidate.delta_bic > DELTA_BIC and before - after > max(GAIN * before, 1e-3 * noise**2)


def _tied(first: Candidate, other: Candidate, current: Candidate, noise: float) -> bool:
    """Whether the data cannot tell two candidates apart."""
    if other.fit is None or first.fit is None:
        return False
    size = effective_size(first.fit)
    apart = abs(bic(other.fit, size) - bic(first.fit, size))
    gained = _excess(current.error_held_out, noise) - _excess(first.error_held_out, noise)
    lost = _excess(other.error_held_out, noise) - _excess(first.error_held_out, noise)
    return apart < DELTA_BIC or (lost < 0.02 * gained and apart < 3 * DELTA_BIC)


def diagnose(
    plant: Plant,
    records: Sequence[Observed],
    model: Model,
    catalogue: Mapping[str, Effect],
    *,
    say: Callable[[str], None] = lambda text: None,
) -> Diagnosis:
    """Name what the model lacks. Deterministic: no random numbers are drawn."""
    say("fitting the believed model")
    fitter, fit = base_fit(plant, records, model)
    base = _candidate(fitter, fit, (), None, 1.0)
    noise = pooled(base.errors)[1]
    current, steps = base, [base]
    seen: list[Candidate] = []
    tied: tuple[str, ...] = ()
    while len(current.effects) < MOST_EFFECTS and current.error_held_out > ADEQUATE * noise:
        assert current.fit is not None and current.fitter is not None
        origins = [Origin(current.fit.state, current.fit.parts)]
        if not current.effects and current.error_held_out > ANCHOR * noise:
            state = anchored_state(plant, records, model)
            origins.append(Origin(state, current.fitter.linearise_all(state)))
        last = _round(current, catalogue, origins, say)
        refitted = _nesting_guard(current, last)
        if refitted is not current:
            current = refitted
            steps[-1] = refitted
            base = refitted if not refitted.effects else base
            last = [_against(one, refitted) for one in last]
            if current.error_held_out <= ADEQUATE * noise:
                break
        seen += last
        passing = [one for one in last if one.fit is not None and _passes(one, current, noise)]
        if not passing:
            break
        first = passing[0]
        tied = tuple(one.effects[-1] for one in passing[1:] if _tied(first, one, current, noise))
        if tied:
            tied = (first.effects[-1], *tied)
            if not current.effects:
                current = first
                steps.append(first)
            break
        current = _backward(first, say)
        steps.append(current)
        if current is not first:
            seen.append(current)
    seen.sort(key=lambda one: (one.fit is None, one.error_held_out, len(one.effects)))
    return _verdict(base, current, steps, tuple(seen), noise, tied)


def _verdict(
    base: Candidate,
    best: Candidate,
    steps: Sequence[Candidate],
    tries: tuple[Candidate, ...],
    noise: float,
    tied: tuple[str, ...],
) -> Diagnosis:
    def answer(verdict: str, effects: tuple[str, ...], sentence: str) -> Diagnosis:
        return Diagnosis(
            verdict, effects, sentence, base.error_held_out, best.error_held_out, noise, tries, base, best, tuple(steps)
        )

    ratio = base.error_held_out / noise
    if ratio <= ADEQUATE:
        return answer(
            "adequate",
            (),
            f"The model explains the records down to their noise (error {ratio:.3f} of the "
            "noise floor): nothing is missing that these records could show.",
        )
    if base.fit is not None and not base.fit.converged and not best.effects:
        return answer(
            "not_converged",
            (),
            "The fit of the believed model did not settle, so nothing can be said of what "
            "it lacks: check the conditions and the starting values.",
        )
    if tied and len(best.effects) <= 1 and tied[0] in best.effects:
        return answer(
            "undecided",
            tied,
            f"Something is missing, and {' and '.join(tied)} explain it equally well: these records cannot tell them apart.",
        )
    share = 1.0 - _excess(best.error_held_out, noise) / max(_excess(base.error_held_out, noise), 1e-300)
    left = best.error_held_out / noise
    if best.effects and (left <= COMPLETE or share >= EXPLAINED):
        rest = f" A further effect is one of {', '.join(tied)}, which these records cannot tell apart." if tied else ""
        rest = (
            rest
            if left <= COMPLETE or tied
            else f" Something more remains: the error is still {left:.2f} times the noise floor."
        )
        return answer(
            "missing_effect",
            best.effects,
            f"The model lacks {' and '.join(best.effects)}: the error on records "
            f"left out of the fit falls from {base.error_held_out:.3g} to {best.error_held_out:.3g}.{rest}",
        )
    if ratio <= 1.05 and not best.effects:
        return answer(
            "adequate",
            (),
            f"The error is {ratio:.3f} of the noise floor and no known effect lowers it: nothing "
            "is missing that these records could show.",
        )
    return answer(
        "unexplained",
        (),
        f"Something is missing (error {ratio:.3g} times the noise floor) that no effect of the catalogue explains.",
    )


def as_json(result: Diagnosis, before: Model) -> dict[str, Any]:
    """The answer of `testbed diagnose --json` (contract), without the next test."""
    after = result.best.fit.state.model if result.best.fit is not None else before
    names = [name for name in (result.base.fit.names if result.base.fit else ()) if name in BASE_UNITS]
    return {
        "verdict": result.verdict,
        "effects": list(result.effects),
        "sentence": result.sentence,
        "error": {"baseline": result.baseline, "with_effects": result.with_effects, "noise_floor": result.noise_floor},
        "candidates": [
            {
                "effects": list(one.effects),
                "parameters": dict(one.parameters),
                "error_fit": one.error_fit,
                "error_held_out": one.error_held_out,
                "delta_bic": one.delta_bic,
                "converged": one.converged,
            }
            for one in result.candidates
        ],
        "base_parameters": {
            name: {"before": before.value(name), "after": after.value(name), "unit": BASE_UNITS[name]} for name in names
        },
        "next_test": None,
    }
