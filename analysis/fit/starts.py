"""Where a waveform fit starts: the structure as free decays show it, cutting coefficients and tooth angle by a scan."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from testbed.analysis.fit.entry_history import with_front_found
from testbed.analysis.fit.entry_passes import entries_together
from testbed.analysis.fit.first_passes import FirstPasses, first_nuisances
from testbed.analysis.fit.first_state import begun_as_seen
from testbed.analysis.fit.fit_state import FreeParameter, State, WaveformFit
from testbed.analysis.fit.fractional_passes import with_parts_of_passes
from testbed.analysis.fit.free_parameters import free_parameters
from testbed.analysis.fit.held_out import own_refit
from testbed.analysis.fit.nuisances import Nuisances
from testbed.analysis.fit.observed import Observed
from testbed.analysis.fit.pass_count import cut_elsewhere, recounted
from testbed.analysis.fit.pass_search import (
    begun_otherwise,
    entered,
    place_entries,
    place_exits,
    recently_entered,
    settle_passes,
)
from testbed.analysis.fit.prediction import Engine, predict
from testbed.analysis.fit.record_restart import angles_tried, begun_afresh, own_course
from testbed.analysis.fit.structure_start import decay_start, structure_start
from testbed.analysis.fit.waveform import Fitter
from testbed.analysis.threads import threaded
from testbed.machine import Model, base_parameter

FURTHER = 60  # iterations more of a fit that has not converged
COEFFICIENTS = (0.5, 0.7, 0.85, 1.0, 1.2, 1.5, 2.0)
OPENING = 8192  # samples of an excited record that the first fits see
GLANCE = 8  # iterations of a fit that only tells which models are worth another
SOFT = 0.1  # of a record's own size: what the first rounds forgive, so that no record rules them alone
SAME = 1e-4  # share of the cost by which two fits of one valley may differ
SOUND = 1.2  # mean square residual, in noise, up to which a record counts as explained
AGREED = 1.1  # the same of half of them, fitted alone,
LOST = 2.0  # where another has more than this: a law that is a little wrong leaves a little more of all
LATE = 4.0  # standard errors of a mean square, by which a record that starts in its cut is off
FEWEST = 3  # such records, that the course of others may be found again by them
UNEVEN = 1.5  # mean square residual of the worst record over the median's, from which the worst are doubted


def at_a_bound(free: Sequence[FreeParameter], model: Model) -> bool:
    """Whether a parameter of the machine itself ended where no machine is: a fit made up for something by it."""
    return any(base_parameter(one.path) and model.value(one.path) in one.bounds for one in free)


def softened(record: Observed) -> Observed:
    """The record with a share of its own size added to its noise."""
    size = record.data.std(axis=1)
    return replace(record, noise=np.hypot(record.noise, SOFT * size), weight=None)


def _scan(engine: Engine, passes: Sequence[FirstPasses], model: Model) -> tuple[float, float, tuple[Nuisances, ...]]:
    """(cost, mark angle, nuisances) of the best tooth angle, with entry and exit as the segments show them."""
    cuts = [first for first in passes if first.observed.cut is not None]
    teeth = max([first.observed.flutes for first in cuts], default=1)
    alike = 1 if model.cutter is not None and model.cutter.pitch_angles else teeth  # what of a turn looks like all of it
    count = max(angles_tried(first.observed, model) for first in cuts) * teeth // alike
    angles = np.arange(count) * (2 * math.pi / alike) / count
    seen = {id(first): begun_as_seen(first.observed, Nuisances(), model.structure) for first in cuts}

    def begun(first: FirstPasses, angle: float) -> Nuisances:
        one = seen[id(first)]
        return replace(first.at(angle), displacement=one.displacement, velocity=one.velocity, states=one.states)

    def one(first: FirstPasses) -> np.ndarray:
        record = first.observed
        variants = [
            (model, angle, begun(first, angle))
            if record.first_mark is not None
            else (model, 0.0, replace(begun(first, angle), angle=angle))
            for angle in angles
        ]
        rest = record.project(record.data - np.nan_to_num(predict(engine, record, variants), nan=1.0))
        rest = np.clip(rest, -1e6, 1e6)
        return np.log(np.mean(rest**2, axis=(1, 2))) * record.count

    costs = dict(zip([id(first.observed) for first in cuts], threaded(one, cuts), strict=True))
    shared = [costs[id(first.observed)] for first in cuts if first.observed.first_mark is not None]
    best = int(np.argmin(sum(shared))) if shared else 0
    total, nuisances = 0.0, []
    for first in passes:
        record = first.observed
        if record.cut is None:
            nuisances.append(Nuisances())
            continue
        place = best if record.first_mark is not None else int(np.argmin(costs[id(record)]))
        total += float(costs[id(record)][place])
        own = 0.0 if record.first_mark is not None else float(angles[place])
        nuisances.append(replace(begun(first, float(angles[place])), angle=own))
    return total, float(angles[best]) if shared else 0.0, tuple(nuisances)


def scan_starts(engine: Engine, records: Sequence[Observed], model: Model, count: int = 3,
                factors: Sequence[float] = COEFFICIENTS) -> list[State]:  # fmt: skip
    """The best few starts over tooth angle and cutting coefficients, which are multiplied by the factors."""
    if model.cutting is None or all(record.cut is None for record in records):
        return [State(model, 0.0, tuple(Nuisances() for _ in records))]
    found, passes = [], [FirstPasses(record) for record in records]
    for factor in factors:
        trial = model.with_values(
            {
                "tangential_coefficient": factor * model.cutting.tangential_coefficient,
                "normal_coefficient": factor * model.cutting.normal_coefficient,
            }
        )
        cost, angle, nuisances = _scan(engine, passes, trial)
        found.append((cost, State(trial, angle, nuisances)))
    return [state for _, state in sorted(found, key=lambda pair: pair[0])[:count]]


def alternate_fit_and_passes(
    fitter: Fitter, state: State, *, rounds: int = 4, iterations: int = 40, cost_limit: float = math.inf
) -> WaveformFit:
    """Fit and put entry and exit passes right in turn, until they stay, or it would not come to the cost that is the goal."""
    state, _ = settle_passes(fitter, state)
    fit = fitter.fit(state, iterations=iterations, cost_limit=cost_limit)
    for _ in range(rounds - 1):
        if fit.cost > cost_limit:
            break
        state, moved = settle_passes(fitter, fit.state)
        if not moved:
            break
        fit = fitter.fit(state, iterations=iterations, cost_limit=cost_limit)
    return fit


def anchored_states(engine: Engine, records: Sequence[Observed], model: Model, unknowns: Sequence[FreeParameter]
                    ) -> tuple[State, State]:  # fmt: skip
    """The best of a scan with the coefficients' ratio as believed; and, from there, the cut fitted softly.

    Frequency and damping are held at what the small end of the free decays shows. unknowns: of the fit that this is a start of.

    Where the structure is not linear, a free fit bends its frequency to the large amplitudes and never comes back; this
    start keeps it.
    """
    started = decay_start(records, model)
    soft = [softened(record) for record in records]
    free = [one for one in unknowns if one.path.endswith("_coefficient")]
    fitter = Fitter(engine, soft, free)
    scanned = scan_starts(engine, soft, started, 1)[0]
    return scanned, alternate_fit_and_passes(fitter, scanned, rounds=2, iterations=8).state


def glance(engine: Engine, records: Sequence[Observed], model: Model, free: Sequence[FreeParameter]) -> float:
    """The cost of a short fit to the openings from the coefficients as believed: a fifth of the work of `opening_fit`."""
    opening = fitter_of_openings(engine, records, free)
    start = scan_starts(engine, opening.records, model, 1, (1.0,))[0]
    return opening.descend(place_entries(opening, start), iterations=GLANCE).cost


def noise_of_openings(records: Sequence[Observed]) -> float:
    """What the noise alone costs in a soft fit to the openings."""
    pairs = [(record.opening().loudest(OPENING), record.noise) for record in records]
    return 0.5 * sum(part.count * float(np.sum((noise / softened(part).noise) ** 2)) for part, noise in pairs)


def fitter_of_openings(engine: Engine, records: Sequence[Observed], free: Sequence[FreeParameter]) -> Fitter:
    """A soft fit to the openings of all records."""
    return Fitter(engine, [softened(record.opening().loudest(OPENING)) for record in records], free)


def opening_fit(engine: Engine, records: Sequence[Observed], model: Model, free: Sequence[FreeParameter], *,
                cost_limit: float = math.inf) -> WaveformFit:  # fmt: skip
    """The model fitted softly to the openings of all records, from several starts: a fifth of the work of `base_fit`.

    cost_limit: the cost above which the fit is of no use, and is given up.
    """
    opening = fitter_of_openings(engine, records, free)
    starts = scan_starts(engine, opening.records, model)
    tries = [alternate_fit_and_passes(opening, state, rounds=3, iterations=12, cost_limit=cost_limit) for state in starts]
    best = min(tries, key=lambda fit: fit.cost)
    if best.cost > cost_limit:
        return best
    return alternate_fit_and_passes(opening, place_entries(opening, best.state), rounds=2, iterations=12)


def base_fit(
    engine: Engine,
    records: Sequence[Observed],
    model: Model,
    *,
    free: Sequence[FreeParameter] | None = None,
    cost_limit: float = math.inf,
    patient: bool = False,
    known: float = math.nan,
) -> tuple[Fitter, WaveformFit]:
    """The believed model refitted to all records, from several starts, with every nuisance.

    cost_limit: the cost above which the fit is of no use and given up; `patient`: once the better half of the records has been
    tried alone. known: see `arrived`.
    """
    started = structure_start(records, model)
    free = list(free) if free is not None else free_parameters(records, started)
    best = opening_fit(engine, records, started, free)
    soft = Fitter(engine, [softened(record) for record in records], free)
    best = alternate_fit_and_passes(soft, with_exits(soft, best.state), rounds=2, iterations=12)
    fitter = Fitter(engine, entered(records, best.state), free)
    fit = alternate_fit_and_passes(fitter, recently_entered(fitter, place_exits(fitter, best.state)), cost_limit=cost_limit)
    if fit.cost > cost_limit and not patient or arrived(fit, known):
        return fitter, fit
    fit = from_the_best_half(fitter, fit, cost_limit=cost_limit)
    if fit.cost > cost_limit:
        return fitter, fit
    fitter, fit = with_fronts_and_courses(fitter, rested(fitter, fit))
    return cut_elsewhere(fitter, with_the_lost_found(fitter, fit))


def arrived(fit: WaveformFit, known: float) -> bool:
    """Whether a fit has come to the cost of one that is known, and so to its valley: what follows was done there."""
    return abs(fit.cost - known) <= SAME * known


def with_fronts_and_courses(fitter: Fitter, fit: WaveformFit) -> tuple[Fitter, WaveformFit]:
    """The fit with what the first teeth meet and the courses of the cuts looked for: either may hide the other."""
    fitter, fit = with_front_found(fitter, fit)
    fit = with_courses(fitter, fit)
    other, again = with_front_found(fitter, fit)
    return (fitter, fit) if other is fitter else (other, with_courses(other, again))


def with_courses(fitter: Fitter, fit: WaveformFit) -> WaveformFit:
    """The fit with the course of every cut looked for again: entries of all together, numbers of passes, parts of passes."""
    return with_parts_of_passes(fitter, recounted(fitter, entries_together(fitter, fit)))


def rested(fitter: Fitter, fit: WaveformFit, *, rounds: int = 4, iterations: int = 40) -> WaveformFit:
    """The fit with cuts begun otherwise, at rest or as their first samples show, where that explains them better at once."""
    state, moved = begun_otherwise(fitter, fit.state)
    return alternate_fit_and_passes(fitter, state, rounds=rounds, iterations=iterations) if moved else fit


def to_its_end(fitter: Fitter, fit: WaveformFit) -> WaveformFit:
    """The fit, gone on with where it has not converged: along a narrow valley values are yet far off."""
    return fit if fit.converged else fitter.fit(fit.state, iterations=FURTHER)


def with_exits(fitter: Fitter, state: State) -> State:
    """A state found on the records' openings with the exits of the whole records."""
    known = []
    for record, nuisances in zip(fitter.records, state.nuisances, strict=True):
        seen = first_nuisances(record, state.angle + nuisances.angle)
        known.append(replace(nuisances, exit=max(seen.exit, nuisances.entry + 1)))
    return place_exits(fitter, replace(state, nuisances=tuple(known)))


def from_the_best_half(fitter: Fitter, fit: WaveformFit, tries: int = 2, cost_limit: float = math.inf) -> WaveformFit:
    """The fit started again from the better half of the records, where a few records stand out; kept if it costs less.

    A record whose entry or exit is a pass wrong drags the coefficients to where that pass seems right; without it they
    are free, and its passes are looked for again. cost_limit: see `alternate_fit_and_passes`.
    """
    for _ in range(tries):
        ratio = fit.mean_squares
        if len(ratio) < 4 or ratio.max() < UNEVEN * float(np.median(ratio)):
            return fit
        kept = _better_half(ratio)
        alone = _fitted_alone(fitter, fit, kept).state
        begun = _begun_there(fit, kept, alone, lambda place, state: begun_afresh(fitter.of_records([place]), state))
        state, _ = settle_passes(fitter, begun, reach=2)
        state = own_refit(fitter, state, [place for place in range(len(ratio)) if place not in kept])
        again = alternate_fit_and_passes(fitter, state, cost_limit=cost_limit)
        if not again.cost < 0.999 * fit.cost:
            return fit
        fit = again
    return fit


def with_the_lost_found(fitter: Fitter, fit: WaveformFit) -> WaveformFit:
    """The fit with those records begun afresh that stand out while others agree down to their noise; kept if it costs less.

    Near its stability limit a cut that begins or ends within an arc, fitted with whole passes, loses its course, and bends what
    all share; at the machine that the others show, its course is found. Those others are the half or more that agree in the
    fit, or the better half, if they agree once they are fitted alone.
    """
    left = fit.mean_squares
    kept = [int(place) for place in np.flatnonzero(left <= SOUND) if not _late_and_off(fitter.records[place], left, int(place))]
    if len(kept) == len(left):
        return fit
    most = SOUND
    if len(kept) < len(left) / 2.0 and left.max() > LOST:
        kept, most = _better_half(left), AGREED
    if len(kept) < max(FEWEST, len(left) / 2.0):
        return fit
    alone = _fitted_alone(fitter, fit, kept, most)
    if not alone.mean_squares.max() <= most:
        return fit
    begun = _begun_there(fit, kept, alone.state, lambda place, state: own_course(fitter, place, state).nuisances[0])
    again = alternate_fit_and_passes(fitter, begun)
    return with_courses(fitter, again) if again.cost < 0.999 * fit.cost else fit


def _late_and_off(record: Observed, left: np.ndarray, place: int) -> bool:
    """Whether a record that starts in its cut leaves more of itself than the median record does, beyond chance."""
    return record.starts_in_cut and left[place] > float(np.median(left)) * (1.0 + LATE * math.sqrt(2.0 / record.size))


def _better_half(left: np.ndarray) -> list[int]:
    """Places of the better half of the records, in their order, by the mean squares that are left of all."""
    return sorted(int(place) for place in np.argsort(left)[: (len(left) + 1) // 2])


def _fitted_alone(fitter: Fitter, fit: WaveformFit, kept: Sequence[int], worth: float = math.inf) -> WaveformFit:
    """The fit of some records alone, from where the joint one ended; given up where their mean square stays above `worth`."""
    alone = fitter.of_records(kept)
    cost_limit = 0.5 * worth * sum(record.size for record in alone.records)
    return alternate_fit_and_passes(alone, fit.state.of_records(kept), rounds=2, iterations=12, cost_limit=cost_limit)


def _begun_there(fit: WaveformFit, kept: Sequence[int], found: State, begin: Callable[[int, State], Nuisances]) -> State:
    """The state of some records fitted alone, each other begun at their machine: begin(place, its state alone) -> nuisances."""
    nuisances = [found.nuisances[kept.index(place)] if place in kept else begin(place, replace(found, nuisances=(own,)))
                 for place, own in enumerate(fit.state.nuisances)]
    return replace(found, nuisances=tuple(nuisances))
