"""Who watches long work: a notebook, a function of the caller's, nobody; and a text without its package."""

import sys
from types import ModuleType, SimpleNamespace

import pytest

import testbed
from testbed.api import watch
from testbed.api.watch import Bars, Called, Notebook, Watch, watch_of
from testbed.problem import optional


@pytest.fixture
def cell(monkeypatch):
    """What a notebook's cell shows, one after the other."""
    shown = []

    def display(content, raw, display_id):
        assert raw and display_id
        shown.append(content["text/html"])
        return SimpleNamespace(update=lambda content, raw: shown.append(content["text/html"]))

    shell = {"get_ipython": lambda: SimpleNamespace(kernel="one")}
    names = {"IPython": {}, "IPython.core": {}, "IPython.core.getipython": shell, "IPython.display": {"display": display}}
    for name, inside in names.items():
        module = ModuleType(name)
        vars(module).update(inside)
        monkeypatch.setitem(sys.modules, name, module)
    return shown


def test_a_notebook_shows_a_bar_that_goes_when_the_work_is_done(cell):
    shown = watch_of(None)
    assert isinstance(shown, Notebook)
    with shown.counted("runs < all") as show:
        for done in range(1001):
            show(done, 1000)
    assert cell[1] == "runs &lt; all <progress value=0 max=100></progress>" and cell[-1] == ""
    assert len(cell) == 102  # however many steps there are
    with shown.busy("fitting") as progress:
        progress("and again")
    assert cell[-3:] == ["fitting", "and again", ""]


def test_without_a_notebook_a_terminal_is_watched_and_false_is_silence(monkeypatch, capsys):
    monkeypatch.delitem(sys.modules, "IPython", raising=False)
    assert type(watch_of(None)) is type(watch_of(True)) is Bars and type(watch_of(False)) is Watch
    mine = Called(print)
    assert watch_of(mine) is mine
    for one in (watch_of(None), watch_of(False)):
        with one.counted("runs") as show, one.busy("fitting") as progress:
            show(1, 2)
            progress("more")
    assert capsys.readouterr() == ("", "")  # a pipe, into which short work says nothing


def test_in_a_pipe_long_work_says_a_line_now_and_then(monkeypatch, capsys):
    now = [0.0]
    monkeypatch.setattr(watch.time, "monotonic", lambda: now[0])
    with Bars().counted("Simulating", "runs") as show, Bars().busy("Diagnosing") as say:
        for second in range(1, 70):
            now[0] = float(second)
            show(second, 100)
            say(f"step {second}")
    assert capsys.readouterr() == ("", "Simulating: 30 of 100 runs (30 s)\nstep 30 (30 s)\n"
                                       "Simulating: 60 of 100 runs (60 s)\nstep 60 (60 s)\n")  # fmt: skip


def test_a_package_that_is_not_there_is_told(monkeypatch):
    monkeypatch.setitem(sys.modules, "pandas", None)
    with pytest.raises(testbed.InputProblem, match="pandas: is not installed: pip install pandas"):
        optional("pandas")
