"""What a tooth cuts where the spindle does not turn as stated: the feed a tooth as it was written, or what the table leaves it.

A feed a tooth that was worked out for the stated speed is another at the true one if the table travels at a speed of its own,
as a machine's does; a simulator may keep it. The file does not say which. Both are tried, and the data choose.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

from analysis.fit.fit_state import State, WaveformFit
from analysis.fit.observed import Observed
from analysis.fit.waveform import Fitter

APART = 3e-4  # by which true over stated speed must differ among the cuts: what is common to all, the coefficients take
WORTH = 10.0  # in mean square residuals, by which the cost must fall
TRIED = 2  # iterations of a fit with the other feed


def with_feed_found(fitter: Fitter, fit: WaveformFit) -> tuple[Fitter, WaveformFit]:
    """The fit with the feed of every cut as the table leaves it at the true speed, if that explains more; else as it was."""
    other = travelling(fitter.records, fit.state)
    if other is None:
        return fitter, fit
    wider = fitter.on(other)
    tried = wider.fit(fit.state, iterations=TRIED)
    if not fit.cost - tried.cost > WORTH * max(fit.variance, 1.0):
        return fitter, fit
    return wider, wider.fit(tried.state)


def travelling(records: Sequence[Observed], state: State) -> list[Observed] | None:
    """The records as cut with a table that travels as the stated speed has it; None where nothing would tell the two apart."""
    ratios = [_slower(record, own.speed) for record, own in zip(records, state.nuisances, strict=True)]
    known = [ratio for ratio in ratios if ratio is not None]
    if len(known) < 2 or max(known) - min(known) < APART:
        return None
    return [record if ratio is None else _fed(record, ratio) for record, ratio in zip(records, ratios, strict=True)]


def _slower(record: Observed, speed: float) -> float | None:
    """Stated over true spindle speed of a cut whose feed was stated a tooth; None for others."""
    if record.cut is None or record.table_feed:
        return None
    return record.cut.spindle_speed * record.period / (2.0 * math.pi * speed)


def _fed(record: Observed, ratio: float) -> Observed:
    """The record with that ratio of its feed a tooth."""
    assert record.cut is not None
    cut = replace(record.cut, feed_per_tooth=ratio * record.cut.feed_per_tooth)
    measured = None if record.measured is None else _fed(record.measured, ratio)
    return replace(record, cut=cut, measured=measured, table_feed=True)


def feed_note(records: Sequence[Observed], used: Sequence[Observed]) -> list[str]:
    """In words, that the table was taken to travel as stated, where in `used` it was and `records` do not say so."""
    if all(one.table_feed == other.table_feed for one, other in zip(records, used, strict=True)):
        return []
    return ["the spindle turned faster or slower than stated, and the table is taken to have travelled as stated all the same: "
            "that explains the records better than the feed a tooth as written; a feed in mm/min states it"]
