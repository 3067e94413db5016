"""`testbed effects`: the catalogue, one effect's card, or a template of a new effect's file."""

from __future__ import annotations

from typing import Any

import click

from testbed.cli._answer import Answer
from testbed.cli._options import effects_option, shared


@click.command(short_help="The catalogue of effects, one effect's card, or a template of a new one.",
               epilog="Example: testbed effects process_damping; testbed effects --new my_effect")
@click.argument("name", required=False)
@click.option("--new", "new_name", metavar="NAME", help="Write NAME.py, a template of a new effect, into this folder.")
@click.option("--no-picture", is_flag=True, help="Leave out the drawing of what it does, for which an effect is compiled.")
@click.option("--hooks", is_flag=True, help="List the places where an effect can act, and what it may ask for there.")
@effects_option
@shared
def command(name: str | None, new_name: str | None, no_picture: bool, hooks: bool, folders: tuple[str, ...],
            json_file: str | None, seed: int | None, quiet: bool) -> None:
    """Without NAME the catalogue; with it, that effect's law, source, parameters and what it is confused with.

    An effect of your own is one Python file: begin with --new, then give its folder to other commands as --effects DIR.
    Such a file is a program, and is run: read one that is not yours first. Files beside it without an EFFECT are not run.
    """
    from testbed.api.effects import list_effects

    answer = Answer(json_file, quiet)
    if new_name is not None:
        _write_template(new_name, answer)
    elif hooks:
        _list_hooks(answer)
    elif name is None:
        _list_effects(list_effects(folders), answer)
    else:
        _show(name, list_effects(folders), answer, not (quiet or no_picture))


def _list_effects(catalogue: Any, answer: Answer) -> None:
    answer.table(("effect", "what it is"), [(name, effect.title) for name, effect in catalogue.items()])
    from testbed.api.effects import card

    answer.finish({"effects": [card(effect) for effect in catalogue.values()]})


def _show(name: str, catalogue: Any, answer: Answer, drawn: bool) -> None:
    from testbed.api.effects import card, named
    from testbed.catalogue import titled
    from testbed.files.model_file import effect_text

    effect = named(name, catalogue)
    answer.say(f"{name}: {effect.title}")
    for title in ("law", "source", "validity", "leaves"):
        answer.say(f"  {title}: {getattr(effect, title)}")
    for other, test in effect.confused_with:
        answer.say(f"  confused with {titled([other], catalogue)}; what separates them: {test}")
    if effect.requires:
        answer.say(f"  a search proposes it only for a model that has {titled(effect.requires, catalogue)}")
    rows = [(f"  {one.name}", one.symbol, one.unit, f"{one.neutral:g}", f"{one.bounds[0]:g} to {one.bounds[1]:g}",
             f"{one.example:g}", one.meaning) for one in effect.parameters]
    if rows:
        answer.table(("  parameter", "symbol", "unit", "neutral", "bounds", "example", "what it is"), rows)
    for one in effect.parameters:
        if one.channels:
            answer.say(f"  {one.name}: only {' and '.join(one.channels)} shows it, so a model file may leave it out")
    for one in effect.form:
        unit = "" if one.unit == "1" else f" {one.unit}"
        answer.say(f"  {one.name}: {one.meaning}, {one.neutral:g}{unit}; a model file may say another. No fit changes it. A "
                   "diagnosis asks the records for it, unless the model file says it")
    answer.say("  in model.yaml: " + effect_text(effect, effect.example()))
    if drawn:
        _draw(effect, catalogue, answer)
    answer.finish(card(effect))


def _draw(effect: Any, catalogue: Any, answer: Answer) -> None:
    from testbed.cli._fingerprint import fingerprint, picture
    from testbed.engines.compose import composed_before

    if not composed_before(catalogue):
        answer.say("  it is compiled first: some ten seconds, once for each version of its file")
    with answer.watch.busy("compiling"):
        found = fingerprint(effect, catalogue)
    answer.say(f"  at its example values, in {found.story}:")
    for title, values in (("displacement", found.with_effect), ("change by the effect", found.change)):
        answer.say(f"  {title}, um")
        for line in picture(found.time * 1e3, values * 1e6):
            answer.say("  " + line)
    answer.say("  time, ms")


def _list_hooks(answer: Answer) -> None:
    from testbed.effect import HOOKS

    answer.table(("hook", "unit", "what it is"), [(name, hook.unit, hook.meaning) for name, hook in HOOKS.items()])
    answer.say()
    for name, hook in HOOKS.items():
        offered = f": {', '.join(hook.offers)}, and" if hook.offers else " nothing but"
        answer.say(f"{name} may ask for{offered} the effect's parameters and states")
    answer.finish({name: {"unit": hook.unit, "meaning": hook.meaning, "offers": hook.offers, "joins": hook.joins}
                   for name, hook in HOOKS.items()})


def _write_template(name: str, answer: Answer) -> None:
    from testbed.api.effects import new_effect

    effect, test = new_effect(name)
    answer.say(f"{effect}: a working effect; edit it, then give its folder as --effects {effect.resolve().parent}")
    answer.say(f"{test}: its test, to edit too; run: python -m pytest {test} (pytest is in the extra `dev` alone)")
    answer.finish({"file": str(effect), "test": str(test)})
