"""Milling with a delay, written from the equations alone: RK4 with the past from a cubic through the stored motion.

Steps end wherever an edge enters or leaves the work, and at the first and the last moment of the cut. The past is looked
up by spindle angle, so a speed that varies needs nothing more. It shares no code with the product.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

TURN = 2.0 * np.pi
FAR = 0.01  # m, beyond which a run has diverged
REFERENCE_CHIP = 1e-4  # m, at which a power law of the chip cuts like the linear one
EDGE = 1e-13  # s, by which a step looks inside its own ends


class Cutting(NamedTuple):
    """One cut and everything that acts in it; SI units, angles in rad. Neutral values leave an effect out."""

    mass: float
    omega: float  # natural frequency, rad/s
    zeta: float
    kt: float  # N/m^2
    kn: float
    flutes: int
    radius: float  # m, of the cutter
    entry: float
    window: float  # angle in the cut
    depth: float
    travel: float  # m/s, of the table
    speed: float  # rad/s
    first_angle: float
    begin: float  # s, of the cut
    end: float
    helix_lag: float = 0.0  # angle by which the edge's top lags its tip
    cubic: float = 0.0
    quadratic_damping: float = 0.0
    friction: float = 0.0
    breakaway: float = 2e-7  # m
    edge_tangential: float = 0.0
    edge_normal: float = 0.0
    flank: float = 0.0  # N/m, process damping
    offset: float = 0.0  # m, of the axis: runout
    offset_angle: float = 0.0
    wear: float = 0.0  # 1/m
    length_before: float = 0.0
    droop: float = 0.0
    droop_time: float = 0.2
    swing: float = 0.0
    swing_frequency: float = 1.0
    swing_phase: float = 0.0
    exponent: float = 1.0
    mass_ratio: float = 0.0  # second mode
    omega2: float = 1.0
    zeta2: float = 0.01
    participation: float = 1.0
    lag: float = 0.0  # s, of the sensor
    quintic: float = 0.0  # laws of no catalogue from here on
    cubic_damping: float = 0.0
    wall_stiffness: float = 0.0
    wall: float = 1.0  # m
    van_der_pol: float = 0.0  # N s/m^3


@njit(cache=True)
def _past(angle, times, angles, motion, rate, count, near):
    """The tool's stored displacement and the time at a spindle angle gone by; `near` is where the last look-up ended."""
    k = min(near, count - 2)
    while k < count - 2 and angles[k + 1] < angle:
        k += 1
    while k > 0 and angles[k] > angle:
        k -= 1
    step = times[k + 1] - times[k]
    u = (angle - angles[k]) / (angles[k + 1] - angles[k])
    value = ((1.0 + 2.0 * u) * (1.0 - u) ** 2 * motion[k] + u * (1.0 - u) ** 2 * step * rate[k]
             + u * u * (3.0 - 2.0 * u) * motion[k + 1] + u * u * (u - 1.0) * step * rate[k + 1])
    return value, times[k] + u * step, k


@njit(cache=True)
def _means(c, angle):
    """Means over the edge of cos sin, sin^2, cos and sin, where it is in the cut."""
    if c.helix_lag == 0.0:
        return np.cos(angle) * np.sin(angle), np.sin(angle) ** 2, np.cos(angle), np.sin(angle)
    low = min(max(angle - c.helix_lag, c.entry), c.entry + c.window)
    high = min(max(angle, c.entry), c.entry + c.window)
    cs = (np.sin(high) ** 2 - np.sin(low) ** 2) / 2.0
    ss = (high - low) / 2.0 - (np.sin(2.0 * high) - np.sin(2.0 * low)) / 4.0
    return (cs / c.helix_lag, ss / c.helix_lag, (np.sin(high) - np.sin(low)) / c.helix_lag,
            (np.cos(low) - np.cos(high)) / c.helix_lag)


@njit(cache=True)
def _cutting_force(c, t, state, speed, engaged, past, then):
    """(force along x, torque) of the teeth in the cut, feed with motion since `then`, when the tool was at `past`."""
    force, torque, pitch = 0.0, 0.0, TURN / c.flutes
    moved = c.travel * (t - then) + state[0] + state[2] - past
    worn = c.depth * (1.0 + c.wear * (c.length_before + c.travel * (t - c.begin)))
    for tooth in range(c.flutes):
        if not engaged[tooth]:
            continue
        angle = (state[7] - tooth * pitch) % TURN
        if angle < c.entry - 1e-9:
            angle += TURN
        cs, ss, cos, sin = _means(c, angle)
        out = c.offset * (np.cos(c.offset_angle - tooth * pitch) - np.cos(c.offset_angle - (tooth - 1) * pitch))
        if c.exponent != 1.0:
            chip = REFERENCE_CHIP * (max(moved * sin + out, 0.0) / REFERENCE_CHIP) ** c.exponent
            force -= worn * chip * (c.kt * cos + c.kn * sin)
            torque += worn * c.radius * c.kt * chip
        else:
            force -= worn * (moved * (c.kt * cs + c.kn * ss) + out * (c.kt * cos + c.kn * sin))
            torque += worn * c.radius * c.kt * (moved * sin + out)
        force -= c.depth * (c.edge_tangential * cos + c.edge_normal * sin)
        force -= c.flank * c.depth * (state[1] + state[3]) * ss / (c.radius * speed)
        torque += c.depth * c.radius * c.edge_tangential
    return force, torque, moved


@njit(cache=True)
def _structure_force(c, x, v, contact):
    force = -c.cubic * x**3 - c.quadratic_damping * abs(v) * v - c.quintic * x**5 - c.cubic_damping * v**3
    force -= c.van_der_pol * x * x * v + c.wall_stiffness * max(x - c.wall, 0.0)
    return force - c.friction * min(max(contact / c.breakaway, -1.0), 1.0)


@njit(cache=True)
def _slope(c, t, state, engaged, stored, count, near, slope):
    """Writes d(state)/dt; state: x, v, second mode q, q', contact, loss of speed, lagging sensor, spindle angle."""
    times, angles, motion, rate = stored
    x, v, q, qv, contact = state[0], state[1], state[2], state[3], state[4]
    speed = c.speed * (1.0 - state[5]) * (1.0 + c.swing * np.sin(TURN * c.swing_frequency * t + c.swing_phase))
    force, torque, moved = 0.0, 0.0, np.inf
    if engaged.any():
        past, then, near = _past(state[7] - TURN / c.flutes, times, angles, motion, rate, count, near)
        force, torque, moved = _cutting_force(c, t, state, speed, engaged, past, then)
    slope[0] = v
    slope[1] = (force + _structure_force(c, x, v, contact)) / c.mass - 2.0 * c.zeta * c.omega * v - c.omega**2 * x
    slope[2] = qv
    slope[3] = c.mass_ratio * force / c.mass - 2.0 * c.zeta2 * c.omega2 * qv - c.omega2**2 * q if c.mass_ratio > 0.0 else 0.0
    slope[4] = 0.0 if abs(contact) >= c.breakaway and contact * v > 0.0 else v
    slope[5] = (c.droop * torque - state[5]) / c.droop_time if c.droop > 0.0 else 0.0
    slope[6] = (x + c.participation * q - state[6]) / c.lag if c.lag > 0.0 else 0.0
    slope[7] = speed
    return moved, near


@njit(cache=True)
def _step_length(c, t, angle, speed, longest):
    """A step that ends where the next edge enters or leaves, or where the cut begins or ends."""
    step, pitch = longest, TURN / c.flutes
    for tooth in range(c.flutes):
        for border in (c.entry, c.entry + c.window + c.helix_lag):
            ahead = (border + tooth * pitch - angle) % TURN
            if 1e-10 < ahead < speed * step:
                step = ahead / speed
    for moment in (c.begin, c.end):
        if t + 1e-12 < moment < t + step:
            step = moment - t
    return max(step, 1e-11)


@njit(cache=True)
def _observe(c, state, seen, n):
    if c.lag > 0.0:
        seen[0, n], seen[1, n] = state[6], (state[0] + c.participation * state[2] - state[6]) / c.lag
    else:
        seen[0, n], seen[1, n] = state[0] + c.participation * state[2], state[1] + c.participation * state[3]


@njit(cache=True)
def run(c, x, v, duration, longest):
    """(times (n,) s, spindle angles (n,) rad, seen (2, n): the sensor's displacement m and velocity m/s, thinnest chip m).

    x, v: where the structure begins; longest: the longest step, s. It ends early where the motion diverges.
    """
    most = 3 * int(duration / longest) + 1000
    times, angles, motion, rate = np.zeros(most), np.zeros(most), np.zeros(most), np.zeros(most)
    stored, seen = (times, angles, motion, rate), np.zeros((2, most))
    state, trial, k = np.zeros(8), np.zeros(8), np.zeros((4, 8))
    state[0], state[1], state[6], state[7] = x, v, x, c.first_angle
    angles[0], motion[0], rate[0] = c.first_angle, x, v
    _observe(c, state, seen, 0)
    engaged = np.zeros(c.flutes, np.bool_)
    t, n, near, thinnest, speed = 0.0, 1, 0, np.inf, c.speed
    while t < duration and n < most:
        step = _step_length(c, t, state[7], speed, longest)
        middle = state[7] + 0.5 * speed * step
        cutting = c.begin <= t + 0.5 * step < c.end
        for tooth in range(c.flutes):
            inside = (middle - tooth * TURN / c.flutes - c.entry) % TURN < c.window + c.helix_lag
            engaged[tooth] = cutting and inside
        for stage in range(4):
            part = (0.0, 0.5, 0.5, 1.0)[stage]
            trial[:] = state if stage == 0 else state + part * step * k[stage - 1]
            moment = t + min(max(part * step, EDGE), step - EDGE)
            moved, near = _slope(c, moment, trial, engaged, stored, n, near, k[stage])
            thinnest = min(thinnest, moved)
        state += step / 6.0 * (k[0] + 2.0 * k[1] + 2.0 * k[2] + k[3])
        state[4] = min(max(state[4], -c.breakaway), c.breakaway)
        t += step
        speed = k[3, 7]
        times[n], angles[n], motion[n], rate[n] = t, state[7], state[0] + state[2], state[1] + state[3]
        _observe(c, state, seen, n)
        n += 1
        if abs(state[0]) > FAR:
            break
    return times[:n].copy(), angles[:n].copy(), seen[:, :n].copy(), thinnest


def sampled(times, angles, seen, at):
    """(displacement (k,) m, spindle angle (k,) rad) at the times `at` (k,), by the cubic between steps."""
    k = np.clip(np.searchsorted(times, at, side="right") - 1, 0, len(times) - 2)
    step = times[k + 1] - times[k]
    u = (at - times[k]) / step
    value = ((1 + 2 * u) * (1 - u) ** 2 * seen[0, k] + u * (1 - u) ** 2 * step * seen[1, k]
             + u * u * (3 - 2 * u) * seen[0, k + 1] + u * u * (u - 1) * step * seen[1, k + 1])
    return value, angles[k] + u * (angles[k + 1] - angles[k])
