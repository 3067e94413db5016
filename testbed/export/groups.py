"""Which runs are held out: whole operating conditions, chosen by a hash of the condition itself.

Runs at one condition differ in noise and starting state only; were they spread over the splits, a method that remembers
them would look as if it had learnt. The hash knows nothing of the other runs: adding runs moves none that is there.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from hashlib import sha256

import numpy as np

SPLITS = ("train", "validation", "test")
SHARES = (70.0, 15.0, 15.0)  # per cent
CONDITION = ("spindle_speed", "axial_depth_of_cut", "feed_per_tooth")
_DIGITS = 6  # of a condition's value: two runs whose settings differ by rounding only stand in one group


def condition_group(condition: Mapping[str, float], flutes: int) -> str:
    """Name of the operating condition (rad/s, m, m; number of flutes): 16 hexadecimal digits."""
    text = " ".join(f"{name}={float(condition[name]):.{_DIGITS - 1}e}" for name in CONDITION)
    return sha256(f"{text} flutes={int(flutes)}".encode()).hexdigest()[:16]


def split_of(group: str, shares: Sequence[float] = SHARES, seed: int = 0) -> str:
    """The split of a group: uniform in its hash, in the proportion of `shares`. `seed` gives other divisions."""
    place = int(sha256(f"{seed} {group}".encode()).hexdigest()[:13], 16) / 16**13  # 52 bits: exact in a float
    edges = np.cumsum(np.asarray(shares, float)) / float(np.sum(shares))
    return SPLITS[min(int(np.searchsorted(edges, place, side="right")), len(SPLITS) - 1)]


def groups_of(conditions: Mapping[str, np.ndarray], flutes: int) -> list[str]:
    """The group of every run; conditions: name -> (runs,)."""
    known: dict[tuple[float, ...], str] = {}
    found = []
    for values in zip(*(conditions[name].tolist() for name in CONDITION), strict=True):
        if values not in known:
            known[values] = condition_group(dict(zip(CONDITION, values, strict=True)), flutes)
        found.append(known[values])
    return found
