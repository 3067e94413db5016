"""Cutter and engagement as they truly are: the believed ones after the effects that change them (helix, immersion_error)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from testbed.effect import Effect, hook_value
from testbed.machine import Cutter, Cutting, Model


def true_geometry(model: Model, catalogue: Mapping[str, Effect]) -> tuple[Cutter, Cutting]:
    """Cutter and engagement of a model; those of the published rig where it has none."""
    cutter, cutting = model.cutter or Cutter(), model.cutting or Cutting()
    for name, given in model.effects.items():
        effect = catalogue[name]
        values = effect.shaped(given)
        if "immersion" in effect.hooks:
            cutting = replace(cutting, immersion=hook_value(effect, "immersion", values, immersion=cutting.immersion))
        if "helix_angle" in effect.hooks:
            cutter = replace(cutter, helix_angle=hook_value(effect, "helix_angle", values, helix_angle=cutter.helix_angle))
    return cutter, cutting
