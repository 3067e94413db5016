"""`testbed effects`: the catalogue, one effect's card, or a template of a new effect's file."""

from __future__ import annotations

from typing import Any

import click

from testbed.cli._answer import Answer, check_place
from testbed.cli._options import catalogue_of, effects_option, shared
from testbed.problem import InputProblem

TEMPLATE = '''"""{title}: say here what the effect is.

Law: F = -c v |v|, a force on the structure against its motion. Replace it by your own, with its symbols.
Source: author (year), title, journal, doi.
Valid: say where the law holds, and where it does not.
"""

from testbed.effect import Effect, Parameter

EFFECT = Effect(
    title="{title}",
    parameters=(
        Parameter("coefficient", "c", "N s^2/m^2", "strength of the effect", neutral=0.0, bounds=(0.0, 1e4),
                  example=50.0),
    ),
    law="F = -c v |v|",
    source="author (year), title, doi",
    validity="say where the law holds",
    leaves="say what it leaves in a measurement",
    confused_with=(),
)


def structure_force(velocity, coefficient):
    """Force on the structure along x, N. The arguments are asked for by name; `testbed effects --hooks` lists them."""
    return -coefficient * velocity * abs(velocity)
'''


@click.command(short_help="The catalogue of effects, one effect's card, or a template of a new one.",
               epilog="Example: testbed effects process_damping; testbed effects --new my_effect")
@click.argument("name", required=False)
@click.option("--new", "new_name", metavar="NAME", help="Write NAME.py, a template of a new effect, into this folder.")
@click.option("--hooks", is_flag=True, help="List the places where an effect can act, and what it may ask for there.")
@effects_option
@shared
def command(name: str | None, new_name: str | None, hooks: bool, folders: tuple[str, ...], json_file: str | None,
            seed: int | None, quiet: bool) -> None:
    """Without NAME the catalogue; with it, that effect's law, source, parameters and what it is confused with.

    An effect of your own is one Python file: begin with --new, then give its folder to other commands as --effects DIR.
    """
    answer = Answer(json_file, quiet)
    if new_name is not None:
        _write_template(new_name, answer)
    elif hooks:
        _list_hooks(answer)
    elif name is None:
        _list_effects(catalogue_of(folders), answer)
    else:
        _show(name, catalogue_of(folders), answer)


def _list_effects(catalogue: Any, answer: Answer) -> None:
    answer.table(("effect", "what it is"), [(name, effect.title) for name, effect in catalogue.items()])
    answer.finish({"effects": [_card(effect) for effect in catalogue.values()]})


def _show(name: str, catalogue: Any, answer: Answer) -> None:
    from testbed.units import nearest

    if name not in catalogue:
        close = nearest(name, catalogue)
        raise InputProblem(name, "unknown effect", (f"did you mean {close}? " if close else "")
                           + f"known: {', '.join(catalogue)}")
    effect = catalogue[name]
    answer.say(f"{name}: {effect.title}")
    for title in ("law", "source", "validity", "leaves"):
        answer.say(f"  {title}: {getattr(effect, title)}")
    for other, test in effect.confused_with:
        answer.say(f"  confused with {other}; what separates them: {test}")
    rows = [(f"  {one.name}", one.symbol, one.unit, f"{one.neutral:g}", f"{one.bounds[0]:g} to {one.bounds[1]:g}",
             f"{one.example:g}") for one in effect.parameters]
    if rows:
        answer.table(("  parameter", "symbol", "unit", "neutral", "bounds", "example"), rows)
    answer.say("  in model.yaml: " + _as_yaml(effect))
    answer.finish(_card(effect))


def _as_yaml(effect: Any) -> str:
    from testbed.units import format_quantity

    values = ", ".join(f"{one.name}: {format_quantity(one.example, one.unit)}" for one in effect.parameters)
    return f"effects: {{{effect.name}: {{{values}}}}}"


def _card(effect: Any) -> dict[str, Any]:
    from dataclasses import asdict

    card = {title: getattr(effect, title) for title in ("name", "title", "law", "source", "validity", "leaves")}
    return card | {"parameters": [asdict(one) for one in effect.parameters], "states": list(effect.states),
                   "confused_with": [{"effect": other, "test": test} for other, test in effect.confused_with],
                   "hooks": sorted(effect.hooks), "file": str(effect.path)}


def _list_hooks(answer: Answer) -> None:
    from testbed.effect import HOOKS

    answer.table(("hook", "unit", "what it is"), [(name, hook.unit, hook.meaning) for name, hook in HOOKS.items()])
    answer.say()
    for name, hook in HOOKS.items():
        answer.say(f"{name} may ask for: {', '.join(hook.offers) or 'nothing but'}, the effect's parameters and states")
    answer.finish({name: {"unit": hook.unit, "meaning": hook.meaning, "offers": hook.offers, "joins": hook.joins}
                   for name, hook in HOOKS.items()})


def _write_template(name: str, answer: Answer) -> None:
    from pathlib import Path

    from testbed.atomic import write_text
    from testbed.effect import catalogue

    path = Path(f"{name}.py")
    if not name.isidentifier():
        raise InputProblem(name, "is no name for an effect", "use letters, digits and _")
    if name in catalogue():
        raise InputProblem(name, "is an effect of the catalogue", "choose another name")
    if path.exists():
        raise InputProblem(path, "exists already", "choose another name, or remove it")
    check_place(path)
    write_text(path, TEMPLATE.format(title=name.replace("_", " ").capitalize()))
    answer.say(f"{path}: a template; edit it, then give its folder as --effects {path.resolve().parent}")
    answer.finish({"file": str(path)})
