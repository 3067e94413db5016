"""The same transient by other people's integrators. Each gives x at every tooth's entry, m, shape (passes + 1,)."""

from __future__ import annotations

import contextlib
import math
import tempfile
from collections.abc import Callable

import mujoco
import numpy as np
from scipy.integrate import solve_ivp

from testbed.cut import Cut
from testbed.machine import Model

BARE = """<mujoco>
  <option integrator="RK4" gravity="0 0 0" timestep="{step!r}">
    <flag contact="disable" constraint="disable" equality="disable" limit="disable" gravity="disable"
      warmstart="disable"/>
  </option>
  <size memory="64K"/>
  <worldbody><body>
    <inertial pos="0 0 0" mass="{mass!r}" diaginertia="1e-3 1e-3 1e-3"/>
    <joint type="slide" axis="1 0 0" stiffness="{stiffness!r}" damping="{damping!r}"/>
  </body></worldbody>
</mujoco>"""


def bare_model(model: Model, step: float) -> mujoco.MjModel:
    """The structure alone."""
    structure = model.structure
    return mujoco.MjModel.from_xml_string(BARE.format(step=step, mass=structure.mass, stiffness=structure.stiffness,
                                                      damping=structure.damping))


def stiffness_of(model: Model, cut: Cut) -> Callable[[float], float]:
    """Force on the workpiece per chip, N/m, at a time after the tooth's entry (straight single tooth, up-milling)."""
    kt, kn = model.cutting.tangential_coefficient, model.cutting.normal_coefficient
    depth, speed = cut.axial_depth_of_cut, cut.spindle_speed

    def value(time: float) -> float:
        theta = speed * time
        return depth * (kt * math.cos(theta) + kn * math.sin(theta)) * math.sin(theta)

    return value


def python_callback(model: Model, cut: Cut, inside: int, per_pass: int) -> np.ndarray:
    """MuJoCo with a Python callback, `inside` of its `per_pass` steps in the cut; steps counted, not timed."""
    tau = cut.tooth_passing_period(1)
    window = model.cutting.immersion * tau
    short, long = window / inside, (tau - window) / (per_pass - inside)
    compiled = bare_model(model, short)
    data = mujoco.MjData(compiled)
    kappa = [stiffness_of(model, cut)(0.5 * node * short) for node in range(2 * inside + 1)]
    memory, fresh = [0.0] * (2 * inside + 1), [0.0] * (2 * inside + 1)
    feed, now = cut.feed_per_tooth, [0, 0]  # step of the pass, stage

    def force(_, moving) -> None:
        step, stage = now
        now[1] += 1
        if step < inside:
            node = 2 * step + (0, 1, 1, 2)[stage]
            moving.qfrc_passive[0] -= kappa[node] * (feed + moving.qpos[0] - memory[node])

    found = [0.0]
    mujoco.set_mjcb_passive(force)
    try:
        for _ in range(cut.passes):
            for step in range(per_pass):
                now[0], now[1] = step, 0
                compiled.opt.timestep = short if step < inside else long
                x, v = data.qpos[0], data.qvel[0]
                mujoco.mj_step(compiled, data)
                if step < inside:
                    fresh[2 * step], fresh[2 * step + 2] = x, data.qpos[0]
                    fresh[2 * step + 1] = 0.5 * (x + data.qpos[0]) + 0.125 * short * (v - data.qvel[0])
            memory[:] = fresh
            found.append(float(data.qpos[0]))
    finally:
        mujoco.set_mjcb_passive(None)
    return np.array(found)


def method_of_steps(model: Model, cut: Cut, tolerance: float) -> np.ndarray:
    """scipy's solve_ivp restarted at every entry and exit, the past from its dense output."""
    structure, tau = model.structure, cut.tooth_passing_period(1)
    window = model.cutting.immersion * tau
    kappa, feed, mass = stiffness_of(model, cut), cut.feed_per_tooth, structure.mass
    pull, drag = structure.stiffness / mass, structure.damping / mass
    settings = {"method": "RK45", "rtol": tolerance, "atol": tolerance * np.array([1e-6, 1e-3])}
    past, state, found = None, np.zeros(2), [0.0]

    def free(_, y):
        return (y[1], -pull * y[0] - drag * y[1])

    for _ in range(cut.passes):
        def cutting(t, y, past=past):
            before = past(t)[0] if past is not None else 0.0
            return (y[1], -pull * y[0] - drag * y[1] - kappa(t) / mass * (feed + y[0] - before))

        inside = solve_ivp(cutting, (0.0, window), state, dense_output=True, **settings)
        outside = solve_ivp(free, (window, tau), inside.y[:, -1], **settings)
        past, state = inside.sol, outside.y[:, -1]
        found.append(float(state[0]))
    return np.array(found)


def jitcdde_solver(model: Model, cut: Cut, sharpness: float = 4e-4) -> Callable[[float], np.ndarray]:
    """JiTCDDE with the engagement smoothed over a share of the period; compiled here, run by what is returned.

    ImportError where it is not installed.
    """
    import symengine
    from jitcdde import jitcdde, t, y

    structure, tau = model.structure, cut.tooth_passing_period(1)
    kt, kn = model.cutting.tangential_coefficient, model.cutting.normal_coefficient
    width, mass = sharpness * tau, structure.mass
    turned = cut.spindle_speed * t
    # 1 in the cut, 0 out of it: the phase measured from the middle of the cut by its cosine
    half = math.pi * model.cutting.immersion
    slope = math.sin(half) * cut.spindle_speed * width
    gate = (1 + symengine.tanh((symengine.cos(turned - half) - math.cos(half)) / slope)) / 2
    kappa = cut.axial_depth_of_cut * (kt * symengine.cos(turned) + kn * symengine.sin(turned)) * symengine.sin(turned)
    size = 1e-6  # displacements in um, so that absolute tolerances mean something
    chip = cut.feed_per_tooth / size + y(0) - y(0, t - tau)
    rates = [y(1), (-structure.stiffness * y(0) - structure.damping * y(1) - gate * kappa * chip) / mass]
    solver = jitcdde(rates, max_delay=1.01 * tau, verbose=False)
    with tempfile.TemporaryDirectory() as folder, contextlib.chdir(folder):  # its build reads the folder it runs in
        solver.compile_C(simplify=False, do_cse=True, verbose=False)

    def run(tolerance: float) -> np.ndarray:
        solver.purge_past()
        solver.constant_past([0.0, 0.0], time=0.0)
        solver.set_integration_parameters(rtol=tolerance, atol=tolerance, max_step=0.02 * tau, first_step=1e-4 * tau)
        solver.integrate_blindly(1e-3 * tau, 1e-3 * tau)
        return np.array([0.0, *(solver.integrate(n * tau)[0] * size for n in range(1, cut.passes + 1))])

    return run
