"""What an engine that the analysis is handed predicts of a record."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any, Protocol

import numpy as np

from testbed.analysis.fit.nuisances import Nuisances
from testbed.analysis.fit.observed import Observed
from testbed.cut import REMEMBERED
from testbed.machine import Model

OUT_OF_REACH = 1e12  # times its mass a mode has that a force is not to move
STIFF = 100.0  # stiffness over K b from which forces are those of a rigid machine


class Engine(Protocol):
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
    modes, cutting = model.structure.modes, model.cutting
    if observed.cut is None or cutting is None:
        return model
    largest = math.hypot(cutting.tangential_coefficient, cutting.normal_coefficient)
    slow = 0.01 * observed.flutes / observed.period
    if any(mode.stiffness < STIFF * largest * observed.cut.axial_depth_of_cut or mode.natural_frequency <= slow
           for mode in modes):
        return model
    values: dict[str, float] = {}
    for place, mode in enumerate(modes):
        mass = mode.mass * (mode.natural_frequency / slow) ** 2
        values |= {model.mode_path(place, name): value
                   for name, value in (("natural_frequency", slow), ("mass", mass), ("damping_ratio", 0.5))}
    return model.with_values(values)


def with_one_part_driven(model: Model, observed: Observed) -> Model:
    """The model with modes that a measured force does not reach, the other part's, too heavy for it: it drives all alike."""
    heavy = {model.mode_path(place, "mass"): mode.mass * OUT_OF_REACH
             for place, mode in enumerate(model.structure.modes) if mode.on != observed.pushed[0]}
    return model.with_values(heavy) if heavy else model


def from_first_tooth(model: Model, own: Nuisances) -> tuple[Model, float]:
    """The model with the tooth that cuts first as the first of its pitches, and how much later than an even one it comes.

    Teeth count from the anchor of the record, passes are mean pitches: the latter in passes; 0 where all teeth are alike.
    """
    cutter = model.cutter
    if cutter is None or not cutter.pitch_angles or own.entry % cutter.flutes == 0:
        return model, 0.0
    tooth, pitches = own.entry % cutter.flutes, cutter.pitch_angles
    turned = replace(model, cutter=replace(cutter, pitch_angles=(*pitches[tooth:], *pitches[:tooth])))
    return turned, math.fsum(pitches[1 : tooth + 1]) / cutter.pitch - tooth


def predict(engine: Engine, observed: Observed, variants: Sequence[tuple[Model, float, Nuisances]],
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
        if observed.kind == "excited" and models[0].structure.planar:
            on, (x, y) = observed.pushed
            more["along"] = (x, y) if on == "workpiece" else (-x, -y)  # what pushes the tool moves its modes the other way
            models = [with_one_part_driven(model, observed) for model in models]
        return engine.predict_driven(models, states, observed.force, observed.rate, observed.channels, **more)
    teeth = [from_first_tooth(model, own) for model, _, own in variants]
    lines = [observed.timeline(angle, own, late) for (_, angle, own), (_, late) in zip(variants, teeth, strict=True)]
    variants = [(model, angle, own) for (_, angle, own), (model, _) in zip(variants, teeth, strict=True)]
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
    return engine.predict_cuts(models, cuts, samplings, observed.channels, durations=kept, **more)[..., lead:]
