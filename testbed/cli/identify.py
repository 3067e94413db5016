"""`testbed identify`: damping, natural frequency and cutting coefficients, with intervals, from recorded cuts."""

from __future__ import annotations

from typing import Any

import click

from testbed.cli._answer import Answer, interval_shown, shown
from testbed.cli._options import catalogue_of, check_cutting, effects_option, model_option, refuse_planar, shared
from testbed.cli._places import check_place
from testbed.problem import InputProblem

OTHER_SPEED = 5e-4  # relative difference from which a speed that was found is told beside the stated one,
MOST_TOLD = 6  # of so many cuts
LEFT_OUT = 1.0 / 3.0  # of the cuts, from which it is said that the machine found is that of the others
DOUBTED, MISSED = 5.0, 30.0  # misfits per degree of freedom from which a fit by multipliers is doubted, and not believed


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
def command(data: str, model_file: str, output: str | None, method: str | None, folders: tuple[str, ...],
            json_file: str | None, seed: int | None, quiet: bool) -> None:
    """Estimate the machine of DATA (an HDF5 data set or a campaign.yaml), starting from MODEL.yaml.

    The multipliers of a cut are those of the linear machine: they know nothing of effects. --method waveform simulates
    the model with its effects, and fits their parameters too. Intervals are 95 %. Of a machine in x and y it finds every mode's
    frequency, damping, direction and mass, as far as the channels tell them; what they do not tell is said before the fit.
    """
    from testbed.analysis.fit.plausible import unlike_a_machine
    from testbed.analysis.search.diagnosis import FAINT_REST, SILENT
    from testbed.cli._fitting import doubts, of_the_mass, of_the_parts, uncalibrated
    from testbed.cli._identification import identify_by_multipliers, identify_by_waveform
    from testbed.cli._records import load_records
    from testbed.files.model_file import read_model, write_model

    answer = Answer(json_file, quiet)
    check_place(output)
    catalogue = catalogue_of(folders)
    model = read_model(model_file, catalogue)
    method = method or ("waveform" if model.planar else "multipliers")
    multipliers = method == "multipliers"
    if multipliers:
        refuse_planar(model, model_file, "measured multipliers are those of one mode along x: take --method waveform")
        check_cutting(model, model_file, "; for free decays and driven records there is --method waveform")
    records = load_records(data)
    try:
        found = identify_by_multipliers(model, records, data, seed or 0) if multipliers else \
            identify_by_waveform(model, records, data, catalogue, model_file, answer.say)
    except InputProblem:
        raise
    except (ValueError, ArithmeticError) as problem:
        raise InputProblem(data, str(problem), "add tests with a clear entry transient, or try --method waveform"
                           if multipliers else "check the records with testbed inspect") from None
    after = [*([] if multipliers else uncalibrated(records)), *doubts(records, model),  # multipliers have no unit
             *of_the_parts(records), *of_the_mass(records, model), *found.notes]
    if multipliers and found.quality["chi_square"] > DOUBTED:
        after.append(_of_the_misfit(found))
    if found.at_bound:
        after.append(_of_the_bounds(found, multipliers))
    if multipliers:
        after += [*_left_out(found), *_speeds_found(records, found), _of_the_ratio(found)]
    elif found.quality["noise_floor"] > SILENT:
        after.append("hardly anything but noise was measured: these records say nothing of the machine, whatever the intervals")
    elif found.quality["chi_square"] > FAINT_REST**2:  # as testbed compare and testbed diagnose have it
        after.append(f"the model leaves {found.quality['chi_square'] ** 0.5:.2g} times the noise: what it lacks may bend its "
                     "parameters beyond their intervals" + _to_diagnose(model))
    for note in after:
        answer.say(note)
    _say(answer, found)
    if output is not None:
        write_model(found.model, output, catalogue, unlike_a_machine(found.model))
        answer.say(f"written: {output}")
    answer.finish({"method": method, "parameters": {name: one.as_json() for name, one in found.parameters.items()},
                   "tests": found.tests, **found.quality, "at_bound": found.at_bound, "notes": [*found.said, *after]})


def _to_diagnose(model: Any) -> str:
    """Where to ask which effect is missing, of a model that can be asked about."""
    return "" if model.planar else "; testbed diagnose says whether an effect is missing"


def _of_the_misfit(found: Any) -> str:
    """What it means that the linear machine's multipliers are not those measured."""
    misfit = found.quality["chi_square"]
    if misfit <= MISSED:
        return (f"the misfit per degree of freedom is {misfit:.2g}: the intervals are widened for it, but what the linear "
                "machine lacks may bend its parameters beyond them; testbed compare and testbed diagnose show it")
    worst = max((test for test in found.tests if test["used"]), key=_missed_by)
    return (f"the linear machine does not explain these multipliers, {worst['name']} least: its parameters may be far outside "
            "their intervals; look at that record, or try --method waveform")


def _of_the_bounds(found: Any, multipliers: bool) -> str:
    """What it means that parameters ended at the end of the range searched, and of multipliers which range that is."""
    from testbed.analysis.fit.estimates import said_at_bound
    from testbed.analysis.multipliers.identify import COEFFICIENTS, FREQUENCIES

    said = said_at_bound(found.at_bound)
    if not multipliers:
        return said
    (lowest, highest), (weakest, strongest) = FREQUENCIES, COEFFICIENTS
    return (f"{said}; the range begins at the free decays, else at the model, and goes from {lowest:g} to {highest:g} of that "
            f"frequency, from {weakest:g} to {strongest:g} of the coefficients: if the machine may lie beyond, begin from "
            "another model")


def _left_out(found: Any) -> list[str]:
    """That much of what was measured plays no part in what was found."""
    count = sum(not test["used"] for test in found.tests)
    if count <= LEFT_OUT * len(found.tests):
        return []
    return [f"{count} of {len(found.tests)} cuts were left out, for the reasons below: the machine found is that of the others "
            "alone; testbed compare shows whether it explains them all"]


def _speeds_found(records: Any, found: Any) -> list[str]:
    """At which speeds cuts without a tachometer are taken, and which were stated."""
    stated = {one.name: one.conditions["spindle_speed"] for one in records
              if one.recording.marks.size < 3 and "spindle_speed" in one.conditions}
    told = [f"{test['name']} {shown(test['spindle_speed'], 'rad/s')} (stated {shown(stated[test['name']], 'rad/s')})"
            for test in found.tests
            if test["name"] in stated and abs(test["spindle_speed"] / stated[test["name"]] - 1.0) > OTHER_SPEED]
    more = [f"and {len(told) - MOST_TOLD} more"] if len(told) > MOST_TOLD else []
    return [f"without a tachometer, the speed is that of the vibration: {', '.join(told[:MOST_TOLD] + more)}"] if told else []


def _of_the_ratio(found: Any) -> str:
    """That the ratio of the coefficients is not found, what hangs on it, and what the intervals allow for."""
    from testbed.cli._identification import RATIO_DOUBT

    cutting, more = found.model.cutting, (1.0 + RATIO_DOUBT) ** found.quality["ratio_slope"] - 1.0
    ratio = cutting.normal_coefficient / cutting.tangential_coefficient
    return (f"normal_coefficient stays {ratio:.3g} of the tangential one, as the model has it: multipliers do not tell. Were "
            f"that {RATIO_DOUBT:.0%} more, tangential_coefficient would be {more:+.1%}; the intervals allow for it, and "
            "--method waveform finds both")


def _missed_by(test: Any) -> float:
    """Largest distance of a measured multiplier from the model's beside it."""
    pairs = zip(test["measured"], test["model"], strict=False)
    return max(abs(complex(one) - complex(other)) for one, other in pairs)


def _say(answer: Answer, found: Any) -> None:
    answer.table(("parameter", "value", "low", "high"),
                 [(name, *interval_shown(one, name))
                  for name, one in found.parameters.items()])
    if found.model.planar and found.tests:
        answer.say()
        answer.table(("test", "speed", "depth", "largest multiplier of the model", "modulus", "per"),
                     [_planar_row(test) for test in found.tests])
        answer.say(f"of these tests the model's multipliers alone are told: {found.tests[0]['reason']}")
    elif found.tests:
        answer.say()
        answer.table(("test", "speed", "depth", "measured", "model", "used"), [_row(test) for test in found.tests])
        for test in found.tests:
            if not test["used"]:
                answer.say(f"{test['name']} was left out: {test['reason']}")
    converged = "" if found.quality["converged"] else "; the fit did not converge"
    answer.say(f"misfit per degree of freedom {found.quality['chi_square']:.3g}{converged}")


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
