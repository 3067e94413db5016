"""The one loop of the fit: try the moves of a scheme, keep what lowers the cost, go on from there.

A sum of squares has many valleys, and a descent ends in one of them. A move proposes a fit in another; whether it is kept is
decided here, by one rule for all (variable neighbourhood descent).

Source: N. Mladenovic and P. Hansen (1997), Variable neighborhood search, Computers & Operations Research 24, 1097.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from typing import NamedTuple

from testbed.analysis.fit.fit_state import State, WaveformFit
from testbed.analysis.fit.moves import Scheme, steps_of
from testbed.analysis.fit.observed import Observed
from testbed.analysis.fit.pass_search import settle_passes
from testbed.analysis.fit.waveform import Fitter
from testbed.effect import Effect
from testbed.machine import Model

SHARE, UNIT = 1e-5, 1.0  # of the cost, and in minus the log likelihood: what a converged fit may still gain in its valley
SAME = 1e-4  # share of the cost by which two fits of one valley may differ that began apart
FURTHER = 60  # iterations more of a fit that has not converged


@dataclass(frozen=True)
class Goal:
    """What a solve is for.

    laws: the effects of the model, that added last at the end; prior: the model before any fit. cost_limit: the cost above
    which a fit is of no use and left alone; patient: moves that rescue are tried above it. known: the cost of a fit at hand,
    whose valley is left alone. before: the cost without the last law; infinite where all were fitted from the prior.
    rounds, iterations: of the descents that moves begin, see `alternate_fit_and_passes`. records: as they were before any fit.
    """

    laws: tuple[Effect, ...] = ()
    prior: Model | None = None
    cost_limit: float = math.inf
    patient: bool = False
    known: float = math.nan
    before: float = math.inf
    rounds: int = 4
    iterations: int = 40
    records: tuple[Observed, ...] = ()


PLAIN = Goal()


class Trial(NamedTuple):
    """A fit that a move proposes, and its fitter.

    departures: by how many its reading of the records departs more from the plainest one; negative where it is the plainer.
    """

    fitter: Fitter
    fit: WaveformFit
    departures: int = 1


@dataclass(frozen=True)
class Move:
    """A way out of a valley: `propose(fitter, fit, goal)` gives trials, or none; the first that is kept counts.

    worth: what a departure must save, in minus the log likelihood at the noise that is left. repeats: times it is asked again
    while it helps. finish: iterations that follow a trial which is kept and has not converged. incomparable: what is counted
    is another then, and the trial is kept whatever it costs. rescues: see `Goal.patient`. quick: a move that no scheme names
    belongs to the quick level, too.
    """

    propose: Callable[[Fitter, WaveformFit, Goal], Iterable[Trial]]
    worth: float = 0.0
    repeats: int = 1
    finish: int = 0
    incomparable: bool = False
    rescues: bool = False
    quick: bool = False


def solve(fitter: Fitter, fit: WaveformFit, scheme: Scheme, goal: Goal = PLAIN) -> tuple[Fitter, WaveformFit]:
    """The fit after the moves of a scheme, and its fitter; `fit.helped` names those that helped, in their order.

    A fit that begins in a known valley stays there; one that comes to it on its way may leave it again.
    """
    return (fitter, fit) if arrived(fit, goal.known) else _tried(fitter, fit, scheme, goal)


def _tried(fitter: Fitter, fit: WaveformFit, scheme: Scheme, goal: Goal) -> tuple[Fitter, WaveformFit]:
    for step, move in steps_of(scheme):
        too_high = fit.cost > goal.cost_limit and not (goal.patient and move.rescues)
        if too_high or not step.when(fitter, fit, goal):
            continue
        before = fit
        for _ in range(move.repeats):
            kept = next((one for one in move.propose(fitter, fit, goal) if accepted(move, one, fit)), None)
            if kept is None:
                break
            fitter, fit = kept.fitter, replace(_finished(move, kept), helped=(*fit.helped, step.move))
        if fit is not before:
            fitter, fit = _tried(fitter, fit, step.then, goal)
    return fitter, fit


def accepted(move: Move, trial: Trial, fit: WaveformFit) -> bool:
    """Whether a trial is kept: it costs less, by more than a converged fit may still gain and what its departures must save.

    A plainer one may cost more, by up to that.
    """
    noise = max(1.0, min(fit.variance, trial.fit.variance))
    least = trial.departures * move.worth * noise + (least_gain(fit) if trial.departures >= 0 else 0.0)
    return move.incomparable or fit.cost - trial.fit.cost > least


def least_gain(fit: WaveformFit) -> float:
    """By how much another valley must be deeper than a fit's to count as another."""
    return SHARE * fit.cost + UNIT


def _finished(move: Move, kept: Trial) -> WaveformFit:
    if kept.fit.converged or not move.finish:
        return kept.fit
    return kept.fitter.fit(kept.fit.state, iterations=move.finish, near=kept.fit)


def arrived(fit: WaveformFit, known: float) -> bool:
    """Whether a fit has come to the cost of one that is known, and so to its valley: what follows was done there."""
    return abs(fit.cost - known) <= SAME * known


def alternate_fit_and_passes(
    fitter: Fitter, state: State, *, rounds: int = 4, iterations: int = 40, cost_limit: float = math.inf
) -> WaveformFit:
    """Fit and put entry and exit passes right in turn, until they stay, or it would not come to the cost that is the goal."""
    state, _ = settle_passes(fitter, state)
    fit = fitter.fit(state, iterations=iterations, cost_limit=cost_limit)
    for _ in range(rounds - 1):
        if fit.cost > cost_limit:
            break
        state, moved = settle_passes(fitter, fit.state)
        if not moved:
            break
        fit = fitter.fit(state, iterations=iterations, cost_limit=cost_limit)
    return fit


def to_its_end(fitter: Fitter, fit: WaveformFit) -> WaveformFit:
    """The fit, gone on with where it has not converged: along a narrow valley values are yet far off."""
    return fit if fit.converged else replace(fitter.fit(fit.state, iterations=FURTHER), helped=fit.helped)
