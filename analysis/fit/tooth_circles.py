"""Effects that set the teeth on circles of their own: what the teeth can tell of a strength and its direction.

Two teeth have one difference between them, so of an offset e in the direction lambda they tell e cos(lambda) alone. A fit of
both may end anywhere along that valley: nearly square to the teeth the offset is many times too large. Then the least offset
is told, and that its direction is unknown.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from testbed.analysis.fit.fit_state import WaveformFit
from testbed.analysis.fit.waveform import Fitter
from testbed.effect import Effect, arguments_of, hook_value
from testbed.machine import Cutter, Model

ONE_NUMBER = 1e-6  # share of a second combination of parameters in what moves the teeth, below which there is one alone
DIRECTIONS = 360  # tried round a turn; 0 and half a turn are among them
APART = (0.3, 1.1)  # rad: directions at which it is asked what moves the teeth; no symmetry makes both of them special


def unknown_directions(model: Model, catalogue: Mapping[str, Effect]) -> dict[str, tuple[str, str]]:
    """(strength, direction) by name of the model's effects whose direction and strength these teeth cannot tell apart."""
    return {name: pair for name, pair in _on_circles(model, catalogue).items()
            if model.cutter is not None and _is_one_number(catalogue[name], pair, model.cutter)}


def at_least_strength(fitter: Fitter, fit: WaveformFit, catalogue: Mapping[str, Effect]) -> tuple[Fitter, WaveformFit]:
    """The fit with such effects as weak as the circles found allow, and their directions held; itself where there are none."""
    model = weaker = fit.state.model
    for name, pair in unknown_directions(model, catalogue).items():
        assert model.cutter is not None
        weaker = weaker.with_effect(name, **_least(catalogue[name], pair, model.effects[name], model.cutter))
        fitter = fitter.without(f"{name}.{pair[1]}")
    if weaker == model and fitter.names == fit.names:
        return fitter, fit
    moved = fitter.fit(replace(fit.state, model=weaker))
    return fitter, replace(moved, alike=fit.alike, converged=fit.converged or moved.converged)


def direction_notes(fitter: Fitter, model: Model, catalogue: Mapping[str, Effect]) -> list[str]:
    """What of a direction no tooth tells, in sentences."""
    marked = any(record.cut is not None and record.first_mark is not None for record in fitter.records)
    cannot, said = unknown_directions(model, catalogue), []
    for name, pair in _on_circles(model, catalogue).items():
        assert model.cutter is not None
        strength, direction = (f"{name}.{one}" for one in pair)
        if name in cannot:
            said.append(f"{strength} and {direction} are one number with so few flutes ({model.cutter.flutes}): given is the "
                        "least strength that explains it; in another direction it is larger")
        elif not marked:
            said.append(f"{direction} counts from the tooth taken for the first: without a tachometer any may be that, and "
                        f"from another it is whole pitches of {math.degrees(model.cutter.pitch):g} deg more or less")
    return said


def directed(effect: Effect) -> tuple[str, str] | None:
    """(strength, direction): names of an effect's only strength and of the angle that says which way it points; or None."""
    strengths = [one.name for one in effect.parameters if one.vanishes]
    directions = [one.name for one in effect.parameters if not one.vanishes and one.unit == "rad"]
    return (strengths[0], directions[0]) if len(strengths) == len(directions) == 1 else None


def _on_circles(model: Model, catalogue: Mapping[str, Effect]) -> dict[str, tuple[str, str]]:
    """(strength, direction) by name of the model's effects that do nothing but set the cutter's teeth on circles."""
    found = {}
    for name in model.effects if model.cutter is not None else ():
        effect, pair = catalogue[name], directed(catalogue[name])
        asked = set(arguments_of(effect, "edge_position")) - {one.name for one in effect.every_parameter}
        if pair and set(effect.hooks) == {"edge_position"} and len(effect.parameters) == 2 and not {"angle", "time"} & asked:
            found[name] = pair
    return found


def _circles(effect: Effect, values: Mapping[str, float], cutter: Cutter) -> np.ndarray:
    """Radii (flutes,) of the teeth's circles beyond the nominal one, m."""
    flutes, radius = int(cutter.flutes), 0.5 * cutter.diameter
    return np.array([hook_value(effect, "edge_position", values, tooth=float(tooth), flutes=float(flutes), radius=radius)
                     for tooth in range(flutes)])


def _is_one_number(effect: Effect, pair: tuple[str, str], cutter: Cutter) -> bool:
    _, direction = pair
    seen = [_circles(effect, {**effect.example(), direction: turned}, cutter) for turned in APART]
    sizes = np.linalg.svd(np.array(seen), compute_uv=False)
    return len(sizes) < 2 or bool(sizes[1] <= ONE_NUMBER * max(sizes[0], 1e-300))


def _least(effect: Effect, pair: tuple[str, str], values: Mapping[str, float], cutter: Cutter) -> dict[str, float]:
    """The least strength, with its direction, that sets the teeth on the circles that these values do."""
    strength, direction = pair
    wanted, one = _circles(effect, values, cutter), effect.parameter(strength)
    turns = np.linspace(0.0, 2.0 * math.pi, DIRECTIONS, endpoint=False)
    found = []
    for turn in np.where(turns > math.pi, turns - 2.0 * math.pi, turns):
        per_unit = _circles(effect, {strength: 1.0, direction: float(turn)}, cutter)
        amount = float(per_unit @ wanted) / max(float(per_unit @ per_unit), 1e-300)
        if np.abs(wanted - amount * per_unit).max() <= ONE_NUMBER * np.abs(wanted).max():
            found.append((abs(amount), amount, float(turn)))
    allowed = [way for way in found if one.bounds[0] <= way[1] <= one.bounds[1]]
    if not allowed or not wanted.any():
        return dict(values)
    size, amount, turn = min(allowed)
    if size >= abs(values[strength]) * (1.0 - ONE_NUMBER):
        return dict(values)
    return {strength: amount, direction: turn}
