"""The largest multipliers of many cuts of one machine: the cells of a chart.

The order of a cell's spectral elements follows the oscillations that its cut spans. Its largest multiplier is corrected by the
characteristic equation at a higher order; where that moves it the order is raised, and what does not settle is not a number.
Cells of like oscillations share their elements, so that compiled code runs through them.
"""

from __future__ import annotations

import math

import numpy as np

from analysis.linear.characteristic import corrected
from analysis.linear.delay_equation import DelayEquation, milling_equation
from analysis.linear.dominant import DENSE, largest_of
from analysis.linear.planar_multipliers import planar_largest
from analysis.linear.spectral_elements import (
    FINER,
    TABLES,
    TOLERANCE,
    Elements,
    divided,
    element_maps,
    sampled,
    swing_rate,
)
from analysis.linear.temporal_elements import transition_matrix
from analysis.threads import WORKERS, threaded
from testbed.cut import Cut
from testbed.kernel_cache import kept
from testbed.machine import Model

LADDER = math.log(1.1)  # swings within this ratio share their elements
BLANK = 1e-4  # of the largest multiplier over max(1, modulus): a cell with a larger error is left blank
PATIENCE = 2  # points more at which cells are given the full eigenvalue problem: two multipliers may be almost one
_FEW = 200  # cells that are not worth a thread
_MOST = 5_000  # cells together, about a second: an interruption waits for them


@kept
def _scaled(unit, added, cutting, damping, stiffness, drag, spring, delayed):
    """Coefficients of one cell at its points, in units of time `unit` (s)."""
    for i in range(cutting.size):
        delayed[i] = unit * unit * cutting[i]
        spring[i] = unit * unit * stiffness + delayed[i]
        drag[i] = unit * (damping + added)


@kept(nogil=True)
def _fill(delays, rows, added, lengths, points, cutting, finer_points, finer_cutting, constants, checked, tables, scratch,
          largest, error):
    """The largest multipliers of some cells (C,) that share their elements, and the errors that they had before a correction.

    delays, rows, added: of each cell the delay (s), the row of `cutting`, and further damping (1/s) in the cut. lengths (E,) of
    the elements in units of delay / 2 pi; cutting (R, points of all elements): b K_s, 1/s^2. constants: damping (1/s),
    stiffness (1/s^2), free flight over the delay.
    """
    damping, stiffness, free = constants
    drag, spring, delayed = np.empty((3, cutting.shape[1]))
    finer_drag, finer_spring, finer_delayed = np.empty((3, finer_cutting.shape[1]))
    most = finer_points.max()
    work = np.empty((most, most + 2), dtype=np.complex128)
    for cell in range(delays.size):
        unit, row = delays[cell] / (2.0 * math.pi), rows[cell]
        _scaled(unit, added[cell], cutting[row], damping, stiffness, drag, spring, delayed)
        maps = element_maps(lengths, points, drag, spring, delayed, *tables)
        flight = transition_matrix(unit * damping, unit * unit * stiffness, 2.0 * math.pi * free)
        rough = largest_of(points, maps, flight, scratch, checked)
        _scaled(unit, added[cell], finer_cutting[row], damping, stiffness, finer_drag, finer_spring, finer_delayed)
        value, error[cell] = corrected(rough, lengths, finer_points, finer_drag, finer_spring, finer_delayed, flight, tables,
                                       work)
        largest[cell] = value if rough.imag > 0.0 else complex(value.real, 0.0)


class _Cells:
    """Cells (C,) of one machine: speeds (rad/s), depths (m), further damping (1/s)."""

    def __init__(self, model: Model, speeds: np.ndarray, depths: np.ndarray, added: np.ndarray, checked: bool) -> None:
        self.added, self.checked = added, checked
        self.depths, self.rows = np.unique(depths, return_inverse=True)
        # straight flutes: one shape for all depths, of which the coefficient is a multiple
        self.straight = model.cutter is not None and model.cutter.helix_angle == 0.0
        shapes = np.ones(1) if self.straight else self.depths
        self.equations = [milling_equation(model, Cut(spindle_speed=1.0, axial_depth_of_cut=depth)) for depth in shapes]
        self.delays = self.equations[0].delay / speeds
        strongest = np.array([np.abs(equation.periodic_stiffness(sampled(equation))).max() for equation in self.equations])
        rates = swing_rate(self.equations[0].damping, self.equations[0].stiffness,
                           2.0 * (self.depths * strongest if self.straight else strongest), float(np.max(added, initial=0.0)))
        self.levels = np.ceil(np.log(rates[self.rows] * self.delays) / LADDER).astype(int)

    def groups(self) -> list[np.ndarray]:
        """Cells that share their elements, at most so many together that every thread has some."""
        key = self._shapes * 10_000 + self.levels - self.levels.min(initial=0)
        order = np.argsort(key, kind="stable")
        size = min(_MOST, max(_FEW, -(-order.size // (4 * WORKERS))))
        parts = np.split(order, np.flatnonzero(np.diff(key[order])) + 1)
        return [part[begin:begin + size] for part in parts for begin in range(0, part.size, size)]

    @property
    def _shapes(self) -> np.ndarray:
        return np.zeros_like(self.rows) if self.straight else self.rows

    def settled(self, some: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Largest multipliers of a group, their order raised until they stand, and their errors."""
        equation = self.equations[self._shapes[some[0]]]
        largest, error = np.full(some.size, np.nan + 0j), np.full(some.size, np.nan)
        try:
            elements = divided(np.array(equation.breaks) / equation.delay, math.exp(LADDER * self.levels[some[0]]))
        except ArithmeticError:  # more oscillations than can be resolved
            return largest, error
        left = np.arange(some.size)
        for more in FINER:
            largest[left], error[left] = self._fill(equation, elements.more(more), elements.more(more + 1), some[left],
                                                        self.checked or more >= PATIENCE)
            left = left[error[left] > TOLERANCE * np.maximum(1.0, np.abs(largest[left]))]
            if not left.size:
                break
        largest[~(error <= BLANK * np.maximum(1.0, np.abs(largest)))] = np.nan
        return largest, error

    def _fill(self, equation: DelayEquation, elements: Elements, finer: Elements, some: np.ndarray,
              checked: bool) -> tuple[np.ndarray, np.ndarray]:
        values = [equation.periodic_stiffness(one.times() * equation.delay) for one in (elements, finer)]
        depths, rows = np.unique(self.rows[some], return_inverse=True)
        scale = self.depths[depths][:, None] if self.straight else np.ones((1, 1))
        largest, error = np.empty(some.size, dtype=complex), np.empty(some.size)
        _fill(self.delays[some], rows, self.added[some], elements.lengths, elements.points, scale * values[0], finer.points,
              scale * values[1], (equation.damping, equation.stiffness, equation.free_flight / equation.delay), checked,
              TABLES, np.empty((3, DENSE + 3, DENSE)), largest, error)
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
