"""What a user believes of a machine: structure, cutter, cutting coefficients and the effects it has.

Every value is SI. A model is immutable: taking physics out or putting it in gives another model.
"""

from __future__ import annotations

import math
import re
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from types import MappingProxyType
from typing import Any, Literal

Direction = Literal["up-milling", "down-milling"]
Carrier = Literal["workpiece", "tool"]
CARRIERS: tuple[Carrier, ...] = ("workpiece", "tool")
MOST_FLUTES = 100  # of any cutter
SAME_DIRECTION_RAD = 1e-9  # rounding alone, between two ways to write one direction
CLOSES_RAD = math.radians(0.1)  # pitch angles in whole tenths of a degree may miss the full circle by this
DIRECTIONS: tuple[Direction, ...] = ("up-milling", "down-milling")
# Where no machine is. K_t is a specific cutting energy: foams and woods take some 50 N/mm^2, hardened steel at the thinnest
# chips below 1e5 N/mm^2. The rake face is pushed, never pulled, by the chip, and with a friction and a rake that no tool has
# K_n comes to twice K_t (Altintas 2012, Manufacturing Automation, section 2.3). Bare metal that rings loses 1e-5 of critical.
LEAST_TANGENTIAL_N_PER_M2, MOST_TANGENTIAL_N_PER_M2 = 5e7, 1e11
LEAST_NORMAL_OVER_TANGENTIAL, MOST_NORMAL_OVER_TANGENTIAL = 0.0, 2.0
LEAST_DAMPING_RATIO, MOST_DAMPING_RATIO = 1e-5, 0.5


def _require(condition: bool, message: str) -> None:
    if not condition:
        raise ValueError(message)


def radial_immersion_fraction(radial_depth_of_cut: float, diameter: float) -> float:
    """Fraction of the spindle period that one tooth spends in the cut: arccos(1 - 2 a/D) / (2 pi)."""
    _require(0.0 < radial_depth_of_cut <= diameter, "radial depth of cut must be above 0 and at most the diameter")
    return math.acos(1.0 - 2.0 * radial_depth_of_cut / diameter) / (2.0 * math.pi)


def unit_vector(angle: float) -> tuple[float, float]:
    """Unit vector (x, y) at an angle (rad) from x towards y; exact along x and y."""
    quarter, rest = divmod(angle, 0.5 * math.pi)
    x, y = (1.0, 0.0) if rest == 0.0 else (math.cos(rest), math.sin(rest))
    for _ in range(int(quarter) % 4):
        x, y = -y, x
    return x + 0.0, y + 0.0  # no negative zeros


@dataclass(frozen=True)
class Mode:
    """One vibration mode: mass (kg), natural frequency (Hz), damping ratio (1), direction (rad, from x towards y), its carrier.

    x is the feed and y the normal to it in the plane. The mass is the modal mass where the mode's shape is 1 at the cut.
    """

    mass: float
    natural_frequency: float
    damping_ratio: float
    direction: float = 0.0
    on: Carrier = "workpiece"

    def __post_init__(self) -> None:
        _require(math.isfinite(self.mass) and self.mass > 0, "mass must be above 0")
        _require(math.isfinite(self.natural_frequency) and self.natural_frequency > 0,
                 "natural_frequency must be above 0")
        _require(0.0 <= self.damping_ratio < 1.0, "damping_ratio must be at least 0 and below 1")
        _require(math.isfinite(self.direction), "direction must be finite")
        _require(self.on in CARRIERS, f"on must be one of {', '.join(CARRIERS)}")

    @property
    def natural_frequency_rad(self) -> float:
        """Undamped natural frequency, rad/s."""
        return 2.0 * math.pi * self.natural_frequency

    @property
    def stiffness(self) -> float:
        """Modal stiffness m omega^2, N/m."""
        return self.mass * self.natural_frequency_rad**2

    @property
    def damping(self) -> float:
        """Viscous damping 2 m zeta omega, N s/m."""
        return 2.0 * self.mass * self.damping_ratio * self.natural_frequency_rad

    @property
    def shape(self) -> tuple[float, float]:
        """Unit vector (x, y) along which the mode moves; exact along x and y."""
        return unit_vector(self.direction)

    def seen(self, on: Carrier, axis: int) -> float:
        """What a sensor along x (axis 0) or y (1), on the workpiece or the tool, gives of the mode's coordinate."""
        if on != self.on:
            return 0.0
        return -self.shape[axis] if on == "tool" else self.shape[axis]


def repeated_mode(modes: Sequence[Mode]) -> int | None:
    """Place of the first mode that stands before it already: same carrier, frequency and direction; None where none does."""
    before: dict[tuple[Carrier, float], list[float]] = {}
    for place, one in enumerate(modes):
        directions = before.setdefault((one.on, one.natural_frequency), [])
        turned = [(one.direction - other) % math.pi for other in directions]
        if any(min(angle, math.pi - angle) <= SAME_DIRECTION_RAD for angle in turned):
            return place
        directions.append(one.direction)
    return None


@dataclass(frozen=True)
class Structure(Mode):
    """The modes of a machine: the first, and any number of `further` ones.

    The motion of the workpiece against the tool is the sum over the modes, whoever carries them.
    """

    further: tuple[Mode, ...] = ()

    @cached_property
    def modes(self) -> tuple[Mode, ...]:
        """All modes, the first one first."""
        return (Mode(self.mass, self.natural_frequency, self.damping_ratio, self.direction, self.on), *self.further)

    @property
    def frequency_range(self) -> tuple[float, float]:
        """The lowest and the highest natural frequency of its modes, Hz."""
        frequencies = [mode.natural_frequency for mode in self.modes]
        return min(frequencies), max(frequencies)

    @property
    def planar(self) -> bool:
        """True for anything but one mode of the workpiece along the feed, the machine of the paper."""
        return bool(self.further) or self.shape != (1.0, 0.0) or self.on != "workpiece"

    @classmethod
    def of(cls, modes: Sequence[Mode]) -> Structure:
        """The structure that has these modes. ValueError where there is none, or one stands twice."""
        _require(len(modes) > 0, "a structure has at least one mode")
        _require(repeated_mode(modes) is None, "a mode stands twice")
        first = modes[0]
        return cls(first.mass, first.natural_frequency, first.damping_ratio, first.direction, first.on, tuple(modes[1:]))


@dataclass(frozen=True)
class Cutter:
    """A milling cutter: number of flutes, diameter (m), helix angle (rad), pitch angles (rad).

    pitch_angles: of each tooth, the angle by which it follows the tooth before it; the first belongs to the tooth that cuts
    first. Empty where all are equal. They are scaled to close the circle exactly.
    """

    flutes: int = 1
    diameter: float = 19.05e-3
    helix_angle: float = 0.0
    pitch_angles: tuple[float, ...] = ()

    def __post_init__(self) -> None:
        _require(int(self.flutes) == self.flutes and self.flutes >= 1, "flutes must be a whole number of at least 1")
        _require(math.isfinite(self.diameter) and self.diameter > 0, "diameter must be above 0")
        _require(abs(self.helix_angle) < math.pi / 2, "helix_angle must lie within +-90 deg")
        if self.pitch_angles:
            angles, total = self.pitch_angles, math.fsum(self.pitch_angles)
            _require(len(angles) == self.flutes, f"pitch gives {len(angles)} angles for {self.flutes} flutes")
            _require(all(angle > 0 for angle in angles), "every pitch must be above 0")
            _require(abs(total - 2.0 * math.pi) <= CLOSES_RAD,
                     f"the pitches add up to {math.degrees(total):.6g} deg, not 360 deg")
            even = max(angles) - min(angles) <= 1e-12
            object.__setattr__(self, "pitch_angles", () if even else tuple(2.0 * math.pi / total * one for one in angles))

    @property
    def pitch(self) -> float:
        """Angle between neighbouring teeth, rad: the mean one where they are not equal."""
        return 2.0 * math.pi / self.flutes

    @property
    def pitches(self) -> tuple[float, ...]:
        """Angle by which each tooth follows the one before it, rad."""
        return self.pitch_angles or (self.pitch,) * self.flutes


@dataclass(frozen=True)
class Cutting:
    """Engagement and the linear force law.

    immersion: fraction of the spindle period one tooth spends in the cut (0 to 0.5; 0.5 is a slot).
    tangential_coefficient K_t and normal_coefficient K_n: N/m^2.
    """

    direction: Direction = "up-milling"
    immersion: float = 0.162
    tangential_coefficient: float = 5.5e8
    normal_coefficient: float = 2.0e8

    def __post_init__(self) -> None:
        _require(self.direction in DIRECTIONS, f"direction must be one of {', '.join(DIRECTIONS)}")
        _require(0.0 < self.immersion <= 0.5, "immersion must be above 0 and at most 0.5 (0.5 is a slot)")
        for name in ("tangential_coefficient", "normal_coefficient"):
            _require(math.isfinite(getattr(self, name)), f"{name} must be finite")

    @property
    def engagement_angle(self) -> float:
        """Angle a tooth turns through in the cut, rad."""
        return 2.0 * math.pi * self.immersion

    @property
    def entry_angle(self) -> float:
        """Angle theta at which a tooth enters the cut, rad; zero chip at theta = 0 and pi."""
        return 0.0 if self.direction == "up-milling" else math.pi - self.engagement_angle


STRUCTURE = ("mass", "natural_frequency", "damping_ratio")
_MODE_PATH = re.compile(r"modes\[(\d+)\]\.(\w+)")
_PITCH_PATH = re.compile(r"pitch\[(\d+)\]")  # of a tooth; the last one closes the circle
CUTTING = ("immersion", "tangential_coefficient", "normal_coefficient")
BASE_UNITS = {"mass": "kg", "natural_frequency": "Hz", "damping_ratio": "1", "direction": "rad", "pitch": "rad",
              "immersion": "1", "tangential_coefficient": "N/m^2", "normal_coefficient": "N/m^2"}


def base_parameter(path: str) -> str | None:
    """Which parameter of the machine itself a path names: `mass` for `mass` and for `modes[1].mass`, `pitch` for a tooth's;
    None for an effect's."""
    found = _MODE_PATH.fullmatch(path)
    name = found[2] if found else "pitch" if _PITCH_PATH.fullmatch(path) else path
    return name if name in BASE_UNITS else None


def _frozen(effects: Mapping[str, Mapping[str, float]]) -> Mapping[str, Mapping[str, float]]:
    return MappingProxyType({
        name: MappingProxyType({key: float(value) for key, value in sorted(effects[name].items())})
        for name in sorted(effects)
    })


@dataclass(frozen=True)
class Model:
    """A machine as believed: `structure`, `cutter` and `cutting` (both absent where nothing is cut), `effects`.

    `effects` maps an effect's name to its parameters (SI); the set has no order. `machine` names the folder of
    `models/` the structure came from, where it came from one. not_determined: paths of parameters that no record told: guesses.
    spreads: (path, standard deviation in SI) of values that are believed with an uncertainty; a mode that was given by its
    stiffness has `stiffness` in place of `mass`. Another value in place of one takes its spread away.
    tapped: by path, the ends (SI) of the 95 % interval that a tap test gave, whatever the values are now.
    """

    structure: Structure
    cutter: Cutter | None = None
    cutting: Cutting | None = None
    effects: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    machine: str | None = None
    not_determined: tuple[str, ...] = field(default=(), compare=False)
    spreads: tuple[tuple[str, float], ...] = field(default=(), compare=False)
    tapped: Mapping[str, tuple[float, float]] = field(default_factory=dict, compare=False)

    def __post_init__(self) -> None:
        _require((self.cutter is None) == (self.cutting is None), "cutter and cutting stand or fall together")
        object.__setattr__(self, "effects", _frozen(self.effects))

    def __reduce__(self):  # mapping proxies do not pickle
        effects = {name: dict(values) for name, values in self.effects.items()}
        return (Model, (self.structure, self.cutter, self.cutting, effects, self.machine, self.not_determined, self.spreads,
                        dict(self.tapped)))

    def __hash__(self) -> int:
        effects = tuple((name, tuple(values.items())) for name, values in self.effects.items())
        return hash((self.structure, self.cutter, self.cutting, effects, self.machine))

    def with_effect(self, name: str, **parameters: float) -> Model:
        """The same machine with one effect more, or with that effect's parameters changed."""
        return replace(self, effects={**self.effects, name: {**self.effects.get(name, {}), **parameters}},
                       spreads=self._spreads_but([f"{name}.{one}" for one in parameters]))

    def without_effect(self, name: str) -> Model:
        """The same machine without one effect; KeyError if it has none of that name."""
        if name not in self.effects:
            raise KeyError(name)
        return replace(self, effects={key: value for key, value in self.effects.items() if key != name},
                       not_determined=tuple(path for path in self.not_determined if path.partition(".")[0] != name),
                       spreads=tuple(one for one in self.spreads if one[0].partition(".")[0] != name))

    def _spreads_but(self, paths: Collection[str]) -> tuple[tuple[str, float], ...]:
        """All spreads but those of some parameters; a stiffness goes with the mass and the frequency that it stands for."""
        if not self.spreads:
            return ()
        gone = {*paths, *(re.sub(r"(mass|natural_frequency)$", "stiffness", path) for path in paths)}
        return tuple(one for one in self.spreads if one[0] not in gone)

    @property
    def limits(self) -> Mapping[str, tuple[float, float]]:
        """Where machines are, by parameter (SI): outside of that, a value says that something else is wrong."""
        found = {self.mode_path(place, "damping_ratio"): (LEAST_DAMPING_RATIO, MOST_DAMPING_RATIO)
                 for place in range(len(self.structure.modes))}
        if self.cutting is not None:
            size = max(self.cutting.tangential_coefficient, LEAST_TANGENTIAL_N_PER_M2)
            found |= {"tangential_coefficient": (LEAST_TANGENTIAL_N_PER_M2, MOST_TANGENTIAL_N_PER_M2),
                      "normal_coefficient": (LEAST_NORMAL_OVER_TANGENTIAL * size, MOST_NORMAL_OVER_TANGENTIAL * size)}
        return found

    @property
    def planar(self) -> bool:
        """True where the model needs motion in x and y, or a pitch for each tooth: more than one mode along the feed."""
        return self.structure.planar or bool(self.cutter and self.cutter.pitch_angles)

    @property
    def base_parameters(self) -> Mapping[str, str]:
        """Paths of the parameters that belong to no effect, with their SI units."""
        cutting = {name: BASE_UNITS[name] for name in CUTTING if self.cutting is not None}
        if not self.structure.planar:
            return {name: BASE_UNITS[name] for name in STRUCTURE} | cutting
        modes = {self.mode_path(place, name): BASE_UNITS[name] for place in range(len(self.structure.modes))
                 for name in (*STRUCTURE, "direction")}
        return modes | cutting

    def mode_path(self, place: int, name: str) -> str:
        """The path of a mode's parameter: `modes[0].mass`, and of the one mode along the feed `mass` alone."""
        return f"modes[{place}].{name}" if self.structure.planar else name

    def value(self, path: str) -> float:
        """A parameter by its path: `natural_frequency` or, where there are several, `modes[0].natural_frequency`;
        `tangential_coefficient`, `pitch[0]`, `process_damping.coefficient`. KeyError where there is none."""
        if path in CUTTING:
            if self.cutting is None:
                raise KeyError(path)
            return float(getattr(self.cutting, path))
        if (tooth := self._tooth(path)) is not None:
            return self.cutter.pitches[tooth]  # type: ignore[union-attr]
        place, name = self._mode_path(path)
        if name is not None:
            return float(getattr(self.structure.modes[place], name))
        effect, _, parameter = path.partition(".")
        return self.effects[effect][parameter]

    def _mode_path(self, path: str) -> tuple[int, str | None]:
        """The mode and the parameter that a path names; no parameter where it names no mode's."""
        if not self.structure.planar and path in STRUCTURE:
            return 0, path
        found = _MODE_PATH.fullmatch(path)
        if found is None:
            return 0, None
        if path not in self.base_parameters:
            raise KeyError(path)
        return int(found[1]), found[2]

    def _tooth(self, path: str) -> int | None:
        """The tooth whose pitch a path names, any but the last; None where it names none."""
        found = _PITCH_PATH.fullmatch(path)
        if found is None:
            return None
        if self.cutter is None or int(found[1]) >= self.cutter.flutes - 1:
            raise KeyError(path)
        return int(found[1])

    def _with_pitches(self, values: Mapping[int, float]) -> Cutter | None:
        """The cutter with the pitch of some teeth (rad) replaced, the last one's such that they close the circle."""
        if self.cutter is None or not values:
            return self.cutter
        pitches = [values.get(tooth, pitch) for tooth, pitch in enumerate(self.cutter.pitches)][:-1]
        return replace(self.cutter, pitch_angles=(*pitches, 2.0 * math.pi - math.fsum(pitches)))

    def with_values(self, values: Mapping[str, float]) -> Model:
        """The same machine with parameters, named by their paths, replaced. KeyError on an unknown path."""
        pitches: dict[int, float] = {}
        effects = {name: dict(params) for name, params in self.effects.items()}
        modes: dict[int, dict[str, Any]] = {}
        cutting: dict[str, Any] = {}
        for path, number in values.items():
            place, name = self._mode_path(path)
            if name is not None:
                modes.setdefault(place, {})[name] = float(number)
            elif path in CUTTING and self.cutting is not None:
                cutting[path] = float(number)
            elif (tooth := self._tooth(path)) is not None:
                pitches[tooth] = float(number)
            else:
                effect, _, parameter = path.partition(".")
                if effect not in effects or not parameter:
                    raise KeyError(path)
                effects[effect][parameter] = float(number)
        further = tuple(replace(mode, **modes.get(place, {})) for place, mode in enumerate(self.structure.further, 1))
        return replace(self, structure=replace(self.structure, further=further, **modes.get(0, {})),
                       cutter=self._with_pitches(pitches), cutting=replace(self.cutting, **cutting) if self.cutting else None, effects=effects,
                       spreads=self._spreads_but(values))
