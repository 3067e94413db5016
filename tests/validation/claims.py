"""What every check hands to the table: a claim, its target, the number found, and whether it holds."""

from __future__ import annotations

import math
from dataclasses import dataclass

from testbed.cut import Cut
from testbed.machine import Cutter, Cutting, Model, Structure

MASS, GAMMA = 2.573, 2.16e8  # kg, N m^-2 kg^-1 (Mann and Young 2006)
PAPER = Model(Structure(MASS, 921.1 / (2 * math.pi), 0.0032), Cutter(),
              Cutting("up-milling", 0.162, GAMMA * MASS, 0.3 * GAMMA * MASS))
FLEXURE = Model(Structure(MASS, 920.0 / (2 * math.pi), 0.0032), Cutter(), Cutting())


@dataclass(frozen=True)
class Claim:
    """One line of the table. passed is None where it could not be checked; `note` then says why."""

    what: str
    target: str
    found: str
    passed: bool | None
    note: str = ""


@dataclass(frozen=True)
class Section:
    """A check's claims, tables (title, header, rows) that show more, and what is to be known of how the numbers came about."""

    title: str
    claims: tuple[Claim, ...]
    tables: tuple[tuple[str, tuple[str, ...], tuple[tuple[str, ...], ...]], ...] = ()
    remark: str = ""


def below(what: str, found: float, limit: float, unit: str = "", note: str = "") -> Claim:
    """A claim that a number is at most a limit."""
    return Claim(what, f"<= {limit:g}{unit}", f"{found:.2g}{unit}", bool(found <= limit), note)


def rpm(speed: float, depth_mm: float, **course: float) -> Cut:
    """A cut by spindle speed in rpm and depth in mm."""
    return Cut(speed * 2 * math.pi / 60, depth_mm * 1e-3, **course)
