"""Whether a machine that a fit found can be one: a good fit by values that no machine has says that something else is wrong.

A wrong feed, flute number or depth bends the coefficients first. A depth of cut, a mass or a unit that is wrong in all records
by one factor bends nothing else, so that only the coefficients can tell it.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

from testbed.analysis.estimate import Estimate
from testbed.analysis.fit.estimates import at_bound, estimates, speed_factors
from testbed.analysis.fit.fit_state import WaveformFit
from testbed.analysis.fit.waveform import Fitter
from testbed.effect import Effect
from testbed.machine import BASE_UNITS, Model, base_parameter
from testbed.units import format_quantity

USUAL = {"N/m^2": "N/mm^2"}
MOVED, FAR = 1.5, 4.0  # times the believed coefficients, from which that is told, and from which no belief is so far off
TOGETHER = 1.5  # of the two coefficients' factors, up to which they are one
BELOW = 0.8  # error over noise floor below which that floor was none
SAME_CLOCK, OFF_CLOCK = 0.01, 0.05  # relative differences: of speeds that are off alike, and by more than a belt slips
CHECK = "check the flutes, feed, depth of cut, sampling rate, mass and units written down"


def unlike_a_machine(model: Model, found: Mapping[str, Estimate] | None = None) -> list[str]:
    """In words, which values of a machine lie where none is; by `found`, those alone that the records determine to lie there.

    A value whose interval reaches back to where machines are says nothing against the fit.
    """
    said = []
    for path, (least, most) in model.limits.items():
        value, one = model.value(path), None if found is None else found.get(path)
        if least <= value <= most or found is not None and (one is None or one.low <= most and one.high >= least):
            continue
        unit = BASE_UNITS[base_parameter(path) or path]
        unit = USUAL.get(unit, unit)
        told, end = (format_quantity(number, unit, 3) for number in (value, least if value < least else most))
        said.append(f"{path} came out at {told}, where no machine has {'less' if value < least else 'more'} than {end}")
    return said


def moved_together(before: Model, after: Model) -> float:
    """The factor by which both cutting coefficients moved from what was believed, in the mean; 1 where it is little, or two.

    Two that moved the same way, both further than any belief is off, are one, too.
    """
    if before.cutting is None or after.cutting is None:
        return 1.0
    pairs = [(after.value(path), before.value(path)) for path in ("tangential_coefficient", "normal_coefficient")]
    if any(found <= 0.0 or believed <= 0.0 for found, believed in pairs):
        return 1.0
    first, second = (math.log(found / believed) for found, believed in pairs)
    moved = math.exp(0.5 * (first + second))
    both_far = first * second > 0.0 and min(abs(first), abs(second)) > math.log(FAR)
    alike = abs(first - second) < math.log(TOGETHER)
    return moved if (alike or both_far) and abs(math.log(moved)) > math.log(MOVED) else 1.0


def said_moved(factor: float) -> str:
    """In words, what else moves both coefficients by a factor."""
    return (f"both cutting coefficients came out {factor:.3g} times as believed: so they would if the depth of cut in all "
            f"records was {factor:.3g} times the stated one, the mass {1.0 / factor:.3g} times, or the coefficients' unit "
            "another; depth and coefficients enter as their product, so that no records tell which, at whatever depths")


def speeds_off(fitter: Fitter, fit: WaveformFit) -> float:
    """The factor by which the speeds of all cuts are other than stated; 1 where it is little, or differs from cut to cut."""
    factors = speed_factors(fitter, fit)
    if len(factors) < 2 or max(factors) / min(factors) > 1.0 + SAME_CLOCK:
        return 1.0
    return factors[0] if abs(math.log(factors[0])) > OFF_CLOCK else 1.0


def said_off(factor: float) -> str:
    """In words, what it means that all speeds are off by one factor."""
    return (f"every cut turns at {factor:.4g} times the stated speed: either the spindle speeds are written down wrongly, "
            f"or the sampling rate was {1.0 / factor:.4g} times the stated one, and all frequencies are {factor:.4g} times too "
            f"{'high' if factor > 1.0 else 'low'}")


def remarks_on(before: Model, after: Model, found: Mapping[str, Estimate] | None = None) -> list[str]:
    """What is to be said of a machine that was fitted, beginning at the one believed `before`, wherever it is told."""
    odd = [f"{one}: not identified; {CHECK}" for one in unlike_a_machine(after)]
    moved = moved_together(before, after)
    return [*odd, *([said_moved(moved)] if moved != 1.0 else [])]


def against_adequacy(fitter: Fitter, fit: WaveformFit, believed: Model, catalogue: Mapping[str, Effect],
                     ratio: float, doubt: float) -> list[str]:  # fmt: skip
    """In words, why a fit that leaves no more than noise says nothing for its model. ratio: its error over the noise floor.

    doubt: standard error of that floor over itself.
    """
    said = []
    if ratio < BELOW - 2.0 * doubt:
        said.append(f"the error is {ratio:.3g} of the noise floor: what was taken for noise is none, so that nothing can be "
                    "said of what is left")
    found = estimates(fitter, fit, catalogue)
    stuck = [path for path in at_bound(fitter.free, found) if base_parameter(path)]
    odd = unlike_a_machine(fit.state.model, found)
    said += [f"{', '.join(stuck)} ended where the range searched ends"] if stuck and not odd else []
    said += odd
    moved = moved_together(believed, fit.state.model)
    if not odd and abs(math.log(moved)) > math.log(FAR):
        said.append(said_moved(moved))
    if (factor := speeds_off(fitter, fit)) != 1.0:
        said.append(said_off(factor))
    return said


def said_against(reasons: Sequence[str]) -> str:
    """The reasons as a sentence, with what to do."""
    return f"{'; '.join(reasons)}: {CHECK}."
