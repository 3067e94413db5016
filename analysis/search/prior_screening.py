"""A look at every effect alone from the believed machine, which no fit of a wrong model has bent.

The fit of the base model has already made up for a strong effect (an immersion far off by the cutting coefficients and the
tooth's angle), so that from there another effect may seem the strongest.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from functools import cached_property

from testbed.analysis.fit.effect_start import all_free, applicable, effect_parameters
from testbed.analysis.fit.fit_state import FreeParameter
from testbed.analysis.fit.held_out import pooled
from testbed.analysis.fit.starts import glance, opening_fit
from testbed.analysis.fit.structure_start import structure_start
from testbed.analysis.search.candidate import Candidate
from testbed.analysis.search.diagnosis import COMPLETE
from testbed.analysis.search.refit_from_prior import explaining, from_believed, with_examples
from testbed.analysis.search.score_test import shifts_in_time
from testbed.effect import Effect
from testbed.machine import Model
from testbed.system.threads import threaded

LIKELY = 4  # effects whose openings are fitted from several starts
RIVAL = 1.2  # times the cost of the openings with the best effect, up to which another may explain the records as well


class PriorScreening:
    """The believed machine with effects at their examples, fitted to the records of the base fit; nothing is fitted twice."""

    def __init__(self, base: Candidate, model: Model, catalogue: Mapping[str, Effect], progress: Callable[[str], None]) -> None:
        self.base, self.model, self.catalogue, self.say = base, model, catalogue, progress
        self.engine, self.records = base.fitter.engine, base.fitter.records
        self._costs: dict[tuple[str, ...], float] = {}
        self._fits: dict[tuple[str, ...], Candidate] = {}
        self._alone: tuple[Candidate, ...] | None = None
        self._turned: set[str] = set()  # effects that explain more on the other side of neutral than their example is on

    @cached_property
    def every(self) -> tuple[str, ...]:
        """Effects that a search could begin with, but for those whose phase every record has for itself.

        What recurs in time bends no coefficient that a cut is entered with. None where nothing is cut.
        """
        cut = any(record.cut is not None for record in self.records)
        present = set(self.model.effects)
        return tuple(
            name
            for name, effect in self.catalogue.items()
            if cut and name not in present and applicable(effect, self.records, present)
            and effect.parameters and not any(one.each_record for one in effect.parameters)
        )  # fmt: skip

    @cached_property
    def _likely(self) -> list[str]:
        """Effects that explain most of the openings, the best first."""
        if not self.every:
            return []
        self.say("much is left: looking at every effect from the believed machine")
        costs = dict(zip(self.every, threaded(self._glanced, self.every), strict=True))
        likely = sorted(self.every, key=lambda name: costs[name])[:LIKELY]
        self._open([(name,) for name in likely[1:]], RIVAL * self.opened(likely[0]))
        return sorted(likely, key=self.opened)

    @property
    def leader(self) -> str | None:
        """The effect whose openings are explained best; None where none can be asked about."""
        return self._likely[0] if self._likely else None

    @cached_property
    def _started(self) -> Model:
        return structure_start(self.records, self.model)

    def _begun(self, names: Sequence[str]) -> tuple[Model, list[FreeParameter]]:
        """The believed machine with these effects, its structure as free decays show it; and what is unknown of it."""
        if self.model.structure.planar and isinstance(self.base, Candidate):  # what these records do not tell is held
            own = [free for name in names for free in effect_parameters(self.catalogue[name], self.records)]
            return with_examples(self._started, names, self.catalogue, self._turned), [*self.base.fitter.unknowns, *own]
        free = all_free(self.records, with_examples(self.model, names, self.catalogue), self.catalogue)
        return with_examples(self._started, names, self.catalogue, self._turned), free

    def _glanced(self, name: str) -> float:
        """The cost of a short fit, on the side of neutral on which it is less."""
        self.say(f"{name} from the believed machine")
        cost = glance(self.engine, self.records, *self._begun([name]))
        if self.catalogue[name].other_side() is None:
            return cost
        self._turned.add(name)
        other = glance(self.engine, self.records, *self._begun([name]))
        if not other < cost:
            self._turned.discard(name)
        return min(cost, other)

    def opened(self, *names: str) -> float:
        """The cost of a fit of these effects to the openings, from several starts."""
        if names not in self._costs:
            self._costs[names] = self._opening(names, math.inf)
        return self._costs[names]

    def _opening(self, names: Sequence[str], cost_limit: float) -> float:
        self.say(f"{' and '.join(names)} from the believed machine, the openings")
        return opening_fit(self.engine, self.records, *self._begun(names), cost_limit=cost_limit).cost

    def _open(self, sets: Sequence[tuple[str, ...]], cost_limit: float) -> None:
        """Open sets of effects; those that do not come to the goal are given up above it."""
        self._costs |= dict(zip(sets, threaded(lambda names: self._opening(names, cost_limit), sets), strict=True))

    def fitted(self, *names: str) -> Candidate:
        """These effects fitted to the whole records; their gain in BIC counts as none."""
        found = self._fitted(names, math.inf)
        assert found is not None
        return found

    def _fitted(self, names: tuple[str, ...], cost_limit: float) -> Candidate | None:
        """The same, or None where the fit was given up above its goal."""
        if names not in self._fits:
            self.say(f"fitting {' and '.join(names)} from the believed machine")
            found = from_believed(self.engine, self.records, self.model, names, self.catalogue, cost_limit, self._turned)
            if found.fit.cost > cost_limit:
                return None
            self._fits[names] = found
        return self._fits[names]

    def alone(self) -> tuple[Candidate, ...]:
        """The leader, if it leaves hardly more than noise, and what explains the openings nearly as well."""
        if self._alone is None:
            self._alone = self._complete() if self.leader is not None else ()
        return self._alone

    def gave(self, names: tuple[str, ...]) -> bool:
        """Whether `alone` was asked, and these are the effects of one of those it gave."""
        return any(one.effects == names for one in self._alone or ())

    def _complete(self) -> tuple[Candidate, ...]:
        first, *others = self._likely
        cost_limit, close = explaining(self.records, self.base.fit.state), RIVAL * self.opened(first)
        found = self.fitted(first)  # to its end: passes, and what the first teeth meet, are found last
        if found.error_where_known > COMPLETE * pooled(self.base.errors)[1]:
            return ()
        rivals = [self._fitted((name,), cost_limit) for name in others if self.opened(name) <= close]
        return (found, *(one for one in rivals if one is not None))

    def beside_leader(self) -> dict[str, float]:
        """Per other effect, the cost of the openings with the leader and it; not for what shifts the records in time.

        None is given up early: of an entry that is gradual the passes are put right only in the end.
        """
        assert self.leader is not None
        self.say(f"much is left: looking at every effect together with {self.leader}")
        others = [name for name in self.every if name != self.leader and not shifts_in_time(self.catalogue[name])]
        self._open([(self.leader, name) for name in others], math.inf)
        return {name: self.opened(self.leader, name) for name in others}
