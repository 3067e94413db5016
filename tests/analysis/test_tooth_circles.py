"""Offset and direction of a runout: two teeth tell one number of both, three tell both, and none of them which is the first."""

import math
from dataclasses import replace
from functools import partial

import pytest

from testbed.analysis.comparison.compare import compare
from testbed.analysis.fit.estimates import estimates
from testbed.analysis.fit.model_fit import model_fit
from testbed.analysis.fit.observe import observe
from testbed.analysis.fit.tooth_circles import at_least_strength, direction_notes, unknown_directions
from testbed.analysis.fit.waveform import Fitter
from testbed.api.fitting import plant_of
from testbed.catalogue import catalogue
from testbed.engines import fast
from testbed.machine import Cutter, Cutting, Model, Structure
from tests.support.synthetic_campaign import synthetic_record

KNOWN = catalogue()
OFFSET, ANGLE = 8.0e-6, 1.2
BELIEVED = {"offset": 6.0e-6, "angle": 1.4}


def machine(flutes: int, **runout: float) -> Model:
    cutting = Cutting("up-milling", 0.12, 7.2e8, 2.6e8)
    return Model(Structure(1.13, 208.4, 0.0085), Cutter(flutes, 0.016), cutting, effects={"runout": runout})


def measured(flutes: int, *, offset: float = OFFSET, angle: float = ANGLE) -> list:
    true, believed = machine(flutes, offset=offset, angle=angle), machine(flutes, **BELIEVED)
    made = [synthetic_record(partial(fast.simulate, steps=97), true, rpm, depth * 1e-3, 80 + number, noise=3e-7, feed=8e-5,
                             rate=20000.0, course=(6, 25, 8)) for number, (rpm, depth) in enumerate(((3300, 0.6), (2600, 0.4)))]
    return [observe(one, believed) for one in made]


def test_the_direction_is_one_number_with_the_offset_for_one_and_two_teeth_alone():
    told = {flutes: unknown_directions(machine(flutes, **BELIEVED), KNOWN) for flutes in (1, 2, 3, 4)}
    pair = {"runout": ("offset", "angle")}
    assert told == {1: pair, 2: pair, 3: {}, 4: {}}


@pytest.mark.parametrize(("true", "to"), [(1.2, 0.0), (2.0, math.pi)])
def test_two_teeth_are_given_the_least_offset_to_the_longer_one_and_any_direction(true, to):
    records, start = measured(2, angle=true), machine(2, offset=6.0e-6, angle=true + 0.2)
    fitter, fit = model_fit(plant_of(KNOWN), records, start, KNOWN)
    held, least = at_least_strength(fitter, fit, KNOWN)
    assert estimates(fitter, fit, KNOWN) == estimates(held, least, KNOWN)
    along = OFFSET * abs(math.cos(true))
    assert fit.state.model.effects["runout"]["offset"] > 1.5 * along  # where the valley was entered, not what is known
    assert least.cost == pytest.approx(fit.cost, rel=1e-4)
    found = estimates(held, least, KNOWN)
    offset, angle = found["runout.offset"], found["runout.angle"]
    assert offset.value == pytest.approx(along, rel=0.01) and offset.low <= along and offset.high == 5.0e-4
    assert offset.value - offset.low < 0.01 * along  # the number itself is well known
    assert angle.value == to and (angle.low, angle.high) == (-2 * math.pi, 2 * math.pi)
    assert "are one number with so few flutes (2)" in direction_notes(held, least.state.model, KNOWN)[0]


def test_a_fit_that_begins_at_the_least_offset_has_its_interval_too():
    """As of the model that `add` wrote; the direction, free in that fit, is none of the parameters that it tells."""
    along = OFFSET * math.cos(ANGLE)
    fitter, fit = model_fit(plant_of(KNOWN), measured(2), machine(2, offset=along, angle=0.0), KNOWN)
    held, least = at_least_strength(fitter, replace(fit, state=replace(fit.state, model=machine(2, offset=along, angle=0.0))),
                                    KNOWN)
    assert held.names == least.names and "runout.angle" in fit.names and "runout.angle" not in least.names
    offset = estimates(fitter, fit, KNOWN)["runout.offset"]
    assert offset.low <= along and offset.value - offset.low < 0.01 * along


def test_three_teeth_tell_both_and_without_a_tachometer_not_from_which():
    records, start = measured(3), machine(3, **BELIEVED)
    result = compare(plant_of(KNOWN), records, start, KNOWN)
    angle = result.parameters["runout.angle"]
    assert angle.low <= ANGLE <= angle.high and angle.high - angle.low < 0.1
    assert direction_notes(result.fitter, result.fit.state.model, KNOWN) == []
    unmarked = Fitter(plant_of(KNOWN), [replace(one, first_mark=None) for one in result.fitter.records], result.fitter.free)
    (said,) = direction_notes(unmarked, result.fit.state.model, KNOWN)
    assert "whole pitches of 120 deg" in said


def test_of_an_offset_that_may_be_none_the_direction_is_unknown():
    records, start = measured(3, offset=0.0), machine(3, offset=1e-7, angle=0.5)
    fitter, fit = model_fit(plant_of(KNOWN), records, start, KNOWN)
    found = estimates(fitter, fit, KNOWN)
    assert found["runout.offset"].low == 0.0
    assert (found["runout.angle"].low, found["runout.angle"].high) == (-2 * math.pi, 2 * math.pi)
