"""The second road of `plane_road` as an engine: idling, cut and ring-down of one test, with the channels of every sensor.

Shares no code with the engines: the delay equation by DOP853 from corner to corner, the free decay in closed form. The cut
begins at rest, and ends where no tooth is in the work.
"""

from __future__ import annotations

import math

import numpy as np

from testbed.recording import Recording, quantity_of
from tests.support.plane_road import Road


def simulate(model, cut, sampling, *, channels, rtol=1e-9):
    """Displacements of one test; marks once a revolution, from time 0 on."""
    pitch = 2.0 * math.pi / model.cutter.flutes
    begun, turned = cut.idle_passes * pitch / cut.spindle_speed, cut.passes * pitch
    assert model.cutting.engagement_angle < pitch and not model.cutter.helix_angle and not model.cutter.pitch_angles
    road = Road(model, cut.spindle_speed, cut.axial_depth_of_cut, cut.feed_per_tooth, turned, rtol=rtol)
    time = sampling.start + np.arange(sampling.count) / sampling.rate
    modes, left = model.structure.modes, begun + turned / cut.spindle_speed
    states = np.zeros((len(time), 2 * len(modes)))
    cutting, after = (time > begun) & (time <= left), time > left
    states[cutting] = [road.state(one - begun) for one in time[cutting]]
    last = road.state(turned / cut.spindle_speed)
    for place, mode in enumerate(modes):
        omega = 2.0 * math.pi * mode.natural_frequency
        root = omega * complex(-mode.damping_ratio, math.sqrt(1.0 - mode.damping_ratio**2))
        q, v = last[place], last[place + len(modes)]
        states[after, place] = (complex(q, (root.real * q - v) / root.imag) * np.exp(root * (time[after] - left))).real
    found = {}
    for name in channels:
        assert quantity_of(name) == "displacement"
        tool, axis = name.startswith("tool_"), math.sin if name.endswith("_y") else math.cos
        share = [(-1.0 if tool else 1.0) * axis(mode.direction) if (mode.on == "tool") == tool else 0.0 for mode in modes]
        found[name] = states[:, : len(modes)] @ share
    passes = np.arange(0, cut.total_passes + 1, model.cutter.flutes) * pitch / cut.spindle_speed
    return Recording(found, sampling.rate, dict.fromkeys(found, "m"), "predicted", sampling.start, passes)
