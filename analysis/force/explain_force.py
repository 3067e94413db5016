"""What a missing force depends on, and a short formula for it, in words and as an effect file."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from testbed.analysis.fit.fit_state import State
from testbed.analysis.fit.held_out import holds_out
from testbed.analysis.fit.observed import Observed
from testbed.analysis.fit.prediction import Engine
from testbed.analysis.force.choice import Choice, Chooser, Subset, choose, coefficients, waveform
from testbed.analysis.force.cut_variables import course_of
from testbed.analysis.force.latent_force import MissingForce, by_the_marks, missing_force, with_force
from testbed.analysis.force.ranking import Ranked, rank
from testbed.analysis.force.regression import products, windows_of
from testbed.analysis.force.terms import power_term
from testbed.analysis.search.candidate import ADEQUATE, Candidate
from testbed.analysis.search.diagnosis import Diagnosis, OtherForm
from testbed.analysis.search.law_form import references
from testbed.effect import Effect
from testbed.trial.proposal import Coefficient, ForceTerm, write_proposal

ANGLES = (-0.05, 0.0, 0.05)  # rad, changes of the tooth angle that every formula is tried at
EXPLAINED = 0.5  # share of the excess from which a formula is called a description of the force
CLEAR = 0.25  # share of the force's variance from which a variable is said to rule it
RETURN_ANGLE = 3e-3  # rad, change of the tooth angle from which the regression is done again


@dataclass(frozen=True)
class Explanation:
    """What was found of a missing force.

    formula: terms with coefficients and 95 % intervals, empty where none is worth writing. share: of the missing motion's
    excess over the noise, explained on conditions held out. corrections: change of the model's own parameters that goes with
    the formula (SI). named_only: what was found that no effect file can carry. state: the fitted one with the corrections.
    """

    formula: tuple[Coefficient, ...]
    share: float
    alternatives: tuple[tuple[tuple[str, ...], float], ...]
    corrections: dict[str, float]
    named_only: tuple[str, ...]
    state: State
    missing: MissingForce = field(repr=False)

    @cached_property
    def maps(self) -> dict[str, dict[str, np.ndarray]]:
        """Force-state maps `in_cut` and `out_of_cut`, arrays of displacement (m), velocity (m/s), force (N)."""
        return _maps(with_force(self.missing, self.state))

    @cached_property
    def in_cut(self) -> tuple[Ranked, ...]:
        """What the missing force depends on in the cut: variables ranked."""
        return rank(self.maps["in_cut"])

    @cached_property
    def out_of_cut(self) -> tuple[Ranked, ...]:
        """What the missing force depends on out of the cut: variables ranked."""
        return rank(self.maps["out_of_cut"])

    @property
    def held_out(self) -> bool:
        """Whether there was more than one operating condition, and `share` is of those held out; else of the regression."""
        return holds_out(self.missing.observed)

    @property
    def sentence(self) -> str:
        """What was found, in words."""
        return _sentence(self)

    def start(self, name: str) -> State:
        """The fitted state with the corrections and the formula as effect `name`: where a refit may begin."""
        values = {one.term.name: one.value for one in self.formula}
        return replace(self.state, model=self.state.model.with_effect(name, **values))


# -- the answer --------------------------------------------------------------------------------------------------------


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
                       corrected(missing.state, corrections), missing)  # fmt: skip


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


def _maps(missing: MissingForce) -> dict[str, dict[str, np.ndarray]]:
    """Samples in and out of the cut, in the windows that were compared, without those next to entry and exit of a tooth."""
    parts: dict[str, list[dict[str, np.ndarray]]] = {"in_cut": [], "out_of_cut": []}
    for index, (record, one) in enumerate(zip(missing.observed, missing.records, strict=True)):
        course = course_of(record, missing.state, index, missing.catalogue)
        used = np.zeros(record.samples, dtype=bool)
        for window in windows_of(record, course, missing.state.model):
            used[window] = True
        changes = np.zeros(record.samples, dtype=bool)
        changes[1:] = one.cutting[1:] != one.cutting[:-1]
        edge = np.convolve(changes, np.ones(3), "same") > 0
        known = {"force": one.force, "deviation": one.deviation, "displacement": one.displacement, "velocity": one.velocity,
                 "delayed displacement": one.delayed, "chip": one.chip, "tooth angle": one.angle,
                 "spindle angle": one.spindle_angle, "length cut": one.length, "time": one.time,
                 "depth of cut": np.full(record.samples, one.depth),
                 "cutting speed": np.full(record.samples, one.cutting_speed)}  # fmt: skip
        group = condition_number(missing, index)
        for name, place in (("in_cut", one.cutting), ("out_of_cut", ~one.cutting)):
            picked = used & place & ~edge
            parts[name].append({key: values[picked] for key, values in known.items()}
                               | {"condition": np.full(int(picked.sum()), group)})  # fmt: skip
    return {name: {key: np.concatenate([one[key] for one in found]) for key in found[0]} for name, found in parts.items()}


def condition_number(missing: MissingForce, index: int) -> int:
    """Number of a record's operating condition: the first record that has it."""
    wanted = missing.observed[index].condition
    return next(place for place, record in enumerate(missing.observed) if record.condition == wanted)


def formula_text(formula: Sequence[Coefficient]) -> str:
    """The law with its values, a line of text."""
    sides = {"structure_force": "F", "tangential_force": "F_t", "normal_force": "F_n"}
    parts = []
    for hook, symbol in sides.items():
        terms = [one for one in formula if one.term.hook == hook]
        if terms:
            text = " + ".join(_with_value(one.term, one.value) for one in terms).replace("+ -", "- ")
            parts.append(f"{symbol} = {text}")
    return "; ".join(parts)


def _with_value(term: ForceTerm, value: float) -> str:
    law, sign = (term.law[1:], -value) if term.law.startswith("-") else (term.law, value)
    return f"{sign:.3g} {law}".rstrip()


def _is_clear(ranked: Sequence[Ranked]) -> bool:
    return bool(ranked) and ranked[0].share >= CLEAR


def _leading(ranked: Sequence[Ranked], where: str) -> str:
    if not _is_clear(ranked):
        return "with nothing that was measured"
    single = next((one for one in ranked if len(one.variables) == 1), None)
    best = ranked[0]
    if single is not None and single.share > best.share - 0.05:
        best = single
    return f"with {' and '.join(best.variables)} ({best.share:.0%} of its variance on {where})"


def _sentence(found: Explanation) -> str:
    described = bool(found.formula) and found.share >= EXPLAINED
    said = [f"There is a {' and a '.join(found.named_only)}, which no effect file can carry."] if found.named_only else []
    if depends := _depends(found, described):
        said.insert(0, depends)
    if found.formula:
        said.insert(0, f"The missing force {_law(found, described)}.")
    elif not found.named_only:
        said.insert(0, "No force of the library explains what is missing.")
    return " ".join(said)


def _depends(found: Explanation, described: bool) -> str:
    """What the force goes with, in and out of the cut; a place where it is scattered too much is told only where no formula is
    found: a fit to the motion sees more.
    """
    where = "held-out conditions" if found.held_out else "held-out stretches"
    text = "; ".join(
        f"{place} the missing force goes {_leading(ranked, where)}"
        for place, ranked in (("in the cut", found.in_cut), ("out of the cut", found.out_of_cut))
        if ranked and (_is_clear(ranked) or not described)
    )
    return f"{text[:1].upper()}{text[1:]}." if text else ""


def _law(found: Explanation, described: bool) -> str:
    formula = found.formula
    wave = all(one.term.name.split("_")[0] in ("cos", "sin", "edge") for one in formula) and len(formula) > 2
    kind = "is described by a waveform of the tooth angle only" if wave else "is described by"
    where = "on held-out conditions" if found.held_out else "in the regression itself"
    good = "" if described else ", which is only part of it"
    return f"{kind}: {formula_text(formula)} ({min(found.share, 1.0):.0%} of the misfit {where}{good})"


def write_effect(explanation: Explanation, folder: str | Path, name: str) -> Path:
    """Write the formula as an effect file NAME.py into a folder. ValueError where no formula was found."""
    if not explanation.formula:
        raise ValueError("no formula was found: there is nothing to write")
    return write_proposal(explanation.formula, folder, name, share=explanation.share, story=explanation.sentence,
                          held_out=explanation.held_out)  # fmt: skip


def as_json(explanation: Explanation) -> dict[str, Any]:
    """The explanation as JSON, SI values, without the maps."""
    return {
        "sentence": explanation.sentence,
        "share": explanation.share,
        "formula": [{"term": one.term.law, "name": one.term.name, "acts": one.term.hook, "value": one.value, "low": one.low,
                     "high": one.high, "unit": one.term.unit} for one in explanation.formula],
        "in_cut": [{"variables": list(one.variables), "share": one.share} for one in explanation.in_cut],
        "out_of_cut": [{"variables": list(one.variables), "share": one.share} for one in explanation.out_of_cut],
        "alternatives": [{"terms": list(terms), "share": share} for terms, share in explanation.alternatives],
        "corrections": explanation.corrections,
        "named_only": list(explanation.named_only),
    }  # fmt: skip
