"""Regression of a residual motion on forces, without derivatives and with the noise where it is: on the measurement.

A force f along the measured motion moves the structure by L[f], the oscillator's response. The residual motion is a sum
of such responses, of what the model's own parameters still lack, and of noise on the samples. Records are cut into
windows; in each the free motion and a constant are projected out, so that no state needs to be known (the weak form
whose test functions are all those orthogonal to free motions; compare D. Messenger and D. Bortz (2021), Multiscale
Modeling and Simulation 19, 1474, and multiple shooting). All that a choice of terms needs is kept as sums of products
per operating condition.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from testbed.analysis.fit.held_out import conditions_of
from testbed.analysis.fit.observed import Observed
from testbed.analysis.force.cut_variables import (
    SUBSTEPS,
    CellForce,
    Course,
    Edges,
    Trajectory,
    base_force,
    course_of,
    model_force,
)
from testbed.analysis.force.latent_force import MissingForce, motion_channels
from testbed.analysis.force.response import response
from testbed.analysis.force.terms import cell_force, structure_terms, tooth_terms
from testbed.machine import Model
from testbed.system.threads import threaded
from testbed.trial.proposal import ForceTerm

CYCLES, REVOLUTIONS = 8, 3  # a window spans at least so many vibrations and revolutions
MARGIN = 1.5  # revolutions left out on both sides of entry and exit, whose passes may be wrong
TURN = 0.01  # rad, step of the difference by the tooth angle
SPINDLE_ORDERS = 3
UNSTEADY = 10.0  # displacement beyond this many times the median of the records' is a motion that left its law


@dataclass(frozen=True)
class Products:
    """Sums of products of columns, the residual last, per operating condition: (conditions, n + 1, n + 1), noise units.

    nuisances: names of the first columns (the model's own parameters); terms: the candidates behind them. rows: values
    per condition. scale (n,): coefficients of the sums over this are those of the terms. blocks: the columns
    themselves, unscaled. angle (rad): what was added to the fit's tooth angle.
    """

    sums: np.ndarray
    nuisances: tuple[str, ...]
    terms: tuple[ForceTerm, ...]
    rows: np.ndarray
    scale: np.ndarray
    blocks: tuple[np.ndarray, ...]
    angle: float


# -- the columns of a record -------------------------------------------------------------------------------------------


def _column(record: Observed, course: Course, model: Model, force: CellForce) -> np.ndarray:
    """What a force does to the channels, (channels, samples) in units of the noise."""
    found = []
    for name, noise in zip(record.channels, record.noise, strict=True):
        if name.startswith("force"):
            found.append(course.sampled(force.on(name)) / noise)
        else:
            found.append(response(model, force.along, record.rate, name.split("_")[0]) / noise)
    return np.stack(found)


def nuisance_forces(missing: MissingForce, index: int, course: Course, at: float = 0.0) -> dict[str, CellForce]:
    """Forces that a small change of the model's own parameters would add, per unit of the parameter."""
    record, model, motion = missing.observed[index], missing.state.model, missing.records[index].trajectory
    x, v = motion.at(course.time)
    found = {}
    if motion_channels(record):
        found = {"stiffness": CellForce(-x), "damping": CellForce(-v)}
    if record.kind == "excited" and record.force is not None:
        drive = np.repeat(0.5 * (record.force[1:] + record.force[:-1]), SUBSTEPS)
        found["drive"] = CellForce(drive)
    if len(course.cell) and model.cutting is not None:
        edges = course.edges(motion)
        load, nothing = edges.variables["depth"] * edges.variables["chip"], np.zeros(len(course.cell))
        found["tangential_coefficient"] = edges.force(load, nothing, len(course.time))
        found["normal_coefficient"] = edges.force(nothing, load, len(course.time))
        coefficients = model.cutting.tangential_coefficient, model.cutting.normal_coefficient
        ends = []
        for turned in (at + TURN, at - TURN):
            moved = course_of(record, missing.state, index, missing.catalogue, turned)
            ends.append(base_force(moved, moved.edges(motion), *(one / (2 * TURN) for one in coefficients)))
        found["mark_angle"] = ends[0].minus(ends[1])
    return found


def spindle_terms() -> list[ForceTerm]:
    """Forces that turn with the spindle, in the cut or not. No hook can carry them, so they are only ever named."""
    return [
        ForceTerm(f"spindle_{wave}_{order}", "structure_force", f"{wave}({order} phi)", "", "N",
                  f"force that turns with the spindle, order {order}", 1.5)
        for order in range(1, SPINDLE_ORDERS + 1)
        for wave in ("cos", "sin")
    ]  # fmt: skip


def library(missing: MissingForce) -> list[ForceTerm]:
    """The terms that these records could show."""
    found: list[ForceTerm] = []
    if any(motion_channels(record) for record in missing.observed):
        found += structure_terms()
    cuts = [record for record in missing.observed if record.cut is not None]
    if cuts and missing.state.model.cutting is not None:
        found += tooth_terms(max(record.flutes for record in cuts)) + spindle_terms()
    return found


def _term_force(term: ForceTerm, course: Course, edges: Edges, motion: Trajectory) -> CellForce:
    if term.expression:
        return cell_force(term, course, edges, motion)
    wave, order = term.name.split("_")[1:]
    turn = np.nan_to_num(course.turn) * 2 * math.pi * int(order)
    return CellForce(np.where(np.isnan(course.turn), 0.0, np.cos(turn) if wave == "cos" else np.sin(turn)))


def windows_of(record: Observed, course: Course, model: Model) -> list[slice]:
    """Stretches of samples that are compared, without the neighbourhood of entry and exit and without idling before."""
    length = CYCLES / model.structure.natural_frequency
    if record.period:
        length = max(length, REVOLUTIONS * record.period)
    size = min(record.samples, max(16, round(length * record.rate)))
    edges = [0, record.samples]
    if course.breaks:
        entry, leave = ((time - record.start) * record.rate for time in course.breaks)
        margin = MARGIN * record.period * record.rate
        stretches = [(entry + margin, leave - margin), (leave + margin, record.samples)]
    else:
        stretches = [(0, record.samples)]
    found = []
    for low, high in stretches:
        first, last = max(edges[0], math.ceil(low)), min(edges[1], math.floor(high))
        count = (last - first) // size
        found += [slice(first + k * size, first + (k + 1) * size) for k in range(count)]
    return found


def _rest(model: Model, size: int, rate: float) -> np.ndarray:
    """Orthonormal basis (size, 3) of free motions and a constant over a window."""
    structure = model.structure
    time = np.arange(size) / rate
    damped = structure.natural_frequency_rad * math.sqrt(1 - structure.damping_ratio**2)
    envelope = np.exp(-structure.damping_ratio * structure.natural_frequency_rad * time)
    basis = np.column_stack([envelope * np.cos(damped * time), envelope * np.sin(damped * time), np.ones(size)])
    return np.linalg.qr(basis)[0]


def _in_windows(record: Observed, model: Model, windows: Sequence[slice], column: np.ndarray) -> np.ndarray:
    """A column (channels, samples) cut into windows, each without free motions and a constant, (values,)."""
    if not windows:
        return np.empty(0)
    size = windows[0].stop - windows[0].start
    places = np.array([one.start for one in windows])[:, None] + np.arange(size)
    basis = _rest(model, size, record.rate)
    parts = []
    for channel, name in enumerate(record.channels):
        if name.startswith("force"):
            whole = column[channel] - record.drift @ (record.drift.T @ column[channel])
            parts.append(whole[places].ravel())
        else:
            rows = column[channel][places]
            parts.append((rows - (rows @ basis) @ basis.T).ravel())
    return np.concatenate(parts)


def _record_blocks(
    missing: MissingForce, index: int, nuisances: Sequence[str], terms: Sequence[ForceTerm], angles: Sequence[float]
) -> list[np.ndarray]:
    """Columns and residual of a record, (values, n + 1), for each change of the tooth angle."""
    record, model, force = missing.observed[index], missing.state.model, missing.records[index]
    fitted = course_of(record, missing.state, index, missing.catalogue)
    windows = windows_of(record, fitted, model)
    nothing = CellForce(np.zeros(len(fitted.time)))
    predicted = model_force(model, missing.catalogue, fitted, force.predicted)

    def column(one: CellForce, course: Course) -> np.ndarray:
        return _in_windows(record, model, windows, _column(record, course, model, one))

    still: dict[int, np.ndarray] = {}  # columns that the tooth angle does not change
    found: list[np.ndarray] = []
    for turned in angles:
        if found and not len(fitted.cell):
            found.append(found[0])
            continue
        course = course_of(record, missing.state, index, missing.catalogue, turned) if turned else fitted
        own = model_force(model, missing.catalogue, course, force.trajectory).minus(predicted)
        edges = course.edges(force.trajectory)
        small = nuisance_forces(missing, index, course, turned)
        block = [column(small.get(name, nothing), course) for name in nuisances]
        for place, term in enumerate(terms):
            if place not in still or term.hook != "structure_force" or not term.expression:
                still[place] = column(_term_force(term, course, edges, force.trajectory), course)
            block.append(still[place])
        rest = force.residual / record.noise[:, None] - _column(record, course, model, own)
        block.append(_in_windows(record, model, windows, rest))
        found.append(np.stack(block, axis=1))
    return found


def _leaves_its_law(missing: MissingForce) -> set[int]:
    """Records whose motion is far larger than the others': they would rule every sum, and no single law may hold there."""
    size = np.array([float(np.abs(one.displacement).max()) for one in missing.records])
    cut = np.array([record.cut is not None for record in missing.observed])
    if cut.sum() < 3:
        return set()
    return {int(place) for place in np.flatnonzero(cut & (size > UNSTEADY * np.median(size[cut])))}


def products(missing: MissingForce, terms: Sequence[ForceTerm] | None = None, angles: Sequence[float] = (0.0,),
             progress: Callable[[str], None] = lambda text: None) -> list[Products]:  # fmt: skip
    """Sums of products of all records, for each change of the fit's tooth angle (rad).

    ValueError where no record has a window to compare.
    """
    terms = library(missing) if terms is None else list(terms)
    cut = any(record.cut is not None for record in missing.observed) and missing.state.model.cutting is not None
    moving = any(motion_channels(record) for record in missing.observed)
    names = ["stiffness", "damping"] * moving + ["drive"] * any(one.kind == "excited" for one in missing.observed)
    names += ["tangential_coefficient", "normal_coefficient", "mark_angle"] * cut
    left_out = _leaves_its_law(missing)
    used = [index for index in range(len(missing.observed)) if index not in left_out]
    progress("forces along the measured motion")
    blocks = threaded(lambda index: _record_blocks(missing, index, names, terms, angles), used)
    return [_summed(missing, used, [block[place] for block in blocks], names, terms, angle)
            for place, angle in enumerate(angles)]  # fmt: skip


def _summed(missing: MissingForce, used: Sequence[int], blocks: Sequence[np.ndarray], names: Sequence[str],
            terms: Sequence[ForceTerm], angle: float) -> Products:  # fmt: skip
    known = {index: block for index, block in zip(used, blocks, strict=True) if len(block)}
    if not known:
        raise ValueError("the records are too short to look for the missing force in them")
    groups = [[index for index in group if index in known] for group in conditions_of(missing.observed)]
    return products_of(known, [group for group in groups if group], names, terms, angle)


def products_of(known: Mapping[int, np.ndarray], groups: Sequence[Sequence[int]], names: Sequence[str],
                terms: Sequence[ForceTerm], angle: float = 0.0) -> Products:  # fmt: skip
    """Sums over the records of each group. known: of each record its columns and its residual, (values, n + 1)."""
    sums = np.stack([sum(known[index].T @ known[index] for index in group) for group in groups])
    size = np.sqrt(np.einsum("kii->i", sums)[:-1])
    scale = np.where(size > 0.0, size, 1.0)
    units = np.append(scale, 1.0)
    rows = np.array([sum(len(known[index]) for index in group) for group in groups])
    return Products(sums / units[:, None] / units, tuple(names), tuple(terms), rows, scale, tuple(known.values()), angle)
