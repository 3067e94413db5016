"""Cuts whose motion never repeats while that of the others does: no model may foretell them, not even the right one.

Where a strong law beyond the linear machine makes a cut chaotic, two motions that begin a nanometre apart have little in common
a hundred turns later, and a fit to such a record takes every parameter astray. The search is then made on the others. What it
finds is held against the irregular ones: it must foretell them, or foretell itself that nobody could.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.interpolate import make_interp_spline

from testbed.analysis.fit.first_passes import first_nuisances
from testbed.analysis.fit.fit_state import State, WaveformFit
from testbed.analysis.fit.observed import Observed
from testbed.analysis.fit.prediction import predict
from testbed.analysis.fit.record_restart import own_course
from testbed.analysis.fit.solve import alternate_fit_and_passes
from testbed.analysis.fit.waveform import Fitter
from testbed.analysis.search.outlier_records import still_loud

BEYOND_NOISE = 10.0  # change from one revolution to the next at a cut's end, in units of the noise, from which it is irregular,
BEYOND_OTHERS = 5.0  # times that of the median record,
OF_THE_MOTION = 0.2  # and as a share of the motion: what dies away, drifts or swings a little is not that
LAST = 1 / 3  # share of the cut that is looked at: its transient has died away
FEWEST_TURNS = 6  # that are looked at all the same
FEWEST = 4  # records that must repeat
NUDGE = 1e-6  # of the motion, by which a second one begins elsewhere
ENTERED = 3  # revolutions after which the entry is over
PARTED = 30.0  # times as far apart as at the end of the entry, from which two motions part
FORGOTTEN = 0.1  # of the motion: so far apart, a cut has forgotten where it began, and no other beginning explains it


def irregular(records: Sequence[Observed]) -> list[int]:
    """Places of the cuts that do not repeat from revolution to revolution where most do; none where too few repeat."""
    changes = [_change(record) for record in records]
    known = [one[0] for one in changes if one is not None]
    if not known:
        return []
    least = max(BEYOND_NOISE, BEYOND_OTHERS * float(np.median(known)))
    found = [place for place, one in enumerate(changes) if one is not None and one[0] > least and one[1] > OF_THE_MOTION]
    return found if len(records) - len(found) >= FEWEST else []


def _change(record: Observed) -> tuple[float, float] | None:
    """Change of the motion over a revolution at the end of the cut: over that of the noise, over the motion; None: unknown."""
    steady = [part for part in record.segments if part.kind == "steady"]
    if record.cut is None or record.motion is None or not steady:
        return None
    stop, turn = steady[-1].stop - record.period, record.period
    first = max(steady[-1].start + turn, stop - max(LAST * (stop - steady[-1].start), FEWEST_TURNS * turn))
    time = record.start + np.arange(record.samples) / record.rate
    seen = time[(time >= first) & (time <= stop)]
    if seen.size < FEWEST_TURNS * turn * record.rate / 2:
        return None
    place = record.motion[0]
    motion = make_interp_spline(time, record.data[place], k=3)
    change = float(np.std(motion(seen) - motion(seen - turn)))
    return change / (2.0**0.5 * float(record.noise[place])), change / max(float(np.std(record.data[place])), 1e-300)


@dataclass(frozen=True)
class Followed:
    """All records with a fit to some of them. strange: places of those it does not follow; parting: of those it says part."""

    fitter: Fitter
    state: State
    strange: tuple[int, ...]
    parting: tuple[int, ...]

    def fitted(self) -> WaveformFit:
        """All records fitted from there."""
        return alternate_fit_and_passes(self.fitter, self.state, rounds=2)


def followed(fitter: Fitter, state: State, records: Sequence[Observed], left_out: Sequence[int]) -> Followed:
    """How the machine that was fitted to all records but those `left_out` does on these.

    fitter, state: of the others, in their order. Of a record left out, its own unknowns are fitted, no others.
    """
    given = iter(zip(fitter.records, state.nuisances, strict=True))
    wider, own, strange, parting = [], [], [], []
    for place, record in enumerate(records):
        if place not in left_out:
            seen, nuisances = next(given)
            wider.append(seen)
            own.append(nuisances)
            continue
        single = fitter.on([record])
        begun = replace(state, nuisances=(first_nuisances(record, state.angle),))
        course = own_course(single, 0, begun, _forgets)
        wider.append(record)
        own.append(course.nuisances[0])
        if still_loud(single, 0, course):
            strange.append(place)
            if parts(single, course):
                parting.append(place)
    return Followed(fitter.on(wider), replace(state, nuisances=tuple(own)), tuple(strange), tuple(parting))


def _forgets(single: Fitter, state: State) -> bool:
    """Whether the one record's motion, which is not explained, forgets where it began."""
    if not still_loud(single, 0, state):
        return False
    apart, size = _apart(single, state)
    return apart.size > 0 and bool(apart.max() > FORGOTTEN * size.max())


def parts(single: Fitter, state: State) -> bool:
    """Whether two motions of the one record's cut that begin almost at the same place part, and more than the motion grows."""
    apart, size = _apart(single, state)
    if apart.size <= ENTERED:
        return False
    grown = max(1.0, float(size[ENTERED:].max() / size[ENTERED]))
    return bool(apart[ENTERED:].max() > PARTED * apart[:ENTERED + 1].max() * grown)


def _apart(single: Fitter, state: State) -> tuple[np.ndarray, np.ndarray]:
    """(how far two motions that begin almost at the same place are apart, size of the motion), both (revolutions,)."""
    record, own = single.records[0], state.nuisances[0]
    moved = replace(own, displacement=own.displacement + NUDGE * record.motion_size)
    motion, other = predict(single.engine, record, [(state.model, state.angle, one) for one in (own, moved)])
    swing = motion - motion.mean(axis=1, keepdims=True)
    return _by_revolution(record, state, other - motion), _by_revolution(record, state, swing)


def _by_revolution(record: Observed, state: State, values: np.ndarray) -> np.ndarray:
    """Largest value of the first channel of motion in every revolution of the cut."""
    own = state.nuisances[0]
    begin, end = (record.pass_start(place, state.angle, own) for place in (own.entry, own.exit))
    first = max(0, round((begin - record.start) * record.rate))
    last = min(record.samples, round((end - record.start) * record.rate))
    turn = max(1, round(record.period * record.rate))
    place = record.motion[0] if record.motion is not None else 0
    return np.array([np.abs(values[place, at:at + turn]).max() for at in range(first, last - turn + 1, turn)])
