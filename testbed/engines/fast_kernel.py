"""The fast engine's integration: fourth order in the spindle angle, on a grid that holds entry and exit.

A tooth pitch is one segment with the leading tooth in the cut and one without; each has equal steps in angle. At a steady
speed the scheme is the exponential Runge-Kutta of Lawson (1967, SIAM J. Numer. Anal. 4, 372): the damped oscillator is
carried by its exact map, only the rest is integrated, so that long free vibration costs no phase. At a varying speed it is
the classical scheme in the angle. Where no tooth cuts and the structure is linear, one exact map replaces the steps.
"""

import math

import numpy as np
from numba import njit

from testbed.engines.hooks import N_STATES, hook_sensed_displacement, hook_sensed_velocity
from testbed.engines.loop_kernel import (
    DAMPING,
    MASS,
    OMEGA,
    PITCH,
    SLICES,
    SPLIT,
    STIFFNESS,
    T_ENTRY,
    cutting_force,
    derivative,
    first_surface,
    leave_surface,
    spindle_speed,
)

# integer settings of one run
N_A, N_B, TEETH_A, TEETH_B, IDLE, CUT, RING_DOWN, LINEAR, STATES_ON, STEADY_SPEED, I_SIZE = range(11)
# what is sampled
SENSED_X, SENSED_V, SENSED_A, FORCE_X, FORCE_Y, ANGLE, N_CHANNELS = range(7)
OUTCOME_OK, OUTCOME_DIVERGED = 0, 1


@njit
def free_map(G, dt):
    """Exact state-transition matrix of the damped oscillator over dt, row by row."""
    omega2 = G[STIFFNESS] / G[MASS]
    decay = 0.5 * G[DAMPING] / G[MASS]
    omega_d = math.sqrt(omega2 - decay * decay)
    c, s, e = math.cos(omega_d * dt), math.sin(omega_d * dt) / omega_d, math.exp(-decay * dt)
    return e * (c + decay * s), e * s, -e * omega2 * s, e * (c - decay * s)


@njit
def sample_step(
    A,
    P,
    G,
    clock,
    wanted,
    Y0,
    D0,
    Y1,
    D1,
    angle0,
    angle1,
    pass_number,
    teeth,
    s0,
    sm,
    s1,
    phase0,
    phase1,
    cutting,
    out,
    position,
    scratch,
    surface,
):
    """Fill the samples that fall into one step by cubic Hermite interpolation in time; return the next sample."""
    start, rate = clock[0], clock[1]
    dt = Y1[2] - Y0[2]
    count = out.shape[1]
    x0, v0 = Y0[0] + hook_sensed_displacement(A, P, Y0), Y0[1] + hook_sensed_velocity(A, P, Y0)
    x1, v1 = Y1[0] + hook_sensed_displacement(A, P, Y1), Y1[1] + hook_sensed_velocity(A, P, Y1)
    a0, a1 = D0[1] + hook_sensed_velocity(A, P, D0), D1[1] + hook_sensed_velocity(A, P, D1)
    w0, w1 = spindle_speed(A, P, G, Y0), spindle_speed(A, P, G, Y1)
    while position < count:
        t = start + position / rate
        if t > Y1[2]:
            break
        u = (t - Y0[2]) / dt
        h10, h01 = u * (1.0 - u) ** 2, u * u * (3.0 - 2.0 * u)
        h11 = u * u * (u - 1.0)
        out[SENSED_X, position] = (1.0 - h01) * x0 + h01 * x1 + dt * (h10 * v0 + h11 * v1)
        out[SENSED_V, position] = (1.0 - h01) * v0 + h01 * v1 + dt * (h10 * a0 + h11 * a1)
        out[SENSED_A, position] = (
            6.0 * u * (1.0 - u) * (v1 - v0) / dt + (1.0 - u) * (1.0 - 3.0 * u) * a0 + u * (3.0 * u - 2.0) * a1
        )
        out[ANGLE, position] = angle0 + h01 * (angle1 - angle0) + dt * (h10 * w0 + h11 * w1)
        if wanted[FORCE_X] and cutting:
            for place in range(Y0.shape[0]):
                scratch[place] = (1.0 - h01) * Y0[place] + h01 * Y1[place] + dt * (h10 * D0[place] + h11 * D1[place])
            scratch[2] = t
            for edge in range(teeth * int(G[SLICES])):
                surface[edge] = (
                    s0[edge] * (1.0 - u) * (1.0 - 2.0 * u) + sm[edge] * 4.0 * u * (1.0 - u) + s1[edge] * u * (2.0 * u - 1.0)
                )
            fx, fy, torque = cutting_force(A, P, G, scratch, phase0 + u * (phase1 - phase0), pass_number, teeth, surface)
            out[FORCE_X, position] = fx
            out[FORCE_Y, position] = fy
        else:
            out[FORCE_X, position] = 0.0
            out[FORCE_Y, position] = 0.0
        position += 1
    return position


@njit
def sample_flight(G, clock, Y, dt, angle0, span, w0, w1, out, position):
    """Fill the samples of an exact free flight of length dt that starts in state Y; return the next sample.

    The spindle turns by `span` from angle0, at the speed w0 first and w1 last.
    """
    start, rate = clock[0], clock[1]
    count = out.shape[1]
    first = start + position / rate
    if position >= count or first > Y[2] + dt:
        return position
    omega2, twice_decay = G[STIFFNESS] / G[MASS], G[DAMPING] / G[MASS]
    a, b, c, d = free_map(G, first - Y[2])
    x, v = a * Y[0] + b * Y[1], c * Y[0] + d * Y[1]
    a, b, c, d = free_map(G, 1.0 / rate)
    while position < count:
        t = start + position / rate
        if t > Y[2] + dt:
            break
        out[SENSED_X, position] = x
        out[SENSED_V, position] = v
        out[SENSED_A, position] = -omega2 * x - twice_decay * v
        out[FORCE_X, position] = 0.0
        out[FORCE_Y, position] = 0.0
        u = (t - Y[2]) / dt if dt > 0.0 else 0.0
        out[ANGLE, position] = angle0 + u * u * (3.0 - 2.0 * u) * span + dt * u * (1.0 - u) * ((1.0 - u) * w0 - u * w1)
        x, v = a * x + b * v, c * x + d * v
        position += 1
    return position


@njit
def slope(A, P, G, Y, D, phase, pass_number, teeth, surface, mean_torque):
    """Time derivative of the state with the teeth at `phase`; returns the spindle speed and the torque."""
    torque = 0.0
    force = 0.0
    if teeth > 0:
        force, across, torque = cutting_force(A, P, G, Y, phase, pass_number, teeth, surface)
    derivative(A, P, G, Y, D, force, mean_torque)
    return spindle_speed(A, P, G, Y), torque


@njit
def advance(A, P, G, I, Y, D0, torque0, speed0, Y1, stages, W, span, phase, pass_number, teeth, s0, sm, s1, mean_torque):
    """One step of `span` rad from Y to Y1; D0, torque0 and speed0 belong to Y. Returns the torque's time integral.

    In the steady case N is the derivative less the linear oscillator's, and E, H its exact maps over the whole and the
    half step; else N is the whole derivative and the maps are the identity.
    """
    N1, N2, N3, N4 = stages[0], stages[1], stages[2], stages[3]
    used = 3 + (N_STATES if I[STATES_ON] else 0)
    steady = I[STEADY_SPEED] != 0
    h1 = span / speed0
    e00, e01, e10, e11 = 1.0, 0.0, 0.0, 1.0
    f00, f01, f10, f11 = 1.0, 0.0, 0.0, 1.0
    pull, drag = 0.0, 0.0
    if steady:
        e00, e01, e10, e11 = free_map(G, h1)
        f00, f01, f10, f11 = free_map(G, 0.5 * h1)
        pull, drag = G[STIFFNESS] / G[MASS], G[DAMPING] / G[MASS]
    N1[:used] = D0[:used]
    if steady:
        N1[0], N1[1] = 0.0, D0[1] + pull * Y[0] + drag * Y[1]
    for i in range(2, used):
        W[i] = Y[i] + 0.5 * h1 * N1[i]
    a, b = Y[0] + 0.5 * h1 * N1[0], Y[1] + 0.5 * h1 * N1[1]
    W[0], W[1] = f00 * a + f01 * b, f10 * a + f11 * b

    speed, torque2 = slope(A, P, G, W, N2, phase + 0.5 * span, pass_number, teeth, sm, mean_torque)
    if steady:
        N2[0], N2[1] = 0.0, N2[1] + pull * W[0] + drag * W[1]
    h2 = span / speed
    for i in range(2, used):
        W[i] = Y[i] + 0.5 * h2 * N2[i]
    W[0] = f00 * Y[0] + f01 * Y[1] + 0.5 * h2 * N2[0]
    W[1] = f10 * Y[0] + f11 * Y[1] + 0.5 * h2 * N2[1]

    speed, torque3 = slope(A, P, G, W, N3, phase + 0.5 * span, pass_number, teeth, sm, mean_torque)
    if steady:
        N3[0], N3[1] = 0.0, N3[1] + pull * W[0] + drag * W[1]
    h3 = span / speed
    for i in range(2, used):
        W[i] = Y[i] + h3 * N3[i]
    W[0] = e00 * Y[0] + e01 * Y[1] + h3 * (f00 * N3[0] + f01 * N3[1])
    W[1] = e10 * Y[0] + e11 * Y[1] + h3 * (f10 * N3[0] + f11 * N3[1])

    speed, torque4 = slope(A, P, G, W, N4, phase + span, pass_number, teeth, s1, mean_torque)
    if steady:
        N4[0], N4[1] = 0.0, N4[1] + pull * W[0] + drag * W[1]
    h4 = span / speed
    for i in range(2, used):
        Y1[i] = Y[i] + (h1 * N1[i] + 2.0 * (h2 * N2[i] + h3 * N3[i]) + h4 * N4[i]) / 6.0
    a, b = Y[0] + h1 * N1[0] / 6.0, Y[1] + h1 * N1[1] / 6.0
    c, d = (h2 * N2[0] + h3 * N3[0]) / 3.0, (h2 * N2[1] + h3 * N3[1]) / 3.0
    Y1[0] = e00 * a + e01 * b + f00 * c + f01 * d + h4 * N4[0] / 6.0
    Y1[1] = e10 * a + e11 * b + f10 * c + f11 * d + h4 * N4[1] / 6.0
    return (h1 * torque0 + 2.0 * (h2 * torque2 + h3 * torque3) + h4 * torque4) / 6.0


@njit
def fly(A, P, G, I, Y, W, clock, steps, span, angle, out, position):
    """Cross a segment in which nothing cuts a linear structure, exactly; return the next sample."""
    parts = 1 if I[STEADY_SPEED] else steps
    turn = steps * span / parts
    for part in range(parts):
        w0 = spindle_speed(A, P, G, Y)
        w1 = w0
        dt = turn / w0
        if not I[STEADY_SPEED]:  # only the time it takes is integrated
            W[:] = Y
            W[2] = Y[2] + 0.5 * dt
            k2 = turn / spindle_speed(A, P, G, W)
            W[2] = Y[2] + 0.5 * k2
            k3 = turn / spindle_speed(A, P, G, W)
            W[2] = Y[2] + k3
            k4 = turn / spindle_speed(A, P, G, W)
            dt = (dt + 2.0 * k2 + 2.0 * k3 + k4) / 6.0
            W[2] = Y[2] + dt
            w1 = spindle_speed(A, P, G, W)
        position = sample_flight(G, clock, Y, dt, angle + part * turn, turn, w0, w1, out, position)
        a, b, c, d = free_map(G, dt)
        Y[0], Y[1] = a * Y[0] + b * Y[1], c * Y[0] + d * Y[1]
        Y[2] += dt
    return position


@njit
def cross_segment(
    A,
    P,
    G,
    I,
    Y,
    S,
    row0,
    steps,
    span,
    base,
    angle,
    pass_number,
    teeth,
    first,
    mean_torque,
    clock,
    wanted,
    limit,
    out,
    position,
    work,
    pending,
):
    """Step through one segment of a pass, reading the surface S and leaving a new one behind.

    Row 2k of S is the surface at step k, row 2k+1 at its middle. The row at a step's end is still to be read by the next
    step, so what was left there waits in `pending`. Returns (next sample, torque's time integral, still bounded).
    """
    Y1, W, D0, D1, column = work[0], work[1], work[2], work[3], work[8]
    used = 3 + (N_STATES if I[STATES_ON] else 0)
    impulse = 0.0
    speed0, torque0 = slope(A, P, G, Y, D0, base, pass_number, teeth, S[row0], mean_torque)
    for step in range(steps):
        row, phase = row0 + 2 * step, base + step * span
        after = phase + span
        impulse += advance(
            A,
            P,
            G,
            I,
            Y,
            D0,
            torque0,
            speed0,
            Y1,
            work[4:8],
            W,
            span,
            phase,
            pass_number,
            teeth,
            S[row],
            S[row + 1],
            S[row + 2],
            mean_torque,
        )
        if not abs(Y1[0]) < limit:
            return position, impulse, False
        speed1, torque1 = slope(A, P, G, Y1, D1, after, pass_number, teeth, S[row + 2], mean_torque)
        position = sample_step(
            A,
            P,
            G,
            clock,
            wanted,
            Y,
            D0,
            Y1,
            D1,
            angle + phase,
            angle + after,
            pass_number,
            teeth,
            S[row],
            S[row + 1],
            S[row + 2],
            phase,
            after,
            teeth > 0,
            out,
            position,
            W,
            column,
        )
        if teeth > 0:
            if first and step == 0:
                leave_surface(A, P, G, Y, phase, pass_number, teeth, S[row], S[row])
            else:
                S[row, :] = pending
            for i in range(used):  # Hermite in the angle: the state at the middle of the step
                W[i] = 0.5 * (Y[i] + Y1[i]) + 0.125 * span * (D0[i] / speed0 - D1[i] / speed1)
            leave_surface(A, P, G, W, phase + 0.5 * span, pass_number, teeth, S[row + 1], S[row + 1])
            pending[:] = S[row + 2]
            leave_surface(A, P, G, Y1, after, pass_number, teeth, S[row + 2], pending)
        Y[:used] = Y1[:used]
        D0[:used] = D1[:used]
        speed0, torque0 = speed1, torque1
    return position, impulse, True


@njit
def run_one(A, P, G, I, Y, durations, clock, wanted, limit, out, pass_times, pass_states):
    """Integrate one test. Y is the state at time 0 and is advanced in place.

    durations (passes,) are the measured times of the tooth passes, or empty at the nominal speed. out (channels, samples),
    pass_times (passes + 1,) and pass_states (passes + 1, 2) are filled; a diverged run leaves NaN behind the point where
    it stopped. Returns (outcome, time it stopped).
    """
    n_a, n_b, linear = I[N_A], I[N_B], I[LINEAR] != 0
    edges = max(1, I[TEETH_A] * int(G[SLICES]))
    rows = 2 * (n_a + n_b) + 1
    S = np.zeros((rows, edges))
    pending = np.zeros(edges)
    work = np.zeros((9, max(Y.shape[0], edges)))
    step_a = G[SPLIT] / n_a
    step_b = (G[PITCH] - G[SPLIT]) / n_b if n_b > 0 else 0.0
    position, mean_torque, start = 0, 0.0, Y[2]
    out[:, :] = np.nan
    pass_times[:] = np.nan
    pass_states[:, :] = np.nan
    pass_times[0], pass_states[0, 0], pass_states[0, 1] = Y[2], Y[0], Y[1]
    for number in range(I[IDLE] + I[CUT] + I[RING_DOWN]):
        pass_number = number - I[IDLE]
        cutting = 0 <= pass_number < I[CUT]
        angle = pass_number * G[PITCH]
        if durations.shape[0] > 0:
            G[OMEGA] = G[PITCH] / durations[number]
        if cutting and pass_number == 0:
            G[T_ENTRY] = Y[2]
            for row in range(rows):
                phase = 0.5 * row * step_a if row <= 2 * n_a else G[SPLIT] + (0.5 * row - n_a) * step_b
                first_surface(A, P, G, work[1, : Y.shape[0]], phase, I[TEETH_A], Y[2] + phase / G[OMEGA], S[row])
        impulse = 0.0
        for segment in range(2):
            steps, span = (n_a, step_a) if segment == 0 else (n_b, step_b)
            base, row0 = (0.0, 0) if segment == 0 else (G[SPLIT], 2 * n_a)
            teeth = 0
            if cutting:
                teeth = I[TEETH_A] if segment == 0 else I[TEETH_B]
            if steps == 0:
                continue
            if teeth == 0 and linear:
                position = fly(A, P, G, I, Y, work[1, : Y.shape[0]], clock, steps, span, angle + base, out, position)
                continue
            position, load, bounded = cross_segment(
                A,
                P,
                G,
                I,
                Y,
                S,
                row0,
                steps,
                span,
                base,
                angle,
                pass_number,
                teeth,
                segment == 0,
                mean_torque,
                clock,
                wanted,
                limit,
                out,
                position,
                work,
                pending,
            )
            impulse += load
            if not bounded:
                out[:, position:] = np.nan
                return OUTCOME_DIVERGED, Y[2]
            if teeth > 0 and (segment == 1 or n_b == 0 or I[TEETH_B] == 0):
                S[row0 + 2 * steps, :] = pending
        if durations.shape[0] > 0:
            Y[2] = pass_times[number] + durations[number]
        elif I[STEADY_SPEED]:  # the clock does not gather rounding
            Y[2] = start + (number + 1) * G[PITCH] / G[OMEGA]
        mean_torque = impulse / (Y[2] - pass_times[number])
        pass_times[number + 1], pass_states[number + 1, 0], pass_states[number + 1, 1] = Y[2], Y[0], Y[1]
    return OUTCOME_OK, np.nan


@njit(nogil=True, cache=True)
def run_batch(A, P, G, I, Y, durations, clock, wanted, limit, out, pass_times, pass_states, outcome, outcome_time):
    """run_one over the first axis of every array."""
    for run in range(G.shape[0]):
        outcome[run], outcome_time[run] = run_one(
            A[run],
            P[run],
            G[run],
            I[run],
            Y[run],
            durations[run],
            clock[run],
            wanted,
            limit,
            out[run],
            pass_times[run],
            pass_states[run],
        )
