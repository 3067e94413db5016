"""The contract of a physical effect (`testbed.catalogue` reads the files).

An effect is one Python file. Its docstring is its manual; `EFFECT = Effect(...)` states its parameters; its hooks are plain
functions named after a place on the regenerative loop (`HOOKS`). A hook asks for what it needs by the names of its
arguments: quantities of that place, parameters of the effect, states of the effect. All values are SI.

    \"\"\"Cubic stiffness: F = -k3 x^3 (Duffing). ...\"\"\"
    from testbed.effect import Effect, Parameter

    EFFECT = Effect(parameters=(Parameter("coefficient", "k_3", "N/m^3", ...),), ...)

    def structure_force(displacement, coefficient):
        return -coefficient * displacement**3

Effects add up (sums) or scale (products), so a set of them has no order.

x is the feed, y the normal to it in the plane of the cutter. `displacement` and `velocity` are the motion of the workpiece
against the tool along x by the structure's own modes, `displacement_y` and `velocity_y` along y; mass, stiffness and damping
are the first mode's. A force along x or y drives every mode by its share in the mode's direction. Of an edge, `edge_velocity`
is the velocity at which it sinks into the work (x' sin + y' cos), `edge_velocity_along` the one that the motion adds to the
cutting speed (x' cos - y' sin). A direction (rad, from x towards y) is a parameter named `direction`: where it is 0 the
effect moves nothing across the feed.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path
from types import MappingProxyType

from testbed.units import is_si_unit


@dataclass(frozen=True)
class Hook:
    """A place on the regenerative loop: what a function there may ask for, how contributions join, and their unit."""

    offers: tuple[str, ...]
    joins: str  # "sum", "product", "replace" (at most one effect), "value" (a derivative), "python"
    unit: str
    meaning: str


ACROSS_OFFERS = ("displacement_y", "velocity_y", "applied_force_y")  # what stays 0 on a structure that moves along x alone
_EVERYWHERE = ("displacement", "velocity", "displacement_y", "velocity_y", "time")
_TOOTH = (
    "chip",
    "penetration",
    "angle",
    "edge_velocity",
    "edge_velocity_along",
    "depth",
    "cutting_speed",
    "length_cut",
    "radius",
    "feed_per_tooth",
    "tooth",
    *_EVERYWHERE,
)
_STRUCTURE = ("mass", "stiffness", "damping", *_EVERYWHERE)

HOOKS: Mapping[str, Hook] = MappingProxyType(
    {
        "edge_position": Hook(
            ("tooth", "flutes", "radius", "angle", "time"),
            "sum",
            "m",
            "radial position of a tooth's edge beyond the nominal radius",
        ),
        "relative_displacement": Hook(_EVERYWHERE, "sum", "m", "displacement of workpiece against tool beyond the modes'"),
        "relative_velocity": Hook(_EVERYWHERE, "sum", "m/s", "time derivative of relative_displacement"),
        "relative_displacement_y": Hook(_EVERYWHERE, "sum", "m", "relative_displacement across the feed, along y"),
        "relative_velocity_y": Hook(_EVERYWHERE, "sum", "m/s", "time derivative of relative_displacement_y"),
        "engagement": Hook(
            ("phase", "engagement_angle", "entry_angle", "feed_travel", "feed_per_tooth", "radius", "time"),
            "product",
            "1",
            "share of the edge in the cut at `phase` after the tooth's entry",
        ),
        "chip": Hook(("penetration",), "replace", "m", "chip thickness left of the edge's penetration below the surface"),
        "force_factor": Hook(_TOOTH, "product", "1", "factor on both cutting coefficients"),
        "tangential_force": Hook(_TOOTH, "sum", "N", "tangential force on the tooth beyond K_t b chip"),
        "normal_force": Hook(_TOOTH, "sum", "N", "normal force on the tooth beyond K_n b chip"),
        "structure_force": Hook(_STRUCTURE, "sum", "N", "force on the structure along x"),
        "structure_force_y": Hook(_STRUCTURE, "sum", "N", "force on the structure along y"),
        "derivative": Hook(
            ("applied_force", "applied_force_y", "torque", *_STRUCTURE),
            "value",
            "1/s",
            "derivative_STATE: time derivative of one of the effect's own states",
        ),
        "speed": Hook(("time", "spindle_speed"), "sum", "1", "relative change of the spindle speed"),
        "sensed_displacement": Hook((), "sum", "m", "what the sensor sees beyond the modes, linear in the effect's states"),
        "sensed_velocity": Hook((), "sum", "m/s", "time derivative of sensed_displacement"),
        "sensed_displacement_y": Hook((), "sum", "m", "sensed_displacement along y"),
        "sensed_velocity_y": Hook((), "sum", "m/s", "time derivative of sensed_displacement_y"),
        "immersion": Hook(("immersion",), "python", "1", "the true immersion, from the believed one"),
        "helix_angle": Hook(("helix_angle",), "python", "rad", "the true helix angle, from the believed one"),
        "measure": Hook(
            ("signal", "true_signal", "rate", "sampling_rate", "quantity", "time"),
            "python",
            "channel's",
            "the sampled channel as the sensor gives it (numpy); true_signal: as it was before any effect",
        ),
        "highest_frequency": Hook(("mass", "stiffness"), "python", "rad/s", "fastest motion the effect brings in"),
    }
)


@dataclass(frozen=True)
class Parameter:
    """One parameter of an effect. At `neutral` the effect vanishes exactly; `start` begins a fit; `example` is plain to see."""

    name: str
    symbol: str
    unit: str
    meaning: str
    neutral: float
    bounds: tuple[float, float]
    example: float
    start: float | None = None
    vanishes: bool = True  # False: the value alone does not switch the effect off (a frequency, an angle)
    each_record: bool = False  # True: every record has a value of its own (a phase at the record's start)
    channels: tuple[str, ...] = ()  # the only channels that show it: unknown where none is recorded, and may then be left out

    def __post_init__(self) -> None:
        for said in ("name", "symbol", "unit", "meaning"):
            if not isinstance(getattr(self, said), str):
                raise ValueError(f"parameter {self.name}: its {said} is no text")
        low, high = self.bounds
        if not self.unit:
            raise ValueError(f"parameter {self.name}: no unit (dimensionless is '1')")
        if not is_si_unit(self.unit):
            raise ValueError(f"parameter {self.name}: '{self.unit}' is no SI unit (write N s/m, 1/(N m), rad, 1)")
        if not low < high:
            raise ValueError(f"parameter {self.name}: the bounds {low:g} and {high:g} are not in rising order")
        if not (low <= self.neutral <= high):
            raise ValueError(f"parameter {self.name}: the neutral value lies outside the bounds")
        if not (low <= self.example <= high):
            raise ValueError(f"parameter {self.name}: the example lies outside the bounds")


@dataclass(frozen=True)
class Effect:
    """A physical effect: what its file says of it, and its hook functions.

    leaves: what it leaves in a measurement. confused_with: (name, the test cut that separates the two).
    form: what gives the law its shape (an exponent, the size that it is a power of): as the law has it where neutral. A model
    need not say it, and no fit changes it unless the law itself is in question.
    states: names of the effect's own ordinary differential states, each with a `derivative_STATE` hook.
    oscillators: pairs of states, neighbours in `states`, that left to themselves are a linear damped oscillator (position,
    its rate): the engines may carry them by their exact map. A promise, which the contract test checks.
    slider: (state, parameter) of a law that is a spring and a slider in series and no more: the state is the spring's
    deflection, structure_force is in proportion to it up to the parameter and constant beyond, where it slides. A promise, too.
    smooth: False where its law has kinks, so that integration keeps less than fourth order.
    requires: effects that a search adds first, because alone this one says nothing that they do not say.
    no_linear_answer: why the loop with this effect has no linear delay equation; empty where it has one.
    """

    title: str
    parameters: tuple[Parameter, ...]
    law: str
    source: str
    validity: str
    leaves: str
    confused_with: tuple[tuple[str, str], ...] = ()
    form: tuple[Parameter, ...] = ()
    states: tuple[str, ...] = ()
    oscillators: tuple[tuple[str, str], ...] = ()
    slider: tuple[str, str] | None = None
    smooth: bool = True
    requires: tuple[str, ...] = ()
    no_linear_answer: str = ""
    name: str = ""
    manual: str = ""
    path: Path | None = None
    hooks: Mapping[str, Callable] = field(default_factory=dict)

    @property
    def titled(self) -> str:
        """What it is and what it is called, for people: Tool wear [tool_wear]."""
        return f"{self.title} [{self.name}]"

    @property
    def every_parameter(self) -> tuple[Parameter, ...]:
        """All that a model may say of the effect: its parameters and the form of its law."""
        return (*self.parameters, *self.form)

    def parameter(self, name: str) -> Parameter:
        """The parameter of that name; KeyError if there is none."""
        for parameter in self.every_parameter:
            if parameter.name == name:
                return parameter
        raise KeyError(name)

    def example(self) -> dict[str, float]:
        """Parameter values at which the effect is plain to see."""
        return {parameter.name: parameter.example for parameter in self.parameters}

    def other_side(self) -> dict[str, float] | None:
        """The example with what switches the effect as far on the other side of neutral; None where a bound forbids that."""
        found = self.example()
        for one in self.parameters:
            if one.vanishes:
                found[one.name] = 2.0 * one.neutral - one.example
                if not one.bounds[0] <= found[one.name] <= one.bounds[1]:
                    return None
        return found if found != self.example() else None

    def neutral(self) -> dict[str, float]:
        """Parameter values at which the effect vanishes exactly."""
        return {parameter.name: parameter.neutral for parameter in self.parameters}

    def complete(self, values: Mapping[str, float]) -> Mapping[str, float]:
        """The values with those added, neutral, that may be left out."""
        left_out = {one.name: one.neutral for one in self.parameters if one.channels and one.name not in values}
        return {**values, **left_out} if left_out else values

    def shaped(self, values: Mapping[str, float]) -> Mapping[str, float]:
        """The values complete, and those of the law's form, where they are left out, as the law has them."""
        form, complete = {one.name: one.neutral for one in self.form}, self.complete(values)
        return {**form, **complete} if form else complete

    def acts_across(self, values: Mapping[str, float]) -> bool:
        """Whether the effect moves something across the feed, or asks how that moves: not where its own `direction` is 0."""
        if values.get("direction") == 0.0:
            return False
        return any(hook.endswith("_y") or not set(_arguments(function)).isdisjoint(ACROSS_OFFERS)
                   for hook, function in self.hooks.items())

    def is_neutral(self, values: Mapping[str, float]) -> bool:
        """True where any parameter that switches the effect off stands at its neutral value."""
        deciding = [parameter for parameter in self.parameters if parameter.vanishes]
        return bool(deciding) and all(values[parameter.name] == parameter.neutral for parameter in deciding)


def hook_value(effect: Effect, hook: str, values: Mapping[str, float], **offers: float) -> float:
    """What a hook of the effect returns at these values of its parameters and of what its place offers."""
    known = {**offers, **values}
    return float(effect.hooks[hook](**{name: known[name] for name in arguments_of(effect, hook)}))


def arguments_of(effect: Effect, hook: str) -> tuple[str, ...]:
    """What a hook of the effect asks for; nothing where it has none."""
    return _arguments(effect.hooks[hook]) if hook in effect.hooks else ()


@lru_cache(maxsize=1024)
def _arguments(function: Callable) -> tuple[str, ...]:
    return tuple(inspect.signature(function).parameters)
