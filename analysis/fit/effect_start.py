"""Where the fit of a candidate effect starts: its strengths, frequencies and angles, tried by one Gauss-Newton step each."""

from __future__ import annotations

import itertools
import math
from collections.abc import Container, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from operator import itemgetter

import numpy as np

from testbed.analysis.fit.fit_state import FreeParameter, Jacobian, State, WaveformFit
from testbed.analysis.fit.free_parameters import free_parameters
from testbed.analysis.fit.least_squares import gauss_newton_step
from testbed.analysis.fit.length_cut import asks_length
from testbed.analysis.fit.moves.growing_decays import grown
from testbed.analysis.fit.observed import Observed
from testbed.analysis.fit.pass_search import begun_otherwise, place_entries, settle_passes, turn_phases
from testbed.analysis.fit.prediction import Engine
from testbed.analysis.fit.recurring_start import SCREENED, recurring_starts, residual_peaks
from testbed.analysis.fit.shown_range import is_shown, parameter_bounds
from testbed.analysis.fit.solve import alternate_fit_and_passes
from testbed.analysis.fit.starts import anchored_states, softened
from testbed.analysis.fit.waveform import Fitter
from testbed.effect import Effect
from testbed.machine import Model

ANCHOR = 1.5  # error over noise floor above which candidates also start from the small-amplitude structure
SHARES = (0.1, 0.4, 1.0)  # of an effect's example strength, tried as starts
SLIGHT = (0.01,)  # of it: from so close to nothing one step leads to the best strength, as far as the effect is linear
BESIDE = 0.25  # of the step between angles tried: at quarter turns an effect may do nothing (runout square to two teeth)
SMALL = 1e-3  # relative gain of a first step below which a sensor effect is fitted a little further
TOGETHER = 24  # passes by which the entries of all records are moved at the most
SETTLING, SETTLED = 10, 0.98  # rounds of placing entries and fitting at the most, and the share of the cost one must beat
CORNER = 8  # iterations of a fit that only has to find its valley,
CREEPING = 32  # and of one that, from nearer, creeps along it


def fitting_example(fitter: Fitter, effect: Effect, fit: WaveformFit) -> Effect:
    """The effect with examples that suit these records, where its own would swamp them (records in volts, say).

    Each parameter that switches the effect is lowered by tens until the prediction moves by less than a third of the record.
    """
    index = fit.worst(1)[0]
    record, state = fitter.records[index], fit.state
    size = float(np.sqrt(np.mean(record.project(record.data) ** 2)))
    base = fit.residuals[index]
    fitted = []
    for parameter in effect.parameters:
        example = parameter.example
        for _ in range(20 if parameter.vanishes else 0):
            values = {one.name: example if one is parameter else one.neutral if one.vanishes else one.example
                      for one in effect.parameters}
            model = state.model.with_effect(effect.name, **values)
            moved = fitter.residual_of(index, replace(state, model=model))[: len(base)] - base
            if float(np.sqrt(np.mean(moved**2))) <= 0.3 * size:
                break
            example = parameter.neutral + 0.1 * (example - parameter.neutral)
        fitted.append(replace(parameter, example=example))
    return replace(effect, parameters=tuple(fitted))


def starting_points(
    effect: Effect, records: Sequence[Observed], fit: WaveformFit, shares: Sequence[float] = SHARES
) -> list[dict[str, float]]:
    """Values a fit of the effect starts from: the residual's lines, angles all round, signs both; neutral if unseen."""
    choices: list[list[float]] = []
    for parameter in effect.parameters:
        low, high = parameter_bounds(parameter, records)
        if not is_shown(parameter, records):
            choices.append([parameter.neutral])
        elif not parameter.vanishes and parameter.unit == "Hz":
            peaks = [peak for peak in residual_peaks(records, fit) if low <= peak <= high]
            choices.append(peaks or [min(max(parameter.start or parameter.example, low), high)])
        elif parameter.each_record:
            choices.append([parameter.start or 0.0])  # every record is turned to where it fits
        elif not parameter.vanishes and parameter.unit == "rad":
            turn = min(high - low, 2 * math.pi)  # wider bounds would only bring the same angles again
            choices.append([low + turn * (k + BESIDE) / 4 for k in range(4)])
        elif parameter.vanishes:
            away = [share * (parameter.example - parameter.neutral) for share in shares]
            signed = [parameter.neutral + sign * size for size in away for sign in (1.0, -1.0)]
            choices.append([value for value in signed if low <= value <= high])
        else:
            choices.append([parameter.start if parameter.start is not None else parameter.example])
    names = [parameter.name for parameter in effect.parameters]
    return [dict(zip(names, values, strict=True)) for values in itertools.islice(itertools.product(*choices), 24)]


def effect_parameters(effect: Effect, records: Sequence[Observed]) -> list[FreeParameter]:
    """The effect's parameters as unknowns of a fit, but for those that no channel of these records shows."""
    swinging = tuple((f"{effect.name}.{position}", f"{effect.name}.{rate}") for position, rate in effect.oscillators)
    free = []
    for parameter in effect.parameters:
        if not is_shown(parameter, records):
            continue
        size = abs(parameter.example - parameter.neutral) or abs(parameter.example) or 1.0
        low, high = bounds = parameter_bounds(parameter, records)
        round_about = parameter.unit == "rad" and not parameter.vanishes and high - low >= 2 * math.pi
        step = {"Hz": 0.02 * max(abs(parameter.example), 1.0), "rad": 0.3}.get(parameter.unit, 0.3 * size)
        free.append(FreeParameter(f"{effect.name}.{parameter.name}", step, bounds, round_about, parameter.each_record,
                         "engagement" in effect.hooks, asks_length([effect.name], {effect.name: effect}), swinging))
    return free


def state_without(state: State, name: str, catalogue: Mapping[str, Effect]) -> State:
    """The state whose model lacks an effect; without one that makes entries gradual, they are those of whole passes again."""
    state = state.without_effect(name)
    return state.with_whole_first_passes() if name in catalogue and "engagement" in catalogue[name].hooks else state


def refitted_without(fitter: Fitter, state: State, name: str, catalogue: Mapping[str, Effect]) -> tuple[Fitter, WaveformFit]:
    """A short fit without one of the effects, from where all of them were."""
    without = fitter.without(name)
    return without, alternate_fit_and_passes(without, state_without(state, name, catalogue), rounds=2, iterations=15)


def is_required(name: str, names: Iterable[str], catalogue: Mapping[str, Effect]) -> bool:
    """Whether one of these effects can only be there beside the one of this name."""
    return any(name in catalogue[other].requires for other in names)


def all_free(records: Sequence[Observed], model: Model, catalogue: Mapping[str, Effect]) -> list[FreeParameter]:
    """The base parameters these records can speak of, and those of the effects the model has."""
    return sum((effect_parameters(catalogue[name], records) for name in model.effects), free_parameters(records, model))


def applicable(effect: Effect, records: Sequence[Observed], present: Container[str] | None = None) -> bool:
    """Whether these records could show the effect at all: without a cut, only the structure's and the sensor's effects can.

    present: the effects the model has already; an effect that requires one it lacks is not asked about yet. None: all are.
    """
    if present is not None and any(name not in present for name in effect.requires):
        return False
    if any(record.cut is not None for record in records):
        return True
    return not {"structure_force", "measure", "sensed_displacement"}.isdisjoint(effect.hooks)


def extended(fitter: Fitter, effect: Effect) -> Fitter:
    """The same fit with the effect's parameters unknown, too."""
    return Fitter(fitter.engine, fitter.records, [*fitter.unknowns, *effect_parameters(effect, fitter.records)])


@dataclass(frozen=True)
class Origin:
    """A state of the base model that candidates start from, with its slopes by the base's unknowns.

    scanned: the state of a mere scan behind it, with the coefficients' ratio as believed.
    """

    state: State
    parts: tuple[Jacobian, ...]
    scanned: State | None = None


def origins_of(engine: Engine, model: Model, fitter: Fitter, fit: WaveformFit, anchored: bool) -> list[Origin]:
    """Where candidates start: the fit, and, where it is bad, the small-amplitude structure of the model as believed."""
    origins = [Origin(fit.state, fit.parts)]
    if anchored:
        scanned, state = anchored_states(engine, fitter.records, model, fitter.unknowns)
        origins.append(Origin(state, fitter.linearise_all(state), scanned))
    return origins


def first_step(
    fitter: Fitter, effect: Effect, fit: WaveformFit, origins: Sequence[Origin], growing: bool = True
) -> tuple[float, State, Fitter]:
    """(cost, state, fitter) after the best single Gauss-Newton step from any of the effect's starting points.

    The slopes by the base's own unknowns are those of the origin; only the effect's are computed. growing: free decays alone
    are fitted from their openings on, too; needless where the effect can but be faint, so that no phase has run away.
    """
    effect = effect if "engagement" in effect.hooks else fitting_example(fitter, effect, fit)
    wider = extended(fitter, effect)
    best: tuple[float, State] = (math.inf, fit.state)
    places = [place for place, one in enumerate(wider.free) if one.path.startswith(f"{effect.name}.")]
    recurring = any(one.each_record for one in effect.parameters)
    points = recurring_starts(wider, effect, fit) if recurring else starting_points(effect, fitter.records, fit)
    slight = [] if recurring else starting_points(effect, fitter.records, fit, SLIGHT)
    worst = fit.worst(SCREENED)
    others = [place for place in range(len(fitter.records)) if place not in worst]
    for origin in origins:
        tried = []
        for values in (*points, *slight):
            state = replace(origin.state, model=origin.state.model.with_effect(effect.name, **values))
            state = _suited(wider, state, effect, worst)
            tried.append((wider.cost(state, worst), state))
        plain, faint = sorted(tried[: len(points)], key=itemgetter(0)), sorted(tried[len(points) :], key=itemgetter(0))
        likely = tried[:1] if recurring and plain[0] is not tried[0] else []  # explains most to first order, its line a bit off
        chosen = [_suited(wider, state, effect, others) for _, state in (*plain[:2], *faint[:1], *likely)]
        tried = [(wider.cost(state), state) for state in chosen]
        for cost, state in tried:
            parts = wider.with_slopes(origin.parts, state, places)
            for damping in (1e-3, 1.0):
                move, own = gauss_newton_step(parts, damping)
                trial = wider.with_own(wider.moved(state, move), own)
                new = wider.cost(trial)
                if new < cost:
                    cost, state = new, trial
                    break
            if cost < best[0]:
                best = (cost, state)
    if growing and all(record.kind == "ring-down" for record in fitter.records):
        base = origins[-1].state
        starts = [replace(base, model=base.model.with_effect(effect.name, **values)) for values in points]
        found = grown(wider, starts)
        best = min(best, (found.cost, found.state), key=itemgetter(0))
    elif best[0] > fit.cost * (1.0 - SMALL) and all(one.cut is None for one in fitter.records):
        further = wider.descend(best[1] if effect.name in best[1].model.effects else tried[0][1], iterations=CORNER)
        best = min(best, (further.cost, further.state), key=itemgetter(0))
    return best[0], best[1], wider


def _suited(fitter: Fitter, state: State, effect: Effect, places: Sequence[int]) -> State:
    """The state with what an effect changes of single records looked for anew in those at these places."""
    if "engagement" in effect.hooks:  # which pass seems to be the first; passes cut in part had made up for a slow entry
        return place_entries(fitter, state.with_whole_first_passes(), places)
    if any(one.each_record for one in effect.parameters):
        return turn_phases(fitter, state, places)
    blind = any(one.cut is not None and one.first_mark is None and one.flutes > 1 for one in fitter.records)
    if blind and "edge_position" in effect.hooks:  # which of the teeth was the first is open without marks
        return settle_passes(fitter, state, places=places)[0]
    return state


def gradual_entry(
    fitter: Fitter, effect: Effect, fit: WaveformFit, scanned: State, cost_limit: float = math.inf
) -> tuple[float, State, Fitter]:
    """(cost, state, fitter) after a short fit of an entry that is not sudden, from coefficients that no sudden entry has bent.

    Which pass is the first is nearly made up for by how gradual it is, and in all records alike: so they are placed in turn
    with soft fits, then moved together, pass by pass, as long as that helps; where they are far above `cost_limit`, not.
    """
    wider = extended(fitter, effect)
    soft = Fitter(fitter.engine, [softened(record) for record in fitter.records], wider.unknowns)
    points = starting_points(effect, fitter.records, fit)
    points.append({one.name: one.example if one.start is None else one.start for one in effect.parameters})
    own = tuple(replace(one, exit=seen.exit) for one, seen in zip(scanned.nuisances, fit.state.nuisances, strict=True))
    tried = []
    for values in points:
        state = replace(scanned, model=scanned.model.with_effect(effect.name, **values), nuisances=own)
        cost, found = math.inf, soft.descend(place_entries(soft, state), iterations=6)
        for _ in range(SETTLING):
            if found.cost > SETTLED * cost:
                break
            cost, found = found.cost, soft.descend(place_entries(soft, found.state), iterations=6)
        tried.append((wider.cost(found.state), found.state))
    best = wider.descend(min(tried, key=itemgetter(0))[1], iterations=CORNER)
    for passes in (-1, 1) if best.cost <= cost_limit else ():
        for _ in range(TOGETHER):
            moved = tuple(replace(one, entry=min(one.entry + passes, one.exit - 1)) for one in best.state.nuisances)
            trial = wider.descend(replace(best.state, nuisances=moved), iterations=CORNER)
            if not trial.cost < best.cost:
                break
            best = trial
    return best.cost, best.state, wider


def switched_on(fitter: Fitter, effect: Effect, origins: Sequence[Origin]) -> tuple[float, State, Fitter]:
    """(cost, state, fitter) after a short fit with an effect without parameters, from the origin that then explains most.

    What the model lacked it had made up for by all it has: no single step leads back.
    """
    states = [replace(one.state, model=one.state.model.with_effect(effect.name)) for one in origins]
    found = [fitter.descend(state, iterations=2 * CORNER) for state in states]
    best = min(found, key=lambda one: one.cost)
    return best.cost, best.state, fitter


def far_step(fitter: Fitter, effect: Effect, fit: WaveformFit, cost_limit: float = math.inf, nearer: bool = False
             ) -> tuple[float, State, Fitter]:  # fmt: skip
    """(cost, state, fitter) after a short fit that begins with the effect at its largest start.

    What shifts the record in time (a sensor's lag, a speed that falls), mark angle, speed and coefficients have made up
    for: near nothing the valley is flat and bent, and no single step leads along it. From far outside it is short.
    A law with a kink begins at whichever strength explains most: far too strong it holds everything stuck. It takes twice as
    long, and is given up where it would not come below the cost `cost_limit`; the others, slow at first, need all their steps.
    nearer: where the largest start of a smooth law does not come below the goal, a middle one is tried as well, with more
    steps: from too far, and where the valley is narrow, there are not enough of them.
    """
    effect = fitting_example(fitter, effect, fit)
    wider = extended(fitter, effect)
    worst = fit.worst(SCREENED)

    def begun(shares: Sequence[float]) -> State:
        points = starting_points(effect, fitter.records, fit, shares)
        states = [replace(fit.state, model=fit.state.model.with_effect(effect.name, **values)) for values in points]
        if not effect.smooth:
            states = [begun_otherwise(wider, state)[0] for state in states]
        return min(((wider.cost(state, worst), state) for state in states), key=itemgetter(0))[1]

    if not effect.smooth:
        found = wider.descend(begun(SHARES), iterations=2 * CORNER, cost_limit=cost_limit)
        return found.cost, found.state, wider
    found = wider.descend(begun(SHARES[-1:]), iterations=CORNER)
    if nearer and not found.cost < cost_limit:
        found = min(found, wider.descend(begun(SHARES[-2:-1]), iterations=CREEPING), key=lambda one: one.cost)
    return found.cost, found.state, wider
