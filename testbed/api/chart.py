"""The stability chart of a machine, with recorded tests laid over it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from testbed.api.believed import (
    CampaignLike,
    DataLike,
    EffectsLike,
    File,
    ModelLike,
    cutting_model,
    effects_of,
    guesses_note,
    in_the_work,
)
from testbed.api.identification import tests_on_chart
from testbed.api.multipliers import of_cut
from testbed.api.places import page_place
from testbed.api.probable import Asked, Sure, chances, unasked
from testbed.api.quantity import DEPTH, SPEED, Quantities, Quantity, quantity
from testbed.api.result import Result, Table, shown_here, with_units
from testbed.api.watch import Progress, Watch
from testbed.api.working import working
from testbed.problem import InputProblem, optional

if TYPE_CHECKING:
    import pandas
    import xarray
    from matplotlib.figure import Figure
    from numpy.typing import NDArray

    from testbed.analysis.linear.chart_plot import ChartTest
    from testbed.analysis.linear.stability import StabilityChart
    from testbed.machine import Model

MOST_CELLS = 4_000_000
PLANAR_PARTS = 4  # of a cell of a picture, along either axis: a cell of a machine in x and y costs up to a millisecond
_UNITS = {"spindle_speed": "rad/s", "axial_depth_of_cut": "m", "stability_limit": "m", "stability_limit_low": "m",
          "stability_limit_median": "m", "stability_limit_high": "m"}


@dataclass(frozen=True, repr=False, eq=False)
class Chart(Result):
    """Where a machine cuts steadily and where it chatters: S spindle speeds by B axial depths of cut.

    detail: the cells. model: whose chart it is, fitted where a campaign was given. stability_limit: depth (m) at which the cut
    first becomes unstable at each speed, (S,), NaN where the chart holds none. tests: recorded cuts laid over it. sure: what
    is known of chances.
    """

    detail: StabilityChart
    model: Model
    stability_limit: NDArray[Any]
    tests: tuple[ChartTest, ...]
    sure: Sure
    notes: tuple[str, ...]

    @property
    def spindle_speed(self) -> NDArray[Any]:
        """rad/s, (S,)."""
        return self.detail.spindle_speeds

    @property
    def axial_depth_of_cut(self) -> NDArray[Any]:
        """m, (B,)."""
        return self.detail.axial_depths

    @property
    def largest_multiplier(self) -> NDArray[Any]:
        """The multiplier of largest modulus, complex, (B, S); NaN where a cell is blank."""
        return self.detail.largest

    @property
    def error(self) -> NDArray[Any]:
        """An estimate of the error of its modulus, (B, S)."""
        assert self.detail.error is not None  # of a chart made here
        return self.detail.error

    @property
    def stability(self) -> list[list[str | None]]:
        """`stable`, `neimark_sacker`, `flip` or `saddle_node` of every cell, None where it is blank, (B, S)."""
        from testbed.analysis.linear.stability import CLASSES

        return [[CLASSES[cell] if cell >= 0 else None for cell in row] for row in self.detail.classes.tolist()]

    @property
    def stable_probability(self) -> NDArray[Any] | None:
        """Share of the machines drawn that are stable, (B, S); None where no chance was asked for, or none can be given."""
        return None if self.sure.chance is None else self.sure.chance.probability  # type: ignore[no-any-return]

    @property
    def recommended(self) -> Any:
        """The cut of most removal at the risk asked: spindle_speed (rad/s), axial_depth_of_cut (m), stable_probability."""
        return self.sure.recommended

    def plot(self) -> Figure:
        """The chart with its borders, finer than its cells, and the tests laid over it."""
        from testbed.analysis.linear.chart_plot import plot_chart
        from testbed.analysis.linear.stability import feed_note

        guessed = f"guessed: {', '.join(self.model.not_determined)}" if self.model.not_determined else ""
        with working():
            drawn = _drawn(self.detail, self.model)
        return shown_here(plot_chart(drawn, list(self.tests), guessed, title=feed_note(self.model)))  # type: ignore[no-any-return]

    def plot_chance(self) -> Figure:
        """The chance of stability. InputProblem where none is known."""
        from testbed.analysis.probable.plot import plot_chance

        if self.sure.chance is None:
            raise InputProblem("plot_chance", f"no chance is known: {self.sure.why_none}", "see testbed.chart, campaign")
        return shown_here(plot_chance(self.sure.chance, self.stability_limit,  # type: ignore[no-any-return]
                                      self.sure.recommended, self.sure.risk))

    def save_plots(self, folder: File) -> list[Path]:
        """stability_chart and, where chances are known, probable_stability, as PNG and SVG; the paths written."""
        from testbed.analysis.linear.chart_plot import save

        pictures = save(self.plot(), Path(folder) / "stability_chart")
        if self.sure.chance is not None:
            pictures += save(self.plot_chance(), Path(folder) / "probable_stability")
        return pictures

    def report(self, path: File, *, effects: EffectsLike = (), progress: Progress = None) -> Path:
        """Write the page on which a cut is dragged and heard into a folder (as report.html), or as the .html file named;
        returns its path.

        It holds some hundred cuts, simulated now. effects: folders of one's own effects that the model has.
        """
        from testbed.api.sounding import listened

        with working(progress) as watch:
            return listened(self, page_place(path), effects_of(effects).known, watch)

    def to_pandas(self) -> pandas.DataFrame:
        """A row for every cell: speed (rad/s), depth (m), modulus, its error, class and, where known, the chance."""
        import numpy as np

        rows = {"spindle_speed": np.tile(self.spindle_speed, self.axial_depth_of_cut.size),
                "axial_depth_of_cut": np.repeat(self.axial_depth_of_cut, self.spindle_speed.size),
                "modulus": abs(self.largest_multiplier).ravel(), "error": self.error.ravel(),
                "stability": [one for row in self.stability for one in row]}
        if self.stable_probability is not None:
            rows["stable_probability"] = self.stable_probability.ravel()
        frame = optional("pandas").DataFrame(rows)
        frame.attrs["units"] = {name: unit for name, unit in _UNITS.items() if name in rows}
        return frame  # type: ignore[no-any-return]

    def to_xarray(self) -> xarray.Dataset:
        """Over axial_depth_of_cut (m) and spindle_speed (rad/s): largest_multiplier, modulus, error, stability, and more."""
        import numpy as np

        cells, speeds = ("axial_depth_of_cut", "spindle_speed"), ("spindle_speed",)
        stability = np.array([[one or "" for one in row] for row in self.stability])
        parts: dict[str, Any] = {
            "largest_multiplier": (cells, self.largest_multiplier), "modulus": (cells, abs(self.largest_multiplier)),
            "error": (cells, self.error), "stability": (cells, stability), "stability_limit": (speeds, self.stability_limit)}
        if self.sure.chance is not None:
            parts["stable_probability"] = (cells, self.sure.chance.probability)
            for name, limit in zip(("low", "median", "high"), self.sure.chance.limits, strict=True):
                parts[f"stability_limit_{name}"] = (speeds, limit)
        found = optional("xarray").Dataset(parts, {"spindle_speed": self.spindle_speed,
                                                   "axial_depth_of_cut": self.axial_depth_of_cut})
        return with_units(found, _UNITS)  # type: ignore[no-any-return]

    def _answer(self) -> Mapping[str, Any]:
        return {"spindle_speed": self.spindle_speed, "axial_depth_of_cut": self.axial_depth_of_cut,
                "largest_multiplier": self.largest_multiplier, "class": self.stability, "error": self.detail.error,
                "stability_limit": self.stability_limit, "stability_limit_lies": self.detail.limit_lies(), "tests": self.tests,
                "notes": self.notes} | self.sure.as_json()

    def _table(self) -> Table:
        return Table("spindle_speed", {"spindle_speed": self.spindle_speed.tolist(),
                                       "stability_limit": self.stability_limit.tolist(),
                                       "limit_lies": self.detail.limit_lies()}, _UNITS)

    def _headline(self) -> str:
        known = self.detail.classes >= 0
        share = f"{float((self.detail.classes[known] == 0).mean()):.0%} stable" if known.any() else "none to be trusted"
        return f"{self.spindle_speed.size} speeds x {self.axial_depth_of_cut.size} depths, {share}"


def chart(model: ModelLike, speed: Quantities, depth: Quantities, *, data: DataLike | None = None,
          campaign: CampaignLike | None = None, risk: Quantity = 0.05, draws: int = 300, seed: int = 0,
          effects: EffectsLike = (), progress: Progress = None) -> Chart:
    """Where a machine cuts steadily and where it chatters, over spindle speed and depth of cut.

    Every cell has an estimate of its error; what cannot be trusted stays blank. A model with effects is linearised in every
    cell, effects and all. Where the model has values with a deviation, or with a campaign, machines are drawn from what is
    known, and every cell gets its chance of being stable.

    model: a model.yaml or a Model. speed: `"2500 rpm:4500 rpm:201"`, or values in rad/s that rise. depth:
    `"0.1 mm:4 mm:101"`, or values in m. data: tests to lay over it. campaign: fit the model to it first. risk: of
    chatter that the cut recommended may have, `"5%"` or 0.05. draws: machines drawn. effects: folders of one's own effects.
    progress: a function of (title, done, all), or False. Raises InputProblem.
    """
    import numpy as np

    with working(progress) as watch:
        speeds, depths = np.array(SPEED.values(speed, "speed")), np.array(DEPTH.values(depth, "depth"))
        if speeds.size * depths.size > MOST_CELLS:
            raise InputProblem("speed, depth", f"{speeds.size * depths.size} cells", f"give at most {MOST_CELLS}")
        own = effects_of(effects)
        given, name = cutting_model(model, own.known)
        believed, _ = in_the_work(given)
        tests = tests_on_chart(believed, data) if data is not None else []
        chance = chance_of_chatter(risk)
        sure = unasked(draws, chance)
        if campaign is not None or believed.spreads:
            sure = chances(Asked(believed, model, campaign, own.known, speeds, depths, draws, seed, chance, watch))
        machine, left_out = in_the_work(sure.model or given)
        return _charted(machine, speeds, depths, own.known, left_out, tests, sure, watch)


def chance_of_chatter(risk: Quantity) -> float:
    """A risk as a number between 0 and 1. InputProblem."""
    found = quantity(risk, "1", "risk")
    if not 0.0 < found < 1.0:
        raise InputProblem("risk", f"'{risk}' is no chance between 0 and 100 %", "give for example '5%'")
    return found


def _charted(model: Any, speeds: Any, depths: Any, catalogue: Any, left_out: list[str], tests: list[Any], sure: Sure,
             watch: Watch) -> Chart:
    import numpy as np

    from testbed.analysis.linear.stability import feed_note, sharpened_limit

    found = with_effects(model, speeds, depths, catalogue, watch) if model.effects else _linear(model, speeds, depths)
    notes = [*guesses_note(model), *left_out, *sure.notes, *filter(None, [feed_note(model)])]
    blank = int(np.count_nonzero(found.classes < 0))
    if blank:
        still = "no periodic motion was found there, or " if model.effects else ""
        notes.append(f"{blank} cells are left blank: {still}their multipliers did not settle")
    limit = found.stability_limit() if model.effects else sharpened_limit(found, model)
    return Chart(found, model, limit, tuple(tests), sure, tuple(notes))


def _linear(model: Any, speeds: Any, depths: Any) -> Any:
    from testbed.analysis.linear.stability import stability_chart

    return stability_chart(model, speeds, depths)


def _drawn(chart: Any, model: Any) -> Any:
    """The chart for a picture, its borders finer than its cells; with effects, where a cell costs much, as it is."""
    from functools import partial

    from testbed.analysis.linear.chart_border import MOST_PARTS, refined

    most = PLANAR_PARTS if model.planar else MOST_PARTS
    return chart if model.effects else refined(chart, partial(_linear, model), most)


def with_effects(model: Any, speeds: Any, depths: Any, catalogue: Any, watch: Watch) -> Any:
    """The chart cell by cell. Over a period of several passes, the multiplier's modulus is given per tooth pass."""
    import numpy as np

    from testbed.analysis.linear.stability import CLASSES, StabilityChart
    from testbed.cut import Cut

    largest = np.full((depths.size, speeds.size), np.nan + 0j)
    classes, error = np.full(largest.shape, -1, dtype=np.int8), np.full(largest.shape, np.nan)
    with watch.counted("chart") as show:
        for place in range(largest.size):
            row, column = divmod(place, speeds.size)
            try:
                found = of_cut(model, Cut(speeds[column], depths[row]), catalogue, "chart")
            except InputProblem:  # no periodic motion here; the cell stays blank
                found = None
            if found is not None:
                value, wrong, share = complex(found["multipliers"][0]), float(found["error"][0]), 1.0 / found["period_passes"]
                if share < 1.0 and value:
                    wrong *= share * abs(value) ** (share - 1.0)
                    value *= abs(value) ** (share - 1.0)
                error[row, column] = wrong
                largest[row, column] = complex(value.real, abs(value.imag))
                classes[row, column] = CLASSES.index(found["class"])
            show(place + 1, largest.size)
    if np.isnan(largest).all():
        raise InputProblem("chart", "no cell has multipliers: an effect of the model leaves no periodic motion",
                           "leave out the effect")
    return StabilityChart(speeds, depths, largest, classes, error)
