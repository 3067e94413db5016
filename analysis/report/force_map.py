"""The force-state map: a force that nobody modelled, over displacement and velocity."""

from __future__ import annotations

import numpy as np

from testbed.analysis.comparison.residual_views import CALIBRATED, MapUnits, map_holds
from testbed.analysis.report.packed import listed
from testbed.analysis.report.page import Page, Panel


def add_force_map(
    page: Page,
    name: str,
    x: np.ndarray,
    v: np.ndarray,
    force: np.ndarray,
    says: str = "",
    shown: MapUnits = CALIBRATED,
) -> None:
    """The force-state map: a force nobody modelled (N, (n,)) over displacement x (m) and velocity v (m/s), (n,) each.

    shown: factor and unit in which displacement, velocity and force are drawn.
    """
    page.heading(f"What does the missing force depend on: displacement or velocity? ({name})")
    page.answer(says or force_map_says(x, v, force))
    if map_holds(name):
        page.text(f"{name}: {map_holds(name)}.", small=True)
    some = np.linspace(0, len(x) - 1, min(len(x), 6000)).astype(int)
    reach = float(np.percentile(np.abs(force), 99)) or 1.0
    across, up, colour = shown
    traces = [
        {
            "type": "scatter",
            "mode": "markers",
            "x": listed(x[some] * across[0], 4),
            "y": listed(v[some] * up[0], 4),
            "text": [f"{value:.3g} {colour[1]}" for value in force[some]],
            "hoverinfo": "text",
            "showlegend": False,
            "marker": {
                "size": 5,
                "color": listed(force[some], 4),
                "cmin": -reach,
                "cmax": reach,
                "colorscale": [[0, "#3b82c4"], [0.5, "#cccccc"], [1, "#d1495b"]],
                "colorbar": {"title": {"text": colour[1]}, "thickness": 10},
            },
        }
    ]
    page.figure(
        Panel(
            traces,
            {
                "height": 420,
                "xaxis": {"title": {"text": f"displacement [{across[1]}]"}},
                "yaxis": {"title": {"text": f"velocity [{up[1]}]"}},
            },
        ),
        "force-state map",
    )


def force_map_says(x: np.ndarray, v: np.ndarray, force: np.ndarray, cells: int = 12) -> str:
    """What share of the force a function of displacement alone, of velocity alone, and of both explains."""

    def explained(*sides: np.ndarray) -> float:
        place = np.zeros(len(force), dtype=int)
        for side in sides:
            edges = np.quantile(side, np.linspace(0, 1, cells + 1)[1:-1])
            place = place * cells + np.searchsorted(edges, side)
        count = np.bincount(place)
        mean = np.bincount(place, force) / np.maximum(count, 1)
        freedom = max(len(force) - int(np.count_nonzero(count)), 1)
        left = float(np.sum((force - mean[place]) ** 2)) / freedom
        return 1.0 - left / max(float(force.var(ddof=1)), 1e-300)

    by_x, by_v, both = explained(x), explained(v), explained(x, v)
    first = "displacement" if by_x >= by_v else "velocity"
    return (
        f"Of the force's variance displacement alone explains {max(by_x, 0):.0%}, velocity alone {max(by_v, 0):.0%}, "
        f"both together {max(both, 0):.0%}: "
        + (f"it goes with {first}." if max(by_x, by_v, both) > 0.2 else "it goes with neither.")
    )
