"""What the first teeth of a cut meet while the structure still rings: a straight front, or what that swing would have left.

A workpiece's front is as it was cut before. A simulator that solves a delay equation has the chip of the first pass measured
from where the idling tool swung one pitch before. The file does not say which; both are tried, and the data choose.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace

from testbed.analysis.fit.fit_state import State, WaveformFit
from testbed.analysis.fit.nuisances import Nuisances
from testbed.analysis.fit.observed import Observed
from testbed.analysis.fit.solve import Goal, Move, Trial
from testbed.analysis.fit.waveform import Fitter

SEEN = 0.1  # standard deviations of the noise: a smaller swing at the entry tells nothing of the front
NEARLY_ALL = 0.99  # of an arc
TRIED = 2  # iterations of a fit with the other front


def propose(fitter: Fitter, fit: WaveformFit, goal: Goal) -> Iterator[Trial]:
    """The fit with the front of every cut as the swing before it would have left it; or, where it is so, straight again.

    A straight front is the plainer, but not one before which a pass lacks all of its arc.
    """
    other = with_other_front(fitter.records, fit.state)
    if other is not None:
        wider, whole = fitter.on(other), _with_whole_passes(other, fit.state)
        plainer = _swung(fitter.records) or whole != fit.state
        yield Trial(wider, wider.fit(whole, iterations=TRIED), -1 if plainer else 1)


MOVE = Move(propose, worth=10.0, finish=25)


def _with_whole_passes(records: Sequence[Observed], state: State) -> State:
    """The state with first passes that lack all of their arc left out: their idle teeth leave what the swing does, too."""
    nuisances = [
        own.with_fields(entry=own.entry + 1, late_entry=0.0)
        if own.late_entry > NEARLY_ALL * state.share_in_arc(record) else own
        for record, own in zip(records, state.nuisances, strict=True)
    ]
    return replace(state, nuisances=tuple(nuisances))


def with_other_front(records: Sequence[Observed], state: State) -> list[Observed] | None:
    """The records with the other front; None where none rings at its entry, or they are weighed by more than their noise."""
    if any(record.weight is not None for record in records):
        return None
    if _swung(records):
        return [replace(record, swung_front=False) for record in records]
    if not any(_rings(record, own, state) for record, own in zip(records, state.nuisances, strict=True)):
        return None
    return [record if record.cut is None else replace(record, swung_front=True) for record in records]


def _swung(records: Sequence[Observed]) -> bool:
    return any(record.swung_front for record in records)


def _rings(record: Observed, own: Nuisances, state: State) -> bool:
    """Whether the swing with which a record begins is larger than its noise when the first tooth enters."""
    sensor = record.sensors[0]
    if record.cut is None or record.starts_in_cut or sensor is None:
        return False
    waits, begun = record.pass_start(own.entry, state.angle, own) - record.start, dict(own.states)
    first, swings = [(own.displacement, own.velocity)], []
    first += [(begun.get(position, 0.0), begun.get(rate, 0.0)) for position, rate in record.further_states]
    for mode, (displacement, velocity) in zip(state.model.structure.modes, first, strict=True):
        omega = mode.natural_frequency_rad
        swing = math.hypot(displacement, velocity / omega) * math.exp(-mode.damping_ratio * omega * max(waits, 0.0))
        swings.append(swing * omega**sensor.order)
    return max(swings) > SEEN * float(record.noise[0])


def front_note(records: Sequence[Observed], used: Sequence[Observed]) -> list[str]:
    """In words, that the fronts were taken as swung, where in `used` they were."""
    if not _swung(used) or _swung(records):
        return []
    return ["the structure still rings as the first teeth enter, and they are taken to meet what that swing would have left, "
            "as in a delay equation with its history: that explains the records better than a straight front"]
