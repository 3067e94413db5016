"""Where nothing cuts and not all is carried exactly: the steps of `fast_kernel` without teeth, surface and torque."""

from testbed.engines.array_kernel import copy
from testbed.engines.compiled import inner
from testbed.engines.hooks import PLANAR, hook_structure_force
from testbed.engines.loop_kernel import DAMPING, HELD_UNTIL, MASS, STIFFNESS, derivative, spindle_speed
from testbed.engines.oscillator_kernel import DRAG, PULL, end_state, increment, set_half_and_whole, stage_state
from testbed.engines.plane_kernel import bounded
from testbed.engines.sampling_kernel import sample_step

ROUNDED = 1e-9  # of a step, that is no step of its own


@inner
def own_acceleration(A, P, G, Y):
    """Acceleration of the structure left to its own law, m/s^2."""
    own = hook_structure_force(A, P, Y, G[MASS], G[STIFFNESS], G[DAMPING])
    return (own - G[DAMPING] * Y[1] - G[STIFFNESS] * Y[0]) / G[MASS]


@inner
def held_share(A, P, G, work, span, speed):
    """Share of a step that is over when the structure is let go; the clock goes on over that, all else is as it is given."""
    Y, W, held, h = work[0], work[4], G[HELD_UNTIL] - work[0, 2], span / speed
    if held <= 0.0:
        return 0.0
    copy(Y, W)
    W[2] = Y[2] + 0.5 * h
    h = span / spindle_speed(A, P, G, W)
    share = 1.0 if held > (1.0 - ROUNDED) * h else held / h
    time = Y[2] + share * h
    copy(work[10], Y)
    Y[2] = time
    return share


@inner
def glide_alone(A, P, G, O, steady, work, maps, base, span, steps, angle, clock, limit, out, position):
    """`glide` where no effect has states, number for number: what is not read by a law stays out of memory."""
    Y, Y1, D0, D1, W = work[0], work[1], work[2], work[3], work[4]
    H, E, pull, drag = maps[0], maps[1], O[0, PULL], O[0, DRAG]
    x, v, t, a, speed0 = Y[0], Y[1], Y[2], own_acceleration(A, P, G, Y), spindle_speed(A, P, G, Y)
    for step in range(steps):
        held = held_share(A, P, G, work, span, speed0) if t < G[HELD_UNTIL] else 0.0
        if held > 0.0:
            x, v, t, a, speed0 = Y[0], Y[1], Y[2], own_acceleration(A, P, G, Y), spindle_speed(A, P, G, Y)
        if held == 1.0:
            continue
        phase, part = base + (step + held) * span, (1.0 - held) * span
        h = part / speed0
        if not steady or held > 0.0:
            set_half_and_whole(O, h, H, E)
        h00, h01, h10, h11 = H[0, 0], H[0, 1], H[0, 2], H[0, 3]
        e00, e01, e10, e11 = E[0, 0], E[0, 1], E[0, 2], E[0, 3]
        k0, l0 = h * v - h * v, h * a + h * (pull * x + drag * v)
        p, q = x + 0.5 * k0, v + 0.5 * l0
        W[0], W[1], W[2] = h00 * p + h01 * q, h10 * p + h11 * q, t + 0.5 * h
        dt1 = part / spindle_speed(A, P, G, W)
        k1, l1 = dt1 * W[1] - h * W[1], dt1 * own_acceleration(A, P, G, W) + h * (pull * W[0] + drag * W[1])
        W[0], W[1], W[2] = h00 * x + h01 * v + 0.5 * k1, h10 * x + h11 * v + 0.5 * l1, t + 0.5 * dt1
        dt2 = part / spindle_speed(A, P, G, W)
        k2, l2 = dt2 * W[1] - h * W[1], dt2 * own_acceleration(A, P, G, W) + h * (pull * W[0] + drag * W[1])
        W[0], W[1], W[2] = e00 * x + e01 * v + h00 * k2 + h01 * l2, e10 * x + e11 * v + h10 * k2 + h11 * l2, t + dt2
        dt3 = part / spindle_speed(A, P, G, W)
        k3, l3 = dt3 * W[1] - h * W[1], dt3 * own_acceleration(A, P, G, W) + h * (pull * W[0] + drag * W[1])
        p, q, c, d = x + k0 / 6.0, v + l0 / 6.0, (k1 + k2) / 3.0, (l1 + l2) / 3.0
        Y1[0] = e00 * p + e01 * q + h00 * c + h01 * d + k3 / 6.0
        Y1[1] = e10 * p + e11 * q + h10 * c + h11 * d + l3 / 6.0
        Y1[2] = t + (h + 2.0 * (dt1 + dt2) + dt3) / 6.0
        a1, speed1 = own_acceleration(A, P, G, Y1), spindle_speed(A, P, G, Y1)
        if not abs(Y1[0]) < limit:
            return position, False
        if position < out.shape[1] and clock[0] + position / clock[1] <= Y1[2]:
            D0[0], D0[1], D1[0], D1[1] = v, a, Y1[1], a1
            position = sample_step(A, P, G, clock, Y, D0, Y1, D1, angle + phase, angle + phase + part, speed0, speed1, out,
                                   position)  # fmt: skip
        Y[0], Y[1], Y[2] = Y1[0], Y1[1], Y1[2]
        x, v, t, a, speed0 = Y[0], Y[1], Y[2], a1, speed1
        if steady and held > 0.0:
            set_half_and_whole(O, span / speed0, H, E)
    return position, True


@inner
def glide(A, P, G, O, plain, steady, work, maps, base, span, steps, angle, clock, limit, out, position):
    """Step through a segment in which nothing cuts. Returns (next sample, still bounded)."""
    Y, Y1, D0, D1, W, D, K = work[0], work[1], work[2], work[3], work[4], work[5], work[6:10]
    H, E = maps[0], maps[1]
    more = O.shape[0] > 1 or plain.shape[0] > 0
    if not more and not PLANAR:
        return glide_alone(A, P, G, O, steady, work, maps, base, span, steps, angle, clock, limit, out, position)
    derivative(A, P, G, Y, D0, 0.0, 0.0, 0.0)
    speed0 = spindle_speed(A, P, G, Y)
    for step in range(steps):
        held = held_share(A, P, G, work, span, speed0)
        if held > 0.0:
            derivative(A, P, G, Y, D0, 0.0, 0.0, 0.0)
            speed0 = spindle_speed(A, P, G, Y)
        if held == 1.0:
            continue
        phase, part = base + (step + held) * span, (1.0 - held) * span
        h = part / speed0
        if not steady or held > 0.0:
            set_half_and_whole(O, h, H, E)
        increment(O, plain, more, Y, D0, h, h, K, 0)
        for stage in range(1, 4):
            stage_state(O, plain, more, H, E, Y, K, stage, W)
            derivative(A, P, G, W, D, 0.0, 0.0, 0.0)
            increment(O, plain, more, W, D, part / spindle_speed(A, P, G, W), h, K, stage)
        end_state(O, plain, more, H, E, Y, K, Y1)
        derivative(A, P, G, Y1, D1, 0.0, 0.0, 0.0)
        speed1 = spindle_speed(A, P, G, Y1)
        if not bounded(P, Y1, limit):
            return position, False
        if position < out.shape[1] and clock[0] + position / clock[1] <= Y1[2]:
            position = sample_step(A, P, G, clock, Y, D0, Y1, D1, angle + phase, angle + phase + part, speed0, speed1, out,
                                   position)  # fmt: skip
        for i in range(Y.shape[0]):
            Y[i], D0[i] = Y1[i], D1[i]
        speed0 = speed1
        if steady and held > 0.0:
            set_half_and_whole(O, span / speed0, H, E)
    return position, True
