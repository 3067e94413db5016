"""What was found of a missing force: what it depends on, a short formula for it, in words and as an effect file."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from testbed.analysis.fit.fit_state import FreeParameter, State
from testbed.analysis.fit.held_out import holds_out
from testbed.analysis.fit.observed import Observed
from testbed.analysis.force.cut_variables import course_of
from testbed.analysis.force.latent_force import MissingForce, with_force
from testbed.analysis.force.ranking import Ranked, rank
from testbed.analysis.force.regression import windows_of
from testbed.analysis.search.diagnosis import COMPLETE
from testbed.trial.proposal import SYMBOLS, Coefficient, ForceTerm, write_proposal

EXPLAINED = 0.5  # share of the excess from which a formula is called a description of the force
CLEAR = 0.25  # share of the force's variance from which a variable is said to rule it


@dataclass(frozen=True)
class Explanation:
    """What was found of a missing force.

    formula: terms with coefficients and 95 % intervals, empty where none is worth writing. share: of the missing motion's
    excess over the noise, explained on conditions held out. corrections: change of the model's own parameters that goes with
    the formula (SI). named_only: what was found that no effect file can carry. state: the fitted one with the corrections.
    library: the terms that it was chosen from. missing: the force in time, None where it was not estimated (in x and y).
    unknowns: of the fit behind it, where some of the machine's are held; empty: all are free. left: what a fit of the formula
    leaves of the record it explains worst, over the noise; 0 before there is one.
    """

    formula: tuple[Coefficient, ...]
    share: float
    alternatives: tuple[tuple[tuple[str, ...], float], ...]
    corrections: dict[str, float]
    named_only: tuple[str, ...]
    state: State
    observed: tuple[Observed, ...] = field(repr=False)
    library: tuple[ForceTerm, ...] = field(repr=False)
    missing: MissingForce | None = field(default=None, repr=False)
    unknowns: tuple[FreeParameter, ...] = field(default=(), repr=False)
    left: float = 0.0

    @cached_property
    def maps(self) -> dict[str, dict[str, np.ndarray]]:
        """Force-state maps `in_cut` and `out_of_cut`, arrays of displacement (m), velocity (m/s), force (N)."""
        return {} if self.missing is None else _maps(with_force(self.missing, self.state))

    @cached_property
    def in_cut(self) -> tuple[Ranked, ...]:
        """What the missing force depends on in the cut: variables ranked."""
        return rank(self.maps.get("in_cut", {}))

    @cached_property
    def out_of_cut(self) -> tuple[Ranked, ...]:
        """What the missing force depends on out of the cut: variables ranked."""
        return rank(self.maps.get("out_of_cut", {}))

    @property
    def held_out(self) -> bool:
        """Whether there was more than one operating condition, and `share` is of those held out; else of the regression."""
        return holds_out(self.observed)

    @property
    def sentence(self) -> str:
        """What was found, in words."""
        return _sentence(self)

    def start(self, name: str) -> State:
        """The fitted state with the corrections and the formula as effect `name`: where a refit may begin."""
        values = {one.term.name: one.value for one in self.formula}
        return replace(self.state, model=self.state.model.with_effect(name, **values))


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
    parts = []
    for hook, symbol in SYMBOLS.items():
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
        if found.left > COMPLETE:
            said.append(f"Fitted, it leaves {found.left:.3g} times the noise of a record: the true law may be another.")
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
