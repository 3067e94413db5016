"""The contract of a physical effect, and the catalogue: the effect files found in a folder.

An effect is one Python file. Its docstring is its manual; `EFFECT = Effect(...)` states its parameters; its hooks are plain
functions named after a place on the regenerative loop (`HOOKS`). A hook asks for what it needs by the names of its
arguments: quantities of that place, parameters of the effect, states of the effect. All values are SI.

    \"\"\"Cubic stiffness: F = -k3 x^3 (Duffing). ...\"\"\"
    from testbed.effect import Effect, Parameter

    EFFECT = Effect(parameters=(Parameter("coefficient", "k_3", "N/m^3", ...),), ...)

    def structure_force(displacement, coefficient):
        return -coefficient * displacement**3

Effects add up (sums) or scale (products), so a set of them has no order.
"""

from __future__ import annotations

import importlib.util
import inspect
import re
import sys
import traceback
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import lru_cache
from hashlib import sha256
from importlib.machinery import SourceFileLoader
from pathlib import Path
from types import CodeType, MappingProxyType, ModuleType

from testbed.problem import InputProblem
from testbed.units import is_si_unit, nearest

BUILT_IN = Path(__file__).parent / "effects"
SENSOR_EFFECTS = Path(__file__).parent / "sensors"
DECOYS = Path(__file__).parent / "decoys"  # laws that no machine has, in a catalogue only where they are asked for


@dataclass(frozen=True)
class Hook:
    """A place on the regenerative loop: what a function there may ask for, how contributions join, and their unit."""

    offers: tuple[str, ...]
    joins: str  # "sum", "product", "replace" (at most one effect), "value" (a derivative), "python"
    unit: str
    meaning: str


_EVERYWHERE = ("displacement", "velocity", "time")
_TOOTH = (
    "chip",
    "penetration",
    "angle",
    "edge_velocity",
    "depth",
    "cutting_speed",
    "length_cut",
    "radius",
    "feed_per_tooth",
    "tooth",
    *_EVERYWHERE,
)
_STRUCTURE = ("mass", "stiffness", "damping", *_EVERYWHERE)

HOOKS: Mapping[str, Hook] = MappingProxyType(
    {
        "edge_position": Hook(
            ("tooth", "flutes", "radius", "angle", "time"),
            "sum",
            "m",
            "radial position of a tooth's edge beyond the nominal radius",
        ),
        "relative_displacement": Hook(_EVERYWHERE, "sum", "m", "displacement of workpiece against tool beyond the mode's"),
        "relative_velocity": Hook(_EVERYWHERE, "sum", "m/s", "time derivative of relative_displacement"),
        "engagement": Hook(
            ("phase", "engagement_angle", "entry_angle", "feed_travel", "feed_per_tooth", "radius", "time"),
            "product",
            "1",
            "share of the edge in the cut at `phase` after the tooth's entry",
        ),
        "chip": Hook(("penetration",), "replace", "m", "chip thickness left of the edge's penetration below the surface"),
        "force_factor": Hook(_TOOTH, "product", "1", "factor on both cutting coefficients"),
        "tangential_force": Hook(_TOOTH, "sum", "N", "tangential force on the tooth beyond K_t b chip"),
        "normal_force": Hook(_TOOTH, "sum", "N", "normal force on the tooth beyond K_n b chip"),
        "structure_force": Hook(_STRUCTURE, "sum", "N", "force on the structure along x"),
        "derivative": Hook(
            ("applied_force", "mean_torque", *_STRUCTURE),
            "value",
            "1/s",
            "derivative_STATE: time derivative of one of the effect's own states",
        ),
        "speed": Hook(("time", "spindle_speed"), "sum", "1", "relative change of the spindle speed"),
        "sensed_displacement": Hook((), "sum", "m", "what the sensor sees beyond the mode, linear in the effect's states"),
        "sensed_velocity": Hook((), "sum", "m/s", "time derivative of sensed_displacement"),
        "immersion": Hook(("immersion",), "python", "1", "the true immersion, from the believed one"),
        "helix_angle": Hook(("helix_angle",), "python", "rad", "the true helix angle, from the believed one"),
        "measure": Hook(
            ("signal", "true_signal", "rate", "sampling_rate", "quantity", "time"),
            "python",
            "channel's",
            "the sampled channel as the sensor gives it (numpy); true_signal: as it was before any effect",
        ),
        "highest_frequency": Hook(("mass", "stiffness"), "python", "rad/s", "fastest motion the effect brings in"),
    }
)


@dataclass(frozen=True)
class Parameter:
    """One parameter of an effect. At `neutral` the effect vanishes exactly; `start` begins a fit; `example` is plain to see."""

    name: str
    symbol: str
    unit: str
    meaning: str
    neutral: float
    bounds: tuple[float, float]
    example: float
    start: float | None = None
    vanishes: bool = True  # False: the value alone does not switch the effect off (a frequency, an angle)
    each_record: bool = False  # True: every record has a value of its own (a phase at the record's start)
    channels: tuple[str, ...] = ()  # the only channels that show it: unknown where none is recorded, and may then be left out

    def __post_init__(self) -> None:
        low, high = self.bounds
        if not self.unit:
            raise ValueError(f"parameter {self.name}: no unit (dimensionless is '1')")
        if not is_si_unit(self.unit):
            raise ValueError(f"parameter {self.name}: '{self.unit}' is no SI unit (write N s/m, 1/(N m), rad, 1)")
        if not low < high:
            raise ValueError(f"parameter {self.name}: the bounds {low:g} and {high:g} are not in rising order")
        if not (low <= self.neutral <= high):
            raise ValueError(f"parameter {self.name}: the neutral value lies outside the bounds")
        if not (low <= self.example <= high):
            raise ValueError(f"parameter {self.name}: the example lies outside the bounds")


@dataclass(frozen=True)
class Effect:
    """A physical effect: what its file says of it, and its hook functions.

    leaves: what it leaves in a measurement. confused_with: (name, the test cut that separates the two).
    states: names of the effect's own ordinary differential states, each with a `derivative_STATE` hook.
    oscillators: pairs of states, neighbours in `states`, that left to themselves are a linear damped oscillator (position,
    its rate): the engines may carry them by their exact map. A promise, which the contract test checks.
    smooth: False where its law has kinks, so that integration keeps less than fourth order.
    requires: effects that a search adds first, because alone this one says nothing that they do not say.
    no_linear_answer: why the loop with this effect has no linear delay equation; empty where it has one.
    """

    title: str
    parameters: tuple[Parameter, ...]
    law: str
    source: str
    validity: str
    leaves: str
    confused_with: tuple[tuple[str, str], ...] = ()
    states: tuple[str, ...] = ()
    oscillators: tuple[tuple[str, str], ...] = ()
    smooth: bool = True
    requires: tuple[str, ...] = ()
    no_linear_answer: str = ""
    name: str = ""
    manual: str = ""
    path: Path | None = None
    hooks: Mapping[str, Callable] = field(default_factory=dict)

    def parameter(self, name: str) -> Parameter:
        """The parameter of that name; KeyError if there is none."""
        for parameter in self.parameters:
            if parameter.name == name:
                return parameter
        raise KeyError(name)

    def example(self) -> dict[str, float]:
        """Parameter values at which the effect is plain to see."""
        return {parameter.name: parameter.example for parameter in self.parameters}

    def neutral(self) -> dict[str, float]:
        """Parameter values at which the effect vanishes exactly."""
        return {parameter.name: parameter.neutral for parameter in self.parameters}

    def complete(self, values: Mapping[str, float]) -> Mapping[str, float]:
        """The values with those added, neutral, that may be left out."""
        left_out = {one.name: one.neutral for one in self.parameters if one.channels and one.name not in values}
        return {**values, **left_out} if left_out else values

    def is_neutral(self, values: Mapping[str, float]) -> bool:
        """True where any parameter that switches the effect off stands at its neutral value."""
        deciding = [parameter for parameter in self.parameters if parameter.vanishes]
        return bool(deciding) and all(values[parameter.name] == parameter.neutral for parameter in deciding)


class _FromSource(SourceFileLoader):
    """Reads a file as it stands. Python's own cache of compiled files overlooks a change of the same size within a second."""

    def get_code(self, fullname: str) -> CodeType:
        return self.source_to_code(self.get_data(self.path), self.path)


def _load_module(path: Path) -> ModuleType:
    # named by content, as the cache of compiled kernels is: what it holds refers to the module by this name
    if not path.stem.isidentifier():
        raise InputProblem(path, f"'{path.stem}' is no name for an effect", "use letters, digits and _, a letter first")
    try:
        content = path.read_bytes()
        name = f"testbed_effect_{path.stem}_{sha256(content).hexdigest()[:8]}"
        content.decode()
    except UnicodeDecodeError as fault:
        line = content.count(b"\n", 0, fault.start) + 1
        raise InputProblem(path, "is not UTF-8 text", "save it as UTF-8", line) from None
    except OSError as fault:
        raise InputProblem(path, f"cannot be read ({fault.strerror})", "check the file and its permissions") from None
    spec = importlib.util.spec_from_file_location(name, path, loader=_FromSource(name, str(path)))
    if spec is None or spec.loader is None:
        raise InputProblem(path, "cannot be read as Python", "give a .py file")
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module
    try:
        spec.loader.exec_module(module)
    except (Exception, SystemExit) as fault:  # a user's file may fail in any way; it becomes one clear line
        del sys.modules[name]
        raise _problem_of(path, fault) from fault
    return module


def _problem_of(path: Path, fault: BaseException) -> InputProblem:
    """What went wrong while the file was read, at the last of its lines that had a part in it."""
    line = getattr(fault, "lineno", None)
    for frame in traceback.extract_tb(fault.__traceback__):
        line = frame.lineno if Path(frame.filename).resolve() == path.resolve() else line
    lacking = re.search(r"(\w+)\.__init__\(\) missing .* arguments?: (.*)", str(fault))
    ours = type(fault) is ValueError and str(fault).startswith("parameter ")
    text = fault.msg if isinstance(fault, SyntaxError) else str(fault)
    what = f"{lacking[1]} lacks {lacking[2]}" if lacking else text if ours else f"{type(fault).__name__}: {text}"
    return InputProblem(path, what, "mend the effect's file", line)


def _is_own_hook(module: ModuleType, function: object) -> bool:
    """Whether the file defines this function, or takes it over from a built-in effect whose law is the same."""
    places = (module.__name__, "testbed.effects.", "testbed.sensors.")
    return inspect.isfunction(function) and function.__module__.startswith(places)


def _check_helper(path: Path, name: str, function: Callable) -> None:
    """Refuse a function that no engine would call: a hook's name misspelt, or a helper that looks like a hook."""
    if not name.startswith("_"):
        close = nearest(name, [*HOOKS, "derivative_STATE"])
        hint = f"did you mean {close}? " if close else ""
        do = f"{hint}the hooks are {', '.join(HOOKS)}; a helper's name begins with _"
        raise InputProblem(path, f"{name}() is no hook", do, function.__code__.co_firstlineno)


def _check_hook(path: Path, effect: Effect, name: str, function: Callable) -> None:
    place = "derivative" if name.startswith("derivative_") else name
    line = function.__code__.co_firstlineno
    if place != name and name.removeprefix("derivative_") not in effect.states:
        raise InputProblem(path, f"{name}() belongs to no state", "name the state in `states`", line)
    known = {*HOOKS[place].offers, *effect.states, *(parameter.name for parameter in effect.parameters)}
    for argument in inspect.signature(function).parameters:
        if argument not in known:
            raise InputProblem(path, f"{name}() asks for '{argument}'", f"it may ask for {', '.join(sorted(known))}", line)


def read_effect(path: Path) -> Effect:
    """Read and check one effect file. InputProblem where the contract is broken."""
    module = _load_module(path)
    effect = getattr(module, "EFFECT", None)
    if not isinstance(effect, Effect):
        raise InputProblem(path, "no EFFECT = Effect(...) in it", "see `testbed effects --new NAME` for a template")
    hooks = {}
    for name, function in vars(module).items():
        place = "derivative" if name.startswith("derivative_") else name
        if place in HOOKS and _is_own_hook(module, function):
            _check_hook(path, effect, name, function)
            hooks[name] = function
        elif inspect.isfunction(function) and function.__module__ == module.__name__:
            _check_helper(path, name, function)
    lines = path.read_text("utf-8").splitlines()
    line = next((number for number, text in enumerate(lines, 1) if text.startswith("EFFECT")), None)
    if not hooks:
        raise InputProblem(path, "no hook function in it", f"define one of {', '.join(HOOKS)}", line)
    for state in effect.states:
        if f"derivative_{state}" not in hooks:
            raise InputProblem(path, f"state '{state}' has no derivative", f"define derivative_{state}(...)", line)
    for position, rate in effect.oscillators:
        if (position, rate) not in zip(effect.states, effect.states[1:], strict=False):
            raise InputProblem(path, f"oscillator ({position}, {rate}) is no pair of neighbouring states", "see `states`", line)
    if effect.parameters and not any(parameter.vanishes for parameter in effect.parameters):
        raise InputProblem(path, "no parameter switches the effect off", "give one a neutral value with vanishes=True", line)
    names = [parameter.name for parameter in effect.parameters]
    if len(set(names)) != len(names):
        raise InputProblem(path, "two parameters of one name", "rename one", line)
    return replace(effect, name=path.stem, manual=(module.__doc__ or "").strip(), path=path, hooks=MappingProxyType(hooks))


def catalogue(*folders: str | Path) -> Mapping[str, Effect]:
    """The effects found in the built-in folders and in `folders`, by name, in alphabetical order."""
    return _catalogue(folders, tuple(Path(folder).resolve() for folder in folders))


@lru_cache(maxsize=8)
def _catalogue(folders: tuple[str | Path, ...], _places: tuple[Path, ...]) -> Mapping[str, Effect]:
    """Read once for the places that the folders are: a relative one is another place in another working folder."""
    found: dict[str, Effect] = {}
    for folder in (BUILT_IN, SENSOR_EFFECTS, *map(Path, folders)):
        if not folder.is_dir():
            raise InputProblem(folder, "is not a folder", "name a folder of effect files")
        for path in sorted(folder.glob("*.py")):
            if path.name.startswith("_") or path.stem == "chain" or path.name.startswith("test_"):
                continue
            if path.stem in found:
                raise InputProblem(
                    path, f"an effect named '{path.stem}' exists already ({found[path.stem].path})", "rename the file"
                )
            found[path.stem] = read_effect(path)
            if folder not in (BUILT_IN, SENSOR_EFFECTS):  # the built-in ones are compiled by their tests
                from testbed.compilable import check_compilable  # it needs this module, and numba is slow to import

                check_compilable(found[path.stem])
    for effect in found.values():
        unknown = [name for name in effect.requires if name not in found]
        if unknown:
            raise InputProblem(effect.path, f"requires the unknown effect '{unknown[0]}'", f"known: {', '.join(sorted(found))}")
    return MappingProxyType(dict(sorted(found.items())))
