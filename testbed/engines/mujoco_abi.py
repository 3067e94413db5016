"""Where MuJoCo keeps what the plugin reads and writes: byte offsets from the installed build's own tables.

The offsets come from `mujoco.introspect`, which is generated from the same headers as the library. `check()` compares
them with a live model before anything is written through them; nothing here is a number typed in by hand.
"""

from __future__ import annotations

import ctypes
import glob
import os
from functools import lru_cache

import mujoco
from mujoco.introspect import ast_nodes, structs

_BASIC = {"int": ctypes.c_int, "unsigned int": ctypes.c_uint, "float": ctypes.c_float, "double": ctypes.c_double,
          "mjtNum": ctypes.c_double, "char": ctypes.c_char, "size_t": ctypes.c_size_t, "uintptr_t": ctypes.c_size_t,
          "mjtSize": ctypes.c_int64, "mjtByte": ctypes.c_uint8, "mjtBool": ctypes.c_uint8,
          "uint64_t": ctypes.c_uint64}


def _c_type(node):
    if isinstance(node, ast_nodes.PointerType):
        return ctypes.c_void_p
    if isinstance(node, ast_nodes.ArrayType):
        kind = _c_type(node.inner_type)
        for extent in reversed(node.extents):
            kind = kind * extent
        return kind
    if hasattr(node, "fields"):
        return type("anonymous", (ctypes.Structure,), {"_fields_": [(f.name, _c_type(f.type)) for f in node.fields]})
    if node.name in _BASIC:
        return _BASIC[node.name]
    return struct(node.name) if node.name in structs.STRUCTS else ctypes.c_int  # what is left are enumerations


@lru_cache(maxsize=64)
def struct(name: str):
    """The ctypes structure of a MuJoCo struct, laid out as in the installed build."""
    fields = [(field.name, _c_type(field.type)) for field in structs.STRUCTS[name].fields]
    return type(name, (ctypes.Structure,), {"_fields_": fields})


_DATA, _MODEL = struct("mjData"), struct("mjModel")
TIME, QPOS, QVEL, QFRC_PASSIVE, PLUGIN_STATE = (
    getattr(_DATA, name).offset for name in ("time", "qpos", "qvel", "qfrc_passive", "plugin_state"))
NUMERIC_DATA, STATE_NUMBER, STATE_ADDRESS = (
    getattr(_MODEL, name).offset for name in ("numeric_data", "plugin_statenum", "plugin_stateadr"))
TIMESTEP = _MODEL.opt.offset + struct("mjOption").timestep.offset


@lru_cache(maxsize=1)
def library() -> ctypes.CDLL:
    """The MuJoCo library that the Python module has loaded already."""
    folder = os.path.dirname(mujoco.__file__)
    found = sorted(path for pattern in ("libmujoco.so*", "libmujoco*.dylib", "mujoco.dll")
                   for path in glob.glob(os.path.join(folder, pattern)))
    if not found:
        raise RuntimeError(f"no MuJoCo library in {folder}: reinstall mujoco")
    return ctypes.CDLL(found[0])


_PROBE = """<mujoco><option timestep="0.0123"/><custom><numeric name="cut" data="3 1 4"/></custom>
<worldbody><body><joint type="slide"/><geom size="1"/></body></worldbody></mujoco>"""


@lru_cache(maxsize=1)
def check() -> None:
    """Compare the offsets with a live model. RuntimeError where this MuJoCo's layout is not what its tables say."""
    model = mujoco.MjModel.from_xml_string(_PROBE)
    data = mujoco.MjData(model)
    data.time = 0.25

    def pointer(base: int, offset: int) -> int | None:
        return ctypes.c_void_p.from_address(base + offset).value

    def number(base: int, offset: int) -> float:
        return ctypes.c_double.from_address(base + offset).value

    agrees = (
        pointer(data._address, QPOS) == data.qpos.ctypes.data
        and pointer(data._address, QVEL) == data.qvel.ctypes.data
        and pointer(data._address, QFRC_PASSIVE) == data.qfrc_passive.ctypes.data
        and number(data._address, TIME) == 0.25
        and pointer(model._address, NUMERIC_DATA) == model.numeric_data.ctypes.data
        and number(model._address, TIMESTEP) == 0.0123
    )
    if not agrees:
        raise RuntimeError(f"mujoco {mujoco.__version__} lays out its structures unlike its own tables: "
                           "install the version this project names, or use the fast engine")
