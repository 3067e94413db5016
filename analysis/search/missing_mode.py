"""A mode of vibration that a machine in x and y has and its model lacks: its frequency, direction and mass, and who carries it.

`second_mode` of the catalogue is such a mode seen by sensors of the workpiece alone. A mode of the tool, or one beside a
measured force, is none: here the structure itself gets one mode more, at a line of what the base fit leaves.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from testbed.analysis.fit.evidence import DELTA_BIC, bic, effective_size
from testbed.analysis.fit.fit_state import State, WaveformFit
from testbed.analysis.fit.free_parameters import at_a_bound, how_a_mode_rings, mass_of_a_mode
from testbed.analysis.fit.held_out import pooled
from testbed.analysis.fit.observed import Observed
from testbed.analysis.fit.solve import alternate_fit_and_passes
from testbed.analysis.fit.waveform import Fitter
from testbed.analysis.records.lines import standing_out
from testbed.analysis.search.candidate import ADEQUATE, Candidate
from testbed.analysis.search.candidate_round import by_noise, candidate_of
from testbed.analysis.search.diagnosis import Diagnosis, verdict_of
from testbed.analysis.search.gates import against
from testbed.machine import CARRIERS, Mode, Model, Structure

NAMES = ("second_mode", "third_mode")  # of effects that are a mode more
PEAKS = 3  # lines of what is left, at which a mode is looked for
CLEAR = 5.5  # times its surroundings that a line must stand
FEWEST = 64  # samples of a part that rings
SAME = 0.02  # relative distance from a mode's own frequency, at which a line is that mode's
STIFFER = (1.0, 6.0)  # times the softest mode's stiffness, as that of the new mode begins
DAMPING = 0.015  # damping ratio that it begins with
SCREENED = 3  # records by which starts are compared
STEPS = 20  # of a first fit of the likeliest,
RINGS = 0.1  # damping ratio up to which a mode shows as a line: beyond, what was fitted is but a compliance
NEAR_BEST = 1.5  # times whose cost the other may leave there to be fitted to the end


@dataclass(frozen=True)
class FoundMode:
    """A mode beside those of the model, and the fit with it."""

    mode: Mode
    fitted: Candidate

    @property
    def line(self) -> str:
        """As a model file has it."""
        one = self.mode
        return (f"{{natural_frequency: {one.natural_frequency:.5g} Hz, damping_ratio: {one.damping_ratio:.3g}, "
                f"mass: {one.mass:.4g} kg, direction: {math.degrees(one.direction):.3g} deg, on: {one.on}}}")

    @property
    def sentence(self) -> str:
        """In words."""
        return (f"The structure lacks a mode: with one of {self.mode.natural_frequency:.4g} Hz that moves along "
                f"{math.degrees(self.mode.direction):.3g} deg (from x towards y), carried by the {self.mode.on}, the model "
                f"explains the records down to their noise. Add to `modes` of the structure: {self.line}.")


def missing_mode(base: Candidate, model: Model, progress: Callable[[str], None]) -> FoundMode | None:
    """The mode with which the believed `model`, fitted as `base`, leaves but noise; None where none does, or all is along x.

    A mode that hardly rings is none: it follows the force at once, and would stand for any law of the cut.
    """
    if not base.fit.state.model.structure.planar or base.error_where_known <= ADEQUATE * pooled(base.errors)[1]:
        return None
    whole = by_noise(base)
    peaks = _lines(whole.fitter.records, whole.fit)
    if not peaks:
        return None
    progress("looking for a mode that the structure lacks")
    found = None
    for fitter, state in _begun(whole.fitter, whole.fit, peaks):
        fit = alternate_fit_and_passes(fitter, state, rounds=2)
        if found is None or fit.cost < found[1].cost:
            found = fitter, fit
    if found is None:
        return None
    one = candidate_of(*found, (), None, 1.0)
    if one.error_where_known > ADEQUATE * pooled(one.errors)[1]:
        return None
    mode = _unbelieved(one.fit.state.model, model)
    if mode.damping_ratio > RINGS or at_a_bound(one.fitter.free, one.fit.state.model):
        return None
    return FoundMode(replace(mode, direction=mode.direction % math.pi), one)


def with_mode(found: Diagnosis, base: Candidate, added: FoundMode, beside: Sequence[str]) -> Diagnosis:
    """The verdict that a mode is missing. beside: effects of modes that the model has."""
    noise = pooled(base.errors)[1]
    name = next(one for one in NAMES if one not in beside)
    one = against(replace(added.fitted, effects=(name,), parameters=_as_effect(name, base, added.mode)), by_noise(base))
    told = verdict_of(base, one, [base, one], (one, *found.candidates), noise, ())
    return replace(told, verdict="missing_effect", effects=(name,), sentence=added.sentence, mode=added.line)


def explains_more(added: FoundMode, found: Diagnosis) -> bool:
    """Whether the mode explains the records better than the effects that a search named, if it named any."""
    if not isinstance(found.best, Candidate) or found.verdict == "adequate":
        return False
    best, fit = by_noise(found.best).fit, added.fitted.fit
    size = effective_size(best)
    return found.verdict != "missing_effect" or bic(fit, size) < bic(best, size) - DELTA_BIC


def _as_effect(name: str, base: Candidate, mode: Mode) -> dict[str, float]:
    """A mode in the parameters of the effect that stands for it."""
    own = {"mass_ratio": base.fit.state.model.structure.mass / mode.mass, "frequency": mode.natural_frequency,
           "damping_ratio": mode.damping_ratio, "direction": mode.direction,
           "participation": 1.0 if mode.on == "workpiece" else 0.0}
    return {f"{name}.{path}": value for path, value in own.items()}


def _lines(records: Sequence[Observed], fit: WaveformFit) -> list[float]:
    """Frequencies (Hz) of what is left where the structure rings freely, but for those of modes that the model has.

    No law of the cut is at work there. Where no record shows it ringing, of all that is left.
    """
    rows = [(record, record.on_samples(rest)) for record, rest in zip(records, fit.residuals, strict=True)]
    ringing = [(part, record.rate) for record, values in rows for part in _where_it_rings(record, values)]
    known = [mode.natural_frequency for mode in fit.state.model.structure.modes]
    found = [(amplitude, frequency) for part, rate in ringing or [(values, record.rate) for record, values in rows]
             for row in part for frequency, amplitude, height in standing_out(row, rate, PEAKS + len(known)) if height > CLEAR]
    kept: list[float] = []
    for _, frequency in sorted(found, reverse=True):
        if all(abs(frequency / one - 1.0) > SAME for one in (*known, *kept)):
            kept.append(frequency)
    return kept[:PEAKS]


def _where_it_rings(record: Observed, values: np.ndarray) -> list[np.ndarray]:
    """Those parts of what is left (channels, samples) in which nothing cuts, from the channels of motion."""
    found = []
    for segment in record.segments:
        begun = segment.start - record.start + (record.period if record.cut is not None else 0.0)  # where no tooth still cuts
        first, last = max(0, round(begun * record.rate)), round((segment.stop - record.start) * record.rate)
        part = values[[sensor is not None for sensor in record.sensors], first:last]
        if segment.kind == "ring-down" and part.size and part.shape[1] >= FEWEST:
            found.append(part)
    return found


def _begun(base: Fitter, fit: WaveformFit, peaks: Sequence[float]) -> list[tuple[Fitter, State]]:
    """The likeliest beginnings of a further mode, one for either part that may carry it, followed for some steps."""
    worst, model = fit.worst(SCREENED), fit.state.model
    softest = min(mode.stiffness for mode in model.structure.modes)
    found = []
    for on in CARRIERS:
        trials: list[tuple[float, Fitter, State]] = []
        for peak, turn, stiffer in itertools.product(peaks, range(4), STIFFER):
            mode = Mode(stiffer * softest / (2.0 * math.pi * peak) ** 2, peak, DAMPING, 0.25 * math.pi * (turn + 0.5), on)
            state = replace(fit.state, model=replace(model, structure=Structure.of([*model.structure.modes, mode])))
            fitter = _wider(base, state.model)
            trials.append((fitter.cost(state, worst), fitter, state))
        _, fitter, state = min(trials, key=lambda one: one[0])
        found.append((fitter, fitter.descend(state, iterations=STEPS)))
    found.sort(key=lambda one: one[1].cost)
    return [(fitter, end.state) for fitter, end in found if end.cost <= NEAR_BEST * found[0][1].cost]


def _wider(base: Fitter, model: Model) -> Fitter:
    """The fit of a model with a mode more: its parameters unknown, and how every record begins in it."""
    last = len(model.structure.modes) - 1
    records = [replace(record, modes=last + 1) for record in base.records]
    own = [*how_a_mode_rings(records, model, last), mass_of_a_mode(records, model, last)]
    return Fitter(base.engine, records, [*base.unknowns, *own])


def _unbelieved(model: Model, believed: Model) -> Mode:
    """Of a model's modes the one that is farthest from every believed one: a fit may have named them in another order."""
    known = [mode.natural_frequency for mode in believed.structure.modes]
    return max(model.structure.modes, key=lambda mode: min(abs(math.log(mode.natural_frequency / one)) for one in known))
