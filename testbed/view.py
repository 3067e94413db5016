"""Pictures of a machine, rendered without a screen; never on the way of a simulation.

Drawing happens in a process of its own: which renderer MuJoCo uses is settled when it is first imported, and a missing one
may end a process in ways that no exception tells.
"""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

from testbed import models
from testbed.problem import InputProblem


def render_rig(path: str | Path, machine: str = "flexure", width: int = 1600, height: int = 1200,
               camera: str = "overview") -> Path:
    """Draw a machine with its tooth in mid-cut into a PNG file; returns the file's path.

    camera: one of those the machine's MJCF names (flexure: overview, cut, front, end). InputProblem for an unknown
    machine or camera, RuntimeError where this computer cannot render.
    """
    import mujoco

    rig = models.machine(machine)
    model = mujoco.MjModel.from_xml_path(str(rig.path))
    cameras = [model.camera(index).name for index in range(model.ncam)]
    if camera not in cameras:
        raise InputProblem("camera", f"machine {machine} has no camera '{camera}'", f"known: {', '.join(cameras)}")
    if not (16 <= width <= model.vis.global_.offwidth and 16 <= height <= model.vis.global_.offheight):
        raise InputProblem("picture", f"{width} x {height} pixels cannot be drawn",
                           f"at most {model.vis.global_.offwidth} x {model.vis.global_.offheight}")
    command = [sys.executable, "-m", "testbed.view", str(rig.path), str(path), str(width), str(height), camera]
    env = {**os.environ, "MUJOCO_GL": os.environ.get("MUJOCO_GL", "egl"),
           "PYTHONPATH": os.pathsep.join([str(Path(__file__).parents[1]), os.environ.get("PYTHONPATH", "")])}
    done = subprocess.run(command, env=env, capture_output=True, text=True, check=False)
    if done.returncode != 0:
        said = done.stderr.strip().splitlines()
        raise RuntimeError(f"no picture: {said[-1] if said else f'the renderer ended with {done.returncode}'}; "
                           "set MUJOCO_GL to egl, osmesa or glfw")
    return Path(path)


def _draw(xml: str, path: str, width: int, height: int, camera: str) -> None:
    import matplotlib.image
    import mujoco

    model = mujoco.MjModel.from_xml_path(xml)
    data = mujoco.MjData(model)
    if model.nkey:
        mujoco.mj_resetDataKeyframe(model, data, 0)
    mujoco.mj_forward(model, data)
    renderer = mujoco.Renderer(model, height, width)
    try:
        renderer.update_scene(data, camera=camera)
        image = renderer.render()
    finally:
        renderer.close()
    matplotlib.image.imsave(path, image, format="png")


if __name__ == "__main__":
    _draw(sys.argv[1], sys.argv[2], int(sys.argv[3]), int(sys.argv[4]), sys.argv[5])
