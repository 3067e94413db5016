"""The fastest that a model may move: what effects bring in, and by how much they stiffen its structure."""

from __future__ import annotations

import math
from collections.abc import Mapping

from testbed.effect import Effect, arguments_of, hook_value
from testbed.engines.model_arrays import active_effects
from testbed.machine import Model

_STIFFENING = (("structure_force", "displacement"), ("structure_force_y", "displacement_y"))  # along x and along y


def stiffens(model: Model, catalogue: Mapping[str, Effect]) -> bool:
    """Whether the model has an effect that may make its structure stiffer as it moves further."""
    return any(argument in arguments_of(catalogue[name], hook) for name in model.effects for hook, argument in _STIFFENING)


def stiffening(model: Model, catalogue: Mapping[str, Effect], amplitude: float) -> float:
    """Highest frequency of a mode up to a displacement of `amplitude` (m) over its natural one, at least 1."""
    structure, added = model.structure, [0.0, 0.0]
    width = 1e-3 * amplitude
    offers = {"velocity": 0.0, "time": 0.0, "mass": structure.mass, "stiffness": structure.stiffness,
              "damping": structure.damping, "velocity_y": 0.0}  # fmt: skip
    for name, values in active_effects(model, catalogue).items():
        effect = catalogue[name]
        for axis, (hook, argument) in enumerate(_STIFFENING):
            if amplitude > 0.0 and argument in arguments_of(effect, hook):
                still = offers | dict.fromkeys(effect.states, 0.0) | {"displacement": 0.0, "displacement_y": 0.0}
                force = [hook_value(effect, hook, values, **(still | {argument: side + step * width}))
                         for side in (-amplitude, amplitude) for step in (-1.0, 1.0)]  # fmt: skip
                added[axis] += max(force[0] - force[1], force[2] - force[3]) / (2.0 * width)
    return math.sqrt(1.0 + max(
        sum(max(0.0, pull) * share**2 for pull, share in zip(added, mode.shape, strict=True)) / mode.stiffness
        for mode in structure.modes))  # fmt: skip


def fastest_frequency(model: Model, catalogue: Mapping[str, Effect]) -> float:
    """The highest angular frequency that the structure or an active effect brings in, rad/s."""
    structure = model.structure
    rates = [mode.natural_frequency_rad for mode in structure.modes]
    for name, values in active_effects(model, catalogue).items():
        if "highest_frequency" in catalogue[name].hooks:
            rates.append(
                hook_value(catalogue[name], "highest_frequency", values, mass=structure.mass, stiffness=structure.stiffness)
            )
    return max(rates)
