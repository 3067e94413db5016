"""Cuts that begin or end while a tooth is in the work: the part of the first and the last pass that is cut, record by record.

A workpiece that begins or ends at any place is met or left within a tooth's arc as often as that is wide. With whole passes
alone such a record has a first or a last kick of the wrong size, and no parameter of the machine can mend that.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from analysis.fit_state import State, WaveformFit
from analysis.nuisances import MISSING, Nuisances, end_moved
from analysis.observed import Observed
from analysis.pass_search import squares_of
from analysis.threads import threaded
from analysis.waveform import Fitter

MISFIT = 1.05  # mean squared residual, in noise, above which a record may have begun or ended within an arc,
KICK = 3.0  # or slow residual about its entry or exit over that of its other passes, as mean squares,
AROUND = 3  # passes after either,
SLOW = 8  # means of the residual a pass: a kick is slow, and in single samples the noise hides it
REACH = 2  # passes beside the entry and the exit that are tried
PARTS = 8  # into which the arc is divided first,
HALVINGS = 6  # and how often the best part is then halved
GAIN = 20.0  # in minus the log likelihood, and
SHARE = 0.6  # share of the record's excess that must go for a part of a pass to be believed
USUAL = 0.5  # share of the cuts above which a weak first pass is no chance of where the work begins, but a slow entry,
ALIKE = 0.15  # if what is missing of them is as much in all: standard deviation, in arcs
NEARLY_WHOLE = 0.1  # of a pass before the next begins, where a tooth is always in the work: so little is no slow entry
MEDIAN = 0.455  # median over mean of squares that are the noise's
FINER = 0.5  # gain from which a part that is believed is changed
ROUNDS = 5  # of looking for parts and fitting again


def with_parts_of_passes(fitter: Fitter, fit: WaveformFit) -> WaveformFit:
    """The fit with first and last passes cut in part, where that explains a record far better than whole ones do."""
    for _ in range(ROUNDS):
        found = _in_part(fitter, fit)
        if found == fit.state.nuisances:
            break
        better = fitter.fit(replace(fit.state, nuisances=found), iterations=25)
        if not better.cost < fit.cost:
            break
        fit = better
    return fit


def _in_part(fitter: Fitter, fit: WaveformFit) -> tuple[Nuisances, ...]:
    left = fit.mean_squares

    def one(index: int) -> Nuisances:
        record, own = fitter.records[index], fit.state.nuisances[index]
        if record.cut is None or record.starts_in_cut or record.forces_only:
            return own
        if _whole(fitter, own) and left[index] < MISFIT and not _kicked(record, own, fit.residuals[index], fit.state.angle):
            return own
        return _best_part(fitter, index, fit.state)

    found = threaded(one, range(len(fitter.records)))
    if fitter.gradual:
        return found
    late = [_missing(fitter.records[place], own, fit.state) for place, own in enumerate(found) if fitter.records[place].cut]
    weak = [share for share in late if share > 0.0]
    if len(weak) <= USUAL * len(late) or np.std(weak) > ALIKE:
        return found
    return tuple(replace(own, entry=before.entry, late_entry=0.0)
                 for own, before in zip(found, fit.state.nuisances, strict=True))  # fmt: skip


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


def _best_part(fitter: Fitter, index: int, state: State) -> Nuisances:
    """The nuisances of one record with the best of whole and part passes, near what its marks say of its clock."""
    record, now = fitter.records[index], state.nuisances[index]
    clocks = [now] if record.clock_error is None else [now, replace(now, angle=0.0, speed=1.0)]
    arc = state.share_in_arc(record.flutes)
    cost, best = min((_tried(fitter, index, state, clock, arc) for clock in clocks), key=lambda pair: pair[0])
    before = 0.5 * squares_of(fitter, index, state, [now])[0]
    floor = 0.5 * record.size
    return best if before - cost > (max(GAIN, SHARE * (before - floor)) if _whole(fitter, now) else FINER) else now


def _whole(fitter: Fitter, own: Nuisances) -> bool:
    """Whether no pass is cut in part; the first touch of a gradual entry is fitted with all else."""
    return (fitter.gradual or own.late_entry == 0.0) and own.early_exit == 0.0


def _tried(fitter: Fitter, index: int, state: State, own: Nuisances, arc: float) -> tuple[float, Nuisances]:
    """(cost, nuisances) of the best entry, then the best exit, then once more."""
    last = fitter.records[index].last_pass(state.angle, own)
    cost = np.inf
    for _ in range(2):
        before = own
        if not fitter.gradual:
            cost, own = _placed(fitter, index, state, own, arc, "entry")
        if own.exit > last + 1:
            break
        cost, own = _placed(fitter, index, state, own, arc, "exit")
        if own == before:
            break
    return cost, own


def _placed(fitter: Fitter, index: int, state: State, own: Nuisances, arc: float, end: str) -> tuple[float, Nuisances]:
    tried = [one for one in _places(own, arc, end) if one.entry < one.exit]
    costs = 0.5 * squares_of(fitter, index, state, tried)
    cost, best = float(costs.min()), tried[int(np.argmin(costs))]
    name = MISSING[end]
    step = 0.5 * arc / PARTS
    for _ in range(HALVINGS if getattr(best, name) > 0.0 or arc == 1.0 else 0):
        near = [one for by in (-step, step) if (one := end_moved(best, end, by)).entry < one.exit]
        costs = 0.5 * squares_of(fitter, index, state, near)
        if costs.min() < cost:
            cost, best = float(costs.min()), near[int(np.argmin(costs))]
        step *= 0.5
    return cost, best


def _places(own: Nuisances, arc: float, end: str) -> Iterator[Nuisances]:
    """Whole passes beside the one that begins or ends the cut, and each with a part of its arc."""
    for place in range(getattr(own, end) - REACH, getattr(own, end) + REACH + 1):
        for part in range(PARTS):
            missing = arc * part / PARTS if end == "entry" else 1.0 - arc * (PARTS - part) / PARTS
            yield own.with_fields(**{end: place, MISSING[end]: missing if part else 0.0})
