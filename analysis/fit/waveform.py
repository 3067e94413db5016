"""Fit a model to all records of a campaign at once, sample by sample: Levenberg-Marquardt over the engine's predictions.

The machine's parameters are shared; every record keeps its own nuisances, which are eliminated from the normal equations
record by record (Schur complement), so that the cost of a step grows linearly with the number of records.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from testbed.analysis.fit.fit_state import (
    Descent,
    Evaluation,
    FreeParameter,
    Jacobian,
    State,
    WaveformFit,
    names_of,
    of_rows,
    together,
)
from testbed.analysis.fit.least_squares import covariance, levenberg_marquardt
from testbed.analysis.fit.nuisances import MISSING, Nuisances, begun_with, end_moved, end_moved_in_arc, turned_by
from testbed.analysis.fit.observed import Observed
from testbed.analysis.fit.prediction import Engine, predict
from testbed.analysis.fit.residual_kernel import difference, fill_residuals
from testbed.machine import Model
from testbed.system.threads import threaded

SLOWEST = 0.8  # of the nominal speed, that a record without marks may turn out to have had
SLOPE_STEP = 1e-4  # of a natural step, by which slopes are taken
ANGLE_STEP = 0.1  # rad: a natural step of the mark angle
LENGTH_STEP = 1e-3  # m: a natural step of the length cut before
LATE_STEP = 0.1  # of a pass: a natural step of the first touch
PART_STEP = 0.1  # of an arc: a natural step of where a cut that begins or ends within one does so
HELIX = "helix.angle"
BIG = 1e6  # residual, in units of the noise, that stands for a prediction that diverged
EDGE, LITTLE = 0.01, 0.5  # of an arc, from a whole pass: what an end so near it may save, in minus the log likelihood


def _upright(model: Model, path: str, value: float) -> float:
    """A parameter's value, a helix such that the whole angle has the sign of the believed one: its size alone counts."""
    if path != HELIX or model.cutter is None:
        return value
    believed = model.cutter.helix_angle
    return math.copysign(believed + value, -1.0 if believed < 0.0 else 1.0) - believed


class Fitter:
    """Records, an engine, and the parameters that are free."""

    def __init__(self, engine: Engine, records: Sequence[Observed], free: Sequence[FreeParameter]) -> None:
        self.engine, self.records = engine, tuple(records)
        self.unknowns = tuple(free)
        self.free = tuple(one for one in free if not one.each_record)
        self.shifting = tuple(one for one in free if one.each_record)
        self.gradual = any(one.gradual for one in free)
        self.swinging = tuple(dict.fromkeys(pair for one in free for pair in one.states))
        self.fits_angle = any(record.cut is not None and record.first_mark is not None for record in records)
        self.names = (*(one.path for one in self.free), *(("mark_angle",) if self.fits_angle else ()))

    def without(self, path: str) -> Fitter:
        """The same fit with a parameter, or all of an effect, no longer unknown."""
        known = [one for one in self.unknowns if path not in (one.path, one.path.partition(".")[0])]
        return Fitter(self.engine, self.records, known)

    def of_records(self, places: Sequence[int]) -> Fitter:
        """The same fit to the records at these places alone."""
        return self.on([self.records[place] for place in places])

    def on(self, records: Sequence[Observed]) -> Fitter:
        """The same fit to other records."""
        return Fitter(self.engine, records, self.unknowns)

    @property
    def steps(self) -> np.ndarray:
        """Natural steps of the shared unknowns, each in its own unit."""
        return np.array([*(one.scale for one in self.free), *((ANGLE_STEP,) if self.fits_angle else ())])

    # -- variants of a state -------------------------------------------------------------------------------------------

    def moved(self, state: State, step: np.ndarray) -> State:
        """The state after a step of the shared unknowns, in natural units, held inside the bounds."""
        values = {}
        for one, amount in zip(self.free, step, strict=False):
            value = _upright(state.model, one.path, state.model.value(one.path) + amount * one.scale)
            turned = math.remainder(value, 2 * math.pi) if one.periodic else min(max(value, one.bounds[0]), one.bounds[1])
            values[one.path] = turned
        angle = state.angle + (step[-1] * ANGLE_STEP if self.fits_angle else 0.0)
        return replace(state, model=state.model.with_values(values), angle=angle)

    def own_steps(self, record: Observed, nuisances: Nuisances) -> list[dict[str, float]]:
        enters = record.cut is not None and not record.starts_in_cut
        own: list[dict[str, float]] = []
        for one in reversed(self.unknowns):
            if one.each_record:
                own.append({one.path: one.scale})
            elif one.gradual and enters and {"late_entry": LATE_STEP} not in own:
                own.append({"late_entry": LATE_STEP})
            elif one.by_length and record.begins_cutting(nuisances) and {"length": LENGTH_STEP} not in own:
                own.append({"length": LENGTH_STEP})
        own += [{end: PART_STEP} for end in nuisances.ends_in_arc(self.gradual)]
        if not record.starts_in_cut or nuisances.swings:  # still swinging at a recent entry
            size, omega = record.motion_size, record.main_frequency
            own += [{"displacement": size}, {"velocity": size * omega}]
            pairs = (*record.further_states, *(self.swinging if record.cut is None else ()))
            own += [change for position, rate in pairs for change in ({position: size}, {rate: size * omega})]
        if record.cut is not None and record.first_mark is None:
            own += [{"angle": 0.1}, {"speed": 1e-3}]
        elif record.clock_error is not None:  # held by what the marks know of them, see Observed.off_marks
            own += [{"angle": record.clock_error[0]}, {"speed": record.clock_error[1]}]
        return own

    def _nudged(self, nuisances: Nuisances, change: Mapping[str, float], amount: float, arc: float) -> Nuisances:
        values: dict[str, Any] = {}
        for key, size in change.items():
            if key.startswith("modes[") or any(key in pair for pair in self.swinging):
                nuisances = begun_with(nuisances, key, amount * size)
            elif "." in key:
                nuisances = turned_by(nuisances, key, amount * size)
            elif key == "late_entry":
                nuisances = end_moved(nuisances, "entry", amount * size)
                nuisances = replace(nuisances, entry=min(nuisances.entry, nuisances.exit - 1))
            elif key in MISSING:
                moved = end_moved_in_arc(nuisances, key, amount * size, arc)
                nuisances = moved if moved.entry < moved.exit else nuisances
            else:
                values[key] = getattr(nuisances, key) + amount * size
        if "speed" in values:  # records that fit no cut at all must not turn the spindle back
            values["speed"] = min(max(values["speed"], SLOWEST), 1.0 / SLOWEST)
        return replace(nuisances, **values)

    # -- residuals and slopes ------------------------------------------------------------------------------------------

    def _residuals(self, record: Observed, variants: list[tuple[Model, float, Nuisances]],
                   first: np.ndarray | None = None) -> np.ndarray:  # fmt: skip
        """Residuals (variants, values), in units of the record's scale. first: see `predict`."""
        return self._left(record, predict(self.engine, record, variants, first))

    @staticmethod
    def _left(record: Observed, predicted: np.ndarray, more: int = 0) -> np.ndarray:
        """What predictions (variants, channels, samples) leave of a record: residuals (variants, values + more).

        more: columns at the end that are left as they are, for what is held of the record's unknowns.
        """
        found = np.empty((len(predicted), record.size + more))
        fill_residuals(predicted, record.data, record.scale, record.counted_drift, record.counted, (record.far, BIG), found)
        return found

    def _shared_nudge(self, state: State, place: int, step: float) -> tuple[State, float]:
        """The state with one shared unknown moved by a small step, and the step's sign: down at an upper bound."""
        unit, sign = np.zeros(len(self.names)), 1.0
        if place < len(self.free) and not self.free[place].periodic:
            free = self.free[place]
            sign = -1.0 if state.model.value(free.path) + step * free.scale > free.bounds[1] else 1.0
        unit[place] = sign * step
        return self.moved(state, unit), sign

    def _shared_nudges(self, state: State) -> list[tuple[State, float]]:
        return [self._shared_nudge(state, place, SLOPE_STEP) for place in range(len(self.names))]

    def linearise(self, index: int, state: State, nudges: Sequence[tuple[State, float]] | None = None,
                  first: np.ndarray | None = None) -> Jacobian:  # fmt: skip
        """Residual and slopes of one record by forward differences.

        At hand: nudges, of the shared unknowns; first, what is predicted at the state, (1, channels, samples).
        """
        record, nuisances = self.records[index], state.nuisances[index]
        own, arc = self.own_steps(record, nuisances), state.share_in_arc(record)
        nudges = self._shared_nudges(state) if nudges is None else nudges
        signs = [sign for _, sign in nudges]
        variants = [(one.model, one.angle, nuisances) for one in (state, *(other for other, _ in nudges))]
        variants += [(state.model, state.angle, self._nudged(nuisances, change, SLOPE_STEP, arc)) for change in own]
        held = record.off_marks(nuisances)
        rows = self._left(record, predict(self.engine, record, variants, first), len(held))
        difference(rows, record.size, SLOPE_STEP * np.array([*signs, *(1.0 for _ in own)]))
        if len(held):
            rows[0, record.size :], rows[1:, record.size :] = held, 0.0
            rows[len(rows) - len(held) :, record.size :] = np.eye(len(held))
        return of_rows(rows, len(self.names), own)

    def linearise_all(self, state: State, looked: Sequence[Evaluation] | None = None) -> tuple[Jacobian, ...]:
        """Every record about a state, on threads (the engine lets go of the interpreter). looked: what is known of it there.

        The nudged models are the same objects for all records, so that the engine need not unpack each anew.
        """
        nudges, places = self._shared_nudges(state), range(len(self.records))
        known = [None for _ in places] if looked is None else [one.predicted for one in looked]
        return threaded(lambda index: self.linearise(index, state, nudges, known[index]), places)

    def look(self, state: State) -> tuple[Evaluation, ...]:
        """Every record's prediction and residual at a state."""

        def one(index: int) -> Evaluation:
            predicted = predict(self.engine, self.records[index], [(state.model, state.angle, state.nuisances[index])])
            return Evaluation(predicted, self._left(self.records[index], predicted)[0])

        return threaded(one, range(len(self.records)))

    def residual_of(self, index: int, state: State) -> np.ndarray:
        """One record's residual, in units of its scale."""
        return self._residuals(self.records[index], [(state.model, state.angle, state.nuisances[index])])[0]

    def residuals_of(self, index: int, variants: Sequence[tuple[Model, float, Nuisances]]) -> np.ndarray:
        """One record's residuals (variants, values) for other models, mark angles and nuisances, and what its marks say."""
        record = self.records[index]
        held = np.array([record.off_marks(own) for _, _, own in variants])
        most = together(record.size)
        if len(variants) <= most or any(model is not variants[0][0] for model, _, _ in variants):
            found = self._left(record, predict(self.engine, record, variants), held.shape[1])
            found[:, record.size :] = held
            return found
        found = np.empty((len(variants), record.size + held.shape[1]))
        found[:, record.size :] = held
        for begin in range(0, len(variants), most):  # each beside the first, whose steps they all take
            part = self._residuals(record, [variants[0], *variants[begin : begin + most]])
            found[begin : begin + most, : record.size] = part[1:]
        return found

    def residuals(self, state: State, indices: Sequence[int] | None = None) -> tuple[np.ndarray, ...]:
        """Every record's residual, or some records', in units of their scale."""
        places = range(len(self.records)) if indices is None else indices
        return threaded(lambda index: self.residual_of(index, state), places)

    def cost(self, state: State, indices: Sequence[int] | None = None) -> float:
        """Half the sum of squared residuals of all records, or of some, in units of their scale."""
        places = range(len(self.records)) if indices is None else indices
        return self.cost_of(self.residuals(state, indices), state, places)

    def cost_of(self, residuals: Iterable[np.ndarray], state: State, places: Iterable[int]) -> float:
        held = [self.records[place].off_marks(state.nuisances[place]) for place in places]
        return 0.5 * sum(float(rest @ rest) for rest in (*residuals, *held))

    def with_slopes(
        self,
        parts: Sequence[Jacobian],
        state: State,
        places: Sequence[int],
        step: float = 1e-3,
    ) -> tuple[Jacobian, ...]:
        """Residuals at a state, with slopes by the free parameters at `places` computed and all others taken from `parts`.

        Own unknowns that `parts` do not know yet, an effect's shifts, are computed, too.
        """

        nudges = [self._shared_nudge(state, place, step) for place in places]
        signs = [sign for _, sign in nudges]

        def one(index: int) -> Jacobian:
            record, nuisances, part = self.records[index], state.nuisances[index], parts[index]
            own, arc = self.own_steps(record, nuisances), state.share_in_arc(record)
            new = [change for change in own if not set(change) <= set(part.known)]
            variants = [(other.model, state.angle, nuisances) for other in (state, *(one for one, _ in nudges))]
            variants += [(state.model, state.angle, self._nudged(nuisances, change, step, arc)) for change in new]
            held = record.off_marks(nuisances)
            found = self._left(record, predict(self.engine, record, variants), len(held))
            difference(found, record.size, step * np.array([*signs, *(1.0 for _ in new)]))
            found[0, record.size :], found[1:, record.size :] = held, 0.0
            rows = np.empty((1 + len(self.names) + len(own), found.shape[1]))
            rows[0] = found[0]
            known = [1 + place for place in range(len(self.names)) if place not in places]
            rows[known] = part.shared.T
            rows[[1 + place for place in places]] = found[1 : 1 + len(signs)]
            columns = dict(zip(part.known, part.own.T, strict=True))
            columns |= dict(zip(names_of(new), found[1 + len(signs) :], strict=True))
            for place, name in enumerate(names_of(own), start=1 + len(self.names)):
                rows[place] = columns[name]
            return of_rows(rows, len(self.names), own)

        return threaded(one, range(len(self.records)))

    # -- steps ---------------------------------------------------------------------------------------------------------

    def with_own(self, state: State, moves: Sequence[np.ndarray]) -> State:
        """The state after a step of the records' own unknowns."""
        changed = []
        for record, nuisances, move in zip(self.records, state.nuisances, moves, strict=True):
            arc = state.share_in_arc(record)
            for change, amount in zip(self.own_steps(record, nuisances), move, strict=True):
                nuisances = self._nudged(nuisances, change, float(amount), arc)
            if record.starts_in_cut and nuisances.entry <= record.first_simulated:  # nothing is seen of it, nothing holds it
                nuisances = replace(nuisances, entry=record.first_simulated, late_entry=0.0, displacement=0.0, velocity=0.0,
                                    states=())
            changed.append(nuisances)
        return replace(state, nuisances=tuple(changed))

    def fit(self, state: State, *, iterations: int = 25, tolerance: float = 1e-5, near: Descent | None = None,
            cost_limit: float = math.inf) -> WaveformFit:  # fmt: skip
        """Levenberg-Marquardt from a state, or from where a descent ended that knows the slopes there.

        Converged: the last step lowered the cost by less than `tolerance` of itself, or none, however short, lowers it any
        more (at a kink of a law, or with an unknown at its bound). cost_limit: see `descend`.
        """
        found = self.descend(state, iterations=iterations, tolerance=tolerance, near=near, cost_limit=cost_limit)
        parts = found.parts if found.anew else self.linearise_all(found.state, found.looked)
        size = sum(part.residual.size for part in parts)
        variance = max(1.0, 2.0 * found.cost / size)
        residuals = tuple(part.residual[: record.size] for part, record in zip(parts, self.records, strict=True))
        return WaveformFit(
            state=found.state, cost=found.cost, parts=parts, converged=found.converged, iterations=found.iterations,
            residuals=residuals, names=self.names, covariance=covariance(parts, self.steps, variance),
        )

    def descend(self, state: State, *, iterations: int = 25, tolerance: float = 1e-5, near: Descent | None = None,
                cost_limit: float = math.inf) -> Descent:  # fmt: skip
        """The same, for who asks for no covariance: slopes where it ends are not computed; `near` lends those of a first step.

        Slopes are computed anew after every step: steps with kept slopes cost a tenth, but creep along the valley between
        the cutting coefficients, and need tens of times as many. cost_limit: the cost from which its end is of use; a descent
        is given up once, at its late pace, it would not come to that. An end of a cut that came to the edge of its arc stays
        there and holds all else, as its slope beyond is another: it is made whole, and the descent goes on.
        """
        found = levenberg_marquardt(self, state, iterations, tolerance, near, cost_limit)
        whole = found.state.with_nearly_whole(self.records, self.gradual, EDGE)
        left = iterations - found.iterations
        if not found.converged or not left or whole == found.state or not self.cost(whole) < found.cost + LITTLE:
            return found
        again = levenberg_marquardt(self, whole, left, tolerance, None, cost_limit)
        return replace(again, iterations=again.iterations + found.iterations) if again.cost < found.cost + LITTLE else found
