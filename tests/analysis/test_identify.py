"""Identification from multipliers: recovery from the paper's start, intervals, honesty about what cannot be used."""

import math
from dataclasses import replace

import numpy as np
import pytest

from testbed.analysis.linear.collocation import collocation_multipliers
from testbed.analysis.linear.delay_equation import milling_equation
from testbed.analysis.multipliers.floquet import EmpiricalMultipliers
from testbed.analysis.multipliers.identify import identify, identify_multipliers
from testbed.analysis.multipliers.recorded_cut import cut_bounds, started_from_ring_down
from testbed.cut import Cut
from testbed.machine import Cutter, Cutting, Model, Structure
from testbed.recording import Recording
from tests.support.independent_simulator import simulate

MASS = 2.573


def machine(zeta, omega, gamma, immersion=0.162):
    return Model(Structure(MASS, omega / (2 * math.pi), zeta), Cutter(),
                 Cutting("up-milling", immersion, gamma * MASS, 0.3 * gamma * MASS))


TRUTH, PAPER_START = machine(0.0032, 921.1, 2.16e8), machine(0.0032, 930.0, 5.0e8)
CUTS = [Cut(speed * 2 * math.pi / 60, depth * 1e-3, idle_passes=3, passes=50)
        for speed, depth in ((3810, 2.9), (2850, 2.9), (4100, 2.2))]


def records(noise=0.0, seed=0):
    return [(simulate(TRUTH, cut, noise=noise, seed=100 * seed + i, offset=1e-5, drift=2e-6), cut)
            for i, cut in enumerate(CUTS)]


def exact(cut, model=TRUTH, count=2, error=1e-3):
    """Model multipliers dressed as a measurement."""
    values = collocation_multipliers(milling_equation(model, cut))[:count]
    return EmpiricalMultipliers(values, error**2 * np.eye(2 * count), np.abs(values), np.abs(values), 0.0, np.zeros(1),
                                np.zeros((20, 1)), 1.0, 0, 0.0, True, "given")


def test_clean_transients_give_the_truth_from_the_papers_start():
    found = identify(PAPER_START, records())
    values = found.parameters
    assert found.converged
    assert values["damping_ratio"].value == pytest.approx(0.0032, rel=0.01)
    assert values["natural_frequency"].value * 2 * math.pi == pytest.approx(921.1, abs=0.1)
    assert values["tangential_coefficient"].value == pytest.approx(2.16e8 * MASS, rel=0.005)
    ratio = values["normal_coefficient"].value / values["tangential_coefficient"].value
    assert ratio == pytest.approx(0.3, rel=1e-12)
    for test in found.tests:
        assert test.used
        assert abs(test.measured[0] - test.model[0]) < 1e-3


def test_noisy_transients_stay_within_the_targets_and_the_intervals():
    errors, inside = [], []
    for seed in range(4):
        found = identify(PAPER_START, records(5e-7, seed)).parameters
        errors.append([found["damping_ratio"].value / 0.0032 - 1,
                       found["natural_frequency"].value * 2 * math.pi - 921.1,
                       found["tangential_coefficient"].value / (2.16e8 * MASS) - 1])
        inside += [found[name].low < TRUTH.value(name) < found[name].high
                   for name in ("damping_ratio", "natural_frequency", "tangential_coefficient")]
        assert found["damping_ratio"].high - found["damping_ratio"].low < 0.0005
    rms = np.sqrt(np.mean(np.square(errors), axis=0))
    assert rms[0] < 0.05
    assert rms[1] < 0.15
    assert rms[2] < 0.01
    assert np.mean(inside) > 0.75


@pytest.mark.parametrize("start", [(0.0032, 930.0, 5.0e8), (0.03, 900.0, 1e8), (0.001, 940.0, 6e8), (0.01, 921.0, 3e8)])
def test_complex_multipliers_lead_home_from_far_starts(start):
    found = identify_multipliers(machine(*start), CUTS, [exact(cut) for cut in CUTS])
    assert found.model.structure.damping_ratio == pytest.approx(0.0032, rel=0.005)
    assert found.model.structure.natural_frequency_rad == pytest.approx(921.1, abs=0.01)
    assert found.model.cutting.tangential_coefficient == pytest.approx(2.16e8 * MASS, rel=1e-3)


def test_growing_and_real_multipliers_count_too():
    cuts = [Cut(speed * 2 * math.pi / 60, depth * 1e-3) for speed, depth in ((3635, 2.0), (3565, 2.1), (2850, 2.9))]
    found = identify_multipliers(PAPER_START, cuts, [exact(cut) for cut in cuts])
    assert found.model.structure.natural_frequency_rad == pytest.approx(921.1, abs=0.01)
    assert found.model.cutting.tangential_coefficient == pytest.approx(2.16e8 * MASS, rel=1e-3)


def test_a_wrong_immersion_shows_in_the_misfit():
    wrong = machine(0.0032, 921.1, 2.16e8, immersion=0.108)
    right = identify_multipliers(TRUTH, CUTS, [exact(cut) for cut in CUTS])
    found = identify_multipliers(wrong, CUTS, [exact(cut) for cut in CUTS])
    assert right.chi_square < 0.1
    assert found.chi_square > 20
    assert found.model.cutting.tangential_coefficient > 1.6 * 2.16e8 * MASS


def test_what_hangs_on_the_ratio_of_the_coefficients_is_told():
    def with_ratio(ratio):
        start = replace(TRUTH, cutting=replace(TRUTH.cutting, normal_coefficient=ratio * TRUTH.cutting.tangential_coefficient))
        return identify_multipliers(start, CUTS, [exact(cut) for cut in CUTS])

    found, steeper = with_ratio(0.3), with_ratio(0.33)
    changed = steeper.model.cutting.tangential_coefficient / found.model.cutting.tangential_coefficient
    assert found.ratio_slope < -0.05
    assert np.log(changed) / np.log(1.1) == pytest.approx(found.ratio_slope, rel=0.1)


def test_a_doubtful_ratio_widens_the_intervals_by_what_hangs_on_it():
    measured = [exact(cut) for cut in CUTS]
    sure, doubtful = (identify_multipliers(TRUTH, CUTS, measured, ratio_doubt=doubt) for doubt in (0.0, 0.2))

    def error(found, name):
        return math.log(found.parameters[name].high / found.parameters[name].value) / 1.96

    for name, slope in (("tangential_coefficient", sure.ratio_slope), ("normal_coefficient", 1.0 + sure.ratio_slope)):
        assert error(doubtful, name) == pytest.approx(math.hypot(error(sure, name), 0.2 * slope), rel=1e-3)
    assert error(doubtful, "natural_frequency") < 1.2 * error(sure, "natural_frequency")


def test_unbelieved_tests_are_left_out_and_said():
    doubtful = EmpiricalMultipliers(np.array([2.0 + 0j]), np.eye(2), np.ones(1), np.ones(1), 0.0, np.zeros(1),
                                    np.zeros((9, 1)), 1.0, 0, 0.0, False, "it moves")
    found = identify_multipliers(TRUTH, CUTS, [exact(CUTS[0]), doubtful, exact(CUTS[2])])
    assert [test.used for test in found.tests] == [True, False, True]
    assert found.tests[1].reason == "it moves"
    assert found.model.structure.natural_frequency_rad == pytest.approx(921.1, abs=0.01)
    with pytest.raises(ValueError, match=r"test 2 \(it moves\)$"):
        identify_multipliers(TRUTH, CUTS[:2], [exact(CUTS[0]), doubtful])
    with pytest.raises(ValueError, match=r"tests left out: a \(it moves\), b .*, f \(it moves\), and 2 more$"):
        identify_multipliers(TRUTH, CUTS[:1] * 8, [doubtful] * 8, names="abcdefgh")


def test_one_test_that_contradicts_all_others_is_left_out():
    cuts = [*CUTS, Cut(3500 * 2 * math.pi / 60, 1.2e-3)]
    hum = replace(exact(cuts[3]), multipliers=np.array([-0.55 + 0.82j, -0.55 - 0.82j]))
    sound = [exact(cut) for cut in CUTS]
    found = identify_multipliers(PAPER_START, cuts, [*sound, hum])
    assert [test.used for test in found.tests] == [True, True, True, False]
    assert "contradicts the others" in found.tests[3].reason and found.chi_square < 1.0
    assert found.model.cutting.tangential_coefficient == pytest.approx(2.16e8 * MASS, rel=1e-3)
    few = identify_multipliers(PAPER_START, cuts[1:], [*sound[1:], hum])  # of three, none is the odd one
    assert all(test.used for test in few.tests) and few.chi_square > 10.0


def test_a_cut_too_short_is_left_out_like_one_not_believed():
    short = Cut(CUTS[1].spindle_speed, 2.9e-3, idle_passes=3, passes=4)
    tests = records()[:2]
    found = identify(PAPER_START, [tests[0], (simulate(TRUTH, short), short), tests[1]], starts=1, delays=32)
    assert [test.used for test in found.tests] == [True, False, True]
    assert "tooth periods in the cut; at least 6 are needed" in found.tests[1].reason
    assert found.tests[1].measured.size == 0 and found.tests[1].model.size == 2
    assert found.model.structure.natural_frequency_rad == pytest.approx(921.1, abs=0.1)
    with pytest.raises(ValueError, match=r"tests left out: the short one \(. tooth periods"):
        identify(PAPER_START, [(simulate(TRUTH, short), short)], names=["the short one"])


def test_same_seed_same_answer():
    one, two = (identify_multipliers(PAPER_START, CUTS, [exact(cut) for cut in CUTS], seed=5) for _ in range(2))
    assert one.parameters == two.parameters


def test_free_decay_after_a_cut_gives_the_start():
    cut = Cut(CUTS[0].spindle_speed, 2.9e-3, passes=30, ring_down_passes=60)
    far = machine(0.03, 990.0, 5e8)
    started = started_from_ring_down(far, [(simulate(TRUTH, cut, noise=5e-7, offset=1e-5), cut)])
    assert started.structure.natural_frequency_rad == pytest.approx(921.1, rel=1e-3)
    assert started.structure.damping_ratio == pytest.approx(0.0032, rel=0.1)
    assert started_from_ring_down(far, records()) == far


def test_bounds_of_the_cut_come_from_conditions_then_pass_times():
    record, cut = records()[0]
    assert cut_bounds(record, cut) == (record.conditions["entry_time"], record.conditions["exit_time"])
    bare = Recording(record.channels, record.sampling_rate, record.units, "predicted", pass_times=record.pass_times)
    assert cut_bounds(bare, cut) == pytest.approx(cut_bounds(record, cut))


def test_a_machine_that_cuts_nothing_is_refused():
    with pytest.raises(ValueError, match="no cutter"):
        identify(Model(Structure(1.0, 100.0, 0.01)), records())


def test_a_speed_that_is_not_the_one_stated_is_taken_from_the_marks():
    stated = [(recording, replace(cut, spindle_speed=cut.spindle_speed * (1 + error)))
              for (recording, cut), error in zip(records(), (0.004, -0.003, 0.002), strict=True)]
    found = identify(PAPER_START, stated)
    assert found.chi_square < 5.0
    assert found.parameters["damping_ratio"].value == pytest.approx(0.0032, rel=0.01)
    assert found.parameters["natural_frequency"].value * 2 * math.pi == pytest.approx(921.1, abs=0.1)
    assert [test.cut.spindle_speed for test in found.tests] == pytest.approx([cut.spindle_speed for cut in CUTS], rel=1e-6)
