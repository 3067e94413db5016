"""Sound files of every kind, damaged at random."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from tests.validation.adversities.hostile_data_sets import READERS, without_seal
from tests.validation.adversities.probe import MODEL, SCENARIO, Probe, campaign
from tests.validation.adversities.runner import EITHER


def _damaged(raw: bytes, seed: int) -> bytes:
    """A sound file with one random damage: flipped bits, random bytes, cut off, a hole, a piece twice."""
    random, data = np.random.default_rng(seed), bytearray(raw)
    place, length = int(random.integers(0, len(raw))), int(random.integers(1, max(2, len(raw) // 20)))
    kind = seed % 5
    if kind == 0:
        data[place] ^= 1 << int(random.integers(0, 8))
    elif kind == 1:
        for spot in random.integers(0, min(len(raw), 4000), 12):
            data[spot] = int(random.integers(0, 256))
    elif kind == 2:
        del data[place:]
    elif kind == 3:
        data[place : place + length] = bytes(len(data[place : place + length]))
    else:
        data[place:place] = data[place : place + length]
    return bytes(data)


def damaged(seeds: Sequence[int]) -> Iterator[Probe]:
    """Sound files of every kind, damaged at random, through the commands that open them in turn."""
    from tests.support.made_files import FORMATS

    for seed in seeds:
        for kind in ("model.yaml", "good.h5", "scenario.yaml", *FORMATS):
            yield Probe("damaged", f"{kind} {seed}", lambda folder, kind=kind, seed=seed: _damage(folder, kind, seed), EITHER)


def _damage(folder: Path, kind: str, seed: int) -> Sequence[object]:
    from tests.support.made_files import write

    if kind == "model.yaml":
        (folder / kind).write_bytes(_damaged(MODEL.encode(), seed))
        return "multipliers", kind, "--speed", "3810", "--depth", "2"
    if kind == "scenario.yaml":
        (folder / kind).write_bytes(_damaged(SCENARIO.encode(), seed))
        return "run", kind, "-o", "new.h5"
    if kind == "good.h5":
        without_seal(folder / kind, folder / "plain.h5")
        (folder / "bad.h5").write_bytes(_damaged((folder / "plain.h5").read_bytes(), seed))
        command = READERS[seed % 5]
        return (command, "bad.h5", *{"identify": ("-m", "model.yaml"), "export": ("-o", "out")}.get(command, ()))
    path = write(kind, folder)
    path.write_bytes(_damaged(path.read_bytes(), seed))
    return campaign(folder, path.name)
