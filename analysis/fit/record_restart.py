"""The course of one record's cut looked for anew at fixed machine parameters: passes, tooth angle, ends within an arc."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from testbed.analysis.fit.first_passes import first_nuisances
from testbed.analysis.fit.fit_state import State
from testbed.analysis.fit.held_out import own_refit
from testbed.analysis.fit.nuisances import Nuisances, end_moved_in_arc
from testbed.analysis.fit.observed import Observed
from testbed.analysis.fit.part_search import best_ends, plainer
from testbed.analysis.fit.pass_search import recently_entered, settle_passes, squares_of, swung_entry
from testbed.analysis.fit.waveform import Fitter
from testbed.machine import Model

ANGLES = 24  # of a tooth pitch that are tried, or more: so many to
PER_SWING = 4  # each swing of the structure in it, since a kick a swing too early or too late explains nearly as much
MOST_SWINGS = 40  # up to which they are counted
LACKING = (0.0, 0.3, 0.6)  # of the first arc, that a cut begun afresh may lack
TURNED = 5  # of those places, from which a record begun afresh is fitted
MISFIT = 1.05  # mean square residual, in noise, above which the cut may have begun or ended within an arc,
SWUNG = 0.5  # share of what is left of a record that a swing at a recent entry must take,
GAIN = 20.0  # and what ends must save in minus the log likelihood


def own_course(
    fitter: Fitter, place: int, state: State, forgets: Callable[[Fitter, State], bool] = lambda single, state: False
) -> State:
    """The state of one record alone, its course as it was fitted or as its segments show it, whichever explains more.

    Without a tachometer its tooth angle is looked for all round, too; where whole passes do not explain it, its ends
    within an arc. forgets: whether the motion of one record alone is such that no end explains it; asked before that.
    """
    record, own = fitter.records[place], state.nuisances[0]
    single = fitter.of_records([place])
    if record.cut is None:
        return state
    fresh = replace(first_nuisances(record, state.angle + own.angle), angle=own.angle)
    begun = [replace(fresh, speed=speed) for speed in dict.fromkeys((own.speed, fresh.speed))]
    if record.first_mark is None:
        begun.append(begun_afresh(single, state, LACKING))
    tried = [own_refit(single, state, [0], rounds=4)]  # never worse than it was
    for one in begun:
        seen, _ = settle_passes(single, recently_entered(single, replace(state, nuisances=(one,))), reach=2)
        tried.append(own_refit(single, seen, [0], rounds=4))
    found = min(tried, key=single.cost)
    if record.starts_in_cut and not record.forces_only:
        found = _with_swing(single, found)
        tried.append(found)
    if record.forces_only or single.cost(found) <= 0.5 * MISFIT * record.size or forgets(single, found):
        return found
    ends = min((_with_ends(single, one) for one in tried), key=single.cost)
    return ends if single.cost(ends) < single.cost(found) - GAIN else found


def _with_swing(single: Fitter, state: State) -> State:
    """One record's state with a recent entry at which the structure swung, where only that explains most of what is left."""
    noise = 0.5 * single.records[0].size
    excess = single.cost(state) - noise
    if excess <= (MISFIT - 1.0) * noise:
        return state
    swung = own_refit(single, swung_entry(single, state), [0], rounds=4)
    return swung if single.cost(swung) - noise < SWUNG * excess else state


def _with_ends(single: Fitter, state: State) -> State:
    """One record's state with both ends of its cut at their best places, within an arc where whole passes explain less."""
    for _ in range(2):  # with the first end right, the other and the angle move on
        state = replace(state, nuisances=(best_ends(single, 0, state, [state.nuisances[0]])[1],))
    return replace(state, nuisances=(plainer(single, 0, state, state.nuisances[0]),))


def angles_tried(record: Observed, model: Model) -> int:
    """How many tooth angles of a pitch are tried, so that every valley between two swings of the structure holds some."""
    if record.forces_only:
        return ANGLES
    swings = model.structure.frequency_range[1] * record.period / record.flutes
    return max(ANGLES, math.ceil(PER_SWING * min(swings, MOST_SWINGS)))


def begun_afresh(single: Fitter, state: State, lacking: Sequence[float] = (0.0,)) -> Nuisances:
    """One record's passes as its segments show them; without a tachometer its tooth angle, too, is looked for all round.

    By that angle alone, a fit under a wrong frequency goes to where the strongest harmonic agrees, a part of a pass away.
    lacking: shares of the first arc that it may lack then.
    """
    record, own = single.records[0], state.nuisances[0]
    if record.cut is None or record.first_mark is not None:
        return replace(first_nuisances(record, state.angle + own.angle), angle=own.angle, speed=own.speed)
    arc, count, tried = state.share_in_arc(record), angles_tried(record, state.model), []
    shares = (0.0,) if record.starts_in_cut or single.gradual else lacking
    for turn in (part * 2 * math.pi / record.flutes / count for part in range(count)):
        whole = replace(first_nuisances(record, state.angle + own.angle + turn), angle=own.angle + turn, speed=own.speed)
        tried += [end_moved_in_arc(whole, "entry", share, arc) for share in shares]
    best = np.argsort(squares_of(single, 0, state, tried))[:TURNED]
    refitted = [own_refit(single, replace(state, nuisances=(tried[int(place)],)), [0], rounds=4) for place in best]
    return min(refitted, key=single.cost).nuisances[0]
