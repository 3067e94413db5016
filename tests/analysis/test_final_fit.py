"""The last fit of a set is followed to its end: a short one of a round may have stopped half way along its valley."""

from dataclasses import replace

from testbed.analysis.search.candidate_round import candidate_of
from testbed.analysis.search.final_fit import settled
from tests.support.short_round import KNOWN, fitted


def test_a_set_that_has_not_converged_is_fitted_to_its_end():
    ended = fitted("edge_force")
    assert ended.converged and settled(ended, KNOWN) is ended
    model = ended.fit.state.model.with_values({"edge_force.tangential": 2e4, "natural_frequency": 146.9})
    short = ended.fitter.fit(replace(ended.fit.state, model=model), iterations=1)
    assert not short.converged and short.cost > 1.1 * ended.fit.cost
    given = replace(candidate_of(ended.fitter, short, ("edge_force",), None, 1.0), delta_bic=77.0)
    found = settled(given, KNOWN)
    assert found.converged and found.fit.cost < 1.001 * ended.fit.cost
    assert found.effects == ("edge_force",) and found.delta_bic == 77.0
    assert found.error_held_out < given.error_held_out


def test_an_effect_that_ends_at_nothing_is_not_kept_beside_others():
    both = fitted("tool_wear", "edge_force")
    place = both.fit.names.index("tool_wear.rate")
    assert abs(both.fit.state.model.value("tool_wear.rate")) < 3.0 * both.fit.covariance[place, place] ** 0.5
    found = settled(both, KNOWN)
    assert found.effects == ("edge_force",) and set(found.parameters) == {"edge_force.tangential", "edge_force.normal"}
    alone = fitted("edge_force")
    assert settled(alone, KNOWN).effects == ("edge_force",)  # of one alone it is not asked
