"""The page of a stability chart on which a cut is dragged and heard: simulated cuts, carried in the page, nothing fetched."""

from __future__ import annotations

import base64
import json
from collections.abc import Sequence
from dataclasses import dataclass
from html import escape
from importlib.resources import files
from pathlib import Path

import numpy as np

from testbed.analysis.linear.stability import StabilityChart
from testbed.system.atomic import write_text

RANGE_DB = 40.0  # of loudness, into which what is heard is pressed
FADED_S = 0.02  # over which a sound's end runs into its beginning
RPM = np.pi / 30.0
HONEST = (
    "What you hear is simulated: the acceleration of the {what}, out of the steady part, repeated. It is that of the nearest "
    "of {count} cuts (dots), not of the very place. Loudness, which differs by {span:.0f} dB, is pressed into {pressed:.0f} dB;"
    " what is {most:.0f} dB below the loudest, or more, all sounds as loud. A real machine has a spindle, a drive, walls and a "
    "microphone besides. Teeth may leave the work in these cuts. The colours come from the multipliers of the delay equation: "
    "white is stable, blue and orange chatter, grey is not known.")
POLICY = "default-src 'none'; style-src 'unsafe-inline'; script-src 'unsafe-inline'"


@dataclass(frozen=True)
class SimulatedCut:
    """A cut at a spindle speed (rad/s) and axial depth (m): acceleration (samples,), m/s^2, None where it diverged."""

    spindle_speed: float
    axial_depth: float
    acceleration: np.ndarray | None


def sound_page(path: Path, chart: StabilityChart, cuts: Sequence[SimulatedCut], rate: float, what: str,
               notes: Sequence[str] = ()) -> Path:
    """Write the page; returns its path. rate: Hz, of the cuts' samples. what: whose acceleration they are, in words."""
    sizes = [0.0 if one.acceleration is None else float(np.std(one.acceleration)) for one in cuts]
    loudest, quietest = max(sizes), min((size for size in sizes if size > 0.0), default=0.0)
    rows, told, first = [], [], 0
    for one, size in zip(cuts, sizes, strict=True):
        row = np.empty(0, np.int8) if one.acceleration is None or size == 0.0 else _looped(one.acceleration, rate)
        said = "without a sound: it diverged" if one.acceleration is None else f"{size:.3g} m/s² rms" if size else "silent"
        db = 20.0 * np.log10(max(size, 1e-300) / max(loudest, 1e-300))
        told.append({"speed": one.spindle_speed / RPM, "depth": 1e3 * one.axial_depth, "first": first, "count": len(row),
                     "gain": round(float(10.0 ** (np.clip(db, -RANGE_DB, 0.0) / RANGE_DB)), 4), "said": said})
        rows.append(row)
        first += len(row)
    data = {"speeds": (chart.spindle_speeds / RPM).tolist(), "depths": (1e3 * chart.axial_depths).tolist(), "rate": rate,
            "classes": _packed(chart.classes.astype(np.int8).ravel()), "samples": _packed(np.concatenate(rows)), "cuts": told}
    span = 20.0 * np.log10(loudest / quietest) if quietest else 0.0
    honest = HONEST.format(what=what, count=len(cuts), span=span, pressed=RANGE_DB / 2.0, most=RANGE_DB)
    own = files("testbed.analysis.report")
    style, script = (own.joinpath(name).read_text(encoding="utf-8") for name in ("page.css", "sound.js"))
    told_notes = "".join(f'<p class="small">{escape(note)}</p>' for note in notes)
    content = json.dumps(data, separators=(",", ":")).replace("<", "\\u003c")
    write_text(path, (
        '<!doctype html>\n<html lang="en"><head><meta charset="utf-8"><title>Where does it cut steadily?</title>'
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        f'<meta http-equiv="Content-Security-Policy" content="{POLICY}"><style>{style}'
        "canvas{width:100%;touch-action:none;cursor:crosshair}input[type=range]{width:100%}"
        "button{font:inherit;padding:.4rem 1.2rem}</style></head>\n<body><h1>Where does it cut steadily?</h1>"
        '<p>Drag in the chart, or move the sliders. Press Play to hear the cut.</p><canvas id="chart" role="img" '
        'aria-label="stability chart"></canvas><p class="outcome" id="said" aria-live="polite"></p>'
        '<p><button id="play">Play</button></p><label>spindle speed <input id="speed" type="range"></label>'
        '<label>axial depth of cut <input id="depth" type="range"></label>'
        f'<p class="small">{escape(honest)}</p>{told_notes}\n<script type="application/json" id="sound">{content}</script>\n'
        f"<script>{script}</script></body></html>\n"))
    return path


def _looped(values: np.ndarray, rate: float) -> np.ndarray:
    """Samples as 8-bit counts of their largest, their end faded into their beginning."""
    count = min(round(FADED_S * rate), len(values) // 4)
    values = values - values.mean()
    weight = np.linspace(0.0, 1.0, count)
    kept = values[:-count].copy()
    kept[:count] = weight * values[:count] + (1.0 - weight) * values[-count:]
    return np.round(127.0 * kept / np.abs(kept).max()).astype(np.int8)


def _packed(values: np.ndarray) -> str:
    return base64.b64encode(values.tobytes()).decode()
