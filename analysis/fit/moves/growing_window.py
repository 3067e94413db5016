"""Cuts under a law by which the frequency depends on the amplitude, fitted on ever longer openings.

Under a strongly hardening flexure phases run apart within a transient: over a whole cut many valleys lie beside the deepest,
and from a rough fit the exit, too, seems to be where the model can no longer follow. Over its first third there is one.
"""

from __future__ import annotations

import inspect
from collections.abc import Iterable, Iterator
from dataclasses import replace

from testbed.analysis.fit.first_passes import first_nuisances
from testbed.analysis.fit.fit_state import State, WaveformFit
from testbed.analysis.fit.pass_search import place_exits
from testbed.analysis.fit.solve import Goal, Move, Trial, alternate_fit_and_passes
from testbed.analysis.fit.waveform import Fitter
from testbed.effect import Effect

GROWTH = (0.3, 0.6)  # shares of the cuts that are fitted before the whole of them
ASTRAY = 4.0  # mean square of the worst record, over the noise's, from which phases may have run apart


def bends_frequency(laws: Iterable[Effect]) -> bool:
    """Whether one of these is a smooth force of the displacement: then the frequency depends on the amplitude."""
    forces = [law.hooks["structure_force"] for law in laws if law.smooth and "structure_force" in law.hooks]
    return any("displacement" in inspect.signature(force).parameters for force in forces)


def propose(fitter: Fitter, fit: WaveformFit, goal: Goal) -> Iterator[Trial]:
    """The fit grown from its state, where a record stands out.

    A model that does not explain the openings will not explain the whole: it is given up there.
    """
    cut = any(record.cut is not None for record in fitter.records)
    if not cut or not bends_frequency(goal.laws) or fit.mean_squares.max() < ASTRAY:
        return
    state = fit.state
    for share in GROWTH:
        opened, begun = _opened(fitter, state, share)
        grown = alternate_fit_and_passes(opened, begun, rounds=2, iterations=15)
        if grown.mean_squares.max() > ASTRAY:
            return
        state = grown.state
    yield Trial(fitter, alternate_fit_and_passes(fitter, place_exits(fitter, state)))


MOVE = Move(propose, rescues=True)


def _opened(fitter: Fitter, state: State, share: float) -> tuple[Fitter, State]:
    """The fitter on the records up to this share of their cuts, and the state with no exit in them."""
    records, own = [], []
    for record, nuisances in zip(fitter.records, state.nuisances, strict=True):
        if record.cut is not None:
            seen = max(first_nuisances(record, state.angle + nuisances.angle).exit, nuisances.entry + 1)
            begin, end = (record.pass_start(place, state.angle, nuisances) for place in (nuisances.entry, seen))
            count = round((begin + share * (end - begin) - record.start) * record.rate)
            record = record.part(0, min(record.samples, max(count, 64)))
            nuisances = replace(nuisances, exit=record.last_pass(state.angle, nuisances) + 1)
        records.append(record)
        own.append(nuisances)
    return fitter.on(records), replace(state, nuisances=tuple(own))
