"""`testbed diagnose`: which physical effect the believed model lacks, or none, or none of those known."""

from __future__ import annotations

import math
import os
import shlex
from typing import Any

import click

from testbed.analysis.fit.budget import BUDGET
from testbed.cli._answer import Answer, shown
from testbed.cli._options import catalogue_of, effects_option, model_option, shared
from testbed.cli._places import output_folder
from testbed.problem import InputProblem

_EXPLAINS = ("adequate", "missing_effect")  # verdicts by which the best model leaves no physics out
MANY = 6  # effects that --until-adequate adds at the most


@click.command(short_help="Say which physical effect is missing, or none, or none of those known.",
               epilog="Example: testbed diagnose campaign.yaml -m model.yaml --json diagnosis.json")
@click.argument("campaign", metavar="CAMPAIGN.yaml")
@model_option
@click.option("-o", "--output", metavar="DIR", help="Write the story as report.html into this folder.")
@click.option("--until-adequate", is_flag=True, help=f"Go on adding, up to {MANY} effects, until only noise is left.")
@click.option("--propose", metavar="DIR", help="Where the catalogue does not explain the records, estimate the missing force "
              "and write it into DIR as an effect file of your own.")
@click.option("--false-alarms", "alarms", type=click.IntRange(min=1), metavar="N",
              help="Repeat the diagnosis on N campaigns simulated without a hidden effect: how often is one named?")
@click.option("--decoys", is_flag=True, help="Offer laws that no machine has beside the real ones: none should be named.")
@click.option("--budget", type=click.FloatRange(min=1.0), default=BUDGET, show_default=True, metavar="N",
              help="End with what is known after N simulations of every record (counted, not timed: the same answer anywhere).")
@effects_option
@shared
def command(campaign: str, model_file: str, output: str | None, until_adequate: bool, propose: str | None,
            alarms: int | None, decoys: bool, budget: float, folders: tuple[str, ...], json_file: str | None,
            seed: int | None, quiet: bool) -> None:
    """Fit MODEL.yaml to the campaign, then with each effect of the catalogue, and compare on records held out of the fit.

    With one operating condition nothing can be held out: the errors are then those in the fit, and the answer says so.

    An honest "these records cannot tell" is an answer too. Only --false-alarms draws random numbers, from --seed.
    """
    from testbed.analysis.search.diagnose import diagnose
    from testbed.analysis.search.diagnosis import as_json, unaided
    from testbed.analysis.search.rules import rules_of
    from testbed.analysis.search.sign_check import other_way_note
    from testbed.catalogue import DECOYS
    from testbed.cli._fitting import channel_units, engine_of, notes_on, read_both, sign_of_life
    from testbed.files.model_file import effect_text

    answer = Answer(json_file, quiet)
    folder = output_folder(output) if output else None
    if propose:
        output_folder(propose)
    catalogue = catalogue_of((*folders, str(DECOYS)) if decoys else folders)
    model, records, read = read_both(campaign, model_file, catalogue)
    with sign_of_life("fitting the believed model to all records", quiet) as progress:
        found = diagnose(engine_of(catalogue), records, model, catalogue, progress=progress, budget=budget,
                         **({"most": MANY} if until_adequate else {}))
        turned = []
        if found.candidates:  # else no search was made, for what was found before it
            turned = other_way_note(engine_of(catalogue), records, model, catalogue, found.with_effects, found.noise_floor)
    stuck, guesses, of_the_fit, tapped = _of_the_best_fit(found, records, model, catalogue)
    notes = [*notes_on(read, model), *turned, *of_the_fit]
    for note in notes:
        answer.say(note)
    said = as_json(found, model) | {"rules": rules_of(found), "at_bound": list(stuck), "tap": tapped, "notes": notes}
    for name, one in said["base_parameters"].items():
        one["determined"] = name not in guesses
    next_step = next_command(found, campaign, model_file, bool(propose), folders)
    _say(answer, found, said, unaided(model))
    if found.form is not None:
        answer.say(f"with that law, model.yaml has: {effect_text(catalogue[found.form.effect], found.form.parameters)}")
    if next_step:
        answer.say(f"next: {next_step}")
    if decoys:
        said["decoys"] = _decoys(answer, found, catalogue)
    explanation = None
    if propose:
        explanation = _propose(answer, found, records, model, catalogue, propose, campaign, model_file, folders)
    if explanation is not None:
        said["proposal"] = explanation
    if alarms:
        said["false_alarms"] = _false_alarms(answer, found, catalogue, alarms, seed or 0)
    if folder is not None:
        from testbed.analysis.report.story_page import diagnosis_page

        page = diagnosis_page(found, said, model, catalogue, channel_units(read),
                              notes=[f"{campaign} against {model_file}", *notes],
                              next_step=next_step, force_maps=_force_maps(found, catalogue))
        answer.say(f"open {page.write(folder / 'report.html')}")
    answer.finish(said)


def _of_the_best_fit(found: Any, records: Any, model: Any, catalogue: Any
                     ) -> tuple[tuple[str, ...], tuple[str, ...], list[str], list[dict[str, Any]]]:  # fmt: skip
    """(parameters at a bound, those not determined, notes, rows beside the tap) of the fit of the best set of effects."""
    from testbed.analysis.comparison.tapped import beside_the_tap, said_of_the_tap
    from testbed.analysis.fit.estimates import (
        at_bound,
        clock_note,
        estimates,
        not_determined,
        said_at_bound,
        said_not_determined,
    )
    from testbed.analysis.fit.plausible import remarks_on
    from testbed.analysis.fit.record_hypotheses import taken_notes
    from testbed.analysis.search.diagnosis import ADEQUATE, Candidate
    from testbed.analysis.search.mark_delay import delay_note

    if not isinstance(found.best, Candidate):
        return (), (), [], []
    fitter, fit = found.best.fitter, found.best.fit
    told = estimates(fitter, fit, catalogue)
    stuck, guesses = at_bound(fitter.free, told), not_determined(told)
    notes = [*taken_notes(records, fitter.records), *delay_note(records, fitter, fit), *clock_note(fitter, fit),
             *(note for note in remarks_on(model, fit.state.model) if note.partition(":")[0] not in found.sentence)]
    notes += [said_not_determined(guesses)] if guesses else []
    explained = fit.converged and found.best.error_held_out <= ADEQUATE * found.noise_floor and found.verdict in _EXPLAINS
    tapped = beside_the_tap(model, told, explained)
    notes += [*([said_at_bound(stuck)] if stuck else []),
              *said_of_the_tap(tapped, any(one.kind == "cut" for one in fitter.records))]
    return stuck, guesses, notes, [one.as_json() for one in tapped]


def _force_maps(found: Any, catalogue: Any) -> list[Any]:
    """Force-state maps of what the best model still lacks; none where that is but noise."""
    from testbed.analysis.force.force_state import force_states
    from testbed.analysis.search.diagnosis import ADEQUATE, Candidate
    from testbed.cli._fitting import engine_of

    best = found.best
    if not isinstance(best, Candidate) or best.error_held_out <= ADEQUATE * found.noise_floor:
        return []
    states = force_states(engine_of(catalogue), best.fitter, best.fit, best.errors, catalogue)
    return [(one.name, one.x, one.v, one.force) for one in states]


def _propose(answer: Answer, found: Any, records: Any, model: Any, catalogue: Any, folder: str, campaign: str,
             model_file: str, folders: tuple[str, ...]) -> Any:
    """Estimate what force is missing, say what it depends on, and write it as an effect; None where nothing is left."""
    from testbed.analysis.force.explain_force import as_json, left_unexplained, write_effect
    from testbed.analysis.force.formula_trial import Jury
    from testbed.cli._fitting import engine_of, sign_of_life
    from testbed.trial.proposal import free_name

    try:
        with sign_of_life("estimating the missing force", answer.quiet) as progress:
            told = left_unexplained(engine_of(catalogue), records, found, catalogue, progress)
            explanation = Jury(engine_of, model, catalogue, progress).likeliest(told) if told else None
    except ValueError as problem:
        raise InputProblem(campaign, f"the missing force cannot be estimated: {problem}", "record more cuts") from None
    if explanation is None:
        answer.say("nothing beyond the noise is left to propose an effect for")
        return None
    answer.say()
    answer.say(explanation.sentence)
    result = as_json(explanation)
    if explanation.formula:
        path = write_effect(explanation, folder, free_name(folder, "proposal"))
        result["file"] = str(path)
        every = {os.path.realpath(one): one for one in (*folders, folder)}  # none is named twice
        answer.say(f"next: {_add((path.stem,), campaign, model_file, tuple(every.values()))}")
    return result


def _decoys(answer: Answer, found: Any, catalogue: Any) -> dict[str, Any]:
    from testbed.catalogue import DECOYS

    offered = [name for name, effect in catalogue.items() if effect.path is not None and effect.path.parent == DECOYS]
    named = [name for name in found.effects if name in offered]
    answer.say(f"{', '.join(named)} is a law that no machine has: what this campaign seems to show is not to be trusted"
               if named else f"of {len(offered)} laws that no machine has, offered beside the real ones, none was named")
    return {"offered": offered, "named": named}


def _false_alarms(answer: Answer, found: Any, catalogue: Any, count: int, seed: int) -> dict[str, Any]:
    from testbed.analysis.search.false_alarms import false_alarms
    from testbed.cli._fitting import engine_of, sign_of_life

    with sign_of_life("diagnosing campaigns without a hidden effect", answer.quiet) as progress:
        told = false_alarms(engine_of(catalogue), found.base, catalogue, count, seed, progress)
    low, high = told.interval
    answer.say(f"of {count} campaigns simulated without a hidden effect at these conditions and noise, {told.alarms} had one "
               f"named: a false-alarm rate between {low:.1%} and {high:.1%} (95 %)")
    return {"campaigns": count, "alarms": told.alarms, "rate_low": low, "rate_high": high,
            "named": [list(names) for names in told.named]}


def next_command(found: Any, campaign: str, model_file: str, proposed: bool, folders: tuple[str, ...] = ()) -> str:
    """The command to go on with; empty where there is none, or where it is told with what was proposed.

    folders: of the user's own effects, which the command will know no more than this one did without them.
    """
    if found.verdict == "missing_effect":
        return _add(found.effects, campaign, model_file, folders)
    if found.verdict == "unexplained" and found.candidates and not proposed:  # without candidates no effect was looked for
        return shlex.join(["testbed", "diagnose", campaign, "-m", model_file, *_own(folders), "--propose", "DIR"])
    return ""


def _add(effects: tuple[str, ...], campaign: str, model_file: str, folders: tuple[str, ...]) -> str:
    return shlex.join(["testbed", "add", *effects, "-m", model_file, "-c", campaign, *_own(folders), "-o", "NEW.yaml"])


def _own(folders: tuple[str, ...]) -> list[str]:
    return [word for folder in folders for word in ("--effects", folder)]


def _without(before: Any, step: Any) -> str:
    """In words, which effects of the step before a later one made needless."""
    dropped = [name for name in before.effects if name not in step.effects]
    return f" (no longer {', '.join(dropped)})" if dropped else ""


def _say(answer: Answer, found: Any, said: Any, first: str) -> None:
    """first: what the step before anything is added is called."""
    answer.say(f"{found.verdict.replace('_', ' ')}: {', '.join(found.effects)}" if found.effects
               else found.verdict.replace("_", " "))
    answer.say(found.sentence)
    held = ("held out",) if found.held_out else ()
    rows = [(" + ".join(one.effects), f"{one.error_fit:.4f}", *(f"{one.error_held_out:.4f}" for _ in held),
             f"{one.delta_bic:.1f}", "yes" if one.converged else "no") for one in found.fitted]
    if rows:
        answer.say()
        answer.table(("tried", "error in the fit", *held, "gain in BIC", "converged"), rows)
        if found.ruled_out:
            answer.say(f"ruled out by a first step: {', '.join(found.ruled_out)}")
    answer.say()
    error = "error, held out" if found.held_out else "error, in the fit"
    answer.table((error, "value"), [(name.replace("_", " "), f"{value:.4f}") for name, value in said["error"].items()])
    if not found.held_out:
        answer.say("one operating condition only, so nothing was held out")
    answer.say()
    answer.table(("parameter", "believed", "refitted"),
                 [(name, shown(one["before"], one["unit"]), shown(one["after"], one["unit"]))
                  for name, one in said["base_parameters"].items()])
    if len(found.steps) > 1:
        answer.say()
        answer.table(("step", "effects", error, "noise floor"),
                     [(str(number), " + ".join(step.effects) + _without(before, step) or first,
                       f"{step.error_held_out:.4f}", f"{found.noise_floor:.4f}")
                      for number, (before, step) in enumerate(zip((found.steps[0], *found.steps), found.steps, strict=False))])
    if found.next_test is not None:
        test = found.next_test
        answer.say(f"a cut at {test.spindle_speed * 30 / math.pi:.0f} rpm, {test.depth_of_cut * 1e3:.2f} mm would tell "
                   f"{' from '.join(found.separates)} best: they differ there by {test.difference:.1f} times the noise")
