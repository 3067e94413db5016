"""Campaigns of the outside simulator in which the courses of a few cuts had led the fit of all astray."""

from dataclasses import replace

import numpy as np
import pytest

from testbed.analysis.fit import waveform
from testbed.analysis.fit.effect_start import extended
from testbed.analysis.fit.model_fit import model_fit
from testbed.analysis.fit.moves import PARTS
from testbed.analysis.fit.solve import alternate_fit_and_passes, solve
from testbed.api.fitting import engine_of, read_both
from testbed.catalogue import catalogue
from tests.validation.outside.files import write
from tests.validation.outside.plan import draw

pytestmark = pytest.mark.long
KNOWN = catalogue()


def fit_of(seed, folder, known=False, guessed=()):
    """(plan, fitter, fit) of the believed model to a campaign of the outside simulator.

    known: with what is hidden in it; guessed: names of effects that start at their examples.
    """
    plan = draw(seed)
    write(plan, folder)
    model, records, _ = read_both(str(folder / "campaign.yaml"), str(folder / "model.yaml"), KNOWN)
    for name, values in plan.hidden.items() if known else ():
        model = model.with_effect(name, **values)
    for name in guessed:
        model = model.with_effect(name, **KNOWN[name].example())
    return plan, *model_fit(engine_of(KNOWN), records, model, KNOWN)


def within(fit, true, sigmas):
    """Whether the machine's parameters are as near to their true values as their standard errors say."""
    errors = dict(zip(fit.names, np.sqrt(np.diag(fit.covariance)), strict=True))
    return all(abs(fit.state.model.value(name) - value) < sigmas * errors[name] for name, value in true.items())


def test_cuts_near_their_limit_that_begin_within_an_arc_are_found_again(tmp_path):
    """No tachometer; one record begins with a ring near a line of the mains, four begin or end within an arc."""
    plan, _, fit = fit_of(41, tmp_path)
    assert fit.mean_squares.max() < 1.1
    assert within(fit, {"natural_frequency": plan.base.omega / (2 * np.pi), "damping_ratio": plan.base.zeta,
                        "tangential_coefficient": plan.base.kt, "normal_coefficient": plan.base.kn}, 4.0)  # fmt: skip


def test_parts_of_passes_that_made_up_for_an_effect_are_given_up_with_it(tmp_path, monkeypatch):
    """An arc of engagement 4 % too long had two cuts begin and end elsewhere; with it, they held it at half its size.

    Where ends at the edge of their arc stay there, a record keeps 1.18.
    """
    plan, fitter, fit = fit_of(48, tmp_path)
    wider = extended(fitter, KNOWN["immersion_error"])
    state = replace(fit.state, model=fit.state.model.with_effect("immersion_error", error=0.01))
    with monkeypatch.context() as held:
        held.setattr(waveform, "EDGE", 0.0)
        assert alternate_fit_and_passes(wider, state).mean_squares.max() > 1.1
    _, found = solve(wider, alternate_fit_and_passes(wider, state), PARTS)
    assert found.mean_squares.max() < 1.06
    assert within(found, {"immersion_error.error": plan.hidden["immersion_error"]["error"],
                          "tangential_coefficient": plan.base.kt, "normal_coefficient": plan.base.kn}, 4.0)  # fmt: skip


def test_sudden_entries_a_little_late_do_not_hold_the_tooth_angle(tmp_path):
    """Four entries at their full chip, each 2 % of a pass late by an angle that they hold: adequate, and 12 % off."""
    plan, _, fit = fit_of(62, tmp_path)
    assert fit.mean_squares.max() < 1.05
    assert within(fit, {"natural_frequency": plan.base.omega / (2 * np.pi), "damping_ratio": plan.base.zeta,
                        "tangential_coefficient": plan.base.kt, "normal_coefficient": plan.base.kn}, 4.0)  # fmt: skip


@pytest.mark.parametrize("seed", [57, 68], ids=["slow cuts that end within an arc", "half of the records three passes off"])
def test_with_the_right_effects_the_records_come_to_their_noise(seed, tmp_path):
    """A loud ring before the cut, and arcs that hold four swings; or ends further off than passes are looked for."""
    plan, _, fit = fit_of(seed, tmp_path, known=True)
    assert fit.mean_squares.max() < 1.2
    hidden = {f"{name}.{key}": value for name, values in plan.hidden.items() for key, value in values.items()}
    assert within(fit, {"tangential_coefficient": plan.base.kt, "normal_coefficient": plan.base.kn, **hidden}, 4.0)


def test_an_arc_of_engagement_is_come_to_from_beyond_too(tmp_path):
    """All cuts of slow teeth begin and end within an arc that is longer by a quarter; whole passes hold it at 0.255."""
    plan, _, fit = fit_of(95, tmp_path, guessed=("immersion_error",))
    assert np.median(fit.mean_squares) < 1.3 and fit.mean_squares.max() < 3.0  # the tool wears, too
    found = fit.state.model.value("immersion_error.error")
    assert found == pytest.approx(plan.hidden["immersion_error"]["error"], abs=0.004)
