"""A short formula for a missing force of a machine that moves along the feed, by regression on what the smoother finds."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from testbed.analysis.fit.fit_state import State
from testbed.analysis.fit.observed import Observed
from testbed.analysis.fit.prediction import Engine
from testbed.analysis.force.choice import Choice, Chooser, Subset, choose, coefficients, waveform
from testbed.analysis.force.explanation import EXPLAINED, Explanation
from testbed.analysis.force.latent_force import MissingForce, by_the_marks, missing_force
from testbed.analysis.force.regression import library, products
from testbed.analysis.force.terms import power_term
from testbed.analysis.search.candidate import ADEQUATE, Candidate
from testbed.analysis.search.diagnosis import Diagnosis, OtherForm
from testbed.analysis.search.law_form import references
from testbed.effect import Effect
from testbed.trial.proposal import ForceTerm

ANGLES = (-0.05, 0.0, 0.05)  # rad, changes of the tooth angle that every formula is tried at
RETURN_ANGLE = 3e-3  # rad, change of the tooth angle from which the regression is done again


def left_unexplained(
    engine: Engine,
    records: Sequence[Observed],
    found: Diagnosis,
    catalogue: Mapping[str, Effect],
    progress: Callable[[str], None] = lambda text: None,
) -> list[Explanation]:
    """What describes the force that a diagnosis left unexplained, as `explanations`; none where it left but noise.

    Where a known law with another exponent explains the records, that is the force looked for, from the machine of that fit.
    ValueError where the force cannot be estimated.
    """
    if found.form is not None and found.form.fitted is not None:
        return _of_form(engine, _fitted_to(records, found.form.fitted), found.form, catalogue, progress)
    chosen = found.best if found.verdict == "missing_effect" else found.base
    if not isinstance(chosen, Candidate) or chosen.error_held_out <= ADEQUATE * found.noise_floor:
        return []
    states = [chosen.fit.state]
    if found.verdict != "missing_effect" and isinstance(found.best, Candidate) and found.best.effects:
        # what partly helps has led the base parameters nearer to the truth: the force is looked for from there, too
        bare = found.best.fit.state
        for name in found.best.effects:
            bare = bare.without_effect(name)
        states.append(bare)
    kept = _fitted_to(records, chosen)
    told = [explanations_from(engine, kept, state, catalogue, progress) for state in states]
    return max(told, key=lambda some: some[0].share)


def explanations_from(engine: Engine, records: Sequence[Observed], state: State, catalogue: Mapping[str, Effect],
                      progress: Callable[[str], None] = lambda text: None) -> list[Explanation]:  # fmt: skip
    """What describes the force that a fitted state lacks, as `explanations`: at the state's own clocks, or at those that the
    records' marks show, where it has left them, whichever explains more. ValueError where the force cannot be estimated.
    """
    marked = by_the_marks(records, state)
    states = [state] if marked is None else [state, marked]
    told = [explanations(missing_force(engine, records, one, catalogue, progress), progress) for one in states]
    return max(told, key=lambda some: some[0].share)


def _fitted_to(records: Sequence[Observed], one: Candidate) -> list[Observed]:
    """Those of the records that a set of effects was fitted to: a chaotic one may have been left out."""
    names = {record.name for record in one.fitter.records}
    return [record for record in records if record.name in names]


def _of_form(engine: Engine, records: Sequence[Observed], form: OtherForm, catalogue: Mapping[str, Effect],
             progress: Callable[[str], None]) -> list[Explanation]:  # fmt: skip
    """What describes the force of a known law with another exponent: by regression, then as the power itself, and as that alone
    where it is too faint for a regression.

    All of a record shows a law to a fit; a regression sees but windows of it.
    """
    assert form.fitted is not None
    bare = form.fitted.fit.state.without_effect(form.effect)
    missing = missing_force(engine, records, bare, catalogue, progress)
    told = explanations(missing, progress)
    (variable,) = references(catalogue[form.effect])
    term = power_term(variable, form.low, form.high)
    seen = bool(told[0].formula) and told[0].share >= EXPLAINED
    if term is None or seen and any([each.term.name for each in one.formula] == [term.name] for one in told):
        return told
    chooser = Chooser(products(missing, [term], progress=progress))
    alone, power = chooser.subset(()), chooser.subset((0,))
    choice = Choice(power, ((alone,), (power,)), max(alone.held_out - min(power.held_out, chooser.rows), 1e-12))
    fitted = _explanation(missing, chooser, choice, power, certain=True)
    return [told[0], fitted, *told[1:]] if seen else [fitted]


def corrected(state: State, corrections: dict[str, float]) -> State:
    """The state with the model's own parameters changed as the regression found them."""
    structure, model = state.model.structure, state.model
    share = 1.0 / max(1.0 + corrections.get("drive", 0.0), 0.1)
    mass = structure.mass * share
    stiffness = max(structure.stiffness + corrections.get("stiffness", 0.0), 0.05 * structure.stiffness) * share
    damping = (structure.damping + corrections.get("damping", 0.0)) * share
    values = {"mass": mass, "natural_frequency": math.sqrt(stiffness / mass) / (2 * math.pi)}
    values["damping_ratio"] = min(max(damping / (2.0 * math.sqrt(stiffness * mass)), 1e-6), 0.9)
    for name in ("tangential_coefficient", "normal_coefficient"):
        if name in corrections and model.cutting is not None:
            values[name] = model.value(name) + corrections[name]
    if values.get("tangential_coefficient", 1.0) <= 0.0:
        values["tangential_coefficient"] = model.value("tangential_coefficient")
    return replace(state, model=model.with_values(values), angle=state.angle + corrections.get("mark_angle", 0.0))


def explain(missing: MissingForce, progress: Callable[[str], None] = lambda text: None) -> Explanation:
    """Rank what the missing force depends on and find a short formula for it. ValueError where records are too short."""
    return explanations(missing, progress)[0]


def explanations(missing: MissingForce, progress: Callable[[str], None] = lambda text: None) -> list[Explanation]:
    """As `explain`; behind the best formula the next best, which fits may prefer. ValueError as there."""
    turning = any(len(one.chip[np.isfinite(one.chip)]) for one in missing.records)
    chooser = Chooser(products(missing, angles=ANGLES if turning else (0.0,), progress=progress))
    progress("choosing a formula")
    choice = choose(chooser)
    if turning and choice.chosen.places:  # the tooth angle is better known now: choose once more there
        terms = [chooser.terms[place] for place in choice.chosen.places]
        _, _, turned = _settled(missing, terms, chooser, choice.chosen)
        chooser = Chooser(products(missing, angles=(turned,), progress=progress))
        choice = choose(chooser).against(choice.levels[0][0])
    if choice.share(choice.chosen) < EXPLAINED:
        choice = replace(choice, chosen=waveform(chooser, choice.chosen, choice.excess))
    return [_explanation(missing, chooser, choice, one) for one in (choice.chosen, *choice.rivals(chooser))]


def _explanation(missing: MissingForce, chooser: Chooser, choice: Choice, wanted: Subset,
                 certain: bool = False) -> Explanation:  # fmt: skip
    """What one subset of the terms says of the missing force. certain: a fit has shown that they are there."""
    terms = [chooser.terms[place] for place in wanted.places]
    alternatives = tuple((tuple(chooser.terms[place].law or "1" for place in one.places), choice.share(one))
                         for one in choice.alternatives())  # fmt: skip
    significant = certain or choice.excess > 4.0 * math.sqrt(2.0 * chooser.rows) and bool(wanted.places)
    chooser, chosen, turned = _settled(missing, terms, chooser, wanted)
    found, corrections = coefficients(chooser, chosen)
    if "mark_angle" in corrections:
        corrections["mark_angle"] += turned
    share = max(0.0, choice.share(chosen))
    drive = max(1.0 + corrections.get("drive", 0.0), 0.1)
    written = tuple(
        replace(one, value=one.value / drive, low=one.low / drive, high=one.high / drive)
        for one in found if one.term.expression
    ) if significant else ()  # fmt: skip
    only_named = tuple(one.term.meaning for one in found if not one.term.expression) if significant else ()
    return Explanation(written, share if significant else 0.0, alternatives, corrections, only_named,
                       corrected(missing.state, corrections), tuple(missing.observed), tuple(library(missing)),
                       missing)  # fmt: skip


def _settled(
    missing: MissingForce, terms: Sequence[ForceTerm], chooser: Chooser, chosen: Subset
) -> tuple[Chooser, Subset, float]:
    """The chosen terms alone, at the tooth angle that goes with them: it does not enter linearly."""
    turned = chooser.found[chosen.at].angle
    for _ in range(3):
        _, corrections = coefficients(chooser, chosen)
        step = corrections.get("mark_angle", 0.0)
        if abs(step) < RETURN_ANGLE and len(chooser.terms) == len(terms):
            break
        turned += float(np.clip(step, -0.1, 0.1))
        chooser = Chooser(products(missing, terms, (turned,)))
        chosen = chooser.subset(range(len(terms)))
    return chooser, chosen, turned
