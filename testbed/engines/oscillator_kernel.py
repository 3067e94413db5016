"""Damped oscillators carried exactly: the structure, and those states of effects that are oscillators themselves.

    p' = r,    r' = -pull p - drag r + rest

A row of O is one of them: place of p in the state (r is the next), pull (1/s^2), drag (1/s). The maps over a time h,

    [p, r] -> [[m0, m1], [m2, m3]] [p, r],

are four numbers a row. Only `rest` is left to the integrator (Lawson 1967, SIAM J. Numer. Anal. 4, 372).
"""

import math

from testbed.engines.compiled import inner

PLACE, PULL, DRAG, O_SIZE = range(4)


@inner
def oscillator_map(pull, drag, dt):
    """Exact state-transition matrix of an underdamped oscillator over dt, row by row."""
    decay = 0.5 * drag
    omega_d = math.sqrt(pull - decay * decay)
    c, s, e = math.cos(omega_d * dt), math.sin(omega_d * dt) / omega_d, math.exp(-decay * dt)
    return e * (c + decay * s), e * s, -e * pull * s, e * (c - decay * s)


@inner
def set_maps(O, dt, E):
    """The maps of every row of O over dt, into E (rows, 4)."""
    for row in range(O.shape[0]):
        E[row, 0], E[row, 1], E[row, 2], E[row, 3] = oscillator_map(O[row, PULL], O[row, DRAG], dt)


@inner
def set_half_and_whole(O, dt, H, E):
    """The maps over half of dt, into H, and their squares, into E."""
    for row in range(O.shape[0]):
        a, b, c, d = oscillator_map(O[row, PULL], O[row, DRAG], 0.5 * dt)
        H[row, 0], H[row, 1], H[row, 2], H[row, 3] = a, b, c, d
        E[row, 0], E[row, 1], E[row, 2], E[row, 3] = a * a + b * c, b * (a + d), c * (a + d), b * c + d * d


@inner
def carry(O, E, Y):
    """Y after the time of the maps E, in place."""
    for row in range(O.shape[0]):
        p = int(O[row, PLACE])
        position, rate = Y[p], Y[p + 1]
        Y[p] = E[row, 0] * position + E[row, 1] * rate
        Y[p + 1] = E[row, 2] * position + E[row, 3] * rate


@inner
def free_slope(O, Y, D):
    """Rates D of the oscillators in Y left to themselves."""
    for row in range(O.shape[0]):
        p = int(O[row, PLACE])
        D[p], D[p + 1] = Y[p + 1], -O[row, PULL] * Y[p] - O[row, DRAG] * Y[p + 1]


@inner
def add_course(out, row, position, stop, q, r, tick, of_q, of_r):
    """Add of_q q + of_r r to a row's samples from `position` to `stop`, of a mode in free flight at q (m) and r (m/s) at first.

    tick: its map from a sample to the next. Four samples go forward side by side, since each step waits for the one before it.
    """
    a, b, c, d = tick
    q1, r1 = a * q + b * r, c * q + d * r
    q2, r2 = a * q1 + b * r1, c * q1 + d * r1
    q3, r3 = a * q2 + b * r2, c * q2 + d * r2
    a, b, c, d = a * a + b * c, b * (a + d), c * (a + d), b * c + d * d
    a, b, c, d = a * a + b * c, b * (a + d), c * (a + d), b * c + d * d
    place = position
    while place + 4 <= stop:
        out[row, place] += of_q * q + of_r * r
        out[row, place + 1] += of_q * q1 + of_r * r1
        out[row, place + 2] += of_q * q2 + of_r * r2
        out[row, place + 3] += of_q * q3 + of_r * r3
        q, r = a * q + b * r, c * q + d * r
        q1, r1 = a * q1 + b * r1, c * q1 + d * r1
        q2, r2 = a * q2 + b * r2, c * q2 + d * r2
        q3, r3 = a * q3 + b * r3, c * q3 + d * r3
        place += 4
    if place < stop:
        out[row, place] += of_q * q + of_r * r
    if place + 1 < stop:
        out[row, place + 1] += of_q * q1 + of_r * r1
    if place + 2 < stop:
        out[row, place + 2] += of_q * q2 + of_r * r2


@inner
def pair_at_stage(H, E, row, a, b, k, l, stage):
    """Where the oscillator of a row stands at a stage: (a, b) at the step's start, (k, l) what the stage before adds."""
    if stage == 1:
        a, b = a + 0.5 * k, b + 0.5 * l
        return H[row, 0] * a + H[row, 1] * b, H[row, 2] * a + H[row, 3] * b
    if stage == 2:
        return H[row, 0] * a + H[row, 1] * b + 0.5 * k, H[row, 2] * a + H[row, 3] * b + 0.5 * l
    return (E[row, 0] * a + E[row, 1] * b + H[row, 0] * k + H[row, 1] * l,
            E[row, 2] * a + E[row, 3] * b + H[row, 2] * k + H[row, 3] * l)  # fmt: skip


@inner
def pair_at_end(H, E, row, a, b, K, p):
    """Where the oscillator at place p of the state stands at the end of the step, from the four stages K (4, size)."""
    a, b = a + K[0, p] / 6.0, b + K[0, p + 1] / 6.0
    c, d = (K[1, p] + K[2, p]) / 3.0, (K[1, p + 1] + K[2, p + 1]) / 3.0
    return (E[row, 0] * a + E[row, 1] * b + H[row, 0] * c + H[row, 1] * d + K[3, p] / 6.0,
            E[row, 2] * a + E[row, 3] * b + H[row, 2] * c + H[row, 3] * d + K[3, p + 1] / 6.0)  # fmt: skip


@inner
def add_effects(O, plain, Y, D, dt, h, K, stage):
    """`increment` for the states of effects."""
    for row in range(1, O.shape[0]):
        p = int(O[row, PLACE])
        K[stage, p] = dt * D[p] - h * Y[p + 1]
        K[stage, p + 1] = dt * D[p + 1] + h * (O[row, PULL] * Y[p] + O[row, DRAG] * Y[p + 1])
    for place in plain:
        K[stage, place] = dt * D[place]


@inner
def move_effects(O, plain, H, E, Y, K, stage, W):
    """`stage_state` and `end_state` for the states of effects."""
    for row in range(1, O.shape[0]):
        p = int(O[row, PLACE])
        if stage == 4:
            W[p], W[p + 1] = pair_at_end(H, E, row, Y[p], Y[p + 1], K, p)
        else:
            W[p], W[p + 1] = pair_at_stage(H, E, row, Y[p], Y[p + 1], K[stage - 1, p], K[stage - 1, p + 1], stage)
    for place in plain:
        if stage == 4:
            W[place] = Y[place] + (K[0, place] + 2.0 * (K[1, place] + K[2, place]) + K[3, place]) / 6.0
        else:
            W[place] = Y[place] + (1.0 if stage == 3 else 0.5) * K[stage - 1, place]


@inner
def increment(O, plain, more, Y, D, dt, h, K, stage):
    """What one stage adds, K[stage]: rates D over dt, less the exactly carried part over h.

    Row 0 of O is the structure; plain: places of the other states of effects; more: whether effects have states at all.
    h is dt at a steady speed.
    """
    K[stage, 0] = dt * D[0] - h * Y[1]
    K[stage, 1] = dt * D[1] + h * (O[0, PULL] * Y[0] + O[0, DRAG] * Y[1])
    K[stage, 2] = dt
    if more:
        add_effects(O, plain, Y, D, dt, h, K, stage)


@inner
def stage_state(O, plain, more, H, E, Y, K, stage, W):
    """The state W at which stage 1, 2 or 3 asks for its slope, from Y and the stage before, K[stage - 1]."""
    W[0], W[1] = pair_at_stage(H, E, 0, Y[0], Y[1], K[stage - 1, 0], K[stage - 1, 1], stage)
    W[2] = Y[2] + (1.0 if stage == 3 else 0.5) * K[stage - 1, 2]
    if more:
        move_effects(O, plain, H, E, Y, K, stage, W)


@inner
def end_state(O, plain, more, H, E, Y, K, Y1):
    """The state Y1 at the end of the step, from Y and the four stages K (4, size)."""
    Y1[0], Y1[1] = pair_at_end(H, E, 0, Y[0], Y[1], K, 0)
    Y1[2] = Y[2] + (K[0, 2] + 2.0 * (K[1, 2] + K[2, 2]) + K[3, 2]) / 6.0
    if more:
        move_effects(O, plain, H, E, Y, K, 4, Y1)
