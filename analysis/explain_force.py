"""What a missing force depends on, and a short formula for it: ranking of variables, best subsets of a library of terms.

Terms are chosen by the residual that they leave on operating conditions held out of the regression, by BIC, and by
length: a longer formula must take away a clear share of what the shorter one leaves. The model's own parameters are
refitted with every subset, since the fit of an incomplete model has bent them.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from analysis.cut_variables import course_of
from analysis.force_ranking import Ranked, rank
from analysis.force_regression import Products, nuisance_forces, products, windows_of
from analysis.latent_force import MissingForce
from analysis.waveform import State
from testbed.proposal import Coefficient, ForceTerm, write_proposal

MOST_TERMS = 4
WORTH = 0.04  # share of the excess that one term more must take away
NEAR = 0.01  # share of the excess within which the simpler of two formulas is taken
DELTA_BIC = 10.0
EXPLAINED = 0.5  # share of the excess from which a formula is called a description of the force
RETURN_ANGLE = 3e-3  # rad, change of the tooth angle from which the regression is done again
BEAM = 12  # subsets that are extended by one term more
Z95 = 1.959964


@dataclass(frozen=True)
class Subset:
    """Terms tried together: their places, the held-out sum of squares and that over all."""

    places: tuple[int, ...]
    held_out: float
    squares: float


@dataclass(frozen=True)
class Explanation:
    """What was found of a missing force.

    formula: terms with coefficients and 95 % intervals, empty where none is worth writing. share: of the missing motion's
    excess over the noise, explained on conditions held out. in_cut and out_of_cut: variables ranked. corrections: change
    of the model's own parameters that goes with the formula (SI). named_only: what was found that no effect file can
    carry. maps: force-state maps `in_cut` and `out_of_cut`, arrays of displacement (m), velocity (m/s), force (N).
    """

    sentence: str
    formula: tuple[Coefficient, ...]
    share: float
    excess: float
    in_cut: tuple[Ranked, ...]
    out_of_cut: tuple[Ranked, ...]
    alternatives: tuple[tuple[tuple[str, ...], float], ...]
    corrections: dict[str, float]
    named_only: tuple[str, ...]
    state: State
    maps: dict[str, dict[str, np.ndarray]] = field(repr=False)

    def start(self, name: str) -> State:
        """The fitted state with the corrections and the formula as effect `name`: where a refit may begin."""
        values = {one.term.name: one.value for one in self.formula}
        return replace(self.state, model=self.state.model.with_effect(name, **values))


# -- choice of terms ---------------------------------------------------------------------------------------------------


class Chooser:
    """Least squares on the sums of products, over all conditions and with each left out in turn."""

    def __init__(self, found: Products) -> None:
        self.found = found
        self.total = found.sums.sum(axis=0)
        self.base = list(range(len(found.nuisances)))
        self.rows = int(found.rows.sum())

    def columns(self, places: Sequence[int]) -> list[int]:
        """Columns of the nuisances and of the terms at `places`."""
        return self.base + [len(self.base) + place for place in places]

    @staticmethod
    def solve(sums: np.ndarray, columns: Sequence[int]) -> np.ndarray:
        """Coefficients of the columns."""
        if not columns:
            return np.zeros(0)
        return np.linalg.lstsq(sums[np.ix_(columns, columns)], sums[columns, -1], rcond=1e-12)[0]

    @staticmethod
    def left(sums: np.ndarray, columns: Sequence[int], values: np.ndarray) -> float:
        """Sum of squares that coefficients leave."""
        square = sums[np.ix_(columns, columns)]
        return float(sums[-1, -1] - 2 * values @ sums[columns, -1] + values @ square @ values)

    def subset(self, places: Sequence[int]) -> Subset:
        """A subset of terms with its sums of squares."""
        columns = self.columns(places)
        squares = self.left(self.total, columns, self.solve(self.total, columns))
        if len(self.found.sums) < 2:
            return Subset(tuple(places), squares, squares)
        held_out = sum(self.left(one, columns, self.solve(self.total - one, columns)) for one in self.found.sums)
        return Subset(tuple(places), held_out, squares)

    def complexity(self, subset: Subset) -> float:
        """How much a reader of the formula has to take in."""
        return sum(self.found.terms[place].complexity for place in subset.places)

    def residual(self, subset: Subset) -> list[np.ndarray]:
        """Residuals of the records (values,), in units of the noise."""
        columns = self.columns(subset.places)
        values = self.solve(self.total, columns)
        return [block[:, -1] - block[:, columns] @ values for block in self.found.blocks]

    def whiteness(self, subset: Subset) -> float:
        """Independent values over values, from the residuals' autocorrelation up to where it dies away."""
        independent = 0.0
        for rest in self.residual(subset):
            if len(rest) < 16:
                continue
            power = np.abs(np.fft.rfft(rest - rest.mean(), 2 * len(rest))) ** 2
            correlation = np.fft.irfft(power)[: len(rest)]
            correlation = correlation / max(float(correlation[0]), 1e-300)
            low = np.flatnonzero(correlation <= 0.05)
            last = int(low[0]) if len(low) else len(rest)
            independent += len(rest) / (1.0 + 2.0 * float(correlation[1:last].sum()))
        return max(independent, 10.0) / max(self.rows, 1)


def _best(chooser: Chooser, tried: Sequence[Subset], excess: float) -> Subset:
    """The simplest of the subsets that are all but as good as the best."""
    best = min(one.held_out for one in tried)
    near = [one for one in tried if one.held_out <= best + NEAR * excess]
    return min(near, key=lambda one: (round(chooser.complexity(one), 6), one.held_out))


def choose(chooser: Chooser) -> tuple[Subset, list[list[Subset]], float]:
    """(chosen subset, subsets tried by size, excess of the model alone over what the fullest formula leaves)."""
    count = len(chooser.found.terms)
    levels = [[chooser.subset(())], [chooser.subset((place,)) for place in range(count)]]
    levels.append([chooser.subset(pair) for pair in itertools.combinations(range(count), 2)])
    while len(levels) <= MOST_TERMS:
        leaders = sorted(levels[-1], key=lambda one: one.held_out)[:BEAM]
        wider = {tuple(sorted((*one.places, place))) for one in leaders for place in range(count) if place not in one.places}
        levels.append([chooser.subset(places) for places in sorted(wider)])
    levels = [level for level in levels if level]
    floor = min(float(chooser.rows), min(one.held_out for level in levels for one in level))
    excess = max(levels[0][0].held_out - floor, 1e-12)
    chosen = levels[0][0]
    for level in levels[1:]:
        trial = _best(chooser, level, excess)
        size = max(10.0, chooser.rows * chooser.whiteness(trial))
        more = len(trial.places) - len(chosen.places)
        gain = size * math.log(max(chosen.squares, 1e-300) / max(trial.squares, 1e-300)) - more * math.log(size)
        worth = chosen.held_out - trial.held_out > more * WORTH * excess
        if gain > DELTA_BIC and worth:
            chosen = trial
    return chosen, levels, excess


def _waveform(chooser: Chooser, chosen: Subset, excess: float) -> Subset:
    """The chosen subset, or a Fourier series in the tooth angle where that leaves clearly less."""
    names = [term.name for term in chooser.found.terms]
    best = chosen
    for side in ("t", "n"):
        series: list[int] = []
        for order in range(0, 7):
            wanted = [f"edge_{side}"] if order == 0 else [f"cos_{order}_{side}", f"sin_{order}_{side}"]
            if any(name not in names for name in wanted):
                break
            series += [names.index(name) for name in wanted]
            trial = chooser.subset(series)
            if best.held_out - trial.held_out > len(wanted) * WORTH * excess:
                best = trial
    return best


def coefficients(chooser: Chooser, subset: Subset) -> tuple[tuple[Coefficient, ...], dict[str, float]]:
    """(terms with values and intervals, changes of the model's own parameters) in SI."""
    columns, first = chooser.columns(subset.places), len(chooser.base)
    values = chooser.solve(chooser.total, columns)
    spread = np.linalg.pinv(chooser.total[np.ix_(columns, columns)], hermitian=True)
    variance = max(1.0, subset.squares / max(chooser.rows, 1)) / min(1.0, chooser.whiteness(subset))
    scale = chooser.found.scale[columns]
    half = Z95 * np.sqrt(np.maximum(np.diag(spread), 0.0) * variance) / scale
    values = values / scale
    found = []
    for place, value, reach in zip(subset.places, values[first:], half[first:], strict=True):
        found.append(Coefficient(chooser.found.terms[place], float(value), float(value - reach), float(value + reach)))
    return tuple(found), dict(zip(chooser.found.nuisances, map(float, values[:first]), strict=True))


# -- the answer --------------------------------------------------------------------------------------------------------


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


def explain(missing: MissingForce, say: Callable[[str], None] = lambda text: None) -> Explanation:
    """Rank what the missing force depends on and find a short formula for it. ValueError where records are too short."""
    turned, chooser, chosen, levels, excess = 0.0, None, None, [], 0.0
    for _ in range(3):  # the fit of an incomplete model bends the tooth angle too, and that does not enter linearly
        chooser = Chooser(products(missing, turned=turned, say=say))
        say("choosing a formula")
        chosen, levels, excess = choose(chooser)
        _, corrections = coefficients(chooser, chosen)
        step = corrections.get("mark_angle", 0.0)
        if abs(step) < RETURN_ANGLE:
            break
        turned += float(np.clip(step, -0.2, 0.2))
    assert chooser is not None and chosen is not None
    if chosen.held_out - (levels[0][0].held_out - excess) > (1 - EXPLAINED) * excess:
        chosen = _waveform(chooser, chosen, excess)
    found, corrections = coefficients(chooser, chosen)
    if "mark_angle" in corrections:
        corrections["mark_angle"] += turned
    share = (levels[0][0].held_out - chosen.held_out) / excess
    significant = excess > 4.0 * math.sqrt(2.0 * chooser.rows) and bool(chosen.places)
    drive = max(1.0 + corrections.get("drive", 0.0), 0.1)
    written = tuple(
        replace(one, value=one.value / drive, low=one.low / drive, high=one.high / drive)
        for one in found if one.term.expression
    ) if significant else ()  # fmt: skip
    only_named = tuple(one.term.meaning for one in found if not one.term.expression) if significant else ()
    say("ranking what the force depends on")
    maps = _maps(missing, corrections)
    in_cut, out = (rank(maps[name]) for name in ("in_cut", "out_of_cut"))
    others = sorted((one for level in levels[1:3] for one in level), key=lambda one: one.held_out)[:8]
    alternatives = tuple(
        (tuple(chooser.found.terms[place].law or "1" for place in one.places),
         (levels[0][0].held_out - one.held_out) / excess) for one in others
    )  # fmt: skip
    sentence = _sentence(written, only_named, share, in_cut, out, significant)
    return Explanation(sentence, written, share if significant else 0.0, excess / max(chooser.rows, 1), in_cut, out,
                       alternatives, corrections, only_named, corrected(missing.state, corrections), maps)  # fmt: skip


def _maps(missing: MissingForce, corrections: dict[str, float]) -> dict[str, dict[str, np.ndarray]]:
    """Samples in and out of the cut: the missing force without what the model's own parameters make up for."""
    turned = corrections.get("mark_angle", 0.0)
    parts: dict[str, list[dict[str, np.ndarray]]] = {"in_cut": [], "out_of_cut": []}
    for index, (record, one) in enumerate(zip(missing.observed, missing.records, strict=True)):
        course = course_of(record, missing.state, index, missing.catalogue)
        small = nuisance_forces(missing, index, course)
        own = sum((corrections[name] * part.along for name, part in small.items() if name in corrections),
                  np.zeros(len(course.time)))  # fmt: skip
        force = one.force - course.sampled(own)
        used = np.zeros(record.samples, dtype=bool)
        for window in windows_of(record, course, missing.state.model):
            used[window] = True
        edge = np.zeros(record.samples, dtype=bool)  # where the gate may be off by the angle's error
        edge[1:] |= one.cutting[1:] != one.cutting[:-1]
        edge[:-1] |= edge[1:]
        reach = math.ceil(abs(turned) * record.period / (2 * math.pi) * record.rate) if record.period else 0
        if reach:
            edge = np.convolve(edge, np.ones(2 * reach + 1), "same") > 0
        known = {"force": force, "deviation": one.deviation, "displacement": one.displacement, "velocity": one.velocity,
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


def _leading(ranked: Sequence[Ranked]) -> str:
    single = next((one for one in ranked if len(one.variables) == 1), None)
    best = ranked[0] if ranked else None
    if best is None or best.share < 0.1:
        return "on nothing that was measured"
    if single is not None and single.share > best.share - 0.05:
        best = single
    return f"on {' and '.join(best.variables)} ({best.share:.0%} of its variance on held-out conditions)"


def _sentence(formula: Sequence[Coefficient], only_named: Sequence[str], share: float, in_cut: Sequence[Ranked],
              out: Sequence[Ranked], significant: bool) -> str:  # fmt: skip
    depends = "; ".join(
        f"{place} the missing force depends {_leading(ranked)}" for place, ranked in (("in the cut", in_cut), ("out of the cut", out))
        if ranked
    )  # fmt: skip
    depends = depends[:1].upper() + depends[1:]
    if not significant:
        return f"No force of the library explains what is missing. {depends}."
    if only_named:
        depends += f". There is a {' and a '.join(only_named)}, which no effect file can carry"
    if not formula:
        return f"{depends}."
    wave = all(one.term.name.split("_")[0] in ("cos", "sin", "edge") for one in formula) and len(formula) > 2
    kind = "is described by a waveform of the tooth angle only" if wave else "is described by"
    good = "" if share >= EXPLAINED else ", which is only part of it"
    return f"The missing force {kind}: {formula_text(formula)} ({share:.0%} of the misfit on held-out conditions{good}). {depends}."


def write_effect(explanation: Explanation, folder: str | Path, name: str) -> Path:
    """Write the formula as an effect file NAME.py into a folder. ValueError where no formula was found."""
    if not explanation.formula:
        raise ValueError("no formula was found: there is nothing to write")
    return write_proposal(explanation.formula, folder, name, share=explanation.share, leaves=explanation.sentence)


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
