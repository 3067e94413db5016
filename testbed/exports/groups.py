"""Which runs are held out: whole operating conditions, or whole machines, chosen by a hash of these themselves.

Runs at one condition differ in noise and starting state only; were they spread over the splits, a method that remembers
them would look as if it had learnt. So with machines, where the question is how a method does on one it never saw. The hash
knows nothing of the other runs: adding runs moves none that is there.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from hashlib import sha256

import numpy as np

SPLITS = ("train", "validation", "test")
SHARES = (70.0, 15.0, 15.0)  # per cent
CONDITION = ("spindle_speed", "axial_depth_of_cut", "feed_per_tooth")
_DIGITS = 6  # of a condition's value: two runs whose settings differ by rounding only stand in one group


def condition_group(condition: Mapping[str, float], flutes: int) -> str:
    """Name of the operating condition (rad/s, m, m; number of flutes): 16 hexadecimal digits."""
    return _hashed({name: condition[name] for name in CONDITION}, flutes)


def _hashed(values: Mapping[str, float], flutes: int) -> str:
    text = " ".join(f"{name}={float(value):.{_DIGITS - 1}e}" for name, value in values.items())
    return sha256(f"{text} flutes={int(flutes)}".encode()).hexdigest()[:16]


def split_of(group: str, shares: Sequence[float] = SHARES, seed: int = 0) -> str:
    """The split of a group: uniform in its hash, in the proportion of `shares`. `seed` gives other divisions."""
    place = int(sha256(f"{seed} {group}".encode()).hexdigest()[:13], 16) / 16**13  # 52 bits: exact in a float
    edges = np.cumsum(np.asarray(shares, float)) / float(np.sum(shares))
    return SPLITS[min(int(np.searchsorted(edges, place, side="right")), len(SPLITS) - 1)]


def _ids(names: Sequence[str], columns: Mapping[str, np.ndarray], flutes: int) -> list[str]:
    """The hash of every run's values of these names; columns: name -> (runs,)."""
    known: dict[tuple[float, ...], str] = {}
    return [known.get(values) or known.setdefault(values, _hashed(dict(zip(names, values, strict=True)), flutes))
            for values in zip(*(columns[name].tolist() for name in names), strict=True)]


def groups_of(conditions: Mapping[str, np.ndarray], flutes: int) -> list[str]:
    """The operating condition of every run; conditions: name -> (runs,)."""
    return _ids(CONDITION, conditions, flutes)


def machines_of(truth: Mapping[str, np.ndarray], of_record: Collection[str], flutes: int) -> list[str]:
    """The machine of every run, by its true parameters; truth: path -> (runs,), of_record: paths that are the record's own."""
    return _ids(sorted(set(truth) - set(of_record)), truth, flutes)
