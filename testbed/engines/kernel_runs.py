"""Packed runs through each of the fast engine's kernels; `found`: the arrays of its `BatchResult`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import NamedTuple

import numpy as np

from testbed.effect import Effect
from testbed.engines import fast_kernel as fk
from testbed.engines import sampling_kernel as sk
from testbed.engines.compose import FAST, Layout, compose
from testbed.engines.model_arrays import active_names, acts_at_edges, each_once, layout_of
from testbed.engines.packing import Stack
from testbed.machine import Model

UNEVEN = (*FAST, "turn_kernel", "uneven_kernel")
_NO_EFFECTS: Mapping[str, Effect] = MappingProxyType({})
_MOTIONS = [first + order for first in (sk.SENSED_X, sk.ACROSS, sk.TOOL_X, sk.TOOL_Y) for order in range(sk.N_MOTION)]
_FORCES = [sk.FORCE_X, sk.FORCE_Y]


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


class _AtEdges(NamedTuple):
    """Of a catalogue: those effects that act at the edges alone, and where their flags and parameters stand in A and P."""

    catalogue: Mapping[str, Effect]
    effects: Mapping[str, Effect]
    flags: list[int]
    parameters: list[int]


_at_edges: dict[int, _AtEdges] = {}


def _of_edges(catalogue: Mapping[str, Effect]) -> _AtEdges:
    known = _at_edges.get(id(catalogue))
    if known is None or known.catalogue is not catalogue:
        whole, some = layout_of(catalogue), {name: effect for name, effect in catalogue.items() if acts_at_edges(effect)}
        own = Layout(some)
        known = _at_edges[id(catalogue)] = _AtEdges(catalogue, some, [whole.flag[name] for name in own.flag],
                                                    [whole.parameter[path] for path in own.parameter])
    return known


def run_plane(packed: Stack, catalogue: Mapping[str, Effect], base: bool, asked: Sequence[int], clock: np.ndarray, forces: bool,
              limit: float, found: Sequence[np.ndarray]) -> None:  # fmt: skip
    """Runs in the plane with effects at the edges alone; base: without any, and without forces.

    asked: which channel each row of `out` holds. forces: they are sampled, too.
    """
    wanted = [*_MOTIONS, *(_FORCES if forces else (None, None)), None]
    rows = np.array([asked.index(one) if one in asked else -1 for one in wanted]).reshape(-1, sk.N_MOTION)
    A, P, runs = packed.A, packed.P, len(packed.Y)
    if base:
        kernel = compose(_NO_EFFECTS, (*FAST, "modes_kernel", "plane_linear_kernel", "plane_run_kernel"))
    else:
        of = _of_edges(catalogue)
        kernel = compose(of.effects, (*FAST, "modes_kernel", "plane_edge_kernel", "plane_run_kernel"), True, True)
        no_modes = np.zeros((runs, 1 + (not of.parameters)))  # in P: the kernel is given the modes aside
        A, P = np.ascontiguousarray(A[:, of.flags]), np.concatenate([P[:, of.parameters], no_modes], axis=1)
    kernel.run_plane_batch(A, P, packed.G, packed.I, *packed.modes(layout_of(catalogue)), packed.Y, rows, clock, limit, *found)


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


def run_general(packed: Stack, effects: Mapping[str, Effect], planar: bool, table: np.ndarray, clock: np.ndarray, forces: bool,
                limit: float, found: Sequence[np.ndarray]) -> None:  # fmt: skip
    """Any runs. table: measured durations of the passes, s."""
    if not packed.turns:
        compose(effects, FAST, planar).run_batch(*packed.arrays(), table, clock, forces, limit, *found)
        return
    kernel = compose(effects, UNEVEN, True)
    A, P, G, I, O, Y = packed.arrays()  # noqa: E741
    *filled, outcome, outcome_time = found
    for run, turn in enumerate(packed.turns):  # teeth of unequal pitch, each run on the grid of its revolution
        outcome[run], outcome_time[run] = kernel.run_uneven(
            A[run], P[run], G[run], I[run], O[run, : I[run, fk.CARRIED]], Y[run], turn.corners, turn.steps, turn.firsts,
            turn.tooth, table[run], clock[run], forces, limit, *(array[run] for array in filled))  # fmt: skip
