"""Identify from synthetic transients again and again, and compare with the known truth."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

from testbed.api.believed import EffectsLike, File, effects_of, name_of, refuse_planar
from testbed.api.methods import METHODS, ONE_MODE, load_method
from testbed.api.places import made_folder
from testbed.api.quantity import Quantity, quantity
from testbed.api.result import Result, Table, shown_here
from testbed.api.scoring import Order, Sealed, study
from testbed.api.watch import Progress, Watch
from testbed.api.words import shown
from testbed.api.working import working
from testbed.machine import BASE_UNITS, base_parameter
from testbed.problem import InputProblem

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from testbed.analysis.multipliers.score import Cost, ParameterScore
    from testbed.store.data_set import DataSet

REPEATS = 5
TruthLike: TypeAlias = "File | DataSet"


@dataclass(frozen=True, repr=False, eq=False)
class Score(Result):
    """How well methods of identification do.

    scores: for each method, level of noise (m), number of tests and parameter: bias, spread, rms error, coverage of the 95 %
    intervals. cost: processor time (s) of an identification. truth: parameter -> its true value (SI). place: the data set.
    """

    methods: tuple[str, ...]
    scores: tuple[ParameterScore, ...]
    cost: tuple[Cost, ...]
    truth: Mapping[str, float]
    place: str
    seed: int
    notes: tuple[str, ...] = ()

    def plot(self, kind: str = "score_noise") -> Figure:
        """`score_noise`: errors and coverage over the noise; `score_tests`, where there are several numbers of tests: over
        those; `score_cost`: failures and processor time. InputProblem names those that there are."""
        from testbed.analysis.multipliers.score_plots import figures

        drawn = figures(self.scores, self.cost)
        if kind not in drawn:
            raise InputProblem(kind, "is no picture of this study", f"there are {', '.join(drawn)}")
        return shown_here(drawn[kind])  # type: ignore[no-any-return]

    def save(self, folder: File) -> list[Path]:
        """Write the table (score.md) and every picture (PNG and SVG) into a folder, which is made; the paths written."""
        from testbed.analysis.linear.chart_plot import save
        from testbed.analysis.multipliers.score_plots import figures
        from testbed.exports.card import table
        from testbed.system.atomic import write_text

        place = made_folder(folder)
        titles, rows = score_rows(self.scores, True, True)
        prices = [(one.method, one.tests, level(one.noise), f"{one.median:.3g} s", f"{one.high:.3g} s") for one in self.cost]
        write_text(place / "score.md", "\n\n".join([
            "# Identification under noise", f"Of {self.place}, seed {self.seed}. Coverage: share of 95 % intervals that hold "
            "the truth; a method without intervals has none. Failures are left out of bias, spread and rms.",
            table(titles, rows), "Processor time of one identification; it differs from run to run.",
            table(("method", "tests", "noise", "median", "90 %"), prices)]) + "\n")
        return [place / "score.md", *(path for name, figure in figures(self.scores, self.cost).items()
                                      for path in save(figure, place / name))]

    def _answer(self) -> Mapping[str, Any]:
        return {"method": self.methods[0], "methods": self.methods, "truth": self.truth,
                "scores": [vars(one) | {"unit": unit_of(one.parameter)} for one in self.scores], "cost": self.cost,
                "units": {"noise": "m", "median": "s", "high": "s"}}

    def _table(self) -> Table:
        names = ("parameter", "method", "tests", "noise", "truth", "bias", "spread", "rms", "coverage", "count", "failures")
        columns: dict[str, Sequence[Any]] = {name: [getattr(one, name) for one in self.scores] for name in names}
        return Table("", columns | {"unit": [unit_of(one.parameter) for one in self.scores]}, {"noise": "m"})

    def _headline(self) -> str:
        return f"{', '.join(self.methods)} on {self.place}, {len(self.scores)} scores"


def score(data: TruthLike, *, noise: Quantity | Sequence[Quantity] | None = None, repeats: int = REPEATS,
          tests: Sequence[int] | None = None, method: str | Sequence[str] = (), workers: int = 1, seed: int = 0,
          effects: EffectsLike = (), progress: Progress = None) -> Score:
    """Identify from simulated tests and their truth, away from which every identification starts; compare with it.

    data: a data set, or testbed.load of one. noise: rms of displacements to identify at ("1 um", m), which is added to what the
    tests have, each level `repeats` times; without it the data set's own. 0 is the least. tests: how many tests an
    identification has, such as (3, 5, 8), drawn anew for each; by default all. method: `multipliers` (the default for one mode
    along the feed), `published` (as in the paper), `waveform` (the default in x and y), or a FILE.py of one's own; or several.
    workers: identifications at a time. seed: of noise and beliefs. effects: folders of one's own effects. progress: a function
    of (title, done, all), or False. Raises InputProblem.
    """
    asked = (method,) if isinstance(method, str) else tuple(method)
    levels = None if noise is None else [quantity(one, "m", "noise") if one else 0.0 for one in _many(noise)]
    if levels is not None and min(levels, default=-1.0) < 0:
        raise InputProblem("noise", "holds a level below 0, or none", "give such as ('0.5 um', '1 um')")
    for name, number in (("repeats", repeats), ("workers", workers), *(("tests", one) for one in tests or ())):
        if number < 1:
            raise InputProblem(name, f"{number} is below 1", "give a number above 0")
    _check_methods(asked)
    with working(progress) as watch:
        order = Order(name_of(data), levels is not None, seed, effects_of(effects).folders)
        return _scored(Sealed(order), levels, repeats, tests, (asked, workers), watch)


def _many(given: Quantity | Sequence[Quantity]) -> Sequence[Quantity]:
    return [given] if isinstance(given, (str, float, int)) else list(given)


def _scored(sealed: Sealed, noise: Sequence[float] | None, repeats: int, tests: Sequence[int] | None,
            who: tuple[tuple[str, ...], int], watch: Watch) -> Score:
    from testbed.analysis.multipliers.score import cases, costs, study_scores

    (methods, workers), place = who, sealed.order.data
    methods = tuple(dict.fromkeys(methods or ("waveform" if sealed.truth.planar else "multipliers",)))
    if {"multipliers", "published"} & set(methods):
        refuse_planar(sealed.truth, place, ONE_MODE)
    groups = sealed.groups
    levels = sorted(groups) if noise is None else \
        list(dict.fromkeys(max(one, min(groups)) if one == 0 else one for one in noise))
    how_often = _repeats(sealed, levels, repeats if noise is not None else None)
    planned = cases(methods, _counts(sealed, tests), how_often)
    outcomes = {}
    with watch.counted("identifying") as show:
        for case, outcome in zip(planned, study(sealed, planned, workers), strict=True):
            outcomes[case] = outcome
            show(len(outcomes), len(planned))
    scores = study_scores(outcomes, sealed.truth, sealed.parameters)
    return Score(methods, tuple(scores), tuple(costs(outcomes)), {one.parameter: one.truth for one in scores}, place,
                 sealed.order.seed)


def _check_methods(methods: Sequence[str]) -> None:
    """InputProblem for a method that is not to be had."""
    from testbed.units import nearest

    for name in methods:
        if name.endswith(".py"):
            load_method(Path(name))
        elif name not in METHODS:
            close = nearest(name, METHODS)
            raise InputProblem("method", f"'{name}' is not known",
                               f"did you mean {close}?" if close else f"give {', '.join(METHODS)} or a FILE.py")


def _counts(sealed: Sealed, tests: Sequence[int] | None) -> list[int]:
    if tests is None:
        return [sealed.tests]
    if max(tests) > sealed.tests:
        raise InputProblem(sealed.order.data, f"holds {sealed.tests} tests, not {max(tests)}", "ask for fewer tests")
    return list(dict.fromkeys(tests))


def _repeats(sealed: Sealed, levels: Sequence[float], repeats: int | None) -> dict[float, int]:
    """How often each level is identified; InputProblem for a level below the noise that is already there."""
    groups, data = sealed.groups, sealed.order.data
    if repeats is None:
        return {one: len(groups[one]) for one in levels}
    if not sealed.displaced:
        raise InputProblem(data, "holds no displacement, to which noise could be added", "score it at its own noise")
    quietest = min(groups)
    low = [one for one in levels if one < quietest]
    if low:
        raise InputProblem(data, f"already has {quietest * 1e6:g} um of noise; {low[0] * 1e6:g} um is less",
                           "run the scenario with less noise, or ask for more")
    # Where no noise is added there are only as many different campaigns as the data set holds.
    return {one: len(groups[quietest]) if one == quietest else repeats for one in levels}


def unit_of(path: str) -> str:
    """The SI unit of a parameter of the machine."""
    return BASE_UNITS[base_parameter(path) or ""]


def level(noise: float) -> str:
    """A level of noise (m) in words."""
    return f"{noise * 1e6:g} um"


def score_rows(scores: Sequence[ParameterScore], by_method: bool, by_tests: bool
               ) -> tuple[tuple[str, ...], list[tuple[str, ...]]]:  # fmt: skip
    """Titles and rows of a table for people; method and number of tests stand in it where that is asked."""
    titles = ("parameter", *("method",) * by_method, *("tests",) * by_tests, "noise", "truth", "bias", "spread", "rms",
              "coverage", "failed")
    rows = []
    for one in scores:
        unit = unit_of(one.parameter)
        rows.append((one.parameter, *(one.method,) * by_method, *(str(one.tests),) * by_tests, level(one.noise),
                     *(shown(value, unit, 4, one.parameter) for value in (one.truth, one.bias, one.spread, one.rms)),
                     "-" if math.isnan(one.coverage) else f"{one.coverage:.0%}", f"{one.failures} of {one.count}"))
    return titles, rows
