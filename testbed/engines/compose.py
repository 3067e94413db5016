"""Turn a catalogue of effects into compiled hooks: one generated module a catalogue, compiled once and cached on disk.

The module is text: the effects' functions joined hook by hook, each behind its effect's flag, followed by the kernels'
own source, in which the names of `testbed.engines.hooks` now mean the joined functions. What is compiled of it is kept
(`testbed.system.kernel_cache`), so the second start of any command compiles nothing.
"""

from __future__ import annotations

import ast
import inspect
import linecache
import marshal
import sys
from collections.abc import Mapping
from hashlib import sha256
from importlib.metadata import version
from pathlib import Path
from threading import RLock
from types import ModuleType

from testbed.effect import ACROSS_OFFERS, HOOKS, Effect
from testbed.engines import hooks as base_hooks
from testbed.system.kernel_cache import keep, read

ENGINES = Path(__file__).parent
FAST = ("array_kernel", "plane_kernel", "loop_kernel", "oscillator_kernel", "front_kernel", "sampling_kernel",
        "slider_kernel", "glide_kernel", "fast_kernel")  # fmt: skip
# what the state gives, on a structure of one mode along the feed, and on any other
_SLOTS = {"displacement": "Y[0]", "velocity": "Y[1]", "time": "Y[2]"} | dict.fromkeys(ACROSS_OFFERS, "0.0")
_PLANAR_SLOTS = {"displacement": "structure_x(P, Y)", "velocity": "structure_vx(P, Y)", "displacement_y": "structure_y(P, Y)",
                 "velocity_y": "structure_vy(P, Y)", "time": "Y[2]"}  # fmt: skip
# and where the state holds what all modes come to: [x (m), x' (m/s), time (s), y, y']
_GIVEN_SLOTS = {"displacement": "Y[0]", "velocity": "Y[1]", "time": "Y[2]", "displacement_y": "Y[3]", "velocity_y": "Y[4]"}
_COMPILED = [name for name, hook in HOOKS.items() if hook.joins in ("sum", "product", "replace")]


class Layout:
    """Where each effect's flag, parameters and states lie in the arrays the kernels are given, sorted by name.

    planar: for the kernels of structures with more than one mode along the feed. given: for those of them that carry the modes
    themselves, and hand on where the structure is, and how fast.
    """

    def __init__(self, effects: Mapping[str, Effect], planar: bool = False, given: bool = False) -> None:
        self.planar, self.given = planar, given
        self.slots = _GIVEN_SLOTS if given else _PLANAR_SLOTS if planar else _SLOTS
        self.effects = dict(sorted(effects.items()))
        self.flag = {name: index for index, name in enumerate(self.effects)}
        self.parameter: dict[tuple[str, str], int] = {}
        self.state: dict[tuple[str, str], int] = {}
        for name, effect in self.effects.items():
            for parameter in effect.every_parameter:
                self.parameter[name, parameter.name] = len(self.parameter)
            for state in effect.states:
                self.state[name, state] = 3 + len(self.state)
        self.parameters = max(1, len(self.parameter))
        self.oscillators = 1 + sum(len(effect.oscillators) for effect in effects.values())


def _argument(layout: Layout, effect: Effect, argument: str) -> str:
    if (effect.name, argument) in layout.state:
        return f"Y[{layout.state[effect.name, argument]}]"
    if (effect.name, argument) in layout.parameter:
        return f"P[{layout.parameter[effect.name, argument]}]"
    return layout.slots.get(argument, argument)


def _call(layout: Layout, effect: Effect, hook: str) -> str:
    arguments = inspect.signature(effect.hooks[hook]).parameters
    return f"{effect.name}__{hook}({', '.join(_argument(layout, effect, name) for name in arguments)})"


def _hook_text(layout: Layout, hook: str) -> list[str]:
    base = getattr(base_hooks, f"hook_{hook}").py_func
    joins = HOOKS[hook].joins
    start = {"sum": "0.0", "product": "1.0", "replace": "penetration"}[joins]
    lines = ["@inner", f"def hook_{hook}({', '.join(inspect.signature(base).parameters)}):", f"    total = {start}"]
    for effect in layout.effects.values():
        if hook in effect.hooks:
            sign = {"sum": "+=", "product": "*=", "replace": "="}[joins]
            lines += [f"    if A[{layout.flag[effect.name]}] != 0.0:",
                      f"        total {sign} {_call(layout, effect, hook)}"]
    return [*lines, "    return total", "", ""]


def _derivatives_text(layout: Layout) -> list[str]:
    base = base_hooks.hook_derivatives.py_func
    lines = ["@inner", f"def hook_derivatives({', '.join(inspect.signature(base).parameters)}):", "    pass"]
    for effect in layout.effects.values():
        for state in effect.states:
            slot = layout.state[effect.name, state]
            lines += [f"    D[{slot}] = 0.0", f"    if A[{layout.flag[effect.name]}] != 0.0:",
                      f"        D[{slot}] = {_call(layout, effect, f'derivative_{state}')}"]
    return [*lines, "", ""]


def _import_text(effects: Mapping[str, Effect]) -> list[str]:
    lines = ["from testbed.engines.compiled import holding, inner", "from testbed.system.kernel_cache import kept", ""]
    for effect in effects.values():
        for hook in effect.hooks:
            if hook in _COMPILED or hook.startswith("derivative_"):
                lines.append(f"{effect.name}__{hook} = inner(HOOKS[{effect.name!r}][{hook!r}])")
    return [*lines, "", ""]


def _kernel_text(name: str) -> str:
    """A kernel's source without what it imports from the project: those names are in the generated module already."""
    path = ENGINES / f"{name}.py"
    lines = path.read_text().splitlines()
    for node in ast.parse(path.read_text()).body:
        if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("testbed."):
            lines[node.lineno - 1 : node.end_lineno] = [""] * ((node.end_lineno or node.lineno) - node.lineno + 1)
    return "\n".join(lines) + "\n"


def _module_text(layout: Layout, kernels: tuple[str, ...]) -> str:
    constants = [f"PLANAR, GIVEN = {layout.planar}, {layout.given}",
                 f"N_STATES, N_PARAMETERS = {len(layout.state)}, {layout.parameters}"]
    lines = [*_import_text(layout.effects), *constants, "", ""]
    for hook in _COMPILED:
        lines += _hook_text(layout, hook)
    lines += _derivatives_text(layout)
    return "\n".join(lines) + "\n\n".join(_kernel_text(name) for name in kernels)


def _compose(key: str, text: str, effects: Mapping[str, Effect]) -> ModuleType:
    """The module of a text, in which HOOKS are the Python functions of the effects by name and hook."""
    name = f"testbed_kernels_{key}"
    if name in sys.modules:
        return sys.modules[name]
    file = f"<{name}>"
    linecache.cache[file] = (len(text), None, text.splitlines(keepends=True), file)  # what a traceback shows
    body = read(f"{name}.code")
    code = compile(text, file, "exec") if body is None else marshal.loads(body)
    if body is None:
        keep(f"{name}.code", marshal.dumps(code))
    module = ModuleType(name)
    module.__dict__["HOOKS"] = {effect.name: effect.hooks for effect in effects.values()}
    exec(code, module.__dict__)
    sys.modules[name] = module
    return module


_ONE_AT_A_TIME = RLock()  # ast.parse on several threads fails in Python 3.11, and numba compiles one module at a time
_Kind = tuple[int, tuple[str, ...], bool, bool]
_modules: dict[_Kind, tuple[Mapping[str, Effect], ModuleType]] = {}


def compose(effects: Mapping[str, Effect], kernels: tuple[str, ...], planar: bool = False, given: bool = False) -> ModuleType:
    """The kernels (names of files in testbed/engines) over this catalogue's hooks.

    planar: for structures with more than one mode along the feed; those of one mode keep kernels without a loop over modes.
    given: see `Layout`; of effects without states.
    """
    kind = (id(effects), kernels, planar, given)
    known = _modules.get(kind)
    if known is not None and known[0] is effects:
        return known[1]
    with _ONE_AT_A_TIME:
        known = _modules.get(kind)
        if known is None or known[0] is not effects:  # else by another thread, while this one waited
            layout = Layout(effects, planar, given)
            known = _modules[kind] = (effects, _compose(*_keyed(layout, kernels), effects))
        return known[1]


def _keyed(layout: Layout, kernels: tuple[str, ...]) -> tuple[str, str]:
    """(a hash of all that compiled code depends on, the text of the module)."""
    text, by_name = _module_text(layout, kernels), layout.effects.values()
    sources = "".join(effect.path.read_text() for effect in by_name if effect.path)
    modules = " ".join(hook.__module__ for effect in by_name for hook in effect.hooks.values())  # kept in code
    stamp = "|".join([text, sources, modules, version("numba"), version("numpy"), sys.version])
    return sha256(stamp.encode()).hexdigest()[:16], text


def composed_before(effects: Mapping[str, Effect], kernels: tuple[str, ...] = FAST) -> bool:
    """Whether this process or an earlier one has had the kernels of one mode over these effects: else they compile first."""
    name = f"testbed_kernels_{_keyed(Layout(effects), kernels)[0]}"
    return name in sys.modules or read(f"{name}.code") is not None
