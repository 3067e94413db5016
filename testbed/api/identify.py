"""Damping, natural frequency and cutting coefficients, with intervals, from recorded cuts."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from testbed.api.believed import (
    DataLike,
    Effects,
    EffectsLike,
    File,
    ModelLike,
    check_cutting,
    effects_of,
    model_of,
    name_of,
    refuse_planar,
)
from testbed.api.fitting import doubts, of_the_mass, of_the_parts, uncalibrated
from testbed.api.identification import RATIO_DOUBT, Identified, identify_by_multipliers, identify_by_waveform
from testbed.api.places import save_fitted
from testbed.api.records import load_records
from testbed.api.result import Result, Table, estimates_table, shown_here
from testbed.api.watch import Progress, Watch
from testbed.api.words import shown
from testbed.api.working import working
from testbed.problem import InputProblem

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from testbed.analysis.estimate import Estimate
    from testbed.machine import Model

Method = Literal["multipliers", "waveform"]
OTHER_SPEED = 5e-4  # relative difference from which a speed that was found is told beside the stated one,
MOST_TOLD = 6  # of so many cuts
LEFT_OUT = 1.0 / 3.0  # of the cuts, from which it is said that the machine found is that of the others
DOUBTED, MISSED = 5.0, 30.0  # misfits per degree of freedom from which a fit by multipliers is doubted, and not believed


@dataclass(frozen=True, repr=False, eq=False)
class Identification(Result):
    """A machine as records show it.

    model: with the values found. parameters: by path, each with value, low, high (95 %) and unit. tests: of each cut the
    measured and the model multipliers. quality: `chi_square` a degree of freedom, `converged`, and more by the method.
    at_bound: parameters that ended where the range searched ends. told: notes that belong before the fit; remarks: after it.
    """

    method: Method
    model: Model
    parameters: Mapping[str, Estimate]
    tests: tuple[Mapping[str, Any], ...]
    quality: Mapping[str, Any]
    at_bound: tuple[str, ...]
    told: tuple[str, ...]
    remarks: tuple[str, ...]
    effects: Effects

    @property
    def chi_square(self) -> float:
        """Misfit per degree of freedom: 1 where only the noise is left."""
        return float(self.quality["chi_square"])

    @property
    def converged(self) -> bool:
        """Whether the fit did."""
        return bool(self.quality["converged"])

    @property
    def notes(self) -> tuple[str, ...]:  # type: ignore[override]
        """What is to be known before the values are believed."""
        return (*self.told, *self.remarks)

    def save_model(self, path: File) -> Path:
        """Write the model with the values found as a model.yaml; an older one there is replaced. InputProblem."""
        return save_fitted(self.model, path, self.effects.known)

    def plot(self) -> Figure:
        """Measured multipliers of every test and those of the model, in the complex plane."""
        from testbed.analysis.linear.chart_plot import plot_multipliers

        if not any(len(test["model"]) for test in self.tests):
            raise InputProblem("plot", "no test has multipliers", "testbed.compare draws records and their predictions")
        return shown_here(plot_multipliers({test["name"]: (test["measured"], test["model"])  # type: ignore[no-any-return]
                                            for test in self.tests}))

    def _answer(self) -> Mapping[str, Any]:
        return {"method": self.method, "parameters": {name: one.as_json() for name, one in self.parameters.items()},
                "tests": self.tests, **self.quality, "at_bound": self.at_bound, "notes": self.notes}

    def _table(self) -> Table:
        return estimates_table(self.parameters)

    def _headline(self) -> str:
        converged = "" if self.converged else ", not converged"
        return (f"{len(self.parameters)} parameters by {self.method}, misfit per degree of freedom "
                f"{self.chi_square:.3g}{converged}")


def identify(data: DataLike, model: ModelLike, *, method: Method | None = None, seed: int = 0, effects: EffectsLike = (),
             progress: Progress = None) -> Identification:
    """Estimate a machine from records, starting from a model.

    data: a campaign.yaml or a data set, or testbed.load of one. model: a model.yaml or a Model. method: `multipliers` fits the
    characteristic multipliers of the entry transients (the default for one mode along the feed), `waveform` every sample of
    every record with the simulator, effects and all (the default for a machine in x and y). seed: of the starts that
    `multipliers` draws. effects: folders of one's own effects. progress: a function of (title, done, all), or False.
    Raises InputProblem where the records do not suffice.
    """
    with working(progress) as watch:
        return _identified(data, model, method, seed, effects_of(effects), watch)


def _identified(data: DataLike, given: ModelLike, method: Method | None, seed: int, effects: Effects,
                watch: Watch) -> Identification:
    model, model_name = model_of(given, effects.known)
    chosen = method or ("waveform" if model.planar else "multipliers")
    if chosen not in ("multipliers", "waveform"):
        raise InputProblem("method", f"there is no '{chosen}'", "give multipliers or waveform")
    multipliers, place = chosen == "multipliers", name_of(data)
    if multipliers:
        refuse_planar(model, model_name, "measured multipliers are those of one mode along x: take --method waveform")
        check_cutting(model, model_name, "; for free decays and driven records there is --method waveform")
    records = load_records(data)
    try:
        found = identify_by_multipliers(model, records, place, seed) if multipliers else \
            identify_by_waveform(model, records, place, effects.known, model_name, watch.note)
    except InputProblem:
        raise
    except (ValueError, ArithmeticError) as problem:
        raise InputProblem(place, str(problem), "add tests with a clear entry transient, or try --method waveform"
                           if multipliers else "check the records with testbed inspect") from None
    after = [*([] if multipliers else uncalibrated(records)), *doubts(records, model),  # multipliers have no unit
             *of_the_parts(records), *of_the_mass(records, model), *found.notes, *_of_the_fit(found, multipliers)]
    if multipliers:
        after += [*_left_out(found), *_speeds_found(records, found), _of_the_ratio(found)]
    else:
        after += _of_what_is_left(found)
    return Identification(chosen, found.model, found.parameters, found.tests, found.quality, tuple(found.at_bound),
                          tuple(found.said), tuple(after), effects)


def _of_the_fit(found: Identified, multipliers: bool) -> list[str]:
    """That the fit is doubtful, or ended at an end of the range."""
    doubt = [_of_the_misfit(found)] if multipliers and found.quality["chi_square"] > DOUBTED else []
    return doubt + ([_of_the_bounds(found, multipliers)] if found.at_bound else [])


def _of_what_is_left(found: Identified) -> list[str]:
    """That the records are hardly more than noise, or that the model leaves more than noise."""
    from testbed.analysis.search.diagnosis import FAINT_REST, SILENT

    if found.quality["noise_floor"] > SILENT:
        return ["almost only noise was measured: these records do not tell the machine, whatever the intervals say"]
    if found.quality["chi_square"] > FAINT_REST**2:  # as testbed compare and testbed diagnose have it
        return [f"the model leaves {found.quality['chi_square'] ** 0.5:.2g} times the noise. What it lacks may bend its "
                "parameters beyond their intervals; testbed diagnose says whether an effect is missing"]
    return []


def _of_the_misfit(found: Any) -> str:
    """What it means that the linear machine's multipliers are not those measured."""
    misfit = found.quality["chi_square"]
    if misfit <= MISSED:
        return (f"the misfit per degree of freedom is {misfit:.2g}. The intervals are widened for it, but what the linear "
                "machine lacks may bend its parameters further: see testbed compare and testbed diagnose")
    worst = max((test for test in found.tests if test["used"]), key=_missed_by)
    return (f"the linear machine does not explain these multipliers, {worst['name']} least of all. Its parameters may be far "
            "outside their intervals. Look at that record, or try --method waveform")


def _of_the_bounds(found: Any, multipliers: bool) -> str:
    """What it means that parameters ended at the end of the range searched, and of multipliers which range that is."""
    from testbed.analysis.fit.estimates import said_at_bound
    from testbed.analysis.multipliers.identify import COEFFICIENTS, FREQUENCIES

    said = said_at_bound(found.at_bound)
    if not multipliers:
        return said
    (lowest, highest), (weakest, strongest) = FREQUENCIES, COEFFICIENTS
    return (f"{said}. The search went from {lowest:g} to {highest:g} times the frequency of the free decays, else of the "
            f"model, and from {weakest:g} to {strongest:g} times the coefficients. If the machine may lie beyond, begin from "
            "another model")


def _left_out(found: Any) -> list[str]:
    """That much of what was measured plays no part in what was found."""
    count = sum(not test["used"] for test in found.tests)
    if count <= LEFT_OUT * len(found.tests):
        return []
    return [f"{count} of {len(found.tests)} cuts were left out, for the reasons below. The machine found is that of the "
            "others. testbed compare shows whether it explains all of them"]


def _speeds_found(records: Any, found: Any) -> list[str]:
    """At which speeds cuts without a tachometer are taken, and which were stated."""
    stated = {one.name: one.conditions["spindle_speed"] for one in records
              if one.recording.marks.size < 3 and "spindle_speed" in one.conditions}
    told = [f"{test['name']} {shown(test['spindle_speed'], 'rad/s')} (stated {shown(stated[test['name']], 'rad/s')})"
            for test in found.tests
            if test["name"] in stated and abs(test["spindle_speed"] / stated[test["name"]] - 1.0) > OTHER_SPEED]
    more = [f"and {len(told) - MOST_TOLD} more"] if len(told) > MOST_TOLD else []
    return [f"without a tachometer, the speed is read from the vibration: {', '.join(told[:MOST_TOLD] + more)}"] if told else []


def _of_the_ratio(found: Any) -> str:
    """That the ratio of the coefficients is not found, what hangs on it, and what the intervals allow for."""
    cutting, more = found.model.cutting, (1.0 + RATIO_DOUBT) ** found.quality["ratio_slope"] - 1.0
    ratio = cutting.normal_coefficient / cutting.tangential_coefficient
    return ("multipliers do not tell the ratio of the two coefficients: normal_coefficient stays "
            f"{ratio:.3g} of the tangential one, as in the model. A ratio {RATIO_DOUBT:.0%} larger would change "
            f"tangential_coefficient by {more:+.1%}. The intervals allow for that; --method waveform finds both")


def _missed_by(test: Any) -> float:
    """Largest distance of a measured multiplier from the model's beside it."""
    pairs = zip(test["measured"], test["model"], strict=False)
    return max(abs(complex(one) - complex(other)) for one, other in pairs)
