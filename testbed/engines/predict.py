"""The fast engine as the analysis is handed it: many variants of one record at once, as the sensor would give them."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from testbed.catalogue import catalogue as known_effects
from testbed.cut import REMEMBERED, Cut, Sampling
from testbed.effect import Effect
from testbed.engines import fast
from testbed.engines import sampling_kernel as sk
from testbed.engines.compose import FAST, compose
from testbed.engines.grid import STEP_PHASE
from testbed.engines.measure import asks_rates, measured_channels, senses
from testbed.engines.model_arrays import kind_of, state_place
from testbed.engines.packing import pack_many
from testbed.engines.stiffening import fastest_frequency
from testbed.machine import Model
from testbed.recording import sensor_of

LARGEST = 3.0  # a swing is followed back no further than to where it was exp(3) times what it is at the first sample
MOST_SUBSTEPS = 200  # steps within one sample, beyond which a driven structure is not followed
# The same of a cut: half again what a vibration at half the sampling rate takes, the fastest that samples can show. A
# descent's trial at a bound (100 kHz, a spring of 1e15 N/m^3) would take a hundred times as many, and minutes a record.
MOST_STEPS = 32
_STILL = Cut(spindle_speed=1.0, axial_depth_of_cut=0.0)  # a driven structure is not cut


def predict_cuts(
    models: Sequence[Model],
    cuts: Sequence[Cut],
    samplings: Sequence[Sampling],
    channels: Sequence[str],
    *,
    durations: Sequence[np.ndarray] | None = None,
    catalogue: Mapping[str, Effect] | None = None,
    refinement: int = 1,
    first: np.ndarray | None = None,
) -> np.ndarray:
    """Predicted channels of cuts that share their sampling's count, shape (runs, channels, samples).

    NaN after divergence, and where more than MOST_STEPS steps would be taken within one sample.

    refinement: how many times as many steps as the engine would choose. first: what this gave for the first run alone, shape
    (1, channels, samples), where that is at hand: it is then not simulated again if it would come out the same beside others.
    """
    effects = known_effects() if catalogue is None else catalogue
    forces = any(name.startswith("force") for name in channels)
    if first is not None and len(models) > 1 and fast.same_alone(models, effects):
        others = None if durations is None else durations[1:]
        found = predict_cuts(models[1:], cuts[1:], samplings[1:], channels, durations=others, catalogue=effects,
                             refinement=refinement)  # fmt: skip
        return np.concatenate([first, found])
    signals = _signals(models, effects, channels)
    sensed = any(senses(model, effects) for model in models)
    firsts = _motions(models, cuts, samplings, durations, effects) if sensed else list(range(len(models)))
    moved = sorted(set(firsts))
    places = [fast.CHANNELS[name] for name in channels]
    result = fast.simulate_batch(
        [models[run] for run in moved], [cuts[run] for run in moved], [samplings[run] for run in moved], forces=forces,
        catalogue=effects, durations=None if durations is None else [durations[run] for run in moved],
        refinement=refinement, alike=True, signals=signals, most_steps=MOST_STEPS * refinement,
        asked=None if sensed else places)  # fmt: skip
    if not sensed:
        return result.out[..., : samplings[0].count]
    outs = dict(zip(moved, result.out, strict=True))
    return np.stack([_sensed(models[run], effects, outs[first], channels, samplings[run], cuts[run])
                     for run, first in enumerate(firsts)])  # fmt: skip


def _motions(models: Sequence[Model], cuts: Sequence[Cut], samplings: Sequence[Sampling],
             durations: Sequence[np.ndarray] | None, effects: Mapping[str, Effect]) -> list[int]:  # fmt: skip
    """For every run, the first that moves as it does: what effects of the sensor alone make of a motion moves nothing."""
    first: dict[object, int] = {}

    def moves(run: int) -> object:
        model = models[run]
        moving = tuple((name, *values.items()) for name, values in model.effects.items()
                       if set(effects[name].hooks) != {"measure"})
        lasting = None if durations is None else durations[run].tobytes()
        return model.structure, model.cutter, model.cutting, moving, cuts[run], samplings[run], lasting

    return [first.setdefault(moves(run), run) for run in range(len(models))]


def _signals(models: Sequence[Model], effects: Mapping[str, Effect], channels: Sequence[str]) -> int:
    """How many of the fast engine's channels it takes to predict these."""
    most = max(fast.CHANNELS[name] for name in channels)
    if most >= sk.N_MOTION:
        return fast.signals_for(channels)
    return sk.N_MOTION if most > 0 or any(asks_rates(model, effects) for model in models) else 1


def predict_driven(
    models: Sequence[Model],
    states: Sequence[tuple[float, float]],
    force: np.ndarray,
    rate: float,
    channels: Sequence[str],
    *,
    catalogue: Mapping[str, Effect] | None = None,
    limit: float = math.inf,
    refinement: int = 1,
    own: Sequence[Mapping[str, float]] = (),
    along: tuple[float, float] = (1.0, 0.0),
) -> np.ndarray:
    """Predicted channels of a structure under a sampled force (N) from states (x, v) at the first sample.

    Of a structure that moves in the plane the states are the first mode's; the models are then all of that kind. along: the
    direction (x, y) of the force, by which it acts on every mode as a cutting force does.

    Shape (runs, channels, samples); zeros for `force` make it a free decay; NaN where a step would have to be absurdly short.
    refinement: how many times as many steps as the engine would choose. own: of each run, the states of effects and of further
    modes at the first sample by their paths (`second_mode.deflection`, `modes[1].velocity`), where they are not 0.
    """
    effects = known_effects() if catalogue is None else catalogue
    fastest = max(fastest_frequency(model, effects) for model in models)
    substeps = refinement * max(1, math.ceil(fastest / rate / STEP_PHASE)) if any(model.effects for model in models) else 1
    if substeps > refinement * MOST_SUBSTEPS:  # a friction far stiffer than anything these samples could show
        return np.full((len(models), len(channels), len(force)), np.nan)
    A, P, G, integers, O, Y = pack_many(models, [_STILL] * len(models), effects).arrays()
    Y[:, :2] = states
    for row, begun in zip(Y, own, strict=False):
        for path, value in begun.items():
            row[state_place(effects, path)] = value
    out = np.zeros((len(models), fast.signals_for(channels), len(force)))
    kernel = compose(effects, (*FAST, "drive_kernel"), kind_of(models[0], effects).planar)
    kernel.drive_batch(
        A,
        P,
        G,
        integers,
        O,
        Y,
        np.tile(force, (len(models), 1)),  # a view would be of another type, and the kernel compiled once more
        *along,
        rate,
        substeps,
        limit,
        out,
        np.zeros(len(models), dtype=np.bool_),
    )
    sampling = Sampling(rate, len(force))
    return np.stack([_sensed(model, effects, out[run], channels, sampling) for run, model in enumerate(models)])


def _sensed(
    model: Model, effects: Mapping[str, Effect], out: np.ndarray, channels: Sequence[str], sampling: Sampling,
    cut: Cut = _STILL,
) -> np.ndarray:  # fmt: skip
    """What the sensor gives of a run (channels, samples); it has followed a swing that is there when the samples begin."""
    signals = {name: out[place, : sampling.count] for name, place in fast.CHANNELS.items() if place < len(out)}
    lead = 0
    if 0.0 < cut.held_until == sampling.start:
        before = _swing_before(model, cut, sampling.rate)
        lead = len(before["displacement"])
        signals = {name: np.concatenate([before.get(name, np.full(lead, one[0])), one]) for name, one in signals.items()}
        sampling = replace(sampling, count=sampling.count + lead, start=sampling.start - lead / sampling.rate)
    measured = measured_channels(model, effects, signals, channels, sampling)
    return np.stack([measured[name][lead:] for name in channels])


def _swing_before(model: Model, cut: Cut, rate: float) -> dict[str, np.ndarray]:
    """Samples, by channel, of the free vibration that leads to the state with which an underdamped structure is let go."""
    modes = model.structure.modes
    fastest = max(mode.damping_ratio * mode.natural_frequency_rad for mode in modes)
    time = -np.arange(math.floor(LARGEST / max(fastest, LARGEST / REMEMBERED) * rate), 0, -1) / rate
    begun = {"modes[0].displacement": cut.initial_displacement, "modes[0].velocity": cut.initial_velocity, **dict(cut.states)}
    sensors = {name: sensor for name in fast.CHANNELS if (sensor := sensor_of(name)) is not None}
    found = {name: np.zeros(len(time)) for name in sensors}
    for place, mode in enumerate(modes):
        x, v = (begun.get(f"modes[{place}].{name}", 0.0) for name in ("displacement", "velocity"))
        omega, decay = mode.natural_frequency_rad, mode.damping_ratio * mode.natural_frequency_rad
        damped = math.sqrt(omega**2 - decay**2)
        cosine, sine = np.cos(damped * time), np.sin(damped * time) / damped
        displacement = np.exp(-decay * time) * (x * cosine + (v + decay * x) * sine)
        velocity = np.exp(-decay * time) * (v * cosine - (omega**2 * x + decay * v) * sine)
        motion = displacement, velocity, -2.0 * decay * velocity - omega**2 * displacement
        for name, sensor in sensors.items():
            found[name] += mode.seen(sensor.on, sensor.axis) * motion[sensor.order]
    return found
