"""The cut as a native MuJoCo engine plugin: numba C functions, registered from Python; no Python in the loop.

One plugin a catalogue of effects. `compute` runs at each of the four Runge-Kutta stages and adds the forces to the
joints of the modes; `advance` runs once a step. All that changes is in mjData's plugin state, all settings in the model's first
custom numeric, and the model's time step is rewritten as the run goes: one model a run, and threads share nothing.
"""

from __future__ import annotations

import ctypes
import threading
from collections.abc import Mapping
from types import ModuleType

import mujoco
from numba import carray, cfunc, types
from numba.extending import intrinsic

from testbed.effect import Effect
from testbed.engines import mujoco_abi as abi
from testbed.engines.compose import compose
from testbed.engines.mujoco_kernel import M_DOF, M_MODES, M_RECORD, M_ROWS, U_DT, U_STAGE

KERNELS = ("array_kernel", "plane_kernel", "loop_kernel", "oscillator_kernel", "front_kernel", "mujoco_kernel")
_CALLBACKS = ("nstate", "nsensordata", "init", "destroy", "copy", "reset", "compute", "advance", "visualize",
              "actuator_act_dot", "sdf_distance", "sdf_gradient", "sdf_staticdistance", "sdf_attribute", "sdf_aabb")
STATE_SIZE_KEY = b"state_size"


class _Plugin(ctypes.Structure):  # mjpPlugin, which the introspection tables leave out
    _fields_ = [("name", ctypes.c_char_p), ("nattribute", ctypes.c_int),
                ("attributes", ctypes.POINTER(ctypes.c_char_p)), ("capabilityflags", ctypes.c_int),
                ("needstage", ctypes.c_int), *((name, ctypes.c_void_p) for name in _CALLBACKS)]


def _caster(pointer_type):
    @intrinsic
    def cast(typing_context, address):
        def build(context, builder, signature, arguments):
            return builder.inttoptr(arguments[0], context.get_value_type(signature.return_type))
        return pointer_type(types.intp), build
    return cast


_doubles, _addresses, _integers, _bytes = (
    _caster(types.CPointer(kind)) for kind in (types.float64, types.intp, types.int32, types.uint8))
_key = ctypes.create_string_buffer(STATE_SIZE_KEY)
_KEY = ctypes.addressof(_key)


def _callbacks(kernel: ModuleType) -> dict:
    """The five C functions around one compiled catalogue."""
    start_run, stage_force, end_step = kernel.start_run, kernel.stage_force, kernel.end_step
    qpos, qvel, force, time, state = abi.QPOS, abi.QVEL, abi.QFRC_PASSIVE, abi.TIME, abi.PLUGIN_STATE
    numeric, number, address, timestep = abi.NUMERIC_DATA, abi.STATE_NUMBER, abi.STATE_ADDRESS, abi.TIMESTEP
    get_config = abi.library().mj_getPluginConfig
    get_config.argtypes, get_config.restype = [ctypes.c_void_p, ctypes.c_int, ctypes.c_void_p], ctypes.c_void_p
    key, settings, row_size = _KEY, 1 << 16, kernel.R_SIZE

    @cfunc(types.int32(types.intp, types.int32))
    def nstate(m, instance):  # asked while the model is compiled, before the numerics exist: the size is an attribute
        text = _bytes(get_config(m, instance, key))
        size, place = 0, 0
        while 48 <= text[place] <= 57:
            size = 10 * size + text[place] - 48
            place += 1
        return size

    @cfunc(types.int32(types.intp, types.intp, types.int32))
    def init(m, d, instance):
        return 0

    @cfunc(types.void(types.intp, types.intp, types.intp, types.int32))
    def reset(m, plugin_state, plugin_data, instance):  # the engine does not clear plugin_state itself
        size = _integers(_addresses(m + number)[0])[instance]
        start_run(carray(_doubles(_addresses(m + numeric)[0]), (settings,)), carray(_doubles(plugin_state), (size,)))

    @cfunc(types.void(types.intp, types.intp, types.int32, types.int32))
    def compute(m, d, instance, capability):
        N = carray(_doubles(_addresses(m + numeric)[0]), (settings,))
        size = _integers(_addresses(m + number)[0])[instance]
        place = _integers(_addresses(m + address)[0])[instance]
        U = carray(_doubles(_addresses(d + state)[0] + 8 * place), (size,))
        first, modes = 8 * int(N[M_DOF]), int(N[M_MODES])
        stage_force(N, U, _doubles(d + time)[0], carray(_doubles(_addresses(d + qpos)[0] + first), (modes,)),
                    carray(_doubles(_addresses(d + qvel)[0] + first), (modes,)),
                    carray(_doubles(_addresses(d + force)[0] + first), (modes,)))
        if U[U_STAGE] == 0.0:  # MuJoCo reads the step only after the first stage
            _doubles(m + timestep)[0] = U[U_DT]

    @cfunc(types.void(types.intp, types.intp, types.int32))
    def advance(m, d, instance):
        N = carray(_doubles(_addresses(m + numeric)[0]), (settings,))
        size = _integers(_addresses(m + number)[0])[instance]
        place = _integers(_addresses(m + address)[0])[instance]
        U = carray(_doubles(_addresses(d + state)[0] + 8 * place), (size,))
        R = carray(_doubles(int(N[M_RECORD])), (int(N[M_ROWS]) * row_size,))
        first, modes = 8 * int(N[M_DOF]), int(N[M_MODES])
        end_step(N, U, R, _doubles(d + time)[0], carray(_doubles(_addresses(d + qpos)[0] + first), (modes,)),
                 carray(_doubles(_addresses(d + qvel)[0] + first), (modes,)))

    return {"nstate": nstate, "init": init, "reset": reset, "compute": compute, "advance": advance}


@cfunc(types.void(types.intp))
def _silent(message):
    """Warnings are read from mjData; without a handler MuJoCo would write MUJOCO_LOG.TXT where the user works."""


_alive: list = []  # what the C side points into
_registered: dict[tuple[int, bool], tuple[Mapping[str, Effect], str, ModuleType]] = {}
_lock = threading.Lock()


def _add(name: str, kernel: ModuleType) -> None:
    functions = _callbacks(kernel)
    plugin = _Plugin()
    library = abi.library()
    library.mjp_defaultPlugin.argtypes = library.mjp_registerPlugin.argtypes = [ctypes.c_void_p]
    library.mjp_defaultPlugin(ctypes.byref(plugin))
    attributes = (ctypes.c_char_p * 1)(STATE_SIZE_KEY)
    plugin.name, plugin.nattribute, plugin.attributes = name.encode(), 1, attributes
    plugin.capabilityflags = int(mujoco.mjtPluginCapabilityBit.mjPLUGIN_PASSIVE)
    for callback, function in functions.items():
        setattr(plugin, callback, function.address)
    _alive.append((plugin, attributes, functions))
    if library.mjp_registerPlugin(ctypes.byref(plugin)) < 0:
        raise RuntimeError(f"MuJoCo refused the plugin {name}")


def register(effects: Mapping[str, Effect], planar: bool = False) -> tuple[str, ModuleType]:
    """(name of the plugin that cuts with this catalogue's effects, its compiled kernel); made once a process.

    planar: for structures with more than one mode along the feed.
    """
    with _lock:
        known = _registered.get((id(effects), planar))
        if known is not None and known[0] is effects:
            return known[1], known[2]
        abi.check()
        ctypes.c_void_p.in_dll(abi.library(), "mju_user_warning").value = _silent.address
        kernel = compose(effects, KERNELS, planar)
        name = f"testbed.cut.{len(_registered)}"
        _add(name, kernel)
        _registered[id(effects), planar] = (effects, name, kernel)
        return name, kernel
