"""Independent work in processes: begun once in each, faults and deaths are the caller's, and Ctrl-C leaves none behind."""

import math
import multiprocessing
import os
import signal
import subprocess
import sys
import time
from contextlib import closing
from functools import partial
from pathlib import Path

import pytest

from testbed.system.processes import WorkerDied, as_done_in_processes
from testbed.system.threads import ordered

begun: list[int] = []


def begin(number):
    begun.append(number)


def begun_here(item):
    return item, tuple(begun), os.getpid()


def die(item):
    os.kill(os.getpid(), signal.SIGKILL)


def test_every_process_begins_once_and_all_items_come_back():
    found = list(ordered(as_done_in_processes(begun_here, range(7), 2, partial(begin, 3))))
    assert [item for item, _, _ in found] == list(range(7))
    assert {told for _, told, _ in found} == {(3,)}
    pids = {pid for _, _, pid in found}
    assert os.getpid() not in pids and 1 <= len(pids) <= 2
    assert not multiprocessing.active_children()


def test_what_one_raises_reaches_the_caller_and_a_death_is_told():
    with pytest.raises(ValueError, match="math domain"):
        list(ordered(as_done_in_processes(math.sqrt, [4.0, -1.0, 9.0], 2)))
    with pytest.raises(WorkerDied):
        list(ordered(as_done_in_processes(die, [1], 2)))
    assert not multiprocessing.active_children()


def test_those_at_work_are_ended_when_it_is_given_up():
    since = time.monotonic()
    with closing(as_done_in_processes(time.sleep, [0.0, 60.0, 60.0], 2)) as done:
        assert next(done)[:2] == (0, None)
    assert time.monotonic() - since < 30.0 and not multiprocessing.active_children()


STRUCK = """
import faulthandler, sys
from testbed.system.processes import as_done_in_processes
from testbed.system.threads import ordered
from tests.support.struck import struck_at

if __name__ == "__main__":
    for step in range(int(sys.argv[1]), 400, 13):
        faulthandler.dump_traceback_later(60, exit=True)
        if struck_at(step, lambda: list(ordered(as_done_in_processes(abs, range(3), 2)))) is None:
            break
    print(step)
"""


def test_ctrl_c_at_many_a_line_ends_it(tmp_path):
    """What strikes in a finaliser is printed and dropped here; a command raises it once more."""
    (tmp_path / "struck.py").write_text(STRUCK)
    here = os.environ | {"PYTHONPATH": str(Path(__file__).resolve().parents[2])}
    run = subprocess.run([sys.executable, "struck.py", "5"], cwd=tmp_path, env=here, capture_output=True, text=True,
                         timeout=300)
    assert run.returncode == 0 and "Timeout" not in run.stderr
    assert 50 < int(run.stdout) < 399
