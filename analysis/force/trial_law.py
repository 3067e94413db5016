"""One effect with every term that a formula may have, so that formulas on trial share one compiled engine."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from testbed.analysis.force.explanation import Explanation
from testbed.catalogue import read_effect
from testbed.effect import Effect, Parameter
from testbed.trial.proposal import SPAN, Coefficient, ForceTerm, effect_text

NAME = "formula_on_trial"
_NOWHERE = ("no channel",)  # of terms that a formula lacks: what no channel shows is unknown to no fit


def trial_law(explanation: Explanation, folder: str | Path) -> Effect:
    """The explanation's formula as an effect whose file, written into `folder`, does not depend on what was found.

    The file holds the library's terms of the structure, of a tooth, or both, as the formula does: few formulas differ in
    that, and engines are compiled, and kept, by the text of the file. In x and y it holds all: slopes by them are asked, too.
    """
    law = law_of(_terms(explanation), folder)
    found = {one.term.name: one for one in explanation.formula}
    return replace(law, parameters=tuple(_as_found(one, found.get(one.name)) for one in law.parameters))


def law_of(terms: Sequence[ForceTerm], folder: str | Path) -> Effect:
    """All the terms as one effect, whose file is written into `folder`."""
    path = Path(folder) / f"{NAME}.py"
    path.write_text(_text(terms))
    return read_effect(path)


def _terms(explanation: Explanation) -> list[ForceTerm]:
    kinds = {_on_structure(one.term) for one in explanation.formula}
    if explanation.state.model.planar:
        kinds = {True, False}
    return [term for term in explanation.library if term.expression and _on_structure(term) in kinds]


def _on_structure(term: ForceTerm) -> bool:
    return term.hook.startswith("structure_force")


def _text(terms: Sequence[ForceTerm]) -> str:
    return effect_text(NAME, [Coefficient(term, 1.0, 1.0, 1.0) for term in terms], share=0.0, story="", switched=True)


def _as_found(parameter: Parameter, found: Coefficient | None) -> Parameter:
    if found is None:
        return replace(parameter, example=0.0, start=0.0, channels=_NOWHERE)
    bound = SPAN * abs(found.value)
    return replace(parameter, example=found.value, start=found.value, bounds=(-bound, bound))
