"""Designs that fill a space, draws of every run's own, noise recipes, refinement: what they give and what is refused."""

import math
import pickle

import numpy as np
import pytest

from testbed.files.yaml_text import parse
from testbed.noise import NoiseRecipe, pink_noise
from testbed.problem import InputProblem
from testbed.scenario.design import Grid, Range, Sampled
from testbed.scenario.draws import Distribution
from testbed.scenario.refinement import refined, stable_cuts
from testbed.scenario.scenario_file import read_scenario, scenario_from

RPM = 2 * math.pi / 60
HEAD = """seed: 5
model:
  structure: {mass: 2.573 kg, natural_frequency: 146.6 Hz, damping_ratio: 0.0032}
  cutter: {flutes: 1, diameter: 19.05 mm}
  cutting: {immersion: 0.1, tangential_coefficient: 550 N/mm^2, normal_coefficient: 200 N/mm^2}
  effects: {process_damping: {coefficient: 1e5 N/m}}
cut: {cutting: 7 rev}
"""
TEST = "tests: [{spindle_speed: 3000 rpm, depth_of_cut: 1 mm}]\n"
SAMPLE = """sample:
  method: METHOD
  runs: 64
  over:
    spindle_speed: {from: 3000 rpm, to: 6000 rpm}
    depth_of_cut: 2 mm
    damping_ratio: {from: 0.001, to: 0.1, scale: log}
    process_damping.coefficient: {from: 0 N/m, to: 4e5 N/m}
"""


def scenario(text):
    return scenario_from(parse(HEAD + text, "s.yaml"))


def columns(found):
    runs = list(found.runs())
    return np.array([(run.cut.spindle_speed / RPM, run.model.value("damping_ratio"),
                      run.model.value("process_damping.coefficient")) for run in runs]).T


@pytest.mark.parametrize("method", ["latin_hypercube", "sobol", "random"])
def test_a_sample_fills_its_box(method):
    found = scenario(SAMPLE.replace("METHOD", method))
    speed, damping, coefficient = columns(found)
    assert len(found) == 64 and [run.cut.axial_depth_of_cut for run in found.runs()] == pytest.approx([2e-3] * 64)
    shares = np.array([(speed - 3000) / 3000, np.log10(damping) / 2 + 1.5, coefficient / 4e5])
    assert shares.min() >= 0 and shares.max() <= 1
    filled = [len(set(np.floor(share * 64).astype(int))) for share in shares]
    if method == "random":
        assert max(filled) < 60  # chance leaves gaps
    else:
        assert min(filled) == 64  # one point in each of 64 slices of every axis
    assert found.longest() == max(run.sampling.count for run in found.runs())


def test_a_design_travels_as_a_few_numbers_and_comes_back_the_same():
    design = Sampled("sobol", 100_000, 3, (Range("spindle_speed", 1.0, 2.0), Range("depth_of_cut", 0.0, 1.0)))
    assert len(pickle.dumps(design)) < 500 and pickle.loads(pickle.dumps(design))[77_777] == design[77_777]
    grid = Grid((("spindle_speed", (1.0, 2.0)), ("depth_of_cut", (3.0, 4.0)), ("damping_ratio", (0.1, 0.2, 0.3))))
    assert len(grid) == 12 and grid[-1].values == (("damping_ratio", 0.3),) and grid[-1].spindle_speed == 2.0
    assert [one.values[0][1] for one in grid[:4]] == [0.1, 0.2, 0.3, 0.1]
    with pytest.raises(IndexError):
        grid[12]


def test_the_seed_of_the_command_line_reaches_the_design():
    found = scenario(SAMPLE.replace("METHOD", "sobol"))
    other = found.with_seed(6)
    assert not np.array_equal(columns(found), columns(other)) and found.fingerprint() != other.fingerprint()
    assert np.array_equal(columns(other.with_seed(5)), columns(found))


def test_lists_and_grids_over_any_parameter():
    listed = scenario("tests:\n  - {spindle_speed: 3000 rpm, depth_of_cut: 1 mm, immersion: 0.2, feed: 0.2 mm/tooth}\n"
                      "  - {spindle_speed: 3000 rpm, depth_of_cut: 1 mm}\n")
    assert [run.model.value("immersion") for run in listed.runs()] == [0.2, 0.1]
    assert [run.cut.feed_per_tooth for run in listed.runs()] == pytest.approx([0.2e-3, 0.1016e-3])
    grid = scenario("sweep: {spindle_speed: 3000 rpm, depth_of_cut: '1, 2 mm', natural_frequency: '100, 150, 200 Hz'}\n")
    assert [(run.cut.axial_depth_of_cut, run.model.value("natural_frequency")) for run in grid.runs()] == [
        (pytest.approx(depth), pytest.approx(frequency)) for depth in (1e-3, 2e-3) for frequency in (100, 150, 200)]


RANDOM = """repeats: 4000
random:
  natural_frequency: {normal: 146 Hz, deviation: 2 Hz}
  damping_ratio: {lognormal: 0.003, deviation: 20 %}
  mark_angle: {uniform: [0 deg, 90 deg]}
  cubic_stiffness: {present: 25 %, coefficient: {loguniform: [1e12 N/m^3, 1e13 N/m^3]}}
sensors:
  displacement: {noise: {uniform: [1 um, 3 um]}}
"""


def test_every_run_draws_its_own_from_what_was_stated():
    found = scenario(TEST + RANDOM)
    runs = [found.run(index) for index in range(0, 4000, 4)]
    frequency, damping, cubic = (np.array([run.model.value(name) for run in runs]) for name in
                                 ("natural_frequency", "damping_ratio", "cubic_stiffness.coefficient"))
    mark = np.array([run.sensors.mark_angle for run in runs])
    noise = np.array([run.sensors.channels["displacement"].noise for run in runs])
    assert frequency.mean() == pytest.approx(146, abs=0.3) and frequency.std() == pytest.approx(2, rel=0.1)
    assert np.median(damping) == pytest.approx(0.003, rel=0.03) and np.log(damping).std() == pytest.approx(0.2, rel=0.1)
    assert 0 <= mark.min() < 0.05 and 1.5 < mark.max() <= math.pi / 2
    assert noise.min() >= 1e-6 and noise.max() <= 3e-6 and noise.mean() == pytest.approx(2e-6, rel=0.03)
    assert np.mean(cubic > 0) == pytest.approx(0.25, abs=0.04) and cubic[cubic > 0].min() >= 1e12 and cubic.max() <= 1e13
    assert abs(np.corrcoef(frequency, damping)[0, 1]) < 0.1
    again = scenario(TEST + RANDOM).run(1234)
    assert again == found.run(1234) and again.model != found.run(1235).model


def test_a_draw_out_of_bounds_is_drawn_again():
    rng = np.random.default_rng(0)
    drawn = [Distribution("normal", 0.1, 1.0, 0.0, 0.5).draw(rng) for _ in range(500)]
    assert min(drawn) >= 0.0 and max(drawn) <= 0.5 and np.std(drawn) > 0.1
    with pytest.raises(ValueError, match="within"):
        Distribution("uniform", -1.0, 1.0, 0.0)


@pytest.mark.parametrize(("text", "said"), [
    (SAMPLE.replace("METHOD", "sobbol"), "s.yaml:9: sample.method: 'sobbol'"),
    (SAMPLE.replace("METHOD", "sobol").replace("runs: 64", "runs: 0"), "s.yaml:10: sample.runs: '0' must be 1 to"),
    (SAMPLE.replace("METHOD", "sobol").replace("damping_ratio", "dampin_ratio"), "did you mean damping_ratio?"),
    (SAMPLE.replace("METHOD", "sobol").replace("    depth_of_cut: 2 mm\n", ""), "depth_of_cut: is missing"),
    (SAMPLE.replace("METHOD", "sobol").replace("0.001", "0"), "must be above 0 on a scale of logarithms"),
    (SAMPLE.replace("METHOD", "sobol").replace("6000 rpm", "2000 rpm"), "must lie above from"),
    (SAMPLE.replace("METHOD", "sobol").replace("6000 rpm", "6000"), "s.yaml:12: sample.over.spindle_speed.to: 6000 has no"),
    (SAMPLE.replace("METHOD", "sobol").replace("to: 0.1", "to: 1.5"), "s.yaml:14: sample.over.damping_ratio.to: '1.5' is ref"),
    (SAMPLE.replace("METHOD", "sobol").replace("process_damping.", "cubic_stiffness."), "no effect cubic_stiffness"),
    (SAMPLE.replace("METHOD", "sobol").replace("4e5", "4e9"), "lies outside the law's bounds"),
    (SAMPLE.replace("METHOD", "sobol") + TEST, "gives both tests and sample"),
    (TEST + "random: {dampin_ratio: 0.1}\n", "s.yaml:9: random.dampin_ratio: unknown parameter or effect: did you mean"),
    (TEST + "random: {damping_ratio: {unifrm: [0, 1]}}\n", "did you mean uniform?"),
    (TEST + "random: {damping_ratio: {uniform: [0.2, 0.1]}}\n", "from the lower to the higher"),
    (TEST + "random: {damping_ratio: {uniform: 0.2}}\n", "is not two ends"),
    (TEST + "random: {natural_frequency: {normal: 146 Hz}}\n", "deviation: is missing"),
    (TEST + "random: {natural_frequency: {normal: 146 Hz, deviation: 2 mm}}\n", "does not convert"),
    (TEST + "random: {cubic_stiffness: {present: 130 %, coefficient: 1e12 N/m^3}}\n", "must be 0 to 100 %"),
    (TEST + "random: {cubic_stiffness: {present: 30 %}}\n", "coefficient: is missing"),
    (TEST + "random: {cubic_stiffness: {coeficient: 1e12 N/m^3}}\n", "did you mean coefficient?"),
    (TEST + "sensors: {displacement: {noise: {whit: 1 um}}}\n", "did you mean white?"),
    (TEST + "sensors: {displacement: {noise: {pink: -1 um}}}\n", "must be at least 0"),
    (TEST + "sensors: {displacement: {noise: {spikes: 1 um}}}\n", "spike_rate: is missing"),
    (TEST + "sensors: {displacement: {noise: {lost: 1}}}\n", "lost must be below 1"),
    ("refine: {spindle_speed: 3000 rpm, depth_of_cut: '1, 2 mm'}\n", "no axis to refine"),
    ("refine: {spindle_speed: '3000, 4000 rpm', depth_of_cut: '1, 2 mm', levels: 9}\n", "'9' must be 0 to 8"),
])
def test_what_is_wrong_is_said_in_one_line_with_its_place(text, said):
    with pytest.raises(InputProblem) as problem:
        scenario(text)
    message = str(problem.value)
    assert said in message and message.startswith("s.yaml:") and "\n" not in message


def test_pink_noise_falls_as_one_over_f_with_unit_rms():
    noise = np.array([pink_noise(4096, np.random.default_rng(seed)) for seed in range(200)])
    assert np.sqrt((noise**2).mean()) == pytest.approx(1.0, rel=0.02)
    power = (np.abs(np.fft.rfft(noise, axis=1)) ** 2).mean(axis=0)[1:2000]
    slope = np.polyfit(np.log(np.arange(1, 2000)), np.log(power), 1)[0]
    assert slope == pytest.approx(-1.0, abs=0.03)
    assert np.std(pink_noise(4097, np.random.default_rng(1))) == pytest.approx(1.0, rel=0.5)


def test_each_part_of_a_recipe_does_what_it_says():
    rate, rng = 1000.0, np.random.default_rng(3)
    still = np.zeros(20_000)
    hum = NoiseRecipe(hum=2.0, hum_frequency=50.0).disturbed(still, rate, rng)
    assert np.argmax(np.abs(np.fft.rfft(hum))) == 1000 and np.std(hum) == pytest.approx(math.sqrt(2.0))
    spikes = NoiseRecipe(spikes=5.0, spike_rate=10.0).disturbed(still, rate, rng)
    assert set(np.unique(spikes)) == {-5.0, 0.0, 5.0} and np.count_nonzero(spikes) == pytest.approx(200, abs=50)
    walks = np.array([NoiseRecipe(wander=3.0).disturbed(np.zeros(1000), rate, rng)[-1] for _ in range(400)])
    assert walks.std() == pytest.approx(3.0, rel=0.12)
    held = NoiseRecipe(lost=0.3).disturbed(np.arange(20_000.0), rate, rng)
    assert np.mean(np.diff(held) == 0) == pytest.approx(0.3, abs=0.02) and (np.diff(held) >= 0).all()


def test_recipes_and_several_sensors_reach_the_record():
    found = read_scenario("noise_recipes")
    run = found.run(6)  # the second recipe
    assert set(run.sensors.channels) == {"displacement", "acceleration", "force_x"}
    assert run.sensors.channels["displacement"].recipe == NoiseRecipe(pink=0.5e-6, hum=0.3e-6, hum_frequency=50.0)
    assert run.sensors.channels["force_x"].recipe == NoiseRecipe(pink=1.0)
    assert run.sensors.channels["acceleration"].noise == pytest.approx(0.05 * 9.80665)


def test_refinement_crowds_about_the_border():
    def below_the_line(points):  # stable below y = x / 2
        return [depth < speed / 2 for speed, depth in points]

    asked = []
    speeds, depths = tuple(map(float, range(9))), tuple(map(float, range(7)))
    found = refined(speeds, depths, 3, lambda points: asked.extend(points) or below_the_line(points))
    distance = np.array([abs(one.axial_depth_of_cut - one.spindle_speed / 2) for one in found])
    assert len(asked) == len(set(asked)) == len(found)
    assert np.mean(distance < 0.3) > 0.3 and distance.max() == 6.0
    assert len(found) < 0.3 * 65 * 49  # of all points of the finest grid
    finest = {(one.spindle_speed, one.axial_depth_of_cut) for one in found}
    for speed in np.arange(0.5, 8.0, 0.5):  # each column has points close on both sides
        depths = sorted(depth for place, depth in finest if place == speed)
        below = [depth for depth in depths if depth < speed / 2]
        above = [depth for depth in depths if depth >= speed / 2]
        assert below and above and above[0] - below[-1] <= 0.125 + 1e-12


def test_the_trial_cuts_agree_with_the_stability_chart():
    from testbed.analysis.linear.stability import stability_chart

    model = scenario(TEST).model.without_effect("process_damping")
    speeds, depths = np.linspace(2500, 4500, 14) * RPM, np.linspace(0.3e-3, 5e-3, 10)
    chart = np.abs(stability_chart(model, speeds, depths).largest)
    judged = stable_cuts(model, 0.1016e-3)([(speed, depth) for depth in depths for speed in speeds])
    clear = np.abs(chart.ravel() - 1) > 0.002
    assert clear.sum() > 120 and 20 < np.sum(chart < 1) < 130
    assert np.array_equal((chart.ravel() < 1)[clear], np.array(judged)[clear])
