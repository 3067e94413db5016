"""A very long record is fitted at every n-th of its samples.

The model is compared at the moments of the samples that are kept, so nothing has to be filtered: the noise of a sample is the
same, and only fewer of them count. What a fit holds in memory, and its time, then grow no further with the sampling rate.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

ENOUGH = 2**18  # samples, 20 s at 12.8 kHz
PER_SWING = 40  # samples in a period of the structure, and in a tooth pass, that stay
SLOWEST = 5000.0  # Hz: a rate that stays, whatever the model says: what it lacks may be faster


def every_nth(samples: int, rate: float, natural_frequency: float, tooth_passing: float = 0.0) -> int:
    """Which samples of a record at `rate` are fitted: all (1) up to ENOUGH, else every so manieth; frequencies in Hz."""
    spare = rate / max(SLOWEST, PER_SWING * natural_frequency, PER_SWING * tooth_passing)
    return max(1, min(-(-samples // ENOUGH), int(spare)))


def thinned_note(used: Sequence[Any]) -> list[str]:
    """A line on the records (testbed.analysis.fit.observed.Observed) of which a fit takes every n-th sample only."""
    told = [f"{one.name} (every {one.every}th sample, {one.rate:.4g} Hz)" for one in used if one.every > 1]
    more = f" and {len(told) - 3} more" if len(told) > 3 else ""
    return [f"very long, so not every sample is fitted: {', '.join(told[:3])}{more}; with from and to a shorter part is fitted "
            "whole"] if told else []
