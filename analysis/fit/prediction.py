"""What an engine that the analysis is handed predicts of a record."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any, Protocol

import numpy as np

from analysis.fit.nuisances import Nuisances
from analysis.fit.observed import Observed
from testbed.cut import REMEMBERED
from testbed.machine import Model

STIFF = 100.0  # stiffness over K b from which forces are those of a rigid machine


class Plant(Protocol):
    """The engine the analysis is handed: variants of one record in, predicted channels (runs, channels, samples) out."""

    @property
    def predict_cuts(self) -> Callable[..., np.ndarray]:
        """Variants of a cut."""
        ...

    @property
    def predict_driven(self) -> Callable[..., np.ndarray]:
        """Variants of a structure that a measured force, or nothing, drives."""
        ...


def immovable(model: Model, observed: Observed) -> Model:
    """The model with a heavy mass where the structure yields nothing to speak of under the chip: stiff against K b.

    Forces are then those of a rigid machine, and no step has to follow an oscillation that nobody sees.
    """
    structure, cutting = model.structure, model.cutting
    if observed.cut is None or cutting is None:
        return model
    largest = math.hypot(cutting.tangential_coefficient, cutting.normal_coefficient)
    if structure.stiffness < STIFF * largest * observed.cut.axial_depth_of_cut:
        return model
    slow = 0.01 * observed.flutes / observed.period
    if structure.natural_frequency <= slow:
        return model
    mass = structure.mass * (structure.natural_frequency / slow) ** 2
    return model.with_values({"natural_frequency": slow, "mass": mass, "damping_ratio": 0.5})


def predict(plant: Plant, observed: Observed, variants: Sequence[tuple[Model, float, Nuisances]],
            first: np.ndarray | None = None) -> np.ndarray:  # fmt: skip
    """Predicted channels, shape (variants, channels, samples), for (model, mark angle, nuisances) variants of one record.

    first: what was predicted of the first alone, (1, channels, samples), where it is at hand.
    """
    variants = [(own.shifted(model), angle, own) for model, angle, own in variants]
    if observed.cut is None:
        states = [(n.displacement, n.velocity) for _, _, n in variants]
        own = [dict(n.states) for _, _, n in variants]
        more: dict[str, Any] = {"own": own} if any(own) else {}
        models = [model for model, _, _ in variants]
        return plant.predict_driven(models, states, observed.force, observed.rate, observed.channels, **more)
    lines = [observed.timeline(angle, nuisances) for _, angle, nuisances in variants]
    if observed.forces_only:
        variants = [(immovable(model, observed), angle, nuisances) for model, angle, nuisances in variants]
    durations = [observed.pass_durations(cut, sampling) for cut, sampling in lines]
    kept = None if any(d is None for d in durations) else durations
    lead = math.ceil(REMEMBERED * observed.rate) if observed.starts_in_cut else 0
    lead = max(0, min(lead, *(math.floor(sampling.start * observed.rate) for _, sampling in lines)))  # an angle far off
    samplings = [one for _, one in lines]
    if lead:
        samplings = [replace(one, count=one.count + lead, start=one.start - lead / one.rate) for one in samplings]
    models, cuts = [model for model, _, _ in variants], [cut for cut, _ in lines]
    more = {} if first is None or observed.starts_in_cut else {"first": first}  # alone it may have had another lead
    return plant.predict_cuts(models, cuts, samplings, observed.channels, durations=kept, **more)[..., lead:]
