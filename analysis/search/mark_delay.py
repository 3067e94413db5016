"""Whether all records have the tachometer's mark at one angle to the teeth, as a shaft has it, and what it means if not.

The mark is fixed to the shaft. A channel that is recorded later than the other turns that angle by the delay times the speed;
anything else that turns it (a tool taken out, a sensor moved) does so by steps.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from scipy.special import chdtri

from testbed.analysis.fit.fit_state import WaveformFit
from testbed.analysis.fit.observed import Observed
from testbed.analysis.fit.waveform import Fitter
from testbed.analysis.search.diagnosis import COMPLETE

SEEN = 0.01  # rad by which the angle must differ between records to be told
SURE = 0.999  # probability that the marks' own scatter makes them differ by less
MOST = 0.1  # share of the angles' sum of squares that a delay may leave
FEWEST = 3  # records


def delay_note(records: Sequence[Observed], fitter: Fitter, fit: WaveformFit) -> list[str]:
    """A sentence where the records' angles between mark and tooth differ by more than their marks' scatter; else none.

    records: as they were read, with the scatter of their marks; the fit's own, of the same names, may doubt it.

    Of a model that leaves much more than noise the angles may have made up for what it lacks: of those nothing is said.
    """
    if fit.variance > COMPLETE**2:
        return []
    seen = {record.name: record.clock_error for record in records}
    rows = [
        (2.0 * math.pi * own.speed / record.period, own.angle, error[0])
        for record, own in zip(fitter.records, fit.state.nuisances, strict=True)
        if record.cut is not None and record.slots == 1 and record.clock_error is not None
        and (error := seen[record.name]) is not None
    ]
    if len(rows) < FEWEST:
        return []
    speed, angle, error = np.array(rows).T
    whole = _left(angle, error, np.ones((len(rows), 1)))[0]
    if np.ptp(angle) < SEEN or whole <= chdtri(len(rows) - 1, 1.0 - SURE):
        return []
    left, (_, delay) = _left(angle, error, np.column_stack([np.ones_like(speed), speed]))
    if np.ptp(speed) < 0.02 * speed.mean() or left > MOST * whole:
        return [f"the angle between mark and tooth differs from record to record, by {math.degrees(np.ptp(angle)):.2g} deg in "
                "all: was the tool taken out, or a sensor moved? Each record has an angle of its own in the fit"]
    late = "the motion comes {} after the marks" if delay > 0 else "the marks come {} after the motion"
    return [f"{late.format(f'{abs(delay) * 1e3:.3g} ms')}: the angle between mark and tooth grows with the speed, as one "
            "channel's delay against the other makes it; each record has an angle of its own in the fit"]


def _left(angle: np.ndarray, error: np.ndarray, columns: np.ndarray) -> tuple[float, np.ndarray]:
    """(sum of squares over the errors' left of the angles by these columns, the coefficients)."""
    found = np.linalg.lstsq(columns / error[:, None], angle / error, rcond=None)[0]
    return float(np.sum(((angle - columns @ found) / error) ** 2)), found
