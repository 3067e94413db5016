"""A small simulator of its own kind: RK4 by the method of steps, on grids that land on every entry and exit.

It shares no code with the engines or the analysis (it writes the force law, the regeneration and the integration out
once more), so that agreement with it says something. One tooth in the cut at a time; straight teeth; one mode.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from testbed.cut import Cut
from testbed.machine import Model
from testbed.recording import Recording


@njit(cache=True)
def _integrate(mass, damping, stiffness, kt, kn, depth, feed, entry, speed, period, window, plan, steps, flight_steps,
               contact_loss, x, v):
    """Times, displacements and velocities at all grid points. `plan` (passes,) is 1 where the pass cuts."""
    per_pass = steps + flight_steps
    times, xs, vs = np.empty(plan.size * per_pass + 1), np.empty(plan.size * per_pass + 1), np.empty(
        plan.size * per_pass + 1)
    times[0], xs[0], vs[0] = 0.0, x, v
    surface = np.full(2 * steps + 1, -feed)  # radial position left by the teeth before, at every half step
    passed = 0
    n = 0
    for number in range(plan.size):
        left = surface.copy()
        for step in range(per_pass):
            cutting = plan[number] == 1 and step < steps
            dt = window / steps if step < steps else (period - window) / flight_steps
            kx, kv = np.zeros(4), np.zeros(4)
            for stage in range(4):
                part = 0.0 if stage == 0 else (1.0 if stage == 3 else 0.5)
                xi = x + (part * dt * kx[stage - 1] if stage else 0.0)
                vi = v + (part * dt * kv[stage - 1] if stage else 0.0)
                force = 0.0
                if cutting:
                    node = 2 * step + int(2 * part)
                    theta = entry + speed * window * node / (2 * steps)
                    chip = passed * feed + xi - surface[node]
                    if contact_loss and chip < 0.0:
                        chip = 0.0
                    force = -depth * (kt * math.cos(theta) + kn * math.sin(theta)) * math.sin(theta) * chip
                kx[stage] = vi
                kv[stage] = (force - damping * vi - stiffness * xi) / mass
            x_next = x + dt * (kx[0] + 2 * kx[1] + 2 * kx[2] + kx[3]) / 6
            v_next = v + dt * (kv[0] + 2 * kv[1] + 2 * kv[2] + kv[3]) / 6
            if cutting:
                middle = 0.5 * (x + x_next) + dt * (v - v_next) / 8
                for node, position in ((2 * step, x), (2 * step + 1, middle), (2 * step + 2, x_next)):
                    position += passed * feed
                    left[node] = max(surface[node], position) if contact_loss else position
            x, v = x_next, v_next
            n += 1
            times[n], xs[n], vs[n] = times[n - 1] + dt, x, v
        surface = left
        passed += plan[number]
    return times, xs, vs


def simulate(model: Model, cut: Cut, *, rate: float = 12800.0, steps: int = 40, flight_steps: int = 200,
             contact_loss: bool = False, noise: float = 0.0, offset: float = 0.0, drift: float = 0.0,
             mark_fraction: float = 0.31, seed: int = 0) -> Recording:
    """The displacement (m) of one cut, sampled at `rate` (Hz), with a tachometer mark once a revolution.

    noise: rms of white noise, m; offset m; drift m/s; mark_fraction: where in a revolution the mark sits.
    """
    structure, cutter, cutting = model.structure, model.cutter, model.cutting
    period = 2 * math.pi / (cut.spindle_speed * cutter.flutes)
    window = cutting.immersion * 2 * math.pi / cut.spindle_speed
    if window >= period or cutter.helix_angle:
        raise ValueError("one straight tooth at a time")
    plan = np.array([0] * cut.idle_passes + [1] * cut.passes + [0] * cut.ring_down_passes)
    entry = 0.0 if cutting.direction == "up-milling" else math.pi - 2 * math.pi * cutting.immersion
    times, xs, vs = _integrate(
        structure.mass, structure.damping, structure.stiffness, cutting.tangential_coefficient,
        cutting.normal_coefficient, cut.axial_depth_of_cut, cut.feed_per_tooth, entry, cut.spindle_speed, period,
        window, plan, steps, flight_steps, contact_loss, cut.initial_displacement, cut.initial_velocity)
    wanted = np.arange(int(times[-1] * rate * (1 + 1e-12))) / rate
    place = np.clip(np.searchsorted(times, wanted, side="right") - 1, 0, times.size - 2)
    dt = times[place + 1] - times[place]
    s = (wanted - times[place]) / dt
    sampled = ((1 + 2 * s) * (1 - s) ** 2 * xs[place] + s * (1 - s) ** 2 * dt * vs[place]
               + s**2 * (3 - 2 * s) * xs[place + 1] + s**2 * (s - 1) * dt * vs[place + 1])
    sampled += offset + drift * wanted + noise * np.random.default_rng(seed).standard_normal(wanted.size)
    revolution = period * cutter.flutes
    marks = np.arange(mark_fraction * revolution, times[-1], revolution)
    passes = np.arange(plan.size + 1) * period
    return Recording({"displacement": sampled}, rate, {"displacement": "m"}, "synthetic", marks=marks,
                     pass_times=passes, conditions={"entry_time": cut.idle_passes * period,
                                                    "exit_time": (cut.idle_passes + cut.passes) * period})
