"""How a machine in x and y may have been written down wrongly: channels exchanged or turned, modes, the pitch of the teeth.

Each is a hypothesis of its own beside those of `common_factor`: the records or the model as they would then be. Where a mode
moves is an unknown of every fit, but one that comes from far off ends in another valley; so it is begun anew across.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from testbed.analysis.fit.fit_state import FreeParameter
from testbed.analysis.fit.observed import Observed
from testbed.machine import CARRIERS, DIRECTIONS, Mode, Model, Structure
from testbed.recording import channel_in_words, motion_channel, quantity_of, sensor_of

PITCH_STEP = 0.02  # rad: a natural step of a tooth's pitch
UNEVEN = 0.02  # rad, by which the fit of unequal pitches begins uneven: of equal ones the engine knows no slope
WIDEST = 0.9  # of the mean pitch, that all teeth but the last may take from it together
SLOT = 0.499  # immersion from which up- and down-milling are one
_TURNS = (math.pi / 3.0, 2.0 * math.pi / 3.0)  # rad, of a mode's direction: the others of three round the half circle


@dataclass(frozen=True)
class Slip:
    """What was written down wrongly: records and model as they would be, what is unknown besides, and how to say it.

    said: from the model as it is then fitted.
    """

    condition: str
    records: Sequence[Observed]
    model: Model
    said: Callable[[Model], str]
    more: tuple[FreeParameter, ...] = ()


def planar_slips(records: Sequence[Observed], model: Model) -> Iterator[Slip]:
    """The usual slips in a campaign of a machine in x and y."""
    if model.structure.planar:
        yield from _of_channels(records, model)
        yield from _of_modes(records, model)
        yield from _of_side(records, model)
    if model.cutter is not None and model.cutter.flutes > 1 and any(record.cut is not None for record in records):
        yield _of_pitch(records, model)


def _of_channels(records: Sequence[Observed], model: Model) -> Iterator[Slip]:
    """Axes exchanged, tool and workpiece exchanged, channels of the other sign."""
    channels = list(dict.fromkeys(name for record in records for name in record.channels))
    motions = [name for name in channels if sensor_of(name) is not None]
    parts = {on: [name for name in motions if sensor_of(name).on == on] for on in CARRIERS}  # type: ignore[union-attr]

    def renamed(names: Sequence[str], other: Callable[[str], str], told: str) -> Slip:
        new = {name: other(name) for name in names}
        changed = [replace(record, channels=tuple(new.get(name, name) for name in record.channels)) for record in records]
        return Slip("channels", changed, model, partial(_plainly, told))

    groups = [(motions, ""), *((names, f" of the {on}") for on, names in parts.items() if names and len(names) < len(motions))]
    for names, whose in groups:
        if names:
            yield renamed(names, _other_axis, f"if the channels of motion{whose} along x and y are exchanged")
    if forces := [name for name in channels if quantity_of(name) == "force"]:
        yield renamed(forces, _other_axis, "if force_x and force_y are exchanged")
    if motions:
        yield renamed(motions, _other_part, "if the sensors on tool and workpiece are exchanged (`on` of every channel), or "
                                            "tool and workpiece in the model's modes")
    for group in _groups_turned(channels, motions, parts["tool"]):
        said = ", ".join(map(channel_in_words, group))
        told = f"if {said} {'count' if len(group) > 1 else 'counts'} the other way (scale: -1)"
        yield Slip("sign", [_turned(record, group) for record in records], model, partial(_plainly, told))


def _groups_turned(channels: Sequence[str], motions: Sequence[str], tool: Sequence[str]) -> list[tuple[str, ...]]:
    """Channels whose sign may be turned: each alone, those along one axis, those of the tool, all of motion."""
    axes = [tuple(name for name in channels if _along(name) == axis) for axis in (0, 1)]
    found = [*((name,) for name in channels), *axes, tuple(tool), tuple(motions)]
    return [names for names in dict.fromkeys(tuple(sorted(one)) for one in found) if names]


def _of_modes(records: Sequence[Observed], model: Model) -> Iterator[Slip]:
    """A mode that the other part carries, or that moves elsewhere than believed."""
    modes = model.structure.modes
    for place, mode in enumerate(modes):
        other = next(on for on in CARRIERS if on != mode.on)
        moved = _with_mode(model, place, replace(mode, on=other))
        if moved is not None and len(modes) > 1:  # of one mode alone that is another slip, of the sensors
            told = f"if the {other} carries modes[{place}], not the {mode.on} (`on` of the mode)"
            yield Slip("carrier", records, moved, partial(_plainly, told))
    for place, mode in enumerate(modes):
        for turn in _TURNS:
            moved = _with_mode(model, place, replace(mode, direction=_half_turn(mode.direction + turn)))
            if moved is not None:
                yield Slip("direction", records, moved, partial(_moves_along, place, mode.direction))


def _of_side(records: Sequence[Observed], model: Model) -> Iterator[Slip]:
    """A cut made in the other direction."""
    cutting = model.cutting
    if cutting is not None and cutting.immersion < SLOT and any(record.cut is not None for record in records):
        other = next(one for one in DIRECTIONS if one != cutting.direction)
        yield Slip("milling", records, replace(model, cutting=replace(cutting, direction=other)),
                   partial(_plainly, f"if the cut was {other}, not {cutting.direction}"))


def _of_pitch(records: Sequence[Observed], model: Model) -> Slip:
    """Teeth of unequal pitch, or of other pitches than believed."""
    cutter = model.cutter
    assert cutter is not None
    teeth, mean = cutter.flutes - 1, cutter.pitch
    paths = [f"pitch[{tooth}]" for tooth in range(teeth)]
    bounds = mean * (1.0 - WIDEST / teeth), mean * (1.0 + WIDEST / teeth)
    begun = {path: value + (UNEVEN if number == 0 and not cutter.pitch_angles else 0.0)
             for number, (path, value) in enumerate(zip(paths, cutter.pitches, strict=False))}
    believed = "as believed" if cutter.pitch_angles else "equal"

    def said(fitted: Model) -> str:
        pitches = fitted.cutter.pitches  # type: ignore[union-attr]
        least = pitches.index(min(pitches))  # which tooth is the first no record tells
        angles = ", ".join(map(_degrees, (*pitches[least:], *pitches[:least])))
        return f"if the pitches of the teeth are not {believed} but {angles}, in this order round the cutter, from any tooth " \
               "(`pitch` of the cutter)"

    free = tuple(FreeParameter(path, PITCH_STEP, bounds) for path in paths)
    return Slip("pitch", records, model.with_values(begun), said, free)


def _with_mode(model: Model, place: int, mode: Mode) -> Model | None:
    """The model with another mode at a place; None where it has that already."""
    modes = [mode if number == place else one for number, one in enumerate(model.structure.modes)]
    try:
        structure = Structure.of(modes)
    except ValueError:
        return None
    return replace(model, structure=structure) if structure.planar else None


def _plainly(told: str, fitted: Model) -> str:
    """What is said whatever the fit finds."""
    return told


def _moves_along(place: int, believed: float, fitted: Model) -> str:
    direction = fitted.structure.modes[place].direction
    return f"if modes[{place}] moves along {_degrees(direction % math.pi)}, not {_degrees(believed)} (from x towards y)"


def _half_turn(direction: float) -> float:
    """The direction (rad) between -90 and 90 deg: to which side a mode moves is one."""
    return math.remainder(direction, math.pi)


def _degrees(angle: float) -> str:
    return f"{math.degrees(angle):.4g} deg"


def _along(channel: str) -> int:
    return int(channel.endswith("_y"))


def _other_axis(channel: str) -> str:
    sensor = sensor_of(channel)
    if sensor is None:
        return {"force_x": "force_y", "force_y": "force_x"}[channel]
    return motion_channel(f"{quantity_of(channel)}_{'yx'[sensor.axis]}", sensor.on)


def _other_part(channel: str) -> str:
    sensor = sensor_of(channel)
    assert sensor is not None
    return motion_channel(f"{quantity_of(channel)}_{'xy'[sensor.axis]}", "workpiece" if sensor.on == "tool" else "tool")


def _turned(record: Observed, names: Sequence[str]) -> Observed:
    sign = np.array([-1.0 if name in names else 1.0 for name in record.channels])
    return replace(record, data=sign[:, None] * record.data)
