"""Commands as another user gives them, without room, and with mistakes."""

from __future__ import annotations

import os
import shutil
from collections.abc import Sequence

from tests.validation.adversities.installation import MULTIPLIERS, RUN, STRANGER, command, place, told, warm

# -- another user, a closed installation, a full disk -------------------------------------------------------------------

COMMANDS = {"doctor": ("doctor",), "run": RUN, "identify": ("identify", "small.h5", "-m", "model.yaml"),
            "multipliers": MULTIPLIERS, "effects": ("effects",),
            "chart": ("chart", "model.yaml", "--speed", "3000:4000:11", "--depth", "1:3:5")}


def stranger(made: bool = False, **environment_: str) -> str:
    """Every command as a service account: no home, no name, nothing of the installation to be written to.

    made: its folder of compiled functions has most of them already.
    """
    without = [name for name in ("HOME", "TESTBED_CACHE", "XDG_CACHE_HOME") if name not in environment_]
    prefix = ("setpriv", f"--reuid={STRANGER}", f"--regid={STRANGER}", "--clear-groups",
              "--inh-caps=+dac_read_search", "--ambient-caps=+dac_read_search")  # it may read all: the interpreter is root's
    with place() as folder:
        folder.chmod(0o777)
        (folder / "tmp").mkdir()
        (folder / "tmp").chmod(0o1777)
        if made:
            own = folder / "tmp" / f"testbed-kernels-{STRANGER}"
            shutil.copytree(warm()[0], own)
            for path in (own, *own.iterdir()):
                os.chown(path, STRANGER, STRANGER)
        for name, one in COMMANDS.items():
            done = command(folder, one, prefix, without, TMPDIR=str(folder / "tmp"), **environment_)
            if done.returncode or told(done.stderr):
                return f"{name}: exit {done.returncode}: {done.stderr[-300:]!r}"
            if name == "doctor" and f"/tmp/testbed-kernels-{STRANGER}, yours alone" not in done.stdout:
                return f"doctor names no folder: {done.stdout[-300:]!r}"
    return ""


def no_room() -> str:
    """No file may grow: nothing is kept, and the answer is the same, with one line."""
    _, expected = warm()
    with place() as folder:
        done = command(folder, MULTIPLIERS, ("prlimit", "--fsize=1000"), TESTBED_CACHE=str(folder / "cache"))
        left = [path for path in (folder / "cache").rglob("*") if path.is_file() and path.stat().st_size]
    if done.returncode or len(told(done.stderr)) != 1 or done.stdout not in expected or left:
        return f"exit {done.returncode}: {done.stderr[-300:]!r}, {left} left"
    return ""


# -- what the command line library makes of a mistake ----------------------------------------------------------------------

MISTAKES = {"no such command": ("nosuch",), "no such option": ("run", "--nosuch"), "a missing argument": ("run",),
            "a missing option": ("chart", "model.yaml"), "a missing value": ("run", "small.yaml", "-o"),
            "no such choice": ("run", "small.yaml", "-o", "x.h5", "--engine", "nosuch"), "no number": ("doctor", "--json"),
            "one too many": ("doctor", "more"), "below its range": ("run", "small.yaml", "-o", "x.h5", "--workers", "0")}


def mistake(arguments: Sequence[str]) -> str:
    with place() as folder:
        done = command(folder, arguments)
    right = done.returncode == 2 and done.stderr.startswith("error: ") and done.stderr.count("\n") == 1 and not done.stdout
    return "" if right else f"exit {done.returncode}: {done.stderr[-300:]!r}"
