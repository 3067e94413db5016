"""What holds while a function of the API works: one thread of linear algebra, as on the command line, and a watch."""

from __future__ import annotations

import os
import sys
import threading
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager

from testbed.api.watch import Progress, Watch, watch_of

THREADS = ("OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "OMP_NUM_THREADS")
_begun: list[str] = []  # names of variables set before numpy was there
_lock = threading.Lock()
_inside: list[ExitStack] = []  # one for every call under way, the first of which holds the limit


def one_thread_from_the_start() -> None:
    """For a process that has not loaded numpy yet: nothing needs to be limited later, which takes loading scipy."""
    for name in THREADS:
        os.environ.setdefault(name, "1")
    if "numpy" not in sys.modules:
        _begun[:] = [name for name in THREADS if os.environ[name] == "1"]


def home_for_pictures() -> None:
    """Give matplotlib a folder for what it keeps, where the user has no home to be written to."""
    if not os.access(os.path.expanduser("~"), os.W_OK):
        from testbed.system.kernel_cache import lodge_matplotlib

        lodge_matplotlib()


@contextmanager
def working(progress: Progress = None) -> Iterator[Watch]:
    """Within it linear algebra has one thread: with more, and with another number of them, the last digits would change.

    What the caller had is put back at the end of the last call under way.
    """
    home_for_pictures()
    with _lock:
        _inside.append(_inside[0] if _inside else _one_thread())
    try:
        yield watch_of(progress)
    finally:
        with _lock:
            limit = _inside.pop()
            if not _inside:
                limit.close()


def _one_thread() -> ExitStack:
    """The limit, which ends when it is closed; for processes that are begun meanwhile it stands in the environment."""
    stack = ExitStack()
    if len(_begun) == len(THREADS):
        return stack
    import scipy.linalg  # noqa: F401  # so that its own linear algebra is there to be limited
    from threadpoolctl import threadpool_limits

    stack.enter_context(threadpool_limits(1))
    given = {name: os.environ.get(name) for name in THREADS}
    os.environ.update(dict.fromkeys(THREADS, "1"))
    stack.callback(_put_back, given)
    return stack


def _put_back(given: dict[str, str | None]) -> None:
    for name, value in given.items():
        if value is None:
            os.environ.pop(name, None)
        else:
            os.environ[name] = value
