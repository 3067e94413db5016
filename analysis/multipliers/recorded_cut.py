"""What a recorded cut shows by itself: its entry and exit, its speed, its multipliers, the free decay after it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

from testbed.analysis.multipliers.floquet import (
    EmpiricalMultipliers,
    TooFewPeriods,
    empirical_multipliers,
    passing_period,
    tooth_period,
)
from testbed.analysis.multipliers.ring_down import ring_down
from testbed.analysis.multipliers.vibration_period import vibration_period
from testbed.analysis.records.spindle_clock import check_speed
from testbed.cut import Cut
from testbed.machine import Model
from testbed.recording import Recording


def at_measured_speed(cut: Cut, recording: Recording, flutes: int, channel: str = "displacement") -> Cut:
    """The cut at the speed that the recording's marks show, or without marks its vibration; it need not be the one stated.

    ValueError where the marks' speed is another by far.
    """
    if recording.marks.size >= 3:
        period = tooth_period(recording, flutes)
        check_speed(flutes * period, 2.0 * math.pi / cut.spindle_speed)
    else:
        period = vibration_period(recording, cut.tooth_passing_period(flutes), flutes, *cut_bounds(recording, cut), channel)
    return replace(cut, spindle_speed=2.0 * math.pi / (flutes * period))


def measured_multipliers(recording: Recording, cut: Cut, flutes: int, channel: str = "displacement",
                         delays: int | None = None) -> EmpiricalMultipliers:
    """The multipliers of one recorded cut; of rank 0, with the reason, where it has too few periods."""
    start, stop = cut_bounds(recording, cut)
    period = passing_period(recording, cut.spindle_speed, flutes)
    try:
        return empirical_multipliers(recording, flutes=flutes, period=period, start=start, stop=stop, channel=channel,
                                     delays=delays)
    except TooFewPeriods as problem:
        return EmpiricalMultipliers.none(period, str(problem))


def started_from_ring_down(model: Model, tests: Sequence[tuple[Recording, Cut]],
                           channel: str = "displacement") -> Model:
    """The model with natural frequency and damping ratio of the surest free decay after a cut, if there is a sure one.

    Sure is a damping ratio known to better than a half of itself and a frequency within a fifth of the model's.
    """
    best, surest = model, 0.5
    for recording, cut in tests:
        if cut.ring_down_passes == 0:
            continue
        try:
            decay = ring_down(recording, start=cut_bounds(recording, cut)[1], channel=channel)
        except ValueError:  # too short or too still to say anything: the model's own values stand
            continue
        frequency, damping = float(decay.natural_frequency[0]), float(decay.damping_ratio[0])
        doubt = float(decay.damping_ratio_high[0] - damping) / damping if damping > 0 else math.inf
        if doubt < surest and abs(frequency / model.structure.natural_frequency - 1.0) < 0.2:
            best, surest = model.with_values({"natural_frequency": frequency, "damping_ratio": damping}), doubt
    return best


def cut_bounds(recording: Recording, cut: Cut) -> tuple[float, float]:
    """Times (s) of entry and exit of a recorded cut."""
    known, passes = recording.conditions, recording.pass_times
    last = recording.start + len(recording) / recording.sampling_rate
    begin, end = recording.start, last
    if passes.size > cut.idle_passes:
        begin = float(passes[cut.idle_passes])
        end = float(passes[min(cut.idle_passes + cut.passes, passes.size - 1)])
    return float(known.get("entry_time", begin)), float(known.get("exit_time", end))
