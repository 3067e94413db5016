"""Paths that lead to no plain file, through every command that opens one."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from tests.validation.adversities.probe import CAMPAIGN, DEEP, Probe, campaign


def _directory(place: Path) -> Path:
    place.mkdir()
    return place


def _fifo(place: Path) -> Path:
    os.mkfifo(place)
    return place


def _empty(place: Path) -> Path:
    place.write_bytes(b"")
    return place


def _loop(place: Path) -> Path:
    other = place.with_name("other" + place.suffix)
    place.symlink_to(other.name)
    other.symlink_to(place.name)
    return place


def _dangling(place: Path) -> Path:
    place.symlink_to("nowhere")
    return place


def _long(place: Path) -> Path:
    return place.with_name("n" * DEEP + place.suffix)


def _device(name: str) -> Callable[[Path], Path]:
    def make(place: Path) -> Path:
        place.symlink_to(name)
        return place

    return make


def _binary(place: Path) -> Path:
    place.write_bytes(np.random.default_rng(3).bytes(20_000))
    return place


PLACES: dict[str, Callable[[Path], Path]] = {
    "missing": lambda place: place,
    "a directory": _directory,
    "a fifo": _fifo,
    "empty": _empty,
    "a loop of links": _loop,
    "a link to nowhere": _dangling,
    "a name of 5000 characters": _long,
    "/dev/zero": _device("/dev/zero"),
    "/dev/null": _device("/dev/null"),
    "random bytes": _binary,
}
OPENERS: dict[str, tuple[str, Callable[[Path], Sequence[object]]]] = {
    "inspect": ("data.h5", lambda path: ("inspect", path)),
    "identify": ("data.h5", lambda path: ("identify", path, "-m", "model.yaml")),
    "identify -m": ("bad.yaml", lambda path: ("identify", "good.h5", "-m", path)),
    "score": ("data.h5", lambda path: ("score", path)),
    "export": ("data.h5", lambda path: ("export", path, "-o", "out")),
    "verify": ("data.h5", lambda path: ("verify", path)),
    "chart": ("bad.yaml", lambda path: ("chart", path, "--speed", "3000:4000:3", "--depth", "1:2:2")),
    "multipliers": ("bad.yaml", lambda path: ("multipliers", path, "--speed", "3810", "--depth", "2")),
    "run": ("bad.yaml", lambda path: ("run", path, "-o", "new.h5")),
    "compare": ("bad.yaml", lambda path: ("compare", path, "-m", "model.yaml")),
    "diagnose": ("bad.yaml", lambda path: ("diagnose", path, "-m", "model.yaml")),
    "add": ("bad.yaml", lambda path: ("add", "edge_force", "-m", "model.yaml", "-c", path, "-o", "new.yaml")),
    "a record's file": ("cut.csv", lambda path: ("inspect", "campaign.yaml")),
    "a record's .mat": ("cut.mat", lambda path: ("inspect", "campaign.yaml")),
    "an effect": ("own/law.py", lambda path: ("effects", "law", "--effects", "own")),
}


def probes() -> Iterator[Probe]:
    for opener, (name, command) in OPENERS.items():
        for place, make in PLACES.items():

            def probe(folder: Path, make: Any = make, name: str = name, command: Any = command) -> Sequence[object]:
                (folder / name).parent.mkdir(exist_ok=True)
                path = make(folder / name)
                if name.startswith("cut"):
                    (folder / "campaign.yaml").write_text(CAMPAIGN.replace("FILE", path.name))
                return command(path)

            yield Probe("paths", f"{opener}: {place}", probe)
    yield Probe("paths", "--effects: a file", lambda folder: ("effects", "--effects", "model.yaml"))
    yield Probe("paths", "--effects: a loop of links", lambda folder: ("effects", "--effects", _loop(folder / "own")))
    yield Probe("paths", "--effects: 5000 characters", lambda folder: ("effects", "--effects", "n" * DEEP))
    yield Probe("paths", "a file's name with a NUL", lambda folder: campaign(folder, file='"a\\0b.csv"'))
    yield Probe("paths", "a folder's name with a NUL", lambda folder: campaign(folder, more='folder: "a\\0b"'))
