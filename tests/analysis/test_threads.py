"""Independent work on threads comes back in order, and an exception of one is the caller's."""

import threading

import pytest

from analysis.threads import WORKERS, threaded


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
