"""Empirical multipliers of simulated transients against the model's."""

import math
from dataclasses import replace

import numpy as np
import pytest

from testbed.analysis.linear.collocation import collocation_multipliers
from testbed.analysis.linear.delay_equation import milling_equation
from testbed.analysis.multipliers.belief import foreign_modes
from testbed.analysis.multipliers.floquet import (
    delay_embedding_multipliers,
    empirical_multipliers,
    once_per_period_samples,
    revolution_period,
    tooth_period,
)
from testbed.analysis.multipliers.multiplier_fit import fit_multipliers
from testbed.cut import Cut
from testbed.machine import Cutter, Cutting, Model, Structure
from testbed.recording import Recording
from tests.support.independent_simulator import simulate

MASS, GAMMA = 2.573, 2.16e8
PAPER = Model(Structure(MASS, 921.1 / (2 * math.pi), 0.0032), Cutter(),
              Cutting("up-milling", 0.162, GAMMA * MASS, 0.3 * GAMMA * MASS))


def rpm(speed, depth_mm, passes=60):
    return Cut(speed * 2 * math.pi / 60, depth_mm * 1e-3, idle_passes=3, passes=passes)


def truth(cut, model=PAPER):
    return collocation_multipliers(milling_equation(model, cut))


@pytest.mark.parametrize(("speed", "depth"), [(3810, 2.9), (2850, 2.9), (4100, 2.2), (3565, 2.1), (3635, 2.0)])
def test_without_noise_the_largest_multiplier_is_exact_in_stable_and_growing_cuts(speed, depth):
    cut = rpm(speed, depth, 40)
    found = empirical_multipliers(simulate(PAPER, cut, offset=1e-5, drift=2e-6))
    assert found.believed
    assert found.rank >= 2
    assert abs(found.multipliers[0] - truth(cut)[0]) < 1e-4


@pytest.mark.parametrize(("speed", "depth"), [(3810, 2.9), (2850, 2.9)])
def test_half_a_micrometre_of_noise_costs_less_than_five_thousandths(speed, depth):
    cut = rpm(speed, depth)
    exact = truth(cut)[0]
    scaled, errors = [], []
    for seed in range(10):
        found = empirical_multipliers(simulate(PAPER, cut, noise=5e-7, seed=seed, offset=1e-5, drift=2e-6))
        assert found.believed
        assert found.noise == pytest.approx(5e-7, rel=0.15)
        errors.append(abs(found.multipliers[0] - exact))
        scaled.append(errors[-1] / found.standard_errors[0])
    assert math.sqrt(np.mean(np.square(errors))) < 0.0025
    assert 0.3 < math.sqrt(np.mean(np.square(scaled))) < 1.6  # the standard errors are neither wishful nor idle


def test_the_plain_jacobian_of_four_delays_suffers_from_noise_and_the_fit_does_not():
    cut = rpm(3810, 2.9)
    exact, plain, fitted = truth(cut)[0], [], []
    for seed in range(10):
        record = simulate(PAPER, cut, noise=5e-7, seed=seed)
        samples = once_per_period_samples(record, cut.tooth_passing_period(1), record.conditions["entry_time"],
                                          record.conditions["exit_time"], 32)[:20]
        plain.append(np.abs(delay_embedding_multipliers(samples[:, ::8], 4) - exact).min())
        start = delay_embedding_multipliers(samples, 3)
        fitted.append(np.abs(fit_multipliers(samples, start).multipliers - exact).min())
    rms = [math.sqrt(np.mean(np.square(errors))) for errors in (plain, fitted)]
    assert rms[0] > 0.01
    assert rms[1] < 0.004


def test_several_flutes_are_sampled_once_per_tooth():
    model = Model(PAPER.structure, Cutter(2), PAPER.cutting)
    cut = rpm(3810 / 2, 2.0, 50)
    found = empirical_multipliers(simulate(model, cut), flutes=2)
    assert found.period == pytest.approx(cut.tooth_passing_period(2), rel=1e-9)
    assert abs(found.multipliers[0] - truth(cut, model)[0]) < 2e-4


def test_growing_cut_is_read_up_to_the_loss_of_contact():
    cut = rpm(3635, 2.0, 60)
    record = simulate(PAPER, cut, contact_loss=True, noise=5e-7)
    found = empirical_multipliers(record)
    assert found.believed
    assert 10 <= found.periods <= 30  # 60 are recorded
    assert abs(found.multipliers[0] - truth(cut)[0]) < 2e-3
    everything = once_per_period_samples(record, found.period, record.conditions["entry_time"], 10.0, 64)
    naive = delay_embedding_multipliers(everything, 3)
    assert abs(naive[0] - truth(cut)[0]) > 0.05


def test_contact_lost_at_once_is_not_believed():
    found = empirical_multipliers(simulate(PAPER, rpm(3050, 2.7), contact_loss=True))
    assert not found.believed
    assert "periods" in found.reason


def test_noise_alone_is_not_believed():
    random = np.random.default_rng(3)
    record = Recording({"displacement": 1e-6 * random.standard_normal(12800)}, 12800.0, {"displacement": "m"},
                       "measured", marks=np.arange(0.003, 1.0, 0.0157))
    found = empirical_multipliers(record)
    assert not found.believed
    assert "no motion" in found.reason


def test_bootstrap_agrees_with_the_linearised_covariance_and_is_repeatable():
    record = simulate(PAPER, rpm(3810, 2.9), noise=5e-7, seed=4)
    plain = empirical_multipliers(record, delays=32)
    boot = empirical_multipliers(record, delays=32, bootstrap=60, seed=1)
    again = empirical_multipliers(record, delays=32, bootstrap=60, seed=1)
    np.testing.assert_array_equal(boot.covariance, again.covariance)
    assert boot.standard_errors[0] == pytest.approx(plain.standard_errors[0], rel=0.35)
    assert plain.modulus_low[0] < abs(plain.multipliers[0]) < plain.modulus_high[0]


def test_fixed_point_is_the_periodic_motion():
    cut = rpm(3810, 2.9, 100)
    record = simulate(PAPER, cut)
    found = empirical_multipliers(record, drift=False)
    late = once_per_period_samples(record, found.period, record.conditions["entry_time"] + 90 * found.period,
                                   record.conditions["exit_time"], found.samples.shape[1])[0]
    assert np.ptp(late) > 1e-5
    np.testing.assert_allclose(found.fixed_point, late, atol=2e-8)


def test_period_comes_from_marks_even_when_some_are_missing():
    marks = 0.4 + 0.0157 * np.delete(np.arange(200), [3, 50, 51, 120])
    jitter = 1e-6 * np.random.default_rng(0).standard_normal(marks.size)
    assert revolution_period(marks + jitter) == pytest.approx(0.0157, rel=1e-6)
    with pytest.raises(ValueError, match="three"):
        revolution_period(marks[:2])
    record = simulate(PAPER, rpm(3810, 2.9, 10))
    assert tooth_period(record) == pytest.approx(60 / 3810, rel=1e-12)


def test_too_short_a_cut_is_refused():
    with pytest.raises(ValueError, match="periods"):
        empirical_multipliers(simulate(PAPER, rpm(3810, 2.9, 4)))
    with pytest.raises(ValueError, match="periods"):
        fit_multipliers(np.random.default_rng(0).standard_normal((5, 32)), np.array([0.5, 0.4, 0.3]))


@pytest.mark.parametrize(("frequency", "flutes", "sizes"), [
    (50.0, 1, (5e-7, 1e-6)), (0.35, 1, (2e-6, 2e-5)), (3810 / 120, 2, (2e-6, 2e-5))])
def test_what_goes_on_beside_the_cut_is_no_multiplier(frequency, flutes, sizes):
    cut = rpm(3810, 2.9)  # its tooth passes 63.5 times a second; half of that is what two unequal teeth repeat
    recording = simulate(PAPER, cut, noise=2e-7, seed=3)
    for size in sizes:
        beside = size * np.sin(2 * math.pi * frequency * recording.time + 0.4)
        disturbed = replace(recording, channels={"displacement": recording.channels["displacement"] + beside})
        found = empirical_multipliers(disturbed, flutes=flutes, period=tooth_period(recording))
        assert found.believed and abs(found.multipliers[0] - truth(cut)[0]) < 0.01
    assert "no transient" in found.reason


def test_modes_that_are_not_the_linear_machines():
    strong = 0.7 * np.exp(1.1j)
    modes = np.array([strong, strong.conjugate(), strong**2, abs(strong) ** 2, -0.5 + 0.866j, 0.985, 0.8, np.exp(0.3j)])
    strength = np.array([1.0, 1.0, 0.1, 0.1, 0.5, 0.5, 0.1, 0.5])
    assert sorted(foreign_modes(modes, strength, 3)) == [2, 3, 4, 5, 7]
    assert sorted(foreign_modes(modes, np.ones(8), 1)) == [4, 5, 7]
