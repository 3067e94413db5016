"""What happens at the cutting edges along a known motion: chip, tooth angle, delayed displacement, and the model's force.

The motion is given (measured and smoothed, or predicted); nothing is integrated. Times are cell middles of a grid of
SUBSTEPS cells a sample; an edge that enters or leaves inside a cell counts by the share of the cell it is in the cut.
The delay is one tooth pass at the same spindle angle. Loss of contact, runout and a varying speed belong to the
prediction and are not evaluated here: where the model has them, their answer to the residual motion is neglected.
"""

from __future__ import annotations

import inspect
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np

from testbed.analysis.fit.fit_state import State
from testbed.analysis.fit.observed import Observed
from testbed.cut import Cut
from testbed.effect import Effect
from testbed.geometry import true_geometry
from testbed.machine import Cutting, Model

SUBSTEPS = 2
POINT_ANGLE = 0.3  # rad of helical lag that one axial point more is spent on


@dataclass(frozen=True)
class Trajectory:
    """A motion at samples: first time `start` (s), `rate` (Hz), displacement x (m) and velocity v (m/s), both (samples,)."""

    start: float
    rate: float
    x: np.ndarray
    v: np.ndarray

    def at(self, time: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Displacement and velocity at any times by cubic Hermite interpolation; held beyond the ends."""
        place = np.clip((time - self.start) * self.rate, 0.0, len(self.x) - 1.0)
        index = np.minimum(place.astype(int), len(self.x) - 2)
        u, dt = place - index, 1.0 / self.rate
        x0, x1, v0, v1 = self.x[index], self.x[index + 1], self.v[index], self.v[index + 1]
        x = (1 - u) ** 2 * ((1 + 2 * u) * x0 + u * dt * v0) + u**2 * ((3 - 2 * u) * x1 - (1 - u) * dt * v1)
        v = 6 * u * (1 - u) * (x1 - x0) / dt + (1 - u) * (1 - 3 * u) * v0 + u * (3 * u - 2) * v1
        return x, v

    def minus(self, other: Trajectory) -> Trajectory:
        """The difference of two motions at the same samples."""
        return replace(self, x=self.x - other.x, v=self.v - other.v)


@dataclass(frozen=True)
class CellForce:
    """A force over the cells of a course (cells,), N: along x on the structure, and across the feed where anything cuts."""

    along: np.ndarray
    across: np.ndarray | None = None

    def minus(self, other: CellForce) -> CellForce:
        """The difference of two forces."""
        sides = (self.across, other.across)
        return CellForce(self.along - other.along, None if sides[0] is None or sides[1] is None else sides[0] - sides[1])

    def on(self, channel: str) -> np.ndarray:
        """What a dynamometer's channel sees of it (cells,)."""
        if channel == "force_y":
            return np.zeros(len(self.along)) if self.across is None else self.across
        return self.along


@dataclass(frozen=True)
class Edges:
    """Edges in the cut along a motion, one entry an edge and cell (entries,). cell: which cell; share of it in the cut.

    The names of the rest are those an effect's hook may ask for (`testbed effects --hooks`).
    """

    cell: np.ndarray
    share: np.ndarray
    variables: Mapping[str, np.ndarray]

    def force(self, tangential: np.ndarray, normal: np.ndarray, cells: int) -> CellForce:
        """Force over the cells of tangential and normal forces (entries,), N."""
        sine, cosine = np.sin(self.variables["angle"]), np.cos(self.variables["angle"])
        along = -(tangential * cosine + normal * sine) * self.share
        across = (tangential * sine - normal * cosine) * self.share
        return CellForce(np.bincount(self.cell, along, cells), np.bincount(self.cell, across, cells))


@dataclass(frozen=True)
class Course:
    """Where the edges of a record are: everything of `Edges` that the motion does not change. time (cells,) s.

    turn (cells,): spindle angle in revolutions, NaN where nothing turns. rows: what each edge entry is. depth (m),
    cutting_speed (m/s), breaks (s): entry and exit of the cut; flutes.
    """

    time: np.ndarray
    samples: int
    turn: np.ndarray
    cell: np.ndarray
    share: np.ndarray
    rows: Mapping[str, np.ndarray]
    depth: float
    cutting_speed: float
    breaks: tuple[float, ...]
    flutes: int

    def edges(self, motion: Trajectory) -> Edges:
        """The edges along a motion."""
        x, v = motion.at(self.time[self.cell])
        before, _ = motion.at(self.rows["earlier"])
        before = np.where(self.rows["first"], 0.0, before)
        sine = np.sin(self.rows["angle"])
        chip = (self.rows["fed"] + x - before) * sine
        known = {name: self.rows[name] for name in ("angle", "depth", "length_cut", "tooth", "time")}
        return Edges(
            self.cell,
            self.share,
            known
            | {
                "chip": chip,
                "penetration": chip,
                "edge_velocity": v * sine,
                "displacement": x,
                "velocity": v,
                "delayed": before,
                "cutting_speed": np.full(x.shape, self.cutting_speed),
                "radius": self.rows["radius"],
                "feed_per_tooth": self.rows["feed_per_tooth"],
            },
        )

    def sampled(self, values: np.ndarray) -> np.ndarray:
        """A force over the cells, averaged about each sample (samples,)."""
        rows = values.reshape(self.samples - 1, -1)
        half = rows.shape[1] // 2
        padded = np.vstack([rows[:1], rows, rows[-1:]])
        return 0.5 * (padded[:-1, -half:].mean(axis=1) + padded[1:, :half].mean(axis=1))

    def at_samples(self, edges: Edges) -> dict[str, np.ndarray]:
        """Delayed displacement, chip, tooth angle, spindle angle and length cut at the samples; NaN out of the cut."""
        found = {}
        cells = np.clip(np.arange(self.samples) * SUBSTEPS, 0, len(self.time) - 1)
        for name, source in (("delayed", "delayed"), ("chip", "chip"), ("angle", "angle"), ("length", "length_cut")):
            values = np.full(len(self.time), np.nan)
            inside = edges.share > 0.5
            values[edges.cell[inside][::-1]] = edges.variables[source][inside][::-1]  # the leading edge has the last word
            found[name] = values[cells]
        found["spindle_angle"] = np.mod(self.turn[cells], 1.0) * 2 * math.pi
        return found


def _hooked(function: Callable, known: Mapping[str, np.ndarray | float], size: int) -> np.ndarray:
    """A hook of the loop evaluated point by point, shape (size,)."""
    names = list(inspect.signature(function).parameters)
    columns = [np.broadcast_to(np.asarray(known[name], dtype=float), size) for name in names]
    return np.fromiter((function(*row) for row in zip(*(one.tolist() for one in columns), strict=True)), float, size)


def course_of(record: Observed, state: State, index: int, catalogue: Mapping[str, Effect], turned: float = 0.0) -> Course:
    """The course of one record under a fitted state; `turned` (rad) is added to the tooth angle."""
    cells = (record.samples - 1) * SUBSTEPS
    time = record.start + (np.arange(cells) + 0.5) / (record.rate * SUBSTEPS)
    if record.cut is None or state.model.cutting is None:
        none = np.empty(0)
        names = ("angle", "depth", "length_cut", "tooth", "time", "earlier", "fed", "radius", "feed_per_tooth")
        rows = {name: none for name in names} | {"first": none.astype(bool)}
        return Course(time, record.samples, np.full(cells, np.nan), none.astype(int), none, rows, 0.0, 0.0, (), record.flutes)
    cut, sampling = record.timeline(state.angle + turned, state.nuisances[index])
    durations = record.pass_durations(cut, sampling)
    pitch_time = cut.tooth_passing_period(record.flutes)
    steps = np.full(cut.total_passes, pitch_time) if durations is None else durations
    starts = record.start - sampling.start + np.concatenate([[0.0], np.cumsum(steps)])
    return _cut_course(record, state, cut, starts, catalogue, time)


def _cut_course(
    record: Observed, state: State, cut: Cut, starts: np.ndarray, catalogue: Mapping[str, Effect], time: np.ndarray
) -> Course:
    cutter, cutting = true_geometry(state.model, catalogue)
    count = np.arange(len(starts), dtype=float)
    position = np.interp(time, starts, count)
    half = 0.5 / (record.rate * SUBSTEPS)
    ends = np.interp(time + half, starts, count)
    number = np.floor(ends)
    lead, width = (position - number) * cutter.pitch, 2.0 * (ends - position) * cutter.pitch
    passed = number - cut.idle_passes
    inside = (passed >= 0) & (passed < cut.passes) & (width > 0)
    feed_speed = cut.feed_per_tooth / cut.tooth_passing_period(cutter.flutes)
    entered = starts[min(cut.idle_passes, len(starts) - 1)]
    earlier = np.interp(position - 1.0, count, starts)
    lag = 2.0 * cut.axial_depth_of_cut * abs(math.tan(cutter.helix_angle)) / cutter.diameter
    parts: list[dict[str, np.ndarray]] = []
    for behind in range(math.ceil((cutting.engagement_angle + lag) / cutter.pitch - 1e-9)):
        for angle, share, depth in _points(lead + behind * cutter.pitch, width, cutting, lag, cut.axial_depth_of_cut):
            cell = np.flatnonzero(inside & (share > 0.0))
            parts.append(
                {
                    "cell": cell,
                    "share": share[cell],
                    "angle": cutting.entry_angle + angle[cell],
                    "depth": depth[cell],
                    "first": passed[cell] == 0,
                    "tooth": np.mod(passed[cell] - behind, cutter.flutes),
                    "earlier": earlier[cell],
                    "fed": feed_speed * (time[cell] - earlier[cell]),
                    "length_cut": cut.length_cut_before + feed_speed * (time[cell] - entered),
                    "time": time[cell] - starts[0],
                    "radius": np.full(len(cell), 0.5 * cutter.diameter),
                    "feed_per_tooth": np.full(len(cell), cut.feed_per_tooth),
                }
            )
    rows = {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}
    leave = starts[min(cut.idle_passes + cut.passes, len(starts) - 1)]
    turn = (position - cut.idle_passes) / cutter.flutes
    speed = 0.5 * cutter.diameter * cut.spindle_speed
    return Course(
        time,
        record.samples,
        turn,
        rows["cell"].astype(int),
        rows["share"],
        rows,
        cut.axial_depth_of_cut,
        speed,
        (float(entered), float(leave)),
        cutter.flutes,
    )


def _points(
    lead: np.ndarray, width: np.ndarray, cutting: Cutting, lag: float, depth: float
) -> list[tuple[np.ndarray, np.ndarray, np.ndarray]]:
    """(angle after entry, share of the cell, depth) of each axial point of an edge whose tip stands at `lead`."""
    engaged = cutting.engagement_angle
    if lag == 0.0:
        low, high = np.maximum(lead - 0.5 * width, 0.0), np.minimum(lead + 0.5 * width, engaged)
        share = np.clip((high - low) / np.maximum(width, 1e-300), 0.0, 1.0)
        return [(0.5 * (low + high), share, np.full(lead.shape, depth))]
    nodes, weights = np.polynomial.legendre.leggauss(3 + math.ceil(min(lag, engaged) / POINT_ANGLE))
    low, high = np.maximum(lead - lag, 0.0), np.minimum(lead, engaged)
    covered = np.maximum(high - low, 0.0) / lag
    return [
        (0.5 * (high + low - (high - low) * node), (covered > 0).astype(float), 0.5 * weight * covered * depth)
        for node, weight in zip(nodes, weights, strict=True)
    ]


def base_force(course: Course, edges: Edges, tangential: float, normal: float) -> CellForce:
    """Force of the linear chip law with coefficients K_t and K_n (N/m^2)."""
    load = edges.variables["depth"] * edges.variables["chip"]
    return edges.force(tangential * load, normal * load, len(course.time))


def model_force(model: Model, catalogue: Mapping[str, Effect], course: Course, motion: Trajectory) -> CellForce:
    """The model's force along a motion, beyond m, c and k: chip law and the effects that add a force to it."""
    edges, cells, count = course.edges(motion), len(course.time), len(course.cell)
    tangential, normal = np.zeros(count), np.zeros(count)
    if model.cutting is not None:
        load = edges.variables["depth"] * edges.variables["chip"]
        tangential += model.cutting.tangential_coefficient * load
        normal += model.cutting.normal_coefficient * load
    own, structure = np.zeros(cells), model.structure
    for name, given in model.effects.items():
        effect = catalogue[name]
        values = effect.shaped(given)
        if effect.states:
            continue
        for hook, side in (("tangential_force", tangential), ("normal_force", normal)):
            if hook in effect.hooks and count:
                side += _hooked(effect.hooks[hook], {**edges.variables, **values}, count)
        if "structure_force" in effect.hooks:
            x, v = motion.at(course.time)
            place: dict[str, np.ndarray | float] = {
                "displacement": x, "velocity": v, "time": course.time, "mass": structure.mass,
                "stiffness": structure.stiffness, "damping": structure.damping}  # fmt: skip
            own += _hooked(effect.hooks["structure_force"], {**place, **values}, cells)
    cut = edges.force(tangential, normal, cells)
    return CellForce(cut.along + own, cut.across)
