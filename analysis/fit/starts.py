"""Where a waveform fit starts: the structure as free decays show it, cutting coefficients and tooth angle by a scan."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from testbed.analysis.fit.first_passes import FirstPasses, first_nuisances
from testbed.analysis.fit.first_state import begun_as_seen
from testbed.analysis.fit.fit_state import FreeParameter, State, WaveformFit
from testbed.analysis.fit.free_parameters import free_parameters
from testbed.analysis.fit.moves import BASE
from testbed.analysis.fit.nuisances import Nuisances
from testbed.analysis.fit.observed import Observed
from testbed.analysis.fit.pass_search import entered, place_entries, place_exits, recently_entered
from testbed.analysis.fit.prediction import Engine, predict
from testbed.analysis.fit.record_restart import angles_tried
from testbed.analysis.fit.solve import PLAIN, Goal, alternate_fit_and_passes, solve
from testbed.analysis.fit.structure_start import decay_start, structure_start
from testbed.analysis.fit.waveform import Fitter
from testbed.machine import Model
from testbed.system.threads import threaded

COEFFICIENTS = (1.0, 0.85, 1.2, 0.7, 1.5, 0.5, 2.0)  # times those believed; the first of equals stays: what nothing shows
OPENING = 8192  # samples of an excited record that the first fits see
GLANCE = 8  # iterations of a fit that only tells which models are worth another
SOFT = 0.1  # of a record's own size: what the first rounds forgive, so that no record rules them alone


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


def with_exits(fitter: Fitter, state: State) -> State:
    """A state found on the records' openings with the exits of the whole records."""
    known = []
    for record, nuisances in zip(fitter.records, state.nuisances, strict=True):
        seen = first_nuisances(record, state.angle + nuisances.angle)
        known.append(replace(nuisances, exit=max(seen.exit, nuisances.entry + 1)))
    return place_exits(fitter, replace(state, nuisances=tuple(known)))


def base_fit(engine: Engine, records: Sequence[Observed], model: Model, *, free: Sequence[FreeParameter] | None = None,
             goal: Goal = PLAIN, as_believed: bool = False) -> tuple[Fitter, WaveformFit]:  # fmt: skip
    """The believed model refitted to all records, from several starts, with every nuisance.

    as_believed: its structure begins as the model has it, not as free decays show it.
    """
    started = model if as_believed else structure_start(records, model)
    free = list(free) if free is not None else free_parameters(records, started)
    best = opening_fit(engine, records, started, free)
    soft = Fitter(engine, [softened(record) for record in records], free)
    best = alternate_fit_and_passes(soft, with_exits(soft, best.state), rounds=2, iterations=12)
    fitter = Fitter(engine, entered(records, best.state), free)
    begun = recently_entered(fitter, place_exits(fitter, best.state))
    return solve(fitter, alternate_fit_and_passes(fitter, begun, cost_limit=goal.cost_limit), BASE, goal)
