"""Stand-ins for an engine: a decaying oscillation that follows the run's own conditions, and engines that misbehave."""

import os
import signal
import time

import numpy as np

from testbed.recording import CHANNEL_UNITS, Recording

FATAL_DEPTH = 2.2e-3  # `deadly` kills its process at this depth


def simulate(model, cut, sampling, *, channels=("displacement",), steps=None, catalogue=None):
    """A motion that depends on every condition of the run."""
    time = sampling.start + np.arange(sampling.count) / sampling.rate
    omega = model.structure.natural_frequency_rad
    motion = (1e-5 + cut.initial_displacement) * np.exp(-0.05 * omega * time) * np.cos(omega * time) \
        + cut.axial_depth_of_cut * 1e-2 * np.sin(cut.spindle_speed * time)
    passes = np.arange(cut.total_passes + 1) * cut.tooth_passing_period(model.cutter.flutes)
    units = {name: CHANNEL_UNITS[name] for name in channels}
    return Recording({name: motion for name in channels}, sampling.rate, units, "predicted",
                     marks=passes[::model.cutter.flutes], pass_times=passes)


def overflowing(model, cut, sampling, **options):
    """As `simulate`, but deep cuts cannot be computed."""
    if cut.axial_depth_of_cut > 2e-3:
        raise FloatingPointError("overflow")
    return simulate(model, cut, sampling, **options)


def deadly(model, cut, sampling, **options):
    """As `simulate`, but one depth takes the process with it."""
    if abs(cut.axial_depth_of_cut - FATAL_DEPTH) < 1e-9:
        os.kill(os.getpid(), signal.SIGKILL)
    return simulate(model, cut, sampling, **options)


class StopsAfter:
    """As `simulate`, but interrupted, as by Ctrl-C, after so many runs."""

    def __init__(self, runs):
        self.left = runs

    def __call__(self, model, cut, sampling, **options):
        if self.left == 0:
            raise KeyboardInterrupt
        self.left -= 1
        return simulate(model, cut, sampling, **options)


def unwanted(model, cut, sampling, **options):
    """An engine that must not be called."""
    raise AssertionError("computed again")


def slow(model, cut, sampling, **options):
    """As `simulate`, but every run takes five milliseconds."""
    time.sleep(0.005)
    return simulate(model, cut, sampling, **options)


def hanging(model, cut, sampling, **options):
    """As `simulate`, but one depth comes to no end."""
    if abs(cut.axial_depth_of_cut - FATAL_DEPTH) < 1e-9:
        time.sleep(1e6)
    return simulate(model, cut, sampling, **options)
