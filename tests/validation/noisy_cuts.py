"""Stable cuts whose force is noisy: the teeth's noise keeps the structure swinging, which is no chatter.

A mode along the feed, stepped by its exact map under a force that is held for a step: an integrator of its own. A tooth whose
chip has run out makes no force.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from scipy.linalg import expm

from testbed.machine import Model
from testbed.recording import Recording
from tests.validation.chatter_cuts import clocked, machine, spoiled

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
    return expm(np.array([[0.0, 1.0], [-(omega**2), -2.0 * zeta * omega]]) * dt).ravel()


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
    time = dt * every * np.arange(len(clean))
    inside = clean[(time > (idle + 1) * turn) & (time < (idle + cuts) * turn)]
    values, _ = spoiled(random, clean, float(inside.std()), time)
    marks, known = clocked(random, cut, flutes, time)
    return Recording({"displacement": values}, 1.0 / (dt * every), {"displacement": "m"}, "synthetic", marks=marks,
                     conditions=known)
