"""How the pictures look: a journal's column widths, small type, few colours that differ in grey too."""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

COLUMN, PAGE = 3.4, 6.9  # inches: one column of the journal, two
BLUE, ORANGE, GREEN, RED, GREY, PURPLE = "#1f5fa8", "#d9822b", "#2f8f5b", "#b8322a", "#7a7a7a", "#7b4fa3"
OUTCOME_COLOURS = {"stable": GREEN, "neimark_sacker": BLUE, "flip": ORANGE, "saddle_node": PURPLE, "borderline": GREY}
_RC: Any = {"font.size": 8.0, "axes.titlesize": 8.0, "axes.labelsize": 8.0, "xtick.labelsize": 7.0, "ytick.labelsize": 7.0,
       "legend.fontsize": 7.0, "legend.frameon": False, "axes.linewidth": 0.6, "lines.linewidth": 0.9,
       "lines.markersize": 3.0, "xtick.major.width": 0.6, "ytick.major.width": 0.6, "axes.spines.top": False,
       "axes.spines.right": False, "savefig.dpi": 220, "svg.hashsalt": "paper", "svg.fonttype": "none",
       "mathtext.fontset": "dejavusans", "figure.constrained_layout.h_pad": 0.04, "figure.constrained_layout.w_pad": 0.04}


@contextmanager
def journal() -> Iterator[None]:
    """Everything drawn and saved inside looks alike."""
    import matplotlib

    with matplotlib.rc_context(_RC):
        yield


def figure(width: float = PAGE, height: float = 2.4) -> Any:
    """An empty figure that needs no screen."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    drawn = Figure(figsize=(width, height), layout="constrained")
    FigureCanvasAgg(drawn)
    return drawn


def letter(axes: Any, name: str, title: str = "") -> None:
    """(a) at the head of a panel, and its title."""
    axes.set_title(f"({name}) {title}".rstrip(), loc="left")


def unit_circle(axes: Any) -> None:
    """The stability limit in the plane of multipliers."""
    angle = np.linspace(0.0, 2.0 * math.pi, 361)
    axes.plot(np.cos(angle), np.sin(angle), color="black", lw=0.7)
    axes.axhline(0.0, color="0.85", lw=0.5, zorder=0)
    axes.axvline(0.0, color="0.85", lw=0.5, zorder=0)
    axes.set_aspect("equal", adjustable="box")
    axes.set_xlabel(r"Re $\mu$")
    axes.set_ylabel(r"Im $\mu$")


def save(drawn: Any, folder: Path, stem: str) -> None:
    """STEM.png and STEM.svg, the same bytes for the same figure."""
    from testbed.system.atomic import replacing

    for ending, extra in (("png", {"Software": None}), ("svg", {"Date": None})):
        with replacing(folder / f"{stem}.{ending}") as temporary:
            drawn.savefig(temporary, format=ending, metadata=extra)


def rpm(speed: float) -> float:
    """Revolutions a minute of rad/s."""
    return speed * 30.0 / math.pi


def shown(value: complex, digits: int = 4) -> str:
    """A multiplier; of a pair the two at once."""
    if abs(value.imag) < 1e-9:
        return f"{value.real:+.{digits}f}"
    return f"{value.real:+.{digits}f} ± {abs(value.imag):.{digits}f}i"
