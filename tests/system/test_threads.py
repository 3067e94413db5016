"""Independent work on threads comes back in order, and an exception of one is the caller's."""

import subprocess
import sys
import threading
import time
from contextlib import closing

import pytest

from testbed.system.threads import WORKERS, in_order, threaded


def test_results_come_in_the_order_of_the_items_whoever_ends_first():
    first = threading.Event()

    def later_first(item):
        if item == 0:
            assert first.wait(10.0)
        else:
            first.set()
        return item * item

    assert WORKERS >= 2 and threaded(later_first, range(6)) == (0, 1, 4, 9, 16, 25)
    assert threaded(later_first, []) == ()


def test_what_one_raises_reaches_the_caller():
    with pytest.raises(ZeroDivisionError):
        threaded(lambda item: 1 // item, [1, 0, 2])


def test_where_one_fails_the_others_end_at_their_next_item():
    begun, done = threading.Event(), []

    def inner(item):
        begun.set()
        time.sleep(0.002)
        done.append(item)

    def outer(item):
        if item == 0:
            assert begun.wait(10.0)
            raise RuntimeError("the first")
        return threaded(inner, range(5000))

    with pytest.raises(RuntimeError, match="the first"):
        threaded(outer, range(2))
    assert 0 < len(done) < 4000
    assert threaded(abs, [-1, 2]) == (1, 2)  # and what is begun after it is not stopped


def test_a_failure_that_is_caught_stops_nothing():
    def outer(item):
        try:
            return threaded(lambda number: 1 // number, [item])
        except ZeroDivisionError:
            return threaded(abs, [-7])

    assert threaded(outer, [0, 1, 0]) == ((7,), (1,), (7,))


def test_what_is_asked_for_in_order_comes_in_order_and_few_are_taken_ahead():
    taken = []

    def coming():
        for number in range(40):
            taken.append(number)
            yield number

    with closing(in_order(lambda number: -number, coming(), 2, 5)) as results:
        for number, result in enumerate(results):
            assert result == -number and len(taken) <= number + 1 + 2 * 5
    assert len(taken) == 40


STRUCK = """
import faulthandler, time
from contextlib import closing
from testbed.system.threads import threaded, in_order
from tests.support.struck import struck_at

def ordered():
    with closing(in_order(abs, range(6), 2, 3)) as results:
        return list(results)

for work in (lambda: threaded(time.sleep, [0.001] * 4), ordered):
    step, struck = 1, True
    while struck is not None:
        faulthandler.dump_traceback_later(20, exit=True)
        struck = struck_at(step, work)
        step += 1
    print(step)
"""


def test_ctrl_c_at_any_line_ends_it_and_nothing_waits_for_ever():
    """With concurrent.futures, some of these lines leave a lock taken: another error comes of it, or no end."""
    run = subprocess.run([sys.executable, "-c", STRUCK], capture_output=True, text=True, timeout=120)
    assert run.returncode == 0 and run.stderr == ""
    assert all(int(steps) > 50 for steps in run.stdout.split())
