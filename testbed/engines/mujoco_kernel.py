"""The cut inside MuJoCo's own Runge-Kutta steps: stage by stage the force, step by step the surface.

MuJoCo integrates the structure; these functions add the force of the cut at each of its four stages, integrate the
effects' own states beside it, choose each step so that the spindle turns through one increment of the grid in angle,
and keep the surface. N holds the run's settings (constant), U everything that changes: MuJoCo saves and restores U with
its physics state, so a run continues bit for bit. Neither knows of MuJoCo: `mujoco_plugin` joins the two.
"""


from testbed.engines.array_kernel import copy, fill
from testbed.engines.compiled import holding
from testbed.engines.front_kernel import first_surface
from testbed.engines.hooks import N_STATES, PLANAR, hook_structure_force, hook_structure_force_y
from testbed.engines.loop_kernel import (
    CORNERS,
    DAMPING,
    G_SIZE,
    MASS,
    MOST_SEGMENTS,
    OMEGA,
    PITCH,
    STIFFNESS,
    T_ENTRY,
    cutting_force,
    derivative,
    leave_surface,
    spindle_speed,
)
from testbed.engines.plane_kernel import FIRST_MODE, MODE_SIZE, mode_place, sensed, sensed_across, sensed_on_tool
from testbed.system.kernel_cache import kept

# settings N: this head, with one number a segment from M_STEPS and M_TEETH on; then the arrays A, P and G of `packing`
M_SEGMENTS, M_IDLE, M_CUT, M_STATES_ON, M_STEADY, M_A, M_P, M_Y, M_DOF, M_EDGES, M_RECORD, M_ROWS, M_MODES, M_STEPS = range(14)
M_TEETH, N_HEAD = M_STEPS + MOST_SEGMENTS, M_STEPS + 2 * MOST_SEGMENTS
# state U: this head, then G, seven states (Y0, Y, D0 = first slope, three more slopes, D1), two surfaces, the memory
U_COUNT, U_PASS, U_SEGMENT, U_STEP, U_TIME, U_DT, U_STAGE, U_MIDDLE, U_SPEED0, U_FORCE_X, U_FORCE_Y, U_HEAD = range(12)
Y_0, Y_STAGE, SLOPES, D_1, Y_BLOCKS = 0, 1, 2, 6, 7
# one row of the record a step: times; displacement, velocity, acceleration at both ends; forces at start, middle, end
R_T0, R_T1, R_X0, R_V0, R_A0, R_X1, R_V1, R_A1, R_FX0, R_FXM, R_FX1, R_FY0, R_FYM, R_FY1, R_ANGLE0, R_ANGLE1, \
    R_MOTION = range(17)
# where the structure moves in the plane, behind that: the six numbers of motion once more, across the feed, and of a sensor on
# the tool along x and along y
R_SIZE = R_MOTION + 18 if PLANAR else R_MOTION


@holding
def settings_of(N):
    """Flags A and parameters P."""
    a = N_HEAD + int(N[M_A])
    return N[N_HEAD:a], N[a:a + int(N[M_P])]


@holding
def state_block(N, U, block):
    """One of the seven state-sized arrays kept in U."""
    size = int(N[M_Y])
    start = U_HEAD + G_SIZE + block * size
    return U[start:start + size]


@holding
def put_structure(N, Y, q, v):
    """Into the state Y the coordinates and rates of the structure's modes."""
    for mode in range(int(N[M_MODES])):
        place = mode_place(mode)
        Y[place], Y[place + 1] = q[mode], v[mode]


@holding
def push_structure(N, A, P, G, Y, force, across, added):
    """Add the force of the cut and of the effects to what pushes the structure's modes."""
    force += hook_structure_force(A, P, Y, G[MASS], G[STIFFNESS], G[DAMPING])
    if PLANAR:
        across += hook_structure_force_y(A, P, Y, G[MASS], G[STIFFNESS], G[DAMPING])
        for mode in range(int(N[M_MODES])):
            at = FIRST_MODE + mode * MODE_SIZE
            added[mode] += P[at] * force + P[at + 1] * across
    else:
        added[0] += force


@holding
def surface_row(N, U, row):
    """Surface memory at one grid angle; row -1 is the pending one, row -2 scratch."""
    edges = int(N[M_EDGES])
    start = U_HEAD + G_SIZE + Y_BLOCKS * int(N[M_Y]) + (row + 2) * edges
    return U[start:start + edges]


@holding
def place_on_grid(N, U):
    """(steps in this segment, angle of one, phase at the segment's start, its first surface row, teeth in the cut)."""
    segment, row0 = int(U[U_SEGMENT]), 0
    for before in range(segment):
        row0 += 2 * int(N[M_STEPS + before])
    low, high = U[U_HEAD + CORNERS + segment], U[U_HEAD + CORNERS + segment + 1]
    cutting = 0.0 <= U[U_PASS] - N[M_IDLE] < N[M_CUT]
    steps = int(N[M_STEPS + segment])
    return steps, (high - low) / steps, low, row0, int(N[M_TEETH + segment]) if cutting else 0


@holding
def enter_cut(N, U, time):
    """The cut begins now: the feed starts, and the memory holds what the first teeth meet."""
    A, P = settings_of(N)
    G = U[U_HEAD:U_HEAD + G_SIZE]
    G[T_ENTRY] = time
    teeth = 0
    for segment in range(int(N[M_SEGMENTS])):
        teeth = max(teeth, int(N[M_TEETH + segment]))
    scratch, Y = state_block(N, U, Y_STAGE), state_block(N, U, Y_0)
    row = 0
    for segment in range(int(N[M_SEGMENTS])):
        if N[M_TEETH + segment] == 0.0:  # the cut is over: no surface is remembered there
            break
        low, high, steps = G[CORNERS + segment], G[CORNERS + segment + 1], int(N[M_STEPS + segment])
        for half in range(2 * steps + 1):
            phase = low + (high - low) * half / (2.0 * steps)
            first_surface(A, P, G, scratch, Y, False, phase, teeth, time, surface_row(N, U, row + half))
        row += 2 * steps


@kept  # an entry, with its callees compiled in
def start_run(N, U):
    """Everything that changes, as it stands at time 0."""
    fill(U, 0, 0.0)
    start = N_HEAD + int(N[M_A]) + int(N[M_P])
    for place in range(G_SIZE):
        U[U_HEAD + place] = N[start + place]
    if N[M_IDLE] == 0.0 and N[M_CUT] > 0.0:
        enter_cut(N, U, 0.0)


@holding
def surface_at(N, U, row, share):
    """Surface met at `share` of the step that starts at `row`: a grid row, or the parabola through the step's three."""
    if share == 0.0 or share == 0.5 or share == 1.0:
        return surface_row(N, U, row + int(2.0 * share))
    met = surface_row(N, U, -2)
    s0, sm, s1 = surface_row(N, U, row), surface_row(N, U, row + 1), surface_row(N, U, row + 2)
    for edge in range(met.shape[0]):
        met[edge] = s0[edge] * (1.0 - share) * (1.0 - 2.0 * share) + sm[edge] * 4.0 * share * (1.0 - share) \
            + s1[edge] * share * (2.0 * share - 1.0)
    return met


@holding
def met_force(N, U, A, P, G, Y, base, span, row0, teeth, share):
    """(force, force across the feed, torque) of the state Y at `share` of the present step."""
    if teeth == 0:
        return 0.0, 0.0, 0.0
    surface = surface_at(N, U, row0 + 2 * int(U[U_STEP]), share)
    return cutting_force(A, P, G, Y, base + (U[U_STEP] + share) * span, int(U[U_PASS] - N[M_IDLE]), teeth, surface)


@holding
def choose_step(N, U, A, P, G, base, span, row0, teeth):
    """Duration of the step that turns the spindle by `span`; also where in angle its middle in time lies."""
    Y0, D0, Y = state_block(N, U, Y_0), state_block(N, U, SLOPES), state_block(N, U, Y_STAGE)
    U[U_MIDDLE] = 0.5
    U[U_SPEED0] = spindle_speed(A, P, G, Y0)
    if N[M_STEADY] != 0.0:
        U[U_DT] = (U[U_PASS] * G[PITCH] + base + (U[U_STEP] + 1.0) * span) / G[OMEGA] - U[U_TIME]
        return
    # dt/dangle = 1/Omega by the classical scheme; the motion within the step is predicted from the slope at its start
    K = state_block(N, U, D_1)
    total, ahead, speed = 0.0, 0.0, U[U_SPEED0]
    copy(D0, K)
    for stage in range(4):
        if stage > 0:
            copy(Y0, Y)
            for i in range(1, Y.shape[0]):
                Y[i] += ahead * K[i]
            Y[0] += ahead * (Y0[1] + 0.5 * ahead * D0[1])
            speed = spindle_speed(A, P, G, Y)
            force, across, torque = met_force(N, U, A, P, G, Y, base, span, row0, teeth, 0.5 if stage < 3 else 1.0)
            derivative(A, P, G, Y, K, force, across, torque)
            K[1] = D0[1]
        weight = 1.0 if stage in (0, 3) else 2.0
        total += weight * span / speed / 6.0
        ahead = span / speed * (1.0 if stage == 2 else 0.5)
    U[U_DT] = total
    U[U_MIDDLE] = 0.5 + 0.125 * total * (U[U_SPEED0] - speed) / span


@holding
def stage_of(U, time):
    """Which of the four stages MuJoCo is at: by time, and the two middle ones by their order."""
    if time == U[U_TIME]:
        return 0
    if time - U[U_TIME] > 0.75 * U[U_DT]:
        return 3
    return 1 if U[U_STAGE] == 0.0 else 2


@kept
def stage_force(N, U, time, q, v, added):
    """Add the force on the modes at one stage beyond their own springs and dampers; the first stage also chooses the step.

    q, v (modes,): coordinates and rates of the modes; added (modes,): the forces on them.
    """
    A, P = settings_of(N)
    G = U[U_HEAD:U_HEAD + G_SIZE]
    stage = stage_of(U, time)
    U[U_STAGE] = stage
    steps, span, base, row0, teeth = place_on_grid(N, U)
    Y0, Y, D = state_block(N, U, Y_0), state_block(N, U, Y_STAGE), state_block(N, U, SLOPES + stage)
    share = 0.0 if stage == 0 else (1.0 if stage == 3 else U[U_MIDDLE])
    put_structure(N, Y, q, v)
    Y[2] = time
    if N[M_STATES_ON] != 0.0:
        before = state_block(N, U, SLOPES + max(stage - 1, 0))
        ahead = 0.0 if stage == 0 else U[U_DT] * (1.0 if stage == 3 else 0.5)
        for i in range(3, 3 + N_STATES):
            Y[i] = Y0[i] + (ahead * before[i] if stage > 0 else 0.0)
    force, across, torque = met_force(N, U, A, P, G, Y, base, span, row0, teeth, share)
    push_structure(N, A, P, G, Y, force, across, added)
    if stage == 0:
        copy(Y, Y0)
        U[U_FORCE_X], U[U_FORCE_Y] = force, across
        derivative(A, P, G, Y, D, force, across, torque)
        choose_step(N, U, A, P, G, base, span, row0, teeth)
    elif N[M_STATES_ON] != 0.0:
        derivative(A, P, G, Y, D, force, across, torque)


@holding
def write_row(N, U, A, P, R, angle, span, force, across, force_middle, across_middle):
    """Keep what the step just ended looked like, for sampling."""
    Y0, D0 = state_block(N, U, Y_0), state_block(N, U, SLOPES)
    Y1, D1 = state_block(N, U, Y_STAGE), state_block(N, U, D_1)
    start = int(U[U_COUNT]) * R_SIZE
    if start + R_SIZE > R.shape[0]:
        return
    row = R[start:start + R_SIZE]
    row[R_T0], row[R_T1] = Y0[2], Y1[2]
    row[R_X0], row[R_V0], row[R_A0] = sensed(A, P, Y0, D0)
    row[R_X1], row[R_V1], row[R_A1] = sensed(A, P, Y1, D1)
    if PLANAR:
        row[R_MOTION], row[R_MOTION + 1], row[R_MOTION + 2] = sensed_across(A, P, Y0, D0)
        row[R_MOTION + 3], row[R_MOTION + 4], row[R_MOTION + 5] = sensed_across(A, P, Y1, D1)
        for axis in range(2):
            at = R_MOTION + 6 * (axis + 1)
            row[at], row[at + 1], row[at + 2] = sensed_on_tool(P, Y0, D0, axis)
            row[at + 3], row[at + 4], row[at + 5] = sensed_on_tool(P, Y1, D1, axis)
    row[R_FX0], row[R_FXM], row[R_FX1] = U[U_FORCE_X], force_middle, force
    row[R_FY0], row[R_FYM], row[R_FY1] = U[U_FORCE_Y], across_middle, across
    row[R_ANGLE0], row[R_ANGLE1] = angle, angle + span


@holding
def leave_step(N, U, A, P, G, row, phase, span, pass_number, teeth, speed1):
    """Write the surface the step leaves; returns the force met at its middle. The row at its end is still to be read by
    the next step, so what is left there waits in the pending row."""
    Y0, D0 = state_block(N, U, Y_0), state_block(N, U, SLOPES)
    Y1, D1 = state_block(N, U, Y_STAGE), state_block(N, U, D_1)
    W = state_block(N, U, SLOPES + 1)
    begin, middle, end = surface_row(N, U, row), surface_row(N, U, row + 1), surface_row(N, U, row + 2)
    pending = surface_row(N, U, -1)
    for i in range(W.shape[0]):  # Hermite in the angle
        W[i] = 0.5 * (Y0[i] + Y1[i]) + 0.125 * span * (D0[i] / U[U_SPEED0] - D1[i] / speed1)
    force, across, torque = cutting_force(A, P, G, W, phase + 0.5 * span, pass_number, teeth, middle)
    if row == 0:
        leave_surface(A, P, G, Y0, phase, pass_number, teeth, begin, begin)
    else:
        copy(pending, begin)
    leave_surface(A, P, G, W, phase + 0.5 * span, pass_number, teeth, middle, middle)
    copy(end, pending)
    leave_surface(A, P, G, Y1, phase + span, pass_number, teeth, end, pending)
    return force, across


@holding
def next_place(N, U, time, steps, row_end, teeth):
    """Move on by one step: to the next segment and the next pass where this one is through."""
    U[U_COUNT] += 1.0
    U[U_TIME] = time
    U[U_STAGE] = 0.0
    U[U_STEP] += 1.0
    if U[U_STEP] < steps:
        return
    U[U_STEP] = 0.0
    segment = int(U[U_SEGMENT])
    last = segment + 1 == int(N[M_SEGMENTS])
    if teeth > 0 and (last or N[M_TEETH + segment + 1] == 0.0):
        copy(surface_row(N, U, -1), surface_row(N, U, row_end))
    if not last:
        U[U_SEGMENT] = segment + 1.0
        return
    U[U_SEGMENT] = 0.0
    U[U_PASS] += 1.0
    if U[U_PASS] == N[M_IDLE] and N[M_CUT] > 0.0:
        enter_cut(N, U, time)


@kept
def end_step(N, U, R, time, q, v):
    """MuJoCo has taken the step: finish the effects' states, leave the surface, keep the record, move on."""
    A, P = settings_of(N)
    G = U[U_HEAD:U_HEAD + G_SIZE]
    steps, span, base, row0, teeth = place_on_grid(N, U)
    Y0, Y1, D1 = state_block(N, U, Y_0), state_block(N, U, Y_STAGE), state_block(N, U, D_1)
    row, phase = row0 + 2 * int(U[U_STEP]), base + U[U_STEP] * span
    pass_number, dt = int(U[U_PASS] - N[M_IDLE]), U[U_DT]
    put_structure(N, Y1, q, v)
    Y1[2] = time
    if N[M_STATES_ON] != 0.0:
        for i in range(3, 3 + N_STATES):
            Y1[i] = Y0[i]
        for stage in range(4):
            weight = dt / 6.0 if stage in (0, 3) else dt / 3.0
            K = state_block(N, U, SLOPES + stage)
            for i in range(3, 3 + N_STATES):
                Y1[i] += weight * K[i]
    force_middle, across_middle = 0.0, 0.0
    force, across, torque = met_force(N, U, A, P, G, Y1, base, span, row0, teeth, 1.0)
    derivative(A, P, G, Y1, D1, force, across, torque)
    if teeth > 0:
        force_middle, across_middle = leave_step(N, U, A, P, G, row, phase, span, pass_number, teeth,
                                                 spindle_speed(A, P, G, Y1))
    write_row(N, U, A, P, R, pass_number * G[PITCH] + phase, span, force, across, force_middle, across_middle)
    copy(Y1, Y0)
    next_place(N, U, time, steps, row + 2, teeth)
