"""The fast engine: compiled, exact at cutter entry and exit, exact in free flight, one call for a batch."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace
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
from testbed.engines.packing import Packed, active_names, pack, stacked
from testbed.engines.stiffening import stiffening, stiffens
from testbed.machine import Cutter, Model
from testbed.recording import ENGINE_UNITS, MOTION_UNITS, Outcome, Recording

_NO_EFFECTS: Mapping[str, Effect] = MappingProxyType({})
STIFFER = 1.05  # a structure stiffened beyond this, in frequency, is run again with finer steps
STIFFEST = 6.0  # in frequency: what seems stiffer diverged, by its steps or by itself, and would take for ever
REFINEMENTS = 4  # how often: after a coarse run the motion itself may still change
ALWAYS_TAKEN = 4_000  # steps a pass: few samples may show a motion that stiffens as it grows, which takes many steps each
LIMIT = 1.0  # m; a displacement beyond it is a run that has diverged
CHANNELS = {
    "displacement": sk.SENSED_X,
    "velocity": sk.SENSED_V,
    "acceleration": sk.SENSED_A,
    "force_x": sk.FORCE_X,
    "force_y": sk.FORCE_Y,
    "spindle_angle": sk.ANGLE,
} | {f"{sensor}{quantity}_{axis}": first + order
     for sensor, axis, first in (("", "x", sk.SENSED_X), ("", "y", sk.ACROSS),
                                 ("tool_", "x", sk.TOOL_X), ("tool_", "y", sk.TOOL_Y))
     for order, quantity in enumerate(MOTION_UNITS)}  # fmt: skip
UNITS = {name: ENGINE_UNITS[name] for name in CHANNELS}
_OUTCOMES: dict[int, Outcome] = {fk.OUTCOME_OK: "ok", fk.OUTCOME_DIVERGED: "diverged"}
_LINEAR_CHANNELS = {name for name in CHANNELS if name not in ("force_x", "force_y", "spindle_angle")}


@dataclass(frozen=True)
class BatchResult:
    """Runs side by side: out (runs, channels, samples), pass_times (runs, passes + 1), pass_states (runs, passes + 1, 2)."""

    out: np.ndarray
    pass_times: np.ndarray
    pass_states: np.ndarray
    outcome: np.ndarray
    outcome_time: np.ndarray

    def arrays(self) -> tuple[np.ndarray, ...]:
        """All of that."""
        return self.out, self.pass_times, self.pass_states, self.outcome, self.outcome_time


@dataclass(frozen=True)
class _Batch:
    """Runs side by side and what is asked of them. clock (runs, 2): start, rate; table (runs, passes): measured durations."""

    models: Sequence[Model]
    cuts: Sequence[Cut]
    effects: Mapping[str, Effect]
    clock: np.ndarray
    table: np.ndarray
    steps: int | None
    refinement: int
    forces: bool
    shape: tuple[int, int, int]  # channels, samples, passes
    most_steps: float  # within one sample, beyond which a run is not followed

    def of(self, runs: Sequence[int]) -> _Batch:
        """The same of some runs."""
        models, cuts = [self.models[run] for run in runs], [self.cuts[run] for run in runs]
        return replace(self, models=models, cuts=cuts, clock=self.clock[runs], table=self.table[runs])

    def packed(self, assumed: np.ndarray) -> list[Packed]:
        """The runs with steps for structures as stiff as `assumed` (runs,)."""
        return [pack(model, cut, self.effects, self.steps, self.table.shape[1] > 0, stiff, self.refinement)
                for model, cut, stiff in zip(self.models, self.cuts, assumed, strict=True)]  # fmt: skip

    def run(self, packed: Sequence[Packed], linear: bool = False) -> BatchResult:
        """The runs as they are packed; NaN for those beyond `most_steps`. linear: by the kernel of the base model alone."""
        followed = [run for run, one in enumerate(packed)
                    if one.steps_of_pass <= max(self.most_steps * self.clock[run, 1] * one.nominal_pass,
                                                self.refinement * ALWAYS_TAKEN)]  # fmt: skip
        if len(followed) == len(packed):
            return self._run(packed, linear)
        runs, (signals, count, passes) = len(packed), self.shape
        whole = BatchResult(np.full((runs, signals, count), np.nan), np.full((runs, passes + 1), np.nan),
                            np.full((runs, passes + 1, 2), np.nan), np.full(runs, fk.OUTCOME_DIVERGED),
                            np.zeros(runs))  # fmt: skip
        if followed:
            part = self.of(followed)._run([packed[run] for run in followed], linear)
            for one in fields(BatchResult):
                getattr(whole, one.name)[followed] = getattr(part, one.name)
        return whole

    def _run(self, packed: Sequence[Packed], linear: bool) -> BatchResult:
        """The runs as they are packed, all of them followed: those of motion in the plane by kernels of their own."""
        kinds = [(one.planar, one.turn is not None) for one in packed]
        if len(set(kinds)) > 1:
            groups = [[run for run, kind in enumerate(kinds) if kind == each] for each in sorted(set(kinds))]
            parts = [self.of(runs)._run([packed[run] for run in runs], False) for runs in groups]
            order = np.argsort(np.concatenate(groups))
            return BatchResult(*(array[order] for array in _together(*parts).arrays()))
        planar, uneven = kinds[0]
        runs, (signals, count, passes) = len(packed), self.shape
        A, P, G, I, O, Y = stacked(packed)  # noqa: E741
        result = BatchResult(np.empty((runs, signals, count)), np.empty((runs, passes + 1)), np.empty((runs, passes + 1, 2)),
                             np.empty(runs, dtype=np.int64), np.empty(runs))  # fmt: skip
        found = result.arrays()
        if linear:
            kernel = compose(_NO_EFFECTS, (*FAST, "linear_kernel"))
            kernel.run_linear_batch(G, I, Y, self.clock, LIMIT, *found)
        elif uneven:
            kernel = compose(self.effects, (*FAST, "turn_kernel", "uneven_kernel"), True)
            for run, turn in enumerate(one.turn for one in packed):
                assert turn is not None
                result.outcome[run], result.outcome_time[run] = kernel.run_uneven(
                    A[run], P[run], G[run], I[run], O[run, : I[run, fk.CARRIED]], Y[run], turn.corners, turn.steps, turn.firsts,
                    turn.tooth, self.table[run], self.clock[run], self.forces, LIMIT,
                    *(array[run] for array in found[:3]))  # fmt: skip
        else:
            kernel = compose(self.effects, FAST, planar)
            kernel.run_batch(A, P, G, I, O, Y, self.table, self.clock, self.forces, LIMIT, *found)
        if not planar and signals > sk.N_CHANNELS:
            result.out[:, sk.N_CHANNELS :] = 0.0 * result.out[:, :1]  # NaN where the run diverged
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
    most_steps: float = math.inf,
) -> BatchResult:
    """Simulate runs side by side; every run's samples and passes are padded with NaN to the longest.

    durations: measured times of the tooth passes (s), one array a run, in place of the nominal speed. general: take the
    general kernel even where the linear one would do. signals: how many channels `out` holds: 1 (the displacement), 3 (the
    motion along the feed), 6 or 15 (see `sampling_kernel`; what is across the feed or on the tool is filled for structures
    that move there). alike: the runs differ little, and all may have steps as fine as the first needs. refinement: how many
    times as many steps as are chosen, a whole number. most_steps: within one sample; a run that takes more is not followed:
    NaN, outcome "diverged" at 0. Arrays are as the sensor sits on the structure, before any effect of the sensor itself.
    """
    effects = known_effects() if catalogue is None else catalogue
    passes = max(cut.total_passes for cut in cuts)
    table = np.zeros((len(models), 0 if durations is None else passes))
    for row, values in zip(table, durations or (), strict=False):
        row[: len(values)] = values
    clock = np.array([[sampling.start, sampling.rate] for sampling in samplings])
    batch = _Batch(models, cuts, effects, clock, table, steps, refinement, forces,
                   (signals, max(sampling.count for sampling in samplings), passes), most_steps)  # fmt: skip
    assumed = np.ones(len(models))
    packed = batch.packed(assumed)
    if not (general or forces) and all(one.base for one in packed):
        return batch.run(packed, linear=True)
    if steps is not None:
        return batch.run(packed)
    if not (alike and len(models) > 1 and stiffens(models[0], effects)):
        return _refined(batch, batch.run(packed), assumed)[0]
    first, stiff = _refined(batch.of([0]), batch.run(packed[:1]), assumed[:1])
    others = batch.of(range(1, len(models)))
    assumed[:] = stiff
    return _refined(batch, _together(first, others.run(others.packed(assumed[1:]))), assumed)[0]


def same_alone(models: Sequence[Model], catalogue: Mapping[str, Effect]) -> bool:
    """Whether the runs of these models are one by one what they are side by side, `alike`: same kernel, same steps."""
    kinds = {(*model.effects, "active:", *active_names(model, catalogue)) for model in models}
    return len(kinds) == 1 and not stiffens(models[0], catalogue)


def _together(*parts: BatchResult) -> BatchResult:
    """The runs of all of them, one after the other."""
    return BatchResult(*(np.concatenate(one) for one in zip(*(part.arrays() for part in parts), strict=True)))


def _refined(batch: _Batch, result: BatchResult, assumed: np.ndarray) -> tuple[BatchResult, np.ndarray]:
    """The runs, with finer steps for what has moved so far that its structure became stiffer than the steps were made for.

    assumed: how stiff that was, (runs,). Returns the same of the last steps, too.
    """
    assumed, models, effects = assumed.copy(), batch.models, batch.effects
    movable = [run for run, model in enumerate(models) if stiffens(model, effects)]
    for _ in range(REFINEMENTS):
        again = []
        for run in (one for one in movable if np.isfinite(result.pass_states[one]).any()):
            x, v = result.pass_states[run, :, 0], result.pass_states[run, :, 1]
            amplitude = float(np.nanmax(np.hypot(x, v / models[run].structure.natural_frequency_rad)))
            found = min(stiffening(models[run], effects, amplitude), STIFFEST)
            if found > STIFFER * assumed[run]:
                again.append(run)
                assumed[run] = found
        if not again:
            break
        finer = batch.of(again)
        part = finer.run(finer.packed(assumed[again]))
        for one in fields(BatchResult):
            getattr(result, one.name)[again] = getattr(part, one.name)
    return result, assumed


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

    Motion without an axis in its name is along the feed, x; `tool_...` is what a sensor on the tool sees, all other motion what
    one on the workpiece sees. On a structure of one mode along the feed the tool and all across the feed stand still.
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
        signals=1 if alone else signals_for(channels),
    )
    return _recording(result, 0, model, cut, sampling, channels, effects, alone)


def signals_for(channels: Sequence[str]) -> int:
    """How many rows of `out` it takes for these channels, and for what the sensor's own effects may ask besides."""
    return sk.N_PLANE if any(CHANNELS[name] >= sk.N_CHANNELS for name in channels) else sk.N_CHANNELS


def _recording(result: BatchResult, run: int, model: Model, cut: Cut, sampling: Sampling, channels: Sequence[str],
               effects: Mapping[str, Effect], alone: bool) -> Recording:  # fmt: skip
    """One run of a batch, sampled after the sensor's own effects; `alone`: of the displacement, which none of them alters."""
    signals = {name: result.out[run, place, : sampling.count]
               for name, place in CHANNELS.items() if place < result.out.shape[1]}
    times, states = result.pass_times[run, : cut.total_passes + 1], result.pass_states[run, : cut.total_passes + 1]
    cutter = model.cutter or Cutter()
    return Recording(
        channels={"displacement": signals["displacement"]} if alone
        else measured_channels(model, effects, signals, channels, sampling),
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
