"""The score of a method whose errors are known in advance."""

import math
from dataclasses import dataclass

import numpy as np
import pytest

from analysis.score import score
from testbed.machine import Cutter, Cutting, Model, Structure

TRUTH = Model(Structure(2.573, 146.6, 0.0032), Cutter(), Cutting())


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
