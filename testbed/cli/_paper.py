"""The work of `testbed paper`: parts computed one by one or in processes, each kept as it is finished."""

from __future__ import annotations

import json
import time
from collections.abc import Iterator, Sequence
from contextlib import closing
from dataclasses import dataclass
from functools import lru_cache, partial
from hashlib import sha256
from pathlib import Path
from typing import Any

from testbed.system.processes import as_done_in_processes


@dataclass(frozen=True)
class Work:
    """What every part is computed with: folder, seed, effort."""

    folder: str
    seed: int
    quick: bool

    def kept(self, name: str) -> Path:
        """The file that says what a part found."""
        return Path(self.folder) / "parts" / f"{name}.json"


def make_all(work: Work, names: Sequence[str], workers: int, resume: bool) -> Iterator[tuple[Any, float]]:
    """Each part as it is finished, with the seconds it took (0: kept from before). Ctrl-C leaves those finished."""
    from testbed.analysis.paper import LONGEST_FIRST

    (Path(work.folder) / "parts").mkdir(exist_ok=True)
    waiting = []
    for name in sorted(names, key=LONGEST_FIRST.index):
        part = _finished(work, name) if resume else None
        if part is None:
            waiting.append(name)
        else:
            yield part, 0.0
    if workers == 1 or len(waiting) < 2:
        for name in waiting:
            yield make_one(work, name)
        return
    with closing(as_done_in_processes(partial(make_one, work), waiting, min(workers, len(waiting)))) as done:
        for _, made, fault in done:
            if fault is not None:  # the other parts are not waited for
                raise fault
            yield made


def make_one(work: Work, name: str) -> tuple[Any, float]:
    """Compute a part, save its pictures, keep what it found; the part without its figures, and the seconds."""
    from importlib import import_module

    from testbed.analysis.paper.bench import Bench
    from testbed.analysis.paper.part import as_dict, from_dict
    from testbed.analysis.paper.style import journal, save
    from testbed.api.result import plain
    from testbed.engines import fast, mujoco_engine
    from testbed.system.atomic import write_text

    began = time.perf_counter()
    folder = Path(work.folder)
    with journal():
        part = import_module(f"testbed.analysis.paper.{name}").make(
            Bench(mujoco_engine.simulate, fast.simulate, folder, work.seed, work.quick, _render))
        for picture in part.pictures:
            if picture.figure is not None:
                save(picture.figure, folder, picture.stem)
    found = plain(as_dict(part))
    write_text(work.kept(name), json.dumps({"made_with": fingerprint(work), "part": found}, indent=1) + "\n")
    return from_dict(found), time.perf_counter() - began


def _render(path: Path, camera: str) -> None:
    from testbed.view import render_rig

    render_rig(path, camera=camera, width=1600, height=1200)


def _finished(work: Work, name: str) -> Any:
    """The part that an earlier run finished with the same program, seed and effort; None if there is none."""
    from testbed.analysis.paper.part import from_dict, picture_files

    try:
        kept = json.loads(work.kept(name).read_text(encoding="utf-8"))
        if kept["made_with"] != fingerprint(work):
            return None
        part = from_dict(kept["part"])
    except (OSError, ValueError, KeyError, TypeError):  # not there, or no part: compute it
        return None
    return part if all(picture_files(Path(work.folder), one) for one in part.pictures) else None


def fingerprint(work: Work) -> str:
    """A hash of the program's own files, the seed and the effort."""
    return sha256(f"{_program()} {work.seed} {work.quick}".encode()).hexdigest()


@lru_cache(maxsize=1)
def _program() -> str:
    """A hash of every Python file of the analysis, the vocabulary, the effects and the engines."""
    import testbed
    from testbed import analysis

    digest = sha256()
    for package in (analysis, testbed):
        root = Path(str(package.__file__)).parent
        for path in sorted(root.rglob("*.py")):
            digest.update(str(path.relative_to(root)).encode())
            digest.update(path.read_bytes())
    return digest.hexdigest()
