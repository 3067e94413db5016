"""Pictures of the documentation, drawn by the program itself: `python docs/draw.py` writes docs/pictures/fit.svg again.

The gallery's pictures are drawn whenever the site is built (`docs/site.py`).
"""

from __future__ import annotations

import math
import re
from dataclasses import replace
from io import StringIO
from pathlib import Path

import matplotlib

matplotlib.use("svg")
matplotlib.rcParams["svg.hashsalt"] = "testbed"  # the same picture has the same bytes

import numpy as np  # noqa: E402
from matplotlib.figure import Figure  # noqa: E402

from testbed.analysis.fit.model_fit import model_fit  # noqa: E402
from testbed.analysis.fit.waveform import Fitter  # noqa: E402
from testbed.analysis.report.waveforms import looks, stretches, without_drift  # noqa: E402
from testbed.api.fitting import observed_records, plant_of  # noqa: E402
from testbed.catalogue import catalogue  # noqa: E402
from testbed.cli._fingerprint import fingerprint  # noqa: E402
from testbed.cut import Cut  # noqa: E402
from testbed.effect import Effect  # noqa: E402
from testbed.engines import fast  # noqa: E402
from testbed.machine import Cutter, Cutting, Model, Structure  # noqa: E402
from testbed.workshop import RPM, Measurement, measured_cut  # noqa: E402

MEASURED, BELIEVED, FITTED = "#444444", "#d1495b", "#3b82c4"
TRUE = Model(Structure(2.573, 146.4, 0.0034), Cutter(), Cutting("up-milling", 0.162, 5.5e8, 2.0e8))
BELIEF = {"natural_frequency": 147.6, "damping_ratio": 0.0045, "tangential_coefficient": 4.9e8, "normal_coefficient": 2.2e8}


def svg(figure: Figure) -> str:
    """Without a date, so that an equal picture is an equal text."""
    text = StringIO()
    figure.savefig(text, format="svg", metadata={"Date": None})
    return re.sub(r"\n(?=[LMCQz])", "", text.getvalue())  # paths on one line each


def effect_picture(effect: Effect) -> tuple[str, str]:
    """(SVG, what was cut): a test cut with the effect at its example values, and what it changes."""
    found = fingerprint(effect, catalogue())
    figure = Figure(figsize=(7, 3.2), layout="constrained")
    whole, change = figure.subplots(2, 1, sharex=True)
    whole.plot(found.time * 1e3, found.with_effect * 1e6, color=FITTED, lw=0.9)
    whole.set_ylabel("displacement\n(um)")
    change.plot(found.time * 1e3, found.change * 1e6, color=BELIEVED, lw=0.9)
    change.set_ylabel("change by\nthe effect (um)")
    change.set_xlabel("time (ms)")
    return svg(figure), found.story


def fit_picture() -> str:
    """One cut of a campaign as it was measured, as the believed and as the fitted machine predict it, and what they leave."""
    cuts = ((3810, 2.9e-3), (2850, 2.9e-3))
    how = Measurement(rate=6400.0)
    records = [measured_cut(fast.simulate, TRUE, Cut(rpm * RPM, depth, 1e-4, 12, 40, 20), how, number, f"{rpm} rpm")
               for number, (rpm, depth) in enumerate(cuts)]
    believed = TRUE.with_values(BELIEF)
    ready = observed_records(records, believed, "campaign", "model")
    fitter, fit = model_fit(plant_of({}), ready, believed, {})
    before = Fitter(fitter.plant, fitter.records, ()).fit(replace(fit.state, model=believed))  # nuisances alone are fitted
    look = looks(ready, {"displacement": "m"})[0]
    first, last = stretches(look.record)["entry"]
    time = (look.record.start + np.arange(first, last) / look.record.rate) * 1e3
    figure = Figure(figsize=(8, 4.6), layout="constrained")
    motion, left = figure.subplots(2, 1, sharex=True)
    measured = without_drift(look)
    motion.plot(time, measured[first:last], color=MEASURED, lw=2.4, label="measured")
    for name, colour, one in (("believed machine", BELIEVED, before), ("fitted machine", FITTED, fit)):
        rest = one.residuals[0].reshape(len(look.record.channels), -1)[look.row]
        predicted = measured - rest * look.record.scale[look.row] * look.factor
        motion.plot(time, predicted[first:last], color=colour, lw=0.9, label=name)
        said = f"{name}: {math.sqrt(float(np.mean(rest**2))):.3g} times the noise over the whole record"
        left.plot(time, rest[first:last], color=colour, lw=0.7, label=said)
    motion.set_ylabel(f"displacement ({look.unit})")
    left.set_ylabel("residual / noise")
    left.set_xlabel("time (ms)")
    for axes in (motion, left):
        axes.legend(fontsize="small", loc="upper right")
    return svg(figure)


if __name__ == "__main__":
    (Path(__file__).parent / "pictures" / "fit.svg").write_text(fit_picture())
