"""The force that a fitted machine in x and y lacks, along both directions, and its force-state maps.

As `latent_force` does it along the feed: the residual motion is that of all modes under two unknown forces at the cut, which a
Kalman smoother finds; what the linear chip law answers to that motion is taken off the residual, and it is smoothed again.
Both forces have one prior. A direction that the channels do not tell has none of its maps. Where effects add a force, what
they answer to the residual motion stays in the map; teeth of unequal pitch are not followed.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import minimize

from testbed.analysis.fit.fit_state import State
from testbed.analysis.fit.observed import Observed
from testbed.analysis.fit.prediction import Engine, predict
from testbed.analysis.force.cut_variables import SUBSTEPS, CellForce, Course, Edges, Trajectory, course_of
from testbed.analysis.force.latent_force import BESIDE
from testbed.analysis.force.response import response
from testbed.analysis.force.smoother import (
    SETTLING,
    SHORTEST,
    TUNED,
    latent,
    march,
    over_a_sample,
    settled_spread,
    smoothed,
)
from testbed.effect import Effect
from testbed.machine import Model, Structure
from testbed.recording import motion_channel, sensor_of

AXES = ("x", "y")
TOLD = 0.5  # of the prior's variance, that of a force up to which the channels tell it
START = (3.0, -0.5)  # logarithms of size over the noise's, and of time scale over the slowest mode's, where tuning begins
MOST_TRIED = 60  # priors of each order


@dataclass(frozen=True)
class AlongAxis:
    """Motion at the cut (m, m/s) and missing force (N) along one axis, all (samples,); deviation (N): of the force, rms."""

    name: str
    displacement: np.ndarray
    velocity: np.ndarray
    force: np.ndarray
    cutting: np.ndarray
    deviation: float


@dataclass(frozen=True)
class _Linear:
    """The modes under two latent forces as a linear system over a sample, for unit noise of every channel.

    states: of each mode displacement and velocity, then the force along x and along y. size: N in one unit of the forces.
    """

    transition: np.ndarray
    disturbance: np.ndarray
    rows: np.ndarray
    tip: np.ndarray
    size: float


def _linear(record: Observed, model: Model, places: Sequence[int], prior: tuple[int, float, float]) -> _Linear:
    """prior: order, size (N) and time scale (s) of the forces. Time in units of the fastest mode's, mode by mode of force over
    stiffness."""
    order, size, scale = prior
    modes = model.structure.modes
    omega = max(mode.natural_frequency_rad for mode in modes)
    count, first = len(modes), 2 * len(modes)
    drift = np.zeros((first + 2 * order, first + 2 * order))
    diffusion = np.zeros_like(drift)
    for place, mode in enumerate(modes):
        ratio, now = mode.natural_frequency_rad / omega, 2 * place
        drift[now, now + 1] = 1.0
        drift[now + 1, [now, now + 1]] = -(ratio**2), -2.0 * mode.damping_ratio * ratio
        drift[now + 1, [first, first + order]] = ratio**2 * np.array(mode.shape)
    for axis in (0, 1):
        block = slice(first + axis * order, first + (axis + 1) * order)
        drift[block, block], diffusion[block, block] = latent(order, scale * omega)
    unit = np.array([size / mode.stiffness for mode in modes])
    read = np.zeros((3, count, len(drift)))  # displacement, velocity and acceleration of each mode, SI
    for place in range(count):
        read[0, place, 2 * place], read[1, place, 2 * place + 1] = unit[place], unit[place] * omega
        read[2, place] = drift[2 * place + 1] * unit[place] * omega**2
    rows = []
    for place in places:
        sensor = sensor_of(record.channels[place])
        assert sensor is not None
        rows.append(np.array([mode.seen(sensor.on, sensor.axis) for mode in modes]) @ read[sensor.order] / record.noise[place])
    shapes = np.array([mode.shape for mode in modes])
    tip = np.concatenate([np.einsum("ma,ms->as", shapes, read[order_of]) for order_of in (0, 1)])  # x, y, x', y'
    return _Linear(*over_a_sample(drift, diffusion, omega / record.rate), np.array(rows), tip, size)


def _tuned(record: Observed, model: Model, places: Sequence[int], values: np.ndarray, orders: Sequence[int] = (1, 2)
           ) -> tuple[int, float, float]:  # fmt: skip
    """The prior of one of these orders under which all channels' residual, in units of their noise (samples, channels), is
    likeliest."""
    values = values[:TUNED]
    slowest = min(mode.natural_frequency_rad for mode in model.structure.modes)
    seen = np.abs(_linear(record, model, places, (1, 1.0, 1.0 / slowest)).rows).max()
    shortest = math.log(SHORTEST * slowest / record.rate)

    def limited(order: int, parameters: np.ndarray) -> tuple[int, float, float]:
        size, scale = np.exp(np.clip(parameters, (-12.0, shortest), (16.0, 4.0)))
        return order, float(size) / seen, float(scale) / slowest

    def cost(parameters: np.ndarray, order: int) -> float:
        one = _linear(record, model, places, limited(order, parameters))
        try:
            spread = settled_spread(one.transition, one.rows, one.disturbance)
        except (np.linalg.LinAlgError, ValueError):
            return 1e12
        variance = one.rows @ spread @ one.rows.T + np.eye(len(one.rows))
        gain = np.linalg.solve(variance, one.rows @ spread @ one.transition.T).T
        ahead = march(one.transition - gain @ one.rows, values @ gain.T, np.zeros(len(one.transition)))
        innovation = (values[1:] - ahead[:-1] @ one.rows.T)[SETTLING:]
        size = np.linalg.slogdet(variance)
        whole = float(np.mean(np.sum(innovation * np.linalg.solve(variance, innovation.T).T, axis=1))) + float(size[1])
        return 0.5 * whole if size[0] > 0 and math.isfinite(whole) else 1e12

    found = []
    for order in orders:
        options = {"maxfev": MOST_TRIED, "xatol": 0.05, "fatol": 1e-5}
        best = minimize(cost, START, (order,), method="Nelder-Mead", options=options)
        found.append((float(best.fun), limited(order, best.x)))
    return min(found)[1]


def planar_force(engine: Engine, record: Observed, state: State, catalogue: Mapping[str, Effect]
                 ) -> tuple[list[AlongAxis], float]:  # fmt: skip
    """(what lacks along each axis that the channels tell, the prior's time scale in s) of one record under a fit's state of it
    alone. ValueError where it cannot be: no sensor of motion, too few samples, unequal pitch."""
    model = state.model
    places = [place for place, name in enumerate(record.channels) if sensor_of(name) is not None]
    if not places or record.samples <= 2 * SETTLING or model.cutter is not None and model.cutter.pitch_angles:
        raise ValueError("no motion that can be followed")
    course = course_of(record, state, 0, catalogue)
    rest = _rest(record, model, _predicted(engine, record, state, record.channels), course)[places]
    values, noise = (rest / record.noise[places][:, None]).T, record.noise[places]
    prior = _tuned(record, model, places, values)
    one = _linear(record, model, places, prior)
    moved = one.tip @ smoothed(one.transition, one.disturbance, one.rows, values)[0].T
    answered = _answered(course, model, record, moved)
    names = [record.channels[place] for place in places]
    left = rest - np.stack([_seen(model, answered, name, record.rate) for name in names])
    values = (left / noise[:, None]).T
    prior = _tuned(record, model, places, values, prior[:1])
    one = _linear(record, model, places, prior)
    means, variances = smoothed(one.transition, one.disturbance, one.rows, values)
    tip = _tip(engine, record, state) + moved
    cells = np.zeros(len(course.time), dtype=bool)
    cells[course.cell[course.share > 0.5]] = True
    cutting = cells[np.clip(np.arange(record.samples) * SUBSTEPS, 0, len(cells) - 1)]
    order, size, scale = prior
    found = []
    for axis, name in enumerate(AXES):
        column = 2 * len(model.structure.modes) + axis * order
        deviation = size * math.sqrt(float(variances[:, column].mean()))
        force = size * means[:, column]
        if deviation**2 <= TOLD * size**2 and float(force.std()) > deviation:
            found.append(AlongAxis(f"{record.name}, along {name}", tip[axis], tip[2 + axis], force, cutting, deviation))
    return found, scale


def _rest(record: Observed, model: Model, predicted: np.ndarray, course: Course) -> np.ndarray:
    """Residual (channels, samples) in the channels' units, without offset and drift.

    Where the record goes on before and behind the cut, offset and drift are read there, behind it beside free decays of the
    modes: under a force that is not symmetric the mean displacement is real.
    """
    rest, drift = record.data - predicted, np.asarray(record.drift)
    outside, columns = np.ones(record.samples, dtype=bool), drift
    if course.breaks:
        time = record.start + np.arange(record.samples) / record.rate
        behind = time > course.breaks[1] + record.period
        before = time < course.breaks[0] - record.period
        if min(before.mean(), behind.mean()) > BESIDE:
            outside, since = before | behind, np.where(behind, time - course.breaks[1], 0.0)
            poles = np.array([mode.natural_frequency_rad * complex(-mode.damping_ratio, math.sqrt(1.0 - mode.damping_ratio**2))
                              for mode in model.structure.modes])
            decays = np.exp(poles * since[:, None]) * behind[:, None]
            columns = np.hstack([drift, decays.real, decays.imag])
    found = np.linalg.lstsq(columns[outside], rest[:, outside].T, rcond=None)[0][: drift.shape[1]]
    return rest - (drift @ found).T


def _predicted(engine: Engine, record: Observed, state: State, names: Sequence[str]) -> np.ndarray:
    """Predicted channels of these names (channels, samples). ValueError for a prediction that diverged."""
    count = len(names)
    bare = replace(record, channels=tuple(names), data=np.zeros((count, record.samples)), noise=np.ones(count), weight=None)
    found = predict(engine, bare, [(state.model, state.angle, state.nuisances[0])])[0]
    if not np.isfinite(found).all():
        raise ValueError("the prediction diverges")
    return found


def _tip(engine: Engine, record: Observed, state: State) -> np.ndarray:
    """Predicted motion of the workpiece against the tool: x, y (m), x', y' (m/s), (4, samples)."""
    names = [motion_channel(f"{quantity}_{axis}", on) for on in ("workpiece", "tool")  # type: ignore[arg-type]
             for quantity in ("displacement", "velocity") for axis in AXES]
    found = _predicted(engine, record, state, names)
    return found[:4] - found[4:]


def _answered(course: Course, model: Model, record: Observed, moved: np.ndarray) -> CellForce:
    """What the linear chip law answers over the cells to a motion of the tip: x, y, x', y' (4, samples)."""
    if model.cutting is None or not len(course.cell):
        return CellForce(np.zeros(len(course.time)), np.zeros(len(course.time)))
    sine, cosine = np.sin(course.rows["angle"]), np.cos(course.rows["angle"])
    chip = np.zeros(len(course.cell))
    for axis, side in ((0, sine), (1, cosine)):
        motion = Trajectory(record.start, record.rate, moved[axis], moved[2 + axis])
        before = np.where(course.rows["first"], 0.0, motion.at(course.rows["earlier"])[0])
        chip += (motion.at(course.time[course.cell])[0] - before) * side
    load = course.rows["depth"] * chip
    edges = Edges(course.cell, course.share, {"angle": course.rows["angle"]})
    cutting = model.cutting
    return edges.force(cutting.tangential_coefficient * load, cutting.normal_coefficient * load, len(course.time))


def _seen(model: Model, force: CellForce, channel: str, rate: float) -> np.ndarray:
    """What a sensor of motion gives (samples,) of all modes' answer to a force over the cells."""
    sensor, quantity = sensor_of(channel), channel.removeprefix("tool_").split("_")[0]
    assert sensor is not None and force.across is not None
    whole = np.zeros(len(force.along) // SUBSTEPS + 1)
    for mode in model.structure.modes:
        if share := mode.seen(sensor.on, sensor.axis):
            alone = Model(Structure(mode.mass, mode.natural_frequency, mode.damping_ratio))
            pushed = mode.shape[0] * force.along + mode.shape[1] * force.across
            whole = whole + share * response(alone, pushed, rate, quantity)
    return whole
