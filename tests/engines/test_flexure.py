"""The rig's MuJoCo model: its mode, its stiff directions, its names, its table of values, its picture."""

from __future__ import annotations

import math
import subprocess
import sys

import mujoco
import numpy as np
import pytest
from ruamel.yaml import YAML

from testbed import models
from testbed.models import flexure
from testbed.models.linearise import linearised
from testbed.problem import InputProblem


@pytest.fixture(scope="module")
def rig() -> mujoco.MjModel:
    return mujoco.MjModel.from_xml_path(str(models.machine("flexure").path))


def test_mode_of_the_compiled_model_is_the_papers():
    structure = flexure.structure()
    assert structure.mass == pytest.approx(2.573, rel=1e-12)
    assert structure.natural_frequency_rad == pytest.approx(920.0, rel=1e-12)
    assert structure.damping_ratio == pytest.approx(0.0032, rel=1e-12)


def test_free_vibration_in_mujoco_is_the_mode(rig):
    """The decay MuJoCo integrates is the closed form of the linearised mode."""
    structure, data = flexure.structure(), mujoco.MjData(rig)
    data.joint("workpiece_feed").qpos = 1e-4
    mujoco.mj_step(rig, data, nstep=2000)
    omega, zeta, t = structure.natural_frequency_rad, structure.damping_ratio, data.time
    omega_d = omega * math.sqrt(1 - zeta**2)
    swing = math.cos(omega_d * t) + zeta * omega / omega_d * math.sin(omega_d * t)
    exact = 1e-4 * math.exp(-zeta * omega * t) * swing
    assert t == pytest.approx(0.1)
    assert data.joint("workpiece_feed").qpos[0] == pytest.approx(exact, abs=1e-9)


def test_cross_directions_are_over_twenty_times_stiffer():
    joints = linearised(models.machine("flexure").path)
    feed = joints["workpiece_feed"][1]
    for name in ("workpiece_cross", "workpiece_axial"):
        assert joints[name][1] > 20 * feed


def test_leaves_as_drawn_carry_the_stiffness(rig):
    """Two fixed-guided leaves of the drawn section have the stiffness of the joint, near enough."""
    leaf = rig.geom("leaf_left").size
    thickness, width = 2 * leaf[0], 2 * leaf[1]
    stiffness = 2 * 7.17e10 * width * (thickness / 0.075) ** 3
    assert stiffness == pytest.approx(flexure.structure().stiffness, rel=0.01)


def test_everything_has_a_name(rig):
    counts = {"BODY": rig.nbody, "JOINT": rig.njnt, "GEOM": rig.ngeom, "ACTUATOR": rig.nu, "SENSOR": rig.nsensor,
              "CAMERA": rig.ncam, "SITE": rig.nsite}
    for kind, count in counts.items():
        assert count > 0
        names = [mujoco.mj_id2name(rig, getattr(mujoco.mjtObj, f"mjOBJ_{kind}"), index) for index in range(count)]
        assert all(names), kind


def test_tooth_stands_where_the_angle_says(rig):
    """Spindle angle theta: the tooth points to (sin, cos), clockwise from above, at half the cutter's diameter."""
    data = mujoco.MjData(rig)
    for theta in (0.0, 0.5, math.radians(58.3)):
        data.joint("spindle_angle").qpos = theta
        mujoco.mj_forward(rig, data)
        tip = data.site("tooth_tip").xpos - data.body("spindle").xpos
        assert tip[:2] == pytest.approx(9.525e-3 * np.array([math.sin(theta), math.cos(theta)]), abs=1e-12)


def test_table_of_values_agrees_with_the_model():
    table = YAML(typ="safe").load(models.machine("flexure").parameters.read_text())
    structure = flexure.structure()
    expected = {"modal_mass": structure.mass, "natural_frequency": structure.natural_frequency,
                "damping_ratio": structure.damping_ratio, "stiffness": structure.stiffness,
                "damping": structure.damping}
    for name, value in expected.items():
        assert float(str(table["structure"][name]["value"]).split()[0]) == pytest.approx(value, rel=1e-6)
    for group in table.values():
        for name, entry in group.items():
            assert entry["certainty"] in ("certain", "inferred", "choice"), name
            assert entry["source"], name


def test_unknown_machine_lists_the_known_ones():
    with pytest.raises(InputProblem, match="known: flexure"):
        models.machine("flexur")


def test_picture_shows_the_rig(tmp_path):
    """In a process of its own, since the way of drawing is chosen when mujoco is first imported."""
    code = ("import sys; from testbed.view import render_rig\n"
            "try: render_rig(sys.argv[1], width=320, height=240)\n"
            "except RuntimeError as fault: print(fault); sys.exit(7)")
    done = subprocess.run([sys.executable, "-c", code, str(tmp_path / "rig.png")], capture_output=True, text=True)
    if done.returncode == 7:
        pytest.skip(done.stdout)
    assert done.returncode == 0, done.stderr
    import matplotlib.image

    image = matplotlib.image.imread(tmp_path / "rig.png")[..., :3]
    assert image.shape == (240, 320, 3)
    assert image[:20, :20].mean() > 0.85  # a light background
    blue = (image[..., 2] > 1.3 * image[..., 0]).mean()  # the leaf springs
    orange = (image[..., 0] > 1.5 * image[..., 2]).mean()  # the specimen
    assert blue > 0.01 and orange > 0.005


def test_unknown_camera_is_refused(tmp_path):
    from testbed.view import render_rig

    with pytest.raises(InputProblem, match="overview"):
        render_rig(tmp_path / "rig.png", camera="behind")
