"""The catalogue of effects: each effect's card, and a template of a new one."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

from testbed.api.believed import Effects, EffectsLike, File, effects_of
from testbed.api.places import check_place, made_folder
from testbed.problem import InputProblem

if TYPE_CHECKING:
    from testbed.effect import Effect


def list_effects(effects: EffectsLike = ()) -> Effects:
    """The effects known, by name: those of the catalogue, and those of folders of one's own.

    Each has `title`, `law`, `source`, `validity`, `parameters`, `confused_with`: what `testbed effects NAME` prints. The
    command's JSON is `effect_card` of each. InputProblem names a file that breaks the contract.
    """
    return effects_of(effects)


def effect_card(name: str, effects: EffectsLike = ()) -> dict[str, Any]:
    """What `testbed effects NAME --json` writes of an effect: law, source, parameters, what it is confused with.

    InputProblem where there is none of that name.
    """
    return card(named(name, effects_of(effects)))


def named(name: str, known: Effects) -> Effect:
    """The effect of that name. InputProblem, with the nearest one, where there is none."""
    from testbed.catalogue import unknown_effect

    if name not in known:
        raise InputProblem(name, "unknown effect", unknown_effect(name, known))
    return known[name]


def card(effect: Effect) -> dict[str, Any]:
    """An effect as plain values."""
    found = {title: getattr(effect, title) for title in ("name", "title", "law", "source", "validity", "leaves")}
    return found | {"parameters": [asdict(one) for one in effect.parameters],
                    "form": [asdict(one) for one in effect.form], "states": list(effect.states),
                    "confused_with": [{"effect": other, "test": test} for other, test in effect.confused_with],
                    "requires": list(effect.requires), "hooks": sorted(effect.hooks), "file": str(effect.path)}


def new_effect(name: str, folder: File = ".") -> tuple[Path, Path]:
    """Write NAME.py, an effect that works as it stands, and test_NAME.py into a folder, which is made; their paths.

    InputProblem where the name is none for an effect, or one of the two is there already.
    """
    from keyword import iskeyword

    from testbed.api.effect_template import EFFECT, TEST
    from testbed.catalogue import catalogue
    from testbed.system.atomic import write_text

    if not name.isidentifier() or name.startswith(("_", "test_")):
        raise InputProblem(name, "is no name for an effect", "use letters, digits and _, a letter first")
    if iskeyword(name):
        raise InputProblem(name, "is a word of Python", "choose another name")
    if name in catalogue():
        raise InputProblem(name, "is an effect of the catalogue", "choose another name")
    place = made_folder(folder)
    paths = place / f"{name}.py", place / f"test_{name}.py"
    for path in paths:
        check_place(path)
        if path.exists():
            raise InputProblem(path, "exists already", "choose another name, or remove it")
    for path, text in zip(paths, (EFFECT, TEST), strict=True):
        write_text(path, text.replace("NAME", name).replace("TITLE", name.replace("_", " ").capitalize()))
    return paths
