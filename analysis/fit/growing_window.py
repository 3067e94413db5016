"""Cuts under a law by which the frequency depends on the amplitude, fitted on ever longer openings.

Under a strongly hardening flexure phases run apart within a transient: over a whole cut many valleys lie beside the deepest,
and from a rough fit the exit, too, seems to be where the model can no longer follow. Over its first third there is one.
"""

from __future__ import annotations

import inspect
from collections.abc import Iterable, Mapping
from dataclasses import replace

from testbed.analysis.fit.first_passes import first_nuisances
from testbed.analysis.fit.fit_state import State, WaveformFit
from testbed.analysis.fit.pass_search import place_exits
from testbed.analysis.fit.starts import alternate_fit_and_passes
from testbed.analysis.fit.waveform import Fitter
from testbed.effect import Effect

GROWTH = (0.3, 0.6)  # shares of the cuts that are fitted before the whole of them
ASTRAY = 4.0  # mean square of the worst record, over the noise's, from which phases may have run apart
BETTER = 0.999  # times the cost that the fit grown may have to be taken


def bends_frequency(names: Iterable[str], catalogue: Mapping[str, Effect]) -> bool:
    """Whether one of these effects is a smooth force of the displacement: then the frequency depends on the amplitude."""
    laws = [catalogue[name].hooks["structure_force"] for name in names
            if catalogue[name].smooth and "structure_force" in catalogue[name].hooks]
    return any("displacement" in inspect.signature(law).parameters for law in laws)


def grown_cuts(fitter: Fitter, fit: WaveformFit) -> WaveformFit:
    """The fit, or the one grown from its state where that explains the records better; itself where no record stands out.

    A model that does not explain the openings will not explain the whole: it is given up there.
    """
    if fit.mean_squares.max() < ASTRAY or all(record.cut is None for record in fitter.records):
        return fit
    state = fit.state
    for share in GROWTH:
        opened, begun = _opened(fitter, state, share)
        grown = alternate_fit_and_passes(opened, begun, rounds=2, iterations=15)
        if grown.mean_squares.max() > ASTRAY:
            return fit
        state = grown.state
    found = alternate_fit_and_passes(fitter, place_exits(fitter, state))
    return found if found.cost < BETTER * fit.cost else fit


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
