"""Pictures of the delay analysis: stability chart, multipliers in the complex plane, once-per-period samples.

matplotlib is imported when a picture is drawn, without a display. `save` writes PNG and SVG beside each other.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from testbed.analysis.linear.labels import label
from testbed.analysis.linear.stability import CLASSES, FEED_ONLY, StabilityChart, said_class

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_COLOURS = {"stable": "#ffffff", "neimark_sacker": "#9ecae1", "flip": "#fdae6b", "saddle_node": "#c7a0d9"}
SPECK = 0.015  # of the axes: a line that is shorter either way is a speck
_MARKERS = {"stable": "o", "neimark_sacker": "^", "flip": "s", "saddle_node": "D"}


@dataclass(frozen=True)
class ChartTest:
    """A test to overlay on a chart: spindle_speed (rad/s), axial_depth_of_cut (m), its class as found, a label."""

    spindle_speed: float
    axial_depth_of_cut: float
    outcome: str
    label: str = ""


def _axes(width: float = 7.0, height: float = 4.5) -> tuple[Figure, Axes]:
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width, height), layout="constrained")
    FigureCanvasAgg(figure)
    return figure, figure.subplots()


def save(figure: Figure, path: Path | str) -> list[Path]:
    """Write `path` with the endings .png and .svg; returns both paths. The folder is made if it is missing."""
    stem = Path(path)
    stem = stem.with_suffix("") if stem.suffix in (".png", ".svg") else stem
    stem.parent.mkdir(parents=True, exist_ok=True)
    written = [stem.parent / f"{stem.name}{ending}" for ending in (".png", ".svg")]
    for target in written:
        figure.savefig(target, dpi=150)
    return written


def _edges(middles: np.ndarray) -> np.ndarray:
    """Edges (n + 1,) of cells about their middles (n,)."""
    if middles.size < 2:
        return middles[0] * np.array([0.99, 1.01])
    between = 0.5 * (middles[1:] + middles[:-1])
    return np.concatenate([[2.0 * middles[0] - between[0]], between, [2.0 * middles[-1] - between[-1]]])


def _legend_beside(axes: Axes, handles: Sequence[Artist]) -> None:
    """A legend to the right of the axes, where it hides nothing."""
    axes.legend(handles=list(handles), loc="upper left", bbox_to_anchor=(1.01, 1.0), borderaxespad=0.0, fontsize="small")


def _borders(axes: Axes, speed: np.ndarray, depth: np.ndarray, radius: np.ndarray) -> list[np.ndarray]:
    """Draw the lines at which the modulus is 1; returns them. Specks are left out: where a gap between two lobes ends it is
    narrower than any cell, and falls to pieces that mean nothing."""
    from matplotlib.collections import LineCollection

    drawn = axes.contour(speed, depth, radius, levels=[1.0])
    drawn.remove()
    reach = SPECK * np.array([np.ptp(speed), np.ptp(depth)])
    lines = [line for line in drawn.allsegs[0] if len(line) and np.any(np.ptp(line, axis=0) > reach)]
    axes.add_collection(LineCollection(lines, colors="black", linewidths=1.2))
    return lines


def _hatch(axes: Axes, edges: tuple[np.ndarray, np.ndarray], blank: np.ndarray) -> None:
    """Hatch the cells (depths, speeds) marked in `blank`; a cell's fill may be see-through, its hatch must not be."""
    from matplotlib.collections import PolyCollection

    speed, depth = edges
    cells = [[(speed[j], depth[i]), (speed[j + 1], depth[i]), (speed[j + 1], depth[i + 1]), (speed[j], depth[i + 1])]
             for i, j in np.argwhere(blank)]
    axes.add_collection(PolyCollection(cells, facecolor="none", edgecolor="0.45", hatch="////", linewidths=0.0))


def plot_chart(chart: StabilityChart, tests: Sequence[ChartTest] = (), note: str = "", title: str = FEED_ONLY) -> Figure:
    """Stability over spindle speed (rpm) and depth (mm), coloured by the class of the instability, tests on top.

    note: a line of the legend on what the labels of the tests mean. title: what the chart leaves out.
    """
    from matplotlib.colors import BoundaryNorm, ListedColormap
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    figure, axes = _axes(9.0)
    speed, depth = chart.spindle_speeds * 30.0 / math.pi, chart.axial_depths * 1e3
    colours = ListedColormap([_COLOURS[name] for name in CLASSES])
    edges, blank = (_edges(speed), _edges(depth)), chart.classes < 0
    axes.pcolorfast(*edges, np.ma.masked_array(chart.classes, blank), cmap=colours, norm=BoundaryNorm(np.arange(5) - 0.5, 4))
    borders = _borders(axes, speed, depth, chart.spectral_radius) if min(chart.classes.shape) > 1 else []
    places = np.array([(test.spindle_speed * 30.0 / math.pi, test.axial_depth_of_cut * 1e3) for test in tests])
    for test, place in zip(tests, places, strict=True):
        axes.plot(*place, _MARKERS.get(test.outcome, "x"), mfc="white", mec="black", ms=7, zorder=5)
    present = [name for index, name in enumerate(CLASSES) if np.any(chart.classes == index)]
    handles: list[Artist] = [Patch(fc=_COLOURS[name], ec="black", label=said_class(name)) for name in present]
    for outcome in sorted({test.outcome for test in tests}):
        handles.append(Line2D([], [], ls="", marker=_MARKERS.get(outcome, "x"), mfc="white", mec="black",
                              label=f"test: {said_class(outcome)}"))
    if blank.any():  # white as stable cells are, but hatched
        _hatch(axes, edges, blank)
        handles.append(Patch(fc="white", ec="0.6", hatch="///", label="blank: not known"))
    if note:
        handles.append(Line2D([], [], ls="", label=note))
    _legend_beside(axes, handles)
    axes.set_xlabel("spindle speed (rpm)")
    axes.set_ylabel("axial depth of cut (mm)")
    axes.set_title(title, fontsize="small", loc="left")
    label(axes, [test.label for test in tests], places, np.concatenate([np.empty((0, 2)), *borders]))
    return figure


def plot_multipliers(tests: Mapping[str, tuple[np.ndarray, np.ndarray]]) -> Figure:
    """(measured, model) multipliers of every test, by its name, in the complex plane with the unit circle.

    The colour tells the test; measured is an open circle, the model a cross.
    """
    from matplotlib.lines import Line2D

    figure, axes = _axes(7.0, 5.0)
    angle = np.linspace(0.0, 2.0 * math.pi, 400)
    axes.plot(np.cos(angle), np.sin(angle), color="black", lw=1.0)
    axes.axhline(0.0, color="0.8", lw=0.8, zorder=0)
    axes.axvline(0.0, color="0.8", lw=0.8, zorder=0)
    kinds = (("measured", "o", 9.0), ("model", "x", 7.0))
    handles: list[Artist] = [Line2D([], [], ls="", marker=marker, color="black", mfc="none", ms=size, label=kind)
                             for kind, marker, size in kinds]
    for number, (name, pair) in enumerate(tests.items()):
        colour = f"C{number % 10}"
        handles.append(Line2D([], [], color=colour, lw=4.0, label=name))
        for values, (_, marker, size) in zip(pair, kinds, strict=True):
            values = np.asarray(values, dtype=complex)
            axes.plot(values.real, values.imag, marker, color=colour, ms=size, mfc="none")
    every = [1.0, *(float(np.abs(values).max()) for pair in tests.values() for values in pair if len(values))]
    reach = 1.1 * max(every)
    axes.set(xlim=(-reach, reach), ylim=(-reach, reach))
    axes.set_aspect("equal", adjustable="box")
    axes.set_xlabel("Re $\\mu$")
    axes.set_ylabel("Im $\\mu$")
    _legend_beside(axes, handles)
    return figure


def plot_once_per_period(times: np.ndarray, displacement: np.ndarray, sample_times: np.ndarray,
                         samples: np.ndarray) -> Figure:
    """A displacement (m) over time (s) with its once-per-tooth samples, in micrometres."""
    figure, axes = _axes()
    axes.plot(times, np.asarray(displacement) * 1e6, color="0.6", lw=0.7, label="displacement")
    axes.plot(sample_times, np.asarray(samples) * 1e6, "o", ms=4, color="tab:red", label="once per tooth")
    axes.set_xlabel("time (s)")
    axes.set_ylabel("displacement (um)")
    axes.legend(loc="upper right", fontsize="small")
    return figure
