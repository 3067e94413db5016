"""What a structure does when the record of a cut begins, as its first samples show it."""

from __future__ import annotations

import math

import numpy as np

from analysis.fit.observed import Observed
from testbed.recording import DERIVATIVES

FEWEST = 6  # samples of a period from which displacement, velocity and offset can be read


def first_state(record: Observed, omega: float) -> tuple[float, float]:
    """Displacement (m) and velocity (m/s) at the first sample of a free vibration at `omega` (rad/s), which the record shows.

    Read from the first period, offset beside it. At rest where the record begins in the cut, or enters it before, or is too
    coarse. What seems to be a cut from the first sample on, and is none, is a structure that still swings.
    """
    entry = min((one.start for one in record.segments if one.kind != "idle" and one.start > record.start), default=math.inf)
    count = round(2 * math.pi / omega * record.rate)
    order = DERIVATIVES.get(record.channels[0])
    free = not record.starts_in_cut and count <= record.samples and record.start + count / record.rate <= entry
    if order is None or count < FEWEST or not free:
        return 0.0, 0.0
    phase = omega * np.arange(count) / record.rate + 0.5 * math.pi * order
    columns = np.stack([np.cos(phase), np.sin(phase), np.ones(count)], axis=1)
    even, odd, _ = np.linalg.lstsq(columns, record.data[0, :count] / omega**order, rcond=None)[0]
    return float(even), float(odd) * omega
