"""The places on the regenerative loop, as the base model leaves them: every hook contributes nothing.

The kernels are written against these names. `testbed.engines.compose` puts the catalogue's functions in their place.
A holds one flag per effect, P all effects' parameters, Y the state [q (m), q' (m/s), t (s), effects' states ...]: q is the
coordinate of the structure's first mode. PLANAR: whether the structure has more than one mode along the feed; the coordinates
of its further modes, and their rates, then stand behind all that in Y, and what the modes are behind all that in P (see
`plane_kernel`). GIVEN: whether the modes stay aside, and Y is [x, x', t, y, y'] of all of them together.
"""

from testbed.engines.compiled import inner

PLANAR, GIVEN, N_STATES, N_PARAMETERS = False, False, 0, 1


@inner
def hook_edge_position(A, P, Y, tooth, flutes, radius, angle):
    return 0.0


@inner
def hook_relative_displacement(A, P, Y):
    return 0.0


@inner
def hook_relative_velocity(A, P, Y):
    return 0.0


@inner
def hook_relative_displacement_y(A, P, Y):
    return 0.0


@inner
def hook_relative_velocity_y(A, P, Y):
    return 0.0


@inner
def hook_engagement(A, P, Y, phase, engagement_angle, entry_angle, feed_travel, feed_per_tooth, radius):
    return 1.0


@inner
def hook_chip(A, P, penetration):
    return penetration


@inner
def hook_force_factor(A, P, Y, chip, penetration, angle, edge_velocity, edge_velocity_along, depth, cutting_speed,
                      length_cut, radius, feed_per_tooth, tooth):
    return 1.0


@inner
def hook_tangential_force(A, P, Y, chip, penetration, angle, edge_velocity, edge_velocity_along, depth, cutting_speed,
                          length_cut, radius, feed_per_tooth, tooth):
    return 0.0


@inner
def hook_normal_force(A, P, Y, chip, penetration, angle, edge_velocity, edge_velocity_along, depth, cutting_speed,
                      length_cut, radius, feed_per_tooth, tooth):
    return 0.0


@inner
def hook_structure_force(A, P, Y, mass, stiffness, damping):
    return 0.0


@inner
def hook_structure_force_y(A, P, Y, mass, stiffness, damping):
    return 0.0


@inner
def hook_derivatives(A, P, Y, D, applied_force, applied_force_y, torque, mass, stiffness, damping):
    """Write the time derivatives of the effects' states into D[3:]."""


@inner
def hook_speed(A, P, Y, spindle_speed):
    return 0.0


@inner
def hook_sensed_displacement(A, P, Y):
    return 0.0


@inner
def hook_sensed_velocity(A, P, Y):
    return 0.0


@inner
def hook_sensed_displacement_y(A, P, Y):
    return 0.0


@inner
def hook_sensed_velocity_y(A, P, Y):
    return 0.0
