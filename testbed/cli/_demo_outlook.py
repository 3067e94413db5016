"""How sure, and what next: `testbed chart --campaign` and `testbed plan` on the demo's workshop once it is explained."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

GRID_RPM, GRID_M = (2600.0, 4400.0, 7), (0.5e-3, 4e-3, 5)  # few cells: with effects one takes 25 ms a chart
FINE = 200  # speeds and depths of the limit without an effect
DRAWS, RISK, MOST_VIBRATION_M, SHOWN = 300, 0.05, 0.5e-3, 3
CELLS = "--speed 2600:4400:7 --depth 0.5:4:5"  # the same, as the commands are told


@dataclass(frozen=True)
class Outlook:
    """Chances with the effect, speeds (rad/s) and limits (m) without it, and the cuts that would tell most."""

    sure: Any
    before: tuple[Any, Any]
    planned: Sequence[Any]

    def as_json(self) -> dict[str, Any]:
        """Its part of the demo's JSON."""
        return self.sure.as_json() | {"limit_before": self.before[1], "next": [one.as_json() for one in self.planned]}


def outlook(sealed: Any, loop: Any) -> Outlook | None:
    """The answers on the workshop's files, with the model that was written; None where nothing was added."""
    import numpy as np

    from testbed.analysis.linear.stability import sharpened_limit, stability_chart
    from testbed.analysis.probable.plan import Explanation, plan, safe_cuts
    from testbed.api.fitting import engine_of, read_both
    from testbed.api.probable import Asked, chances
    from testbed.api.watch import Watch
    from testbed.catalogue import catalogue
    from testbed.files.model_file import read_model

    if loop.written is None:
        return None
    effects = catalogue()
    speeds, depths = np.linspace(*GRID_RPM) * math.pi / 30.0, np.linspace(*GRID_M)
    model = read_model(loop.written, effects)
    sure = chances(Asked(model, str(loop.written), str(sealed.campaign), effects, speeds, depths, DRAWS, 0, RISK, Watch()))
    plain, fine = loop.diagnosis.base.fit.state.model, np.linspace(speeds[0], speeds[-1], FINE)
    before = fine, sharpened_limit(stability_chart(plain, fine, np.linspace(0.02 * depths[-1], depths[-1], FINE)), plain)
    if sure.chance is None:
        return Outlook(sure, before, ())
    within = safe_cuts(sure.chance.probability, speeds, depths, DRAWS, RISK)
    _, records, _ = read_both(str(sealed.campaign), str(loop.written), effects)
    known = [Explanation(" + ".join(model.effects), sure.known)]
    told = plan(engine_of(effects), max(records, key=lambda one: one.samples), known, within)
    return Outlook(sure, before, [one for one in told if one.vibration <= MOST_VIBRATION_M][:SHOWN])


def said(found: Outlook) -> list[str]:
    """What the chart says before and after the effect was added, in words."""
    lines = ["before the effect was added, the model left more than noise: then no chance is given"]
    if found.sure.chance is None:
        return [*lines, f"nor is one with it: {found.sure.why_none}"]
    best = found.sure.recommended
    return lines if best is None else [*lines, f"most removal at a risk of {RISK:.0%}: {_point(best)}, stable in "
                                       f"{best.stable_probability:.1%} of {found.sure.chance.draws} machines drawn"]


def cuts_table(found: Outlook) -> tuple[tuple[str, ...], list[tuple[str, ...]]]:
    """Titles and rows of the cuts to make next."""
    return ("next cut", "stable", "vibrates by up to", "information a minute"), [
        (_point(one), f"{one.stable_probability:.1%}", f"{one.vibration * 1e6:.0f} um",
         f"{one.information_per_minute:.0f} nats") for one in found.planned]


def _point(cut: Any) -> str:
    return f"{cut.spindle_speed * 30.0 / math.pi:.0f} rpm, {cut.axial_depth_of_cut * 1e3:.2f} mm"
