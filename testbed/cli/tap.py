"""`testbed tap`: from hammer blows and frequency responses to the modes of a machine."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import click

from testbed.cli._answer import Answer, interval_shown
from testbed.cli._options import catalogue_of, effects_option, shared
from testbed.cli._places import check_place, output_folder
from testbed.problem import InputProblem

if TYPE_CHECKING:
    from testbed.machine import Mode

_MISTAKEN = 1.5  # times a believed frequency, within which a mode that rings may be the one believed in


@click.command(short_help="From hammer blows or frequency responses to a model of the machine.",
               epilog="Example: testbed tap taps.yaml -m cutter.yaml -o machine.yaml --report pictures")
@click.argument("taps_file", metavar="TAPS.yaml")
@click.option("-m", "--model", "model_file", metavar="MODEL.yaml",
              help="A model whose cutter, cutting and effects the new one takes over.")
@click.option("-o", "--output", metavar="NEW.yaml", help="The model to write: the modes found.")
@click.option("--report", metavar="DIR", help="Folder for report.html: responses, fits, coherence, poles, blows.")
@click.option("--modes", "most_modes", type=click.IntRange(1, 12),
              help="So many modes for each set of responses that belong together, instead of as many as the data ask for.")
@effects_option
@shared
def command(taps_file: str, model_file: str | None, output: str | None, report: str | None, most_modes: int | None,
            folders: tuple[str, ...], json_file: str | None, seed: int | None, quiet: bool) -> None:
    """Find the modes that TAPS.yaml shows: natural frequency, damping ratio, mass and direction, each with an interval.

    Blows are found and split, double hits and overloads left out, sensors that are turned round told. How many modes there are
    follows from the data. Needs the extra package sdypy-EMA.
    """
    answer = Answer(json_file, quiet)
    if output is not None:
        check_place(output)
    from testbed.analysis.tap.tap import tap_test
    from testbed.files.model_file import read_model
    from testbed.files.taps_file import load_taps

    catalogue = catalogue_of(folders)
    base = read_model(model_file, catalogue) if model_file else None
    taps = load_taps(taps_file)
    folder = output_folder(report) if report else None
    found = tap_test(taps, most_modes)
    _say(answer, found)
    if output is not None:
        guessed = _write(found, base, output, catalogue, taps_file)
        masses = any(path.endswith("mass") for path in guessed)
        answer.say(f"written: {output}" + (", its masses are guesses: no force told them" if masses else ""))
    if folder is not None:
        from testbed.analysis.report.tap_page import tap_page

        answer.say(f"written: {tap_page(found, taps.name).write(folder / 'report.html')}")
    answer.finish({"modes": [mode.as_json() for mode in found.modes], "residual": found.residual, "blows": found.blows,
                   "responses": found.responses_json(), "decays": [one.as_json() for one in found.decays],
                   "notes": found.notes})


def _say(answer: Answer, found: Any) -> None:
    used = sum(blow.used for blow in found.blows)
    if found.blows:
        answer.say(f"{used} of {len(found.blows)} blows used")
    for blow in found.blows:
        if not blow.used:
            answer.say(f"left out: blow of {abs(blow.force):.4g} N at {blow.time:.4g} s in {blow.tap}: {blow.why}")
    for note in found.notes:
        answer.say(f"note: {note}")
    rows = []
    for number, mode in enumerate(found.modes):
        for name in ("natural_frequency", "damping_ratio", "mass", "direction"):
            rows.append((f"modes[{number}].{name}", *interval_shown(getattr(mode, name)), mode.on))
    answer.table(("parameter", "value", "low", "high", "on"), rows)
    answer.say(f"residual {found.residual:.1%} of the measured {'responses' if found.groups else 'decays'}")


def _write(found: Any, base: Any, output: str, catalogue: Any, taps_file: str) -> tuple[str, ...]:
    """The model of the modes, with what a given model says of the cut; paths of parameters that are guesses.

    InputProblem where a mode's values make none.
    """
    from dataclasses import replace

    from testbed.files.model_file import write_model
    from testbed.machine import CUTTING, Model, Structure

    known = [(mode, mode.mode()) for mode in found.modes if mode.mass.determined]
    known = known or _with_believed_masses(found, base, taps_file)
    try:
        structure = Structure.of([mode for _, mode in known])
    except ValueError as problem:
        raise InputProblem(taps_file, f"the modes found make no machine ({problem})", "ask for fewer with --modes") from None
    model = Model(structure)
    if base is not None:
        spreads = tuple(one for one in base.spreads if one[0].partition(".")[0] in {*base.effects, *CUTTING})
        model = replace(base, structure=structure, machine=None, not_determined=(), spreads=spreads)
    names = ("natural_frequency", "damping_ratio", "mass", "direction")
    paths = {(place, name): model.mode_path(place, name) for place in range(len(known)) for name in names}
    guessed = tuple(path for (place, name), path in paths.items()
                    if path in model.base_parameters and not getattr(known[place][0], name).determined)
    tapped = {path: (one.low, one.high) for (place, name), path in paths.items()
              if path in model.base_parameters and (one := getattr(known[place][0], name)).determined and one.high > one.low}
    left = [f"{mode.natural_frequency.value:.5g} Hz" for mode in found.modes if all(mode is not one for one, _ in known)]
    remarks = [f"found by testbed tap, residual {found.residual:.1%}", *found.notes]
    if left:
        remarks.insert(1, f"left out, without a mass: {', '.join(left)}")
    write_model(replace(model, not_determined=guessed, tapped=tapped), output, catalogue, remarks)
    return guessed


def _with_believed_masses(found: Any, base: Any, taps_file: str) -> list[tuple[Any, Mode]]:
    """Modes of decays, each with the mass of the believed mode that lies nearest, or 1 kg without a model: a guess either way.

    InputProblem where no mode has one.
    """
    from testbed.machine import Mode

    believed, paired = list(base.structure.modes) if base is not None else [], []
    for mode in found.modes if found.decays else ():
        hertz, angle = mode.natural_frequency.value, mode.direction.value
        away = {one: abs(math.log(one.natural_frequency / hertz)) for one in believed
                if one.on == mode.on and abs(math.cos(one.direction - angle)) > math.sqrt(0.5)}
        own = min((one for one in away if away[one] < math.log(_MISTAKEN)), key=away.__getitem__, default=None)
        if own is not None:
            believed.remove(own)
        if own is not None or base is None:
            mass = own.mass if own is not None else 1.0
            paired.append((mode, Mode(mass, hertz, mode.damping_ratio.value, angle, mode.on)))
    if not paired:
        raise InputProblem(taps_file, "no mode has a mass that the data tell: no machine can be written",
                           "tap where the sensor is, and measure the force" if not found.decays else
                           "measure the force, or give a model whose modes lie near those found, with their direction and `on`")
    return paired
