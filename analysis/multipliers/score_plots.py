"""Pictures of a study of identification under noise: errors and coverage over noise and number of tests, failures, cost."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import PurePath
from typing import TYPE_CHECKING, Any

import numpy as np

from testbed.analysis.multipliers.score import Cost, ParameterScore, binomial_interval

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_COLOURS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#56b4e9", "#e69f00")
_MARKERS = ("o", "s", "^", "D", "v", "P")
MOST_BESIDE = 4  # parameters beside each other
_TITLES = {"natural_frequency": "natural frequency", "damping_ratio": "damping ratio",
           "tangential_coefficient": "tangential coefficient"}


def figures(scores: Sequence[ParameterScore], spent: Sequence[Cost]) -> dict[str, Figure]:
    """name -> figure: `score_noise`; `score_tests` where there is more than one number of tests; `score_cost`."""
    found = {}
    tests = sorted({one.tests for one in scores})
    most = [one for one in scores if one.tests == tests[-1]]
    found["score_noise"] = _errors(most, "noise", f"{tests[-1]} tests")
    if len(tests) > 1:
        levels = sorted({one.noise for one in scores})
        level = levels[len(levels) // 2]
        found["score_tests"] = _errors([one for one in scores if one.noise == level], "tests", f"{level * 1e6:g} um of noise")
    found["score_cost"] = _cost(scores, spent)
    return found


def _places(values: Sequence[float], over: str) -> tuple[list[float], list[str]]:
    """Levels stand at equal distances: 0 has no place on a logarithmic axis."""
    levels = sorted(set(values))
    return levels, [f"{level * 1e6:g}" if over == "noise" else f"{level:g}" for level in levels]


def _new(rows: int, columns: int, height: float) -> tuple[Figure, Any]:
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(3.3 * columns + 0.6, height), layout="constrained")
    FigureCanvasAgg(figure)
    return figure, figure.subplots(rows, columns, squeeze=False, sharex="col")


def _errors(scores: Sequence[ParameterScore], over: str, title: str) -> Figure:
    """Rms error and spread in per cent of the truth above, coverage below; a column a parameter, a colour a method."""
    parameters = list(dict.fromkeys(one.parameter for one in scores))
    wide = min(len(parameters), MOST_BESIDE)
    methods = list(dict.fromkeys(one.method for one in scores))
    levels, labels = _places([getattr(one, over) for one in scores], over)
    tall = math.ceil(len(parameters) / wide)
    figure, axes = _new(2 * tall, wide, 5.2 * tall)
    for place in range(len(parameters), tall * wide):
        axes[2 * (place // wide), place % wide].remove()
        axes[2 * (place // wide) + 1, place % wide].remove()
    bounds = [binomial_interval(one.coverage, one.count - one.failures)[0] for one in scores]
    lowest = 10 * math.floor(10 * min([0.8, *(bound for bound in bounds if math.isfinite(bound))])) - 4
    for column, parameter in enumerate(parameters):
        above, below = axes[2 * (column // wide):2 * (column // wide) + 2, column % wide]
        turned = parameter.endswith("direction")  # of an angle about 0 no share can be told
        above.set_title(_TITLES.get(parameter, parameter) + (" (% of 1 rad)" if turned else ""), fontsize=10)
        for rank, method in enumerate(methods):
            rows = {getattr(one, over): one for one in scores if (one.parameter, one.method) == (parameter, method)}
            at = [k for k, level in enumerate(levels) if level in rows]
            here = [rows[levels[k]] for k in at]
            shift = 0.12 * (rank - 0.5 * (len(methods) - 1))
            places = np.array(at) + shift
            style: dict[str, Any] = {"color": _COLOURS[rank % 6], "marker": _MARKERS[rank % 6], "ms": 5}
            size = [1.0 if turned else abs(one.truth) for one in here]
            rms, bias = ([100 * abs(getattr(one, name)) / each for one, each in zip(here, size, strict=True)]
                         for name in ("rms", "bias"))
            above.plot(places, rms, lw=1.4, label=PurePath(method).name, **style)
            above.plot(places, bias, lw=0.9, ls=":", mfc="none",
                       color=style["color"], marker=style["marker"], ms=3.5)
            _coverage(below, places, here, style)
        above.set_yscale("log")
        above.grid(True, axis="y", color="0.9", lw=0.6)
        below.axhline(95, color="black", lw=0.9)
        below.set(ylim=(lowest, 104), xticks=range(len(levels)))
        below.set_xlabel("noise rms (um)" if over == "noise" else "number of tests")
        below.set_xticklabels(labels)
        below.set_xlim(-0.5, len(levels) - 0.5)
        below.grid(True, axis="y", color="0.9", lw=0.6)
    axes[0, 0].set_ylabel("error (% of the truth)")
    axes[1, 0].set_ylabel("95 % intervals that hold\nthe truth (%)")
    _legend(figure, axes[0, 0], title)
    return figure


def _coverage(axes: Any, places: np.ndarray, here: Sequence[ParameterScore], style: dict[str, Any]) -> None:
    share = np.array([one.coverage for one in here])
    bounds = np.array([binomial_interval(one.coverage, one.count - one.failures) for one in here]).reshape(-1, 2)
    given = np.isfinite(share)
    if given.any():
        reach = np.clip(np.abs(bounds[given] - share[given, None]).T, 0, 1)
        axes.errorbar(places[given], 100 * share[given], 100 * reach, ls="none", lw=1.0, capsize=2, **style)


def _legend(figure: Figure, axes: Any, title: str) -> None:
    from matplotlib.lines import Line2D

    handles, labels = axes.get_legend_handles_labels()
    handles += [Line2D([], [], color="0.3", lw=1.4), Line2D([], [], color="0.3", lw=0.9, ls=":")]
    figure.legend(handles, [*labels, "rms error", "|bias|"], loc="outside upper center", ncols=len(handles), fontsize=9,
                  title=title, title_fontsize=9, frameon=False)


def _cost(scores: Sequence[ParameterScore], spent: Sequence[Cost]) -> Figure:
    """Failures in per cent, and processor time of one identification, over noise; a line a method and number of tests."""
    from matplotlib.lines import Line2D
    from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

    figure, axes = _new(1, 2, 3.6)
    figure.set_figwidth(9.0)
    failed, price = axes[0]
    levels, labels = _places([one.noise for one in spent], "noise")
    kinds = list(dict.fromkeys((one.method, one.tests) for one in spent))
    methods, tests = list(dict.fromkeys(method for method, _ in kinds)), sorted({count for _, count in kinds})
    for rank, (method, count) in enumerate(kinds):
        colour = _COLOURS[methods.index(method) % 6]
        style: dict[str, Any] = {"color": colour, "marker": _MARKERS[tests.index(count) % 6], "ms": 5, "lw": 1.2}
        shift = 0.06 * (rank - 0.5 * (len(kinds) - 1))
        rows = {one.noise: one for one in scores if (one.method, one.tests) == (method, count)}
        share = [100 * rows[level].failures / rows[level].count if level in rows else math.nan for level in levels]
        failed.plot(np.arange(len(levels)) + shift, share, **style)
        prices = {one.noise: one for one in spent if (one.method, one.tests) == (method, count)}
        median = [max(prices[level].median, 1e-4) if level in prices else math.nan for level in levels]
        price.plot(np.arange(len(levels)) + shift, median, **style)
    failed.set(ylabel="identifications that failed (%)", ylim=(-4, 104))
    price.set(ylabel="processor time of one (s)", yscale="log")
    price.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    price.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    price.yaxis.set_minor_formatter(NullFormatter())
    for each in (failed, price):
        each.set(xlabel="noise rms (um)", xticks=range(len(levels)), xlim=(-0.5, len(levels) - 0.5))
        each.set_xticklabels(labels)
        each.grid(True, axis="y", color="0.9", lw=0.6)
    handles = [Line2D([], [], color=_COLOURS[rank % 6], lw=2.5, label=PurePath(method).name)
               for rank, method in enumerate(methods)]
    handles += [Line2D([], [], color="0.3", marker=_MARKERS[rank % 6], ls="none", label=f"{count} tests")
                for rank, count in enumerate(tests)]
    figure.legend(handles=handles, loc="outside upper center", ncols=min(7, len(handles)), fontsize=9, frameon=False)
    return figure
