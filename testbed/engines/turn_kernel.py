"""The tables of a revolution under teeth of unequal pitch, and what the first of them meet; see `uneven_kernel`.

V holds of each tooth where in the revolution it enters, and the angle by which it follows the one before (rad, both). Row 2k of
a segment is its step k, row 2k + 1 the middle. Within a segment only edges in the cut are counted, tooth by tooth.
"""

import math

from testbed.engines.array_kernel import fill
from testbed.engines.compiled import inner
from testbed.engines.front_kernel import FINE, plane_swing_before, time_before
from testbed.engines.hooks import hook_chip
from testbed.engines.loop_kernel import (
    COSINE,
    COVER,
    ENGAGED,
    ENTRY,
    FEED_SPEED,
    FIRST_TOOTH,
    PITCH,
    SINE,
    SLICE_LAG,
    SLICES,
    SWUNG_FRONT,
    THETA,
    TURNED,
    piece_of_tooth,
    radius_of_edge,
)
from testbed.engines.plane_kernel import position_at_cut

ENTERS, FOLLOWS = 0, 1
NUDGE = 1e-6  # of the way to the middle of its segment, by which a row at a corner is on its own side of it
TURN = 2.0 * math.pi


@inner
def leading_angle(V, tooth, phase, middle):
    """Angle after its entry of a tooth's tip at a phase of the revolution, within a segment that has this middle."""
    return phase - V[tooth, ENTERS] - TURN * math.floor((middle - V[tooth, ENTERS]) / TURN)


@inner
def fill_grid(G, C, V, steps, rows, teeth, where, T, base, old, weight, tooth):
    """Tables of every row, for the teeth in the cut: angles T; from which row (base) and place (old) on a surface is read; how.

    rows (segments,): first row of each; teeth (segments,): how many are in the cut; where (segments, flutes): which place a
    tooth has among them, or -1; weight (rows, place, 4); tooth (segments, edges): the number a hook is told, in mean pitches.
    """
    slices, window = int(G[SLICES]), G[ENGAGED] + int(G[SLICES]) * G[SLICE_LAG]
    for segment in range(steps.shape[0]):
        middle, count = 0.5 * (C[segment] + C[segment + 1]), 0
        for one in range(V.shape[0]):
            where[segment, one] = -1
            if leading_angle(V, one, middle, middle) < window:
                where[segment, one] = count
                for point in range(slices):
                    tooth[segment, count * slices + point] = G[FIRST_TOOTH] + V[one, ENTERS] / G[PITCH]
                count += 1
        teeth[segment] = count
    for segment in range(steps.shape[0]):
        low, middle = C[segment], 0.5 * (C[segment] + C[segment + 1])
        half = (C[segment + 1] - low) / (2.0 * steps[segment])
        for one in range(V.shape[0]):
            place = where[segment, one]
            if place < 0:
                continue
            shift = V[one, FOLLOWS] if middle >= V[one, FOLLOWS] else V[one, FOLLOWS] - TURN
            before = one - 1 if one > 0 else V.shape[0] - 1
            for k in range(2 * steps[segment] + 1):
                row, phase = rows[segment] + k, low + k * half
                leading = leading_angle(V, one, phase, middle)
                for point in range(slices):
                    edge = place * slices + point
                    cover, turned = piece_of_tooth(G, leading, point)
                    theta = G[ENTRY] + turned
                    T[row, edge, COVER], T[row, edge, TURNED], T[row, edge, THETA] = cover, turned, theta
                    T[row, edge, SINE], T[row, edge, COSINE] = math.sin(theta), math.cos(theta)
                source = segment_of(C, phase - shift + NUDGE * (middle - phase))
                at = (phase - shift - C[source]) / (C[source + 1] - C[source]) * 2.0 * steps[source]
                first = min(max(int(math.floor(at)) - 1, 0), 2 * steps[source] - 3)
                base[row, place], old[row, place] = rows[source] + first, where[source, before]
                u = at - first
                weight[row, place, 0] = -(u - 1.0) * (u - 2.0) * (u - 3.0) / 6.0
                weight[row, place, 1] = 0.5 * u * (u - 2.0) * (u - 3.0)
                weight[row, place, 2] = -0.5 * u * (u - 1.0) * (u - 3.0)
                weight[row, place, 3] = u * (u - 1.0) * (u - 2.0) / 6.0


@inner
def segment_of(C, phase):
    """The segment in which a phase of the revolution lies."""
    found = 0
    while found + 2 < C.shape[0] and C[found + 1] <= phase:
        found += 1
    return found


@inner
def read_memory(M, base, weight, row, place, old):
    """What an edge meets at a row: what edge `old` left one pitch before, by the cubic through four rows."""
    first = base[row, place]
    return weight[row, place, 0] * M[first, old] + weight[row, place, 1] * M[first + 1, old] \
        + weight[row, place, 2] * M[first + 2, old] + weight[row, place, 3] * M[first + 3, old]


@inner
def meet(G, M, base, weight, old, row, teeth, S):
    """Into the row of S what the teeth in the cut meet there."""
    slices = int(G[SLICES])
    for place in range(teeth):
        for point in range(slices):
            edge = place * slices + point
            S[row, edge] = read_memory(M, base, weight, row, place, old[row, place] * slices + point)


@inner
def straight_front(A, P, G, C, steps, rows, teeth, tooth, old, T, base, weight, entry, steady, W, S, M):
    """Into the memory what rigid teeth have left in the revolution before the entry, and the swing; W is scratch.

    The first revolution knows no surface, the second meets what that has left: where contact can be lost, one of unequal teeth
    may fly over what others before it have cut.
    """
    fill(W, 0, 0.0)
    begun = entry[2]
    for turn in range(2, 0, -1):
        for segment in range(steps.shape[0]):
            half = (C[segment + 1] - C[segment]) / (2.0 * steps[segment])
            edges = teeth[segment] * int(G[SLICES])
            for k in range(2 * steps[segment] + 1 if edges > 0 else 0):
                row = rows[segment] + k
                fill(W, 0, 0.0)
                W[2] = time_before(A, P, G, W, steady, begun, TURN * turn - C[segment] - k * half, FINE)
                time = W[2]
                x, y = position_at_cut(A, P, W)
                x += G[FEED_SPEED] * (time - begun)
                if turn == 1:
                    meet(G, M, base, weight, old, row, teeth[segment], S)
                for edge in range(edges):
                    radial = radius_of_edge(A, P, G, W, x, y, T[row, edge, THETA], T[row, edge, SINE], T[row, edge, COSINE],
                                            tooth[segment, edge])  # fmt: skip
                    if turn == 1:
                        chip = hook_chip(A, P, radial - S[row, edge])
                        radial = radial if chip == radial - S[row, edge] else S[row, edge] + chip
                    M[row, edge] = radial
    if G[SWUNG_FRONT] == 0.0:
        return
    for segment in range(steps.shape[0]):
        half = (C[segment + 1] - C[segment]) / (2.0 * steps[segment])
        edges = teeth[segment] * int(G[SLICES])
        for k in range(2 * steps[segment] + 1 if edges > 0 else 0):
            row = rows[segment] + k
            fill(W, 0, 0.0)
            before = begun - time_before(A, P, G, W, steady, begun, TURN - C[segment] - k * half, FINE)
            x, y = plane_swing_before(P, entry, before)
            for edge in range(edges):
                M[row, edge] += x * T[row, edge, SINE] + y * T[row, edge, COSINE]
