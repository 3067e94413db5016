"""How a command ends: each signal at each moment, once and twice, to the whole group as a terminal sends it or to one process.

As asked: exit code 130 and one line that begins with `interrupted`, whatever comes after the first; no crash, no trace of the
interpreter, nothing under a temporary name and no worker left behind.
"""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from testbed.system.interruption import SAME_PRESS_S
from tests.validation.adversities.installation import ROOT, Probe, place, told, warm

LONGEST_S = 60.0  # for an end, on a busy machine with the compiler at work
Ready = Callable[[Path, float], bool]  # of the folder and the seconds since the start


@dataclass(frozen=True)
class Moment:
    """What is under way. ready: the moment has come; cold: nothing was compiled before."""

    arguments: Sequence[str]
    ready: Ready
    cold: bool = False


def _after(seconds: float) -> Ready:
    return lambda _, passed: passed > seconds


def _there(pattern: str) -> Ready:
    return lambda folder, _: any(folder.glob(pattern))


SWEEP = ("run", "many.yaml", "-o", "many.h5", "--engine", "fast")
CHART = ("chart", "model.yaml", "--speed", "2000:4500:2001", "--depth", "0.1:4:1001")
DIAGNOSE = ("diagnose", "campaign.yaml", "-m", "model.yaml", "-o", "report")
MOMENTS = {
    "while it starts": Moment(SWEEP, _after(0.35)),
    "soon after": Moment(SWEEP, _after(1.5)),
    "while it compiles": Moment(SWEEP, _after(4.0), cold=True),
    "in a sweep": Moment(SWEEP, _there("many.h5.parts/runs-*.h5")),
    "in a sweep on threads": Moment((*SWEEP, "--workers", "2"), _there("many.h5.parts/runs-*.h5")),
    "in a sweep on processes": Moment((*SWEEP, "--workers", "2", "--processes"), _there("many.h5.parts/runs-*.h5")),
    "while processes start": Moment((*SWEEP, "--workers", "2", "--processes"), _there("many.h5.parts")),
    "while a shard is written": Moment(SWEEP, _there("many.h5.parts/.*.part")),
    "in a chart": Moment(CHART, _after(3.0)),
    "in a diagnosis": Moment(DIAGNOSE, _after(6.0)),
}  # fmt: skip


def _campaign(folder: Path) -> None:
    """Four cuts in which an effect is hidden."""
    from testbed.engines import fast
    from testbed.workshop import write_campaign
    from tests.support.campaign_files import BELIEVED, TRUE
    from tests.support.synthetic_campaign import synthetic_campaign

    true = TRUE.with_effect("process_damping", coefficient=6e5)
    write_campaign(folder, synthetic_campaign(partial(fast.simulate, steps=37), true, seed=4, rate=6400.0, course=(10, 35, 15),
                                              tests=((3810, 2.9), (2850, 2.9), (4200, 1.5), (2600, 1.5))), BELIEVED)


def _listening() -> None:
    """A shell's background job ignores Ctrl-C, and so would what it starts."""
    for one in (signal.SIGINT, signal.SIGHUP):
        signal.signal(one, signal.SIG_DFL)


def _alive(group: int) -> bool:
    """Whether a process of the group still runs, a moment later."""
    for _ in range(100):
        try:
            os.killpg(group, 0)
        except ProcessLookupError:
            return False
        time.sleep(0.1)
    return True


def _struck(moment: Moment, signals: Sequence[tuple[signal.Signals, float]], all_of_them: bool = True) -> str:
    """The signals, each so many seconds after the one before."""
    with place() as folder:
        if moment.arguments[0] == "diagnose":
            _campaign(folder)
        kernels = folder / "cache" if moment.cold else warm()[0].parent
        process = subprocess.Popen([sys.executable, "-m", "testbed", *moment.arguments], cwd=folder, text=True,
                                   stdout=subprocess.PIPE, stderr=subprocess.PIPE,
                                   start_new_session=True, preexec_fn=_listening,
                                   env={**os.environ, "PYTHONPATH": str(ROOT), "TESTBED_CACHE": str(kernels)})
        began = time.monotonic()
        while process.poll() is None and not moment.ready(folder, time.monotonic() - began):
            time.sleep(0.002)
        for one, later in signals:
            time.sleep(later)
            with suppress(ProcessLookupError):
                os.killpg(process.pid, one) if all_of_them else process.send_signal(one)
        try:
            _, said = process.communicate(timeout=LONGEST_S)
        except subprocess.TimeoutExpired:
            os.killpg(process.pid, signal.SIGKILL)
            process.communicate()
            return f"no end within {LONGEST_S:g} s"
        left = [path.name for path in folder.rglob("*.part")]
        if _alive(process.pid):
            os.killpg(process.pid, signal.SIGKILL)
            left.append("a worker")
    lines = told(said)
    if process.returncode != 130 or len(lines) != 1 or not lines[0].startswith("interrupted") or left:
        return f"exit {process.returncode}: {said[-400:]!r}, left: {left}"
    return ""


def _ignored() -> str:
    """What nohup has set stays: a command goes on without its terminal."""
    with place() as folder:
        process = subprocess.Popen([sys.executable, "-m", "testbed", "run", "small.yaml", "-o", "small.h5", "--engine", "fast"],
                                   cwd=folder, text=True, stdout=subprocess.PIPE, stderr=subprocess.PIPE,
                                   preexec_fn=lambda: signal.signal(signal.SIGHUP, signal.SIG_IGN),
                                   env={**os.environ, "PYTHONPATH": str(ROOT), "TESTBED_CACHE": str(warm()[0].parent)})
        for _ in range(5):
            time.sleep(0.3)
            process.send_signal(signal.SIGHUP)
        _, said = process.communicate(timeout=LONGEST_S)
        whole = (folder / "small.h5").exists()
    return "" if process.returncode == 0 and whole else f"exit {process.returncode}: {said[-300:]!r}"


def probes() -> list[Probe]:
    """Every moment with every signal; Ctrl-C twice at once, soon and late, and thrice; a SIGTERM after Ctrl-C."""
    interrupt, late = signal.SIGINT, SAME_PRESS_S + 0.3
    found = [Probe(f"{one.name} {name}", partial(_struck, moment, [(one, 0.0)]))
             for name, moment in MOMENTS.items() for one in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)]
    for name, moment in MOMENTS.items():
        found += [Probe(f"Ctrl-C twice within {gap:g} s {name}", partial(_struck, moment, [(interrupt, 0.0), (interrupt, gap)]))
                  for gap in (0.0, 0.05, 0.4, late)]
    sweep = MOMENTS["in a sweep on threads"]
    found += [Probe("Ctrl-C five times in a sweep", partial(_struck, sweep, [(interrupt, 0.3)] * 5)),
              Probe("SIGTERM after Ctrl-C in a sweep", partial(_struck, sweep, [(interrupt, 0.0), (signal.SIGTERM, late)])),
              Probe("Ctrl-C to the sweep's own process alone",
                    partial(_struck, MOMENTS["in a sweep on processes"], [(interrupt, 0.0)], all_of_them=False)),
              Probe("SIGHUP under nohup", _ignored)]
    return found
