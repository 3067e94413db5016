"""What a tooth cuts where the spindle does not turn as stated: the feed a tooth as it was written, or what the table leaves it.

A feed a tooth that was worked out for the stated speed is another at the true one if the table travels at a speed of its own,
as a machine's does; a simulator may keep it. The file does not say which. Both are tried, and the data choose.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace

from testbed.analysis.fit.fit_state import State, WaveformFit
from testbed.analysis.fit.observed import Observed
from testbed.analysis.fit.solve import Goal, Move, Trial
from testbed.analysis.fit.waveform import Fitter

APART = 3e-4  # by which true over stated speed must differ among the cuts: what is common to all, the coefficients take
EXPLAINED = 0.5  # share of what is beyond the noise that must go: something else that is missing leans on the feed a little
SLIGHT = 1.1  # mean square residual up to which the fall of the cost alone decides
TRIED = 2  # iterations of a fit with the other feed


def propose(fitter: Fitter, fit: WaveformFit, goal: Goal) -> Iterator[Trial]:
    """The fit with the feed of every cut as the table leaves it at the true speed.

    Records that were taken so, with an effect missing that leant on it, and do about as well with the feed as it was written,
    get it back.
    """
    other = with_other_feed(fitter.records, fit.state)
    if other is None:
        return
    wider = fitter.on(other)
    tried = wider.fit(fit.state, iterations=TRIED)
    if any(record.feed_basis == "table" for record in fitter.records):
        yield Trial(wider, tried, -1)
    elif fit.variance <= SLIGHT or tried.variance - 1.0 <= EXPLAINED * (fit.variance - 1.0):
        yield Trial(wider, tried)


MOVE = Move(propose, worth=10.0, finish=25)


def with_other_feed(records: Sequence[Observed], state: State) -> list[Observed] | None:
    """The records as cut with a table that travels as the stated speed has it; where they were taken so, as they were written.

    None where nothing would tell the two apart, or records are weighed by more than their noise.
    """
    if any(record.weight is not None for record in records):
        return None
    if any(record.feed_basis == "table" for record in records):
        return [record if record.feed_basis != "table" else _fed(record, 1.0 / record.feed_ratio, "tooth")
                for record in records]
    ratios = [_slower(record) for record in records]
    known = [ratio / own.speed for ratio, own in zip(ratios, state.nuisances, strict=True) if ratio is not None]
    if len(known) < 2 or max(known) - min(known) < APART:
        return None
    return [record if ratio is None else _fed(record, ratio, "table") for record, ratio in zip(records, ratios, strict=True)]


def _slower(record: Observed) -> float | None:
    """Stated spindle speed over that of the record's period, of a cut whose feed was stated a tooth; None for others."""
    if record.cut is None or record.feed_basis == "travel":
        return None
    return record.cut.spindle_speed * record.period / (2.0 * math.pi)


def _fed(record: Observed, ratio: float, basis: str) -> Observed:
    """The record with that ratio of its feed a tooth."""
    assert record.cut is not None
    cut = replace(record.cut, feed_per_tooth=ratio * record.cut.feed_per_tooth)
    measured = None if record.measured is None else _fed(record.measured, ratio, basis)
    return replace(record, cut=cut, measured=measured, feed_basis=basis, feed_ratio=ratio)


def feed_note(records: Sequence[Observed], used: Sequence[Observed]) -> list[str]:
    """In words, that the table was taken to travel as stated, where in `used` it was and `records` do not say so."""
    if all(one.feed_basis == other.feed_basis for one, other in zip(records, used, strict=True)):
        return []
    return ["the spindle turned faster or slower than stated, and the table is taken to have travelled as stated all the same: "
            "that explains the records better than the feed a tooth as written; a feed in mm/min states it"]
