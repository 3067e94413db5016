"""Formulas that a regression prefers, told apart by fits of the whole model to the records.

A regression takes the motion as measured and everything else as linear: neighbouring powers of a displacement then look
alike, and what the base model made up for tells against the true law. In a fit the wrong one shifts the vibration's phase,
which runs apart over a record.
"""

from __future__ import annotations

import math
import tempfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

from testbed.analysis.fit.effect_start import all_free, effect_parameters
from testbed.analysis.fit.estimates import estimates
from testbed.analysis.fit.fit_state import State, WaveformFit
from testbed.analysis.fit.model_fit import model_fit
from testbed.analysis.fit.observed import Observed
from testbed.analysis.fit.prediction import Engine
from testbed.analysis.fit.solve import alternate_fit_and_passes
from testbed.analysis.fit.waveform import Fitter
from testbed.analysis.force.explain_force import explanations_from, left_unexplained
from testbed.analysis.force.explanation import Explanation, formula_text
from testbed.analysis.force.planar_formula import explanations_about, left_in_the_plane, share_of
from testbed.analysis.force.trial_law import NAME, trial_law
from testbed.analysis.search.diagnosis import Diagnosis
from testbed.analysis.search.outlier_records import SOUND, agreed, misfit
from testbed.analysis.search.refit_from_prior import with_examples
from testbed.effect import Effect
from testbed.machine import Model

MOST_TRIALS = 7


@dataclass(frozen=True)
class _Trial:
    """An explanation with what its formula leaves when it is fitted (see `misfit`), and the fitted state without it.

    fitted: the fit with the formula.
    """

    explanation: Explanation
    misfit: float
    left: float
    bare: State
    fitted: tuple[Fitter, WaveformFit] | None = None


@dataclass(frozen=True)
class Jury:
    """What every formula is tried with: the engine with a catalogue, the believed model and its effects.

    On the records that the force was estimated from.
    """

    engine_of: Callable[[Mapping[str, Effect]], Engine]
    model: Model
    catalogue: Mapping[str, Effect]
    progress: Callable[[str], None] = lambda text: None

    def left_unexplained(self, records: Sequence[Observed], found: Diagnosis) -> list[Explanation]:
        """What describes the force that a diagnosis left unexplained; see `left_unexplained` and `left_in_the_plane`."""
        if self.model.planar:
            return left_in_the_plane(self.engine_of, found, self.catalogue, self.progress)
        return left_unexplained(self.engine_of(self.catalogue), records, found, self.catalogue, self.progress)

    def likeliest(self, told: Sequence[Explanation]) -> Explanation:
        """The explanation whose formula, fitted to the records, leaves least. ValueError where nothing was told.

        They are tried in turn until one leaves but noise. A fit leads the model's own parameters nearer to the truth: from
        there the force is looked for again, and what is then found comes first.
        """
        if not told:
            raise ValueError("no explanation to choose from")
        if not told[0].formula:
            return told[0]
        waiting = [one for one in told if one.formula]
        known = set(map(_terms, waiting))
        best, seen_from = self._trial(waiting.pop(0)), None
        for _ in range(MOST_TRIALS - 1):
            if best.left <= SOUND:
                break
            if best is not seen_from:
                seen_from = best
                new = [one for one in self._from(best) if one.formula and _terms(one) not in known]
                known |= set(map(_terms, new))
                waiting = [*new, *waiting]
            if not waiting:
                break
            best = min(best, self._trial(waiting.pop(0)), key=lambda one: one.misfit)
        if self.model.planar and best.left > SOUND:
            best = min(best, self._trial(best.explanation, far=True), key=lambda one: one.misfit)
        return self._as_fitted(self._shortened(best))

    def _as_fitted(self, best: _Trial) -> Explanation:
        """The explanation with the values, intervals and share of its fit, in x and y: slopes hold about one motion alone."""
        tried = replace(best.explanation, left=math.sqrt(best.left))
        if not self.model.planar or best.fitted is None:
            return tried
        with tempfile.TemporaryDirectory() as folder:
            told = estimates(*best.fitted, {**self.catalogue, NAME: trial_law(best.explanation, folder)})
        found = [(one, told[f"{NAME}.{one.term.name}"]) for one in best.explanation.formula]
        formula = tuple(replace(one, value=now.value, low=now.low, high=now.high) for one, now in found)
        share = share_of(self.engine_of, *best.fitted, formula, self.catalogue)
        return replace(tried, formula=formula, state=best.bare, share=share)

    def _shortened(self, best: _Trial) -> _Trial:
        """The trial of a shorter formula that leaves but noise, too, if there is one.

        A term may only have made up for what the base model's parameters had made up for; from the right ones it is not seen.
        """
        terms = len(best.explanation.formula)
        if terms > 1 and best.left <= SOUND:
            shorter = next((one for one in self._from(best) if 0 < len(one.formula) < terms), None)
            trial = self._trial(shorter) if shorter is not None else best
            return trial if trial.left <= SOUND else best
        return best

    def _from(self, trial: _Trial) -> list[Explanation]:
        """What explains the force that the model lacks where a trial has led it, without the formula."""
        records = trial.explanation.observed
        if self.model.planar and trial.fitted is not None:
            return explanations_about(self.engine_of, *trial.fitted, self.catalogue, self.progress)
        return explanations_from(self.engine_of(self.catalogue), records, trial.bare, self.catalogue, self.progress)

    def _trial(self, explanation: Explanation, far: bool | None = None) -> _Trial:
        """far: whether it begins at the believed machine, too, where the regression's own state leads astray; where None, along
        the feed alone, where that costs little."""
        far = not self.model.planar if far is None else far
        self.progress(f"fitting {formula_text(explanation.formula)}")
        records = explanation.observed
        with tempfile.TemporaryDirectory() as folder:
            wider = {**self.catalogue, NAME: trial_law(explanation, folder)}
            engine, model = self.engine_of(wider), self.model
            for name, values in explanation.state.model.effects.items():  # those that the diagnosis has named
                model = model.with_effect(name, **values)
            model = with_examples(model, [NAME], wider)
            own = [*explanation.unknowns, *effect_parameters(wider[NAME], records)]
            fitter = Fitter(engine, records, own if explanation.unknowns else all_free(records, model, wider))
            fitter, fit = agreed(fitter, alternate_fit_and_passes(fitter, explanation.start(NAME)))
            found = _Trial(explanation, *misfit(fitter, fit), fit.state.without_effect(NAME), (fitter, fit))
            if found.left <= SOUND or not far:
                return found
            fitter, fit = agreed(*model_fit(engine, records, model, wider))
        other = _Trial(explanation, *misfit(fitter, fit), fit.state.without_effect(NAME), (fitter, fit))
        return min(found, other, key=lambda one: one.misfit)


def _terms(explanation: Explanation) -> frozenset[str]:
    return frozenset(one.term.name for one in explanation.formula)
