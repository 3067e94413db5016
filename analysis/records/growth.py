"""How a cut's motion grew behind the entry, before teeth left the work: the multiplier that the record itself shows.

While it is small, what grows is multiplied by one number from tooth to tooth: negative and real in a flip, one of a complex
pair in a Neimark-Sacker. Differences over a revolution leave out all that repeats with the spindle, runout and tooth passing,
so a growing flip is told from runout of the same orders; once it stands, the two look alike.
"""

from __future__ import annotations

import cmath
import math

import numpy as np
from scipy.interpolate import CubicSpline

from testbed.analysis.records.orders import Turns

SMALL = 0.6  # of the largest change: below it the motion grows nearly as a small one does
FEWEST = 6  # tooth passes of growth that tell
GROWN = 2.0  # times, by which it must have grown over them
FOLLOWED = 0.15  # of the power, that a multiplier may leave unexplained
AS_WELL = 0.5  # of that which a pair leaves: a single real one leaves more by so much, it is no flip
LEAST = 1.0  # modulus of a multiplier that grows
FEWEST_SAMPLES = 8  # a tooth pass
NEARLY_REAL = 0.97  # of pi: angle from which a multiplier is a flip's


def growth(whole: Turns, flutes: int) -> complex | None:
    """The multiplier a tooth by which a cut (all its revolutions, from the entry on) grew; None where no growth is seen.

    The angle is 0 to pi. A motion that was large at once, or that grew within a few teeth, shows none.
    """
    passes = _passes(whole, flutes)
    if len(passes) < flutes + FEWEST:
        return None
    return _multiplier(passes[flutes:] - passes[:-flutes])  # what repeats with the spindle is gone


def is_flip(multiplier: complex) -> bool:
    """Whether a multiplier is real and negative, as nearly as a record tells."""
    return abs(cmath.phase(multiplier)) > NEARLY_REAL * math.pi


def _passes(whole: Turns, flutes: int) -> np.ndarray:
    """The revolutions as tooth passes, (passes, samples a pass), about their means."""
    count, per_turn = whole.rows.shape
    size = max(FEWEST_SAMPLES, round(per_turn / flutes))
    values = whole.rows.ravel()
    wanted = np.arange(count * flutes * size) * (per_turn / flutes / size)
    wanted = wanted[wanted <= len(values) - 1]
    rows = CubicSpline(np.arange(len(values)), values)(wanted)
    rows = rows[: len(rows) // size * size].reshape(-1, size)
    return np.asarray(rows)


def _multiplier(rows: np.ndarray) -> complex | None:
    """That of differences (passes, samples a pass), from where they are least to where they are no longer small."""
    level = np.maximum(np.sqrt(np.mean(rows**2, axis=1)), 1e-300)
    least = np.minimum.accumulate(level)
    top = int(np.argmax(level / least))
    first = int(np.argmin(level[: top + 1]))
    last = first + int(np.argmax(level[first : top + 1] > SMALL * level[top]))
    if last - first < FEWEST or level[last - 1] < GROWN * level[first]:
        return None
    seen = rows[first:last]
    power = float(np.sum(seen[2:] ** 2))
    single = float(np.sum(seen[2:] * seen[1:-1]) / np.sum(seen[1:-1] ** 2))
    left_single = float(np.sum((seen[2:] - single * seen[1:-1]) ** 2)) / power
    before = np.column_stack([seen[1:-1].ravel(), seen[:-2].ravel()])
    pair = np.linalg.lstsq(before, seen[2:].ravel(), rcond=None)[0]
    left_pair = float(np.sum((seen[2:].ravel() - before @ pair) ** 2)) / power
    root = 0.5 * (pair[0] + cmath.sqrt(pair[0] ** 2 + 4.0 * pair[1]))
    other = pair[0] - root
    largest = max(root, other, key=abs)
    if left_single < FOLLOWED and AS_WELL * left_single < left_pair:
        largest = complex(single)
    elif left_pair > FOLLOWED:
        return None
    return complex(largest.real, abs(largest.imag)) if abs(largest) > LEAST else None
