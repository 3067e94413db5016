"""The chance of stability over spindle speed and depth of cut, beside the limit of one machine."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from testbed.analysis.probable.chance import QUANTILES, Chance, Recommended

if TYPE_CHECKING:
    from matplotlib.figure import Figure

LEVELS = (0.0, 0.01, 0.05, 0.2, 0.5, 0.8, 0.95, 0.99, 1.0)
_COLOURS = ("#b2182b", "#d6604d", "#f4a582", "#fddbc7", "#d1e5f0", "#92c5de", "#4393c3", "#2166ac")


def plot_chance(chance: Chance, plain_limit: np.ndarray | None, best: Recommended | None, risk: float,
                before: tuple[np.ndarray, np.ndarray] | None = None) -> Figure:  # fmt: skip
    """The chance by colour; the limits of 5, 50 and 95 % of the machines, dashed; the plain limit (m), (S,), black; the cut
    recommended. A limit that no two neighbouring speeds have is no line. before: speeds (rad/s) and limits (m), each (T,), of
    the machine without what was added to it."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.colors import BoundaryNorm, ListedColormap
    from matplotlib.figure import Figure
    from matplotlib.patches import Patch

    figure = Figure(figsize=(9.0, 4.8), layout="constrained")
    FigureCanvasAgg(figure)
    axes: Any = figure.subplots()
    speed, depth = chance.spindle_speeds * 30.0 / math.pi, chance.axial_depths * 1e3
    colours = ListedColormap(_COLOURS)
    colours.set_bad("0.75")
    norm = BoundaryNorm(LEVELS, len(_COLOURS))
    shade = axes.pcolormesh(speed, depth, np.ma.masked_invalid(chance.probability), cmap=colours, norm=norm, shading="nearest",
                            rasterized=True)
    bar = figure.colorbar(shade, ax=axes, ticks=LEVELS, spacing="uniform")
    bar.ax.set_yticklabels([f"{100 * level:g} %" for level in LEVELS])
    bar.set_label("chance of a stable cut")
    for share, limit, dashes in zip(QUANTILES, chance.limits, (":", "--", "-."), strict=True):
        if _is_line(limit):
            label = f"limit, {100 * share:g} % quantile of the machines"
            axes.plot(speed, limit * 1e3, dashes, color="0.15", lw=1.0, label=label)
    if plain_limit is not None and _is_line(plain_limit):
        axes.plot(speed, plain_limit * 1e3, color="black", lw=1.8, label="limit of the machine in the middle")
    if before is not None:
        axes.plot(before[0] * 30.0 / math.pi, before[1] * 1e3, color="#8e2fb5", lw=1.8,
                  label="limit before the effect was added")
    if best is not None:
        axes.plot(best.spindle_speed * 30.0 / math.pi, best.axial_depth_of_cut * 1e3, "*", ms=14, mfc="#ffd92f", mec="black",
                  ls="", label=f"most removal at a risk of {100 * risk:g} %", zorder=5, clip_on=False)
    handles, _ = axes.get_legend_handles_labels()
    if np.isnan(chance.probability).any():
        handles.append(Patch(fc="0.75", ec="0.4", label="not known"))
    figure.legend(handles=handles, loc="outside lower center", ncols=3, fontsize="small", frameon=False)
    axes.set(xlabel="spindle speed (rpm)", ylabel="axial depth of cut (mm)")
    for limits, values in ((axes.set_xlim, speed), (axes.set_ylim, depth)):
        if values.size > 1:
            limits(values[0], values[-1])
    return figure


def _is_line(limit: np.ndarray) -> bool:
    """Whether two neighbouring speeds have a limit."""
    known = np.isfinite(limit)
    return bool(np.any(known[1:] & known[:-1]))
