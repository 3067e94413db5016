"""Cuts and free decays by a plain integrator that shares nothing with the engines, under any force law: the hidden truth.

Classical Runge-Kutta by the method of steps on a grid that lands on every entry and exit; one straight tooth.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from testbed.analysis.fit.drift import drift_basis
from testbed.analysis.fit.observed import Observed
from testbed.cut import Cut
from testbed.files.campaign import Record
from testbed.files.manifest import Feed
from testbed.machine import Cutter, Cutting, Model, Structure
from testbed.recording import Recording

RATE, STEPS, FLIGHT, MARK = 12800.0, 36, 110, 0.7
RELEASED = (2.5e-4, 1.5e-4)  # m, from where free decays begin
COURSE = (8, 30, 20)  # revolutions of idling, cutting, ringing down
TRUE = Model(Structure(2.573, 146.4, 0.0032), Cutter(), Cutting())


def no_force(*_: float) -> float:
    """Nothing is hidden."""
    return 0.0


def motion(model: Model, cut: Cut, structure_law: Callable = no_force, tooth_law: Callable = no_force):
    """(times, displacements, velocities). structure_law(x, v) N; tooth_law(depth, chip, angle) normal force, N."""
    structure, cutting = model.structure, model.cutting
    pitch = 2 * math.pi / cut.spindle_speed
    window = cutting.immersion * pitch
    surface = [-cut.feed_per_tooth] * (2 * STEPS + 1)
    times, xs, vs = [0.0], [cut.initial_displacement], [cut.initial_velocity]
    passed = 0
    for number in range(cut.total_passes):
        cuts = cut.idle_passes <= number < cut.idle_passes + cut.passes
        left = list(surface)
        for step in range(STEPS + FLIGHT):
            inside = cuts and step < STEPS
            dt = window / STEPS if step < STEPS else (pitch - window) / FLIGHT
            x, v, slopes = xs[-1], vs[-1], []
            for stage in range(4):
                part = (0.0, 0.5, 0.5, 1.0)[stage]
                xi = x + (part * dt * slopes[-1][0] if stage else 0.0)
                vi = v + (part * dt * slopes[-1][1] if stage else 0.0)
                force = structure_law(xi, vi)
                if inside:
                    node = 2 * step + round(2 * part)
                    angle = cutting.entry_angle + cutting.engagement_angle * node / (2 * STEPS)
                    chip = (passed * cut.feed_per_tooth + xi - surface[node]) * math.sin(angle)
                    load, depth = cut.axial_depth_of_cut * chip, cut.axial_depth_of_cut
                    normal = cutting.normal_coefficient * load + tooth_law(depth, chip, angle)
                    force -= cutting.tangential_coefficient * load * math.cos(angle) + normal * math.sin(angle)
                slopes.append((vi, (force - structure.damping * vi - structure.stiffness * xi) / structure.mass))
            new_x, new_v = (
                (x, v)[i] + dt * (slopes[0][i] + 2 * slopes[1][i] + 2 * slopes[2][i] + slopes[3][i]) / 6 for i in range(2)
            )
            if inside:
                middle = 0.5 * (x + new_x) + dt * (v - new_v) / 8
                for node, place in ((2 * step, x), (2 * step + 1, middle), (2 * step + 2, new_x)):
                    left[node] = place + passed * cut.feed_per_tooth
            times.append(times[-1] + dt)
            xs.append(new_x)
            vs.append(new_v)
        surface = left
        passed += int(cuts)
    return np.array(times), np.array(xs), np.array(vs)


def record(
    speed_rpm: float, depth: float, seed: int, *, noise: float = 1e-6, course: tuple[int, int, int] = COURSE, **laws: Callable
) -> Record:
    """A measured cut (depth m) with the tachometer's mark MARK rad before the tooth's entry."""
    speed = speed_rpm * math.pi / 30
    cut = Cut(speed, depth, 0.1016e-3, *course)
    times, xs, vs = motion(TRUE, cut, **laws)
    wanted = np.arange(int(times[-1] * RATE)) / RATE
    place = np.searchsorted(times, wanted, side="right") - 1
    dt, s = times[place + 1] - times[place], (wanted - times[place]) / (times[place + 1] - times[place])
    signal = (
        (1 + 2 * s) * (1 - s) ** 2 * xs[place]
        + s * (1 - s) ** 2 * dt * vs[place]
        + s**2 * (3 - 2 * s) * xs[place + 1]
        + s**2 * (s - 1) * dt * vs[place + 1]
    )
    signal = signal + 4e-6 + noise * np.random.default_rng(seed).standard_normal(len(wanted))
    marks = (2 * math.pi * np.arange(1, cut.total_passes) - MARK) / speed
    conditions = {
        "spindle_speed": speed,
        "axial_depth_of_cut": depth,
        "feed_per_tooth": 0.1016e-3,
        "feed_per_revolution": 0.1016e-3,
    }
    recording = Recording({"displacement": signal}, RATE, {"displacement": "m"}, "synthetic", 0.0, marks, conditions=conditions)
    return Record(f"{speed_rpm:.0f}rpm", "cut", recording, conditions, (), feed=Feed(0.1016e-3, "tooth"))


def free_decays(structure_law: Callable, noise: float = 1e-6) -> list[Observed]:
    """Records of 0.4 s of the structure let go from each displacement of RELEASED, ready to be fitted."""
    found = []
    for seed, amplitude in enumerate(RELEASED):
        cut = Cut(2 * math.pi * 100.0, 0.0, idle_passes=40, passes=0, initial_displacement=amplitude)
        times, xs, _ = motion(TRUE, cut, structure_law=structure_law)
        wanted = np.arange(int(times[-1] * RATE)) / RATE
        x = np.interp(wanted, times, xs) + noise * np.random.default_rng(seed).standard_normal(len(wanted))
        name, drift = f"tap_{seed}", drift_basis(len(x))
        found.append(Observed(name, "ring-down", ("displacement",), x[None], RATE, 0.0, np.array([noise]), "idle", drift, (),
                              ("ring-down", name), force=np.zeros(len(x))))  # fmt: skip
    return found
