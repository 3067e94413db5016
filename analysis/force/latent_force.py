"""The force a model lacks, in time and without differentiating: a Kalman smoother of the residual motion.

The residual r = measured - predicted obeys the oscillator's equation driven by all that the model gets wrong,

    m r'' + c r' + k r = u(t),        u = F_missing + F_model(along the measured motion) - F_model(along the predicted one)

A first pass of `force_smoother` gives r and with it the measured motion; the response to what the model itself makes of
r, regeneration included, is then taken off the residual, and a second pass gives F_missing. Source: M. Alvarez, D. Luengo
and N. Lawrence (2013), IEEE Trans. Pattern Analysis 35, 2693 (latent forces).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from testbed.analysis.fit.fit_state import State
from testbed.analysis.fit.observed import Observed
from testbed.analysis.fit.prediction import Engine, predict
from testbed.analysis.force.cut_variables import SUBSTEPS, Course, Trajectory, course_of, model_force
from testbed.analysis.force.response import response
from testbed.analysis.force.smoother import SETTLING, Prior, smooth, tuned_prior
from testbed.effect import Effect
from testbed.machine import Model

BESIDE = 0.05  # share of a record that must lie before, and behind, the cut for its drift to be read there
BEYOND_MARKS = 4.0  # standard deviations of a record's own clock from its marks that only a model's lack explains
_MOTION = ("displacement", "velocity", "acceleration")


@dataclass(frozen=True)
class RecordForce:
    """The missing force of one record, at its samples. All arrays (samples,).

    force and deviation (N): missing force along x and its standard deviation. displacement (m), velocity (m/s): the
    smoothed motion. delayed (m), chip (m, of the leading tooth), angle (rad, of that tooth, 0 at zero chip) are NaN
    out of the cut; spindle_angle (rad) runs from 0 to 2 pi and is NaN where nothing turns. length (m) cut since entry.
    """

    name: str
    time: np.ndarray
    force: np.ndarray
    deviation: np.ndarray
    displacement: np.ndarray
    velocity: np.ndarray
    delayed: np.ndarray
    chip: np.ndarray
    angle: np.ndarray
    spindle_angle: np.ndarray
    length: np.ndarray
    cutting: np.ndarray
    depth: float
    cutting_speed: float
    trajectory: Trajectory
    predicted: Trajectory
    residual: np.ndarray


@dataclass(frozen=True)
class MissingForce:
    """What the model lacks on every record, with what it takes to explain it: records, the state of the fit, the catalogue."""

    records: tuple[RecordForce, ...]
    observed: tuple[Observed, ...]
    state: State
    catalogue: Mapping[str, Effect]
    prior: Prior

    def force_map(self, cutting: bool) -> dict[str, np.ndarray]:
        """Force-state map: displacement (m), velocity (m/s), force (N), deviation (N) of all samples in or out of the cut."""
        picked = [(one, one.cutting if cutting else ~one.cutting) for one in self.records]
        names = ("displacement", "velocity", "force", "deviation")
        return {name: np.concatenate([getattr(one, name)[place] for one, place in picked]) for name in names}


def motion_channels(record: Observed) -> list[int]:
    """Places of the channels that see the motion."""
    return [place for place, name in enumerate(record.channels) if name.split("_")[0] in _MOTION]


def _predictions(engine: Engine, record: Observed, state: State, index: int) -> tuple[np.ndarray, Trajectory]:
    """(predicted channels, predicted motion) of a record. A prediction that diverged counts as no motion at all."""
    names = ("displacement", "velocity", *(name for name in record.channels if name not in ("displacement", "velocity")))
    variant = (state.model, state.angle, state.nuisances[index])
    found = predict(engine, replace(record, channels=names, data=np.zeros((len(names), record.samples))), [variant])[0]
    found = np.where(np.isfinite(found).all(axis=1, keepdims=True), found, 0.0)
    channels = np.stack([found[names.index(name)] for name in record.channels])
    return channels, Trajectory(record.start, record.rate, found[0], found[1])


def _residual(record: Observed, predicted: np.ndarray, course: Course) -> np.ndarray:
    """Residual (channels, samples) in the channels' units, without offset and drift.

    Where the record goes on before and behind the cut, offset and drift are read there, behind it from the small end of
    the free vibration: under a force that is not symmetric the mean displacement is real.
    """
    rest = record.data - predicted
    outside = np.ones(record.samples, dtype=bool)
    if course.breaks:
        time = record.start + np.arange(record.samples) / record.rate
        before = time < course.breaks[0] - record.period
        behind = time > course.breaks[1] + (2 / 3) * (time[-1] - course.breaks[1])
        if min(before.mean(), behind.mean()) > BESIDE:
            outside = before | behind
    found = np.linalg.lstsq(np.asarray(record.drift)[outside], rest[:, outside].T, rcond=None)[0]
    return rest - (record.drift @ found).T


def missing_force(
    engine: Engine,
    records: Sequence[Observed],
    state: State,
    catalogue: Mapping[str, Effect],
    progress: Callable[[str], None] = lambda text: None,
) -> MissingForce:
    """The force that the fitted model of `state` lacks on every record; `state` is a fit's (`WaveformFit.state`)."""
    progress("estimating the missing force")
    predictions = [_predictions(engine, record, state, index) for index, record in enumerate(records)]
    courses = [course_of(record, state, index, catalogue) for index, record in enumerate(records)]
    residuals = [
        _residual(record, channels, course) for record, (channels, _), course in zip(records, predictions, courses, strict=True)
    ]
    prior = prior_of(state.model, records, residuals)
    found = []
    for record, course, residual, (_, predicted) in zip(records, courses, residuals, predictions, strict=True):
        motion = _motion(record, state.model, prior, residual, predicted)
        found.append(_record_force(record, course, residual, motion, predicted))
    missing = MissingForce(tuple(found), tuple(records), state, catalogue, prior)
    return with_force(missing, state)


def by_the_marks(records: Sequence[Observed], state: State) -> State | None:
    """The state with every record's tooth angle and speed as its marks have them; None where the fit has left none of them.

    A fit that leaves many times the noise turns single records away from their marks to make up for the force it lacks.
    """
    pairs = list(zip(records, state.nuisances, strict=True))
    if all(np.all(np.abs(record.off_marks(own)) <= BEYOND_MARKS) for record, own in pairs):
        return None
    return replace(state, nuisances=tuple(record.by_marks(own) for record, own in pairs))


def prior_of(model: Model, records: Sequence[Observed], residuals: Sequence[np.ndarray]) -> Prior:
    """The prior tuned on the record whose motion is worst explained, of those long enough to tune on."""
    moving = [index for index, record in enumerate(records) if motion_channels(record) and record.samples > 2 * SETTLING]
    if not moving:
        return Prior(1, 1.0, 1e-3)
    worst = max(moving, key=lambda index: float(np.mean((residuals[index] / records[index].noise[:, None]) ** 2)))
    place, record = motion_channels(records[worst])[0], records[worst]
    return tuned_prior(model, residuals[worst][place], record.channels[place], record.noise[place], record.rate)


def _motion(record: Observed, model: Model, prior: Prior, residual: np.ndarray, predicted: Trajectory) -> Trajectory:
    """The measured motion, smoothed; the predicted one where no channel sees it."""
    seen = motion_channels(record)
    if not seen:
        return predicted
    names = [record.channels[place] for place in seen]
    states, _ = smooth(model, prior, residual[seen], names, record.noise[seen], record.rate)
    return replace(predicted, x=predicted.x + states[:, 0], v=predicted.v + states[:, 1])


def with_force(missing: MissingForce, state: State) -> MissingForce:
    """The force that lacks if the fitted state's own parameters are those of `state`: along the same measured motion.

    The response to all that `state` says beyond the prediction is taken off the residual first, so that the smoother has
    only the missing force left to find.
    """
    rests = [_unexplained(missing, index, state) for index in range(len(missing.records))]
    prior = prior_of(missing.state.model, missing.observed, rests)
    found = []
    for record, one, rest in zip(missing.observed, missing.records, rests, strict=True):
        seen = motion_channels(record)
        if seen:
            names = [record.channels[place] for place in seen]
            states, variances = smooth(missing.state.model, prior, rest[seen], names, record.noise[seen], record.rate)
            force, deviation = states[:, 2], np.sqrt(variances[:, 2])
        else:  # a dynamometer sees the force itself
            force, deviation = rest[0], np.full(record.samples, record.noise[0])
        found.append(replace(one, force=force, deviation=deviation))
    return replace(missing, records=tuple(found), prior=prior)


def _unexplained(missing: MissingForce, index: int, state: State) -> np.ndarray:
    """Residual (channels, samples) less the response to what the model of `state` adds along the measured motion."""
    record, one, fitted = missing.observed[index], missing.records[index], missing.state
    course = course_of(record, fitted, index, missing.catalogue)
    moved = course_of(record, state, index, missing.catalogue)
    share = fitted.model.structure.mass / state.model.structure.mass
    after = model_force(state.model, missing.catalogue, moved, one.trajectory)
    before = model_force(fitted.model, missing.catalogue, course, one.predicted)
    x, v = one.trajectory.at(course.time)
    more = (fitted.model.structure.stiffness - share * state.model.structure.stiffness) * x
    more += (fitted.model.structure.damping - share * state.model.structure.damping) * v
    if record.kind == "excited" and record.force is not None:
        more += (share - 1.0) * np.repeat(0.5 * (record.force[1:] + record.force[:-1]), SUBSTEPS)
    rows = []
    for name in record.channels:
        force = share * after.on(name) - before.on(name)
        if name.startswith("force"):
            rows.append(course.sampled(force))
        else:
            rows.append(response(fitted.model, force + more, record.rate, name.split("_")[0]))
    return one.residual - np.stack(rows)


def _record_force(
    record: Observed, course: Course, residual: np.ndarray, motion: Trajectory, predicted: Trajectory
) -> RecordForce:
    """A record's variables along its motion; the force is filled in by `with_force`."""
    variables = course.at_samples(course.edges(motion))
    nothing = np.zeros(record.samples)
    return RecordForce(
        record.name,
        record.start + np.arange(record.samples) / record.rate,
        nothing,
        nothing,
        motion.x,
        motion.v,
        variables["delayed"],
        variables["chip"],
        variables["angle"],
        variables["spindle_angle"],
        variables["length"],
        np.isfinite(variables["chip"]),
        course.depth,
        course.cutting_speed,
        motion,
        predicted,
        residual,
    )
