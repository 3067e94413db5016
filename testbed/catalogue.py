"""The catalogue of effects: effect files found in folders, read and checked."""

from __future__ import annotations

import importlib.util
import inspect
import os
import re
import sys
import traceback
from collections.abc import Callable, Collection, Iterable, Mapping
from dataclasses import replace
from functools import lru_cache
from hashlib import sha256
from importlib.machinery import SourceFileLoader
from pathlib import Path
from types import CodeType, MappingProxyType, ModuleType

from testbed.effect import HOOKS, Effect
from testbed.files.door import content
from testbed.problem import InputProblem
from testbed.trial.compilable import check_compilable
from testbed.trial.effect_checks import check_source, check_texts
from testbed.trial.effect_trial import defines_effect, try_effect
from testbed.units import nearest

BUILT_IN = Path(__file__).parent / "effects"
SENSOR_EFFECTS = Path(__file__).parent / "sensors"
MOST_BYTES = 1_000_000  # of an effect's file
_NO_EFFECT = ("no EFFECT = Effect(...) in it", "see `testbed effects --new NAME` for a template")
DECOYS = Path(__file__).parent / "decoys"  # laws that no machine has, in a catalogue only where they are asked for


def titled(names: Iterable[str], catalogue: Mapping[str, Effect]) -> str:
    """Effects for people, title and name of each; a name that the catalogue does not have as it is."""
    return ", ".join(catalogue[name].titled if name in catalogue else name for name in names)


class _FromSource(SourceFileLoader):
    """Reads a file as it stands. Python's own cache of compiled files overlooks a change of the same size within a second."""

    def get_code(self, fullname: str) -> CodeType:
        return self.source_to_code(self.get_data(self.path), self.path)


def _load_module(path: Path) -> ModuleType:
    # named by content, as the cache of compiled kernels is: what it holds refers to the module by this name
    if not path.stem.isidentifier():
        raise InputProblem(path, f"'{path.stem}' is no name for an effect", "use letters, digits and _, a letter first")
    text, name = _text(path)
    if path.parent not in (BUILT_IN, SENSOR_EFFECTS):
        check_source(path, text)
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


def _text(path: Path) -> tuple[str, str]:
    """(text of an effect's file, its module's name)."""
    raw = content(path, MOST_BYTES, "a law is a few lines")
    try:
        return raw.decode(), f"testbed_effect_{path.stem}_{sha256(raw).hexdigest()[:8]}"
    except UnicodeDecodeError as fault:
        line = raw.count(b"\n", 0, fault.start) + 1
        raise InputProblem(path, "is not UTF-8 text", "save it as UTF-8", line) from None


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
    known = {*HOOKS[place].offers, *effect.states, *(parameter.name for parameter in effect.every_parameter)}
    for argument in inspect.signature(function).parameters:
        if argument not in known:
            raise InputProblem(path, f"{name}() asks for '{argument}'", f"it may ask for {', '.join(sorted(known))}", line)


def _check_slider(path: Path, effect: Effect, hooks: Iterable[str], line: int | None) -> None:
    """A spring and slider has one state, a parameter where it slides, and no law but its own."""
    if effect.slider is None:
        return
    state, parameter = effect.slider
    if effect.states != (state,) or parameter not in [one.name for one in effect.parameters]:
        raise InputProblem(path, f"slider ({state}, {parameter}) is not its one state and a parameter", "see `states`", line)
    if {*hooks} - {"highest_frequency"} != {"structure_force", f"derivative_{state}"}:
        raise InputProblem(path, "a slider has structure_force and its state's derivative alone", "leave `slider` out", line)


def read_effect(path: Path) -> Effect:
    """Read and check one effect file. InputProblem where the contract is broken."""
    if path.parent not in (BUILT_IN, SENSOR_EFFECTS) and not defines_effect(_text(path)[0]):
        raise InputProblem(path, *_NO_EFFECT)
    module = _load_module(path)
    effect = getattr(module, "EFFECT", None)
    if not isinstance(effect, Effect):
        raise InputProblem(path, *_NO_EFFECT)
    lines = path.read_text("utf-8").splitlines()
    line = next((number for number, text in enumerate(lines, 1) if text.startswith("EFFECT")), None)
    check_texts(path, effect, line)
    hooks = {}
    for name, function in vars(module).items():
        place = "derivative" if name.startswith("derivative_") else name
        if place in HOOKS and _is_own_hook(module, function):
            _check_hook(path, effect, name, function)
            hooks[name] = function
        elif inspect.isfunction(function) and function.__module__ == module.__name__:
            _check_helper(path, name, function)
    if not hooks:
        raise InputProblem(path, "no hook function in it", f"define one of {', '.join(HOOKS)}", line)
    for state in effect.states:
        if f"derivative_{state}" not in hooks:
            raise InputProblem(path, f"state '{state}' has no derivative", f"define derivative_{state}(...)", line)
    for position, rate in effect.oscillators:
        if (position, rate) not in zip(effect.states, effect.states[1:], strict=False):
            raise InputProblem(path, f"oscillator ({position}, {rate}) is no pair of neighbouring states", "see `states`", line)
    _check_slider(path, effect, hooks, line)
    if effect.parameters and not any(parameter.vanishes for parameter in effect.parameters):
        raise InputProblem(path, "no parameter switches the effect off", "give one a neutral value with vanishes=True", line)
    names = [parameter.name for parameter in effect.every_parameter]
    if len(set(names)) != len(names):
        raise InputProblem(path, "two parameters of one name", "rename one", line)
    return replace(effect, name=path.stem, manual=(module.__doc__ or "").strip(), path=path, hooks=MappingProxyType(hooks))


def catalogue(*folders: str | Path) -> Mapping[str, Effect]:
    """The effects found in the built-in folders and in `folders`, by name, in alphabetical order."""
    return _catalogue(folders, tuple(os.path.realpath(folder) for folder in folders))


def unknown_effect(name: str, known: Collection[str], all_known: str = "") -> str:
    """What to do about an effect that is not among those known: the nearest of them, else where one's own is looked for.

    all_known: what to say in place of their names.
    """
    close, others = nearest(name, known), all_known or f"known: {', '.join(known)}"
    own = "for one of your own give the folder of its file: --effects DIR"
    return f"did you mean {close}? {others}" if close else f"{others}; {own}"


def _files(folder: Path) -> list[Path]:
    """The Python files of a folder; InputProblem where it is none or cannot be read, which glob takes for empty."""
    try:
        return sorted(folder / name for name in os.listdir(folder) if name.endswith(".py"))
    except (FileNotFoundError, NotADirectoryError):
        raise InputProblem(folder, "is not a folder", "name a folder of effect files") from None
    except ValueError:
        raise InputProblem(repr(str(folder)), "is no name of a folder", "name a folder of effect files") from None
    except OSError as fault:
        raise InputProblem(folder, f"cannot be read ({fault.strerror})", "check its permissions") from None


@lru_cache(maxsize=8)
def _catalogue(folders: tuple[str | Path, ...], _places: tuple[str, ...]) -> Mapping[str, Effect]:
    """Read once for the places that the folders are: a relative one is another place in another working folder."""
    found: dict[str, Effect] = {}
    for folder in (BUILT_IN, SENSOR_EFFECTS, *map(Path, folders)):
        for path in _files(folder):
            if path.name.startswith("_") or path.stem == "chain" or path.name.startswith("test_"):
                continue
            own = folder not in (BUILT_IN, SENSOR_EFFECTS)
            if own and defines_effect(_text(path)[0]) is False:
                continue  # a script that lies beside them: it is not run
            if path.stem in found:
                raise InputProblem(
                    path, f"an effect named '{path.stem}' exists already ({found[path.stem].path})", "rename the file"
                )
            if own:  # the built-in ones are tried, and compiled, by their tests
                try_effect(path, read_effect)
            found[path.stem] = read_effect(path)
            if own:
                check_compilable(found[path.stem])
    for effect in found.values():
        unknown = [name for name in effect.requires if name not in found]
        if unknown:
            raise InputProblem(effect.path, f"requires the unknown effect '{unknown[0]}'", f"known: {', '.join(sorted(found))}")
    return MappingProxyType(dict(sorted(found.items())))
