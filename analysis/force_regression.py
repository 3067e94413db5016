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
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.signal import lfilter

from analysis.cut_variables import SUBSTEPS, Course, base_force, course_of, model_force
from analysis.force_terms import CellForce, cell_force, structure_terms, tooth_terms
from analysis.held_out import conditions_of
from analysis.latent_force import MissingForce, motion_channels
from analysis.observed import Observed
from testbed.machine import Model
from testbed.proposal import ForceTerm

CYCLES, REVOLUTIONS = 8, 3  # a window spans at least so many vibrations and revolutions
MARGIN = 1.5  # revolutions left out on both sides of entry and exit, whose passes may be wrong
TURN = 0.01  # rad, step of the difference by the tooth angle
SPINDLE_ORDERS = 3
UNSTEADY = 10.0  # displacement beyond this many times the median of the records' is a motion that left its law


@dataclass(frozen=True)
class Products:
    """Sums of products of columns, the residual last, per operating condition: (conditions, n + 1, n + 1), noise units.

    nuisances: names of the first columns (the model's own parameters); terms: the candidates behind them. rows: values
    per condition. scale (n,): coefficients of the sums over this are those of the terms. blocks: the columns themselves.
    """

    sums: np.ndarray
    nuisances: tuple[str, ...]
    terms: tuple[ForceTerm, ...]
    rows: np.ndarray
    scale: np.ndarray
    blocks: tuple[np.ndarray, ...]


def response(model: Model, force: np.ndarray, rate: float, kind: str) -> np.ndarray:
    """The oscillator's response (samples,) from rest to a force over the cells (cells,): displacement, velocity or acceleration."""
    structure = model.structure
    rows = force.reshape(-1, SUBSTEPS)
    dt = 1.0 / rate
    whole = _free(structure.natural_frequency_rad, structure.damping_ratio, dt)
    pushes = np.array([_push(model, dt / SUBSTEPS, dt * (1 - (cell + 1) / SUBSTEPS)) for cell in range(SUBSTEPS)])
    push = np.vstack([np.zeros(2), rows @ pushes])  # (samples, 2), of the interval that ends at each sample
    bottom = [1.0, -float(np.trace(whole)), float(np.linalg.det(whole))]
    late = np.vstack([np.zeros(2), push[:-1]])
    x = lfilter([1.0], bottom, push[:, 0] - whole[1, 1] * late[:, 0] + whole[0, 1] * late[:, 1])
    v = lfilter([1.0], bottom, push[:, 1] - whole[0, 0] * late[:, 1] + whole[1, 0] * late[:, 0])
    if kind == "displacement":
        return x
    if kind == "velocity":
        return v
    means = np.concatenate([rows[:1, 0], 0.5 * (rows[:-1, -1] + rows[1:, 0]), rows[-1:, -1]])
    return (means - structure.damping * v - structure.stiffness * x) / structure.mass


def _free(omega: float, zeta: float, dt: float) -> np.ndarray:
    """Exact transition of [x, v] in free vibration."""
    decay, damped = zeta * omega, omega * math.sqrt(1.0 - zeta**2)
    c, s, e = math.cos(damped * dt), math.sin(damped * dt) / damped, math.exp(-decay * dt)
    return e * np.array([[c + decay * s, s], [-(omega**2) * s, c - decay * s]])


def _push(model: Model, length: float, rest: float) -> np.ndarray:
    """[x, v] at the end of a sample of a unit force that acts for `length` and then leaves the structure free for `rest`."""
    structure = model.structure
    over = _free(structure.natural_frequency_rad, structure.damping_ratio, length)
    static = 1.0 / structure.stiffness
    pushed = np.array([static, 0.0]) - over @ np.array([static, 0.0])
    return _free(structure.natural_frequency_rad, structure.damping_ratio, rest) @ pushed


# -- the columns of a record -------------------------------------------------------------------------------------------


def _column(record: Observed, course: Course, model: Model, force: CellForce) -> np.ndarray:
    """What a force does to the channels, (channels, samples) in units of the noise."""
    found = []
    for name, noise in zip(record.channels, record.noise, strict=True):
        if name.startswith("force"):
            values = force.across if name == "force_y" else force.along
            found.append((np.zeros(record.samples) if values is None else course.sampled(values)) / noise)
        else:
            found.append(response(model, force.along, record.rate, name.split("_")[0]) / noise)
    return np.stack(found)


def nuisance_forces(missing: MissingForce, index: int, course: Course, at: float = 0.0) -> dict[str, CellForce]:
    """Forces that a small change of the model's own parameters would add, per unit of the parameter."""
    record, model, motion = missing.observed[index], missing.state.model, missing.records[index].trajectory
    x, v = motion.at(course.time)
    found = {}
    if motion_channels(record):
        found = {"stiffness": CellForce(-x, None), "damping": CellForce(-v, None)}
    if record.kind == "excited" and record.force is not None:
        drive = np.repeat(0.5 * (record.force[1:] + record.force[:-1]), SUBSTEPS)
        found["drive"] = CellForce(drive, None)
    if len(course.cell) and model.cutting is not None:
        edges = course.edges(motion)
        load, nothing = edges.variables["depth"] * edges.variables["chip"], np.zeros(len(course.cell))
        for name, sides in (("tangential_coefficient", (load, nothing)), ("normal_coefficient", (nothing, load))):
            cells = len(course.time)
            found[name] = CellForce(edges.on_structure(*sides, cells), edges.across(*sides, cells))
        coefficients = model.cutting.tangential_coefficient, model.cutting.normal_coefficient
        sides = []
        for turned in (-TURN, TURN):
            moved = course_of(record, missing.state, index, missing.catalogue, at + turned)
            sides.append(base_force(moved, moved.edges(motion), *coefficients))
        found["mark_angle"] = CellForce((sides[1] - sides[0]) / (2 * TURN), None)
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


def _term_force(term: ForceTerm, course: Course, edges: object, motion: object) -> CellForce:
    if term.expression:
        return cell_force(term, course, edges, motion)  # type: ignore[arg-type]
    wave, order = term.name.split("_")[1:]
    turn = np.nan_to_num(course.turn) * 2 * math.pi * int(order)
    return CellForce(np.where(np.isnan(course.turn), 0.0, np.cos(turn) if wave == "cos" else np.sin(turn)), None)


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


def _record_block(
    missing: MissingForce, index: int, nuisances: Sequence[str], terms: Sequence[ForceTerm], turned: float
) -> np.ndarray:
    """Columns and residual of a record in its windows, without what the projections take, (values, n + 1)."""
    record, model, force = missing.observed[index], missing.state.model, missing.records[index]
    course = course_of(record, missing.state, index, missing.catalogue, turned)
    fitted = course_of(record, missing.state, index, missing.catalogue) if turned else course
    own = model_force(model, missing.catalogue, course, force.trajectory)
    own -= model_force(model, missing.catalogue, fitted, force.predicted)
    edges = course.edges(force.trajectory)
    small = nuisance_forces(missing, index, course, turned)
    nothing = CellForce(np.zeros(len(course.time)), None)
    columns = [_column(record, course, model, small.get(name, nothing)) for name in nuisances]
    columns += [_column(record, course, model, _term_force(term, course, edges, force.trajectory)) for term in terms]
    columns.append(force.residual / record.noise[:, None] - _column(record, course, model, CellForce(own, None)))
    windows = windows_of(record, course, model)
    parts = []
    for channel, name in enumerate(record.channels):
        whole = np.stack([column[channel] for column in columns], axis=1)
        if name.startswith("force"):
            whole = whole - record.drift @ (record.drift.T @ whole)
        for window in windows:
            part = whole[window]
            if not name.startswith("force"):
                basis = _rest(model, len(part), record.rate)
                part = part - basis @ (basis.T @ part)
            parts.append(part)
    return np.concatenate(parts) if parts else np.zeros((0, len(columns)))


def _leaves_its_law(missing: MissingForce) -> set[int]:
    """Records whose motion is far larger than the others': they would rule every sum, and no single law may hold there."""
    size = np.array([float(np.abs(one.displacement).max()) for one in missing.records])
    cut = np.array([record.cut is not None for record in missing.observed])
    if cut.sum() < 3:
        return set()
    return {int(place) for place in np.flatnonzero(cut & (size > UNSTEADY * np.median(size[cut])))}


def products(missing: MissingForce, terms: Sequence[ForceTerm] | None = None, turned: float = 0.0,
             say: Callable[[str], None] = lambda text: None) -> Products:  # fmt: skip
    """Sums of products of all records, with the tooth angle moved by `turned` (rad) from the fit's.

    ValueError where no record has a window to compare.
    """
    terms = library(missing) if terms is None else list(terms)
    cut = any(record.cut is not None for record in missing.observed) and missing.state.model.cutting is not None
    moving = any(motion_channels(record) for record in missing.observed)
    names = ["stiffness", "damping"] * moving + ["drive"] * any(one.kind == "excited" for one in missing.observed)
    names += ["tangential_coefficient", "normal_coefficient", "mark_angle"] * cut
    left_out = _leaves_its_law(missing)
    blocks = []
    for index, record in enumerate(missing.observed):
        say(f"forces along {record.name}")
        block = _record_block(missing, index, names, terms, turned)
        blocks.append(block[:0] if index in left_out else block)
    if not any(len(block) for block in blocks):
        raise ValueError("the records are too short to look for the missing force in them")
    total = sum(np.einsum("ij,ij->j", block, block) for block in blocks)
    scale = np.sqrt(np.maximum(np.asarray(total)[:-1], 1e-300))
    scale[np.asarray(total)[:-1] <= 0.0] = 1.0
    groups = [group for group in conditions_of(missing.observed) if any(len(blocks[index]) for index in group)]
    units = np.append(scale, 1.0)
    scaled = tuple(block / units for block in blocks)
    sums = np.stack([sum(scaled[index].T @ scaled[index] for index in group) for group in groups])
    rows = np.array([sum(len(scaled[index]) for index in group) for group in groups])
    return Products(sums, tuple(names), tuple(terms), rows, scale, scaled)
