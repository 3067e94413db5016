"""The misfit drawn on the stability chart of the fitted machine."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from scipy.special import stdtr

from testbed.analysis.comparison.residual_views import ChartView, on_chart
from testbed.analysis.fit.held_out import RecordError
from testbed.analysis.fit.observed import Observed
from testbed.analysis.linear.stability import feed_note
from testbed.analysis.report.packed import even, listed, packed
from testbed.analysis.report.page import Page, Panel
from testbed.machine import Model


def add_chart(page: Page, records: Sequence[Observed], errors: Sequence[RecordError], model: Model) -> None:
    """Misfit on the stability chart."""
    view = on_chart(records, errors, model)
    if view is None:
        return
    page.heading("Where on the stability chart is the misfit?")
    page.answer(_chart_says(view))
    chart = view.chart
    ratio = np.log10(np.clip(view.ratios, 0.9, 100.0))
    speed, depth = chart.spindle_speeds * 30 / math.pi, chart.axial_depths * 1e3
    traces = [
        {
            "type": "contour",
            "x": even(speed[0], speed[1] - speed[0], len(speed)),
            "y": even(depth[0], depth[1] - depth[0], len(depth)),
            "z": [packed(np.minimum(row, 3.0)) for row in chart.spectral_radius],
            "contours": {"type": "constraint", "operation": "<", "value": 1.0},
            "fillcolor": "rgba(139,111,192,.28)",
            "line": {"color": "#8b6fc0", "width": 1.5},
            "showlegend": False,
            "hoverinfo": "skip",
            "name": "unstable",
        },
        {
            "type": "scatter",
            "mode": "markers",
            "x": listed(view.speeds * 30 / math.pi),
            "y": listed(view.depths * 1e3),
            "text": [f"{name}<br>error / noise floor {value:.2f}" for name, value in zip(view.names, view.ratios, strict=True)],
            "hoverinfo": "text",
            "showlegend": False,
            "marker": {
                "size": 15,
                "color": listed(ratio),
                "cmin": 0,
                "cmax": max(1.0, float(ratio.max())),
                "line": {"color": "@ink", "width": 1.2},
                "colorscale": [[0, "#c4e8d0"], [0.35, "#faeeb4"], [0.7, "#f7be82"], [1, "#d1495b"]],
                "colorbar": {
                    "title": {"text": "error /<br>noise"},
                    "thickness": 10,
                    "tickvals": [0, 0.301, 0.699, 1, 1.301, 2],
                    "ticktext": ["1", "2", "5", "10", "20", "100"],
                },
            },
        },
    ]
    page.figure(
        Panel(
            traces,
            {
                "height": 400,
                "xaxis": {"title": {"text": "spindle speed [rpm]"}},
                "yaxis": {"title": {"text": "depth of cut [mm]"}, "rangemode": "tozero"},
            },
        ),
        "stability chart with the error of each cut",
    )
    limits = f"; {feed}" if (feed := feed_note(model)) else ""
    page.text(f"Violet: unstable by the fitted linear machine{limits}. A dot is a record; touch it for its figures.",
              small=True)


def _chart_says(view: ChartView) -> str:
    worst = int(np.argmax(view.ratios))
    if view.ratios[worst] < 1.05:
        return f"Nowhere: all {len(view.names)} cuts are predicted to within their noise."
    count = len(view.names)
    said = (
        f"The largest is at {view.speeds[worst] * 30 / math.pi:.0f} rpm and {view.depths[worst] * 1e3:.2g} mm "
        f"({view.names[worst]}): {view.ratios[worst]:.2f} times the noise floor."
    )
    if count >= 5:
        for values, name in ((view.depths, "depth"), (view.speeds, "spindle speed")):
            if np.ptp(values) > 0:
                correlation, chance = rank_correlation(values, view.ratios)
                if chance < 0.05:
                    way = "grows" if correlation > 0 else "falls"
                    said += f" It {way} with {name} (rank correlation {correlation:+.2f})."
    return said


def rank_correlation(one: np.ndarray, other: np.ndarray) -> tuple[float, float]:
    """Spearman's correlation of two series of at least three values, equal ones sharing their rank; and its p value by t."""
    ranks = []
    for values in (one, other):
        _, place, count = np.unique(values, return_inverse=True, return_counts=True)
        ranks.append((np.cumsum(count) - 0.5 * (count - 1))[place])
    found = min(max(float(np.corrcoef(ranks[0], ranks[1])[0, 1]), -1.0), 1.0)
    freedom = len(ranks[0]) - 2
    size = math.inf if abs(found) == 1.0 else abs(found) * math.sqrt(freedom / (1.0 - found**2))
    return found, float(2.0 * stdtr(freedom, -size))
