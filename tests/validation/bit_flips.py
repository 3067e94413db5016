"""400 random bits flipped one at a time, over all bytes of a data set and of a folder of shards: does verify notice?"""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from pathlib import Path

import numpy as np

from testbed.problem import InputProblem
from testbed.store.verification import verify
from testbed.sweeps import sweep
from tests.support import plain_engine, sweep_kills
from tests.validation.claims import Claim, Section

FLIPS = 400


def unnoticed(paths: list[Path], flips: int, rng: np.random.Generator, intact: Callable[[], bool]) -> list[str]:
    """Places (file and byte) of flipped bits, drawn evenly over all bytes, that `intact` did not notice."""
    sizes = np.array([path.stat().st_size for path in paths])
    missed = []
    for place in rng.integers(sizes.sum(), size=flips):
        number = int(np.searchsorted(np.cumsum(sizes), place, side="right"))
        byte = int(place - sizes[:number].sum())
        whole = paths[number].read_bytes()
        harmed = bytearray(whole)
        harmed[byte] ^= 1 << int(rng.integers(8))
        paths[number].write_bytes(harmed)
        if intact():
            missed.append(f"{paths[number].name}:{byte}")
        paths[number].write_bytes(whole)
    return missed


def called_whole(path: Path) -> bool:
    """True where verify finds nothing wrong."""
    try:
        return not verify(path).damage
    except InputProblem:
        return False


def check() -> Section:
    """The section of the table."""
    rng, scenario, claims = np.random.default_rng(400), sweep_kills.scenario(48), []
    with tempfile.TemporaryDirectory() as name:
        place = Path(name)
        for target, keep in ((place / "file.h5", False), (place / "shards", True)):
            sweep.run(scenario, plain_engine.simulate, target, keep_shards=keep)
            paths = sorted(target.iterdir()) if keep else [target]
            if not called_whole(target):
                raise AssertionError("the undamaged data set is called damaged")
            missed = unnoticed(paths, FLIPS, rng, lambda target=target: called_whole(target))
            claims.append(Claim(f"bits flipped over all {sum(path.stat().st_size for path in paths)} bytes of "
                                f"{'a folder of shards' if keep else 'a data set'}", f"{FLIPS} of {FLIPS} noticed",
                                f"{FLIPS - len(missed)} of {FLIPS}", not missed, ", ".join(missed[:5])))
    return Section("verify", tuple(claims))
