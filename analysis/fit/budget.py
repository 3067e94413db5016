"""A budget of simulations, counted and not timed, so that the same files give the same answer on any machine."""

from __future__ import annotations

import threading
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:  # a command tells the default before anything heavy is imported
    import numpy as np

    from testbed.analysis.fit.identifiable import Identifiable
    from testbed.analysis.fit.observed import Observed
    from testbed.analysis.fit.prediction import Engine

BUDGET = 100_000  # simulations of every record: a fit of the base model takes some thousands, a long search tens of them
SHOWN = 500  # simulations of every record, between two signs of life


class BudgetSpent(Exception):
    """The simulations that were allowed are done. steps, seen: what a search had found by then."""

    steps: tuple[Any, ...] = ()
    seen: tuple[Any, ...] = ()


class Budgeted:
    """An engine that simulates no more than it may: in units of one simulation of every record, counted by samples.

    A step that would overrun is given up in the midst of its threads; what was known before it stays known, so that threads
    change nothing. known: the fit of the base model, once it is had. told: what the records tell of its parameters, if that
    is at hand.
    """

    def __init__(self, engine: Engine, records: Sequence[Observed], budget: float,
                 progress: Callable[[str], None] = lambda text: None, told: Identifiable | None = None) -> None:  # fmt: skip
        self.engine, self.budget, self._whole, self._say, self.told = engine, budget, budget, progress, told
        self.known: Any = None
        self._all = max(1, sum(record.samples for record in records))
        self._spent, self._told, self._lock = 0, 0.0, threading.Lock()

    @property
    def spent(self) -> float:
        """Simulations of every record until now."""
        return self._spent / self._all

    def allow(self, more: float) -> None:
        """Allow no more than so many simulations from here on."""
        self.budget = min(self.budget, self.spent + more)

    def allow_all(self) -> None:
        """Allow as many again as there were to begin with."""
        self.budget = self._whole

    def predict_cuts(self, models: Sequence[Any], cuts: Sequence[Any], samplings: Sequence[Any], channels: Sequence[str],
                     **more: Any) -> np.ndarray:  # fmt: skip
        """As the engine's, counted."""
        self._count(len(models) * samplings[0].count * more.get("refinement", 1))
        return self.engine.predict_cuts(models, cuts, samplings, channels, **more)

    def predict_driven(self, models: Sequence[Any], states: Sequence[Any], force: np.ndarray, *rest: Any,
                       **more: Any) -> np.ndarray:  # fmt: skip
        """As the engine's, counted."""
        self._count(len(models) * len(force) * more.get("refinement", 1))
        return self.engine.predict_driven(models, states, force, *rest, **more)

    def _count(self, samples: int) -> None:
        with self._lock:
            self._spent += samples
            spent, told = self.spent, self._told
            if spent > told + SHOWN:
                self._told = spent
        if spent > self.budget:
            raise BudgetSpent(f"{self.budget:.0f} simulations of every record")
        if spent > told + SHOWN:
            self._say(f"{spent:,.0f} of {self.budget:,.0f} simulations")
