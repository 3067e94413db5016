"""What a user believes of a machine: structure, cutter, cutting coefficients and the effects it has.

Every value is SI. A model is immutable: taking physics out or putting it in gives another model.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Mapping
from dataclasses import dataclass, field, replace
from types import MappingProxyType
from typing import Any

from testbed.cutter import DIRECTIONS, MOST_FLUTES, Cutter, Cutting, Direction, radial_immersion_fraction
from testbed.structure import CARRIERS, Carrier, Mode, Structure, repeated_mode, require, unit_vector

__all__ = ["CARRIERS", "DIRECTIONS", "MOST_FLUTES", "Carrier", "Cutter", "Cutting", "Direction", "Mode", "Model", "Structure",
           "base_parameter", "radial_immersion_fraction", "repeated_mode", "unit_vector"]

# Where no machine is. K_t is a specific cutting energy: foams and woods take some 50 N/mm^2, hardened steel at the thinnest
# chips below 1e5 N/mm^2. The rake face is pushed, never pulled, by the chip, and with a friction and a rake that no tool has
# K_n comes to twice K_t (Altintas 2012, Manufacturing Automation, section 2.3). Bare metal that rings loses 1e-5 of critical.
LEAST_TANGENTIAL_N_PER_M2, MOST_TANGENTIAL_N_PER_M2 = 5e7, 1e11
LEAST_NORMAL_OVER_TANGENTIAL, MOST_NORMAL_OVER_TANGENTIAL = 0.0, 2.0
LEAST_DAMPING_RATIO, MOST_DAMPING_RATIO = 1e-5, 0.5

STRUCTURE = ("mass", "natural_frequency", "damping_ratio")
_MODE_PATH = re.compile(r"modes\[(0|[1-9]\d*)\]\.(\w+)")
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
    tapped: by path, the ends (SI) of the 95 % interval that a tap test gave, whatever the values are now. file: where it was
    read, empty where it was not, or was changed since.
    """

    structure: Structure
    cutter: Cutter | None = None
    cutting: Cutting | None = None
    effects: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    machine: str | None = None
    not_determined: tuple[str, ...] = field(default=(), compare=False)
    spreads: tuple[tuple[str, float], ...] = field(default=(), compare=False)
    tapped: Mapping[str, tuple[float, float]] = field(default_factory=dict, compare=False)
    file: str = field(default="", compare=False, repr=False)

    def __post_init__(self) -> None:
        require((self.cutter is None) == (self.cutting is None), "cutter and cutting stand or fall together")
        object.__setattr__(self, "effects", _frozen(self.effects))

    def __reduce__(self):  # mapping proxies do not pickle
        effects = {name: dict(values) for name, values in self.effects.items()}
        return (Model, (self.structure, self.cutter, self.cutting, effects, self.machine, self.not_determined, self.spreads,
                        dict(self.tapped), self.file))

    def __hash__(self) -> int:
        effects = tuple((name, tuple(values.items())) for name, values in self.effects.items())
        return hash((self.structure, self.cutter, self.cutting, effects, self.machine))

    def _repr_html_(self) -> str:
        """For a notebook: every parameter with its unit; those that are guesses are marked."""
        own = {f"{name}.{one}": "" for name, values in self.effects.items() for one in values}
        rows = "".join(f"<tr><td>{path}</td><td>{self.value(path):.6g} {unit if unit != '1' else ''}"
                       f"{' (a guess)' if path in self.not_determined else ''}</td></tr>"
                       for path, unit in {**self.base_parameters, **own}.items())
        return f"<p><b>Model</b> {self.file}</p><table><tbody>{rows}</tbody></table>"

    def with_effect(self, name: str, **parameters: float) -> Model:
        """The same machine with one effect more, or with that effect's parameters changed."""
        return replace(self, effects={**self.effects, name: {**self.effects.get(name, {}), **parameters}},
                       spreads=self._spreads_but([f"{name}.{one}" for one in parameters]), file="")

    def without_effect(self, name: str) -> Model:
        """The same machine without one effect; KeyError if it has none of that name."""
        if name not in self.effects:
            raise KeyError(name)
        return replace(self, effects={key: value for key, value in self.effects.items() if key != name},
                       not_determined=tuple(path for path in self.not_determined if path.partition(".")[0] != name),
                       spreads=tuple(one for one in self.spreads if one[0].partition(".")[0] != name), file="")

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
        place, name = int(found[1]), found[2]
        if not self.structure.planar or name not in (*STRUCTURE, "direction") or place >= len(self.structure.modes):
            raise KeyError(path)
        return place, name

    def _tooth(self, path: str) -> int | None:
        """The tooth whose pitch a path names, any but the last; None where it names none."""
        found = _PITCH_PATH.fullmatch(path)
        if found is None:
            return None
        if self.cutter is None or int(found[1]) >= self.cutter.flutes - 1:
            raise KeyError(path)
        return int(found[1])

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
                       cutter=self.cutter.with_pitches(pitches) if self.cutter and pitches else self.cutter,
                       cutting=replace(self.cutting, **cutting) if self.cutting else None, effects=effects,
                       spreads=self._spreads_but(values), file="")
