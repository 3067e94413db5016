"""`testbed identify`: damping, natural frequency and cutting coefficients, with intervals, from recorded cuts."""

from __future__ import annotations

from typing import Any

import click

from testbed.api.places import check_place
from testbed.api.words import interval_shown, shown
from testbed.cli._answer import Answer
from testbed.cli._options import effects_option, model_option, shared


@click.command(short_help="Estimate damping, frequency and cutting coefficients, with intervals.",
               epilog="Example: testbed identify campaign.yaml -m model.yaml -o identified.yaml")
@click.argument("data", metavar="DATA")
@model_option
@click.option("-o", "--output", metavar="NEW.yaml",
              help="Write the model with the values found; an older model there is replaced.")
@click.option("--method", type=click.Choice(["multipliers", "waveform"]),
              help="Fit the characteristic multipliers of the entry transients (the default for one mode along the feed), or "
                   "every sample of every record (the default for a machine in x and y).")
@effects_option
@shared
def command(data: str, model_file: str, output: str | None, method: Any, folders: tuple[str, ...],
            json_file: str | None, seed: int | None, quiet: bool) -> None:
    """Estimate the machine of DATA (an HDF5 data set or a campaign.yaml), starting from MODEL.yaml.

    The multipliers of a cut are those of the linear machine: they know nothing of effects. --method waveform simulates
    the model with its effects, and fits their parameters too. Intervals are 95 %. Of a machine in x and y it finds every mode's
    frequency, damping, direction and mass, as far as the channels tell them; what they do not tell is said before the fit.
    """
    from testbed.api.identify import identify

    answer = Answer(json_file, quiet)
    check_place(output)
    found = identify(data, model_file, method=method, seed=seed or 0, effects=folders, progress=answer.watch)
    for note in found.remarks:
        answer.say(note)
    _say(answer, found)
    if output is not None:
        found.save_model(output)
        answer.say(f"written: {output}")
    answer.finish(found.to_dict())


def _say(answer: Answer, found: Any) -> None:
    answer.table(("parameter", "value", "low", "high"),
                 [(name, *interval_shown(one, name))
                  for name, one in found.parameters.items()])
    if found.model.planar and found.tests:
        answer.say()
        answer.table(("test", "speed", "depth", "largest multiplier of the model", "modulus", "per"),
                     [_planar_row(test) for test in found.tests])
        answer.say(f"only the model's multipliers are shown for these tests: {found.tests[0]['reason']}")
    elif found.tests:
        answer.say()
        answer.table(("test", "speed", "depth", "measured", "model", "used"), [_row(test) for test in found.tests])
        for test in found.tests:
            if not test["used"]:
                answer.say(f"{test['name']} was left out: {test['reason']}")
    converged = "" if found.quality["converged"] else "; the fit did not converge"
    answer.say(f"misfit per degree of freedom {found.chi_square:.3g}{converged}")


def _planar_row(test: Any) -> tuple[str, ...]:
    largest = max(test["model"], key=abs, default=None)
    told = ("-", "-") if largest is None else (f"{largest:+.4f}", f"{abs(largest):.4f}")
    depth = f"{test['axial_depth_of_cut'] * 1e3:.4g} mm"
    return (test["name"], shown(test["spindle_speed"], "rad/s"), depth, *told, test["per"])


def _row(test: Any) -> tuple[str, ...]:
    def told(values: Any) -> str:
        return f"{values[place]:+.4f}" if len(values) > place else "-"

    # the model's largest and what was measured beside it: the largest measured may be the sensor's drift
    both = min(len(test["measured"]), len(test["model"]))
    place = max(range(both), key=lambda at: abs(test["model"][at])) if both else 0
    return (test["name"], shown(test["spindle_speed"], "rad/s"), f"{test['axial_depth_of_cut'] * 1e3:.4g} mm",
            told(test["measured"]), told(test["model"]), "yes" if test["used"] else "no")
