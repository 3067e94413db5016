"""Pictures of a machine, rendered without a screen; never on the way of a simulation."""

from __future__ import annotations

import os
from pathlib import Path

import models
from testbed.problem import InputProblem


def render_rig(path: str | Path, machine: str = "flexure", width: int = 1600, height: int = 1200,
               camera: str = "overview") -> Path:
    """Draw a machine with its tooth in mid-cut into a PNG file; returns the file's path.

    camera: one of those the machine's MJCF names (flexure: overview, cut, front, end). InputProblem for an unknown
    machine or camera, RuntimeError where this computer cannot render.
    """
    os.environ.setdefault("MUJOCO_GL", "egl")  # read once, when mujoco is first imported for drawing
    import matplotlib.image
    import mujoco

    rig = models.machine(machine)
    model = mujoco.MjModel.from_xml_path(str(rig.path))
    cameras = [model.camera(index).name for index in range(model.ncam)]
    if camera not in cameras:
        raise InputProblem("camera", f"machine {machine} has no camera '{camera}'", f"known: {', '.join(cameras)}")
    if not (16 <= width <= model.vis.global_.offwidth and 16 <= height <= model.vis.global_.offheight):
        raise InputProblem("picture", f"{width} x {height} pixels cannot be drawn",
                           f"at most {model.vis.global_.offwidth} x {model.vis.global_.offheight}")
    data = mujoco.MjData(model)
    if model.nkey:
        mujoco.mj_resetDataKeyframe(model, data, 0)
    mujoco.mj_forward(model, data)
    try:
        renderer = mujoco.Renderer(model, height, width)
    except Exception as fault:  # the drivers' own errors differ from computer to computer
        raise RuntimeError(f"no picture: {fault}; set MUJOCO_GL to egl, osmesa or glfw") from fault
    try:
        renderer.update_scene(data, camera=camera)
        image = renderer.render()
    finally:
        renderer.close()
    path = Path(path)
    matplotlib.image.imsave(path, image, format="png")
    return path
