"""Samples at the jumps of a cutting force, which no fit should believe.

A tooth that enters or leaves the work lets the force jump, and with it an acceleration. A sample at the very jump shows one
side or the other by a hair of timing, or something between, as the sensor's bandwidth has it; each would weigh as much as all
the noise of a pass. Next to the jump both sides are told all the same.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from testbed.analysis.fit.fit_state import State, WaveformFit
from testbed.analysis.fit.nuisances import Nuisances
from testbed.analysis.fit.observed import Observed
from testbed.analysis.fit.prediction import from_first_tooth
from testbed.analysis.fit.solve import Goal, Move, Trial
from testbed.analysis.fit.waveform import Fitter

BESIDE = 1.5  # samples to either side of a jump that are left out
FEWEST = 0.5  # share of a record's samples that must be left; else all are believed


def propose(fitter: Fitter, fit: WaveformFit, goal: Goal) -> Iterator[Trial]:
    """The fit without the samples at the jumps where it places them; none where they are those left out so far."""
    records = [_without_jumps(record, fit.state, own) for record, own in zip(fitter.records, fit.state.nuisances, strict=True)]
    if any(new is not old for new, old in zip(records, fitter.records, strict=True)):
        wider = fitter.on(records)
        yield Trial(wider, wider.fit(fit.state))


MOVE = Move(propose, repeats=3, incomparable=True)  # asked again, since it may place them elsewhere then


def _without_jumps(record: Observed, state: State, own: Nuisances) -> Observed:
    """The record with the samples believed that are not at a jump; itself where they are the ones believed so far."""
    if record.cut is None or not any(sensor is None or sensor.order == 2 for sensor in record.sensors):
        return record
    mask = np.ones(record.samples, dtype=bool) if record.filled is None else ~record.filled
    places = (_jumps(record, state, own) - record.start) * record.rate
    nearest = np.rint(places).astype(int)
    for beside in range(-int(BESIDE) - 1, int(BESIDE) + 2):
        sample = nearest + beside
        left_out = (np.abs(sample - places) < BESIDE) & (sample >= 0) & (sample < record.samples)
        mask[sample[left_out]] = False
    if mask.mean() < FEWEST:
        return record
    same = mask.all() if record.mask is None else np.array_equal(mask, record.mask)
    return record if same else replace(record, mask=mask)


def _jumps(record: Observed, state: State, own: Nuisances) -> np.ndarray:
    """Times (s) at which a tooth enters the work or leaves it, or is in it when the cut begins or ends."""
    model, late = from_first_tooth(state.model, own)
    cut, sampling = record.timeline(state.angle, own, late)
    durations = record.pass_durations(cut, sampling)
    if durations is None:
        durations = np.full(cut.total_passes, cut.tooth_passing_period(record.flutes))
    starts = record.start - sampling.start + np.concatenate([[0.0], np.cumsum(durations)])
    passes = slice(cut.idle_passes, cut.idle_passes + cut.passes)
    entries = starts[:-1][passes]
    if not len(entries):  # a fit astray: the cut lies beyond the record
        return entries
    first, last = durations[passes][[0, -1]]
    pitches = model.cutter.pitch_angles if model.cutter is not None else ()
    if pitches:
        ahead = np.cumsum((0.0, *pitches[1:])) * record.flutes / (2.0 * np.pi) - np.arange(record.flutes)
        entries = entries + np.resize(ahead, len(entries)) * durations[passes]
    begun, ended = entries[0] + own.late_entry * first, entries[-1] + (1.0 - own.early_exit) * last
    ends = [time for time, missing in ((begun, own.late_entry), (ended, own.early_exit)) if missing > 0.0]
    return np.concatenate([entries, entries + state.passes_in_arc(record) * durations[passes], ends])
