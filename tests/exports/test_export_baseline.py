"""The baseline learns what can be learnt, learns nothing from shuffled answers, and its parts solve known problems."""

from dataclasses import replace

import numpy as np
import pytest

from testbed.analysis.multipliers.baseline_scores import FEATURES, baseline, features, fit_ridge, fit_softmax
from testbed.analysis.multipliers.run_labels import class_of_linear
from testbed.cut import Cut, whole_cut_sampling
from testbed.engines.fast import simulate
from testbed.machine import Cutter, Cutting, Model, Structure


@pytest.fixture(scope="module")
def machines():
    """(features, stability, parameters) of 300 random machines at random conditions."""
    random = np.random.default_rng(4)
    rows, classes, truth = [], [], {"frequency": [], "damping": [], "coefficient": []}
    for _ in range(300):
        frequency, damping, coefficient = random.uniform(120, 180), random.uniform(0.002, 0.02), random.uniform(3e8, 9e8)
        model = Model(Structure(2.573, frequency, damping), Cutter(),
                      Cutting("up-milling", 0.162, coefficient, 0.3 * coefficient)).with_effect("contact_loss")
        cut = Cut(random.uniform(270, 470), random.uniform(3e-4, 3.5e-3), 1.016e-4, 0, 50, 20)
        recording = simulate(model, cut, whole_cut_sampling(cut, 1, 6400.0))
        noisy = recording.channels["displacement"] + 5e-7 * random.standard_normal(len(recording))
        known = {"spindle_speed": cut.spindle_speed, "axial_depth_of_cut": cut.axial_depth_of_cut, "flutes": 1,
                 "feed_per_tooth": cut.feed_per_tooth, "idle_passes": 0, "passes": 50}
        rows.append(features(replace(recording, channels={"displacement": noisy}, conditions=known)))
        classes.append(class_of_linear(model.without_effect("contact_loss"), cut).stability)
        for name, value in zip(truth, (frequency, damping, coefficient), strict=True):
            truth[name].append(value)
    return np.array(rows), classes, {name: np.array(values) for name, values in truth.items()}


SPLIT = ["train"] * 200 + ["validation"] * 50 + ["test"] * 50
GROUP = [str(number) for number in range(300)]


def test_both_methods_beat_the_naive_answers_on_conditions_held_out(machines):
    found = baseline(machines[0], SPLIT, GROUP, machines[1], machines[2])
    assert found.trained == 200 and machines[0].shape == (300, len(FEATURES))
    test = next(one for one in found.classifier if one.split == "test")
    assert test.accuracy > 0.85 > test.naive_accuracy and test.recall > test.naive_recall + 0.2 and test.groups == 50
    explained = {one.parameter: one.explained for one in found.regressor if one.split == "test"}
    assert explained["frequency"] > 0.9 and explained["damping"] > 0.8 and explained["coefficient"] > 0.1


def test_shuffled_answers_teach_nothing(machines):
    random = np.random.default_rng(0)
    order = random.permutation(300)
    found = baseline(machines[0], SPLIT, GROUP, [machines[1][k] for k in order],
                     {name: values[order] for name, values in machines[2].items()})
    assert all(one.explained < 0.15 for one in found.regressor if one.split == "test")
    test = next(one for one in found.classifier if one.split == "test")
    assert test.recall < test.naive_recall + 0.1


def test_the_test_split_is_not_learnt_from(machines):
    """Wrong answers in the test split change its scores and nothing else."""
    spoilt = {name: np.where(np.arange(300) < 250, values, 2 * values) for name, values in machines[2].items()}
    one, other = (baseline(machines[0], SPLIT, GROUP, machines[1], truth).regressor for truth in (machines[2], spoilt))
    for before, after in zip(one, other, strict=True):
        assert (before == after) == (before.split != "test")


def test_what_cannot_be_scored_is_said():
    values = np.random.default_rng(0).standard_normal((6, len(FEATURES)))
    values[0] = np.nan
    found = baseline(values, ["train"] * 6, GROUP[:6], ["stable"] * 6, {"mass": np.full(6, 2.5)})
    assert not found.classifier and not found.regressor and found.trained == 5
    for said in ("1 rows are too short", "no row fell into test", "one class only (stable)", "no parameter differs"):
        assert any(said in note for note in found.notes), said


def test_softmax_gives_the_odds_and_ridge_the_line():
    random = np.random.default_rng(2)
    x = random.standard_normal(20_000)
    target = (random.random(20_000) < 1 / (1 + np.exp(-(0.5 + 1.5 * x)))).astype(int)
    weights = fit_softmax(np.column_stack([np.ones_like(x), x]), target, 2, 1e-6)
    assert weights[:, 1] - weights[:, 0] == pytest.approx([0.5, 1.5], abs=0.08)
    line = 3 - 2 * x + 0.1 * random.standard_normal(x.size)
    assert fit_ridge(np.column_stack([np.ones_like(x), x]), line, 1e-9) == pytest.approx([3, -2], abs=0.01)
    shrunk = fit_ridge(np.column_stack([np.ones_like(x), x]), line, 1.0)
    assert shrunk == pytest.approx([3, -1], abs=0.05)  # unit variance against a penalty of 1: halved, the constant is not
