"""Entry and exit passes of a record as its segments show them: where their search begins."""

from __future__ import annotations

import math

import numpy as np

from testbed.analysis.fit.nuisances import Nuisances
from testbed.analysis.fit.observed import Observed
from testbed.analysis.records.free_decay import spectral_peak


class FirstPasses:
    """Where the cut of a record begins and ends as its segments show it, for any tooth angle."""

    def __init__(self, observed: Observed) -> None:
        self.observed = observed
        if observed.cut is None:
            return
        cutting = [s for s in observed.segments if s.kind in ("entry", "steady")]
        downs = [s.start for s in observed.segments if s.kind == "ring-down"]
        self.end = self.leaves = observed.start + observed.samples / observed.rate
        self.enters = min((s.start for s in cutting), default=observed.start)
        if downs:
            self.leaves = last_tooth(observed, downs[0])
        elif any(s.kind == "exit" or s.kind == "idle" and s.start > self.enters for s in observed.segments):
            self.leaves = max((s.stop for s in cutting), default=self.end)

    def at(self, angle: float) -> Nuisances:
        """Entry and exit passes at a given tooth angle (rad); the rest at its neutral value."""
        observed = self.observed
        if observed.cut is None:
            return Nuisances()
        pitch, zero = observed.period / observed.flutes, observed.pass_start(0, angle, Nuisances())
        entry = round((self.enters - zero) / pitch)
        if observed.starts_in_cut:
            entry = observed.first_simulated
        if self.leaves >= self.end - pitch:
            return Nuisances(entry=entry, exit=math.ceil((self.end - zero) / pitch) + observed.flutes + 1)
        return Nuisances(entry=entry, exit=math.ceil((self.leaves - zero) / pitch - 0.1))


def first_nuisances(observed: Observed, angle: float) -> Nuisances:
    """Entry and exit passes as the segments show them, at a given tooth angle; the rest at its neutral value."""
    return FirstPasses(observed).at(angle)


def last_tooth(observed: Observed, ring_down: float) -> float:
    """Time (s) at which a tooth last cut, near the segment found as ring-down.

    In free vibration of one mode x(t) + x(t + T/2) is the offset alone, whatever the amplitude; under the teeth it is not. So
    the last revolution in which that sum is as large as in steady cutting still cut, though the frequency may move with it.
    """
    first = round((ring_down - observed.start) * observed.rate)
    tail = observed.data[0, first:] - observed.data[0, first:].mean()
    if len(tail) < 64 or observed.channels[0].startswith("force") or observed.modes > 1:
        return ring_down
    half = round(0.5 / spectral_peak(tail))
    values = observed.data[0] - observed.drift @ (observed.drift.T @ observed.data[0])
    pair = values[half:] + values[:-half]
    turn = round(observed.period * observed.rate)
    count = len(pair) // turn
    level = np.array([np.ptp(pair[k * turn : (k + 1) * turn]) for k in range(count)])
    steady = [
        k
        for k in range(count)
        for s in observed.segments
        if s.kind == "steady" and s.start < observed.start + k * turn / observed.rate < s.stop - 2 * observed.period
    ]
    if len(steady) < 4 or 2 * half >= turn * 4:
        return ring_down
    usual, quiet = float(np.median(level[steady])), float(np.quantile(level, 0.1))  # the latter: noise alone
    cutting = np.flatnonzero(level > 0.5 * (usual + quiet))
    if len(cutting) == 0 or usual < max(8.0 * observed.noise[0], 2.0 * quiet):
        return ring_down
    return observed.start + (int(cutting[-1]) + 1.0) * turn / observed.rate + 0.5 * observed.period / observed.flutes
