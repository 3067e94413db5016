"""What records can tell of the machine itself, as unknowns of a fit: how its modes ring, their masses, how it cuts."""

from __future__ import annotations

import math
from collections.abc import Sequence

from testbed.analysis.fit.fit_state import FreeParameter
from testbed.analysis.fit.observed import Observed
from testbed.analysis.fit.shown_range import frequency_bounds, mass_bounds
from testbed.machine import Model, base_parameter

DIRECTION_STEP = 0.1  # rad: a natural step of a mode's direction
_DAMPING_BOUNDS = (1e-6, 0.9)


def free_parameters(records: Sequence[Observed], model: Model) -> list[FreeParameter]:
    """The base parameters these records can speak of.

    A displacement under a cut knows stiffness and cutting coefficients only relative to the mass, which stays as believed;
    a measured force that drives the structure makes the mass known. A dynamometer's forces say nothing of the structure.
    Of a structure that moves in the plane, all that any records could tell: see `identifiable` for what these do.
    """
    kinds = {record.kind for record in records}
    moving = not all(record.forces_only for record in records)
    free = []
    if moving:
        free += [one for place in range(len(model.structure.modes)) for one in how_a_mode_rings(records, model, place)]
    if "excited" in kinds or moving and model.structure.planar:
        free += [mass_of_a_mode(records, model, place) for place in range(len(model.structure.modes))]
    if "cut" in kinds:
        free += how_it_cuts(model)
    return free


def how_a_mode_rings(records: Sequence[Observed], model: Model, place: int) -> list[FreeParameter]:
    """Frequency, damping ratio and, in the plane, direction of the mode at a place, as unknowns."""
    mode = model.structure.modes[place]
    free = [
        FreeParameter(model.mode_path(place, "natural_frequency"), 0.01 * mode.natural_frequency,
                      frequency_bounds(records, mode.natural_frequency)),
        FreeParameter(model.mode_path(place, "damping_ratio"), max(0.2 * mode.damping_ratio, 1e-4), _DAMPING_BOUNDS),
    ]
    if model.structure.planar:
        free.append(FreeParameter(model.mode_path(place, "direction"), DIRECTION_STEP, (-math.pi, math.pi), periodic=True))
    return free


def how_it_cuts(model: Model) -> list[FreeParameter]:
    """Both cutting coefficients, as unknowns; none of a model that has none."""
    if model.cutting is None:
        return []
    size = max(abs(model.cutting.tangential_coefficient), abs(model.cutting.normal_coefficient))
    return [FreeParameter("tangential_coefficient", 0.2 * size, (1e-3 * size, 100 * size)),
            FreeParameter("normal_coefficient", 0.2 * size, (-20 * size, 100 * size))]  # fmt: skip


def mass_of_a_mode(records: Sequence[Observed], model: Model, place: int) -> FreeParameter:
    """The mass of the mode at a place, as an unknown."""
    mass = model.structure.modes[place].mass
    return FreeParameter(model.mode_path(place, "mass"), 0.05 * mass, mass_bounds(records, mass))


def at_a_bound(free: Sequence[FreeParameter], model: Model) -> bool:
    """Whether a parameter of the machine itself ended where no machine is: a fit made up for something by it."""
    return any(base_parameter(one.path) and model.value(one.path) in one.bounds for one in free)
