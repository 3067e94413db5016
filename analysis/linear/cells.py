"""The largest multipliers of many cuts of one machine: the cells of a chart.

The order of a cell's spectral elements follows the oscillations that its cut spans. Its largest multiplier is corrected by the
characteristic equation at a higher order; where that moves it the order is raised, and what does not settle is not a number.
Cells of like oscillations share their elements, so that compiled code runs through them.
"""

from __future__ import annotations

import math

import numpy as np

from testbed.analysis.linear.characteristic import corrected
from testbed.analysis.linear.delay_equation import DelayEquation, milling_equation
from testbed.analysis.linear.dominant import DENSE, largest_of
from testbed.analysis.linear.lane_correction import corrected_multipliers
from testbed.analysis.linear.lane_maps import rough_multipliers
from testbed.analysis.linear.lanes import LANES
from testbed.analysis.linear.planar_multipliers import planar_largest
from testbed.analysis.linear.spectral_elements import (
    FINER,
    TABLES,
    TOLERANCE,
    Elements,
    divided,
    element_maps,
    sampled,
    swing_rate,
)
from testbed.analysis.linear.temporal_elements import transition_matrix
from testbed.cut import Cut
from testbed.machine import Model
from testbed.system.kernel_cache import kept
from testbed.system.threads import WORKERS, threaded

LADDER = math.log(1.1)  # swings within this ratio share their elements
BLANK = 1e-4  # of the largest multiplier over max(1, modulus): a cell with a larger error is left blank
PATIENCE = 2  # points more at which cells are given the full eigenvalue problem: two multipliers may be almost one
_FEW = 200  # cells that are not worth a thread
IN_LANES = DENSE  # unknowns up to which many cells are computed side by side,
MANY = 4_000  # and cells from which on: fewer are as fast one by one, and do not wait for more code to be compiled
_MOST = 5_000  # cells together, about a second: an interruption waits for them


@kept
def _scaled(unit, added, scale, cutting, damping, stiffness, drag, spring, delayed):
    """Coefficients of one cell at its points, in units of time `unit` (s)."""
    for i in range(cutting.size):
        delayed[i] = unit * unit * (scale * cutting[i])
        spring[i] = unit * unit * stiffness + delayed[i]
        drag[i] = unit * (damping + added)


@kept(nogil=True)
def _one_by_one(cells, lengths, points, finer_points, cut, checked, tables, largest):
    """The largest multipliers of some cells (C,) that share their elements; returned: the errors before a correction.

    cells: of each cell the delay (s), further damping (1/s) in the cut, and the scale of `cutting`. lengths (E,) of the
    elements in units of delay / 2 pi. cut: damping (1/s), stiffness (1/s^2), free flight over the delay; b K_s of scale 1 at
    the points of all elements, and the same at finer points, 1/s^2.
    """
    damping, stiffness, free, cutting, finer_cutting = cut
    delays, added, scales = cells
    drag, spring, delayed = np.empty((3, cutting.size))
    finer_drag, finer_spring, finer_delayed = np.empty((3, finer_cutting.size))
    most, error, scratch = finer_points.max(), np.empty(delays.size), np.empty((3, DENSE + 3, DENSE))
    work = np.empty((most, most + 2), dtype=np.complex128)
    for cell in range(delays.size):
        unit = delays[cell] / (2.0 * math.pi)
        _scaled(unit, added[cell], scales[cell], cutting, damping, stiffness, drag, spring, delayed)
        maps = element_maps(lengths, points, drag, spring, delayed, *tables)
        flight = transition_matrix(unit * damping, unit * unit * stiffness, 2.0 * math.pi * free)
        rough = largest_of(points, maps, flight, scratch, checked)
        _scaled(unit, added[cell], scales[cell], finer_cutting, damping, stiffness, finer_drag, finer_spring, finer_delayed)
        value, error[cell] = corrected(rough, lengths, finer_points, finer_drag, finer_spring, finer_delayed, flight, tables,
                                       work)
        largest[cell] = value if rough.imag > 0.0 else complex(value.real, 0.0)
    return error


class _Cells:
    """Cells (C,) of one machine: speeds (rad/s), depths (m), further damping (1/s)."""

    def __init__(self, model: Model, speeds: np.ndarray, depths: np.ndarray, added: np.ndarray, checked: bool) -> None:
        self.added, self.checked = added, checked
        self.straight = model.cutter is not None and model.cutter.helix_angle == 0.0
        self.side_by_side = self.straight and not checked and speeds.size >= MANY  # else too few share a structure
        if self.straight:  # one shape for all depths, which are its scale
            shapes, self.shapes, self.scales = np.ones(1), np.zeros(depths.size, dtype=np.int64), depths
        else:
            shapes, self.shapes = np.unique(depths, return_inverse=True)
            self.scales = np.ones(depths.size)
        self.equations = [milling_equation(model, Cut(spindle_speed=1.0, axial_depth_of_cut=depth)) for depth in shapes]
        first = self.equations[0]
        self.delays = first.delay / speeds
        strongest = np.array([np.abs(equation.periodic_stiffness(sampled(equation))).max() for equation in self.equations])
        rates = swing_rate(first.damping, first.stiffness, 2.0 * self.scales * strongest[self.shapes],
                           float(np.max(added, initial=0.0)))
        self.levels = np.ceil(np.log(rates * self.delays) / LADDER).astype(int)
        natural = math.sqrt(first.stiffness)
        self.machine = np.ones((1, 1)), np.array([natural]), np.array([0.5 * first.damping / natural])

    def groups(self) -> list[np.ndarray]:
        """Cells that share their elements, of one speed in turn, at most so many together that every thread has some."""
        key = self.shapes * 10_000 + self._alike()
        order = np.argsort(self.delays, kind="stable")
        order = order[np.argsort(key[order], kind="stable")]
        size = min(_MOST, max(_FEW, -(-order.size // (4 * WORKERS))))
        parts = np.split(order, np.flatnonzero(np.diff(key[order])) + 1)
        return [part[begin:begin + size] for part in parts for begin in range(0, part.size, size)]

    def _alike(self) -> np.ndarray:
        """Levels from 0; of one shape for all depths, equal ones where the elements are."""
        levels = self.levels - self.levels.min(initial=0)
        if len(self.equations) > 1:
            return levels
        found: dict[bytes, int] = {}
        alike = np.arange(levels.max(initial=0) + 1)
        for level in np.unique(levels):
            elements = self._elements(self.equations[0], level + self.levels.min(initial=0))
            if elements is not None:
                alike[level] = found.setdefault(elements.edges.tobytes() + elements.points.tobytes(), level)
        return alike[levels]

    @staticmethod
    def _elements(equation: DelayEquation, level: int) -> Elements | None:
        """None: more oscillations than can be resolved."""
        try:
            return divided(np.array(equation.breaks) / equation.delay, math.exp(LADDER * level))
        except ArithmeticError:
            return None

    def settled(self, some: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Largest multipliers of a group, their order raised until they stand, and their errors."""
        equation = self.equations[self.shapes[some[0]]]
        largest, error = np.full(some.size, np.nan + 0j), np.full(some.size, np.nan)
        elements = self._elements(equation, self.levels[some[0]])
        if elements is None:
            return largest, error
        left = np.arange(some.size)
        for more in FINER:
            largest[left], error[left] = self._filled(equation, elements.more(more), elements.more(more + 1), some[left],
                                                      self.checked or more >= PATIENCE)
            left = left[error[left] > TOLERANCE * np.maximum(1.0, np.abs(largest[left]))]
            if not left.size:
                break
        largest[~(error <= BLANK * np.maximum(1.0, np.abs(largest)))] = np.nan
        return largest, error

    def _filled(self, equation: DelayEquation, elements: Elements, finer: Elements, some: np.ndarray,
                checked: bool) -> tuple[np.ndarray, np.ndarray]:
        """Largest multipliers and their errors: of straight flutes in lanes, and where those cannot tell one by one."""
        cutting, finer_cutting = (equation.periodic_stiffness(one.times() * equation.delay) for one in (elements, finer))
        free = equation.free_flight / equation.delay
        largest, error = np.empty(some.size, dtype=complex), np.full(some.size, np.nan)
        if self.side_by_side and not checked and elements.unknowns <= IN_LANES:
            cells = (self.delays[some] / (2.0 * math.pi), self.added[some], np.zeros(some.size, dtype=np.int64),
                     self.scales[some])
            shape = elements.lengths[None, :], np.array([2.0 * math.pi * free])
            cut, finer_cut = (*shape, cutting.reshape(1, -1, 1, 1)), (*shape, finer_cutting.reshape(1, -1, 1, 1))
            rough_multipliers(self.machine, cells, cut, elements.points, TABLES, LANES, largest)
            corrected_multipliers(self.machine, cells, finer_cut, finer.points, TABLES, LANES, largest, error)
        alone = np.flatnonzero(np.isnan(error))
        if alone.size:
            cell, values = some[alone], np.empty(alone.size, dtype=complex)
            error[alone] = _one_by_one((self.delays[cell], self.added[cell], self.scales[cell]), elements.lengths,
                                       elements.points, finer.points,
                                       (equation.damping, equation.stiffness, free, cutting, finer_cutting), checked, TABLES,
                                       values)
            largest[alone] = values
        return largest, error


def largest_multipliers(model: Model, spindle_speeds: np.ndarray, axial_depths: np.ndarray,
                        added_damping: np.ndarray | None = None, *, full_eigenvalues: bool = False
                        ) -> tuple[np.ndarray, np.ndarray]:
    """Largest multiplier (of a pair the upper) and an estimate of its error, each (C,), of cuts (C,).

    spindle_speeds rad/s, axial_depths m, added_damping 1/s, each (C,). The estimate is the error before the last correction,
    some ten times what is left. Where it is above 1e-4 of max(1, modulus) after all, the multiplier is NaN. Where the teeth
    differ and a period is a revolution, the modulus is per tooth passing. ValueError without a cutter.
    """
    speeds, depths = np.asarray(spindle_speeds, float), np.asarray(axial_depths, float)
    if model.planar:
        if added_damping is not None and np.any(added_damping):
            raise ValueError("further damping is of a machine of one mode along x")
        return planar_largest(model, speeds, depths)
    added = np.zeros(speeds.size) if added_damping is None else np.asarray(added_damping, float)
    cells = _Cells(model, speeds, depths, added, full_eigenvalues)
    groups = cells.groups()
    found = threaded(cells.settled, groups) if len(groups) > 1 else tuple(map(cells.settled, groups))
    largest, error = np.full(speeds.size, np.nan + 0j), np.full(speeds.size, np.nan)
    for some, (of_group, errors) in zip(groups, found, strict=True):
        largest[some], error[some] = of_group, errors
    return largest, error
