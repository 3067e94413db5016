"""The fast engine: compiled, exact at cutter entry and exit, exact in free flight, one call for a batch."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace

import numpy as np

from testbed.catalogue import catalogue as known_effects
from testbed.cut import Cut, Cuts, Sampling
from testbed.effect import Effect
from testbed.engines import fast_kernel as fk
from testbed.engines import loop_kernel as lk
from testbed.engines import sampling_kernel as sk
from testbed.engines.kernel_runs import run_general, run_linear, run_plane, with_motions_asked
from testbed.engines.measure import measured_channels, senses
from testbed.engines.model_arrays import active_names, each_once, kind_of, runs_by
from testbed.engines.packing import Stack, pack_many
from testbed.engines.stiffening import stiffening, stiffens
from testbed.machine import Cutter, Model
from testbed.recording import ENGINE_UNITS, MOTION_UNITS, Outcome, Recording, Records

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
    cuts: Cuts
    effects: Mapping[str, Effect]
    clock: np.ndarray
    table: np.ndarray
    steps: int | None
    refinement: int
    forces: bool
    shape: tuple[int, int, int]  # channels, samples, passes
    most_steps: float  # within one sample, beyond which a run is not followed
    asked: Sequence[int] | None  # channels that `out` is to hold alone; None: the first `shape[0]`
    lean: bool  # whether kernels that sample no angle and know no measured durations may serve

    def of(self, runs: Sequence[int] | np.ndarray) -> _Batch:
        """The same of some runs."""
        models, cuts = [self.models[run] for run in runs], self.cuts.some(runs)
        return replace(self, models=models, cuts=cuts, clock=self.clock[runs], table=self.table[runs])

    def run(self, assumed: np.ndarray, linear: bool = False) -> BatchResult:
        """The runs, with steps for structures as stiff as `assumed` (runs,), each kind of them by kernels of its own.

        linear: by the kernel of the base model alone. NaN for those beyond `most_steps`.
        """
        kinds = runs_by(self._kernel_of, self.models)
        if len(kinds) == 1:
            return self._run(assumed, linear, next(iter(kinds)))
        groups = list(kinds.values())
        parts = [self.of(runs)._run(assumed[runs], False, kind) for kind, runs in kinds.items()]
        order = np.argsort(np.concatenate(groups))
        return BatchResult(*(array[order] for array in _together(*parts).arrays()))

    def _kernel_of(self, model: Model) -> tuple[bool, bool, bool]:
        planar, uneven, at_edges, _ = kind_of(model, self.effects)
        return planar, uneven, self.lean and planar and at_edges

    def _run(self, assumed: np.ndarray, linear: bool, kind: tuple[bool, bool, bool]) -> BatchResult:
        """The runs of one kind."""
        packed = pack_many(self.models, self.cuts, self.effects, self.steps, assumed, self.refinement)
        most = np.maximum(self.most_steps * self.clock[:, 1] * packed.nominal_pass, self.refinement * ALWAYS_TAKEN)
        followed = np.flatnonzero(packed.steps_of_pass <= most)
        if len(followed) == len(self.models):
            return self._simulated(packed, linear, kind)
        runs, (signals, count, passes) = len(self.models), self.shape
        rows = signals if self.asked is None else len(self.asked)
        whole = BatchResult(np.full((runs, rows, count), np.nan), np.full((runs, passes + 1), np.nan),
                            np.full((runs, passes + 1, 2), np.nan), np.full(runs, fk.OUTCOME_DIVERGED),
                            np.zeros(runs))  # fmt: skip
        if len(followed):
            part = self.of(followed)._simulated(packed.some(followed), linear, kind)
            for one in fields(BatchResult):
                getattr(whole, one.name)[followed] = getattr(part, one.name)
        return whole

    def _simulated(self, packed: Stack, linear: bool, kind: tuple[bool, bool, bool]) -> BatchResult:
        """The runs of one kind as they are packed, all of them followed."""
        runs, (signals, count, passes), (planar, _, at_edges) = len(self.models), self.shape, kind
        asked = range(signals) if self.asked is None else self.asked
        lean = planar and (linear or at_edges)  # such a kernel fills nothing that is not asked for
        result = BatchResult(np.empty((runs, len(asked) if lean else signals, count)), np.empty((runs, passes + 1)),
                             np.empty((runs, passes + 1, 2)), np.empty(runs, dtype=np.int64), np.empty(runs))  # fmt: skip
        found = result.arrays()
        if lean:
            run_plane(packed, self.effects, linear, asked, self.clock, self.forces, LIMIT, found)
        elif linear:
            run_linear(packed, self.clock, LIMIT, found)
        else:
            clock = with_motions_asked(self.clock, self.asked, self.models, self.effects) if planar else self.clock
            run_general(packed, self.effects, planar, self.table, clock, self.forces, LIMIT, found)
        if not planar and signals > sk.N_CHANNELS:
            result.out[:, sk.N_CHANNELS :] = 0.0 * result.out[:, :1]  # NaN where the run diverged
        if lean or self.asked is None:
            return result
        side_by_side = list(asked) == list(range(asked[0], asked[0] + len(asked)))  # then nothing has to be copied
        return replace(result, out=result.out[:, slice(asked[0], asked[-1] + 1) if side_by_side else list(asked)])


def simulate_batch(
    models: Sequence[Model],
    cuts: Sequence[Cut],
    samplings: Sequence[Sampling] | None,
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
    asked: Sequence[int] | None = None,
) -> BatchResult:
    """Simulate runs side by side; every run's samples and passes are padded with NaN to the longest.

    samplings: None where no record is wanted: times and states of the passes alone, which takes a fifth of the time.
    durations: measured times of the tooth passes (s), one array a run, in place of the nominal speed. general: take the
    general kernel even where the linear one would do. signals: how many channels `out` holds: 1 (the displacement), 3 (the
    motion along the feed), 6 or 15 (see `sampling_kernel`; what is across the feed or on the tool is filled for structures
    that move there). alike: the runs differ little, and all may have steps as fine as the first needs. refinement: how many
    times as many steps as are chosen, a whole number. most_steps: within one sample; a run that takes more is not followed:
    NaN, outcome "diverged" at 0. asked: those channels that `out` is to hold alone, by their places. Arrays are as the sensor
    sits on the structure, before any effect of the sensor itself.
    """
    effects, columns = known_effects() if catalogue is None else catalogue, Cuts.of(cuts)
    passes = int(columns.total_passes.max())
    table = np.zeros((len(models), 0 if durations is None else passes))
    for row, values in zip(table, durations or (), strict=False):
        row[: len(values)] = values
    clock = np.array([[sampling.start, sampling.rate] for sampling in samplings]) if samplings else np.ones((len(models), 2))
    batch = _Batch(models, columns, effects, clock, table, steps, refinement, forces,
                   (signals, max((sampling.count for sampling in samplings or ()), default=0), passes), most_steps,
                   asked, not (general or table.shape[1] or forces and (asked is None or sk.ANGLE in asked)))  # fmt: skip
    assumed = np.ones(len(models))
    if batch.lean and not forces and all(kind_of(model, effects).base for model in each_once(models)):
        return batch.run(assumed, linear=True)
    if steps is not None:
        return batch.run(assumed)
    if not (alike and len(models) > 1 and stiffens(models[0], effects)):
        return _refined(batch, batch.run(assumed), assumed)[0]
    one = batch.of([0])
    first, stiff = _refined(one, one.run(assumed[:1]), assumed[:1])
    assumed[:] = stiff
    return _refined(batch, _together(first, batch.of(range(1, len(models))).run(assumed[1:])), assumed)[0]


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
    movable = runs_by(lambda model: stiffens(model, effects), models).get(True, [])
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
        part = batch.of(again).run(assumed[again])
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


def simulate_side_by_side(models: Sequence[Model], cuts: Cuts, counts: np.ndarray, rate: float, *,
                          channels: Sequence[str] = ("displacement",), steps: int | None = None,
                          catalogue: Mapping[str, Effect] | None = None) -> Records:  # fmt: skip
    """What `simulate` gives for each run, to the bit. counts: samples of each, (runs,), at `rate` (Hz) from time 0 on."""
    effects = known_effects() if catalogue is None else catalogue
    kinds = runs_by(lambda model: (not model.effects, kind_of(model, effects).base), models)
    if len(kinds) > 1:
        parts = [simulate_side_by_side([models[run] for run in runs], cuts.some(runs), counts[runs], rate, channels=channels,
                                       steps=steps, catalogue=effects) for runs in kinds.values()]  # fmt: skip
        return Records.joined(parts, np.argsort(np.concatenate(list(kinds.values()))))
    alone, clock = set(channels) == {"displacement"} and not models[0].effects, Sampling(rate, int(counts.max()))
    result = simulate_batch(models, cuts, [clock] * len(models), steps=steps, catalogue=effects,
                            forces=bool({"force_x", "force_y"} & set(channels)),
                            general=not set(channels) <= _LINEAR_CHANNELS,
                            signals=1 if alone else signals_for(channels))  # fmt: skip
    signals = {name: result.out[:, place] for name, place in CHANNELS.items() if place < result.out.shape[1]}
    wanted = {name: signals[name] for name in channels}
    if any(senses(model, effects) for model in each_once(models)):
        wanted = {name: np.array(values) for name, values in wanted.items()}
        for run, (model, count) in enumerate(zip(models, counts.tolist(), strict=True)):
            own = {name: values[run, :count] for name, values in signals.items()}
            for name, values in measured_channels(model, effects, own, channels, Sampling(rate, count)).items():
                wanted[name][run, :count] = values
    flutes = (models[0].cutter or Cutter()).flutes
    outcomes = [_OUTCOMES[one] for one in result.outcome.tolist()]
    return Records(wanted, result.pass_times[:, ::flutes], result.pass_times, outcomes, result.outcome_time)


simulate.__dict__["side_by_side"] = simulate_side_by_side  # a sweep looks for it there

__all__ = ["BatchResult", "lk", "simulate", "simulate_batch", "simulate_side_by_side"]
