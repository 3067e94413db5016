"""Cuts that begin or end while a tooth is in the work: the part of the first and the last pass that is cut, record by record.

A workpiece that begins or ends at any place is met or left within a tooth's arc as often as that is wide. With whole passes
alone such a record has a first or a last kick of the wrong size, and no parameter of the machine can mend that. What the other
records lack bends the parameters that all share, so parts are tried boldly first, fitted with all else, and only then judged.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from analysis.fit_state import State, WaveformFit
from analysis.nuisances import Nuisances
from analysis.observed import Observed
from analysis.part_search import best_ends, best_whole, in_part_of, plainer, with_parts_known
from analysis.pass_search import squares_of
from analysis.threads import threaded
from analysis.waveform import Fitter

MISFIT = 1.05  # mean squared residual, in noise, above which a record may have begun or ended within an arc,
KICK = 3.0  # or slow residual about its entry or exit over that of its other passes, as mean squares,
AROUND = 3  # passes after either,
SLOW = 8  # means of the residual a pass: a kick is slow, and in single samples the noise hides it
MEDIAN = 0.455  # median over mean of squares that are the noise's
GAIN = 20.0  # in minus the log likelihood, for a part of a pass to be tried,
BOLD = 0.1  # and share of the record's excess that must go at fixed parameters;
HOPE = 0.3  # share of all records' excess that must then go for trying to go on,
SHARE = 0.6  # and of the record's that must be worth it in the end for the part to be believed
USUAL = 0.5  # share of the cuts above which a weak first pass is no chance of where the work begins, but a slow entry,
ALIKE = 0.15  # if what is missing of them is as much in all: standard deviation, in arcs
NEARLY_WHOLE = 0.1  # of a pass before the next begins, where a tooth is always in the work: so little is no slow entry
ROUNDS = 5  # of looking for parts and fitting again
STEPS = 12  # iterations of a fit between them


def with_parts_of_passes(fitter: Fitter, fit: WaveformFit) -> WaveformFit:
    """The fit with first and last passes cut in part, where that explains a record far better than whole ones do."""
    bold = _bold(fitter, fit)
    if bold is None:
        return fit
    for _ in range(2):  # without the parts that are not believed, those left may not be either
        kept = _believed(fitter, bold.state)
        same = kept == bold.state.nuisances
        if not any(in_part_of(fitter, own) for own in kept):
            return fit
        partly = with_parts_known(fitter, replace(bold.state, nuisances=kept))
        bold = partly.fit(replace(bold.state, nuisances=kept), iterations=25)
        if same:
            break
    found = fitter.fit(bold.state, iterations=STEPS)
    return found if found.cost < fit.cost else fit


def _bold(fitter: Fitter, fit: WaveformFit) -> WaveformFit | None:
    """The fit with every part of a pass that may be one, the ends fitted with all else; None where that is of little use."""
    found, excess = fit, _excess(fitter, fit)
    for _ in range(ROUNDS):
        nuisances = _in_part(fitter, found)
        if nuisances == found.state.nuisances:
            break
        state = replace(found.state, nuisances=nuisances)
        better = with_parts_known(fitter, state).fit(state, iterations=STEPS)
        if not better.cost < found.cost - GAIN or not _excess(fitter, better) < (1.0 - HOPE) * excess:
            break
        found = better
    return found if found is not fit else None


def _excess(fitter: Fitter, fit: WaveformFit) -> float:
    """What all records together cost beyond their noise."""
    return fit.cost - 0.5 * sum(record.size for record in fitter.records)


def _in_part(fitter: Fitter, fit: WaveformFit) -> tuple[Nuisances, ...]:
    """The nuisances of every record with the best of whole and part passes, near what its marks say of its clock."""
    left = fit.mean_squares

    def one(index: int) -> Nuisances:
        record, now = fitter.records[index], fit.state.nuisances[index]
        if record.cut is None or record.starts_in_cut or record.forces_only:
            return now
        if left[index] < MISFIT and not _kicked(record, now, fit.residuals[index], fit.state.angle):
            return now
        clocks = [now] if record.clock_error is None else [now, replace(now, angle=0.0, speed=1.0)]
        cost, best = best_ends(fitter, index, fit.state, clocks)
        before = 0.5 * float(squares_of(fitter, index, fit.state, [now])[0])
        return best if before - cost > max(GAIN, BOLD * (before - 0.5 * record.size)) else now

    return threaded(one, range(len(fitter.records)))


def _believed(fitter: Fitter, state: State) -> tuple[Nuisances, ...]:
    """The nuisances of every record, with whole passes where parts of them are worth too little or are a slow entry."""

    def one(index: int) -> Nuisances:
        record, own = fitter.records[index], state.nuisances[index]
        own = plainer(fitter, index, state, own) if in_part_of(fitter, own) else own
        if not in_part_of(fitter, own):
            return own
        cost = 0.5 * float(squares_of(fitter, index, state, [own])[0])
        before, whole = best_whole(fitter, index, state, own)
        return own if before - cost > max(GAIN, SHARE * (before - 0.5 * record.size)) else whole

    found = threaded(one, range(len(fitter.records)))
    return found if fitter.gradual or not _slow_entry(fitter, state, found) else _without_late_entries(fitter, state, found)


def _slow_entry(fitter: Fitter, state: State, found: Sequence[Nuisances]) -> bool:
    """Whether the first passes of most cuts lack as much, and that does not explain them: the sign of an entry that is slow."""
    cuts = [place for place, record in enumerate(fitter.records) if record.cut is not None]
    missing = {place: _missing(fitter.records[place], found[place], state) for place in cuts}
    weak = [place for place in cuts if missing[place] > 0.0]
    if len(weak) <= USUAL * len(cuts) or np.std([missing[place] for place in weak]) > ALIKE:
        return False
    left = fitter.residuals(replace(state, nuisances=tuple(found)), weak)
    return any(float(np.mean(rest**2)) > MISFIT or _kicked(fitter.records[place], found[place], rest, state.angle)
               for place, rest in zip(weak, left, strict=True))  # fmt: skip


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
    arc = state.share_in_arc(record.flutes)
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
