"""Characteristic multipliers of a planar machine: of one cut all of them, of many cuts the largest; each with an error.

Every answer is computed at two orders, and their difference is its error: that of the lower one, where the higher one is given.
The order is raised until that is small; what does not settle has no answer. Multipliers of one cut are over a principal period
(`period_passes` tooth passings). Of many cuts, the modulus is per tooth passing.
"""

from __future__ import annotations

import math

import numpy as np

from testbed.analysis.linear.delay_equation import milling_equation
from testbed.analysis.linear.dominant import append, dominant, full
from testbed.analysis.linear.planar_elements import PLANAR_TABLES, period_map, times_period
from testbed.analysis.linear.planar_equation import PlanarMachine, chip_stiffness, divide, planar_machine
from testbed.analysis.linear.spectral_elements import FINE, TOLERANCE, multipliers
from testbed.analysis.linear.temporal_elements import sort_multipliers
from testbed.cut import Cut
from testbed.machine import Model
from testbed.system.kernel_cache import kept
from testbed.system.threads import threaded

MORE = (0, 2, 4, 7)  # points more in every element
BLANK = 1e-4  # of the largest multiplier of a period over max(1, modulus): beyond, no answer
KRYLOV = (12, 20, 30, 44, 64, 90, 124, 160)  # vectors, as many as it takes
RITZ = 1e-8  # residual of an eigenvector over its eigenvalue
DENSE = 700  # unknowns up to which all multipliers are found
SAMPLES = 48  # angles of a period that show how strong the cut becomes
_TOGETHER = 100  # cells of one depth that are worth a thread


@kept
def _polished(h, count, value):
    """An eigenvalue of a Hessenberg matrix after Newton's steps on its characteristic polynomial, and the last row's residual;
    infinite where the steps lead away.

    Hyman's method: the eigenvector from its last entry upwards, its first row the polynomial (Wilkinson 1965, The Algebraic
    Eigenvalue Problem, section 7.11).
    """
    z, slope = np.zeros(count, dtype=np.complex128), np.zeros(count, dtype=np.complex128)
    residual = math.inf
    for _ in range(4):
        z[count - 1], slope[count - 1] = 1.0, 0.0
        for i in range(count - 1, 0, -1):
            total, turn = value * z[i], z[i] + value * slope[i]
            for j in range(i, count):
                total -= h[i, j] * z[j]
                turn -= h[i, j] * slope[j]
            z[i - 1], slope[i - 1] = total / h[i, i - 1], turn / h[i, i - 1]
            if abs(z[i - 1]) > 1e100:
                z[i - 1:] *= 1e-100
                slope[i - 1:] *= 1e-100
        residual = h[count, count - 1] * abs(z[count - 1]) / (math.sqrt(np.sum(z.real**2 + z.imag**2)) * abs(value))
        miss, turn = value * z[0], z[0] + value * slope[0]
        for j in range(count):
            miss -= h[0, j] * z[j]
            turn -= h[0, j] * slope[j]
        change = miss / turn if abs(turn) > 0.0 else complex(0.0, 0.0)
        if not abs(change) < 1e-3 * abs(value):
            return value, math.inf
        value = complex(value.real - change.real, value.imag - change.imag if value.imag != 0.0 else 0.0)
        if abs(change) < 1e-13 * abs(value):
            break
    return value, residual


@kept
def _krylov(period, size, basis, h):
    """The largest multiplier by Arnoldi's method, of a pair the upper, and its number of vectors; 0 where it is not found."""
    most = basis.shape[0] - 1
    for i in range(size):  # a start without a pattern of its own
        basis[0, i] = 0.5 + (0.6180339887498949 * (i + 1)) % 1.0
    basis[0] /= math.sqrt(np.dot(basis[0], basis[0]))
    new, count = np.empty(size), 0
    for wanted in KRYLOV:
        closed = False
        while count < min(wanted, most) and not closed:
            times_period(period, basis[count], new)
            closed = append(basis, h, count, new)
            count += 1
        part = np.ascontiguousarray(h[:count, :count])
        value = dominant(part, np.empty((2, count, count)), np.empty(count), np.empty(count), np.empty(count))
        if closed:
            return full(part), count
        if not math.isfinite(abs(value)):
            break
        if abs(value) == 0.0:
            continue
        value, residual = _polished(h, count, value)
        if not math.isfinite(residual):  # squaring did not find the largest
            value, residual = _polished(h, count, full(part))
        if residual < RITZ:
            return value, count
        if count == most:
            break
    return complex(math.nan, math.nan), 0


@kept
def swing(machine, cut):
    """At most so many rad does the motion turn in a rad of the spindle, for multipliers of modulus about 1."""
    _, shapes, frequencies, dampings, entries, delays, law = machine
    speed, depth, lag = cut
    period, h, strongest = delays.sum(), np.empty((2, 2)), 0.0
    for k in range(SAMPLES):
        size = 0.0
        for lane in range(entries.size):
            chip_stiffness(((k + 0.5) / SAMPLES * period - entries[lane]) % period, period, lag, law, h)
            size += math.sqrt(np.sum(h * h))
        strongest = max(strongest, size)
    fastest, slowed = frequencies.max(), (frequencies * dampings).max()
    return (math.sqrt(fastest**2 + 2.0 * depth * strongest * np.sum(shapes * shapes)) + slowed) / speed


@kept
def _elements(machine, cut, places, smooth, more):
    delays = machine[5]
    return divide(places, smooth, swing(machine, cut), delays.min(), more, delays.size > 1)


@kept
def _largest(machine, cut, places, smooth, more, tables):
    """The largest multiplier at one order, of a pair the upper; not a number where it is not found."""
    elements = _elements(machine, cut, places, smooth, more)
    if elements[0].size == 0:
        return complex(math.nan, math.nan)
    period = period_map(machine, cut, elements, tables)
    size = period[1][-1] + 2 * machine[2].size
    most = min(KRYLOV[-1], size)
    return _krylov(period, size, np.empty((most + 1, size)), np.zeros((most + 1, most)))[0]


@kept(nogil=True)
def _fill(machine, speeds, depth, lag, places, smooth, tolerance, tables):
    """Largest multipliers (C,) of a period and their errors, of cuts at some speeds (rad/s) and one depth (m)."""
    largest, error = np.full(speeds.size, complex(math.nan, math.nan)), np.full(speeds.size, math.nan)
    for cell in range(speeds.size):
        cut = (speeds[cell], depth, lag)
        last, modulus = complex(math.nan, math.nan), 0.0
        for more in MORE:  # one call: a second one, with a constant, would compile all below it twice
            value = _largest(machine, cut, places, smooth, more, tables)
            if more > MORE[0]:
                error[cell], modulus = abs(value - last), max(modulus, abs(abs(value) - abs(last)))
            last = value
            if error[cell] <= tolerance * max(1.0, abs(value)):
                break
        if modulus <= tolerance * abs(last):  # of two that are of one modulus, now the one, now the other
            error[cell] = min(error[cell], modulus)
        if error[cell] <= BLANK * max(1.0, abs(last)):
            largest[cell] = last
    return largest, error


def _packed(machine: PlanarMachine) -> tuple:
    return (np.ascontiguousarray(machine.axes, dtype=float), np.ascontiguousarray(machine.shapes), machine.frequencies,
            machine.dampings, machine.entries, machine.delays, machine.law)


def planar_largest(model: Model, speeds: np.ndarray, depths: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Largest multiplier (of a pair the upper), its modulus per tooth passing, and an estimate of its error, each (C,).

    Of cuts: speeds rad/s, depths m, each (C,). NaN where it did not settle.
    """
    machine = planar_machine(model)
    order = np.lexsort((speeds, depths))
    edges = np.flatnonzero(np.diff(depths[order])) + 1
    groups = [part[begin:begin + _TOGETHER] for part in np.split(order, edges) for begin in range(0, part.size, _TOGETHER)]

    def one(some: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        depth = float(depths[some[0]])
        return _fill(_packed(machine), speeds[some], depth, machine.lag(depth), *machine.corners(depth), TOLERANCE,
                     PLANAR_TABLES)

    largest, error = np.full(speeds.size, np.nan + 0j), np.full(speeds.size, np.nan)
    for some, found in zip(groups, threaded(one, groups) if len(groups) > 1 else map(one, groups), strict=True):
        largest[some], error[some] = found
    share = 1.0 / machine.period_passes
    with np.errstate(divide="ignore", invalid="ignore"):
        scale = np.where(largest == 0.0, 1.0, np.abs(largest) ** (share - 1.0))
    scale = np.where(np.isfinite(scale), scale, 1.0)
    return largest * scale, error * share * scale if share < 1.0 else error


@kept(nogil=True)
def _matrix(machine, cut, places, smooth, more, tables):
    """The map of a period: all of it (n, n), or where it is large on Arnoldi's vectors, as many as the largest one takes.

    Of no rows where there are more oscillations than can be resolved.
    """
    elements = _elements(machine, cut, places, smooth, more)
    if elements[0].size == 0:
        return np.empty((0, 0))
    period = period_map(machine, cut, elements, tables)
    n = period[1][-1] + 2 * machine[2].size
    if n > DENSE:
        basis, h = np.empty((KRYLOV[-1] + 1, n)), np.zeros((KRYLOV[-1] + 1, KRYLOV[-1]))
        count = _krylov(period, n, basis, h)[1]
        return h[:count, :count].copy()
    columns, unit = np.empty((n, n)), np.zeros(n)
    for j in range(n):
        unit[j] = 1.0
        times_period(period, unit, columns[j])
        unit[j] = 0.0
    return columns.T.copy()


def _all(machine: PlanarMachine, cut: Cut, more: int) -> np.ndarray:
    depth = cut.axial_depth_of_cut
    matrix = _matrix(_packed(machine), (cut.spindle_speed, depth, machine.lag(depth)), *machine.corners(depth), more,
                     PLANAR_TABLES)
    if not matrix.size:
        raise ArithmeticError("the structure swings more often in the cut than can be resolved")
    return sort_multipliers(np.linalg.eigvals(matrix))


def planar_multipliers(machine: PlanarMachine, cut: Cut, tolerance: float = FINE) -> tuple[np.ndarray, np.ndarray]:
    """Multipliers of a period, complex, largest modulus first, of a pair the upper first; and an estimate of the error of each.

    ArithmeticError if the largest does not settle.
    """
    last = _all(machine, cut, MORE[0])
    for more in MORE[1:]:
        values = _all(machine, cut, more)
        errors = np.abs(values[:, None] - last[None, :]).min(axis=1)
        errors[0] = max(errors[0], abs(abs(values[0]) - abs(last[0])))
        last, settled = values, errors[0] / max(1.0, abs(values[0]))
        if settled <= tolerance:
            break
    if not settled <= max(tolerance, TOLERANCE):
        raise ArithmeticError(f"the largest multiplier did not settle to {TOLERANCE:g}")
    return values, errors


def cut_multipliers(model: Model, cut: Cut, tolerance: float = FINE) -> tuple[np.ndarray, np.ndarray, int]:
    """Multipliers of any machine without effects at a cut, an estimate of each error, and their period in tooth passings.

    ValueError without a cutter, ArithmeticError where the largest does not settle.
    """
    if not model.planar:
        return *multipliers(milling_equation(model, cut), tolerance), 1
    machine = planar_machine(model)
    return *planar_multipliers(machine, cut, tolerance), machine.period_passes
