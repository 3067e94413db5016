"""The fast engine: compiled, exact at cutter entry and exit, exact in free flight, one call for a batch."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np

from testbed.catalogue import catalogue as known_effects
from testbed.cut import Cut, Sampling
from testbed.effect import Effect
from testbed.engines import fast_kernel as fk
from testbed.engines import loop_kernel as lk
from testbed.engines import sampling_kernel as sk
from testbed.engines.compose import FAST, compose
from testbed.engines.measure import measured_channels
from testbed.engines.packing import Packed, pack, stiffening, stiffens
from testbed.machine import Cutter, Model
from testbed.recording import Outcome, Recording

_NO_EFFECTS: Mapping[str, Effect] = MappingProxyType({})
STIFFER = 1.05  # a structure stiffened beyond this, in frequency, is run again with finer steps
STIFFEST = 6.0  # in frequency: what seems stiffer diverged, by its steps or by itself, and would take for ever
REFINEMENTS = 4  # how often: after a coarse run the motion itself may still change
LIMIT = 1.0  # m; a displacement beyond it is a run that has diverged
CHANNELS = {
    "displacement": sk.SENSED_X,
    "velocity": sk.SENSED_V,
    "acceleration": sk.SENSED_A,
    "force_x": sk.FORCE_X,
    "force_y": sk.FORCE_Y,
    "spindle_angle": sk.ANGLE,
}
UNITS = {
    "displacement": "m",
    "velocity": "m/s",
    "acceleration": "m/s^2",
    "force_x": "N",
    "force_y": "N",
    "spindle_angle": "rad",
}
_OUTCOMES: dict[int, Outcome] = {fk.OUTCOME_OK: "ok", fk.OUTCOME_DIVERGED: "diverged"}
_LINEAR_CHANNELS = {"displacement", "velocity", "acceleration"}


@dataclass(frozen=True)
class BatchResult:
    """Runs side by side: out (runs, channels, samples), pass_times (runs, passes + 1), pass_states (runs, passes + 1, 2)."""

    out: np.ndarray
    pass_times: np.ndarray
    pass_states: np.ndarray
    outcome: np.ndarray
    outcome_time: np.ndarray


def _run(
    packed: Sequence[Packed],
    clock: np.ndarray,
    durations: np.ndarray,
    forces: bool,
    count: int,
    passes: int,
    catalogue: Mapping[str, Effect],
    linear: bool,
    signals: int,
) -> BatchResult:
    runs = len(packed)
    A, P, G, integers, O, Y = (np.ascontiguousarray([getattr(one, name) for one in packed]) for name in "APGIOY")
    result = BatchResult(
        np.empty((runs, signals, count)),
        np.empty((runs, passes + 1)),
        np.empty((runs, passes + 1, 2)),
        np.empty(runs, dtype=np.int64),
        np.empty(runs),
    )
    if linear:
        kernel = compose(_NO_EFFECTS, (*FAST, "linear_kernel"))
        kernel.run_linear_batch(
            G, integers, Y, clock, LIMIT, result.out, result.pass_times, result.pass_states, result.outcome, result.outcome_time
        )
    else:
        kernel = compose(catalogue, FAST)
        kernel.run_batch(
            A,
            P,
            G,
            integers,
            O,
            Y,
            durations,
            clock,
            forces,
            LIMIT,
            result.out,
            result.pass_times,
            result.pass_states,
            result.outcome,
            result.outcome_time,
        )
    return result


def simulate_batch(
    models: Sequence[Model],
    cuts: Sequence[Cut],
    samplings: Sequence[Sampling],
    *,
    forces: bool = False,
    steps: int | None = None,
    catalogue: Mapping[str, Effect] | None = None,
    durations: Sequence[np.ndarray] | None = None,
    general: bool = False,
    signals: int = sk.N_CHANNELS,
    alike: bool = False,
    refinement: int = 1,
) -> BatchResult:
    """Simulate runs side by side; every run's samples and passes are padded with NaN to the longest.

    durations: measured times of the tooth passes (s), one array a run, in place of the nominal speed. general: take the
    general kernel even where the linear one would do. signals: how many channels `out` holds: 1 (the displacement), 3 (the
    motion) or all. alike: the runs differ little, and all may have steps as fine as the first needs. refinement: how many
    times as many steps as are chosen, a whole number. Arrays are as the sensor sits on the structure, before any effect of
    the sensor itself.
    """
    effects = known_effects() if catalogue is None else catalogue
    assumed = np.ones(len(models))
    if alike and steps is None and len(models) > 1 and stiffens(models[0], effects):
        first = None if durations is None else durations[:1]
        assumed[:] = _simulated(models[:1], cuts[:1], samplings[:1], forces, None, effects, first, general, signals, refinement,
                                assumed[:1])[1][0]
    return _simulated(models, cuts, samplings, forces, steps, effects, durations, general, signals, refinement, assumed)[0]


def _simulated(models: Sequence[Model], cuts: Sequence[Cut], samplings: Sequence[Sampling], forces: bool, steps: int | None,
               effects: Mapping[str, Effect], durations: Sequence[np.ndarray] | None, general: bool, signals: int,
               refinement: int, assumed: np.ndarray) -> tuple[BatchResult, np.ndarray]:  # fmt: skip
    """The runs, begun with steps for structures as stiff as `assumed` (runs,), and how stiff they turned out to be."""
    packed = [
        pack(model, cut, effects, steps, durations is not None, stiff, refinement)
        for model, cut, stiff in zip(models, cuts, assumed, strict=True)
    ]
    count = max(sampling.count for sampling in samplings)
    passes = max(cut.total_passes for cut in cuts)
    clock = np.array([[sampling.start, sampling.rate] for sampling in samplings])
    table = np.zeros((len(packed), 0))
    if durations is not None:
        table = np.zeros((len(packed), passes))
        for row, values in zip(table, durations, strict=True):
            row[: len(values)] = values
    linear = not (general or forces) and all(one.base for one in packed)
    result = _run(packed, clock, table, forces, count, passes, effects, linear, signals)
    if steps is None and not linear:
        assumed = _refine(result, models, cuts, effects, clock, table, forces, refinement, assumed)
    return result, assumed


def _refine(result: BatchResult, models: Sequence[Model], cuts: Sequence[Cut], effects: Mapping[str, Effect],
            clock: np.ndarray, table: np.ndarray, forces: bool, refinement: int,
            assumed: np.ndarray) -> np.ndarray:  # fmt: skip
    """Run again, with finer steps, what has moved so far that its structure became stiffer than the steps were made for.

    assumed: how stiff that was, (runs,). Returns the same of the last steps.
    """
    assumed = assumed.copy()
    movable = [run for run, model in enumerate(models) if stiffens(model, effects)]
    for _ in range(REFINEMENTS):
        again = []
        for run in movable:
            x, v = result.pass_states[run, :, 0], result.pass_states[run, :, 1]
            amplitude = float(np.nanmax(np.hypot(x, v / models[run].structure.natural_frequency_rad)))
            found = min(stiffening(models[run], effects, amplitude), STIFFEST)
            if found > STIFFER * assumed[run]:
                again.append(run)
                assumed[run] = found
        if not again:
            break
        finer = [pack(models[run], cuts[run], effects, None, table.shape[1] > 0, assumed[run], refinement) for run in again]
        part = _run(finer, clock[again], table[again], forces, result.out.shape[2], result.pass_times.shape[1] - 1, effects,
                    False, result.out.shape[1])  # fmt: skip
        for name in ("out", "pass_times", "pass_states", "outcome", "outcome_time"):
            getattr(result, name)[again] = getattr(part, name)
    return assumed


def simulate(
    model: Model,
    cut: Cut,
    sampling: Sampling,
    *,
    channels: Sequence[str] = ("displacement",),
    steps: int | None = None,
    catalogue: Mapping[str, Effect] | None = None,
    durations: np.ndarray | None = None,
) -> Recording:
    """Simulate one test. See `testbed.recording` for what comes back; sampled after the sensor's own effects.

    steps: Runge-Kutta steps while the leading tooth crosses its cut; chosen where None, for an
    error of about 1e-6 of the peak (1e-5 to 1e-4 where a law is not smooth).
    """
    unknown = set(channels) - set(CHANNELS)
    if unknown:
        raise ValueError(f"no channel {', '.join(sorted(unknown))}; known: {', '.join(CHANNELS)}")
    effects = known_effects() if catalogue is None else catalogue
    general = not set(channels) <= _LINEAR_CHANNELS
    alone = not model.effects and durations is None and set(channels) == {"displacement"}
    result = simulate_batch(
        [model],
        [cut],
        [sampling],
        forces=bool({"force_x", "force_y"} & set(channels)),
        steps=steps,
        catalogue=effects,
        durations=None if durations is None else [durations],
        general=general,
        signals=1 if alone else sk.N_CHANNELS,
    )
    return _recording(result, 0, model, cut, sampling, channels, effects, alone)


def _recording(result: BatchResult, run: int, model: Model, cut: Cut, sampling: Sampling, channels: Sequence[str],
               effects: Mapping[str, Effect], alone: bool) -> Recording:  # fmt: skip
    """One run of a batch, sampled after the sensor's own effects; `alone`: of the displacement, which none of them alters."""
    signals = {name: result.out[run, place, : sampling.count]
               for name, place in CHANNELS.items() if place < result.out.shape[1]}
    times, states = result.pass_times[run, : cut.total_passes + 1], result.pass_states[run, : cut.total_passes + 1]
    cutter = model.cutter or Cutter()
    return Recording(
        channels=signals if alone else measured_channels(model, effects, signals, channels, sampling),
        sampling_rate=sampling.rate,
        units={name: UNITS[name] for name in channels},
        origin="predicted",
        start=sampling.start,
        marks=times[:: cutter.flutes],
        pass_times=times,
        outcome=_OUTCOMES[int(result.outcome[run])],
        outcome_time=float(result.outcome_time[run]),
        conditions={
            "spindle_speed": cut.spindle_speed,
            "axial_depth_of_cut": cut.axial_depth_of_cut,
            "feed_per_tooth": cut.feed_per_tooth,
            "pass_states": states,
        },
    )


def simulate_together(models: Sequence[Model], cuts: Sequence[Cut], samplings: Sequence[Sampling], *,
                      channels: Sequence[str] = ("displacement",), steps: int | None = None,
                      catalogue: Mapping[str, Effect] | None = None) -> list[Recording]:  # fmt: skip
    """What `simulate` gives for each run, in one call of the kernel where the runs are short work: base model, displacement."""
    effects = known_effects() if catalogue is None else catalogue
    runs = list(zip(models, cuts, samplings, strict=True))
    if set(channels) != {"displacement"} or any(model.effects for model in models):
        return [simulate(*run, channels=channels, steps=steps, catalogue=effects) for run in runs]
    result = simulate_batch(models, cuts, samplings, steps=steps, catalogue=effects, signals=1)
    return [_recording(result, place, *run, channels, effects, True) for place, run in enumerate(runs)]


simulate.__dict__["together"] = simulate_together  # a sweep looks for it there


__all__ = ["BatchResult", "lk", "simulate", "simulate_batch", "simulate_together"]
