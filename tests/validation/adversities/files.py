"""Hostile, wrong and damaged files through every command that opens one: each is refused in one line, in ten seconds."""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

from tests.validation.adversities import hostile_data_sets, own_effects, paths
from tests.validation.adversities.measured_files import MEASURED
from tests.validation.adversities.probe import MODEL, SCENARIO, Probe
from tests.validation.adversities.random_damage import damaged
from tests.validation.adversities.runner import Result, Said, forked, preload, started, within
from tests.validation.adversities.written_texts import WRITTEN

SEEDS = range(6)  # of random damage


def probes() -> list[Probe]:
    """All but the random ones, in a fixed order."""
    found = [*paths.probes(), *hostile_data_sets.probes(), *own_effects.probes()]
    for kind, group in (("measured files", MEASURED), ("written texts", WRITTEN)):
        found += [Probe(kind, name, make, codes) for name, (make, codes) in group.items()]
    return found


def prepared(folder: Path) -> None:
    """The sound files that probes begin with."""
    (folder / "model.yaml").write_text(MODEL)
    (folder / "scenario.yaml").write_text(SCENARIO)
    with within(folder):
        made = started(("run", "scenario.yaml", "-o", "good.h5", "--engine", "fast", "--quiet"), 120.0)
    if made.code != 0:
        raise RuntimeError(made.err)


def answered(probe: Probe, sound: Path, folder: Path, command: Callable[..., Said] = started) -> Result:
    """Make a probe in an empty folder and see what the command says. Nothing may be left half-written."""
    for name in ("model.yaml", "scenario.yaml", "good.h5"):
        shutil.copyfile(sound / name, folder / name)
    with within(folder):
        arguments = probe.make(folder)
        before = sorted(path.name for path in folder.iterdir())
        said = command(arguments)
        wrong = said.wrong(probe.codes)
        left = sorted({path.name for path in folder.iterdir()} - set(before))
        if not wrong and said.code == 2 and left:
            wrong = f"left {', '.join(left)}"
        if not wrong and "precious" in before and not (folder / "precious").exists():
            wrong = "a file was deleted"
    return f"{probe.kind}: {probe.name}", not wrong, wrong or (said.err.strip() or "done")[:200]


def run(chosen: Sequence[Probe] | None = None, command: Callable[..., Said] = forked) -> Iterator[Result]:
    """Every probe in a process of its own."""
    preload()
    with tempfile.TemporaryDirectory() as name:
        sound = Path(name)
        prepared(sound)
        for probe in [*probes(), *damaged(SEEDS)] if chosen is None else chosen:
            with tempfile.TemporaryDirectory() as own:
                yield answered(probe, sound, Path(own), command)
