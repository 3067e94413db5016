"""The force a model lacks, in time and without differentiating: a Kalman smoother of the residual motion.

The residual r = measured - predicted obeys the oscillator's equation driven by all that the model gets wrong,

    m r'' + c r' + k r = u(t),        u = F_missing + F_model(along the measured motion) - F_model(along the predicted one)

u is given a Gaussian process as prior (exponential or Matern 3/2 covariance, variance and time scale by maximum
likelihood), which makes the whole a linear state-space model of r, r' and u; the Rauch-Tung-Striebel smoother gives all
three with their standard deviations. The model's own response to r, regeneration included, is then taken off u. Source:
M. Alvarez, D. Luengo and N. Lawrence (2013), IEEE Trans. Pattern Analysis 35, 2693 (latent forces); J. Hartikainen and
S. Sarkka (2010), MLSP (their state-space form); H. Rauch, F. Tung and C. Striebel (1965), AIAA J. 3, 1445.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import LinAlgError, expm, solve_discrete_are
from scipy.optimize import minimize
from scipy.signal import lfilter

from analysis.cut_variables import Course, Trajectory, course_of, model_force
from analysis.observed import Observed, Plant, predict
from analysis.waveform import State
from testbed.effect import Effect
from testbed.machine import Model

SETTLING = 80  # samples for which the filter's gain is still computed; it is constant afterwards
TUNED = 20000  # samples of the worst fitted record that the prior is tuned on
_MOTION = ("displacement", "velocity", "acceleration")


@dataclass(frozen=True)
class Prior:
    """Prior of the latent force: order 1 (exponential) or 2 (Matern 3/2), size (N) and time scale (s)."""

    order: int
    size: float
    time_scale: float


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


# -- the smoother ------------------------------------------------------------------------------------------------------


def _transition(model: Model, order: int, scale: float, dt: float) -> tuple[np.ndarray, np.ndarray]:
    """(transition, noise) over dt in units where mass, stiffness and the force's variance are 1; time in 1 / omega."""
    zeta = model.structure.damping_ratio
    size = 2 + order
    drift, diffusion = np.zeros((size, size)), np.zeros((size, size))
    drift[0, 1], drift[1, :3] = 1.0, (-1.0, -2.0 * zeta, 1.0)
    if order == 1:
        drift[2, 2], diffusion[2, 2] = -1.0 / scale, 2.0 / scale
    else:
        rate = math.sqrt(3.0) / scale
        drift[2, 3], drift[3, 2], drift[3, 3] = 1.0, -(rate**2), -2.0 * rate
        diffusion[3, 3] = 4.0 * rate**3
    block = np.block([[-drift, diffusion], [np.zeros((size, size)), drift.T]])  # C. Van Loan (1978)
    whole = expm(block * dt)
    transition = whole[size:, size:].T
    noise = transition @ whole[:size, size:]
    return transition, 0.5 * (noise + noise.T)


def _sensing(model: Model, channels: Sequence[str], order: int) -> np.ndarray:
    """Rows that read the channels off the state [x, x', f ...], with x in m and time in 1 / omega."""
    omega, zeta = model.structure.natural_frequency_rad, model.structure.damping_ratio
    rows = np.zeros((len(channels), 2 + order))
    for row, name in zip(rows, channels, strict=True):
        kind = name.split("_")[0]
        if kind == "displacement":
            row[0] = 1.0
        elif kind == "velocity":
            row[1] = omega
        else:
            row[:3] = omega**2 * np.array([-1.0, -2.0 * zeta, 1.0])
    return rows


def tuned_prior(model: Model, residual: np.ndarray, channel: str, noise: float, rate: float) -> Prior:
    """The prior under which one channel's residual (samples,) is likeliest."""
    omega = model.structure.natural_frequency_rad
    values = residual[:TUNED] / noise
    unit = noise / abs(_sensing(model, [channel], 1)[0]).max()  # displacement that the noise stands for, m

    def cost(parameters: np.ndarray, order: int) -> float:
        size, scale = np.exp(np.clip(parameters, -12.0, 16.0))
        transition, disturbance = _transition(model, order, scale, omega / rate)
        row = _sensing(model, [channel], order) * unit / noise
        try:
            spread = solve_discrete_are(transition.T, row.T, size**2 * disturbance, np.eye(1))
        except (LinAlgError, ValueError):
            return 1e12
        variance = float((row @ spread @ row.T)[0, 0]) + 1.0
        if not 1.0 - 1e-6 <= variance < math.inf:  # the solver lost its digits
            return 1e12
        gain = transition @ spread @ row.T / variance
        below, above = np.poly(transition - gain @ row), np.poly(transition)
        innovation = lfilter(above.real, below.real, values)[SETTLING:]
        return 0.5 * float(np.mean(innovation**2)) / variance + 0.5 * math.log(variance)

    found = []
    for order in (1, 2):
        for start in ((2.0, 0.0), (4.0, -1.0)):
            best = minimize(cost, start, (order,), method="Nelder-Mead", options={"maxfev": 90, "xatol": 0.05, "fatol": 1e-5})
            found.append((float(best.fun), order, np.exp(np.clip(best.x, -12.0, 16.0))))
    _, order, (size, scale) = min(found, key=lambda entry: entry[0])
    return Prior(order, float(size) * unit * model.structure.stiffness, float(scale) / omega)


def smooth(
    model: Model, prior: Prior, residual: np.ndarray, channels: Sequence[str], noise: np.ndarray, rate: float
) -> tuple[np.ndarray, np.ndarray]:
    """(states, variances), both (samples, 3): displacement (m), velocity (m/s) and force (N) behind a residual motion.

    residual (channels, samples) of displacement, velocity or acceleration, noise (channels,) its standard deviations.
    """
    omega, stiffness = model.structure.natural_frequency_rad, model.structure.stiffness
    unit = prior.size / stiffness  # m; keeps every state near 1
    transition, disturbance = _transition(model, prior.order, prior.time_scale * omega, omega / rate)
    rows = _sensing(model, channels, prior.order) * unit / noise[:, None]
    values = (residual / noise[:, None]).T
    size, count = len(transition), len(values)
    mean, spread = np.zeros(size), np.eye(size)
    spread[:2, :2] *= 1e2 * max(1.0, float(np.abs(values[: 2 * SETTLING]).max() / max(np.abs(rows[:, :2]).max(), 1e-300))) ** 2
    means, settled = np.empty((count, size)), min(SETTLING, count)
    filtered: list[np.ndarray] = []
    ahead: list[np.ndarray] = []  # covariances of the predictions that led to each sample
    for place in range(settled):
        if place:
            mean, spread = transition @ mean, transition @ spread @ transition.T + disturbance
        ahead.append(spread)
        gain = np.linalg.solve(rows @ spread @ rows.T + np.eye(len(rows)), rows @ spread).T
        mean = mean + gain @ (values[place] - rows @ mean)
        left = np.eye(size) - gain @ rows
        spread = left @ spread @ left.T + gain @ gain.T
        filtered.append(spread)
        means[place] = mean
    steady = solve_discrete_are(transition.T, rows.T, disturbance, np.eye(len(rows)))
    gain = np.linalg.solve(rows @ steady @ rows.T + np.eye(len(rows)), rows @ steady).T
    forward, pushed = transition - gain @ (rows @ transition), values @ gain.T
    for place in range(settled, count):
        mean = forward @ mean + pushed[place]
        means[place] = mean
    final = (np.eye(size) - gain @ rows) @ steady
    back = np.linalg.solve(steady, transition @ final).T
    variances = np.empty((count, size))
    spread, variances[-1] = final, np.diag(final)
    inverse_part, still = means - means @ (back @ transition).T, False
    for place in range(count - 2, settled - 1, -1):
        mean = inverse_part[place] + back @ mean
        means[place] = mean
        if not still:
            following = final + back @ (spread - steady) @ back.T
            still = bool(np.allclose(np.diag(following), np.diag(spread), rtol=1e-6, atol=0.0))
            spread = following
        variances[place] = np.diag(spread)
    for place in range(min(settled, count - 1) - 1, -1, -1):
        expected = ahead[place + 1] if place + 1 < settled else transition @ filtered[place] @ transition.T + disturbance
        back = np.linalg.solve(expected, transition @ filtered[place]).T
        means[place] = means[place] + back @ (means[place + 1] - transition @ means[place])
        spread = filtered[place] + back @ (spread - expected) @ back.T
        variances[place] = np.diag(spread)
    scale = np.array([unit, unit * omega, prior.size])
    return means[:, :3] * scale, np.maximum(variances[:, :3], 0.0) * scale**2


# -- the missing force -------------------------------------------------------------------------------------------------


def _predictions(plant: Plant, record: Observed, state: State, index: int) -> tuple[np.ndarray, Trajectory]:
    """(predicted channels, predicted motion) of a record. A prediction that diverged counts as no motion at all."""
    names = ("displacement", "velocity", *(name for name in record.channels if name not in ("displacement", "velocity")))
    variant = (state.model, state.angle, state.nuisances[index])
    found = predict(plant, replace(record, channels=names, data=np.zeros((len(names), record.samples))), [variant])[0]
    found = np.where(np.isfinite(found).all(axis=1, keepdims=True), found, 0.0)
    channels = np.stack([found[names.index(name)] for name in record.channels])
    return channels, Trajectory(record.start, record.rate, found[0], found[1])


def _residual(record: Observed, predicted: np.ndarray) -> np.ndarray:
    """Residual (channels, samples) in the channels' units, without offset and drift."""
    return record.project(record.data - predicted) * record.noise[:, None]


def missing_force(
    plant: Plant,
    records: Sequence[Observed],
    state: State,
    catalogue: Mapping[str, Effect],
    say: Callable[[str], None] = lambda text: None,
) -> MissingForce:
    """The force that the fitted model of `state` lacks on every record; `state` is a fit's (`WaveformFit.state`)."""
    say("estimating the missing force")
    predictions = [_predictions(plant, record, state, index) for index, record in enumerate(records)]
    residuals = [_residual(record, channels) for record, (channels, _) in zip(records, predictions, strict=True)]
    moving = [index for index, record in enumerate(records) if motion_channels(record)]
    prior = Prior(1, 1.0, 1e-3)
    if moving:
        worst = max(moving, key=lambda index: float(np.mean((residuals[index] / records[index].noise[:, None]) ** 2)))
        place, record = motion_channels(records[worst])[0], records[worst]
        prior = tuned_prior(state.model, residuals[worst][place], record.channels[place], record.noise[place], record.rate)
    found = [
        _record_force(record, course_of(record, state, index, catalogue), state.model, catalogue, prior, residual, motion)
        for index, (record, residual, (_, motion)) in enumerate(zip(records, residuals, predictions, strict=True))
    ]
    return MissingForce(tuple(found), tuple(records), state, catalogue, prior)


def _record_force(
    record: Observed,
    course: Course,
    model: Model,
    catalogue: Mapping[str, Effect],
    prior: Prior,
    residual: np.ndarray,
    predicted: Trajectory,
) -> RecordForce:
    seen = motion_channels(record)
    time = record.start + np.arange(record.samples) / record.rate
    if seen:
        names = [record.channels[place] for place in seen]
        states, variances = smooth(model, prior, residual[seen], names, record.noise[seen], record.rate)
    else:  # a dynamometer sees the force itself
        states = np.column_stack([np.zeros((record.samples, 2)), residual[0]])
        variances = np.tile([0.0, 0.0, record.noise[0] ** 2], (record.samples, 1))
    motion = Trajectory(record.start, record.rate, predicted.x + states[:, 0], predicted.v + states[:, 1])
    own = model_force(model, catalogue, course, motion) - model_force(model, catalogue, course, predicted)
    edges = course.edges(motion)
    variables = course.at_samples(edges, motion)
    return RecordForce(
        record.name,
        time,
        states[:, 2] - course.sampled(own),
        np.sqrt(variances[:, 2]),
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
