"""Scenarios: what they expand to, what is refused, and that the shipped ones are whole."""

import math

import numpy as np
import pytest

from testbed import scenarios
from testbed.files.yaml_text import parse
from testbed.problem import InputProblem
from testbed.scenario.scenario_file import read_scenario, scenario_from

RPM = 2 * math.pi / 60
TEXT = """name: trial
seed: 5
repeats: 2
model:
  structure: {mass: 2.573 kg, natural_frequency: 146.6 Hz, damping_ratio: 0.0032}
  cutter: {flutes: 2, diameter: 19.05 mm}
  cutting: {immersion: 0.1, tangential_coefficient: 550 N/mm^2, normal_coefficient: 200 N/mm^2}
cut:
  feed: 0.1 mm/tooth
  idle: 2 rev
  cutting: 7 passes
  ring_down: 1.5 rev
  spread: {displacement: 5 um}
tests:
  - {spindle_speed: 3000 rpm, depth_of_cut: 1 mm}
  - {spindle_speed: 6000 rpm, depth_of_cut: 2 mm}
sensors:
  sampling_rate: 10 kHz
  mark_angle: 30 deg
  displacement: {noise: "0, 1 um", bits: 16, range: 1 mm, offset: 3 um, drift: 1 um/s}
"""


def scenario(text=TEXT):
    return scenario_from(parse(text, "s.yaml"))


def swept(speed, depth="1 mm"):
    return scenario(TEXT[:TEXT.index("tests:")] + f"sweep:\n  spindle_speed: {speed}\n  depth_of_cut: {depth}\n")


def test_tests_turn_slowest_then_noise_then_repeats():
    runs = list(scenario().runs())
    assert [round(run.cut.spindle_speed / RPM) for run in runs] == [3000] * 4 + [6000] * 4
    assert [run.sensors.channels["displacement"].noise for run in runs] == pytest.approx([0, 0, 1e-6, 1e-6] * 2)
    assert [run.index for run in runs] == list(range(8))


def test_the_course_is_counted_in_tooth_passes():
    cut = scenario().run(0).cut
    assert (cut.idle_passes, cut.passes, cut.ring_down_passes) == (4, 7, 3)
    assert cut.feed_per_tooth == pytest.approx(1e-4) and cut.axial_depth_of_cut == pytest.approx(1e-3)


def test_samples_cover_the_cut_and_the_longest_is_known():
    found = scenario()
    counts = [run.sampling.count for run in found.runs()]
    assert counts[0] == 14 * 100 and counts[-1] == 14 * 50 and found.longest() == max(counts)


def test_sensors():
    chain = scenario().run(0).sensors
    sensor = chain.channels["displacement"]
    assert chain.mark_angle == pytest.approx(math.pi / 6)
    assert (sensor.bits, sensor.full_scale, sensor.offset, sensor.drift) == pytest.approx((16, 1e-3, 3e-6, 1e-6))


def test_a_runs_random_numbers_are_its_own():
    found = scenario()
    starts = [run.cut.initial_displacement for run in found.runs()]
    assert len(set(starts)) == len(starts) and 1e-6 < np.std(starts) < 2e-5
    assert starts == [run.cut.initial_displacement for run in scenario().runs()]
    assert starts != [run.cut.initial_displacement for run in scenario(TEXT.replace("seed: 5", "seed: 6")).runs()]
    assert found.run(3).sensed().random() == found.run(3).sensed().random() != found.run(4).sensed().random()


@pytest.mark.parametrize(("written", "speeds"), [
    ("3000 rpm", [3000]), ("1000, 2000, 4000 rpm", [1000, 2000, 4000]), ('"[1000, 2000] rpm"', [1000, 2000]),
    ("[1000 rpm, 50 rev/s]", [1000, 3000]), ("{from: 1000 rpm, to: 2000 rpm, count: 3}", [1000, 1500, 2000]),
    ("{from: 1000 rpm, to: 1000 rpm, count: 1}", [1000]), ("{from: 2000 rpm, to: 1000 rpm, count: 2}", [2000, 1000]),
])
def test_axes(written, speeds):
    assert [test.spindle_speed / RPM for test in swept(written).tests] == pytest.approx(speeds)


def test_a_sweep_is_a_grid_with_depths_turning_fastest():
    tests = swept("1000, 2000 rpm", "{from: 1 mm, to: 3 mm, count: 3}").tests
    assert [(round(test.spindle_speed / RPM), round(test.axial_depth_of_cut * 1e3)) for test in tests] == [
        (1000, 1), (1000, 2), (1000, 3), (2000, 1), (2000, 2), (2000, 3)]


@pytest.mark.parametrize(("written", "said"), [
    ("{from: 1 rpm, to: 2 rpm, count: 0}", "sweep.spindle_speed.count: '0' must be 1"),
    ("{from: 1 rpm, to: 2 rpm, count: 1}", "one point"), ("{from: 1 rpm, to: 2, count: 3}", "to: 2 has no unit"),
    ("{from: 1 rpm, too: 2 rpm, count: 3}", "did you mean to?"), ("{from: 1 rpm, to: 2 rpm}", "count: is missing"),
    ("[]", "has no values"), ("0 rpm", "above 0"), ("[1000 rpm, -1 rpm]", "above 0"),
    ("1000, 2000000 rpm", "every value lies beyond 1e+06 rpm"), ("1000, x rpm", "not a finite"),
    ("1000, 2000", "has no unit"), ("1000, 2000 mm", "does not convert"), ("null", "is empty"),
])
def test_axes_refused(written, said):
    with pytest.raises(InputProblem) as problem:
        swept(written)
    message = str(problem.value)
    assert said in message and message.startswith("s.yaml:") and "\n" not in message


@pytest.mark.parametrize(("old", "new", "said"), [
    ("seed: 5", "sed: 5", "s.yaml:2: sed: unknown key: did you mean seed?"),
    ("seed: 5", "seed: -5", "s.yaml:2: seed"), ("seed: 5", "seed: five", "s.yaml:2: seed"),
    ("repeats: 2", "repeats: 0", "s.yaml:3: repeats"),
    ("mass: 2.573 kg", "mass: 2.573", "s.yaml:5: model.structure.mass: 2.573 has no unit"),
    ("immersion: 0.1", "immersion: 1.1", "s.yaml:7: model.cutting.immersion"),
    ("0.1 mm/tooth", "0 mm/tooth", "s.yaml:9: cut.feed: '0 mm/tooth' must be above 0"),
    ("7 passes", "7", "s.yaml:11: cut.cutting: 7 has no unit"),
    ("7 passes", "7.5 passes", "s.yaml:11: cut.cutting: '7.5 passes' must be a whole number"),
    ("7 passes", "-7 passes", "s.yaml:11"), ("7 passes", "1e12 passes", "samples"),
    ("  idle: 2 rev\n  cutting: 7 passes\n  ring_down: 1.5 rev", "  idle: 0 rev\n  cutting: 0 rev", "over before"),
    ("2 mm}", "-2 mm}", "s.yaml:16: tests.1.depth_of_cut: '-2 mm' must be at least 0"),
    ("3000 rpm", "0 rpm", "s.yaml:15: tests.0.spindle_speed: '0 rpm' must be above 0"),
    ("3000 rpm", "3000", "s.yaml:15: tests.0.spindle_speed: 3000 has no unit"),
    ("3000 rpm", "3000 krpm", "unknown unit"), ("3000 rpm", "1.1e6 rpm", "spindle_speed: '1.1e6 rpm' lies beyond 1e+06 rpm"),
    ("10 kHz", "0 Hz", "s.yaml:18: sensors.sampling_rate"), ("noise:", "nois:", "did you mean noise?"),
    ("1 um\",", "-1 um\",", "noise: every value must be at least 0"), ("bits: 16, ", "", "bits: is missing"),
    ("bits: 16", "bits: 99", "bits"), ("range: 1 mm", "range: 0 mm", "range above 0"),
    ("  displacement:", "  displacment:", "did you mean displacement?"),
])
def test_what_is_wrong_is_said_in_one_line_with_its_place(old, new, said):
    assert old in TEXT
    with pytest.raises(InputProblem) as problem:
        scenario(TEXT.replace(old, new))
    assert said in str(problem.value) and "\n" not in str(problem.value)


def test_tests_and_sweep_exclude_each_other():
    both = TEXT + "sweep: {spindle_speed: 1 rpm, depth_of_cut: 1 mm}\n"
    for text in (both, TEXT[:TEXT.index("tests:")], TEXT[:TEXT.index("tests:")] + "tests: []\n"):
        with pytest.raises(InputProblem, match="tests"):
            scenario(text)


def test_a_model_of_its_own_file(tmp_path):
    body = TEXT[TEXT.index("  structure"):TEXT.index("cut:\n")]
    (tmp_path / "m.yaml").write_text("\n".join(line[2:] for line in body.splitlines()) + "\n")
    outside = TEXT.replace(f"model:\n{body}", "model: {file: m.yaml}\n")
    (tmp_path / "s.yaml").write_text(outside)
    assert read_scenario(tmp_path / "s.yaml").model == scenario().model
    (tmp_path / "s.yaml").write_text(outside.replace("m.yaml", "none.yaml"))
    with pytest.raises(InputProblem, match="no file 'none.yaml'"):
        read_scenario(tmp_path / "s.yaml")


def test_the_fingerprint_follows_what_the_runs_depend_on():
    first = scenario().fingerprint()
    assert scenario().fingerprint() == first
    assert scenario(TEXT.replace("name: trial", "name: other")).fingerprint() == first
    for old, new in (("seed: 5", "seed: 6"), ("1 um\"", "2 um\""), ("30 deg", "31 deg"), ("0.0032", "0.0033"),
                     ("2 mm}", "2.1 mm}"), ("0.1 mm/tooth", "0.11 mm/tooth"), ("10 kHz", "11 kHz")):
        assert scenario(TEXT.replace(old, new)).fingerprint() != first, new


@pytest.mark.parametrize("name", scenarios.names())
def test_the_shipped_scenarios_are_found_by_name(name):
    found = read_scenario(name)
    assert found.name == name and len(found) >= 3
    assert found.file == str(scenarios.find(name))


def test_the_published_tests_are_those_of_the_paper():
    tests = read_scenario("published_tests").tests
    assert [(round(test.spindle_speed / RPM), round(test.axial_depth_of_cut * 1e3, 6)) for test in tests] == [
        (3050, 2.7), (3565, 2.1), (3635, 2.0), (3810, 2.9), (2850, 2.9)]


def test_an_unknown_scenario_is_answered_with_the_shipped_ones():
    with pytest.raises(InputProblem, match="did you mean noise_study"):
        read_scenario("noise_studdy")
