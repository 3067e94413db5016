"""A swing of the spindle's speed that turns it by more than a tooth's arc, started from a tachometer's marks."""

import math
from functools import partial

import numpy as np
import pytest

from testbed.analysis.fit.effect_start import all_free
from testbed.analysis.fit.free_vibration_start import Clock, free_vibration_fit, marks_show, swing_clocks
from testbed.analysis.fit.model_fit import model_fit
from testbed.analysis.fit.observe import observe
from testbed.analysis.search.add_effect import add_effect
from testbed.analysis.search.diagnose import diagnose
from testbed.api.fitting import engine_of
from testbed.catalogue import catalogue
from testbed.engines import fast
from tests.support.campaign_files import BELIEVED, TRUE
from tests.support.synthetic_campaign import TESTS, begun_later, synthetic_record

AMPLITUDE, FREQUENCY = 0.05, 4.0
PHASES = (-2.0, 0.4)
IDLE, SINCE = 12, 7  # revolutions before the entry, and from the entry to where a record starts that starts within its cut
SWING = catalogue()["speed_variation"]


def swung_record(number, rpm, depth, phase):
    true = TRUE.with_effect("speed_variation", amplitude=AMPLITUDE, frequency=FREQUENCY, phase=phase)
    return synthetic_record(partial(fast.simulate, steps=97), true, rpm, depth * 1e-3, 70 + number, course=(IDLE, 45, 20),
                            rate=6400.0)  # fmt: skip


@pytest.fixture(scope="module")
def records():
    cuts = zip(TESTS, PHASES, strict=False)
    return [observe(swung_record(number, *cut, phase), BELIEVED) for number, (cut, phase) in enumerate(cuts)]


def test_a_clock_turns_at_its_own_speed():
    clock = Clock(zero=0.3, angle=1.0, speed=400.0, phase=0.7, amplitude=0.05, frequency=4.0)
    time = np.linspace(0.0, 1.0, 20001)
    rate = np.gradient(clock.angle_at(time), time)
    expected = 400.0 * (1 + 0.05 * np.sin(2 * math.pi * 4.0 * (time - 0.3) + 0.7))
    assert np.abs(rate - expected)[1:-1].max() < 1e-4 * 400.0
    assert clock.angle_at(clock.time_of(123.4)) == pytest.approx(123.4, abs=1e-9)


def test_marks_tell_amplitude_and_frequency(records):
    assert not marks_show(SWING, records)  # the speed is measured: nothing is left for the effect
    clocks = swing_clocks([record.at_constant_speed() for record in records], SWING)
    for clock in clocks:
        assert clock.amplitude == pytest.approx(AMPLITUDE, rel=1e-3)
        assert clock.frequency == pytest.approx(FREQUENCY, rel=1e-3)


@pytest.mark.parametrize("time_constant", [0.05, 0.2, 1.0])
@pytest.mark.parametrize("count", [1, 2, 4])
def test_marks_that_follow_no_sinusoid_are_not_believed(count, time_constant):
    true = TRUE.with_effect("speed_droop", droop=0.1, time_constant=time_constant)
    made = [synthetic_record(partial(fast.simulate, steps=61), true, rpm, depth * 1e-3, 75 + number, course=(12, 45, 20))
            for number, (rpm, depth) in enumerate(TESTS[:count])]
    observed = [observe(record, BELIEVED).at_constant_speed() for record in made]
    assert observed[0].measured is not None and not marks_show(SWING, observed)


@pytest.mark.long
def test_a_cut_whose_entry_still_dies_away_keeps_its_beginning(records):
    late = observe(begun_later(swung_record(2, 3900, 2.2, 1.0), IDLE + SINCE), BELIEVED)
    opened = [record.at_constant_speed() for record in (*records, late)]
    model = BELIEVED.with_effect("speed_variation", amplitude=0.03, frequency=5.0, phase=0.0)
    free = all_free(opened, model, catalogue())
    _, fit = free_vibration_fit(engine_of(catalogue()), opened, model, [SWING], free)
    assert late.starts_in_cut and fit.state.nuisances[-1].entry > opened[-1].first_simulated
    assert fit.mean_squares.max() < 1.05


@pytest.mark.long
def test_the_effect_is_added_and_then_compared(records):
    engine = engine_of(catalogue())
    found = add_effect(engine, records, BELIEVED, SWING, catalogue())
    assert found.after < 1.03 * found.noise_floor < 0.1 * found.before
    amplitude, frequency = (found.parameters[f"speed_variation.{name}"] for name in ("amplitude", "frequency"))
    assert amplitude.value == pytest.approx(AMPLITUDE, rel=2e-4) and amplitude.high - amplitude.low < 1e-4
    assert frequency.value == pytest.approx(FREQUENCY, rel=1e-4)
    assert found.model.cutting.tangential_coefficient == pytest.approx(TRUE.cutting.tangential_coefficient, rel=0.05)
    opened = [record.at_constant_speed() for record in records]
    believed = BELIEVED.with_effect("speed_variation", amplitude=0.03, frequency=5.0, phase=0.0)
    assert model_fit(engine, opened, believed, catalogue())[1].mean_squares.max() < 1.05


@pytest.mark.long
def test_it_is_named(records):
    found = diagnose(engine_of(catalogue()), records, BELIEVED, catalogue())
    assert (found.verdict, found.effects) == ("missing_effect", ("speed_variation",))
    assert "tachometer" in found.sentence
