"""The five published experiments: observed, by multipliers, and by the simulated once-per-tooth samples."""

import numpy as np
import pytest

from testbed.analysis.linear.published import PUBLISHED, linear_multipliers, linear_verdict
from testbed.analysis.multipliers.verdict import once_per_tooth_samples, simulated_verdict
from testbed.cut import Cut, whole_cut_sampling
from testbed.engines import fast, mujoco_engine
from testbed.scenario.scenario_file import read_scenario
from testbed.sensors.chain import ChannelSensor, SensorChain
from tests.validation.claims import PAPER

LARGEST = {"A": 1.15886, "B": 1.01256, "C": 1.10151, "D": 0.79776, "E": 0.69121}  # Chebyshev collocation, 24 nodes
CHAIN = SensorChain({"displacement": ChannelSensor(0.5e-6, 16, 2e-3)}, mark_angle=0.7)


def cut_of(test, passes):
    return Cut(test.spindle_speed, test.axial_depth_of_cut, passes=passes)


@pytest.mark.parametrize("test", PUBLISHED, ids=lambda test: test.name)
def test_the_published_outcome_comes_from_multipliers_and_from_samples(test):
    assert np.abs(linear_multipliers(PAPER, test)[0]) == pytest.approx(LARGEST[test.name], abs=1e-5)
    assert linear_verdict(PAPER, test) == test.outcome
    cut = cut_of(test, 240)
    predicted = fast.simulate(PAPER.with_effect("contact_loss"), cut, whole_cut_sampling(cut, 1, 12_800.0), steps=60)
    samples = once_per_tooth_samples(CHAIN.apply(predicted, np.random.default_rng(1)))
    assert 235 <= samples.size <= 240 and np.ptp(samples) > 30e-6
    verdict = simulated_verdict(samples, noise=0.5e-6)
    assert verdict.outcome == test.outcome, verdict


def test_the_angle_of_a_closed_curve_is_that_of_the_multiplier_near_the_limit():
    test = PUBLISHED[1]
    cut = cut_of(test, 240)
    predicted = fast.simulate(PAPER.with_effect("contact_loss"), cut, whole_cut_sampling(cut, 1, 12_800.0), steps=60)
    verdict = simulated_verdict(once_per_tooth_samples(predicted))
    linear = np.abs(np.angle(linear_multipliers(PAPER, test)[0]))
    assert verdict.rotation == pytest.approx(linear, abs=0.06)  # a finite motion turns a little otherwise


def test_mujoco_shows_the_published_flip():
    test, cut = PUBLISHED[2], cut_of(PUBLISHED[2], 160)
    predicted = mujoco_engine.simulate(PAPER.with_effect("contact_loss"), cut, whole_cut_sampling(cut, 1, 12_800.0))
    verdict = simulated_verdict(once_per_tooth_samples(predicted))
    assert verdict.outcome == test.outcome and verdict.alternation > 30e-6


def test_the_rig_s_scenario_holds_the_published_tests():
    scenario = read_scenario("rig_published")
    points = [(test.spindle_speed, test.axial_depth_of_cut) for test in PUBLISHED]
    assert np.array([(test.spindle_speed, test.axial_depth_of_cut) for test in scenario.tests]) \
        == pytest.approx(np.array(points), rel=1e-12)
    assert scenario.model.machine == "flexure" and "contact_loss" in scenario.model.effects


TEETH = np.arange(200)
RANDOM = np.random.default_rng(4)
MOTIONS = {
    "a decay": (30 * 0.9**TEETH * np.cos(2.0 * TEETH) + 5, "stable"),
    "a slow decay": (30 * 0.985**TEETH * np.cos(2.0 * TEETH) + 5, "stable"),
    "a decay too slow to tell": (30 * 0.994**TEETH * np.cos(2.0 * TEETH), "undecided"),
    "an alternation too slow to tell": (30 * (-0.994) ** TEETH, "undecided"),
    "no motion": (np.full(200, 3.0), "stable"),
    "noise about one value": (0.5 * RANDOM.standard_normal(200), "stable"),
    "two values": (10.0 * (-1.0) ** TEETH + 3, "flip"),
    "a growing alternation": (0.5 * (-1.03) ** TEETH, "flip"),
    "a closed curve": (40 * np.cos(0.6 * TEETH) + 8 * np.cos(1.2 * TEETH), "neimark_sacker"),
    "a curve near the flip": (40 * np.cos(2.9 * TEETH), "neimark_sacker"),
    "a growing spiral": (5 * 1.01**TEETH * np.cos(0.6 * TEETH), "neimark_sacker"),
    "noise where little is expected": (20 * RANDOM.standard_normal(200), "undecided"),
    "a drift": (1.0 * TEETH, "undecided"),
    "too few teeth": (30 * 0.9 ** TEETH[:30], "undecided"),
    "a run that diverged": (np.where(TEETH < 150, 10.0, np.nan), "undecided"),
}


@pytest.mark.parametrize("name", sorted(MOTIONS))
def test_the_rule_on_made_motions(name):
    samples, expected = MOTIONS[name]
    noisy = samples + 0.2 * np.random.default_rng(1).standard_normal(samples.size)
    verdict = simulated_verdict(noisy, noise=0.5)
    assert verdict.outcome == expected, verdict
    assert simulated_verdict(-3e-6 * noisy, noise=1.5e-6).outcome == expected  # neither unit nor sign matter
