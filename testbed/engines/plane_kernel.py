"""The motion of workpiece against tool, from the modes of the structure: one along the feed, or any number in the plane.

Where PLANAR, P holds behind the effects' parameters how many modes there are, and MODE_SIZE numbers for each: the unit vector
along which it moves, mass (kg), damping (N s/m), stiffness (N/m), and 1 where the tool carries it. Mode 0 has the places 0 and
1 of the state (coordinate, rate), mode j the places 1 + N_STATES + 2 j and the next. A state may be a slope as well: then what
is summed are rates of change.

PLANAR is a constant of the composed module, not a flag of a run: the kernels of a single mode along the feed hold no loop.
"""

from testbed.engines.compiled import inner
from testbed.engines.hooks import (
    GIVEN,
    N_PARAMETERS,
    N_STATES,
    PLANAR,
    hook_relative_displacement,
    hook_relative_displacement_y,
    hook_relative_velocity,
    hook_relative_velocity_y,
    hook_sensed_displacement,
    hook_sensed_displacement_y,
    hook_sensed_velocity,
    hook_sensed_velocity_y,
    hook_structure_force,
    hook_structure_force_y,
)

SHAPE_X, SHAPE_Y, MODE_MASS, MODE_DAMPING, MODE_STIFFNESS, ON_TOOL, MODE_SIZE = range(7)
COUNT, FIRST_MODE = N_PARAMETERS, N_PARAMETERS + 1  # places in P


@inner
def mode_place(mode):
    """Place of a mode's coordinate in the state."""
    return 0 if mode == 0 else 1 + N_STATES + 2 * mode


@inner
def along(P, Y, axis, order):
    """Sum over the modes of their displacements (order 0) or rates (order 1) along x (axis 0) or y (axis 1)."""
    total = 0.0
    for mode in range(int(P[COUNT])):
        total += P[FIRST_MODE + mode * MODE_SIZE + axis] * Y[mode_place(mode) + order]
    return total


@inner
def carried_by(P, Y, axis, order, tool):
    """`along` over the modes that the tool (1) or the workpiece (0) carries, as a sensor there sees them.

    The tool moves against the sum: what opens the chip for the workpiece closes it for the tool.
    """
    total = 0.0
    for mode in range(int(P[COUNT])):
        at = FIRST_MODE + mode * MODE_SIZE
        if P[at + ON_TOOL] == tool:
            total += P[at + axis] * Y[mode_place(mode) + order]
    return -total if tool == 1.0 else total


@inner
def structure_x(P, Y):
    """Displacement along the feed of the structure's own modes, m."""
    return along(P, Y, 0, 0) if PLANAR and not GIVEN else Y[0]


@inner
def structure_vx(P, Y):
    """Velocity along the feed of the structure's own modes, m/s."""
    return along(P, Y, 0, 1) if PLANAR and not GIVEN else Y[1]


@inner
def structure_y(P, Y):
    """Displacement across the feed of the structure's own modes, m."""
    return Y[3] if GIVEN else along(P, Y, 1, 0) if PLANAR else 0.0


@inner
def structure_vy(P, Y):
    """Velocity across the feed of the structure's own modes, m/s."""
    return Y[4] if GIVEN else along(P, Y, 1, 1) if PLANAR else 0.0


@inner
def position_at_cut(A, P, Y):
    """(x, y) of the workpiece against the tool, m."""
    x = structure_x(P, Y) + hook_relative_displacement(A, P, Y)
    return x, (structure_y(P, Y) + hook_relative_displacement_y(A, P, Y) if PLANAR else 0.0)


@inner
def velocity_at_cut(A, P, Y):
    """(x, y) of the velocity of the workpiece against the tool, m/s."""
    x = structure_vx(P, Y) + hook_relative_velocity(A, P, Y)
    return x, (structure_vy(P, Y) + hook_relative_velocity_y(A, P, Y) if PLANAR else 0.0)


@inner
def bounded(P, Y, limit):
    """Whether the structure has moved less than `limit` (m) along the feed and across it."""
    return abs(structure_x(P, Y)) < limit and abs(structure_y(P, Y)) < limit


@inner
def drive_structure(A, P, Y, D, force_x, force_y, mass, stiffness, damping):
    """Rates D of the structure's modes under the applied force and the effects' own; mass and so on: of the first mode."""
    own = hook_structure_force(A, P, Y, mass, stiffness, damping)
    if PLANAR:
        force_x += own
        force_y += hook_structure_force_y(A, P, Y, mass, stiffness, damping)
        for mode in range(int(P[COUNT])):
            at, place = FIRST_MODE + mode * MODE_SIZE, mode_place(mode)
            D[place] = Y[place + 1]
            D[place + 1] = (P[at + SHAPE_X] * force_x + P[at + SHAPE_Y] * force_y - P[at + MODE_DAMPING] * Y[place + 1]
                            - P[at + MODE_STIFFNESS] * Y[place]) / P[at + MODE_MASS]  # fmt: skip
    else:
        D[0] = Y[1]
        D[1] = (force_x + own - damping * Y[1] - stiffness * Y[0]) / mass


@inner
def sensed(A, P, Y, D):
    """(displacement, velocity, acceleration) along the feed of a sensor on the workpiece; D: slope of the state Y."""
    if PLANAR:
        return (carried_by(P, Y, 0, 0, 0.0) + hook_sensed_displacement(A, P, Y),
                carried_by(P, Y, 0, 1, 0.0) + hook_sensed_velocity(A, P, Y),
                carried_by(P, D, 0, 1, 0.0) + hook_sensed_velocity(A, P, D))  # fmt: skip
    return (Y[0] + hook_sensed_displacement(A, P, Y), Y[1] + hook_sensed_velocity(A, P, Y),
            D[1] + hook_sensed_velocity(A, P, D))  # fmt: skip


@inner
def sensed_across(A, P, Y, D):
    """The same across the feed."""
    return (carried_by(P, Y, 1, 0, 0.0) + hook_sensed_displacement_y(A, P, Y),
            carried_by(P, Y, 1, 1, 0.0) + hook_sensed_velocity_y(A, P, Y),
            carried_by(P, D, 1, 1, 0.0) + hook_sensed_velocity_y(A, P, D))  # fmt: skip


@inner
def sensed_on_tool(P, Y, D, axis):
    """(displacement, velocity, acceleration) of a sensor on the tool along x (axis 0) or y (axis 1)."""
    return carried_by(P, Y, axis, 0, 1.0), carried_by(P, Y, axis, 1, 1.0), carried_by(P, D, axis, 1, 1.0)
