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

from analysis.stability import CLASSES, StabilityChart

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_COLOURS = {"stable": "#ffffff", "neimark_sacker": "#9ecae1", "flip": "#fdae6b", "saddle_node": "#c7a0d9"}
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


def plot_chart(chart: StabilityChart, tests: Sequence[ChartTest] = ()) -> Figure:
    """Stability over spindle speed (rpm) and depth (mm), coloured by the class of the instability, tests on top."""
    from matplotlib.colors import BoundaryNorm, ListedColormap
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    figure, axes = _axes()
    speed, depth = chart.spindle_speeds * 30.0 / math.pi, chart.axial_depths * 1e3
    colours = ListedColormap([_COLOURS[name] for name in CLASSES])
    axes.pcolormesh(speed, depth, chart.classes, cmap=colours, norm=BoundaryNorm(np.arange(5) - 0.5, 4),
                    shading="nearest", rasterized=True)
    if min(chart.classes.shape) > 1:
        axes.contour(speed, depth, chart.spectral_radius, levels=[1.0], colors="black", linewidths=1.2)
    for test in tests:
        place = (test.spindle_speed * 30.0 / math.pi, test.axial_depth_of_cut * 1e3)
        axes.plot(*place, _MARKERS.get(test.outcome, "x"), mfc="white", mec="black", ms=7, zorder=5)
        if test.label:
            axes.annotate(test.label, place, textcoords="offset points", xytext=(6, 4))
    present = [name for index, name in enumerate(CLASSES) if np.any(chart.classes == index)]
    handles: list[Patch | Line2D] = [Patch(fc=_COLOURS[name], ec="black", label=name.replace("_", " "))
                                     for name in present]
    for outcome in sorted({test.outcome for test in tests}):
        handles.append(Line2D([], [], ls="", marker=_MARKERS.get(outcome, "x"), mfc="white", mec="black",
                              label=f"test: {outcome.replace('_', ' ')}"))
    axes.legend(handles=handles, loc="upper right", fontsize="small")
    axes.set_xlabel("spindle speed (rpm)")
    axes.set_ylabel("axial depth of cut (mm)")
    return figure


def plot_multipliers(sets: Mapping[str, np.ndarray]) -> Figure:
    """Sets of multipliers, by name, in the complex plane with the unit circle."""
    figure, axes = _axes(5.0, 5.0)
    angle = np.linspace(0.0, 2.0 * math.pi, 400)
    axes.plot(np.cos(angle), np.sin(angle), color="black", lw=1.0)
    axes.axhline(0.0, color="0.8", lw=0.8, zorder=0)
    axes.axvline(0.0, color="0.8", lw=0.8, zorder=0)
    for marker, (name, values) in zip("ox+sd^v*" * (1 + len(sets) // 8), sets.items(), strict=False):
        values = np.asarray(values, dtype=complex)
        axes.plot(values.real, values.imag, marker, label=name, ms=8, mfc="none")
    reach = 1.1 * max([1.0, *(float(np.abs(values).max()) for values in sets.values() if len(values))])
    axes.set(xlim=(-reach, reach), ylim=(-reach, reach))
    axes.set_aspect("equal", adjustable="box")
    axes.set_xlabel("Re $\\mu$")
    axes.set_ylabel("Im $\\mu$")
    axes.legend(fontsize="small")
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
