"""One adversity: a command line run against the clock, and whether it answered as was asked."""

from __future__ import annotations

import contextlib
import importlib
import os
import pkgutil
import resource
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

WITHIN = 10.0  # s of processor time in which bad input is refused
WAITED, IN_TURN = 6.0, 60.0  # times that, on the clock: then it counts as hung; and if it but waits for a processor others have
CEILING = 6 * 2**30  # bytes of address space
REFUSED, EITHER, DONE = (2,), (0, 2), (0,)  # exit codes that are an answer: to a bad file, to a damaged one, to a good one
Result = tuple[str, bool, str]  # name, answered as asked, what was seen


@dataclass(frozen=True)
class Said:
    """How a command ended. code: None where it did not within the time; seconds: of processor time."""

    code: int | None
    out: str
    err: str
    seconds: float

    def wrong(self, codes: Sequence[int]) -> str:
        """What is wrong with the answer; "" where it is as asked: such a code, and of bad input one line that says so."""
        if self.code is None or self.seconds > WITHIN:
            return f"no end within {WITHIN:.0f} s"
        if "Traceback" in self.err or self.code not in codes:
            return f"exit code {self.code}: {(self.err.strip().splitlines() or ['no word'])[-1][:150]}"
        lines = self.err.strip().splitlines()
        if self.code == 2 and not (len(lines) == 1 and lines[0].startswith("error: ") and len(lines[0]) < 1000):
            return f"{len(lines)} lines of {len(self.err)} characters: {self.err[:150]!r}"
        return ""


def preload() -> None:
    """Import all of the program: children that are forked then need not."""
    import testbed
    from testbed import analysis

    for package, places in ((testbed, testbed.__path__), (analysis, analysis.__path__)):
        for module in pkgutil.walk_packages(places, f"{package.__name__}."):
            if not module.name.endswith("__main__"):
                importlib.import_module(module.name)


def forked(arguments: Sequence[object], seconds: float = WITHIN, room: int | None = None) -> Said:
    """The command in a child of this process, which has imported all already: quick. room: bytes of memory it may take."""
    with tempfile.TemporaryFile() as out, tempfile.TemporaryFile() as err:
        began, child = time.monotonic(), os.fork()
        if child == 0:
            code = 70
            try:
                os.dup2(out.fileno(), 1)
                os.dup2(err.fileno(), 2)
                sys.stdout, sys.stderr = os.fdopen(1, "w"), os.fdopen(2, "w")
                from testbed.cli import main

                taken = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
                most = CEILING if room is None else taken + room
                resource.setrlimit(resource.RLIMIT_AS, (most, most))
                main([str(one) for one in arguments])
            except SystemExit as stop:
                code = stop.code if isinstance(stop.code, int) else 0
            except BaseException:
                import traceback

                traceback.print_exc()
            finally:
                with contextlib.suppress(Exception):
                    sys.stdout.flush()
                    sys.stderr.flush()
                os._exit(code)
        return _ended(child, began, seconds, out, err)


def started(arguments: Sequence[object], seconds: float = WITHIN) -> Said:
    """The command as a shell starts it."""
    began = time.monotonic()
    with tempfile.TemporaryFile() as out, tempfile.TemporaryFile() as err:
        child = subprocess.Popen([sys.executable, "-m", "testbed", *map(str, arguments)], stdin=subprocess.DEVNULL, stdout=out,
                                 stderr=err, start_new_session=True,
                                 preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_AS, (CEILING, CEILING)))
        return _ended(child.pid, began, seconds, out, err)


def _ended(child: int, began: float, seconds: float, out: object, err: object) -> Said:
    """The end of a child, awaited."""
    while (passed := time.monotonic() - began) < WAITED * seconds or (passed < IN_TURN * seconds and _waits_its_turn(child)):
        done, status, used = os.wait4(child, os.WNOHANG)
        if done:
            return Said(os.waitstatus_to_exitcode(status), _text(out), _text(err), used.ru_utime + used.ru_stime)
        time.sleep(0.005)
    os.kill(child, signal.SIGKILL)
    os.waitpid(child, 0)
    return Said(None, _text(out), _text(err), time.monotonic() - began)


def _waits_its_turn(child: int) -> bool:
    """Whether a child could go on but for other processes, as the system says."""
    return Path(f"/proc/{child}/stat").read_text().rpartition(")")[2].split()[0] == "R"


def _text(stream: object) -> str:
    stream.seek(0)  # type: ignore[attr-defined]
    return stream.read(1_000_000).decode(errors="replace")  # type: ignore[attr-defined]


@contextlib.contextmanager
def within(folder: Path) -> Iterator[None]:
    """The working folder changed for a while."""
    before = os.getcwd()
    os.chdir(folder)
    try:
        yield
    finally:
        os.chdir(before)
