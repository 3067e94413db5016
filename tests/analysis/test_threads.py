"""Independent work on threads comes back in order, and an exception of one is the caller's."""

import threading
import time

import pytest

from testbed.analysis.threads import WORKERS, threaded


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
