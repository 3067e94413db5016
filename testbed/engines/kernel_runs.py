"""Packed runs through each of the fast engine's kernels but the general one; `found`: the arrays of its `BatchResult`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from types import MappingProxyType, ModuleType

import numpy as np

from testbed.effect import Effect
from testbed.engines import fast_kernel as fk
from testbed.engines import sampling_kernel as sk
from testbed.engines.compose import FAST, Layout, compose
from testbed.engines.model_arrays import active_names, each_once
from testbed.engines.packing import Stack
from testbed.machine import Model

UNEVEN = (*FAST, "turn_kernel", "uneven_kernel")
_NO_EFFECTS: Mapping[str, Effect] = MappingProxyType({})
_MOTIONS = [first + order for first in (sk.SENSED_X, sk.ACROSS, sk.TOOL_X, sk.TOOL_Y) for order in range(sk.N_MOTION)]


def with_motions_asked(clock: np.ndarray, asked: Sequence[int] | None, models: Sequence[Model],
                       effects: Mapping[str, Effect]) -> np.ndarray:  # fmt: skip
    """The clocks of runs in the plane, and behind them, where the structure's own motion is all that is asked for, what of it.

    See `sampling_kernel.CLOCK`.
    """
    if asked is None or not set(asked) <= set(_MOTIONS):
        return clock
    hooks = {hook for model in each_once(models) for name in active_names(model, effects) for hook in effects[name].hooks}
    if any(hook.startswith("sensed_") for hook in hooks):
        return clock
    rows = np.isin(np.arange(sk.N_PLANE), asked).astype(float)
    return np.concatenate([clock, np.tile(rows, (len(clock), 1))], axis=1)


def run_plane_linear(packed: Stack, layout: Layout, asked: Sequence[int], clock: np.ndarray, limit: float,
                     found: Sequence[np.ndarray]) -> None:  # fmt: skip
    """Base models in the plane. asked: which channel each row of `out` holds."""
    kernel = compose(_NO_EFFECTS, (*FAST, "modes_kernel", "plane_linear_kernel"))
    rows = np.array([asked.index(one) if one in asked else -1 for one in _MOTIONS]).reshape(-1, sk.N_MOTION)
    kernel.run_plane_linear_batch(packed.G, packed.I, *packed.modes(layout), packed.Y, rows, clock, limit, *found)


def run_linear(packed: Stack, clock: np.ndarray, limit: float, found: Sequence[np.ndarray]) -> None:
    """Base models of one mode along the feed; those without samples side by side."""
    kernel, runs = compose(_NO_EFFECTS, (*FAST, "linear_kernel", "silent_kernel")), len(packed.Y)
    G, I, Y = packed.G, packed.I, packed.Y  # noqa: E741
    silent = found[0].shape[2] == 0
    groups, others = packed.side_by_side(kernel.LANES) if silent else (np.empty((0, 1), np.intp), np.arange(runs))
    if len(groups):
        kernel.run_silent_batch(G, I, Y, groups, limit, *found[1:])
    if len(others) == runs:
        kernel.run_linear_batch(G, I, Y, clock, limit, *found)
    elif len(others):
        some = [array[others] for array in found]
        kernel.run_linear_batch(G[others], I[others], Y[others], clock[others], limit, *some)
        for array, part in zip(found, some, strict=True):
            array[others] = part


def run_uneven(packed: Stack, kernel: ModuleType, table: np.ndarray, clock: np.ndarray, forces: bool, limit: float,
               found: Sequence[np.ndarray]) -> None:  # fmt: skip
    """Teeth of unequal pitch, each run on the grid of its revolution. table: measured durations of the passes, s."""
    A, P, G, I, O, Y = packed.arrays()  # noqa: E741
    *filled, outcome, outcome_time = found
    for run, turn in enumerate(packed.turns):
        outcome[run], outcome_time[run] = kernel.run_uneven(
            A[run], P[run], G[run], I[run], O[run, : I[run, fk.CARRIED]], Y[run], turn.corners, turn.steps, turn.firsts,
            turn.tooth, table[run], clock[run], forces, limit, *(array[run] for array in filled))  # fmt: skip
