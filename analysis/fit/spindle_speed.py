"""Whose speed a record is predicted at: that which its marks show, or that which the model itself says."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

import numpy as np

from testbed.analysis.fit.observed import Observed
from testbed.analysis.records.spindle_clock import turns_of
from testbed.effect import Effect


def rules_the_speed(names: Iterable[str], catalogue: Mapping[str, Effect]) -> bool:
    """Whether an effect of these names says how the spindle's speed varies."""
    return any("speed" in catalogue[name].hooks for name in names)


def at_modelled_speed(
    records: Sequence[Observed], names: Iterable[str], catalogue: Mapping[str, Effect]
) -> list[Observed]:
    """The records as a model with the effects of these names predicts them.

    Where it says itself how the speed varies, what unsteady marks say of that is left out: it would count twice.
    """
    return [record.at_constant_speed() for record in records] if rules_the_speed(names, catalogue) else list(records)


def speed_swing(records: Sequence[Observed]) -> float:
    """Half the range of the relative speed that unsteady marks show, the largest of the records'; 0 where all are steady."""
    return max((_swing(record.marks) for record in records if record.marks is not None), default=0.0)


def _swing(marks: np.ndarray) -> float:
    periods = np.diff(marks) / np.maximum(np.diff(turns_of(marks)), 1.0)
    low, high = np.quantile(periods, [0.02, 0.98])
    return 0.5 * float(high - low) / float(np.median(periods))
