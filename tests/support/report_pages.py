"""Pages for the tests of the report: three cuts with a hidden effect, fitted from the truth so that no search is needed."""

from __future__ import annotations

from functools import cache, partial
from types import SimpleNamespace

import testbed.analysis.comparison.compare
from testbed.analysis.comparison.compare import Comparison, compare
from testbed.analysis.fit.effect_start import effect_parameters
from testbed.analysis.fit.estimates import estimates
from testbed.analysis.fit.first_passes import first_nuisances
from testbed.analysis.fit.fit_state import State
from testbed.analysis.fit.free_parameters import free_parameters
from testbed.analysis.fit.held_out import errors_in_fit, held_out_errors, pooled
from testbed.analysis.fit.observe import observe
from testbed.analysis.fit.solve import alternate_fit_and_passes
from testbed.analysis.fit.waveform import Fitter
from testbed.analysis.report.compare_page import compare_page
from testbed.analysis.report.page import Page, Panel
from testbed.analysis.report.story_page import addition_page, diagnosis_page
from testbed.analysis.search.add_effect import Addition
from testbed.analysis.search.candidate import Candidate
from testbed.analysis.search.diagnosis import Diagnosis
from testbed.catalogue import catalogue
from testbed.engines import fast, predict
from tests.support.campaign_files import BELIEVED, TRUE
from tests.support.synthetic_campaign import MARK_ANGLE, TESTS, synthetic_campaign

CATALOGUE = catalogue()
EFFECT, OTHER = "process_damping", "tool_wear"
HIDDEN = TRUE.with_effect(EFFECT, coefficient=2.0e5)
UNITS = {"displacement": "m"}
ENGINE = SimpleNamespace(
    predict_cuts=partial(predict.predict_cuts, catalogue=CATALOGUE),
    predict_driven=partial(predict.predict_driven, catalogue=CATALOGUE),
)


@cache
def records(true=HIDDEN):
    """Three cuts made ready for a fit."""
    made = synthetic_campaign(partial(fast.simulate, steps=37), true, seed=4, tests=TESTS[:3])
    return tuple(observe(record, BELIEVED) for record in made)


def fit_from(model, chosen, effects=()):
    """(fitter, fit) of a model from where the truth is."""
    free = free_parameters(chosen, model)
    for name in effects:
        free += effect_parameters(CATALOGUE[name], chosen)
    fitter = Fitter(ENGINE, chosen, free)
    state = State(model, MARK_ANGLE, tuple(first_nuisances(record, MARK_ANGLE) for record in chosen))
    return fitter, alternate_fit_and_passes(fitter, state, rounds=1, iterations=4)


@cache
def comparison(true=HIDDEN) -> Comparison:
    """compare() without its search for a start."""
    search = testbed.analysis.comparison.compare.model_fit
    testbed.analysis.comparison.compare.model_fit = lambda engine, chosen, model, known, told: fit_from(TRUE, chosen)
    try:
        return compare(ENGINE, records(true), BELIEVED, CATALOGUE)
    finally:
        testbed.analysis.comparison.compare.model_fit = search


@cache
def candidate(*effects: str) -> Candidate:
    """A set of effects fitted; process damping starts at its true strength, tool wear from none."""
    model = TRUE
    for name in effects:
        model = HIDDEN if name == EFFECT else model.with_effect(OTHER, rate=0.1)
    fitter, fit = fit_from(model, records(), effects)
    errors = tuple(held_out_errors(fitter, fit))
    parameters = {path: fit.state.model.value(path) for path in fit.names if "." in path}
    in_fit = pooled(errors_in_fit(fitter, fit))[0]
    return Candidate(effects, parameters, in_fit, pooled(errors)[0], 100.0, True, errors, fit=fit, fitter=fitter)


def diagnosis() -> Diagnosis:
    """What diagnose() would answer: process damping is missing, tool wear was tried."""
    base, found, other = candidate(), candidate(EFFECT), candidate(OTHER)
    return Diagnosis(
        "missing_effect", (EFFECT,), "The model lacks process_damping.", base.error_held_out, found.error_held_out,
        pooled(base.errors)[1], (found, other), base, found, (base, found),
    )


def addition() -> Addition:
    """What add_effect() would answer."""
    base, found = candidate(), candidate(EFFECT)
    return Addition(
        (EFFECT,), found.fit.state.model, base.error_held_out, found.error_held_out, pooled(base.errors)[1], base.errors,
        found.errors, True, estimates(found.fitter, found.fit, CATALOGUE), True, ("one warning",), found.fit, base.fit,
    )


@cache
def failing_page() -> Page:
    """compare's page where something is missing."""
    return compare_page(comparison(), BELIEVED, CATALOGUE, UNITS)


def sealed() -> Page:
    """A page with what is wider than a phone: a word of 64 letters, a command, a table."""
    page = Page("Sealed")
    page.text("the truth is sealed in demo/workshop/truth.json, SHA-256 " + "3b988efd" * 8)
    page.code("testbed add chip_force_exponent -m demo/workshop/model.yaml -c demo/workshop/campaign.yaml -o better.yaml")
    page.table(("parameter", "believed", "found", "truth"), [("tangential_coefficient", *["627.69 N/mm^2"] * 3)])
    page.figure(Panel([{"type": "scatter", "x": [1.0, 2.0], "y": [1.0, 2.0]}]))
    return page


@cache
def story() -> Page:
    """diagnose's page."""
    said = {"next_test": {"spindle_speed": 318.0, "depth_of_cut": 0.0018, "separates": [EFFECT, OTHER]}}
    return diagnosis_page(diagnosis(), said, BELIEVED, CATALOGUE, UNITS)


@cache
def added() -> Page:
    """add's page."""
    return addition_page(addition(), records(), BELIEVED, UNITS)
