"""Once-per-tooth samples of several tests: over the teeth, and each against the one before."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from testbed.analysis.multipliers.verdict import WINDOW

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def plot_samples(tests: Mapping[str, np.ndarray]) -> Figure:
    """A column a test, by its title; samples (teeth,) in m. Below: the last window, y_n+1 over y_n."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(2.5 * len(tests) + 0.5, 5.0), layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.subplots(2, len(tests), squeeze=False)
    for column, (title, samples) in enumerate(tests.items()):
        microns = np.asarray(samples) * 1e6
        last = microns[-WINDOW:]
        axes[0, column].plot(microns, ".", ms=3)
        axes[0, column].set_title(title, fontsize="medium")
        axes[0, column].set_xlabel("tooth")
        axes[1, column].plot(last[:-1], last[1:], ".", ms=4, color="tab:red")
        middle, half = 0.5 * (last.max() + last.min()), max(0.6 * np.ptp(last), 10.0)  # 0.5 um of noise is a point
        for limits in (axes[1, column].set_xlim, axes[1, column].set_ylim):
            limits(middle - half, middle + half)
        axes[1, column].set_box_aspect(1)
        axes[1, column].set_xlabel("$y_n$ (um)")
    axes[0, 0].set_ylabel("once-per-tooth sample (um)")
    axes[1, 0].set_ylabel("$y_{n+1}$ (um)")
    return figure
