"""Adversities of an installation: a folder of compiled code that is another's or damaged, a user without a home, signals.

`quick` probes take a second or less in this process; the others are processes of their own, whose compiled functions are made
once and copied.
"""

from __future__ import annotations

import atexit
import os
import pickle
import random
import re
import shutil
import stat
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, redirect_stderr
from dataclasses import dataclass
from functools import cache, partial
from io import StringIO
from pathlib import Path
from unittest import mock

from testbed.system import kernel_cache

Result = tuple[str, bool, str]
ROOT = Path(__file__).resolve().parents[3]
STRANGER = 54321  # a user without a home, a name or a group
MODEL = """structure: {mass: 2.573 kg, natural_frequency: 147.5 Hz, damping_ratio: 0.005}
cutter: {flutes: 1, diameter: 19.05 mm, helix_angle: 0 deg}
cutting: {direction: up-milling, immersion: 0.162, tangential_coefficient: 600 N/mm^2, normal_coefficient: 180 N/mm^2}
"""
SCENARIO = """name: small
seed: 3
REPEATS
model: {file: model.yaml}
cut: {idle: 10 rev, cutting: 60 rev, ring_down: 60 rev}
tests:
  - {spindle_speed: 3810 rpm, depth_of_cut: 2.9 mm}
  - {spindle_speed: 2850 rpm, depth_of_cut: 2.9 mm}
  - {spindle_speed: 4100 rpm, depth_of_cut: 2.0 mm}
sensors: {displacement: {noise: 0.2 um, bits: 16, range: 1 mm}}
"""
RUN = ("run", "small.yaml", "-o", "small.h5", "--engine", "fast")
MULTIPLIERS = ("multipliers", "model.yaml", "--speed", "3810", "--depth", "2.9")


@dataclass(frozen=True)
class Probe:
    """An adversity. act: "" where it was answered as asked, else what was seen instead. quick: takes about a second."""

    name: str
    act: Callable[[], str]
    quick: bool = False


# -- helpers ---------------------------------------------------------------------------------------------------------------

@contextmanager
def place() -> Iterator[Path]:
    """A new folder that anybody may enter, with the files that commands read."""
    folder = Path(tempfile.mkdtemp(prefix="adversity"))
    try:
        folder.chmod(0o755)
        (folder / "model.yaml").write_text(MODEL)
        (folder / "small.yaml").write_text(SCENARIO.replace("REPEATS\n", ""))
        (folder / "many.yaml").write_text(SCENARIO.replace("REPEATS", "repeats: 6000"))
        yield folder
    finally:
        shutil.rmtree(folder, ignore_errors=True)


def command(folder: Path, arguments: Sequence[str], prefix: Sequence[str] = (), without: Sequence[str] = (),
            **environment: str) -> subprocess.CompletedProcess[str]:
    """A command line as a shell calls it, in that folder."""
    known = {**os.environ, "PYTHONPATH": str(ROOT), **environment}
    return subprocess.run([*prefix, sys.executable, "-m", "testbed", *arguments], cwd=folder, capture_output=True, text=True,
                          timeout=300, env={name: value for name, value in known.items() if name not in without})


def told(stderr: str) -> list[str]:
    """The lines of standard error without those that show how far long work is, which a busy machine adds."""
    return [line for line in stderr.splitlines() if not re.search(r" \(\d+ s\)$", line)]


@cache
def warm() -> tuple[Path, str]:
    """(a folder of all that the two commands compile, what they print), made once."""
    root = Path(tempfile.mkdtemp(prefix="warm"))
    atexit.register(shutil.rmtree, root, ignore_errors=True)
    with place() as folder:
        said = "".join(command(folder, one, TESTBED_CACHE=str(root)).stdout for one in (RUN, MULTIPLIERS))
    return next(root.iterdir()), said


@contextmanager
def environment(**changes: str | None) -> Iterator[StringIO]:
    """The folder chosen anew under another environment; what is said meanwhile."""
    kept = {name: value for name, value in os.environ.items() if name not in ("TESTBED_CACHE", "XDG_CACHE_HOME", *changes)}
    kept |= {name: value for name, value in changes.items() if value is not None}
    with mock.patch.dict(os.environ, kept, clear=True), \
            mock.patch.object(tempfile, "tempdir", changes.get("TMPDIR")), redirect_stderr(StringIO()) as said:
        kernel_cache.cache_folder.cache_clear()
        kernel_cache._said.clear()
        try:
            yield said
        finally:
            kernel_cache.cache_folder.cache_clear()


# -- whose folder it is ------------------------------------------------------------------------------------------------------

class _Trap:
    """What a file that is unpickled can do: here, end the program that reads it."""

    def __reduce__(self) -> tuple[Callable, tuple]:
        return (os._exit, (70,))


def _planted(spoil: Callable[[Path], None], refused: bool = True) -> str:
    """A folder with files that run code when they are unpickled, under the name that the program would take."""
    with place() as home:
        folder = home / "chosen" / f"testbed-kernels-{os.geteuid()}"
        folder.mkdir(parents=True, mode=0o700)
        body = pickle.dumps(_Trap())
        (folder / "trap").write_bytes(kernel_cache._head("trap", body) + body)
        spoil(folder)
        with environment(TESTBED_CACHE=str(folder.parent), HOME=str(home), TMPDIR=str(home)) as said:
            found, read = kernel_cache.cache_folder(), kernel_cache.read("trap")
    if refused and (found == folder or read is not None or str(folder) not in said.getvalue()):
        return f"{found} was taken, {said.getvalue()!r} said"
    return "" if refused or found == folder else f"{found} was taken"


def _moved(folder: Path, link: bool = True) -> None:
    other = folder.with_name("other")
    folder.rename(other)
    folder.symlink_to(other) if link else folder.write_text("")


SPOILT: dict[str, Callable[[Path], None]] = {
    "can be written by its group": lambda folder: folder.chmod(0o770),
    "can be written by all": lambda folder: folder.chmod(0o777),
    "can be written by all, sticky": lambda folder: folder.chmod(0o1777),
    "lies where all can replace it": lambda folder: folder.parent.chmod(0o777),
    "is a link": _moved,
    "is a file": partial(_moved, link=False),
    "is a link to nowhere": lambda folder: (_moved(folder), shutil.rmtree(folder.with_name("other")))[0],
}  # fmt: skip
ONLY_ROOT: dict[str, Callable[[Path], None]] = {
    "belongs to another user": lambda folder: os.chown(folder, STRANGER, STRANGER),
    "belongs to another user, closed": lambda folder: (os.chown(folder, STRANGER, STRANGER), folder.chmod(0o700))[0],
    "is a link of another user": lambda folder: (_moved(folder), os.lchown(folder, STRANGER, STRANGER))[0],
    "is a link to another's": lambda folder: (_moved(folder), os.chown(folder.with_name("other"), STRANGER, STRANGER))[0],
}


def _chosen(expected: str, **changes: str | None) -> str:
    """Where the folder is under an environment; HOME and TMPDIR stand for folders that exist, # for one of this place."""
    with place() as folder:
        for name in ("home", "tmp", "named"):
            (folder / name).mkdir()
        (folder / "tmp").chmod(0o1777)
        (folder / "file").write_text("")
        given = {name: value and value.replace("#", str(folder)) for name, value in changes.items()}
        with environment(**{"HOME": f"{folder}/home", "TMPDIR": f"{folder}/tmp"} | given):
            found = kernel_cache.cache_folder()
            if found is not None and stat.S_IMODE(found.stat().st_mode) != 0o700:
                return f"{found} is open to others"
            name = "None" if found is None else str(found.parent.relative_to(folder))
        return "" if name == expected else f"{name} was taken in place of {expected}"


PLACES: dict[str, tuple[str, dict[str, str | None]]] = {
    "a home": ("home/.cache/testbed", {}),
    "a home that is not there": ("tmp", {"HOME": "/nonexistent"}),
    "a home that is no folder": ("tmp", {"HOME": "#/file"}),
    "a home that is a device": ("tmp", {"HOME": "/dev/null"}),
    "an empty HOME": ("tmp", {"HOME": ""}),
    "a HOME that is no absolute path": ("tmp", {"HOME": "home"}),
    "XDG_CACHE_HOME": ("named/testbed", {"XDG_CACHE_HOME": "#/named"}),
    "XDG_CACHE_HOME that cannot be made": ("home/.cache/testbed", {"XDG_CACHE_HOME": "#/file/below"}),
    "TESTBED_CACHE": ("named", {"TESTBED_CACHE": "#/named"}),
    "TESTBED_CACHE that is not there yet": ("new/deep", {"TESTBED_CACHE": "#/new/deep"}),
    "TESTBED_CACHE with blanks and umlauts": ("näm ed", {"TESTBED_CACHE": "#/näm ed"}),
    "TESTBED_CACHE that is a file": ("home/.cache/testbed", {"TESTBED_CACHE": "#/file"}),
    "TESTBED_CACHE with too long a name": ("home/.cache/testbed", {"TESTBED_CACHE": "#/" + "n" * 300}),
    "TESTBED_CACHE in /proc": ("home/.cache/testbed", {"TESTBED_CACHE": "/proc/none"}),
    "an empty TESTBED_CACHE": ("home/.cache/testbed", {"TESTBED_CACHE": ""}),
    "no place at all": ("None", {"HOME": "/nonexistent", "TMPDIR": "/proc/none"}),
}


# -- damage ------------------------------------------------------------------------------------------------------------------

def _flip(data: bytes, share: float) -> bytes:
    place_, spoilt = int(share * (len(data) - 1)), bytearray(data)
    spoilt[place_] ^= 1 << random.Random(place_).randrange(8)
    return bytes(spoilt)


DAMAGES: dict[str, Callable[[bytes], bytes]] = {
    "emptied": lambda data: b"", "cut to a byte": lambda data: data[:1], "cut within its hash": lambda data: data[:20],
    "cut after its hash": lambda data: data[:40], "cut in half": lambda data: data[: len(data) // 2],
    "cut by a byte": lambda data: data[:-1], "longer by a byte": lambda data: data + b"\0", "twice": lambda data: data * 2,
    "zeroes": lambda data: bytes(len(data)), "random bytes": lambda data: random.Random(1).randbytes(len(data)),
    "text": lambda data: b"no compiled function\n", "without its hash": lambda data: data[40:],
    "a pickle of another": lambda data: pickle.dumps(_Trap()), "zeroes at the end": lambda data: data[:-512] + bytes(512),
    **{f"a bit flipped at {share:.0%}": partial(_flip, share=share) for share in (0.0, 0.001, 0.01, 0.3, 0.5, 0.8, 1.0)},
}  # fmt: skip


def _alone(spoil: Callable[[bytes], bytes]) -> str:
    """One damaged file, read in this process."""
    with place() as folder, environment(TESTBED_CACHE=str(folder)) as said:
        kernel_cache.keep("one", os.urandom(5000))
        kernel_cache.keep("other", b"whole")
        path = next(Path(str(kernel_cache.cache_folder())).glob("one"))
        path.write_bytes(spoil(path.read_bytes()))
        found = [kernel_cache.read("one") for _ in range(2)]
        if found != [None, None] or kernel_cache.read("other") != b"whole" or path.exists():
            return f"{found} was read"
        return "" if said.getvalue().count("\n") == 1 and "damaged" in said.getvalue() else f"{said.getvalue()!r} said"


def _swapped() -> str:
    with place() as folder, environment(TESTBED_CACHE=str(folder)):
        kernel_cache.keep("one", b"1")
        here = Path(str(kernel_cache.cache_folder()))
        shutil.copy(here / "one", here / "two")
        return "" if kernel_cache.read("two") is None else "a file was taken for another"


def _odd(make: Callable[[Path], object]) -> str:
    """Something that is no file stands where a compiled function is looked for; it must not hang or end the program."""
    with place() as folder, environment(TESTBED_CACHE=str(folder)):
        make(Path(str(kernel_cache.cache_folder())) / "one")
        found = kernel_cache.read("one")
        kernel_cache.keep("one", b"1")
        return "" if found is None else f"{found!r} was read"


ODD = {"a folder": Path.mkdir, "a fifo": os.mkfifo, "a link to a device": lambda path: path.symlink_to("/dev/zero"),
       "a link to itself": lambda path: path.symlink_to(path), "a link to nowhere": lambda path: path.symlink_to("/nowhere")}


def _all_damaged(spoil: Callable[[bytes], bytes]) -> str:
    """Every file of a real cache damaged: the commands answer the same, say it once, and are silent the next time."""
    kernels, expected = warm()
    with place() as folder:
        here = folder / "cache" / kernels.name
        shutil.copytree(kernels, here)
        for path in here.iterdir():
            path.write_bytes(spoil(path.read_bytes()))
        for notes in (1, 0):
            (folder / "small.h5").unlink(missing_ok=True)
            done = [command(folder, one, TESTBED_CACHE=str(here.parent)) for one in (RUN, MULTIPLIERS)]
            if "".join(one.stdout for one in done) != expected or any(len(told(one.stderr)) != notes for one in done):
                return "; ".join(f"exit {one.returncode}: {one.stderr[-200:]!r}" for one in done)
    return ""


def probes() -> list[Probe]:
    """All of them that this machine and user can try."""
    from tests.validation.adversities.accounts import MISTAKES, mistake, no_room, stranger

    found = [Probe(f"a folder of compiled code that {name}", partial(_planted, spoil), True) for name, spoil in SPOILT.items()]
    found.append(Probe("a folder of one's own, closed", partial(_planted, lambda folder: None, refused=False), True))
    found += [Probe(f"the folder with {name}", partial(_chosen, where, **changes), True)
              for name, (where, changes) in PLACES.items()]
    found += [Probe(f"a compiled function {name}", partial(_alone, spoil), True) for name, spoil in DAMAGES.items()]
    found += [Probe(f"{name} for a compiled function", partial(_odd, make), True) for name, make in ODD.items()]
    found.append(Probe("one compiled function under the name of another", _swapped, True))
    found += [Probe(f"{name} on the command line", partial(mistake, arguments), True) for name, arguments in MISTAKES.items()]
    found += [Probe(f"all compiled functions: {name}", partial(_all_damaged, DAMAGES[name]))
              for name in ("emptied", "cut in half", "random bytes", "a pickle of another", "a bit flipped at 50%")]
    if shutil.which("prlimit"):
        found.append(Probe("no room for compiled functions", no_room))
    if os.name == "posix" and os.geteuid() == 0 and shutil.which("setpriv"):
        found += [Probe(f"a folder of compiled code that {name}", partial(_planted, spoil), True)
                  for name, spoil in ONLY_ROOT.items()]
        found += [Probe("a user without HOME", stranger), Probe("a user whose HOME is not there",
                                                                 partial(stranger, True, HOME="/nonexistent"))]
    return found


def run() -> Iterator[Result]:
    """(name, answered as asked, what was seen) of every probe here and of `endings`."""
    from tests.validation.adversities import endings

    for kind, found in (("installation", probes()), ("signals", endings.probes())):
        yield from ((f"{kind}: {probe.name}", not (seen := probe.act()), seen) for probe in found)
