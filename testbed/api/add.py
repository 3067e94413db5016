"""Effects join the model, everything is refitted, and the error falls, or does not."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from testbed.api.believed import CampaignLike, Effects, EffectsLike, File, ModelLike, effects_of, name_of
from testbed.api.fitting import channel_units, engine_of, notes_on, read_both, told_before
from testbed.api.places import page_place, save_fitted
from testbed.api.result import Result, Table, estimates_table, shown_here
from testbed.api.watch import Progress, Watch
from testbed.api.working import working
from testbed.problem import InputProblem

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from testbed.analysis.estimate import Estimate
    from testbed.analysis.search.add_effect import Addition as Added
    from testbed.machine import Model


@dataclass(frozen=True, repr=False, eq=False)
class Addition(Result):
    """A model with effects added, refitted.

    believed: the model before. detail: everything, the fits too. known: the effects known. records, read: the campaign's, ready
    for a fit, and as read. place: the campaign's file and the model's.
    """

    believed: Model
    detail: Added
    known: Effects
    records: list[Any]
    read: tuple[Any, ...]
    notes: tuple[str, ...]
    place: tuple[str, str]

    @property
    def effects(self) -> tuple[str, ...]:
        """What was added, in that order."""
        return self.detail.effects

    @property
    def model(self) -> Model:
        """The model with the effects, fitted to the campaign."""
        return self.detail.model

    @property
    def vanished(self) -> list[str]:
        """Effects that ended where they do nothing: all that could switch them off is at its neutral value."""
        switches = {name: [one for one in self.known.known[name].parameters if one.vanishes] for name in self.effects}
        return [name for name, ones in switches.items()
                if ones and all(self.model.effects[name][one.name] == one.neutral for one in ones)]

    @property
    def before(self) -> float:
        """The error without them, on records left out of the fit."""
        return self.detail.before

    @property
    def after(self) -> float:
        """The error with them."""
        return self.detail.after

    @property
    def noise_floor(self) -> float:
        """The same ratio for the measured noise alone."""
        return self.detail.noise_floor

    @property
    def parameters(self) -> Mapping[str, Estimate]:
        """The parameters found, by path, each with value, low, high (95 %) and unit."""
        return self.detail.parameters

    @property
    def warnings(self) -> tuple[str, ...]:
        """What speaks against the addition."""
        return self.detail.warnings

    @property
    def converged(self) -> bool:
        """Whether the fit did."""
        return self.detail.converged

    def save_model(self, path: File) -> Path:
        """Write the model with the effects as a model.yaml; an older one there is replaced. InputProblem."""
        return save_fitted(self.model, path, self.known.known)

    def report(self, path: File) -> Path:
        """Write the page of this addition into a folder (as report.html), or as the .html file named; returns its path."""
        from testbed.analysis.report.story_page import addition_page

        place = page_place(path)
        with working():
            campaign, model_file = self.place
            page = addition_page(self.detail, self.records, self.believed, channel_units(self.read),
                                 notes=[f"{campaign} against {model_file}", *self.notes])
            return page.write(place)

    def plot(self) -> Figure:
        """The error of every record before and after, against its noise floor."""
        import numpy as np
        from matplotlib.figure import Figure

        found, place = self.detail, np.arange(len(self.detail.records_after))
        figure = Figure(figsize=(8, 4), layout="constrained")
        axes = figure.subplots()
        axes.bar(place - 0.2, [one.error for one in found.records_before], 0.4, color="#bdbdbd", label="before")
        axes.bar(place + 0.2, [one.error for one in found.records_after], 0.4, color="#2b7bba", label="after")
        axes.plot(place, [one.noise_floor for one in found.records_after], "_", color="#d62728", ms=24, label="noise floor")
        axes.set_xticks(place, [one.name for one in found.records_after], rotation=45, ha="right")
        where = "held out" if found.held_out else "in the fit"
        axes.set(ylabel=f"error, {where}", title=f"with {' and '.join(self.effects)}")
        axes.legend()
        return shown_here(figure)  # type: ignore[no-any-return]

    def _answer(self) -> Mapping[str, Any]:
        from testbed.analysis.search.add_effect import as_json

        return as_json(self.detail) | {"vanished": self.vanished, "notes": self.notes}

    def _table(self) -> Table:
        return estimates_table(self.parameters)

    def _headline(self) -> str:
        return (f"{' + '.join(self.effects)}, error {self.before:.4g} before, {self.after:.4g} after, noise floor "
                f"{self.noise_floor:.4g}")


def add(effect: str | Sequence[str], campaign: CampaignLike, model: ModelLike, *, effects: EffectsLike = (),
        progress: Progress = None) -> Addition:
    """Add an effect, or several of them, to a model and fit all parameters jointly to a campaign.

    effect: a name of the catalogue, or names, strongest first: those of a Diagnosis. campaign: a campaign.yaml, or testbed.load
    of one. model: a model.yaml or a Model. effects: folders of one's own effects. progress: a function of (title, done, all),
    or False. Raises InputProblem where an effect is unknown, is in the model already, or could show in no record.
    """
    names = (effect,) if isinstance(effect, str) else tuple(effect)
    if not names:
        raise InputProblem("effect", "none is named", "name what is to be added")
    with working(progress) as watch:
        return _added(names, (campaign, model), effects_of(effects), watch)


def _added(names: tuple[str, ...], given: tuple[CampaignLike, ModelLike], known: Effects, watch: Watch) -> Addition:
    from testbed.analysis.search.add_effect import add_effects

    catalogue, place = known.known, (name_of(given[0]), name_of(given[1]))
    chosen = _effects(names, catalogue)
    model, records, read = read_both(*given, catalogue)
    for name in names:
        if name in model.effects:
            raise InputProblem(place[1], f"has {name} already", "to fit it again, use testbed identify --method waveform")
    engine = engine_of(catalogue)
    told = told_before(engine, records, model, catalogue, watch.note)
    try:
        with watch.busy(f"adding {' and '.join(names)}") as progress:
            found = add_effects(engine, records, model, chosen, catalogue, progress, told)
    except InputProblem:
        raise
    except ValueError as problem:
        raise InputProblem(place[0], str(problem), "add a record that shows it") from None
    notes = (*notes_on(read, model), *told.notes)
    return Addition(model, found, known, records, read, notes, place)


def _effects(names: tuple[str, ...], catalogue: Any) -> list[Any]:
    from testbed.catalogue import unknown_effect

    for place, name in enumerate(names):
        if name not in catalogue:
            raise InputProblem(name, "unknown effect", unknown_effect(name, catalogue, "testbed effects lists them"))
        if name in names[:place]:
            raise InputProblem(name, "named twice", "name every effect once")
    return [catalogue[name] for name in names]
