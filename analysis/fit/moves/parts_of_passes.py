"""Cuts that begin or end while a tooth is in the work: the part of the first and the last pass that is cut, record by record.

A workpiece that begins or ends at any place is met or left within a tooth's arc as often as that is wide. With whole passes
alone such a record has a first or a last kick of the wrong size, and no parameter of the machine can mend that. What the other
records lack bends the parameters that all share, so parts are tried boldly first, fitted with all else, and only then judged.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import partial
from typing import NamedTuple

import numpy as np

from testbed.analysis.fit.fit_state import State, WaveformFit
from testbed.analysis.fit.nuisances import Nuisances, end_whole
from testbed.analysis.fit.observed import Observed
from testbed.analysis.fit.part_search import best_ends, best_moved, best_whole, plainer, reachable
from testbed.analysis.fit.pass_search import squares_of
from testbed.analysis.fit.solve import Goal, Move, Trial
from testbed.analysis.fit.waveform import Fitter
from testbed.system.threads import threaded

MISFIT = 1.05  # mean squared residual, in noise, above which a record may have begun or ended within an arc,
KICK = 3.0  # or slow residual about its entry or exit over that of its other passes, as mean squares,
AROUND = 3  # passes after either,
SLOW = 8  # means of the residual a pass: a kick is slow, and in single samples the noise hides it
MEDIAN = 0.455  # median over mean of squares that are the noise's
NEARLY = 1.2  # and of all, up to which only the ends of a few may be wrong,
GAIN = 20.0  # in minus the log likelihood, for a part of a pass to be tried,
BOLD = 0.1  # and share of the record's excess that must go at fixed parameters;
SURELY = 0.5  # share of that which moves of the ends must reach to first order for the places to be looked for;
FIRST = 3  # records that are asked before all others
HOPE = 0.3  # share of all records' excess that must then go for trying to go on,
SHARE = 0.6  # and of the record's that must be worth it in the end for the part to be believed
USUAL = 0.5  # share of the cuts above which a weak first pass is no chance of where the work begins, but a slow entry,
ALIKE = 0.15  # if what is missing of them is as much in all: standard deviation, in arcs,
EXPLAINED = 0.05  # and leaves more than this share of their excess
NEARLY_WHOLE = 0.1  # of a pass before the next begins, where a tooth is always in the work: so little is no slow entry
MOVES = 4  # of the end of one cut, with all unknowns following,
MOVED = 0.02  # and share of all records' excess that must go with each: where much is left, small gains are no end
ROUNDS = 5  # of looking for parts and fitting again
TURNS = (-0.16, 0.16)  # rad: where the tooth's angle, and with it the coefficients, may have a valley of their own
DOUBT = 1.15  # of the noise's mean square, that it may truly be, as its samples differ from one to the next
STEPS = 12  # iterations of a fit between them
LAST = 60  # and of the last ones: the coefficients creep along with how much is missing of most cuts


def propose(fitter: Fitter, fit: WaveformFit, goal: Goal) -> Iterator[Trial]:
    """The fit with first and last passes cut in part, where that explains a record far better than whole ones do.

    Parts that made up for what has been added since have led into a valley of their own: whole passes are begun from, too.
    """
    begun = [fit, fitter.fit(_with_whole_passes(fit.state), iterations=LAST)] if _misled(fitter, fit) else [fit]
    bold = [one for each in begun if (one := _bold(fitter, each)) is not None]
    found = [one for each in bold if (one := as_believed(fitter, each)) is not None]
    yield from (Trial(fitter, one) for one in sorted(found, key=lambda one: one.cost)[:1])


MOVE = Move(propose)


def _misled(fitter: Fitter, fit: WaveformFit) -> bool:
    """Whether a fit that is nearly right, but not of every record, has parts of passes."""
    if fit.mean_squares.max() < MISFIT or fit.variance >= NEARLY:
        return False
    return any(own.ends_in_arc(fitter.gradual) for own in fit.state.nuisances)


def _with_whole_passes(state: State) -> State:
    """The state with every end of a cut at the whole pass next to it."""
    entered = [end_whole(own, "entry", round(own.late_entry)) for own in state.nuisances]
    whole = [end_whole(own, "exit", round(own.early_exit)) for own in entered]
    return replace(state, nuisances=tuple(one if one.entry < one.exit else own
                                          for one, own in zip(whole, state.nuisances, strict=True)))


def as_believed(fitter: Fitter, bold: WaveformFit) -> WaveformFit | None:
    """The fit with those of its parts of passes that are worth it, all else refitted; None where none is."""
    for _ in range(2):  # without the parts that are not believed, those left may not be either
        kept = _believed(fitter, bold.state)
        same = kept == bold.state.nuisances
        if not any(own.ends_in_arc(fitter.gradual) for own in kept):
            return None
        bold = fitter.fit(replace(bold.state, nuisances=kept), iterations=LAST)
        if same:
            break
    return bold


def _bold(fitter: Fitter, fit: WaveformFit) -> WaveformFit | None:
    """The fit with every part of a pass that may be one, the ends fitted with all else; None where that is of little use."""
    found, excess = fit, _excess(fitter, fit)
    for _ in range(ROUNDS):
        nuisances = _in_part(fitter, found)
        if nuisances == found.state.nuisances:
            break
        state = replace(found.state, nuisances=nuisances)
        better = fitter.fit(state, iterations=STEPS)
        if not better.cost < found.cost - GAIN or not _excess(fitter, better) < (1.0 - HOPE) * excess:
            break
        found = better
    if found is fit:
        return None
    return _moved(fitter, min((found, *_turned(fitter, found.state)), key=lambda one: one.cost))


def _turned(fitter: Fitter, state: State) -> list[WaveformFit]:
    """Fits from other tooth angles: whole passes had bent the shared one, and the ratio of the coefficients with it."""
    if not fitter.fits_angle:
        return []
    return [fitter.fit(replace(state, angle=state.angle + by), iterations=STEPS) for by in TURNS]


def _moved(fitter: Fitter, fit: WaveformFit) -> WaveformFit:
    """The fit with the end of one cut after another elsewhere, all unknowns following, as long as that costs less.

    What follows is foretold by slopes. On a fit's way they may lead astray, so a move that fails is asked again at its end.
    """
    cuts = [place for place, one in enumerate(fitter.records) if not (one.cut is None or one.forces_only)]
    for _ in range(MOVES):
        tried = threaded(partial(best_moved, fitter, fit), cuts)
        place, (cost, own) = min(zip(cuts, tried, strict=True), key=lambda pair: pair[1][0])
        cost_limit = fit.cost - max(GAIN, MOVED * _excess(fitter, fit))
        if not cost < cost_limit:
            break
        moved = fitter.fit(fit.state.with_record(place, own), iterations=STEPS)
        if not moved.cost < cost_limit and fit.converged:
            break
        fit = moved if moved.cost < cost_limit else fitter.fit(fit.state, iterations=LAST, near=fit)
    return fit


def _excess(fitter: Fitter, fit: WaveformFit) -> float:
    """What all records together cost beyond their noise."""
    return fit.cost - 0.5 * sum(record.size for record in fitter.records)


def _in_part(fitter: Fitter, fit: WaveformFit) -> tuple[Nuisances, ...]:
    """The nuisances of every record with the best of whole and part passes, near what its marks say of its clock.

    The records explained worst are asked first: where no part helps them, none of the others is asked.
    """
    left, usual = fit.mean_squares, any(own.ends_in_arc(fitter.gradual) for own in fit.state.nuisances)

    def doubted(index: int) -> bool:
        record, now = fitter.records[index], fit.state.nuisances[index]
        if record.cut is None or record.forces_only:
            return False
        return usual or left[index] >= MISFIT or _kicked(record, now, fit.residuals[index], fit.state.angle)

    def one(index: int) -> Nuisances:
        record, now = fitter.records[index], fit.state.nuisances[index]
        clocks = [now] if record.clock_error is None else [now, replace(now, angle=0.0, speed=1.0)]
        before = 0.5 * float(squares_of(fitter, index, fit.state, [now])[0])
        worth = max(GAIN, BOLD * (before - 0.5 * record.size))
        if reachable(fitter, fit, index) < SURELY * worth:
            return now
        cost, best = best_ends(fitter, index, fit.state, clocks)
        return best if before - cost > worth else now

    asked = [index for index in fit.worst(len(fitter.records)) if doubted(index)]
    found = list(fit.state.nuisances)
    for some in (asked[:FIRST], asked[FIRST:]):
        for index, own in zip(some, threaded(one, some), strict=True):
            found[index] = own
        if tuple(found) == fit.state.nuisances:
            break
    return tuple(found)


class _Judged(NamedTuple):
    """One record: its nuisances with parts as far as they are believed, and what its best whole passes cost more than noise."""

    own: Nuisances
    excess: float
    left: float


def _believed(fitter: Fitter, state: State) -> tuple[Nuisances, ...]:
    """The nuisances of every record, with whole passes where parts of them are worth too little or are a slow entry."""

    def one(index: int) -> _Judged:
        record, own = fitter.records[index], state.nuisances[index]
        own = plainer(fitter, index, state, own) if own.ends_in_arc(fitter.gradual) else own
        if not own.ends_in_arc(fitter.gradual):
            return _Judged(own, 0.0, 0.0)
        floor = 0.5 * record.size * _noise(record, fitter.residual_of(index, state))
        cost = 0.5 * float(squares_of(fitter, index, state, [own])[0])
        before, whole = best_whole(fitter, index, state, own)
        worth = before - cost > max(GAIN, SHARE * (before - floor))
        return _Judged(own if worth else whole, before - floor, cost - floor)

    judged = threaded(one, range(len(fitter.records)))
    found = tuple(each.own for each in judged)
    return found if fitter.gradual or not _slow_entry(fitter, state, judged) else _without_late_entries(fitter, state, found)


def _noise(record: Observed, residual: np.ndarray) -> float:
    """Mean square of the noise in a residual, in units of what it was taken for: that is off by some percent."""
    steps = np.diff(record.on_samples(residual), axis=1)
    return min(max(0.5 * float(np.mean(steps**2)), 1.0), DOUBT)


def _slow_entry(fitter: Fitter, state: State, judged: Sequence[_Judged]) -> bool:
    """Whether the first passes of most cuts lack as much, and that does not explain them: the sign of an entry that is slow."""
    cuts = [place for place, record in enumerate(fitter.records) if record.cut is not None]
    missing = {place: _missing(fitter.records[place], judged[place].own, state) for place in cuts}
    weak = [place for place in cuts if missing[place] > 0.0]
    if len(weak) <= USUAL * len(cuts) or np.std([missing[place] for place in weak]) > ALIKE:
        return False
    return sum(max(judged[place].left, 0.0) for place in weak) > EXPLAINED * sum(judged[place].excess for place in weak)


def _without_late_entries(fitter: Fitter, state: State, found: Sequence[Nuisances]) -> tuple[Nuisances, ...]:
    def one(index: int) -> Nuisances:
        own = found[index]
        if own.late_entry == 0.0:
            return own
        early = own.with_fields(late_entry=0.0)
        tried = [one for one in (early, early.with_fields(entry=own.entry + 1)) if one.entry < one.exit]
        return tried[int(np.argmin(squares_of(fitter, index, state, tried)))]

    return threaded(one, range(len(found)))


def _missing(record: Observed, own: Nuisances, state: State) -> float:
    """Share of the arc that the first pass lacks; 0 where the cut begins just before a pass, among teeth on their way out."""
    arc = state.share_in_arc(record)
    return 0.0 if arc == 1.0 and own.late_entry > 1.0 - NEARLY_WHOLE else own.late_entry / arc


def _kicked(record: Observed, own: Nuisances, residual: np.ndarray, angle: float) -> bool:
    """Whether what is left of a record is far larger just after its entry or its exit than elsewhere."""
    length = record.period / record.flutes / own.speed
    count = max(1, round(record.rate * length / SLOW))
    rest = record.on_samples(residual)
    means = rest[:, : rest.shape[1] // count * count].reshape(rest.shape[0], -1, count).mean(axis=2)
    size, around = (means**2).mean(axis=0), AROUND * SLOW
    usual = float(np.median(size)) / MEDIAN
    for place in (own.entry, own.exit):
        first = int((record.pass_start(place, angle, own) - record.start) * record.rate / count)
        part = size[max(first, 0) : max(first + around, 0)]
        if part.size and float(part.mean()) > KICK * usual:
            return True
    return False
