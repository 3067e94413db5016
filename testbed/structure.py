"""The modes of a machine: how tool and workpiece move against each other. Every value is SI."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Literal

Carrier = Literal["workpiece", "tool"]
CARRIERS: tuple[Carrier, ...] = ("workpiece", "tool")
SAME_DIRECTION_RAD = 1e-9  # rounding alone, between two ways to write one direction


def require(condition: bool, message: str) -> None:
    """Raises ValueError with the message where the condition does not hold."""
    if not condition:
        raise ValueError(message)


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
        require(math.isfinite(self.mass) and self.mass > 0, "mass must be above 0")
        require(math.isfinite(self.natural_frequency) and self.natural_frequency > 0,
                 "natural_frequency must be above 0")
        require(0.0 <= self.damping_ratio < 1.0, "damping_ratio must be at least 0 and below 1")
        require(math.isfinite(self.direction), "direction must be finite")
        require(self.on in CARRIERS, f"on must be one of {', '.join(CARRIERS)}")

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

    @cached_property
    def planar(self) -> bool:
        """True for anything but one mode of the workpiece along the feed, the machine of the paper."""
        return bool(self.further) or self.shape != (1.0, 0.0) or self.on != "workpiece"

    @classmethod
    def of(cls, modes: Sequence[Mode]) -> Structure:
        """The structure that has these modes. ValueError where there is none, or one stands twice."""
        require(len(modes) > 0, "a structure has at least one mode")
        require(repeated_mode(modes) is None, "a mode stands twice")
        first = modes[0]
        return cls(first.mass, first.natural_frequency, first.damping_ratio, first.direction, first.on, tuple(modes[1:]))
