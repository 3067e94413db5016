"""The reference engine: MuJoCo integrates the structure, the native plugin cuts.

Shares with the fast engine only the force at one instant (`loop_kernel`), the effects and the packing of inputs; the
integration (MuJoCo's Runge-Kutta, stepped in time so that every step turns the spindle by one increment of a grid that
holds entry and exit), the surface memory and the sampling are its own.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType, ModuleType
from xml.etree import ElementTree

import mujoco
import numpy as np

from testbed import models
from testbed.catalogue import catalogue as known_effects
from testbed.cut import Cut, Sampling
from testbed.effect import Effect
from testbed.engines import fast_kernel as fk
from testbed.engines import loop_kernel as lk
from testbed.engines import mujoco_kernel as mk
from testbed.engines import mujoco_plugin
from testbed.engines.measure import measured_channels
from testbed.engines.model_arrays import active_effects
from testbed.engines.mujoco_record import sample_record
from testbed.engines.packing import Packed, pack
from testbed.engines.stiffening import fastest_frequency
from testbed.machine import Cutter, Model, Structure
from testbed.problem import InputProblem
from testbed.recording import ENGINE_UNITS, MOTION_UNITS, Outcome, Recording

LIMIT = 1.0  # m; a displacement beyond it is a run that has diverged
STEP_PHASE = 0.04  # rad of the fastest vibration a step may cover
STEP_ANGLE = 0.06  # rad of tooth travel a step in the cut may cover
FEED_JOINT = "workpiece_feed"
_OWN = (*MOTION_UNITS, "force_x", "force_y", "spindle_angle")  # then, in the plane, the motion of the other kinds
_FURTHER = tuple(f"{kind[:-1]}{quantity}_{kind[-1]}" for kind in ("y", "tool_x", "tool_y") for quantity in MOTION_UNITS)
CHANNELS = (*_OWN, *_FURTHER, *(f"{quantity}_x" for quantity in MOTION_UNITS))
UNITS = {name: ENGINE_UNITS[name] for name in CHANNELS}
_BAD = (mujoco.mjtWarning.mjWARN_BADQPOS, mujoco.mjtWarning.mjWARN_BADQVEL, mujoco.mjtWarning.mjWARN_BADQACC)

_LEAN = """<mujoco model="{name}">
  <option integrator="RK4" gravity="0 0 0">
    <flag contact="disable" constraint="disable" equality="disable" limit="disable" gravity="disable"
      warmstart="disable" autoreset="disable"/>
  </option>
  <size memory="64K"/>
  <worldbody>
{bodies}  </worldbody>
</mujoco>"""
_BODY = """    <body name="{name}">
      <inertial pos="0 0 0" mass="{mass!r}" diaginertia="1e-3 1e-3 1e-3"/>
      <joint name="{joint}" type="slide" axis="{axis}" stiffness="{stiffness!r}" damping="{damping!r}"/>
    </body>
"""

_NO_EFFECTS: Mapping[str, Effect] = MappingProxyType({})


def _grid(model: Model, cut: Cut, effects: Mapping[str, Effect], steps: int | None) -> Packed:
    """Packed inputs with this engine's own grid: plain steps everywhere, of about one size in all segments.

    steps: how many while the leading tooth crosses its cut.
    """
    packed = pack(model, cut, effects, steps)
    if packed.turn:
        raise InputProblem("cutter", "this engine's teeth are of one pitch", "leave out `pitch`, or take the fast engine")
    segments = packed.I[fk.SEGMENTS]
    lengths = np.diff(packed.G[lk.CORNERS : lk.CORNERS + segments + 1])
    if steps is None:
        fastest = fastest_frequency(model, effects)
        density = max(fastest / STEP_PHASE / cut.spindle_speed, 1.0 / STEP_ANGLE, 12.0 / packed.crossing)
    else:
        density = steps / packed.crossing
    packed.I[fk.STEPS : fk.STEPS + segments] = np.maximum(1, np.ceil(lengths * density - 1e-9))
    return packed


def _settings(packed: Packed) -> np.ndarray:
    """The plugin's settings as one flat array: head, flags, parameters, geometry."""
    head = np.zeros(mk.N_HEAD)
    for place, source in ((mk.M_SEGMENTS, fk.SEGMENTS), (mk.M_IDLE, fk.IDLE), (mk.M_CUT, fk.CUT),
                          (mk.M_STEADY, fk.STEADY_SPEED)):
        head[place] = packed.I[source]
    head[mk.M_STATES_ON], head[mk.M_MODES] = packed.states_on, packed.modes
    head[mk.M_STEPS : mk.M_STEPS + lk.MOST_SEGMENTS] = packed.I[fk.STEPS : fk.STEPS + lk.MOST_SEGMENTS]
    head[mk.M_TEETH : mk.M_TEETH + lk.MOST_SEGMENTS] = packed.I[fk.TEETH : fk.TEETH + lk.MOST_SEGMENTS]
    head[[mk.M_A, mk.M_P, mk.M_Y]] = packed.A.size, packed.P.size, packed.Y.size
    teeth = max(1, int(packed.I[fk.TEETH : fk.TEETH + lk.MOST_SEGMENTS].max()))
    head[mk.M_EDGES] = teeth * int(packed.G[lk.SLICES])
    return np.concatenate([head, packed.A, packed.P, packed.G])


def _state_size(settings: np.ndarray) -> int:
    steps = settings[mk.M_STEPS : mk.M_STEPS + lk.MOST_SEGMENTS]
    rows = 2 * steps[settings[mk.M_TEETH : mk.M_TEETH + lk.MOST_SEGMENTS] > 0].sum() + 1
    return int(mk.U_HEAD + lk.G_SIZE + mk.Y_BLOCKS * settings[mk.M_Y] + (rows + 2) * settings[mk.M_EDGES])


def _fit_structure(root: ElementTree.Element, structure: Structure, own: Structure) -> None:
    """Give the rig's feed mode the model's mass, stiffness and damping, where they differ from the rig's own."""
    joint = root.find(f".//joint[@name='{FEED_JOINT}']")
    platform = root.find(".//geom[@name='platform']")
    assert joint is not None and platform is not None
    joint.set("stiffness", repr(structure.stiffness))
    joint.set("damping", repr(structure.damping))
    mass = float(platform.get("mass", "0")) + structure.mass - own.mass
    if mass <= 0:
        raise ValueError(f"a modal mass of {structure.mass:g} kg is less than the specimen and its clamps weigh")
    platform.set("mass", repr(mass))


def _lean(structure: Structure) -> str:
    """A machine of modes alone, a body and a slide joint for each: modal coordinates, so that every body has its modal mass.

    The workpiece's x is the rig's -X, and its y the rig's -Y; a tool moves the other way.
    """
    bodies = ""
    for place, mode in enumerate(structure.modes):
        sign = 1.0 if mode.on == "tool" else -1.0
        axis = " ".join(f"{sign * share:.17g}" if share else "0" for share in (*mode.shape, 0.0))
        name = f"{mode.on}_mode_{place}" if structure.planar else "workpiece"
        bodies += _BODY.format(name=name, mass=mode.mass, joint=FEED_JOINT if place == 0 else f"mode_{place}", axis=axis,
                               stiffness=mode.stiffness, damping=mode.damping)
    return _LEAN.format(name="modes_in_the_plane" if structure.planar else "one_mode", bodies=bodies)


def _xml(model: Model, packed: Packed, plugin: str) -> str:
    if model.machine is None:
        root = ElementTree.fromstring(_lean(model.structure))
    elif model.structure.planar:
        raise ValueError(f"the machine {model.machine} has one mode along the feed: leave out `machine`")
    else:
        machine = models.machine(model.machine)
        root = ElementTree.fromstring(machine.xml())
        _fit_structure(root, model.structure, machine.structure())
        flag = root.find("option/flag")
        assert flag is not None
        flag.set("autoreset", "disable")
    settings = _settings(packed)
    extension = ElementTree.SubElement(root, "extension")
    ElementTree.SubElement(extension, "plugin", plugin=plugin)
    custom = ElementTree.SubElement(root, "custom")
    ElementTree.SubElement(custom, "numeric", name="cut", data=" ".join(repr(float(value)) for value in settings))
    body = root.find("worldbody/body" if model.structure.planar else ".//body[@name='workpiece']")
    assert body is not None
    instance = ElementTree.Element("plugin", plugin=plugin)
    ElementTree.SubElement(instance, "config", key="state_size", value=str(_state_size(settings)))
    body.insert(0, instance)
    ElementTree.indent(root)
    return ElementTree.tostring(root, encoding="unicode")


def _needed(model: Model, effects: Mapping[str, Effect]) -> tuple[Model, Mapping[str, Effect]]:
    """The model and the catalogue to compile: where no effect is active, a plugin without any, which costs less a step."""
    if active_effects(model, effects):
        return model, effects
    return replace(model, effects={}), _NO_EFFECTS


def model_xml(model: Model, cut: Cut, *, steps: int | None = None,
              catalogue: Mapping[str, Effect] | None = None) -> str:
    """The MJCF text that one run simulates: the machine, its values, and the cut's settings as a custom numeric."""
    model, effects = _needed(model, known_effects() if catalogue is None else catalogue)
    packed = _grid(model, cut, effects, steps)
    return _xml(model, packed, mujoco_plugin.register(effects, packed.planar)[0])


def _largest(rows: np.ndarray) -> np.ndarray:
    """How far the workpiece has moved against the tool at the ends of some steps of a record, the larger of x and y, m."""
    if rows.shape[1] == mk.R_MOTION:
        return np.abs(rows[:, mk.R_X1])
    y, tool_x, tool_y = (rows[:, mk.R_MOTION + 6 * kind + 3] for kind in range(3))
    return np.maximum(np.abs(rows[:, mk.R_X1] - tool_x), np.abs(y - tool_y))


@dataclass
class Run:
    """One simulation under way: the compiled model, its data, and the record of the steps taken so far (steps, 17)."""

    model: mujoco.MjModel
    data: mujoco.MjData
    record: np.ndarray
    steps_per_pass: int
    total_passes: int
    kernel: ModuleType
    done: int = 0
    stopped: float = math.nan

    def advance(self, passes: int) -> None:
        """Take the steps of so many tooth passes; less where the run diverges."""
        for _ in range(min(passes, self.total_passes - self.done)):
            if not math.isnan(self.stopped):
                return
            begin = self.data.time
            mujoco.mj_step(self.model, self.data, nstep=self.steps_per_pass)
            rows = self.record[self.done * self.steps_per_pass:(self.done + 1) * self.steps_per_pass]
            beyond = ~(_largest(rows) < LIMIT)
            if beyond.any():
                first = int(np.argmax(beyond))
                self.stopped = float(rows[first, mk.R_T0])
                rows[first:] = np.nan
            elif any(self.data.warning[int(kind)].number for kind in _BAD):
                self.stopped = begin
                rows[:] = np.nan
            self.done += 1


def prepare(model: Model, cut: Cut, *, steps: int | None = None, catalogue: Mapping[str, Effect] | None = None) -> Run:
    """Compile the model of one run and set it at time 0."""
    model, effects = _needed(model, known_effects() if catalogue is None else catalogue)
    packed = _grid(model, cut, effects, steps)
    plugin, kernel = mujoco_plugin.register(effects, packed.planar)
    compiled = mujoco.MjModel.from_xml_string(_xml(model, packed, plugin))
    per_pass = int(packed.I[fk.STEPS : fk.STEPS + packed.I[fk.SEGMENTS]].sum())
    record = np.full((max(1, per_pass * cut.total_passes), kernel.R_SIZE), np.nan)
    joint = mujoco.mj_name2id(compiled, mujoco.mjtObj.mjOBJ_JOINT, FEED_JOINT)
    numeric = compiled.numeric("cut").data  # a view; the record's address is this process's own, so not in the text
    numeric[[mk.M_DOF, mk.M_RECORD, mk.M_ROWS]] = compiled.jnt_dofadr[joint], record.ctypes.data, len(record)
    data = mujoco.MjData(compiled)
    data.joint(FEED_JOINT).qpos, data.joint(FEED_JOINT).qvel = cut.initial_displacement, cut.initial_velocity
    if model.machine is not None:
        flutes = (model.cutter or Cutter()).flutes
        speeds = {"spindle": cut.spindle_speed, "feed": cut.feed_per_tooth / cut.tooth_passing_period(flutes)}
        for name, speed in zip(("spindle_angle", "feed"), speeds.values(), strict=True):
            data.joint(name).qvel = speed
        data.actuator("spindle_drive").ctrl, data.actuator("feed_drive").ctrl = speeds["spindle"], speeds["feed"]
    return Run(compiled, data, record, per_pass, cut.total_passes, kernel)


def save_state(run: Run) -> np.ndarray:
    """The full physics state, the surface and the effects' states among it."""
    kind = mujoco.mjtState.mjSTATE_FULLPHYSICS
    state = np.empty(mujoco.mj_stateSize(run.model, kind))
    mujoco.mj_getState(run.model, run.data, state, kind)
    return state


def load_state(run: Run, state: np.ndarray, done: int) -> None:
    """Put a run at a saved state, `done` tooth passes after its start."""
    mujoco.mj_setState(run.model, run.data, state, mujoco.mjtState.mjSTATE_FULLPHYSICS)
    run.done = done


def _pass_times(run: Run, passes: int) -> np.ndarray:
    """Times at which the tooth passes start, and the end; NaN where a diverged run never came."""
    times = np.full(passes + 1, np.nan)
    times[0] = 0.0
    if passes:
        times[1:] = run.record[run.steps_per_pass - 1::run.steps_per_pass, mk.R_T1][:passes]
    return times


def simulate(model: Model, cut: Cut, sampling: Sampling, *, channels: Sequence[str] = ("displacement",),
             steps: int | None = None, catalogue: Mapping[str, Effect] | None = None) -> Recording:
    """Simulate one test with MuJoCo into a Recording, sampled after the sensor's own effects.

    steps: Runge-Kutta steps while the leading tooth crosses its cut; chosen for an error of about 1e-5 where None.
    The rig's own MJCF is simulated where the model names a machine, a one-mode model where it does not.
    ValueError for a cut that begins or ends within a pass, or until which the structure is held.
    """
    if cut.late_entry or cut.early_exit:
        raise ValueError("this engine's cuts begin and end with a tooth pass")
    if cut.held_until:
        raise ValueError("this engine's structure moves from time 0 on")
    if cut.states:
        raise ValueError("this engine's further modes stand still at time 0")
    unknown = set(channels) - set(CHANNELS)
    if unknown:
        raise ValueError(f"no channel {', '.join(sorted(unknown))}; known: {', '.join(CHANNELS)}")
    effects = known_effects() if catalogue is None else catalogue
    run = prepare(model, cut, steps=steps, catalogue=effects)
    run.advance(cut.total_passes)
    taken = int(np.count_nonzero(np.isfinite(run.record[:, mk.R_T1])))
    planar = run.record.shape[1] > mk.R_MOTION
    out = np.full((len(_OWN) + len(_FURTHER) if planar else len(_OWN), sampling.count), np.nan)
    sample_record(run.record[:taken], sampling.start, sampling.rate, out)
    signals = dict(zip((*_OWN, *_FURTHER), out, strict=False))
    signals |= {f"{name}_x": signals[name] for name in MOTION_UNITS} | {name: 0.0 * out[0] for name in _FURTHER if not planar}
    times = _pass_times(run, cut.total_passes)
    flutes = (model.cutter or Cutter()).flutes
    outcome: Outcome = "ok" if math.isnan(run.stopped) else "diverged"
    return Recording(
        channels=measured_channels(model, effects, signals, channels, sampling), sampling_rate=sampling.rate,
        units={name: UNITS[name] for name in channels}, origin="predicted", start=sampling.start,
        marks=times[::flutes], pass_times=times, outcome=outcome, outcome_time=run.stopped,
        conditions={"spindle_speed": cut.spindle_speed, "axial_depth_of_cut": cut.axial_depth_of_cut,
                    "feed_per_tooth": cut.feed_per_tooth})
