"""Stable cuts whose force is noisy: the teeth's noise keeps the structure swinging, which is no chatter.

A mode along the feed, stepped by its exact map under a force that is held for a step: an integrator of its own. A tooth whose
chip has run out makes no force.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from testbed.cut import Cut
from testbed.machine import Model
from testbed.recording import Recording
from tests.validation.chatter_cuts import machine, spoiled

NOISIEST, QUIETEST = 1.0, 0.03  # of the force, from step to step, log-uniform
STEPS_A_SWING, STEPS_A_PASS = 200, 60


@njit
def swung(exact, compliance, load, feed, turning, window, course, noise):
    """Displacement (m) at every step of a cut. exact (4,): map of a step; compliance, m/N; load (2,): of K_t, of K_n, N/m.

    turning (3,): rad a step, steps a tooth pass, flutes; window, course (2,): angles (rad) and steps between which teeth cut.
    noise (steps,): of the force, as a share of it.
    """
    found, rate = np.zeros(len(noise)), 0.0
    place, delay = 0.0, int(turning[1])
    for step in range(1, len(noise)):
        force = 0.0
        if course[0] <= step < course[1]:
            old = found[step - delay] if step >= delay else 0.0
            for tooth in range(int(turning[2])):
                angle = (turning[0] * step + 2.0 * math.pi * tooth / turning[2]) % (2.0 * math.pi)
                chip = (feed + place - old) * math.sin(angle)
                if window[0] <= angle < window[1] and chip > 0.0:
                    force -= chip * (load[0] * math.cos(angle) + load[1] * math.sin(angle)) * (1.0 + noise[step])
        away = place - force * compliance
        place, rate = exact[0] * away + exact[1] * rate + force * compliance, exact[2] * away + exact[3] * rate
        found[step] = place
    return found


def exact_map(model: Model, dt: float) -> np.ndarray:
    """The map of (displacement, velocity) over dt (s) without a force, (4,)."""
    omega, zeta = model.structure.natural_frequency_rad, model.structure.damping_ratio
    damped, fade = omega * math.sqrt(1.0 - zeta**2), math.exp(-zeta * omega * dt)
    cos, sin = fade * math.cos(damped * dt), fade * math.sin(damped * dt) / damped
    return np.array([cos + zeta * omega * sin, sin, -(omega**2) * sin, cos - zeta * omega * sin])


def draw(seed: int) -> Recording:
    """The displacement of a random stable cut with a noisy force, hum, noise and drift; half of them with a tachometer."""
    random = np.random.default_rng([535, seed])
    found = None
    while found is None:
        found = machine(random, "stable")
    model, cut, _ = found
    flutes, structure, cutting = model.cutter.flutes, model.structure, model.cutting
    tooth, turn = cut.tooth_passing_period(flutes), cut.tooth_passing_period(flutes) * flutes
    rate = max(structure.natural_frequency, 1.0 / tooth) * 10 ** random.uniform(0.9, 1.5)
    every = math.ceil(max(STEPS_A_SWING * structure.natural_frequency, STEPS_A_PASS / tooth) / rate)
    delay = math.ceil(tooth * rate * every)
    dt = tooth / delay
    idle, cuts, after = (int(random.integers(low, high)) for low, high in ((8, 30), (max(20, -(-40 // flutes)), 121), (0, 25)))
    noise = random.standard_normal((idle + cuts + after) * flutes * delay)
    noise *= math.exp(random.uniform(math.log(QUIETEST), math.log(NOISIEST)))
    load = cut.axial_depth_of_cut * np.array([cutting.tangential_coefficient, cutting.normal_coefficient])
    entered = cutting.entry_angle, cutting.entry_angle + cutting.engagement_angle
    clean = swung(exact_map(model, dt), 1.0 / structure.stiffness, load, cut.feed_per_tooth,
                  np.array([cut.spindle_speed * dt, delay, flutes]), np.array(entered),
                  np.array([idle, idle + cuts]) * flutes * delay, noise)[::every]  # fmt: skip
    return _recorded(random, cut, flutes, clean, (dt * every, (idle + 1) * turn, (idle + cuts) * turn))


def _recorded(random: np.random.Generator, cut: Cut, flutes: int, clean: np.ndarray, course: tuple[float, float, float]
              ) -> Recording:  # fmt: skip
    """course: time between samples, of the cut's second revolution, and of its end, s."""
    interval, first, last = course
    time, turn = interval * np.arange(len(clean)), 2.0 * math.pi / cut.spindle_speed
    values, _ = spoiled(random, clean, float(clean[(time > first) & (time < last)].std()), time)
    marked = bool(random.random() < 0.5)
    marks = np.arange(random.uniform(0, turn), time[-1], turn) if marked else np.empty(0)
    known = {"spindle_speed": cut.spindle_speed * (1.0 if marked else 1.0 + random.uniform(-0.03, 0.03)), "flutes": flutes,
             "axial_depth_of_cut": cut.axial_depth_of_cut, "feed_per_tooth": cut.feed_per_tooth}
    known_as = {"displacement": "m"}
    return Recording({"displacement": values}, 1.0 / interval, known_as, "synthetic", conditions=known, marks=marks)
