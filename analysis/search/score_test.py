"""First looks at what could be missing: each effect after its first step, and from far outside where that tells too little.

A first Gauss-Newton step ranks the candidates of a round (a score test with a look at the true cost); which of them are
fitted in full is for `candidate_round` to say.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

from testbed.analysis.fit.effect_start import Origin, applicable, far_step, first_step, gradual_entry, switched_on
from testbed.analysis.fit.fit_state import State
from testbed.analysis.fit.held_out import pooled
from testbed.analysis.fit.length_cut import asks_length, carried_on
from testbed.analysis.fit.solve import alternate_fit_and_passes
from testbed.analysis.fit.waveform import Fitter
from testbed.analysis.search.candidate import ADEQUATE, Candidate
from testbed.effect import Effect
from testbed.system.threads import threaded

# Error over noise floor below which a leader that leaves only noise may still be the wrong one: what a helix does grows with
# the square of its angle, so that its own first step leads nowhere, and what is left of a faint effect passes for noise.
FAINT = 1.3
BEHIND = 4.0  # times the cost of the best of its round above which a candidate is out: its fit is given up
SLIGHT = 2.0  # error over noise floor below which parts of passes may have made up for an entry that is gradual


@dataclass
class ScreenedCandidate:
    """A candidate of a round: the cost after its first step, where that ended, and its full fit once there is one."""

    name: str
    cost: float
    state: State
    fitter: Fitter
    fitted: Candidate | None = None

    @property
    def reached(self) -> float:
        """The cost of the best that is known of it."""
        return self.cost if self.fitted is None else self.fitted.fit.cost


def shifts_in_time(effect: Effect) -> bool:
    """Whether an effect shifts the record in time, so that it is tried from far outside at once."""
    return bool({"measure", "speed"} & set(effect.hooks))


def not_sudden(entries: Sequence[ScreenedCandidate], catalogue: Mapping[str, Effect]) -> list[ScreenedCandidate]:
    """Entries whose first step may lead nowhere, see FAINT; of an entry that is not sudden it says more."""
    return [one for one in entries if "engagement" not in catalogue[one.name].hooks]


def nothing_hidden(current: Candidate, noise: float) -> bool:
    """Whether little is left of records without a cut: nothing there makes up for an effect, so its first step tells all."""
    return current.error_held_out < FAINT * noise and all(record.cut is None for record in current.fitter.records)


def best_cost(entries: Sequence[ScreenedCandidate]) -> float:
    """The lowest cost that a candidate of the round was fitted to."""
    return min((one.fitted.fit.cost for one in entries if one.fitted and one.fitted.fit), default=math.inf)


def first_steps(
    current: Candidate, catalogue: Mapping[str, Effect], origins: Sequence[Origin], progress: Callable[[str], None],
    growing: bool = True,
) -> list[ScreenedCandidate]:  # fmt: skip
    """Every effect the current set lacks after its first step, cheapest first."""
    present = {*current.effects, *current.fit.state.model.effects}
    records = current.fitter.records
    asked = [one for name, one in catalogue.items() if name not in present and applicable(one, records, present)]
    noise = pooled(current.errors)[1]
    little = ADEQUATE * noise < current.error_held_out < SLIGHT * noise

    def looked(effect: Effect) -> ScreenedCandidate:
        progress(f"trying {effect.name}")
        entry = begun(current, effect, origins, growing)
        return _settled_entry(current, entry) if little and "engagement" in effect.hooks else entry

    return sorted(threaded(looked, asked), key=lambda entry: entry.cost)


def _settled_entry(current: Candidate, entry: ScreenedCandidate) -> ScreenedCandidate:
    """A gradual entry fitted in full, where its first step costs more than the model without it.

    Parts of passes have made up for it, and no step leads from the whole ones with which it begins to what they gained.
    """
    if entry.cost > current.fit.cost:
        found = alternate_fit_and_passes(entry.fitter, entry.state, rounds=3)
        entry.cost, entry.state = found.cost, found.state
    return entry


def begun(current: Candidate, effect: Effect, origins: Sequence[Origin], growing: bool = True) -> ScreenedCandidate:
    """An effect after its first step."""
    entry = ScreenedCandidate(effect.name, *first_step(current.fitter, effect, current.fit, origins, growing))
    if asks_length([effect.name], {effect.name: effect}) and (longer := carried_on(current.fitter.records)) is not None:
        worn = current.fitter.on(longer)
        other = ScreenedCandidate(effect.name, *first_step(worn, effect, current.fit, origins))
        entry = min(entry, other, key=lambda one: one.cost)
    if shifts_in_time(effect):
        from_far(current, entry, effect)
    return entry


def from_far(
    current: Candidate, entry: ScreenedCandidate, effect: Effect, origins: Sequence[Origin] = (), cost_limit: float = math.inf,
    nearer: bool = False,
) -> None:  # fmt: skip
    """Put the entry where a fit from far outside ends, if better. cost_limit: see `try_from_far`; nearer: see `far_step`."""
    scanned = origins[-1].scanned if origins and "engagement" in effect.hooks else None
    if any(one.each_record for one in effect.parameters):
        return
    base = current.fitter.on(entry.fitter.records)
    if not effect.parameters:
        cost, state, fitter = switched_on(base, effect, origins)
    elif scanned is not None:
        cost, state, fitter = gradual_entry(base, effect, current.fit, scanned, cost_limit)
    else:
        wanted = entry.reached if effect.smooth else min(cost_limit, entry.reached)
        cost, state, fitter = far_step(base, effect, current.fit, wanted, nearer)
    if cost < entry.reached:
        entry.cost, entry.state, entry.fitter, entry.fitted = cost, state, fitter, None


def try_from_far(
    current: Candidate,
    entries: list[ScreenedCandidate],
    catalogue: Mapping[str, Effect],
    origins: Sequence[Origin],
    progress: Callable[[str], None],
    cost_limit: float,
    nearer: bool = False,
) -> None:
    """Every entry once more from far outside, where no first step led to much.

    cost_limit: the cost from which an entry that is not sudden, or has a kink, is of use. nearer: see `far_step`.
    """

    def tried(entry: ScreenedCandidate) -> None:
        effect = catalogue[entry.name]
        if (entry.fitted is None or "engagement" in effect.hooks) and not shifts_in_time(effect):
            progress(f"trying {entry.name} from far")
            from_far(current, entry, effect, origins, cost_limit, nearer)

    threaded(tried, entries)
    entries.sort(key=lambda entry: entry.reached)
