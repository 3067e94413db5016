"""Modes in the plane that nothing but a force along x and y moves: carried exactly in free flight, summed, sampled.

modes (modes, 6) holds what `plane_kernel` says of each mode, Q (modes, 2) their coordinates (m) and rates (m/s).
"""

from testbed.engines.compiled import inner
from testbed.engines.fast_kernel import SEGMENTS, STEPS
from testbed.engines.oscillator_kernel import add_course, oscillator_map
from testbed.engines.plane_kernel import MODE_DAMPING, MODE_MASS, MODE_STIFFNESS, ON_TOOL, SHAPE_X, SHAPE_Y
from testbed.engines.sampling_kernel import quintic, samples_until

FORCES = 4  # row of `rows` behind the motions: where `out` has the forces along and across the feed


@inner
def rows_of(I):  # noqa: E741
    """Rows of a table over one tooth pass: the ends and middles of all steps, segment by segment."""
    size = 0
    for segment in range(I[SEGMENTS]):
        size += 2 * I[STEPS + segment] + 1
    return size


@inner
def fill_mode_maps(modes, dt, E):
    """The exact maps of every mode over dt (s), into E (modes, 4)."""
    for mode in range(modes.shape[0]):
        mass = modes[mode, MODE_MASS]
        a, b, c, d = oscillator_map(modes[mode, MODE_STIFFNESS] / mass, modes[mode, MODE_DAMPING] / mass, dt)
        E[mode, 0], E[mode, 1], E[mode, 2], E[mode, 3] = a, b, c, d


@inner
def carried_on(modes, Q, E, order):
    """(x, y) of all modes' coordinates (order 0, m) or rates (order 1, m/s) after the time of the maps E."""
    x, y = 0.0, 0.0
    for mode in range(modes.shape[0]):
        moved = E[mode, 2 * order] * Q[mode, 0] + E[mode, 2 * order + 1] * Q[mode, 1]
        x += modes[mode, SHAPE_X] * moved
        y += modes[mode, SHAPE_Y] * moved
    return x, y


@inner
def carry_modes(Q, E):
    """Q after the time of the maps E, in place."""
    for mode in range(Q.shape[0]):
        q, r = Q[mode, 0], Q[mode, 1]
        Q[mode, 0], Q[mode, 1] = E[mode, 0] * q + E[mode, 1] * r, E[mode, 2] * q + E[mode, 3] * r


@inner
def in_the_plane(modes, Q, order):
    """(x, y) of all modes' coordinates (order 0) or rates (order 1)."""
    x, y = 0.0, 0.0
    for mode in range(modes.shape[0]):
        x += modes[mode, SHAPE_X] * Q[mode, order]
        y += modes[mode, SHAPE_Y] * Q[mode, order]
    return x, y


@inner
def compliance(modes, F, column):
    """(xx, xy, yy): what a force of one newton a second long makes of all modes by a column of the maps F: m (1) or m/s (3)."""
    xx, xy, yy = 0.0, 0.0, 0.0
    for mode in range(modes.shape[0]):
        share = F[mode, column] / modes[mode, MODE_MASS]
        xx += share * modes[mode, SHAPE_X] * modes[mode, SHAPE_X]
        xy += share * modes[mode, SHAPE_X] * modes[mode, SHAPE_Y]
        yy += share * modes[mode, SHAPE_Y] * modes[mode, SHAPE_Y]
    return xx, xy, yy


@inner
def carry_under_force(modes, E, F, dt, Q, Q1, first_x, first_y, middle_x, middle_y, last_x, last_y):
    """Q1: Q after a step of dt by its maps E, those of half of it F, and the force (N) at its start, middle (times 4), end."""
    for mode in range(modes.shape[0]):
        along, across, part = modes[mode, SHAPE_X], modes[mode, SHAPE_Y], dt / (6.0 * modes[mode, MODE_MASS])
        first, last = along * first_x + across * first_y, along * last_x + across * last_y
        middle = along * middle_x + across * middle_y
        q, r = Q[mode, 0], Q[mode, 1]
        Q1[mode, 0] = E[mode, 0] * q + E[mode, 1] * r + part * (E[mode, 1] * first + F[mode, 1] * middle)
        Q1[mode, 1] = E[mode, 2] * q + E[mode, 3] * r + part * (E[mode, 3] * first + F[mode, 3] * middle + last)


@inner
def acceleration_of(modes, Q, mode, force_x, force_y):
    """Second derivative of a mode's coordinate under a force on the workpiece, m/s^2."""
    push = modes[mode, SHAPE_X] * force_x + modes[mode, SHAPE_Y] * force_y
    return (push - modes[mode, MODE_DAMPING] * Q[mode, 1] - modes[mode, MODE_STIFFNESS] * Q[mode, 0]) / modes[mode, MODE_MASS]


@inner
def acceleration_in_the_plane(modes, Q, force_x, force_y):
    """(x'', y'') of all modes under a force on the workpiece, m/s^2."""
    ax, ay = 0.0, 0.0
    for mode in range(modes.shape[0]):
        one = acceleration_of(modes, Q, mode, force_x, force_y)
        ax += modes[mode, SHAPE_X] * one
        ay += modes[mode, SHAPE_Y] * one
    return ax, ay


@inner
def is_asked(rows, group):
    """Whether anybody asks for displacement, velocity or acceleration along x, y on the workpiece (0, 1) or the tool (2, 3)."""
    return max(rows[group, 0], rows[group, 1], rows[group, 2]) >= 0


@inner
def fill_step(out, rows, group, clock, t0, dt, position, stop, ends):
    """The samples of one group that fall into a step; ends: displacement, velocity, acceleration at its start, at its end."""
    d0, v0, a0, d1, v1, a1 = ends
    for place in range(position, stop):
        moved, rising, bent = quintic((clock[0] + place / clock[1] - t0) / dt, dt, d0, v0, a0, d1, v1, a1)
        if rows[group, 0] >= 0:
            out[rows[group, 0], place] = moved
        if rows[group, 1] >= 0:
            out[rows[group, 1], place] = rising
        if rows[group, 2] >= 0:
            out[rows[group, 2], place] = bent


@inner
def sample_modes(modes, rows, clock, t0, dt, Q0, Q1, x0, y0, x1, y1, out, position):
    """Fill the samples that fall into a step from Q0 to Q1, under the forces (x0, y0) first and (x1, y1) last; the next one.

    rows (5, 3): where `out` has displacement, velocity and acceleration of each group of `is_asked`, -1 where nobody asks.
    """
    start, rate = clock[0], clock[1]
    if position >= out.shape[1] or start + position / rate > t0 + dt:
        return position
    stop = samples_until(start, rate, t0 + dt, position, out.shape[1])
    for part in range(2):
        along, across = is_asked(rows, 2 * part), is_asked(rows, 2 * part + 1)
        if not (along or across):
            continue
        dx0, vx0, ax0, dx1, vx1, ax1 = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
        dy0, vy0, ay0, dy1, vy1, ay1 = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
        for mode in range(modes.shape[0]):
            if modes[mode, ON_TOOL] == part:
                sign = 1.0 - 2.0 * part  # a shape is how the workpiece moves against the tool
                sx, sy = sign * modes[mode, SHAPE_X], sign * modes[mode, SHAPE_Y]
                a0, a1 = acceleration_of(modes, Q0, mode, x0, y0), acceleration_of(modes, Q1, mode, x1, y1)
                dx0, vx0, ax0 = dx0 + sx * Q0[mode, 0], vx0 + sx * Q0[mode, 1], ax0 + sx * a0
                dy0, vy0, ay0 = dy0 + sy * Q0[mode, 0], vy0 + sy * Q0[mode, 1], ay0 + sy * a0
                dx1, vx1, ax1 = dx1 + sx * Q1[mode, 0], vx1 + sx * Q1[mode, 1], ax1 + sx * a1
                dy1, vy1, ay1 = dy1 + sy * Q1[mode, 0], vy1 + sy * Q1[mode, 1], ay1 + sy * a1
        if along:
            fill_step(out, rows, 2 * part, clock, t0, dt, position, stop, (dx0, vx0, ax0, dx1, vx1, ax1))
        if across:
            fill_step(out, rows, 2 * part + 1, clock, t0, dt, position, stop, (dy0, vy0, ay0, dy1, vy1, ay1))
    return stop


@inner
def sample_free_modes(modes, rows, clock, t0, dt, Q, ticks, out, position):
    """Fill the samples of a free flight of length dt from Q at t0; return the next. ticks: maps from a sample to the next."""
    start, rate = clock[0], clock[1]
    begun = start + position / rate - t0
    if position >= out.shape[1] or start + position / rate > t0 + dt:
        return position
    stop = samples_until(start, rate, t0 + dt, position, out.shape[1])
    for group in range(4):
        for order in range(3):
            for place in range(position, stop if rows[group, order] >= 0 else position):
                out[rows[group, order], place] = 0.0
    for mode in range(modes.shape[0]):
        group = 2 * int(modes[mode, ON_TOOL])
        if not (is_asked(rows, group) or is_asked(rows, group + 1)):
            continue
        pull, drag = modes[mode, MODE_STIFFNESS] / modes[mode, MODE_MASS], modes[mode, MODE_DAMPING] / modes[mode, MODE_MASS]
        a, b, c, d = oscillator_map(pull, drag, begun)
        q, r = a * Q[mode, 0] + b * Q[mode, 1], c * Q[mode, 0] + d * Q[mode, 1]
        tick = (ticks[mode, 0], ticks[mode, 1], ticks[mode, 2], ticks[mode, 3])
        for axis in range(2):
            shape = modes[mode, axis] if group == 0 else -modes[mode, axis]
            for order in range(3):
                row = rows[group + axis, order]
                if row >= 0 and shape != 0.0:
                    of_q = shape if order == 0 else 0.0 if order == 1 else -shape * pull
                    of_r = 0.0 if order == 0 else shape if order == 1 else -shape * drag
                    add_course(out, row, position, stop, q, r, tick, of_q, of_r)
    return stop
