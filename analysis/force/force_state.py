"""Force-state maps: the force that a fitted model lacks, over displacement and velocity.

The force is the smoother's (latent_force.py), on the record with the largest misfit alone. While a tooth cuts, it also holds
what the model gets wrong about the chip, so a cut has two maps. Source: S. Masri and T. Caughey (1979), J. Appl. Mech. 46, 433
(force over state).
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from testbed.analysis.fit.fit_state import WaveformFit
from testbed.analysis.fit.held_out import RecordError
from testbed.analysis.fit.prediction import Engine
from testbed.analysis.fit.waveform import Fitter
from testbed.analysis.force.latent_force import missing_force
from testbed.analysis.force.planar_force import planar_force
from testbed.effect import Effect
from testbed.recording import sensor_of

MOVING = 0.1  # of the largest motion: samples nearer to rest say nothing about a force of the motion
SMEAR = 3.0  # time scales of the force's prior
NEGLIGIBLE = 1e-4  # of the spring's own force: a smoother that takes all that is left for noise finds less
FEWEST = 200  # samples that a map needs


@dataclass(frozen=True)
class ForceState:
    """A map: displacement x (m), velocity v (m/s) and missing force (N), (n,) each; units are the channels' own where those
    are uncalibrated. name: record and, of a cut, whether a tooth cuts."""

    name: str
    x: np.ndarray
    v: np.ndarray
    force: np.ndarray


def force_states(
    engine: Engine, fitter: Fitter, fit: WaveformFit, errors: Sequence[RecordError], catalogue: Mapping[str, Effect]
) -> list[ForceState]:
    """Maps of the record whose error is largest against its noise, in x and y along each axis that the channels tell; none
    where the smoother finds no force in it."""
    if not any(sensor_of(name) for one in fitter.records for name in one.channels):  # forces alone
        return []
    worst = int(np.argmax([one.squares / max(one.noise_squares, 1e-300) for one in errors]))
    state = replace(fit.state, nuisances=(fit.state.nuisances[worst],))
    if state.model.planar:
        try:
            along, scale = planar_force(engine, fitter.records[worst], state, catalogue)
        except (ValueError, ArithmeticError):
            return []
        smear = math.ceil(SMEAR * scale * fitter.records[worst].rate)
        return [one for each in along for one in maps_of(each, state.model.structure.natural_frequency_rad, smear)]
    try:
        missing = missing_force(engine, [fitter.records[worst]], state, catalogue)
    except (ValueError, ArithmeticError):  # a prediction too far off for a filter: the map would say nothing
        return []
    one, structure, scale = missing.records[0], state.model.structure, missing.prior.time_scale
    if float(np.std(one.force)) < NEGLIGIBLE * structure.stiffness * float(np.std(one.displacement)):
        return []
    return maps_of(one, structure.natural_frequency_rad, math.ceil(SMEAR * scale * fitter.records[worst].rate))


class Moving(Protocol):
    """Motion (m, m/s), the force that lacks (N) and whether a tooth cuts, all (samples,)."""

    @property
    def name(self) -> str: ...
    @property
    def displacement(self) -> np.ndarray: ...
    @property
    def velocity(self) -> np.ndarray: ...
    @property
    def force(self) -> np.ndarray: ...
    @property
    def cutting(self) -> np.ndarray: ...


def maps_of(one: Moving, omega: float, smear: int) -> list[ForceState]:
    """The moving samples of a record's missing force, in the cut and well out of it.

    omega (rad/s) weighs the velocity. smear: samples by which the smoother rounds off the force's jumps at entry and exit.
    """
    smear = min(smear, len(one.force) // 10)
    motion = np.hypot(one.displacement - np.median(one.displacement), one.velocity / omega)
    moving = (motion > MOVING * motion.max()) & np.isfinite(one.force)
    parts = {one.name: moving}
    if one.cutting.any():
        near = np.convolve(one.cutting, np.ones(2 * smear + 1), mode="same") > 0.5
        parts = {f"{one.name}, while a tooth cuts": moving & one.cutting, f"{one.name}, out of the cut": moving & ~near}
    return [ForceState(name, one.displacement[place], one.velocity[place], one.force[place])
            for name, place in parts.items() if np.count_nonzero(place) >= FEWEST]  # fmt: skip
