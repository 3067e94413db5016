"""Cuts all over a stability chart, simulated to be heard."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from testbed.api.watch import Watch

if TYPE_CHECKING:
    from testbed.machine import Model

ACROSS, UP = 13, 8  # cuts along the speeds and the depths
HEARD_S = 0.5  # of each
LEAD_REVOLUTIONS, LEAD_TIMES = 20, 3.0  # before that: at least so many turns, and times over which the slowest mode decays
MOST_LEAD_S = 3.0
RATES = (8000.0, 16000.0, 48000.0)  # Hz, of sound; the least that holds the fastest mode
OVER = 2.5  # times the fastest mode's frequency


def listened(chart: Any, path: Path, catalogue: Any, watch: Watch) -> Path:
    """Write the page on which the cuts of a chart are heard; returns its path."""
    import numpy as np

    from testbed.analysis.report.sound_page import SimulatedCut, sound_page

    model: Model = chart.model if "contact_loss" in chart.model.effects else chart.model.with_effect("contact_loss")
    rate = next((one for one in RATES if one >= OVER * model.structure.frequency_range[1]), RATES[-1])
    mode = min(model.structure.modes, key=lambda one: one.natural_frequency)
    axis = "x" if abs(mode.shape[0]) >= abs(mode.shape[1]) else "y"
    speeds, depths = (np.linspace(one[0], one[-1], min(count, len(one)))
                      for one, count in ((chart.spindle_speed, ACROSS), (chart.axial_depth_of_cut, UP)))
    places = [(float(speed), float(depth)) for depth in depths for speed in speeds]
    cuts = []
    with watch.counted("cutting to be heard") as show:
        for speed, depth in places:
            cuts.append(SimulatedCut(speed, depth, _cut(model, speed, depth, rate, (mode.on, axis), catalogue)))
            show(len(cuts), len(places))
    return sound_page(path, chart.detail, cuts, rate, f"{mode.on} along {axis}", chart.notes)


def _cut(model: Model, speed: float, depth: float, rate: float, place: tuple[Any, str], catalogue: Any) -> Any:
    """Acceleration (samples,) out of the steady part of a cut; None where it diverges."""
    from testbed.cut import Cut, Sampling
    from testbed.engines.fast import simulate
    from testbed.recording import motion_channel

    assert model.cutter is not None  # of a chart
    turn = 2.0 * math.pi / speed
    mode = min(model.structure.modes, key=lambda one: one.natural_frequency)
    decay = LEAD_TIMES / max(mode.damping_ratio * mode.natural_frequency_rad, 1e-9)
    lead = max(LEAD_REVOLUTIONS * turn, min(decay, MOST_LEAD_S))
    passes = math.ceil((lead + HEARD_S) / turn) * model.cutter.flutes
    cut = replace(Cut(speed, depth), passes=passes)
    channel = motion_channel(f"acceleration_{place[1]}", place[0])
    found = simulate(model, cut, Sampling(rate, round(HEARD_S * rate), lead), channels=(channel,), catalogue=catalogue)
    return found.channels[channel] if found.outcome == "ok" else None
