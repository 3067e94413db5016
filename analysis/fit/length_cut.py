"""The length a tool has cut before each record, where nobody wrote it down: afresh in every cut, or from record to record.

What grows with the length cut (wear) goes on where the last record ended if the tool stayed the same and the campaign lists
its cuts in their order; with a fresh edge every time, it begins anew. Both are tried, and the data choose.

Where between two teeth a cut begins or ends, no record shows: the work comes to the cutter before a tooth is there, and stays
after the last has left. Every length is uncertain by that, and all are the same way where all cuts are made the same way.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from testbed.analysis.fit.first_passes import first_nuisances
from testbed.analysis.fit.fit_state import State, WaveformFit
from testbed.analysis.fit.least_squares import covariance
from testbed.analysis.fit.nuisances import Nuisances
from testbed.analysis.fit.observed import Observed
from testbed.analysis.fit.waveform import Fitter
from testbed.effect import Effect, arguments_of
from testbed.system.threads import threaded

LENGTH = "length_cut"
LONGER = 1e-5  # m: a length by which slopes are taken


def asks_length(names: Iterable[str], catalogue: Mapping[str, Effect]) -> bool:
    """Whether any of these effects depends on the length cut."""
    effects = [catalogue[name] for name in names if name in catalogue]
    return any(LENGTH in arguments_of(effect, hook) for effect in effects for hook in effect.hooks)


def carried_on(records: Sequence[Observed]) -> list[Observed] | None:
    """The records as cut one after the other by one tool, in their order; None where a length is stated or but one cut is.

    A cut is as long as its feed from the entry to the exit that its segments show, to a few passes.
    """
    cuts = [record.cut for record in records if record.cut is not None]
    if len(cuts) < 2 or any(cut.length_cut_before for cut in cuts):
        return None
    return summed(records, [passes_cut(record, first_nuisances(record, 0.0), 0.0, 0.0) for record in records])


def passes_cut(record: Observed, own: Nuisances, angle: float, idle: float) -> float:
    """For how many passes a record cuts: from where in an arc it begins to where in one it ends.

    Where either is in the time of no tooth, `idle` (of a pass), it is as likely anywhere there: in its middle.
    """
    if record.cut is None:
        return 0.0
    begins = own.entry + (own.late_entry or -0.5 * idle)
    ends = own.exit - (own.early_exit or 0.5 * idle)
    return max(0.0, min(ends, record.last_pass(angle, own) + 1) - max(begins, record.first_pass))


def summed(records: Sequence[Observed], passes: Sequence[float]) -> list[Observed]:
    """The records with the lengths of all before, of which each cuts for so many passes."""
    found, before = [], 0.0
    for record, count in zip(records, passes, strict=True):
        if record.cut is None:
            found.append(record)
            continue
        found.append(replace(record, cut=replace(record.cut, length_cut_before=before), length_summed=True))
        before += count * record.cut.feed_per_tooth
    return found


def moved_by_lengths(fitter: Fitter, fit: WaveformFit) -> np.ndarray:
    """By how much the shared unknowns move (ways, unknowns), each in its unit, where cuts are longer by a standard deviation.

    First all of them, as where they are made alike, then each of them alone, by which every record after it changes.
    """
    places = [index for index, record in enumerate(fitter.records) if record.length_summed]
    if not places:
        return np.zeros((0, len(fit.names)))
    unseen = _unseen(fitter.records, fit.state)

    def pulled(index: int) -> np.ndarray:
        own, part = fit.state.nuisances[index], fit.parts[index]
        longer = replace(own, length=own.length + LONGER)
        rests = fitter.residuals_of(index, [(fit.state.model, fit.state.angle, one) for one in (own, longer)])
        return part.shared.T @ part.without_own(rests[1] - rests[0]) / LONGER

    by_length = np.zeros((len(unseen), len(fit.names)))
    by_length[places] = np.reshape(threaded(pulled, places), (len(places), len(fit.names)))
    later = np.cumsum(by_length[::-1], axis=0)[::-1]  # of a record and all after it
    alone = np.array(unseen[:-1])[:, None] * later[1:]
    ways = np.vstack([alone.sum(axis=0), alone])
    return -(covariance(fit.parts, fitter.steps) @ (ways / fitter.steps).T).T


def _unseen(records: Sequence[Observed], state: State) -> list[float]:
    """Standard deviation (m) of every cut's length, by what of its ends no tooth shows; 0 of other records."""
    found = []
    for record, own in zip(records, state.nuisances, strict=True):
        idle, ends = 1.0 - state.share_in_arc(record), 2 - len(own.ends_in_arc())
        found.append(0.0 if record.cut is None else idle * math.sqrt(ends / 12.0) * record.cut.feed_per_tooth)
    return found


def _before(record: Observed) -> float:
    return 0.0 if record.cut is None else record.cut.length_cut_before


def length_note(records: Sequence[Observed], used: Sequence[Observed]) -> list[str]:
    """In words, that records were taken as cut by one tool, where `used` were and `records` do not say so."""
    if all(_before(one) == _before(other) for one, other in zip(records, used, strict=True)):
        return []
    longest = max(map(_before, used))
    return ["the tool is taken to have cut the records one after the other, as the campaign lists them "
            f"({longest * 1e3:.4g} mm before the last): that explains them better than a fresh edge in each; "
            "length_cut_before of a record states it"]
