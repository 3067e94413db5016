"""The moves of the fit, a file each, and the schemes in which `solve` tries them.

A file of this folder that defines `MOVE` is a move of its name. Where no scheme names it, it is tried where NEW stands.
"""

from __future__ import annotations

import pkgutil
from collections.abc import Callable, Iterator
from functools import lru_cache
from importlib import import_module
from typing import TYPE_CHECKING, NamedTuple

from testbed.analysis.fit.evidence import excess

if TYPE_CHECKING:
    from testbed.analysis.fit.fit_state import WaveformFit
    from testbed.analysis.fit.solve import Goal, Move
    from testbed.analysis.fit.waveform import Fitter

NEW, NEW_QUICK = "every other move", "every other move that is quick"
SOME = 20.0  # gain in minus the log likelihood from which it is asked whether the cuts were elsewhere: by then it is an effect
HALVES = 0.5  # share of the excess that a candidate may leave for parts of passes to be looked for at once, not if it is named
HELPS = 0.95  # share of the cost that a candidate may leave for its scales to be looked for in other valleys too

When = Callable[["Fitter", "WaveformFit", "Goal"], bool]


def _always(fitter: Fitter, fit: WaveformFit, goal: Goal) -> bool:
    return True


def _is_kinked(fitter: Fitter, fit: WaveformFit, goal: Goal) -> bool:
    """Whether the last law has a kink, so that its valleys are narrow and bent."""
    return bool(goal.laws) and not goal.laws[-1].smooth


def _explains_some(fitter: Fitter, fit: WaveformFit, goal: Goal) -> bool:
    return fit.cost < goal.before - SOME


def _explains_half(fitter: Fitter, fit: WaveformFit, goal: Goal) -> bool:
    return excess(fitter, fit.cost) < HALVES * excess(fitter, goal.before)


def _helps(fitter: Fitter, fit: WaveformFit, goal: Goal) -> bool:
    return fit.cost < HELPS * goal.before


class Step(NamedTuple):
    """A move of a scheme. then: moves that are tried where it helped, since it hid what they look for. when: it is tried."""

    move: str
    then: Scheme = ()
    when: When = _always


Scheme = tuple["str | Step", ...]

# Cuts that begin and end within an arc, after the whole passes: judged in part, then those that are nearly whole
PARTS: Scheme = ("parts_of_passes", "nearly_whole", "beside_whole")
# The course of every cut: entries of all together, numbers of passes, parts of passes
COURSES: Scheme = ("entries_together", "pass_count", *PARTS)
# What the first teeth meet, and the courses: either may hide the other
FRONTS: Scheme = ("entry_history", *COURSES, Step("entry_history", COURSES))
# The full level, where all is begun from the prior: first what belongs to single records,
BASE: Scheme = ("best_half", "other_beginnings", *FRONTS, Step("lost_records", COURSES), "cut_elsewhere", NEW)
# then what the laws of the model need (samples at jumps hid what entries and exits a pass off leave); at last, what the
# campaign may state otherwise than it was: without an effect that is there, a fit may have leant on it
HYPOTHESES: Scheme = ("entry_history", "table_feed")
LAWS: Scheme = ("growing_window", "growing_decays", "other_decades", "prior_coefficients", "prior_structure", "quiet_records",
                "basin_hopping", Step("force_jumps", (*COURSES, "force_jumps")), "lengths", *HYPOTHESES)  # fmt: skip
# The quick level, where a candidate goes on from the fit that it extends: what its law needs, dear moves as it is worth them
QUICK: Scheme = ("lengths", Step("other_beginnings", when=_is_kinked), "entries_together", "pass_count",
                 Step("cut_elsewhere", when=_explains_some), NEW_QUICK)  # fmt: skip
WORTH_PARTS: Scheme = tuple(Step(move, when=_explains_half) for move in PARTS if isinstance(move, str))
WORTH_HOPPING: Scheme = (Step("basin_hopping", when=_helps),)
# A candidate that is named; and a fit that is told, its search over
NAMED: Scheme = ("force_jumps", *HYPOTHESES)
TOLD: Scheme = ("doubted_marks",)


@lru_cache(maxsize=1)
def every_move() -> dict[str, Move]:
    """The moves of this folder by name: read once."""
    names = sorted(one.name for one in pkgutil.iter_modules(__path__))
    return {name: import_module(f"{__name__}.{name}").MOVE for name in names}


def steps_of(scheme: Scheme) -> Iterator[tuple[Step, Move]]:
    """The steps of a scheme, each with its move: those that no scheme names where it has NEW, none that `every_move` lacks."""
    moves = every_move()
    for one in scheme:
        others = [name for name, move in moves.items() if name not in NAMES and (move.quick or one == NEW)]
        for step in map(Step, others) if one in (NEW, NEW_QUICK) else (one if isinstance(one, Step) else Step(one),):
            if step.move in moves:
                yield step, moves[step.move]


NAMES = {one.move if isinstance(one, Step) else one for one in (*BASE, *LAWS, *QUICK, *TOLD)} - {NEW, NEW_QUICK}
