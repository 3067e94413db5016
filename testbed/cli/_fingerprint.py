"""The small picture on an effect's card: what it does to one test cut, drawn with characters."""

from __future__ import annotations

import math
import sys
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from testbed.cut import Cut, whole_cut_sampling
from testbed.effect import Effect
from testbed.engines import fast
from testbed.machine import Cutter, Cutting, Model, Structure

_DOTS = ((0x01, 0x08), (0x02, 0x10), (0x04, 0x20), (0x40, 0x80))  # braille: row, column


@dataclass(frozen=True)
class Fingerprint:
    """Displacements (m) at `time` (s) of a test cut with the effect, and their change by it."""

    time: np.ndarray
    with_effect: np.ndarray
    change: np.ndarray
    story: str


def fingerprint(effect: Effect, catalogue: Mapping[str, Effect]) -> Fingerprint:
    """A stable cut with two flutes: idling while the structure swings, entry, exit, ring-down."""
    model = Model(Structure(2.573, 146.4, 0.0032), Cutter(2), Cutting())
    cut = Cut(3810 * 2 * math.pi / 60, 0.8e-3, idle_passes=2, passes=20, ring_down_passes=6, initial_displacement=2e-4,
              length_cut_before=0.02)
    sampling = whole_cut_sampling(cut, 2, 12800.0)
    changed = replace(model, effects={effect.name: effect.example()})
    found, base = (fast.simulate(one, cut, sampling, catalogue=catalogue) for one in (changed, model))
    return Fingerprint(found.time, found.channels["displacement"],
                       found.channels["displacement"] - base.channels["displacement"],
                       "a cut of 2 idle, 20 cutting and 6 ring-down passes (2 flutes, 3810 rpm, 0.8 mm deep)")


def picture(x: np.ndarray, y: np.ndarray, width: int = 64, height: int = 4) -> list[str]:
    """Lines of a plot of y over x, each column the range of y in it; NaN is left empty."""
    finite = np.isfinite(y)
    if not finite.any():
        return ["(no finite values)"]
    low, high = float(y[finite].min()), float(y[finite].max())
    if high - low < 1e-12 * max(1e-30, abs(high), abs(low)):
        low, high = low - 1.0, high + 1.0
    dots = np.zeros((4 * height, 2 * width), dtype=bool)
    column = np.minimum((x - x[0]) / (x[-1] - x[0]) * 2 * width, 2 * width - 1).astype(int)
    row = np.zeros(len(y), dtype=int)
    row[finite] = np.minimum((high - y[finite]) / (high - low) * 4 * height, 4 * height - 1)
    for one in np.unique(column[finite]):
        inside = row[finite & (column == one)]
        dots[inside.min():inside.max() + 1, one] = True
    lines = ["".join(_character(dots[4 * r:4 * r + 4, 2 * c:2 * c + 2]) for c in range(width)) for r in range(height)]
    labels = [f"{high:9.3g}", *[" " * 9] * (height - 2), f"{low:9.3g}"]
    scale = f"{x[0]:<{width // 2}.3g}{x[-1]:>{width - width // 2}.4g}"
    return [f"{label} |{line}" for label, line in zip(labels, lines, strict=True)] + [" " * 11 + scale]


def _character(cell: np.ndarray) -> str:
    """One character of 4 x 2 dots: braille, or * where the terminal has none."""
    if not _has_braille():
        return "*" if cell.any() else " "
    return chr(0x2800 + sum(_DOTS[r][c] for r in range(4) for c in range(2) if cell[r, c]))


def _has_braille() -> bool:
    try:
        "\u28ff".encode(sys.stdout.encoding or "ascii")
    except (UnicodeEncodeError, LookupError):
        return False
    return True
