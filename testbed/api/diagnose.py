"""Which physical effect the believed model lacks, or none, or none of those known."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from testbed.api.believed import (
    CampaignLike,
    Effects,
    EffectsLike,
    File,
    ModelLike,
    effects_of,
    name_of,
)
from testbed.api.best_fit import force_maps, of_the_best_fit
from testbed.api.defaults import MANY
from testbed.api.fitting import channel_units, engine_of, notes_on, read_both, told_before
from testbed.api.next_command import add_command, next_command
from testbed.api.places import made_folder, page_place
from testbed.api.result import Result, Table, plain, shown_here
from testbed.api.watch import Progress, Watch
from testbed.api.working import working
from testbed.problem import InputProblem

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from testbed.analysis.search.candidate import Tried
    from testbed.analysis.search.diagnosis import Diagnosis as Diagnosed
    from testbed.analysis.search.next_test import NextTest
    from testbed.machine import Model



@dataclass(frozen=True, repr=False, eq=False)
class Diagnosis(Result):
    """What a model lacks, as far as a campaign tells.

    believed: the model as it was given. detail: everything, the fits too. known: the effects that were offered. records, read:
    the campaign's, ready for a fit, and as read. said: what `--json` writes. place: the campaign's file and the model's.
    """

    believed: Model
    detail: Diagnosed
    known: Effects
    records: list[Any]
    read: tuple[Any, ...]
    said: Mapping[str, Any]
    place: tuple[str, str]

    @property
    def verdict(self) -> str:
        """`missing_effect`, `adequate`, `unexplained`, `undecided` or `not_converged`."""
        return self.detail.verdict

    @property
    def effects(self) -> tuple[str, ...]:
        """What to add, strongest first; of an undecided one the tied names."""
        return tuple(self.detail.effects)

    @property
    def sentence(self) -> str:
        """The verdict in words, with its reason."""
        return self.detail.sentence

    @property
    def error(self) -> Mapping[str, float]:
        """`baseline`, `with_effects` and `noise_floor`: rms ratios on records left out of the fit."""
        return dict(self.said["error"])

    @property
    def candidates(self) -> tuple[Tried, ...]:
        """Sets of effects that were tried, those that a first step ruled out among them."""
        return self.detail.candidates

    @property
    def next_test(self) -> NextTest | None:
        """The cut that would tell tied explanations apart: spindle_speed (rad/s), depth_of_cut (m)."""
        return self.detail.next_test

    @property
    def model(self) -> Model:
        """The best model found, effects and all, fitted to the campaign; the believed one where no fit was made."""
        from testbed.analysis.search.candidate import Candidate

        best = self.detail.best
        return best.fit.state.model if isinstance(best, Candidate) else self.believed

    @property
    def notes(self) -> tuple[str, ...]:  # type: ignore[override]
        """What is to be known before the verdict is believed."""
        return tuple(self.said["notes"])

    @property
    def first(self) -> str:
        """What the step before anything is added is called."""
        from testbed.analysis.search.diagnosis import unaided

        return unaided(self.believed)

    def propose(self, folder: File, progress: Progress = None) -> Proposal | None:
        """Estimate the force that is missing and write it into a folder as an effect file of one's own. None where nothing
        beyond the noise is left. InputProblem where it cannot be estimated."""
        from testbed.analysis.force.explanation import as_json, write_effect
        from testbed.analysis.force.formula_trial import Jury
        from testbed.trial.proposal import free_name

        place, known = os.fspath(folder), self.known.known
        made_folder(place)
        with working(progress) as watch:
            try:
                with watch.busy("estimating the missing force") as shown:
                    jury = Jury(engine_of, self.believed, known, shown)
                    told = jury.left_unexplained(self.records, self.detail)
                    explanation = jury.likeliest(told) if told else None
            except ValueError as problem:
                raise InputProblem(self.place[0], f"the missing force cannot be estimated: {problem}",
                                   "record more cuts") from None
            if explanation is None:
                return None
            said = as_json(explanation)
            if not explanation.formula:
                return Proposal(explanation.sentence, None, "", said)
            path = write_effect(explanation, place, free_name(place, "proposal"))
            every = {os.path.realpath(one): one for one in (*self.known.folders, place)}  # none is named twice
            return Proposal(explanation.sentence, path, add_command((path.stem,), *self.place, tuple(every.values())),
                            said | {"file": str(path)})

    def false_alarms(self, count: int, seed: int = 0, progress: Progress = None) -> FalseAlarms:
        """Repeat the diagnosis on so many campaigns simulated without a hidden effect: how often is one named?"""
        from testbed.analysis.search.candidate import Candidate
        from testbed.analysis.search.false_alarms import false_alarms

        known, base = self.known.known, self.detail.base
        if not isinstance(base, Candidate):
            raise InputProblem(self.place[0], "the believed model was not fitted", "allow a larger budget")
        with working(progress) as watch, watch.busy("diagnosing campaigns without a hidden effect") as shown:
            told = false_alarms(engine_of(known), base, known, count, seed, shown)
        return FalseAlarms(count, told.alarms, told.interval, told.named)

    def report(self, path: File, *, said: Mapping[str, Any] | None = None, next_step: str | None = None) -> Path:
        """Write the story of this diagnosis into a folder (as report.html), or as the .html file named; returns its path.

        said: what is told, with what was asked further. next_step: the command to go on with; None: as the verdict has it.
        """
        from testbed.analysis.report.story_page import diagnosis_page

        place = page_place(path)
        with working():
            campaign, model_file = self.place
            if next_step is None:
                next_step = next_command(self.detail, campaign, model_file, False, self.known.folders)
            page = diagnosis_page(self.detail, dict(said or self.said), self.believed, self.known.known,
                                  channel_units(self.read), notes=[f"{campaign} against {model_file}", *self.notes],
                                  next_step=next_step, force_maps=force_maps(self.detail, self.known.known))
            return page.write(place)

    def plot(self) -> Figure:
        """The error at each step of the search, against the noise floor."""
        from matplotlib.figure import Figure

        steps = self.detail.steps or (self.detail.base,)
        figure = Figure(figsize=(7, 0.6 * len(steps) + 1.8), layout="constrained")
        axes = figure.subplots()
        names = [" + ".join(one.effects) or self.first for one in steps]
        axes.barh(names, [one.error_held_out for one in steps], color="#9ecae1")
        axes.axvline(self.detail.noise_floor, color="#d62728", linewidth=1.0, label="noise floor")
        axes.invert_yaxis()
        where = "held out" if self.detail.held_out else "in the fit"
        axes.set(xlabel=f"error, {where}", title=self.verdict.replace("_", " "))
        axes.legend()
        return shown_here(figure)  # type: ignore[no-any-return]

    def _answer(self) -> Mapping[str, Any]:
        return self.said

    def _table(self) -> Table:
        tried = self.detail.fitted
        return Table("tried", {"tried": [" + ".join(one.effects) for one in tried],
                               "error_fit": [one.error_fit for one in tried],
                               "error_held_out": [one.error_held_out for one in tried],
                               "delta_bic": [one.delta_bic for one in tried],
                               "converged": [one.converged for one in tried]}, {})

    def _headline(self) -> str:
        named = f": {', '.join(self.effects)}" if self.effects else ""
        return f"{self.verdict.replace('_', ' ')}{named}. {self.sentence}"


@dataclass(frozen=True)
class Proposal:
    """A force that is missing, in words; the effect file that was written, or None; the command that adds it."""

    sentence: str
    file: Path | None
    next_step: str
    said: Mapping[str, Any]

    def to_dict(self) -> dict[str, Any]:
        """What `testbed diagnose --propose --json` writes under `proposal`."""
        return dict(plain(self.said))


@dataclass(frozen=True)
class FalseAlarms:
    """Of `campaigns` without a hidden effect, in how many one was named; the rate's 95 % interval; what was named."""

    campaigns: int
    alarms: int
    interval: tuple[float, float]
    named: tuple[tuple[str, ...], ...]

    def to_dict(self) -> dict[str, Any]:
        """What `testbed diagnose --false-alarms --json` writes under `false_alarms`."""
        low, high = self.interval
        return {"campaigns": self.campaigns, "alarms": self.alarms, "rate_low": low, "rate_high": high,
                "named": [list(names) for names in self.named]}


def diagnose(campaign: CampaignLike, model: ModelLike, *, until_adequate: bool = False, decoys: bool = False,
             budget: float | None = None, effects: EffectsLike = (), progress: Progress = None) -> Diagnosis:
    """Fit a model to a campaign, then with each effect of the catalogue, and compare on records held out of the fit.

    campaign: a campaign.yaml, or testbed.load of one. model: a model.yaml or a Model. until_adequate: go on adding, up to six
    effects, until only noise is left. decoys: offer laws that no machine has, too. budget: end with what is known after so many
    simulations of every record. effects: folders of one's own effects. progress: a function of (title, done, all), or False.
    An honest "these records cannot tell" is an answer, too. Raises InputProblem.
    """
    from testbed.catalogue import DECOYS

    with working(progress) as watch:
        own = effects_of(effects)
        offered = effects_of((*own.folders, str(DECOYS))).known if decoys else own.known
        return _diagnosed((campaign, model), Effects(offered, own.folders), until_adequate, decoys, budget, watch)


def _diagnosed(given: tuple[CampaignLike, ModelLike], known: Effects, until_adequate: bool, decoys: bool,
               budget: float | None, watch: Watch) -> Diagnosis:
    from testbed.analysis.fit.budget import BUDGET
    from testbed.analysis.search.answer import as_json
    from testbed.analysis.search.diagnose import diagnose as searched
    from testbed.analysis.search.rules import rules_of
    from testbed.analysis.search.sign_check import other_way_note

    catalogue, engine = known.known, engine_of(known.known)
    model, records, read = read_both(*given, catalogue)
    told = told_before(engine, records, model, catalogue, watch.note)
    with watch.busy("fitting the believed model to all records") as progress:
        found = searched(engine, records, model, catalogue, progress=progress, budget=BUDGET if budget is None else budget,
                         told=told, **({"most": MANY} if until_adequate else {}))
        turned = []
        if found.candidates:  # else no search was made, for what was found before it
            turned = other_way_note(engine, records, model, catalogue, found.with_effects, found.noise_floor)
    stuck, guesses, of_the_fit, tapped = of_the_best_fit(found, records, model, catalogue)
    notes = [*notes_on(read, model), *told.notes, *turned, *of_the_fit]
    said = as_json(found, model) | {"rules": rules_of(found), "at_bound": list(stuck), "tap": tapped, "notes": notes}
    for name, one in said["base_parameters"].items():
        one["determined"] = name not in guesses
    if decoys:
        said["decoys"] = _decoys(found, catalogue)
    return Diagnosis(model, found, known, records, read, said, (name_of(given[0]), name_of(given[1])))


def _decoys(found: Diagnosed, catalogue: Any) -> dict[str, Any]:
    """Laws that no machine has: those offered, and those named."""
    from testbed.catalogue import DECOYS

    offered = [name for name, effect in catalogue.items() if effect.path is not None and effect.path.parent == DECOYS]
    return {"offered": offered, "named": [name for name in found.effects if name in offered]}
