"""The cutter, its engagement with the work, and the linear law of the cutting force. Every value is SI."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

from testbed.structure import require

Direction = Literal["up-milling", "down-milling"]
DIRECTIONS: tuple[Direction, ...] = ("up-milling", "down-milling")
MOST_FLUTES = 100  # of any cutter
CLOSES_RAD = math.radians(0.1)  # pitch angles in whole tenths of a degree may miss the full circle by this


def radial_immersion_fraction(radial_depth_of_cut: float, diameter: float) -> float:
    """Fraction of the spindle period that one tooth spends in the cut: arccos(1 - 2 a/D) / (2 pi)."""
    require(0.0 < radial_depth_of_cut <= diameter, "radial depth of cut must be above 0 and at most the diameter")
    return math.acos(1.0 - 2.0 * radial_depth_of_cut / diameter) / (2.0 * math.pi)


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
        require(int(self.flutes) == self.flutes and self.flutes >= 1, "flutes must be a whole number of at least 1")
        require(math.isfinite(self.diameter) and self.diameter > 0, "diameter must be above 0")
        require(abs(self.helix_angle) < math.pi / 2, "helix_angle must lie within +-90 deg")
        if self.pitch_angles:
            angles, total = self.pitch_angles, math.fsum(self.pitch_angles)
            require(len(angles) == self.flutes, f"pitch gives {len(angles)} angles for {self.flutes} flutes")
            require(all(angle > 0 for angle in angles), "every pitch must be above 0")
            require(abs(total - 2.0 * math.pi) <= CLOSES_RAD,
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
        require(self.direction in DIRECTIONS, f"direction must be one of {', '.join(DIRECTIONS)}")
        require(0.0 < self.immersion <= 0.5, "immersion must be above 0 and at most 0.5 (0.5 is a slot)")
        for name in ("tangential_coefficient", "normal_coefficient"):
            require(math.isfinite(getattr(self, name)), f"{name} must be finite")

    @property
    def engagement_angle(self) -> float:
        """Angle a tooth turns through in the cut, rad."""
        return 2.0 * math.pi * self.immersion

    @property
    def entry_angle(self) -> float:
        """Angle theta at which a tooth enters the cut, rad; zero chip at theta = 0 and pi."""
        return 0.0 if self.direction == "up-milling" else math.pi - self.engagement_angle
