"""A short formula for a missing force of a machine in x and y, by the slopes of the fit itself.

All terms of a library are one effect. What a little of each does to every channel is simulated beside the slopes of the
machine's own parameters, so that regeneration, modes and sensors are the engine's; subsets of terms are then chosen from sums
of products, as along the feed. The slopes hold about the motion of the fit: a strong force shows but roughly from a model
without it, and well from one with a formula that is nearly right (Gauss and Newton's method, terms chosen anew each time).
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace

import numpy as np

from testbed.analysis.fit.fit_state import State, WaveformFit, together
from testbed.analysis.fit.held_out import conditions_of
from testbed.analysis.fit.observed import Observed
from testbed.analysis.fit.prediction import Engine
from testbed.analysis.fit.waveform import Fitter
from testbed.analysis.force.choice import Choice, Chooser, Subset, choose, coefficients
from testbed.analysis.force.explanation import Explanation
from testbed.analysis.force.regression import Products, products_of
from testbed.analysis.force.terms import planar_structure_terms, term_value, tooth_terms
from testbed.analysis.force.trial_law import NAME, law_of
from testbed.analysis.search.candidate import ADEQUATE, Candidate
from testbed.analysis.search.candidate_round import by_noise
from testbed.analysis.search.diagnosis import Diagnosis
from testbed.effect import Effect
from testbed.machine import Model
from testbed.trial.proposal import Coefficient, ForceTerm

SMALL = 1e-6  # of the spring's own force, that a term has as it is tried: a response far above rounding, far below any bend
BEYOND_CHANCE = 4.0  # standard deviations of the noise's own sum of squares, from which there is a force to describe
SHARES = (1.0, 0.5, 0.25, 0.1, 0.03, 0.01)  # of the step that the slopes ask for, tried as a start
MOST_BYTES = 2_000_000_000  # of the columns of all records
LENGTH_CUT = 0.05  # m, at which a term that grows with the length cut is scaled
ANGLE = 0.7  # rad, at which a waveform is scaled
EngineOf = Callable[[Mapping[str, Effect]], Engine]


def left_in_the_plane(engine_of: EngineOf, found: Diagnosis, catalogue: Mapping[str, Effect],
                      progress: Callable[[str], None] = lambda text: None) -> list[Explanation]:  # fmt: skip
    """What describes the force that a diagnosis in x and y left unexplained, best first; none where it left but noise."""
    chosen = found.best if found.verdict == "missing_effect" else found.base
    if not isinstance(chosen, Candidate) or chosen.error_held_out <= ADEQUATE * found.noise_floor:
        return []
    chosen = by_noise(chosen)
    return explanations_about(engine_of, chosen.fitter, chosen.fit, catalogue, progress)


def planar_library(records: Sequence[Observed], model: Model) -> list[ForceTerm]:
    """The terms that records of a machine in x and y could show."""
    if model.cutter is None or all(record.cut is None for record in records):
        return planar_structure_terms()
    return planar_structure_terms() + tooth_terms(model.cutter.flutes)


@dataclass(frozen=True)
class _About:
    """A fit with the library beside it: fitter and state with all terms, those that are on trial in it at their values."""

    fitter: Fitter
    state: State
    terms: tuple[ForceTerm, ...]
    chooser: Chooser


@contextmanager
def _about(engine_of: EngineOf, fitter: Fitter, fit: WaveformFit, catalogue: Mapping[str, Effect]) -> Iterator[_About]:
    terms = planar_library(fitter.records, fit.state.model)
    held = fit.state.model.effects.get(NAME, {})
    values = {term.name: held.get(term.name, 0.0) for term in terms}
    plain = [one for one in fitter.unknowns if not one.path.startswith(f"{NAME}.")]
    with tempfile.TemporaryDirectory() as folder:  # the law's file is read again where its engine compiles
        wider = Fitter(engine_of({**catalogue, NAME: law_of(terms, folder)}), fitter.records, plain)
        about = replace(fit.state, model=fit.state.model.with_effect(NAME, **values))
        yield _About(wider, about, tuple(terms), Chooser([_products(wider, about, terms, values)]))


def explanations_about(engine_of: EngineOf, fitter: Fitter, fit: WaveformFit, catalogue: Mapping[str, Effect],
                       progress: Callable[[str], None] = lambda text: None) -> list[Explanation]:  # fmt: skip
    """Formulas for the force that a fit lacks, or beside a formula on trial in it: the best, then the next best."""
    progress("slopes by every term of the library")
    with _about(engine_of, fitter, fit, catalogue) as one:
        progress("choosing a formula")
        choice = choose(one.chooser)
        there = choice.excess > BEYOND_CHANCE * (2.0 * one.chooser.rows) ** 0.5
        subsets = (choice.chosen, *choice.rivals(one.chooser)) if there else (one.chooser.subset(()),)
        return [_explanation(one, choice, subset) for subset in subsets]


def share_of(engine_of: EngineOf, fitter: Fitter, fit: WaveformFit, formula: Sequence[Coefficient],
             catalogue: Mapping[str, Effect]) -> float:  # fmt: skip
    """Share of what is missing beyond the noise that a formula explains on conditions held out, about the fit that has it."""
    with _about(engine_of, fitter, fit, catalogue) as one:
        names = [term.name for term in one.terms]
        without, some = one.chooser.subset(()), one.chooser.subset([names.index(each.term.name) for each in formula])
        excess = max(without.held_out - min(some.held_out, float(one.chooser.rows)), 1e-12)
        return max(0.0, (without.held_out - some.held_out) / excess)


def _explanation(about: _About, choice: Choice, subset: Subset) -> Explanation:
    """What one subset of the terms says of the missing force."""
    alternatives = tuple((tuple(about.terms[place].law or "1" for place in one.places), choice.share(one))
                         for one in choice.alternatives())  # fmt: skip
    formula, steps = coefficients(about.chooser, subset)
    begun, corrections, formula = _damped(about.fitter, about.state, steps, formula)
    return Explanation(formula, max(0.0, choice.share(subset)), alternatives, corrections, (), begun, about.fitter.records,
                       about.terms, unknowns=about.fitter.unknowns)  # fmt: skip


def _typical(records: Sequence[Observed], model: Model) -> dict[str, float]:
    """What a hook is offered, as large as in the loudest record."""
    loudest = max(records, key=lambda record: record.motion_size)
    cuts = [record.cut for record in records if record.cut is not None]
    size = loudest.motion_size
    rate = size * max(mode.natural_frequency_rad for mode in model.structure.modes)
    along = {"displacement": size, "velocity": rate, "displacement_y": size, "velocity_y": rate}
    if not cuts or model.cutter is None:
        return along
    return along | {"edge_velocity": rate, "depth": max(cut.axial_depth_of_cut for cut in cuts),
                    "chip": max(cut.feed_per_tooth for cut in cuts), "length_cut": LENGTH_CUT, "angle": ANGLE, "tooth": 1.0,
                    "cutting_speed": 0.5 * model.cutter.diameter * max(cut.spindle_speed for cut in cuts)}  # fmt: skip


def _products(fitter: Fitter, state: State, terms: Sequence[ForceTerm], values: Mapping[str, float]) -> Products:
    """Sums of products about a state in which the terms have these coefficients; columns per unit of each.

    ValueError where the records are too long for that.
    """
    taken = 8 * sum(record.size for record in fitter.records) * (len(fitter.names) + len(terms) + 1)
    if taken > MOST_BYTES:
        raise ValueError(f"slopes by {len(terms)} terms of all records would take {taken / 1e9:.2g} GB, more than "
                         f"{MOST_BYTES / 1e9:g}: name a part of the records by from and to")
    typical = _typical(fitter.records, state.model)
    force = SMALL * state.model.structure.stiffness * typical["displacement"]
    steps = np.array([force / max(abs(term_value(term, typical)), 1e-300) for term in terms])
    paths = [f"{NAME}.{term.name}" for term in terms]
    models = [state.model.with_values({path: state.model.value(path) + step}) for path, step in zip(paths, steps, strict=True)]
    present = np.array([values[term.name] for term in terms])
    blocks = []
    for index, own in enumerate(state.nuisances):
        part = fitter.linearise(index, state)
        variants = [(model, state.angle, own) for model in (state.model, *models)]
        most = together(fitter.records[index].size)
        parts = [fitter.residuals_of(index, [variants[0], *variants[begin : begin + most]])
                 for begin in range(1, len(variants), most)]
        left = np.vstack([parts[0][:1], *(found[1:] for found in parts)])
        slopes = (left[1:] - left[0]) / steps[:, None]
        rows = part.without_own(np.vstack([-part.shared.T, -slopes, left[:1] - present @ slopes]))
        blocks.append(np.where(np.isfinite(rows), rows, 0.0).T)
    return products_of(dict(enumerate(blocks)), conditions_of(fitter.records), fitter.names, terms)


def _damped(fitter: Fitter, state: State, steps: Mapping[str, float], formula: tuple[Coefficient, ...]
            ) -> tuple[State, dict[str, float], tuple[Coefficient, ...]]:  # fmt: skip
    """(the state without the formula, by how much the machine's own parameters are moved (SI), the formula), by that share of
    the whole step that explains most: the slopes of a strong force hold for a part of the way alone."""
    known, own = state.model.effects[NAME], np.array([steps[name] for name in fitter.names])

    def moved(share: float) -> State:
        values = {name: (1.0 - share) * value for name, value in known.items()}
        for one in formula:
            values[one.term.name] += share * one.value
        begun = fitter.moved(state, share * own)
        return replace(begun, model=begun.model.with_effect(NAME, **values))

    share = min(SHARES, key=lambda share: fitter.cost(moved(share)))
    begun = moved(share)
    found = tuple(replace(one, value=begun.model.effects[NAME][one.term.name]) for one in formula)
    corrections = share * own * fitter.steps
    return begun.without_effect(NAME), dict(zip(fitter.names, corrections.tolist(), strict=True)), found
