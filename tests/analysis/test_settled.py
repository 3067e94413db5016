"""The last fit of a set is followed to its end: a short one of a round may have stopped half way along its valley."""

from dataclasses import replace
from functools import partial

from campaign_files import BELIEVED, TRUE
from synthetic_campaign import synthetic_campaign

from analysis.fit.observed import observe
from analysis.search.begun_anew import from_believed
from analysis.search.candidate_round import candidate_of
from analysis.search.settled import settled
from testbed.catalogue import catalogue
from testbed.cli._fitting import plant_of
from testbed.engines import fast

KNOWN = catalogue()


def test_a_set_that_has_not_converged_is_fitted_to_its_end():
    bent = TRUE.with_effect("edge_force", tangential=6e4, normal=3e4)
    records = synthetic_campaign(partial(fast.simulate, steps=61), bent, seed=4, rate=6400.0, tests=((3500, 1.2),))
    observed = [observe(one, BELIEVED) for one in records]
    ended = from_believed(plant_of(KNOWN), observed, BELIEVED, ["edge_force"], KNOWN)
    assert ended.converged and settled(ended, KNOWN) is ended
    model = ended.fit.state.model.with_values({"edge_force.tangential": 2e4, "natural_frequency": 146.9})
    short = ended.fitter.fit(replace(ended.fit.state, model=model), iterations=1)
    assert not short.converged and short.cost > 1.1 * ended.fit.cost
    given = replace(candidate_of(ended.fitter, short, ("edge_force",), None, 1.0), delta_bic=77.0)
    found = settled(given, KNOWN)
    assert found.converged and found.fit.cost < 1.001 * ended.fit.cost
    assert found.effects == ("edge_force",) and found.delta_bic == 77.0
    assert found.error_held_out < given.error_held_out
