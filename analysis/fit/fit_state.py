"""What a fit over all records knows and finds: unknowns, states, slopes, and where a descent and a finished fit ended."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

from testbed.analysis.fit.nuisances import Nuisances, end_moved_in_arc, nearly_whole
from testbed.analysis.fit.observed import Observed
from testbed.machine import Model

VALUES_TOGETHER = 2**22  # of residuals that are worked on at once: 32 MB, and with what is made of them a few times that;
FEWEST_TOGETHER = 4  # runs, at the least


def together(size: int) -> int:
    """How many residuals of so many values are worked on at once."""
    return max(FEWEST_TOGETHER, VALUES_TOGETHER // size)


@dataclass(frozen=True)
class FreeParameter:
    """A machine parameter that is fitted: its path, the size of a natural step, and its bounds.

    periodic: an angle that goes round, kept between -pi and pi instead of at its bounds. each_record: no parameter of the
    machine, but an angle that every record has for itself, as a shift from the model's value. gradual: of an engagement that
    is not sudden, so that the moment of the first touch, within a pass, is an unknown of every record. by_length: of a law of
    the length cut, so that what was cut before is an unknown of every record that begins while it cuts. states: paths of the
    states of its effect that swing by themselves, (position, its rate), which a record without a cut may begin with.
    """

    path: str
    scale: float
    bounds: tuple[float, float]
    periodic: bool = False
    each_record: bool = False
    gradual: bool = False
    by_length: bool = False
    states: tuple[tuple[str, str], ...] = ()


@dataclass(frozen=True)
class State:
    """Where a fit stands: the model, the mark angle (rad) and every record's nuisances."""

    model: Model
    angle: float
    nuisances: tuple[Nuisances, ...]

    def with_value(self, path: str, value: float) -> State:
        """The state with one parameter of the model at another value."""
        return replace(self, model=self.model.with_values({path: value}))

    def passes_in_arc(self, record: Observed) -> float:
        """How many passes of a cut long a tooth is in the work, its helix and an error of the immersion counted."""
        cutter, cutting, effects = self.model.cutter, self.model.cutting, self.model.effects
        assert cutter is not None and cutting is not None and record.cut is not None
        wound = cutter.helix_angle + effects.get("helix", {}).get("angle", 0.0)
        lag = 2.0 * record.cut.axial_depth_of_cut * abs(math.tan(wound)) / cutter.diameter
        engaged = cutting.engagement_angle * (1.0 + effects.get("immersion_error", {}).get("error", 0.0))
        return (min(engaged, math.pi) + lag) / cutter.pitch

    def share_in_arc(self, record: Observed) -> float:
        """Share of a pass in which a tooth is in the work, 1 where one always is, or where nothing cuts."""
        return 1.0 if record.cut is None or self.model.cutting is None else min(1.0, self.passes_in_arc(record))

    def of_records(self, places: Sequence[int]) -> State:
        """The state of a fit of the records at these places alone."""
        return replace(self, nuisances=tuple(self.nuisances[place] for place in places))

    def with_record(self, place: int, own: Nuisances) -> State:
        """The state with the nuisances of one record replaced."""
        return self.with_records([place], [own])

    def with_records(self, places: Sequence[int], found: Sequence[Nuisances]) -> State:
        """The state with the nuisances of the records at these places replaced."""
        new = dict(zip(places, found, strict=True))
        return replace(self, nuisances=tuple(new.get(place, own) for place, own in enumerate(self.nuisances)))

    def with_whole_first_passes(self) -> State:
        """The state with no first pass cut in part."""
        return replace(self, nuisances=tuple(replace(one, late_entry=0.0) for one in self.nuisances))

    def with_nearly_whole(self, records: Sequence[Observed], gradual: bool, near: float) -> State:
        """The state with every end of a cut that is within `near` of an arc of a whole pass at that pass."""
        return replace(self, nuisances=tuple(nearly_whole(own, own.ends_in_arc(gradual), self.share_in_arc(record), near)
                                             for own, record in zip(self.nuisances, records, strict=True)))

    def with_sudden_entries(self, records: Sequence[Observed]) -> State:
        """The state with first passes that begin where gradual ones first touch the work: within an arc, or with the next."""
        return replace(self, nuisances=tuple(end_moved_in_arc(own, "entry", 0.0, self.share_in_arc(record))
                                             for own, record in zip(self.nuisances, records, strict=True)))

    def without_effect(self, name: str) -> State:
        """The state whose model lacks one effect, and no record begins with a state of it; all else as it is."""
        own = tuple(one.without_states_of(name) for one in self.nuisances)
        return replace(self, model=self.model.without_effect(name), nuisances=own)


class Evaluation(NamedTuple):
    """One record at a state: what is predicted, (1, channels, samples), and its residual (values,)."""

    predicted: np.ndarray
    residual: np.ndarray


class Products(NamedTuple):
    """Normal equations of one record: own unknowns, those with the shared ones, their gradient; the shared ones, theirs."""

    own: np.ndarray
    cross: np.ndarray
    pulled: np.ndarray
    shared: np.ndarray
    gradient: np.ndarray


@dataclass(frozen=True)
class Jacobian:
    """One record about a state: residual (values,), slopes by the shared (values, shared) and own (values, own) unknowns.

    known: names of the own unknowns.
    """

    residual: np.ndarray
    shared: np.ndarray
    own: np.ndarray
    known: tuple[str, ...] = ()

    def without_own(self, residuals: np.ndarray) -> np.ndarray:
        """Residuals (..., values) less what the record's own unknowns can take of them."""
        basis = self._own_basis
        if residuals.size <= VALUES_TOGETHER:
            return residuals - (residuals @ basis) @ basis.T
        return np.array([row - (row @ basis) @ basis.T for row in residuals])

    @cached_property
    def products(self) -> Products:
        """The products of slopes and residual, summed over the values: all that a step needs."""
        own, shared, rest = self.own.T, self.shared.T, self.residual
        return Products(own @ own.T, own @ shared.T, own @ rest, shared @ shared.T, shared @ rest)

    @property
    def information(self) -> tuple[np.ndarray, np.ndarray]:
        """What the record tells of the shared unknowns with its own eliminated: (shared, shared), and its pull on them."""
        own, cross, pulled, shared, gradient = self.products
        taken = cross.T @ np.linalg.pinv(own) if len(own) else cross.T
        return shared - taken @ cross, gradient - taken @ pulled

    @cached_property
    def _own_basis(self) -> np.ndarray:
        return np.linalg.qr(self.own)[0] if self.own.shape[1] else self.own


def of_rows(rows: np.ndarray, shared: int, steps: Sequence[Mapping[str, float]]) -> Jacobian:
    """A record about a state from its residual and slopes, rows (1 + shared + own, values): on the thread of the record.

    steps: of its own unknowns. All products are those of the rows with each other.
    """
    found, own = Jacobian(rows[0], rows[1 : 1 + shared].T, rows[1 + shared :].T, names_of(steps)), 1 + shared
    all_of = rows @ rows.T
    found.__dict__["products"] = Products(all_of[own:, own:], all_of[own:, 1:own], all_of[own:, 0], all_of[1:own, 1:own],
                                          all_of[1:own, 0])  # fmt: skip
    return found


def names_of(steps: Sequence[Mapping[str, float]]) -> tuple[str, ...]:
    """The names of a record's own unknowns, by their steps."""
    return tuple(name for step in steps for name in step)


@dataclass(frozen=True, kw_only=True)
class Descent:
    """Where a descent ended. cost: half the sum of squared residuals in units of the records' scale.

    parts: residuals and slopes about this state where they were computed `anew`, else about that before the last step.
    looked: the records at this state, where a step led to it.
    """

    state: State
    cost: float
    parts: tuple[Jacobian, ...]
    anew: bool = True
    converged: bool
    iterations: int
    looked: tuple[Evaluation, ...] | None = None


@dataclass(frozen=True, kw_only=True)
class WaveformFit(Descent):
    """A finished fit, with the slopes where it ended.

    names of the shared unknowns: the free parameters' paths, then `mark_angle` where it was fitted; covariance of the same.
    alike: states elsewhere, out of reach of the slopes, that explain the records as well. helped: names of the moves that led
    to it, in their order, see `solve`.
    """

    residuals: tuple[np.ndarray, ...]
    names: tuple[str, ...]
    covariance: np.ndarray
    alike: tuple[State, ...] = ()
    helped: tuple[str, ...] = ()

    @property
    def squares(self) -> float:
        """Sum of squared residuals over all records, in units of their scale."""
        return 2.0 * self.cost

    @property
    def variance(self) -> float:
        """Mean of the squared residuals, in units of the records' scale squared: near 1 where noise alone is left."""
        return self.squares / sum(rest.size for rest in self.residuals)

    @property
    def mean_squares(self) -> np.ndarray:
        """Mean squared residual (records,) of every record, in units of its scale squared."""
        return np.array([float(np.mean(rest**2)) for rest in self.residuals])

    def worst(self, count: int) -> list[int]:
        """Places of the records fitted worst, the worst first."""
        return [int(place) for place in np.argsort(-self.mean_squares)[:count]]
