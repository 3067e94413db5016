"""Whether force and responses have the scales that are stated: told only where a tap measures one thing in two ways.

A factor s on a sensor and f on a hammer multiply what they take part in. So a tap made twice shows their ratio, and reciprocity
(what moves along y for a force along x moves along x for a force along y, Maxwell 1864) that of x and y:

    H_xy / H_yx = H_xy^2 / (H_xx H_yy) = s_y f_x / (s_x f_y)        (the second of each mode's residues)

A factor common to all is told by neither: it multiplies every modal mass, and no frequency or damping ratio.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from testbed.analysis.estimate import Estimate
from testbed.analysis.information import Z_95, autocorrelation, independent
from testbed.analysis.tap.frequency_response import FEWEST_LINES, FrequencyResponse, axis_of
from testbed.analysis.tap.poles import poles
from testbed.analysis.tap.real_modes import Lines, levels, residues

_CALIBRATED = 1.25  # a ratio of calibrations of 5 % each, and of points and directions that are not quite the same
_CONSTANT = 0.5  # of the logarithm of a ratio, that half of the lines may be away from it: else it is no factor
_MEDIAN = 1.2533  # standard deviation of a median over that of a mean
_DEVIATION = 1.4826  # standard deviation over median deviation
_STRONG = 0.01  # of a response's strongest residue, from which a mode's residue is more than noise and tells a ratio
_USUAL = ((9.80665, "g where m/s^2 are stated, or the other way round"), (4.4482216, "pounds where newtons are stated, or the "
          "other way round"), (1e3, "a thousandth"), (25.4, "inches where millimetres are stated, or the other way round"))
_NEAR = 0.05  # of a usual factor, within which it is named
_HAMMERS = (0.5, 30e3)  # N: peaks from the smallest instrumented hammers' to the largest sledges'


@dataclass(frozen=True)
class ScaleCheck:
    """How many times as much as `against` does `of` read, where both must read the same. by: why they must.

    agrees: None where the ratio is no one factor.
    """

    of: str
    against: str
    by: str
    ratio: Estimate

    @property
    def agrees(self) -> bool | None:
        """Whether no more than calibrations stands between the two; None where that is not told."""
        return 1.0 / _CALIBRATED <= self.ratio.value <= _CALIBRATED if self.ratio.bounded else None

    def as_json(self) -> dict[str, Any]:
        """For `--json`."""
        return {"of": self.of, "against": self.against, "by": self.by, "ratio": self.ratio.as_json(), "agrees": self.agrees}

    def said(self) -> str:
        """In words, what it means."""
        if self.agrees is None:
            return (f"the scales of {self.of} and {self.against} cannot be checked by {self.by}: what they read differs by "
                    "no one factor. Force and sensor are not at one point, or turned against the axes")
        size = f"{self.of} reads {self.ratio.value:.4g} times as much as {self.against}, by {self.by}"
        if self.agrees:
            return size
        factor = max(self.ratio.value, 1.0 / self.ratio.value)
        usual = next((f" ({said}?)" for one, said in _USUAL if abs(factor / one - 1.0) < _NEAR), "")
        return (size + f": a unit or a `scale` is wrong{usual}, of which of them the data do not tell. Modal masses and "
                "directions are guesses until it is mended")


def checked(responses: Sequence[FrequencyResponse], band: tuple[float, float],
            done: list[ScaleCheck]) -> list[FrequencyResponse]:
    """The responses, brought to the scales of the first of each pair where two disagree; each check is added to `done`."""
    found = list(responses)
    first: dict[tuple, int] = {}
    for place, one in enumerate(found):
        kind = (one.on, axis_of(one.along), axis_of(one.sensed))
        if kind in first:
            found[place] = one.scaled(repeated(one, found[first[kind]], band, done))
        first.setdefault(kind, place)
    for on in dict.fromkeys(one.on for one in found):
        four = {(along, sensed): found[place] for (carrier, along, sensed), place in first.items() if carrier == on}
        check = _by_reciprocity(four, on, band)
        if check is not None:
            done.append(check)
            if check.agrees is False:
                found = [one.scaled(1.0 / check.ratio.value) if one.on == on and axis_of(one.sensed) == (0.0, 1.0) else one
                         for one in found]
    return found


def repeated(one: FrequencyResponse, other: FrequencyResponse, band: tuple[float, float], done: list[ScaleCheck]) -> float:
    """The factor that brings `one`, a tap repeated, to the scale of `other`: 1 where the two agree or tell none."""
    ratio = ratio_of_lines(one, other, band)
    if ratio is None:
        return 1.0
    name = one.name if one.name != other.name else f"{one.name}, its second tap,"
    done.append(ScaleCheck(name, other.name, "the tap repeated", ratio))
    return 1.0 / ratio.value if done[-1].agrees is False else 1.0


def ratio_of_lines(one: FrequencyResponse, other: FrequencyResponse, band: tuple[float, float]) -> Estimate | None:
    """The median ratio of two responses over the lines at which both are believed; None where these are too few."""
    mask, others = one.believed(*band), other.believed(*band)
    mask &= np.interp(one.frequency, other.frequency, others.astype(float), 0.0, 0.0) == 1.0
    if np.count_nonzero(mask) < FEWEST_LINES:
        return None
    at = one.frequency[mask]
    ratios = np.log(np.abs(one.receptance[mask])) - np.interp(at, other.frequency[others],
                                                              np.log(np.abs(other.receptance[others])))
    return _factor(ratios, independent(autocorrelation(ratios)))


def _factor(ratios: np.ndarray, count: float) -> Estimate:
    """The factor of logarithmic ratios of which `count` are independent; not bounded where half of them are far from it."""
    middle = float(np.median(ratios))
    away = float(np.median(np.abs(ratios - middle)))
    wide = Z_95 * _MEDIAN * _DEVIATION * away / np.sqrt(max(count, 1.0))
    told = away <= max(_CONSTANT * abs(middle), np.log(_CALIBRATED))
    value, low, high = (float(np.exp(one)) for one in (middle, middle - wide, middle + wide))
    return Estimate(value, low, high, "1", bounded=bool(told))


def _by_reciprocity(four: dict[tuple, FrequencyResponse], on: str, band: tuple[float, float]) -> ScaleCheck | None:
    """What the sensor along y reads over the force along y, against the same of x; None without the responses it needs.

    four: by the axes of force and sensor.
    """
    x, y = (1.0, 0.0), (0.0, 1.0)
    xx, xy, yx, yy = (four.get(axes) for axes in ((x, x), (x, y), (y, x), (y, y)))
    ratio = None
    if xy is not None and yx is not None:
        ratio = ratio_of_lines(xy, yx, band)
    elif xx is not None and yy is not None and (xy is not None or yx is not None):
        cross = xy if xy is not None else yx
        ratio = _ratio_of_residues([xx, yy, cross], band, 1.0 if xy is not None else -1.0)  # type: ignore[list-item]
    if ratio is None:
        return None
    return ScaleCheck(f"y of the {on}", f"x of the {on}", "reciprocity", ratio)


def _ratio_of_residues(three: Sequence[FrequencyResponse], band: tuple[float, float], sign: float) -> Estimate | None:
    """The ratio by each mode's residues in two drive points and one cross response between them.

    sign: of the ratio's logarithm in that of the residues.
    """
    masks = [one.believed(*band) for one in three]
    if min(np.count_nonzero(mask) for mask in masks) < FEWEST_LINES:
        return None
    stable = poles(three, masks).stable
    lines = Lines(three, masks, np.eye(2), levels(three, masks))
    found, _ = residues(lines, 2.0 * np.pi * stable[:, 0], stable[:, 1])
    strong = np.all(np.abs(found) > _STRONG * np.abs(found).max(axis=1, keepdims=True), axis=0) & (found[0] * found[1] > 0.0)
    if np.count_nonzero(strong) < 2:
        return None
    ratios = sign * np.log(found[2, strong] ** 2 / (found[0, strong] * found[1, strong]))
    return _factor(ratios, float(len(ratios)))


def said_of_scales(done: Sequence[ScaleCheck], forces: Sequence[float]) -> list[str]:
    """In words, what the checks tell of the scales, and what none can. forces: of the blows (N)."""
    said = [check.said() for check in done if not check.agrees]
    alike = "; ".join(check.said() for check in done if check.agrees)
    said += [f"scales agree: {alike}"] if alike else []
    peak = float(np.median(np.abs(forces))) if len(forces) else 0.0
    if len(forces) and not _HAMMERS[0] <= peak <= _HAMMERS[1]:
        said.append(f"the blows have {peak:.3g} N: no instrumented hammer gives that. Check the unit and `scale` of the force")
    more = "a factor common to all" if done else "a wrong one"
    said.append(f"the scale of force and response is as stated: {more} would not show in this tap, and would be in every modal "
            "mass. A block of known mass, hung up and struck, tells it")
    return said
