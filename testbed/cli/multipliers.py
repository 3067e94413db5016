"""`testbed multipliers`: the largest characteristic multipliers of a cut, and what they mean."""

from __future__ import annotations

from typing import Any

import click

from testbed.cli._answer import Answer, shown
from testbed.cli._options import (
    DEPTH,
    SPEED,
    catalogue_of,
    cutting_model,
    effects_option,
    guesses_note,
    in_the_work,
    refuse_planar_effects,
    shared,
)
from testbed.problem import InputProblem

MOST_SWINGS = 1000.0  # periods of the structure within a tooth pass up to which a loop with effects is linearised
TOLERANCE = 1e-6  # of the largest multiplier before its last correction
BLANK = 1e-4  # of the largest multiplier over max(1, modulus): nothing is said where it changes by more
MEANING = {"stable": "stable", "neimark_sacker": "Neimark-Sacker (chatter at a frequency of its own)",
           "flip": "flip (period doubling)", "saddle_node": "saddle-node"}


@click.command(short_help="Largest characteristic multipliers of a cut, and their class.",
               epilog="Example: testbed multipliers model.yaml --speed 3810 --depth 2.9")
@click.argument("model_file", metavar="MODEL.yaml")
@click.option("--speed", type=SPEED, required=True, help="Spindle speed, rpm.")
@click.option("--depth", type=DEPTH, required=True, help="Axial depth of cut, mm.")
@click.option("--feed", "feed_text", default="0.1016 mm/tooth", show_default=True,
              help="Feed; it matters only with effects that are not linear.")
@click.option("--count", type=click.IntRange(1, 50), default=6, show_default=True, help="How many to give.")
@effects_option
@shared
def command(model_file: str, speed: list[float], depth: list[float], feed_text: str, count: int,
            folders: tuple[str, ...], json_file: str | None, seed: int | None, quiet: bool) -> None:
    """Largest characteristic multipliers of MODEL.yaml at one cut, largest modulus first: over a tooth passing period, or
    over a revolution where the teeth have different pitches.

    With effects, the whole loop is linearised about its periodic motion, over its principal period.
    """
    from testbed.cut import Cut
    from testbed.units import UnitProblem, parse_quantity

    answer = Answer(json_file, quiet)
    if len(speed) > 1 or len(depth) > 1:
        raise click.UsageError("give one speed and one depth; `testbed chart` takes ranges")
    try:
        feed = parse_quantity(feed_text, "m/tooth")
    except UnitProblem as problem:
        raise InputProblem("--feed", problem.what, problem.do) from None
    if feed <= 0:
        raise InputProblem("--feed", f"'{feed_text}' must be above 0", "correct the value")
    catalogue = catalogue_of(folders)
    model, left_out = in_the_work(cutting_model(model_file, catalogue))
    place = model_file if model.effects else f"--speed {shown(speed[0], 'rad/s')}, --depth {depth[0] * 1e3:.6g} mm"
    found = multipliers(model, Cut(speed[0], depth[0], feed), catalogue, place)
    values, period = found["multipliers"][:count], found["period_passes"]
    for note in (notes := [*guesses_note(model), *left_out]):
        answer.say(note)
    answer.say(f"{MEANING[found['class']]}, over {period} tooth passing period{'s' if period > 1 else ''}")
    errors = found["error"][:count]
    answer.table(("multiplier", "modulus", "error below"),
                 [(f"{value:+.6f}", f"{abs(value):.6f}", f"{error:.0e}") for value, error in zip(values, errors, strict=True)])
    answer.finish({**found, "multipliers": values, "error": errors, "spindle_speed": speed[0], "axial_depth_of_cut": depth[0],
                   "notes": notes})


def multipliers(model: Any, cut: Any, catalogue: Any, name: str) -> dict[str, Any]:
    """Multipliers of a model, effects and all, their errors, class and the period in passes. InputProblem if there are none.

    name: what is to be blamed then.
    """
    import numpy as np

    from testbed.analysis.linear.planar_multipliers import cut_multipliers
    from testbed.analysis.linear.stability import classify

    refuse_planar_effects(model, name)
    try:
        if model.effects:
            swings = model.structure.natural_frequency * cut.tooth_passing_period(model.cutter.flutes)
            if swings > MOST_SWINGS:  # their map would not fit into memory
                raise ArithmeticError(f"the structure swings {swings:.3g} times within a tooth pass")
            values, errors, passes = _of_loop(model, cut, catalogue)
        else:
            with np.errstate(over="ignore", invalid="ignore"):  # at absurd speeds and depths, which are refused below
                values, errors, passes = cut_multipliers(model, cut, TOLERANCE)
    except (ValueError, ArithmeticError) as problem:
        why = "its numbers grow beyond what a computer holds" if isinstance(problem, np.linalg.LinAlgError) else problem
        raise InputProblem(name, f"no multipliers of this cut can be had ({why})",
                           "leave out the effect, or choose another cut" if model.effects else "choose another cut") from None
    return {"multipliers": values, "class": classify(values), "period_passes": passes, "error": errors}


def _of_loop(model: Any, cut: Any, catalogue: Any) -> tuple[Any, Any, int]:
    """Multipliers of a loop with effects, how much each changes on pieces twice as long, and their period in passes."""
    import numpy as np

    from testbed.analysis.linear.linearise import linearise
    from testbed.engines.regenerative_loop import regenerative_loop

    loop: Any = regenerative_loop(model, cut, catalogue)
    motion = linearise(loop)
    other = linearise(loop, passes=motion.passes, coarser=2.0).multipliers
    errors = np.abs(motion.multipliers[:, None] - other[None, :]).min(axis=1)
    errors[0] = max(errors[0], abs(abs(motion.multipliers[0]) - abs(other[0])))
    if not errors[0] <= BLANK * max(1.0, abs(motion.multipliers[0])):
        raise ArithmeticError(f"the largest changes by {errors[0]:.1g} on finer pieces")
    return motion.multipliers, errors, motion.passes
