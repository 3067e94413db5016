"""An installation among other users, damage and signals: the quick adversities, and some slow ones with `make long`."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from testbed.system import interruption, kernel_cache
from tests.validation.adversities import endings, installation

QUICK = {probe.name: probe for probe in installation.probes() if probe.quick}
SLOW = {probe.name: probe for probe in (*installation.probes(), *endings.probes()) if not probe.quick}
OFTEN = [name for name in SLOW if name in ("all compiled functions: a bit flipped at 50%", "a user without HOME",
                                           "no room for compiled functions", "SIGHUP under nohup")
         or name.endswith(("in a sweep on threads", "in a diagnosis"))]


@pytest.mark.parametrize("name", QUICK)
def test_a_quick_adversity_is_answered_as_asked(name):
    assert QUICK[name].act() == ""


@pytest.mark.long
@pytest.mark.parametrize("name", OFTEN)
def test_a_slow_adversity_is_answered_as_asked(name):
    assert SLOW[name].act() == ""


def test_every_compiled_function_is_kept_in_the_one_folder():
    """numba's own keeping, beside the sources or in a folder of its own choice, is used nowhere."""
    root = Path(kernel_cache.__file__).parents[2]
    sources = [path for package in ("testbed", "analysis", "models", "scenarios") for path in (root / package).rglob("*.py")]
    assert len(sources) > 100
    assert not [path.name for path in sources if "cache=True" in path.read_text() and path.name != "kernel_cache.py"]


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.setenv("TESTBED_CACHE", str(tmp_path))
    kernel_cache.cache_folder.cache_clear()
    yield kernel_cache.cache_folder()
    kernel_cache.cache_folder.cache_clear()


def _square(x):
    return x * x


def test_a_function_is_kept_for_its_types_and_read_again(folder):
    first = kernel_cache.kept(_square)
    assert first(3.0) == 9.0 and first(3) == 9 and len(list(folder.iterdir())) == 2
    again = kernel_cache.kept(_square)
    assert again(3.0) == 9.0 and again(3) == 9 and sum(again.stats.cache_hits.values()) == 2
    assert again(np.float32(3.0)) == 9.0 and sum(again.stats.cache_misses.values()) == 1
    assert len(list(folder.iterdir())) == 3


def test_what_a_function_calls_is_part_of_what_it_is_kept_under(folder, tmp_path):
    """A source beside it that changes makes the compiled function another: it was compiled in."""
    (tmp_path / "inner_part.py").write_text("from numba import njit\n@njit\ndef inner(x):\n    return x + 1.0\n")
    (tmp_path / "outer_part.py").write_text("from testbed.system.kernel_cache import kept\nfrom inner_part import inner\n"
                                            "@kept\ndef outer(x):\n    return inner(x)\n")
    asked = [sys.executable, "-c", "from outer_part import outer; print(outer(1.0))"]
    path = os.pathsep.join([str(tmp_path), str(Path(kernel_cache.__file__).parents[2])])

    def answer():
        return subprocess.run(asked, capture_output=True, text=True, check=True, env={**os.environ, "PYTHONPATH": path,
                                                                                      "PYTHONDONTWRITEBYTECODE": "1"}).stdout

    assert answer() == answer() == "2.0\n" and len(list(folder.iterdir())) == 1
    (tmp_path / "inner_part.py").write_text("from numba import njit\n@njit\ndef inner(x):\n    return x + 2.0\n")
    assert answer() == "3.0\n" and len(list(folder.iterdir())) == 2


@pytest.fixture
def struck(monkeypatch):
    """Signals answered by the command line's handler; the codes that the process would have ended with at once."""
    ended = []
    monkeypatch.setattr(interruption, "_exit", ended.append)
    before = {one: signal.signal(one, signal.SIG_DFL) for one in interruption._SIGNALS}
    signal.signal(signal.SIGINT, signal.default_int_handler)
    restore = interruption.listen()
    yield ended
    restore()
    for one, handler in before.items():
        signal.signal(one, handler)


@pytest.mark.parametrize("one", interruption._SIGNALS)
def test_the_first_signal_interrupts_one_soon_after_is_the_same_and_a_late_one_ends_at_once(struck, one, monkeypatch, capfd):
    with pytest.raises(KeyboardInterrupt):
        signal.raise_signal(one)
    assert interruption.interrupted() and not struck
    signal.raise_signal(one)
    assert not struck
    monkeypatch.setattr(interruption, "SAME_PRESS_S", -1.0)
    with pytest.raises(KeyboardInterrupt):  # where a process would have ended
        signal.raise_signal(one)
    assert struck == [130] and capfd.readouterr().err == "interrupted\n"


def test_an_end_at_once_removes_what_is_unfinished(struck, monkeypatch, tmp_path, capfd):
    from testbed.system.atomic import replacing

    monkeypatch.setattr(interruption, "SAME_PRESS_S", -1.0)
    with pytest.raises(KeyboardInterrupt):
        signal.raise_signal(signal.SIGINT)
    with pytest.raises(KeyboardInterrupt), replacing(tmp_path / "whole") as temporary:
        assert list(tmp_path.iterdir()) == [temporary]
        monkeypatch.setattr(interruption, "_exit", lambda code: struck.append((code, list(tmp_path.iterdir()))))
        signal.raise_signal(signal.SIGINT)
    assert struck == [(130, [])] and not interruption.unfinished


def test_an_interruption_that_the_interpreter_drops_is_raised_once_more(struck):
    class Finaliser:
        def __del__(self):
            signal.raise_signal(signal.SIGINT)

    with pytest.raises(KeyboardInterrupt):
        Finaliser()  # gone at once: what its end raises is dropped
        time.sleep(20.0)
    assert not struck
