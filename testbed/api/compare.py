"""The model refitted, every record predicted, and where it fails."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

from testbed.api.believed import CampaignLike, Effects, EffectsLike, File, ModelLike, effects_of, name_of
from testbed.api.fitting import channel_units, engine_of, notes_on, read_both, told_before
from testbed.api.places import page_place
from testbed.api.result import Result, Table, estimates_table, shown_here, with_units
from testbed.api.watch import Progress, Watch
from testbed.api.working import working
from testbed.problem import InputProblem, optional

if TYPE_CHECKING:
    import pandas
    import xarray
    from matplotlib.figure import Figure

    from testbed.analysis.comparison.compare import Comparison as Compared
    from testbed.analysis.comparison.compare import RecordComparison
    from testbed.analysis.comparison.tapped import TappedParameter
    from testbed.analysis.estimate import Estimate
    from testbed.machine import Model


@dataclass(frozen=True, repr=False, eq=False)
class Comparison(Result):
    """How well a model, refitted, predicts a campaign.

    believed: the model as it was given. detail: everything, the fit and its residuals too. told: notes that belong before
    the fit. tap: the parameters found beside those of a tap test. place: the campaign's file and the model's.
    """

    believed: Model
    detail: Compared
    effects: Effects
    read: tuple[Any, ...]
    told: tuple[str, ...]
    remarks: tuple[str, ...]
    tap: tuple[TappedParameter, ...]
    place: tuple[str, str]

    @property
    def error(self) -> float:
        """rms(measured - predicted) / rms(measured about its mean), held out of the fit, pooled over all records."""
        return self.detail.error

    @property
    def noise_floor(self) -> float:
        """The same ratio for the measured noise alone."""
        return self.detail.noise_floor

    @property
    def adequate(self) -> bool | None:
        """Whether nothing but noise is left of any record; None where hardly anything but noise was measured."""
        return None if self.detail.says_nothing else self.detail.adequate

    @property
    def converged(self) -> bool:
        """Whether the fit did; the figures are otherwise those of its last step."""
        return self.detail.fit.converged

    @property
    def records(self) -> tuple[RecordComparison, ...]:
        """Every record: its error, noise floor, chi-square, segments and nuisances."""
        return self.detail.records

    @property
    def parameters(self) -> Mapping[str, Estimate]:
        """The parameters found, by path, each with value, low, high (95 %) and unit."""
        return self.detail.parameters

    @property
    def model(self) -> Model:
        """The model as it was fitted to all records."""
        return self.detail.fit.state.model

    @property
    def silence(self) -> tuple[str, ...]:
        """That records hold hardly anything but noise."""
        if not self.detail.silent:
            return ()
        names = ", ".join(self.detail.silent)
        return (f"{names}: almost only noise was measured, which does not test the model",)

    @property
    def notes(self) -> tuple[str, ...]:  # type: ignore[override]
        """What is to be known before the figures are believed."""
        return (*self.told, *self.remarks, *self.silence)

    @property
    def verdict(self) -> str:
        """The comparison in a sentence."""
        from testbed.analysis.report.compare_page import verdict_of

        return verdict_of(self.detail)

    def waveform(self, record: str) -> Waveform:
        """What was measured of a record and what the fit that left its condition out predicts. KeyError of its name."""
        for index, own in enumerate(self.detail.fitter.records):
            if own.name == record:
                return Waveform(self, index)
        raise KeyError(record)

    @property
    def plots(self) -> tuple[str, ...]:
        """What `plot` can draw of this comparison."""
        return tuple(self._pictures(quick=True))

    def plot(self, kind: str = "worst_record") -> Figure:
        """One picture of what is left unexplained: see `plots` for their names. `constancy` and `force_state_map` fit anew."""
        from matplotlib.figure import Figure

        pictures = self._pictures(quick=kind not in ("constancy", "force_state_map"))
        if kind not in pictures:
            raise InputProblem(kind, "is no picture of this comparison", f"there are {', '.join(pictures)}")
        figure = Figure(figsize=(10, 5), layout="constrained")
        pictures[kind](figure)
        return shown_here(figure)  # type: ignore[no-any-return]

    def save_plots(self, folder: File, progress: Progress = None) -> list[Path]:
        """Every picture as PNG and SVG into a folder that is there; the paths written."""
        from testbed.analysis.comparison.compare_plots import save
        from testbed.analysis.comparison.residual_views import map_units

        with working(progress) as watch, watch.busy("fitting test by test, drawing"):
            return save(self.detail, Path(folder), self._tested, self._states, map_units(self._units), self._units)

    def report(self, path: File, progress: Progress = None) -> Path:
        """Write the page of this comparison into a folder (as report.html), or as the .html file named; returns its path."""
        from testbed.analysis.report.compare_page import compare_page

        place = page_place(path)
        with working(progress) as watch, watch.busy("fitting test by test, drawing"):
            campaign, model_file = self.place
            page = compare_page(self.detail, self.believed, self.effects.known, self._units, tested=self._tested,
                                force_maps=[(one.name, one.x, one.v, one.force) for one in self._states],
                                notes=[f"{campaign} against {model_file}", *self.remarks, *self.silence])
            return page.write(place)

    def _pictures(self, quick: bool = False) -> Mapping[str, Any]:
        """Functions that draw; quick: without those that need further fits."""
        from testbed.analysis.comparison.compare_plots import pictures
        from testbed.analysis.comparison.residual_views import map_units

        tested, states = (None, ()) if quick else (self._tested, self._states)
        return pictures(self.detail, tested, states, map_units(self._units), self._units)

    @cached_property
    def _units(self) -> dict[str, str]:
        return channel_units(self.read)

    @cached_property
    def _tested(self) -> Any:
        from testbed.analysis.comparison.constancy import constancy

        return constancy(self.detail.fitter, self.detail.fit, self.effects.known)

    @cached_property
    def _states(self) -> Sequence[Any]:
        """Force-state maps of what is left. Of noise there is none."""
        from testbed.analysis.force.force_state import force_states

        if self.detail.adequate:
            return ()
        known = self.effects.known
        return force_states(engine_of(known), self.detail.fitter, self.detail.fit, self.detail.errors, known)

    def _answer(self) -> Mapping[str, Any]:
        from testbed.analysis.comparison.compare import as_json

        return as_json(self.detail) | {"tap": [one.as_json() for one in self.tap], "notes": self.notes}

    def parameters_to_pandas(self) -> pandas.DataFrame:
        """The parameters found as a pandas DataFrame: value, low, high, unit."""
        table = estimates_table(self.parameters)
        return optional("pandas").DataFrame(table.columns).set_index(table.head)  # type: ignore[no-any-return]

    def _table(self) -> Table:
        found = self.records
        return Table("name", {"name": [one.name for one in found], "kind": [one.kind for one in found],
                              "error": [one.error for one in found], "error_fit": [one.error_fit for one in found],
                              "noise_floor": [one.noise_floor for one in found],
                              "chi_square": [one.chi_square for one in found],
                              "held_out": [one.held_out for one in found]}, {})

    def _headline(self) -> str:
        return f"error {self.error:.4g}, noise floor {self.noise_floor:.4g}: {self.verdict}"


@dataclass(frozen=True, repr=False, eq=False)
class Waveform:
    """One record of a comparison: what was measured, what is predicted without having seen it, and the rest."""

    of: Comparison
    index: int

    @property
    def name(self) -> str:
        """The record's name."""
        return self.of.detail.fitter.records[self.index].name

    @property
    def channels(self) -> tuple[str, ...]:
        """Channels that were compared, in the order of the arrays' first axis."""
        return self.of.detail.fitter.records[self.index].channels

    @property
    def time(self) -> Any:
        """Sample times, s, shape (samples,)."""
        import numpy as np

        own = self.of.detail.fitter.records[self.index]
        return own.start + np.arange(own.samples) / own.rate

    @property
    def measured(self) -> Any:
        """Offset and drift of the sensor taken away, in the channels' units, shape (channels, samples)."""
        own = self.of.detail.fitter.records[self.index]
        return own.data - (own.data @ own.drift) @ own.drift.T

    @property
    def residual(self) -> Any:
        """Measured less predicted, shape (channels, samples)."""
        return self.of.detail.errors[self.index].residual

    @property
    def predicted(self) -> Any:
        """Shape (channels, samples)."""
        return self.measured - self.residual

    def to_xarray(self) -> xarray.Dataset:
        """`measured`, `predicted` and `residual` over channel and time (s). InputProblem without xarray."""
        parts = {name: (("channel", "time"), getattr(self, name)) for name in ("measured", "predicted", "residual")}
        found = optional("xarray").Dataset(parts, {"channel": list(self.channels), "time": self.time})
        return with_units(found, {"time": "s"})  # type: ignore[no-any-return]

    def plot(self) -> Figure:
        """Measured, predicted and their difference over time, of the first channel."""
        from matplotlib.figure import Figure

        from testbed.analysis.comparison.compare_plots import one_record

        figure = Figure(figsize=(10, 5), layout="constrained")
        one_record(figure, self.of.detail, self.index, self.of._units)
        return shown_here(figure)  # type: ignore[no-any-return]

    def __repr__(self) -> str:
        return f"<Waveform: {self.name}, {', '.join(self.channels)}, {len(self.time)} samples>"


def compare(campaign: CampaignLike, model: ModelLike, *, effects: EffectsLike = (), progress: Progress = None) -> Comparison:
    """Fit a model to a whole campaign, predict each record from a fit that left its operating condition out, and set the
    error against the noise.

    campaign: a campaign.yaml, or testbed.load of one. model: a model.yaml or a Model: the start of the fit. effects: folders of
    one's own effects. progress: a function of (title, done, all), or False for silence.
    Raises InputProblem where either cannot be read, or a record cannot be predicted.
    """
    with working(progress) as watch:
        return _compared(campaign, model, effects_of(effects), watch)


def _compared(campaign: CampaignLike, given: ModelLike, effects: Effects, watch: Watch) -> Comparison:
    from testbed.analysis.comparison.compare import compare as fitted
    from testbed.analysis.comparison.tapped import beside_the_tap, said_of_the_tap
    from testbed.analysis.fit.estimates import clock_note
    from testbed.analysis.fit.plausible import remarks_on
    from testbed.analysis.fit.record_hypotheses import taken_notes
    from testbed.analysis.fit.switched import switch_note
    from testbed.analysis.search.mark_delay import delay_note
    from testbed.analysis.search.sign_check import other_way_note

    catalogue, engine = effects.known, engine_of(effects.known)
    model, records, read = read_both(campaign, given, catalogue)
    told = told_before(engine, records, model, catalogue, watch.note)
    with watch.busy("fitting the believed model to all records"):
        found = fitted(engine, records, model, catalogue, told)
        turned = other_way_note(engine, records, model, catalogue, found.error, found.noise_floor)
    unlike = [] if found.adequate else switch_note(found.fitter, found.fit.state, catalogue)
    notes = [*notes_on(read, model), *turned, *unlike, *taken_notes(records, found.fitter.records),
             *delay_note(records, found.fitter, found.fit), *clock_note(found.fitter, found.fit),
             *remarks_on(model, found.fit.state.model)]
    notes += [one for one in found.against if not any(one in note for note in notes)]
    tapped = beside_the_tap(model, found.parameters, found.adequate and found.fit.converged and not found.silent)
    notes += said_of_the_tap(tapped, any(one.kind == "cut" for one in found.records))
    return Comparison(model, found, effects, read, tuple(told.notes), tuple(notes), tuple(tapped),
                      (name_of(campaign), name_of(given)))
