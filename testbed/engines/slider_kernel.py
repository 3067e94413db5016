"""Free flight in which all is carried exactly: by one map, or beside a spring and a slider in series, from event to event.

Stuck, the spring pulls beside the structure's own; sliding, its force is constant. So between a turning point and a
breakaway the structure is a linear oscillator about a point of its own, carried by its exact map. Where it turns follows
from its phase; where the spring breaks away between two turning points, by Newton's method on the monotone way there.
"""

import math

from testbed.engines.compiled import inner
from testbed.engines.loop_kernel import SLIDER, SLIDER_PULL, SLIDER_TRAVEL
from testbed.engines.oscillator_kernel import DRAG, PULL, carry, oscillator_map, set_maps
from testbed.engines.sampling_kernel import angle_between, sample_flight

NEWTON = 60  # iterations at the most: bisections, should every one of Newton's leave the bracket


@inner
def time_to_turn(pull, drag, x, v):
    """Time until the velocity of a free oscillator at (x, v) is next zero."""
    decay = 0.5 * drag
    omega_d = math.sqrt(pull - decay * decay)
    found = math.atan2(v * omega_d, pull * x + decay * v)
    return (found if found > 0.0 else found + math.pi) / omega_d


@inner
def time_to_reach(pull, drag, x, v, target, latest):
    """Time at which a free oscillator at (x, v), moving one way until `latest`, reaches a target that it then has passed."""
    low, high = 0.0, latest
    time = min((target - x) / v, 0.5 * latest) if v != 0.0 else 0.5 * latest
    rising = target > x
    for _ in range(NEWTON):
        a, b, c, d = oscillator_map(pull, drag, time)
        over, rate = a * x + b * v - target, c * x + d * v
        if (over > 0.0) == rising:
            high = time
        else:
            low = time
        step = over / rate if rate != 0.0 else math.inf
        before, time = time, time - step
        if not low < time < high:
            time = 0.5 * (low + high)
        if abs(time - before) <= 1e-15 * latest:
            break
    return time


@inner
def next_event(G, O, z, x, v, drag):
    """What holds until the next event: (pull, point about which it vibrates, sliding, time until then, whether it breaks away).

    z: the spring's deflection; x, v: the structure's displacement and velocity.
    """
    stiff, travel = G[SLIDER_PULL], G[SLIDER_TRAVEL]
    if abs(z) >= travel and z * v > 0.0:
        pull = O[0, PULL]
        middle = -math.copysign(stiff * travel, z) / pull
        return pull, middle, True, time_to_turn(pull, drag, x - middle, v), False
    pull = O[0, PULL] + stiff
    middle = stiff * (x - z) / pull
    y, decay = x - middle, 0.5 * drag
    reach = math.hypot(y, (v + decay * y) / math.sqrt(pull - decay * decay))
    if abs(z - y) + reach <= travel:
        return pull, middle, False, math.inf, False
    turn = time_to_turn(pull, drag, y, v)
    a, b, c, d = oscillator_map(pull, drag, turn)
    moved = a * y + b * v - y
    if abs(z + moved) <= travel:
        return pull, middle, False, turn, False
    target = y + math.copysign(travel, moved) - z
    return pull, middle, False, time_to_reach(pull, drag, y, v, target, turn), True


@inner
def drift(A, P, G, O, clock, Y, middle, dt, angle0, span, w0, w1, W, D, E, out, position):
    """Carry the state Y over dt by one map and fill its samples; return the next. The arguments: see `sample_flight`."""
    position = sample_flight(A, P, G, O, clock, Y, middle, dt, angle0, span, w0, w1, W, D, E, out, position)
    set_maps(O, dt, E)
    carry(O, E, Y)
    Y[2] += dt
    return position


@inner
def fly_exactly(A, P, G, O, clock, Y, dt, angle0, span, w0, w1, W, D, E, out, position):
    """Carry the state Y over a free flight of length dt and fill its samples; return the next. See `sample_flight`."""
    if G[SLIDER] == 0.0:
        return drift(A, P, G, O, clock, Y, 0.0, dt, angle0, span, w0, w1, W, D, E, out, position)
    place, travel, pull, drag = int(G[SLIDER]), G[SLIDER_TRAVEL], O[0, PULL], O[0, DRAG]
    Y[place] = min(max(Y[place], -travel), travel)  # steps in the cut may have carried it past by their error
    gone, angle, speed = 0.0, angle0, w0
    while gone < dt:
        held, middle, sliding, time, breaks = next_event(G, O, Y[place], Y[0], Y[1], drag)
        last = not gone + time < dt
        if last:
            time = dt - gone
        share = 1.0 if last else (gone + time) / dt
        angle1 = angle_between(share, dt, angle0, angle0 + span, w0, w1)
        speed1 = w0 + share * (w1 - w0)
        before = Y[0]
        O[0, PULL] = held
        Y[0] -= middle
        position = drift(A, P, G, O, clock, Y, middle, time, angle, angle1 - angle, speed, speed1, W, D, E, out, position)
        O[0, PULL] = pull
        Y[0] += middle
        if not sliding:
            Y[place] = min(max(Y[place] + Y[0] - before, -travel), travel)
            if breaks and not last:
                Y[place] = math.copysign(travel, Y[1])
        if not last and not breaks:
            Y[1] = 0.0
        gone, angle, speed = gone + time, angle1, speed1
        if last:
            break
    return position
