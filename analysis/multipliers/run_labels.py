"""What a simulated run is called: the class of its linear machine, what its samples show, whether a tooth left the work."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.interpolate import CubicSpline

from testbed.analysis.linear.planar_multipliers import cut_multipliers
from testbed.analysis.linear.stability import classify
from testbed.analysis.multipliers.verdict import changing_part, once_per_tooth_samples, simulated_verdict
from testbed.analysis.records.chatter import judge_cut
from testbed.analysis.records.segments import Segment, main_channel
from testbed.cut import Cut
from testbed.machine import Model
from testbed.recording import Recording

_ANGLES = 48  # places in the cut where the surface is followed
_NOISES = 6.0  # a gap must exceed this many rms of the noise: thousands of looks at a run raise one false alarm in 1e5
_CHATTER = ("neimark_sacker", "flip")
_LINEAR = 1e-3  # of the chip: what interpolation may feign


@dataclass(frozen=True)
class LinearClass:
    """Class of the largest multiplier, its modulus per tooth passing period, and its angle (rad, 0 to pi)."""

    stability: str | None
    modulus: float | None
    angle: float | None


NO_CLASS = LinearClass(None, None, None)


def linear_class(multipliers: np.ndarray, period_passes: int = 1) -> LinearClass:
    """The label of multipliers over `period_passes` tooth passing periods."""
    values = np.asarray(multipliers, complex)
    largest = complex(values[np.argmax(np.abs(values))])
    return LinearClass(classify(values), abs(largest) ** (1.0 / period_passes), abs(math.atan2(largest.imag, largest.real)))


def class_of_linear(model: Model, cut: Cut) -> LinearClass:
    """The label of a machine without effects; modulus to 1e-5, or no label where its multipliers do not settle."""
    try:
        values, _, passes = cut_multipliers(model, cut)
        return linear_class(values, passes)
    except ArithmeticError:
        return NO_CLASS


def contact_loss_time(recording: Recording, immersion: float, noise: float = 0.0, flutes: int = 1) -> float:
    """When (s) a tooth first left the work while engaged; NaN if none did.

    The surface is what the highest tooth left at each angle, S <- max(S, feed position + x); a tooth is out where feed
    position + x falls below it. It follows from the recorded displacement (m), so a gap counts only if it exceeds six
    rms of the noise, `noise` (m). The nominal edges are taken: teeth that run out are not told from motion.
    Needs `pass_times` and the conditions `feed_per_tooth`, `idle_passes` and `passes`. ValueError without displacement.
    """
    if "displacement" not in recording.channels:
        raise ValueError("contact is found from the displacement, which was not recorded")
    known = recording.conditions
    first, last = int(known["idle_passes"]), int(known["idle_passes"]) + int(known["passes"])
    begins = recording.pass_times[first:last + 1]
    values = np.asarray(recording.channels["displacement"], float)
    if begins.size < 3 or values.size < 4 or not np.isfinite(values).all():
        return math.nan
    times = begins[:-1, None] + np.linspace(0.0, 1.0, _ANGLES) * immersion * flutes * np.diff(begins)[:, None]
    times = times[times[:, -1] <= recording.time[-1]]
    if not len(times):
        return math.nan
    feed = float(known["feed_per_tooth"])
    edge = feed * np.arange(len(times))[:, None] + CubicSpline(recording.time, values)(times)
    surface = np.maximum.accumulate(edge, axis=0)
    gap = surface[:-1] - edge[1:]
    lost = gap > math.sqrt(2.0) * _NOISES * noise + _LINEAR * feed
    return float(times[1:][lost].min()) if lost.any() else math.nan


def labels(recording: Recording, linear: LinearClass, model: Model, noise: Mapping[str, float]) -> Mapping[str, Any]:
    """All label columns of a run. model: the true machine; noise: rms of each channel's sensor, its unit."""
    when: float | None = None
    if not model.planar:  # a surface that y, too, leaves cannot be followed from one channel
        try:
            when = contact_loss_time(recording, model.value("immersion"), noise.get("displacement", 0.0),
                                     int(recording.conditions["flutes"]))
        except ValueError:
            when = None
    uneven = model.cutter is not None and bool(model.cutter.pitch_angles)
    lost = None if when is None else not math.isnan(when)
    behaviour = observed(recording, noise, uneven)
    return {"stability": linear.stability, "largest_multiplier_modulus": linear.modulus,
            "largest_multiplier_angle": linear.angle, "behaviour": behaviour, **chatter(linear.stability, behaviour),
            "contact_loss": lost, "contact_loss_time": when if lost else None, "effects": sorted(model.effects)}


def chatter(stability: str | None, behaviour: str) -> dict[str, Any]:
    """The run's `label` (stable, neimark_sacker, flip or unknown) and its `chatter` (True, False, or None: not known).

    The delay equation names the class. Where the record shows the contrary of it - a stable cut that the entry threw into
    lasting chatter, an unstable one that did not grow - or where the equation has no class, nobody can say: unknown, not False.
    """
    unstable = stability in _CHATTER
    contrary = behaviour != "undecided" and unstable != (behaviour in _CHATTER)
    if contrary or not (unstable or stability == "stable"):
        return {"label": "unknown", "chatter": None}
    return {"label": stability, "chatter": unstable}


def observed(recording: Recording, noise: Mapping[str, float], by_revolution: bool = False) -> str:
    """What the cut did alone, by the displacement, else the velocity, the acceleration, a force; noise: rms of each channel's.

    by_revolution: the teeth differ, so that samples are compared once a revolution and not once a tooth.
    Where the samples of another channel than the displacement leave it undecided, its lines are asked.

    Undecided where the run is too short, broken off or has no marks.
    """
    known, passes = recording.conditions, recording.pass_times
    first, last = int(known["idle_passes"]), int(known["idle_passes"]) + int(known["passes"])
    if len(recording) < 8 or passes.size <= last:
        return "undecided"
    cut = {"entry_time": float(passes[first]), "exit_time": float(passes[last])}
    flutes, channel = int(known["flutes"]), main_channel(recording)
    marks = recording.marks if recording.marks.size >= 3 else passes[::flutes]
    flutes = 1 if by_revolution else flutes
    timed = replace(recording, marks=marks, conditions={**known, **cut})
    try:
        samples = (once_per_tooth_samples(timed, flutes) if channel == "displacement"
                   else changing_part(timed, flutes, channel))
        found = simulated_verdict(samples, noise.get(channel, 0.0)).outcome
        return found if found != "undecided" or channel == "displacement" else _by_lines(timed, channel)
    except (ValueError, IndexError, np.linalg.LinAlgError):
        return "undecided"


def _by_lines(recording: Recording, channel: str) -> str:
    """What the lines of the cut in a channel tell where its samples, once a tooth, leave it undecided."""
    start, stop = (float(recording.conditions[name]) for name in ("entry_time", "exit_time"))
    alone = replace(recording, channels={channel: recording.channels[channel]})
    found = judge_cut(alone, (Segment("idle", recording.start, start), Segment("steady", start, stop)))
    if found.verdict == "chatter" and found.kind in ("neimark_sacker", "flip"):
        return str(found.kind)
    return "stable" if found.verdict == "none" else "undecided"
