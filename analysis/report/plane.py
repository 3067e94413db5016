"""A picture of a model in the x-y plane: feed, angles, forces, teeth, modes, and what sensors see.

    tooth at n = -(sin theta, cos theta), theta growing with the spindle's turn; x the feed of the workpiece, y its normal
    force on the workpiece: F_t along the tooth's motion, F_n along n, away from the cutter
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from testbed.machine import Cutter, Cutting, Mode, Model

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_WORK, _TOOL, _FORCE = "#9e6b2f", "#1f5a8a", "#b3261e"
_CARRIER = {"workpiece": _WORK, "tool": _TOOL}


def outward(theta: float | np.ndarray) -> np.ndarray:
    """Unit vector from the cutter's axis to a tooth at `theta` (rad); (2,) or (2, n)."""
    return -np.array([np.sin(theta), np.cos(theta)])


def along_motion(theta: float) -> np.ndarray:
    """Unit vector along which a tooth at `theta` (rad) moves."""
    return np.array([-math.cos(theta), math.sin(theta)])


def plot_plane(model: Model) -> Figure:
    """The cut and the modes side by side. ValueError where the model cuts nothing."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    if model.cutter is None or model.cutting is None:
        raise ValueError("the model has no cutter: there is no plane of a cut")
    figure = Figure(figsize=(11.0, 5.2), layout="constrained")
    FigureCanvasAgg(figure)
    cut, modes = figure.subplots(1, 2)
    _draw_cut(cut, model.cutter, model.cutting)
    _draw_modes(modes, model.structure.modes)
    for axes, reach in ((cut, 1.75), (modes, 1.45)):
        axes.set(xlim=(-reach, reach), ylim=(-reach, reach), aspect="equal")
        axes.axis("off")
    return figure


def _arrow(axes: Axes, start: Any, step: Any, colour: str, text: str = "", both: bool = False) -> None:
    """An arrow from `start` by `step`, with a text at its head."""
    start, step = np.asarray(start, float), np.asarray(step, float)
    axes.annotate("", start + step, start, arrowprops={"arrowstyle": "<|-|>" if both else "-|>", "color": colour, "lw": 1.8,
                                                       "shrinkA": 0.0, "shrinkB": 0.0})
    if text:
        _label(axes, start + step + 0.12 * step / np.hypot(*step), text, color=colour)


def _label(axes: Axes, place: np.ndarray, text: str, **style: Any) -> Any:
    """A text about a place."""
    return axes.text(float(place[0]), float(place[1]), text, ha="center", va="center", **style)


def _draw_cut(axes: Axes, cutter: Cutter, cutting: Cutting) -> None:
    """Workpiece, cutter, teeth, the angle and the forces, for a cutter of radius 1."""
    from matplotlib.patches import Circle, Rectangle

    entry, exit_ = cutting.entry_angle, cutting.entry_angle + cutting.engagement_angle
    edges = sorted(float(-math.cos(angle)) for angle in (entry, exit_))
    axes.add_patch(Rectangle((-1.7, edges[0]), 1.7, edges[1] - edges[0], fc="#ead9c3", ec="none", zorder=0))
    axes.add_patch(Circle((0.0, 0.0), 1.0, fc="white", ec=_TOOL, lw=1.5, zorder=1))
    arc = outward(np.linspace(entry, exit_, 90))
    axes.plot(*arc, color=_FORCE, lw=4.0, solid_capstyle="butt", zorder=2)
    for angle, said in ((entry, "entry"), (exit_, "exit")):
        _label(axes, 0.83 * outward(angle), f"{said}\n{math.degrees(angle):.3g}°", fontsize="x-small", zorder=4)
    theta = 0.5 * (entry + exit_)
    _draw_teeth(axes, cutter, theta)
    tooth = outward(theta)
    _arrow(axes, tooth, 0.55 * along_motion(theta), _FORCE, "$F_t$")
    _arrow(axes, tooth, 0.35 * tooth, _FORCE, "$F_n$")
    axes.plot([0.0, 0.0], [0.0, -1.0], color="0.6", lw=0.8, ls=":", zorder=2)
    axes.plot(*(0.38 * outward(np.linspace(0.0, theta, 60))), color="0.3", lw=1.0, zorder=3)
    _label(axes, 0.5 * outward(0.5 * theta), r"$\theta$", color="0.3")
    _arrow(axes, (-1.7, edges[1] + 0.15), (0.4, 0.0), _WORK)
    axes.text(-1.7, edges[1] + 0.25, "feed", color=_WORK)
    _arrow(axes, (1.1, -1.55), (0.4, 0.0), "black", "x")
    _arrow(axes, (1.1, -1.55), (0.0, 0.4), "black", "y")
    axes.text(-1.65, 0.5 * sum(edges), "workpiece", color=_WORK, ha="left", va="center", fontsize="small")
    axes.set_title(f"{cutting.direction}, {cutter.flutes} flute{'s' * (cutter.flutes > 1)}: forces on the workpiece")


def _draw_teeth(axes: Axes, cutter: Cutter, theta: float) -> None:
    """The teeth, the first at `theta`, and the angles between them where they are few; the turn's sense."""
    angle = theta
    for number, pitch in enumerate((0.0, *cutter.pitches[1:])):
        angle -= pitch
        axes.plot(*np.outer(outward(angle), (0.72, 1.0)), color=_TOOL, lw=3.0, zorder=3)
        if cutter.flutes <= 8:
            _label(axes, 0.64 * outward(angle), str(number), color=_TOOL, fontsize="small")
        if cutter.pitch_angles and cutter.flutes <= 8 and number:
            _label(axes, 0.82 * outward(angle + 0.5 * pitch), f"{math.degrees(pitch):.4g}°", color=_TOOL, fontsize="x-small")
    turn = 0.25 * outward(np.linspace(2.4, 4.6, 40))
    axes.plot(*turn, color=_TOOL, lw=1.2)
    _arrow(axes, turn[:, -1], 0.02 * along_motion(4.6), _TOOL)


def _draw_modes(axes: Axes, modes: tuple[Mode, ...]) -> None:
    """The direction of every mode, longer ones for lower frequencies so that none hides another."""
    order = sorted(modes, key=lambda mode: mode.natural_frequency)
    for place, mode in enumerate(order):
        reach = 1.05 - 0.55 * place / max(1, len(order) - 1)
        shape = np.array(mode.shape)
        _arrow(axes, -reach * shape, 2.0 * reach * shape, _CARRIER[mode.on], both=True)
        text = _label(axes, (reach + 0.16) * shape, f"{mode.natural_frequency:.5g} Hz", color=_CARRIER[mode.on],
                      fontsize="small")
        text.set_bbox({"fc": "white", "ec": "none", "alpha": 0.8, "pad": 0.5})
    for place, (carrier, sees) in enumerate((("workpiece", "sees +$\\Sigma\\, e_j q_j$ of its modes"),
                                             ("tool", "sees $-\\Sigma\\, e_j q_j$ of its modes"))):
        axes.text(-1.4, -1.3 - 0.12 * place, f"modes of the {carrier}; a sensor on it {sees}", color=_CARRIER[carrier],
                  fontsize="small")
    axes.set_title("modes: $r = \\Sigma\\, e_j q_j$, the workpiece against the tool")
