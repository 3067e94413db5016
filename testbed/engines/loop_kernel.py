"""The regenerative loop at one instant: from the state and the surface to the force of every tooth in the cut.

Both engines call these functions; they share nothing else but the effects' contract. An edge is one axial point of
one tooth (a straight tooth has one); edge q * slices + s belongs to the tooth that entered q pitches ago. The surface
is remembered per edge at a fixed set of spindle angles within the tooth pitch, as the radial position left there one
tooth pass before; so the delay is an angle, right at any speed. Geometry and conditions come in one array G (the
constants below are its places).
"""

import math

import numpy as np

from testbed.engines.compiled import inner
from testbed.engines.hooks import (
    PLANAR,
    hook_chip,
    hook_derivatives,
    hook_edge_position,
    hook_engagement,
    hook_force_factor,
    hook_normal_force,
    hook_speed,
    hook_tangential_force,
)
from testbed.engines.plane_kernel import drive_structure, position_at_cut, velocity_at_cut

FLUTES, PITCH, RADIUS, ENTRY, ENGAGED, SLICES, SLICE_LAG, SLICE_DEPTH, KT, KN, FEED, FEED_SPEED, OMEGA, T_ENTRY, \
    LENGTH_BEFORE, FIRST_TOOTH, MASS, DAMPING, STIFFNESS, BEGIN, END, SLIDER, SLIDER_PULL, SLIDER_TRAVEL, HELD_UNTIL, \
    SWUNG_FRONT, CORNERS = range(27)
# A spring and a slider in series hold the structure where G[SLIDER], the place of the spring's deflection in the state, is not
# 0: the spring's stiffness over the mass (1/s^2), and the deflection (m) from which it slides.
# The state that a run begins with is that at the time G[HELD_UNTIL], s; the structure's motion before is nothing's.
# G[SWUNG_FRONT] is 1 where the first teeth meet what the swing before has left, 0 where they meet a straight front.
# The cut begins and ends G[BEGIN] and G[END] after the start of its first pass, rad; an engagement's travel counts from there.
# The pitch is cut into segments at the corners of the force; segment i runs from G[CORNERS + i] to G[CORNERS + i + 1].
MOST_SEGMENTS = 4
G_SIZE = CORNERS + MOST_SEGMENTS + 1

COVER, TURNED, THETA, SINE, COSINE, T_SIZE = range(6)  # what a table of the angles holds of an edge at a row

MOST_POINTS = 32
GAUSS_NODES, GAUSS_WEIGHTS = np.zeros((MOST_POINTS + 1, MOST_POINTS)), np.zeros((MOST_POINTS + 1, MOST_POINTS))
for _count in range(1, MOST_POINTS + 1):
    GAUSS_NODES[_count, :_count], GAUSS_WEIGHTS[_count, :_count] = np.polynomial.legendre.leggauss(_count)


@inner
def weights_in_cut(G, start, span):
    """What the force counts at the start, in the middle and at the end of a step of `span` from `start` (rad, both).

    1 within the cut, 0 outside it. A step in which the cut begins or ends has the weights with which Simpson's rule gives the
    force's moments of order 0 to 2 over the part in the cut: the kick is of the right size, at the right time.
    """
    if start >= G[BEGIN] - 1e-12 and start + span <= G[END] + 1e-12:
        return 1.0, 1.0, 1.0
    low = min(max((G[BEGIN] - start) / span, 0.0), 1.0)
    high = max(min((G[END] - start) / span, 1.0), low)
    first, second, third = high - low, (high**2 - low**2) / 2.0, (high**3 - low**3) / 3.0
    return 6.0 * first - 18.0 * second + 12.0 * third, 6.0 * (second - third), 12.0 * third - 6.0 * second


@inner
def piece_of_edge(G, phase, edge):
    """(weight as a share of SLICE_DEPTH, angle after entry) of one Gauss point of a tooth's part that is in the cut.

    A helical edge lags by SLICES * SLICE_LAG from tip to top. Its points move with the part in the cut, so that the
    integral over the depth has no jumps as the edge enters and leaves.
    """
    slices = int(G[SLICES])
    q = edge // slices
    return piece_of_tooth(G, phase + q * G[PITCH], edge - q * slices)


@inner
def piece_of_tooth(G, leading, point):
    """`piece_of_edge` of a tooth whose tip is so far after its entry (rad)."""
    slices = int(G[SLICES])
    lag = slices * G[SLICE_LAG]
    if lag == 0.0:
        return 1.0, leading
    low, high = max(leading - lag, 0.0), min(leading, G[ENGAGED])
    if high <= low:
        return 0.0, min(max(leading, 0.0), G[ENGAGED])
    turned = 0.5 * (high + low - (high - low) * GAUSS_NODES[slices, point])
    return 0.5 * slices * GAUSS_WEIGHTS[slices, point] * (high - low) / lag, turned


@inner
def radius_of_edge(A, P, G, Y, x, y, theta, sine, cosine, tooth):
    """`edge_radius` at a known angle, with the workpiece at (x, y): x along the feed, its travel included; m."""
    radial = x * sine + hook_edge_position(A, P, Y, tooth, G[FLUTES], G[RADIUS], theta)
    return radial + y * cosine if PLANAR else radial


@inner
def edge_radius(A, P, G, Y, theta, edge, pass_number):
    """Radial position of an edge beyond the nominal circle of a tool that does not feed, m."""
    tooth = (pass_number + int(G[FIRST_TOOTH]) - edge // int(G[SLICES])) % int(G[FLUTES])
    x, y = position_at_cut(A, P, Y)
    x += G[FEED_SPEED] * (Y[2] - G[T_ENTRY])
    return radius_of_edge(A, P, G, Y, x, y, theta, math.sin(theta), math.cos(theta), tooth)


@inner
def leave_surface(A, P, G, Y, phase, pass_number, teeth, old, new):
    """Radial positions the edges leave behind them at this instant; `old` is what they met, `new` may be `old`."""
    for edge in range(teeth * int(G[SLICES])):
        cover, turned = piece_of_edge(G, phase, edge)
        radial = edge_radius(A, P, G, Y, G[ENTRY] + turned, edge, pass_number)
        penetration = radial - old[edge]
        chip = hook_chip(A, P, penetration)
        new[edge] = radial if chip == penetration else old[edge] + chip


@inner
def force_of_edge(A, P, G, Y, at, moving, feed, cover, turned, theta, sine, cosine, met, tooth):
    """(tangential force, normal force, radial position left behind) of one edge that met the surface `met`; N, m.

    at, moving: `position_at_cut` and `velocity_at_cut`; feed: how far the workpiece has travelled besides, m.
    """
    radial = radius_of_edge(A, P, G, Y, feed + at[0], at[1], theta, sine, cosine, tooth)
    penetration = radial - met
    chip = hook_chip(A, P, penetration)
    if cover <= 0.0:
        return 0.0, 0.0, radial if chip == penetration else met + chip
    cutting_speed, length = G[RADIUS] * G[OMEGA], G[LENGTH_BEFORE] + feed
    depth = G[SLICE_DEPTH] * cover \
        * hook_engagement(A, P, Y, turned, G[ENGAGED], G[ENTRY], feed - G[FEED] * G[BEGIN] / G[PITCH], G[FEED], G[RADIUS])
    radial_velocity, velocity_along = moving[0] * sine, moving[0] * cosine
    if PLANAR:
        radial_velocity += moving[1] * cosine
        velocity_along -= moving[1] * sine
    factor = depth * chip * hook_force_factor(A, P, Y, chip, penetration, theta, radial_velocity, velocity_along,
                                              depth, cutting_speed, length, G[RADIUS], G[FEED], tooth)
    tangential = G[KT] * factor + hook_tangential_force(
        A, P, Y, chip, penetration, theta, radial_velocity, velocity_along, depth, cutting_speed, length, G[RADIUS], G[FEED],
        tooth)
    normal = G[KN] * factor + hook_normal_force(
        A, P, Y, chip, penetration, theta, radial_velocity, velocity_along, depth, cutting_speed, length, G[RADIUS], G[FEED],
        tooth)
    return tangential, normal, radial if chip == penetration else met + chip


@inner
def fill_row(G, T, row, phase):
    """What depends on the angle alone, for every edge: one row of T (rows, edges, 5)."""
    for edge in range(T.shape[1]):
        cover, turned = piece_of_edge(G, phase, edge)
        theta = G[ENTRY] + turned
        T[row, edge, COVER], T[row, edge, TURNED], T[row, edge, THETA] = cover, turned, theta
        T[row, edge, SINE], T[row, edge, COSINE] = math.sin(theta), math.cos(theta)


@inner
def force_at_row(A, P, G, Y, at, moving, T, row, S, left, left_row, tooth, edges):
    """(force along, across, torque) of all edges at a row, N and N m; left[left_row]: the surface left there.

    at, moving: `position_at_cut` and `velocity_at_cut`.
    """
    force, across, torque = 0.0, 0.0, 0.0
    feed = G[FEED_SPEED] * (Y[2] - G[T_ENTRY])
    for edge in range(edges):
        sine, cosine = T[row, edge, SINE], T[row, edge, COSINE]
        tangential, normal, radial = force_of_edge(
            A, P, G, Y, at, moving, feed, T[row, edge, COVER], T[row, edge, TURNED], T[row, edge, THETA], sine, cosine,
            S[row, edge], tooth[edge])  # fmt: skip
        left[left_row, edge] = radial
        force -= tangential * cosine + normal * sine
        if PLANAR:
            across += tangential * sine - normal * cosine
        torque += tangential * G[RADIUS]
    return force, across, torque


@inner
def cutting_force(A, P, G, Y, phase, pass_number, teeth, surface):
    """(F_x on the structure, F_y across the feed, torque on the spindle) of all edges, N and N m."""
    force_x, force_y, torque = 0.0, 0.0, 0.0
    at, moving = position_at_cut(A, P, Y), velocity_at_cut(A, P, Y)
    feed = G[FEED_SPEED] * (Y[2] - G[T_ENTRY])
    for edge in range(teeth * int(G[SLICES])):
        cover, turned = piece_of_edge(G, phase, edge)
        theta = G[ENTRY] + turned
        sine, cosine = math.sin(theta), math.cos(theta)
        tooth = (pass_number + int(G[FIRST_TOOTH]) - edge // int(G[SLICES])) % int(G[FLUTES])
        tangential, normal, left = force_of_edge(A, P, G, Y, at, moving, feed, cover, turned, theta, sine, cosine,
                                                 surface[edge], tooth)
        force_x -= tangential * cosine + normal * sine
        force_y += tangential * sine - normal * cosine
        torque += tangential * G[RADIUS]
    return force_x, force_y, torque


@inner
def derivative(A, P, G, Y, D, force_x, force_y, torque):
    """Time derivative D of the state Y under the applied force and torque: the structure's own law and the effects' states."""
    mass, damping, stiffness = G[MASS], G[DAMPING], G[STIFFNESS]
    drive_structure(A, P, Y, D, force_x, force_y, mass, stiffness, damping)
    D[2] = 1.0
    hook_derivatives(A, P, Y, D, force_x, force_y, torque, mass, stiffness, damping)


@inner
def spindle_speed(A, P, G, Y):
    """Spindle speed now, rad/s."""
    return G[OMEGA] * (1.0 + hook_speed(A, P, Y, G[OMEGA]))
