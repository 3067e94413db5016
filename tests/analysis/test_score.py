"""The score of methods whose errors are known in advance, of an outsider's file, and of the paper's own way."""

import json
import math
from dataclasses import dataclass

import numpy as np
import pytest

from testbed.analysis.multipliers.identify_as_published import identify_as_published
from testbed.analysis.multipliers.score import Case, Outcome, binomial_interval, score, study_scores
from testbed.api.scoring import Order, Sealed
from testbed.cut import Cut, whole_cut_sampling
from testbed.engines.fast import simulate as engine
from testbed.machine import Cutter, Cutting, Model, Structure
from tests.support.export_files import run, simulate

TRUTH = Model(Structure(2.573, 146.6, 0.0032), Cutter(), Cutting())
RIG = Model(Structure(2.573, 146.5976, 0.0032), Cutter(), Cutting("up-milling", 0.162, 5.55768e8, 1.667304e8))


@dataclass(frozen=True)
class Guess:
    value: float
    low: float
    high: float


def records(noise, seed):
    return noise, np.random.default_rng(seed).standard_normal(3)


def method(campaign):
    """Biased by 1 %, spread by `noise`, with intervals of exactly 95 % about the biased mean; refuses one in ten."""
    noise, draws = campaign
    if draws[1] > 1.2816:
        raise ValueError("too little motion")
    answer = {}
    for name in ("natural_frequency", "damping_ratio", "tangential_coefficient"):
        truth = TRUTH.value(name)
        value = truth * (1.01 + noise * draws[0])
        answer[name] = Guess(value, value - (0.01 + 1.96 * noise) * truth, value + (1.96 * noise - 0.01) * truth)
    return answer


def test_bias_spread_coverage_and_failures_are_found():
    scores = score(method, TRUTH, records, [0.02, 0.05], range(800))
    assert len(scores) == 6
    for one in scores:
        assert one.truth == TRUTH.value(one.parameter)
        assert one.bias / one.truth == pytest.approx(0.01, abs=4 * one.noise / math.sqrt(700))
        assert one.spread / one.truth == pytest.approx(one.noise, rel=0.1)
        assert one.rms == pytest.approx(math.hypot(one.bias, one.spread), rel=1e-2)
        assert one.coverage == pytest.approx(0.95, abs=0.03)
        assert one.count == 800
        assert one.failures == pytest.approx(80, abs=30)
        assert len(one.reasons) == one.failures and "too little motion" in one.reasons[0]


def test_a_method_that_always_fails_scores_nothing():
    def refuses(_):
        raise ArithmeticError("singular")

    one = score(refuses, TRUTH, records, [0.0], range(3))[0]
    assert (one.count, one.failures) == (3, 3)
    assert math.isnan(one.rms) and math.isnan(one.coverage)


def test_a_fault_of_the_method_is_not_swallowed():
    with pytest.raises(KeyError):
        score(lambda _: {}, TRUTH, records, [0.0], [0])


def outcomes(found):
    return {Case("m", 1e-6, 3, number): one for number, one in enumerate(found)}


def test_a_method_without_intervals_has_no_coverage_and_one_that_is_silent_no_score():
    three = (147.0, math.nan, math.nan)
    scores = study_scores(outcomes([Outcome({"natural_frequency": three}), Outcome(None, "noise")]), TRUTH)
    assert [one.parameter for one in scores] == ["natural_frequency"]
    assert (scores[0].count, scores[0].failures, scores[0].tests, scores[0].method) == (2, 1, 3, "m")
    assert math.isnan(scores[0].coverage) and math.isnan(scores[0].stated) and scores[0].bias == pytest.approx(0.4)
    with_interval = study_scores(outcomes([Outcome({"natural_frequency": (147.0, 146.0, 147.96)})]), TRUTH)[0]
    assert with_interval.stated == pytest.approx(0.5, rel=1e-4) and with_interval.coverage == 1


def test_the_interval_of_a_share():
    low, high = binomial_interval(0.9, 10)  # Wilson's formula worked by hand
    assert (low, high) == (pytest.approx(0.5958, abs=1e-4), pytest.approx(0.9821, abs=1e-4))
    assert binomial_interval(1.0, 20)[1] == pytest.approx(1.0) and all(map(math.isnan, binomial_interval(math.nan, 4)))


SCENARIO = """seed: 3
repeats: 2
model:
  structure: {mass: 2.573 kg, natural_frequency: 146.5976 Hz, damping_ratio: 0.0032}
  cutter: {flutes: 1, diameter: 19.05 mm}
  cutting: {immersion: 0.162, tangential_coefficient: 555.768 N/mm^2, normal_coefficient: 166.7304 N/mm^2}
  effects: {contact_loss: {}}
cut: {idle: 5 rev, cutting: 40 rev, ring_down: 40 rev}
tests:
  - {spindle_speed: 3810 rpm, depth_of_cut: 2.9 mm}
  - {spindle_speed: 2850 rpm, depth_of_cut: 2.9 mm}
  - {spindle_speed: 4100 rpm, depth_of_cut: 2.0 mm}
sensors:
  mark_angle: 40 deg
  displacement: {noise: 0.1 um}
"""
MINE = """import numpy as np

def identify(recordings, belief):
    assert not belief.effects and all(one.pass_times.size == 0 for one in recordings)
    assert set(recordings[0].conditions) == {"spindle_speed", "axial_depth_of_cut", "feed_per_tooth", "flutes", "kind"}
    level = sum(float(np.std(np.diff(one.channels["displacement"], 4))) for one in recordings) * 1e6
    recordings[0].channels["displacement"][:] = 0.0  # a method may spoil what it was given
    frequency = belief.value("natural_frequency")
    return {"natural_frequency": (frequency + level, frequency - 5, frequency + 5),
            "damping_ratio": (belief.value("damping_ratio"), np.nan, np.nan)}
"""


@pytest.fixture(scope="module")
def data(tmp_path_factory):
    return simulate(tmp_path_factory.mktemp("score"), SCENARIO, "tests")


def scored(data, folder, *arguments):
    """The JSON of a command line."""
    assert run("score", data, *arguments, "--quiet", "--json", folder / "score.json") == 0
    return json.loads((folder / "score.json").read_text())


def test_an_outsiders_method_is_scored_the_same_by_any_number_of_workers(data, tmp_path):
    mine = tmp_path / "mine.py"
    mine.write_text(MINE)
    order = ["--method", mine, "--noise", "0,1um", "--tests", "2,3", "--repeats", 3, "--seed", 5]
    one = scored(data, tmp_path, *order)
    two = scored(data, tmp_path, *order, "--workers", 2, "-o", tmp_path / "out")
    assert one["scores"] == two["scores"] and len(one["scores"]) == 2 * 2 * 2
    assert scored(data, tmp_path, *order[:-1], 6)["scores"] != one["scores"]
    assert {(row["tests"], row["count"]) for row in one["scores"] if row["noise"] == 1e-6} == {(2, 3), (3, 3)}
    louder = {row["noise"]: row["bias"] for row in one["scores"]
              if (row["parameter"], row["tests"]) == ("natural_frequency", 3)}
    assert louder[1e-6] > louder[1e-7] + 5
    assert {row["coverage"] for row in one["scores"]} == {None, 1.0}
    assert len(one["cost"]) == 4 and all(row["median"] >= 0 for row in one["cost"])
    names = {path.name for path in (tmp_path / "out").iterdir()}
    assert names == {"score.md"} | {f"score_{name}.{kind}" for name in ("noise", "tests", "cost") for kind in ("png", "svg")}
    assert "| natural_frequency | " in (tmp_path / "out" / "score.md").read_text()


def test_no_method_can_know_the_way_back_from_its_belief(data):
    sealed = Sealed(Order(str(data), False, 1, ()))
    ratios = {name: [sealed.belief(number).value(name) / sealed.truth.value(name) for number in range(200)]
              for name in ("natural_frequency", "damping_ratio", "tangential_coefficient")}
    for name, reach in (("natural_frequency", 1.0151), ("damping_ratio", 2.5), ("tangential_coefficient", 2.0)):
        logs = np.log(ratios[name]) / math.log(reach)
        assert np.abs(logs).max() <= 1 and np.unique(logs).size == 200 and logs.std() == pytest.approx(1 / math.sqrt(3), 0.15)


BAD = {"def identify(recordings, belief):\n    return {}['x']\n": "mine.py:2: identify failed with KeyError",
       "def identify(recordings, belief):\n    return 3\n": "returned int",
       "def identify(recordings, belief):\n    return {'natural_frequency': 3}\n": "no (value, low, high)",
       "def identify(recordings, belief):\n    return {'zeta': (1, 0, 2)}\n": "none of natural_frequency",
       "def find(recordings, belief):\n    return 3\n": "has no function `identify`", "def (\n": "cannot be imported"}


@pytest.mark.parametrize("text", BAD)
def test_a_faulty_file_is_told_in_one_line(data, tmp_path, capsys, text):
    (tmp_path / "mine.py").write_text(text)
    assert run("score", data, "--method", tmp_path / "mine.py") == 2
    err = capsys.readouterr().err
    assert err.startswith("error: ") and err.count("\n") == 1 and BAD[text] in err


def test_a_method_that_gives_up_has_failed(data, tmp_path):
    (tmp_path / "mine.py").write_text("def identify(recordings, belief):\n    raise ValueError('too quiet')\n")
    rows = scored(data, tmp_path, "--method", tmp_path / "mine.py")["scores"]
    assert {(row["count"], row["failures"], row["rms"]) for row in rows} == {(2, 2, None)}
    assert rows[0]["reasons"] == ["seed 0: too quiet", "seed 1: too quiet"]


@pytest.mark.parametrize(("arguments", "said"), [
    (["--method", "multiplier"], "did you mean multipliers"), (["--method", "none.py"], "no such file"),
    (["--tests", "4"], "holds 3 tests, not 4"), (["--tests", "0"], "no numbers of tests")])
def test_bad_orders(data, capsys, arguments, said):
    assert run("score", data, *arguments) == 2 and said in capsys.readouterr().err


def test_the_method_of_the_paper_comes_near_without_noise():
    tests = []
    for speed, depth in ((3810, 2.9), (2850, 2.9), (4100, 2.0)):
        cut = Cut(speed * math.pi / 30, depth * 1e-3, 1.016e-4, 0, 40, 0)
        tests.append((engine(RIG, cut, whole_cut_sampling(cut, 1, 12800.0)), cut))
    start = RIG.with_values({"damping_ratio": 0.006, "tangential_coefficient": 8e8, "normal_coefficient": 2.4e8})
    found = identify_as_published(start, tests)
    for name, within in (("natural_frequency", 0.005), ("damping_ratio", 0.4), ("tangential_coefficient", 0.05)):
        assert found[name].value == pytest.approx(RIG.value(name), rel=within) and math.isnan(found[name].low)
    with pytest.raises(ValueError, match="one test"):
        identify_as_published(start, tests[:1])


PLANAR = """seed: 3
model:
  structure:
    modes:
      - {natural_frequency: 146.6 Hz, damping_ratio: 0.01, mass: 2.5 kg, direction: 12 deg}
      - {natural_frequency: 310 Hz, damping_ratio: 0.02, mass: 0.6 kg, direction: 100 deg}
  cutter: {flutes: 2, diameter: 20 mm}
  cutting: {direction: down-milling, immersion: 0.2, tangential_coefficient: 600 N/mm^2, normal_coefficient: 200 N/mm^2}
cut: {idle: 4 rev, cutting: 14 rev, ring_down: 8 rev}
tests:
  - {spindle_speed: 3800 rpm, depth_of_cut: 0.3 mm}
  - {spindle_speed: 3300 rpm, depth_of_cut: 0.2 mm}
sensors:
  sampling_rate: 4000 Hz
  displacement_x: {noise: 0.3 um}
  displacement_y: {noise: 0.3 um}
engine: {name: fast}
"""
TOLD = [f"modes[{place}].{name}" for place in (0, 1) for name in ("natural_frequency", "damping_ratio", "direction")]


@pytest.fixture(scope="module")
def planar(tmp_path_factory):
    return simulate(tmp_path_factory.mktemp("planar"), PLANAR, "planar")


def test_of_a_machine_in_x_and_y_every_mode_is_believed_off(planar):
    sealed = Sealed(Order(str(planar), False, 1, ()))
    assert sealed.parameters == (*TOLD, "tangential_coefficient", "normal_coefficient")
    beliefs = [sealed.belief(number) for number in range(200)]
    for path, reach in zip(TOLD[3:], (0.015, math.log(2.5), math.radians(10)), strict=True):
        values = np.array([one.value(path) for one in beliefs])
        off = (values - sealed.truth.value(path) if "direction" in path else np.log(values / sealed.truth.value(path))) / reach
        assert np.abs(off).max() <= 1 and off.std() == pytest.approx(1 / math.sqrt(3), 0.15)
    assert {one.value("modes[1].mass") for one in beliefs} == {0.6}


def test_an_outsiders_method_on_a_machine_in_x_and_y(planar, tmp_path, capsys):
    (tmp_path / "mine.py").write_text(
        "import numpy as np\n\ndef identify(recordings, belief):\n    channels = recordings[0].channels\n"
        "    assert set(channels) == {'displacement_x', 'displacement_y'}\n"
        "    levels = [float(np.std(np.diff(one, 4))) * 1e6 for one in channels.values()]\n"
        "    return {'modes[1].direction': (levels[0], -4, 4), 'normal_coefficient': (levels[1], 0, 1e12)}\n")
    order = ["--method", tmp_path / "mine.py", "--noise", "0,2um", "--repeats", 2, "-o", tmp_path / "out"]
    found = scored(planar, tmp_path, *order)
    rows = {(one["parameter"], one["noise"]): one for one in found["scores"]}
    assert {path for path, _ in rows} == {"modes[1].direction", "normal_coefficient"}
    for path in ("modes[1].direction", "normal_coefficient"):  # noise is added to either channel
        assert rows[path, 2e-6]["bias"] > rows[path, 3e-7]["bias"] + 5
    assert rows["modes[1].direction", 2e-6]["unit"] == "rad" and (tmp_path / "out" / "score_noise.svg").is_file()
    for method in ("multipliers", "published"):
        assert run("score", planar, "--method", method) == 2
        assert "the multipliers of one mode along the feed: here there is waveform" in capsys.readouterr().err


@pytest.mark.long
def test_a_machine_in_x_and_y_is_scored_by_its_waveform(planar, tmp_path):
    found = scored(planar, tmp_path)
    rows = {one["parameter"]: one for one in found["scores"]}
    assert found["methods"] == ["waveform"] and set(rows) == {*TOLD, "tangential_coefficient", "normal_coefficient"}
    assert {(one["count"], one["failures"], one["coverage"]) for one in rows.values()} <= {(1, 0, 1.0), (1, 0, 0.0)}
    assert sum(one["coverage"] for one in rows.values()) >= 6
    for path in ("modes[0].natural_frequency", "modes[1].natural_frequency"):
        assert abs(rows[path]["bias"]) < 1e-3 * rows[path]["truth"]
    assert abs(rows["modes[1].direction"]["bias"]) < math.radians(3)
