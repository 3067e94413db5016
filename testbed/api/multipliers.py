"""The largest characteristic multipliers of a cut, and what they mean."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from testbed.api.believed import (
    EffectsLike,
    ModelLike,
    cutting_model,
    effects_of,
    guesses_note,
    in_the_work,
)
from testbed.api.defaults import FEED
from testbed.api.quantity import DEPTH, SPEED, Quantity, positive
from testbed.api.result import Result, Table, shown_here
from testbed.api.working import working
from testbed.problem import InputProblem

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from numpy.typing import NDArray

    from testbed.analysis.linear.stability import StabilityClass

MOST_SWINGS = 1000.0  # periods of the structure within a tooth pass up to which a loop with effects is linearised
TOLERANCE = 1e-6  # of the largest multiplier before its last correction
BLANK = 1e-4  # of the largest multiplier over max(1, modulus): nothing is said where it changes by more
MOST_OUT = 0.05  # of their cut that teeth may be out of the work under contact_loss: unequal ones are where the chip runs out
MEANING = {"stable": "stable", "neimark_sacker": "Neimark-Sacker (chatter at a frequency of its own)",
           "flip": "flip (period doubling)", "saddle_node": "saddle-node"}


@dataclass(frozen=True, repr=False, eq=False)
class Multipliers(Result):
    """Characteristic multipliers of one cut, largest modulus first.

    multipliers: complex, shape (count,); error: an estimate of each one's error, shape (count,). stability: `stable`,
    `neimark_sacker`, `flip` or `saddle_node` (`class` in the JSON). period_passes: over so many tooth passing periods.
    spindle_speed: rad/s. axial_depth_of_cut: m.
    """

    multipliers: NDArray[Any]
    stability: StabilityClass
    period_passes: int
    error: NDArray[Any]
    spindle_speed: float
    axial_depth_of_cut: float
    notes: tuple[str, ...]

    @property
    def spectral_radius(self) -> float:
        """Modulus of the largest: below 1 the cut is stable."""
        return float(abs(self.multipliers[0]))

    def plot(self) -> Figure:
        """The multipliers in the complex plane, with the unit circle."""
        from testbed.analysis.linear.chart_plot import plot_multipliers

        return shown_here(plot_multipliers({"this cut": (self.multipliers[:0], self.multipliers)}))  # type: ignore[no-any-return]

    def _answer(self) -> Mapping[str, Any]:
        return {"multipliers": self.multipliers, "class": self.stability, "period_passes": self.period_passes,
                "error": self.error, "spindle_speed": self.spindle_speed, "axial_depth_of_cut": self.axial_depth_of_cut,
                "notes": self.notes}

    def _table(self) -> Table:
        return Table("", {"multiplier": self.multipliers.tolist(), "modulus": abs(self.multipliers).tolist(),
                          "error": self.error.tolist()}, {})

    def _headline(self) -> str:
        return f"{MEANING[self.stability]}, largest modulus {self.spectral_radius:.6g}"


def multipliers(model: ModelLike, speed: Quantity, depth: Quantity, *, feed: Quantity = FEED, count: int = 6,
                effects: EffectsLike = ()) -> Multipliers:
    """Largest characteristic multipliers of a machine at one cut, over a tooth passing period, or over a revolution where
    the teeth have different pitches. With effects, the whole loop is linearised about its periodic motion.

    model: a model.yaml or a Model. speed: `"3810 rpm"`, or rad/s. depth: `"2.9 mm"`, or m. feed: matters only with effects
    that are not linear; `"0.1 mm/tooth"`, or m. count: how many to give. effects: folders of one's own effects.
    Raises InputProblem where the model has no cutter, or the cut has no multipliers.
    """
    from testbed.cut import Cut

    with working():
        own = effects_of(effects)
        at, deep, advance = SPEED.one(speed, "speed"), DEPTH.one(depth, "depth"), positive(feed, "m/tooth", "feed")
        believed, name = cutting_model(model, own.known)
        machine, left_out = in_the_work(believed)
        place = name if machine.effects else f"speed {at / SPEED.factor:.5g} rpm, depth {deep / DEPTH.factor:.6g} mm"
        found = of_cut(machine, Cut(at, deep, advance), own.known, place)
        return Multipliers(found["multipliers"][:count], found["class"], found["period_passes"], found["error"][:count], at,
                           deep, (*guesses_note(machine), *left_out))


def of_cut(model: Any, cut: Any, catalogue: Any, name: str) -> dict[str, Any]:
    """Multipliers of a model, effects and all, their errors, class and the period in passes. InputProblem if there are none.

    name: what is to be blamed then.
    """
    import numpy as np

    from testbed.analysis.linear.planar_multipliers import cut_multipliers
    from testbed.analysis.linear.stability import classify

    try:
        if model.effects:
            fastest = max(mode.natural_frequency for mode in model.structure.modes)
            swings = fastest * cut.tooth_passing_period(model.cutter.flutes)
            if swings > MOST_SWINGS:  # their map would not fit into memory
                raise ArithmeticError(f"the structure swings {swings:.3g} times within a tooth pass")
            values, errors, passes = _of_loop(model, cut, catalogue)
        else:
            with np.errstate(over="ignore", invalid="ignore"):  # at absurd speeds and depths, which are refused below
                values, errors, passes = cut_multipliers(model, cut, TOLERANCE)
    except (ValueError, ArithmeticError) as problem:
        why = "its numbers grow beyond what a computer holds" if isinstance(problem, np.linalg.LinAlgError) else problem
        raise InputProblem(name, f"no multipliers of this cut can be had ({why})",
                           "leave out the effect, or choose another cut" if model.effects else "choose another cut") from None
    return {"multipliers": values, "class": classify(values), "period_passes": passes, "error": errors}


def _of_loop(model: Any, cut: Any, catalogue: Any) -> tuple[Any, Any, int]:
    """Multipliers of a loop with effects, how much each changes on pieces twice as long, and their period in passes."""
    import numpy as np

    from testbed.analysis.linear.linearise import linearise
    from testbed.engines.regenerative_loop import regenerative_loop

    stays = model.without_effect("contact_loss") if "contact_loss" in model.effects else model
    loop: Any = regenerative_loop(stays, cut, catalogue)
    motion = linearise(loop)
    if stays is not model and motion.out_of_work > MOST_OUT:
        raise ArithmeticError(f"teeth are out of the work for {motion.out_of_work:.0%} of their cut")
    other = linearise(loop, passes=motion.passes, coarser=2.0).multipliers
    errors = np.abs(motion.multipliers[:, None] - other[None, :]).min(axis=1)
    errors[0] = max(errors[0], abs(abs(motion.multipliers[0]) - abs(other[0])))
    if not errors[0] <= BLANK * max(1.0, abs(motion.multipliers[0])):
        raise ArithmeticError(f"the largest changes by {errors[0]:.1g} on finer pieces")
    return motion.multipliers, errors, motion.passes
