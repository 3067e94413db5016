"""Read a machine's modes from its compiled MuJoCo model, which is the one place where their values stand."""

from __future__ import annotations

import math
from pathlib import Path

import mujoco
import numpy as np

from testbed.machine import Structure

FEED_JOINT = "workpiece_feed"
_STEP = 2.0**-20  # m or m/s: a power of two, so that a linear spring's differences are exact


def linearised(path: Path) -> dict[str, tuple[float, float, float]]:
    """Joint name -> (mass kg, stiffness N/m, damping N s/m) about rest, for every joint of one degree of freedom.

    Mass is the diagonal of the mass matrix; the other two are differences of the passive force. RuntimeError where the
    feed joint is coupled to another one, since it then is no mode of its own.
    """
    model = mujoco.MjModel.from_xml_path(str(path))
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    mass = np.zeros((model.nv, model.nv))
    mujoco.mj_fullM(model, data, mass)
    feed = model.joint(FEED_JOINT).dofadr[0]
    if np.any(np.delete(mass[feed], feed) != 0.0):
        raise RuntimeError(f"{path}: joint {FEED_JOINT} is coupled to another joint through the mass matrix")

    found = {}
    for joint in range(model.njnt):
        dof, adr = int(model.jnt_dofadr[joint]), int(model.jnt_qposadr[joint])
        slopes = []
        for name, index in (("qpos", adr), ("qvel", dof)):
            forces = []
            for step in (_STEP, -_STEP):
                mujoco.mj_resetData(model, data)
                getattr(data, name)[index] += step
                mujoco.mj_forward(model, data)
                forces.append(float(data.qfrc_passive[dof]))
            slopes.append((forces[1] - forces[0]) / (2.0 * _STEP))
        found[model.joint(joint).name] = (float(mass[dof, dof]), slopes[0], slopes[1])
    return found


def feed_mode(path: Path) -> Structure:
    """The structure's mode along the feed."""
    mass, stiffness, damping = linearised(path)[FEED_JOINT]
    omega = math.sqrt(stiffness / mass)
    return Structure(mass, omega / (2.0 * math.pi), damping / (2.0 * mass * omega))
