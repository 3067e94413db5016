"""The comparison of golden traces: what it calls the same, and what another."""

import copy
import json

import pytest

from testbed.analysis.fit.moves import BASE, every_move, steps_of
from tests.validation import golden

TRACE = {"campaign": "blind 1", "verdict": "missing_effect", "effects": ["helix"], "noise_floor": 0.01, "simulations": 900,
         "steps": [{"effects": [], "cost": 9.0, "error_fit": 0.1, "error_held_out": 0.11, "delta_bic": 0.0,
                    "moves": []},
                   {"effects": ["helix"], "cost": 2.0, "error_fit": 0.01, "error_held_out": 0.01, "delta_bic": 800.0,
                    "moves": ["pass_count"]}],
         "parameters": {"helix.lag": 0.01}, "said": ["fitting the believed model", "trying helix"], "processor": 9.0}


def changed(**more):
    return golden.differences(TRACE, copy.deepcopy(TRACE) | more)


def test_what_differs_by_rounding_is_the_same():
    steps = copy.deepcopy(TRACE["steps"])
    steps[1]["cost"] *= 1 + 1e-9
    assert changed() == changed(steps=steps, processor=99.0) == []


def test_each_part_of_a_trace_is_compared():
    steps = copy.deepcopy(TRACE["steps"])
    steps[1]["cost"] = 2.1
    assert changed(verdict="adequate", effects=[])[:2] == ["verdict: missing_effect -> adequate", "effects: ['helix'] -> []"]
    assert changed(steps=steps) == ["step 1, cost: 2 -> 2.1"]
    steps[1] |= {"cost": 2.0, "moves": []}
    assert changed(steps=steps) == ["step 1, moves that helped: ['pass_count'] -> []"]
    assert changed(steps=steps[:1]) == ["steps: [[], ['helix']] -> [[]]"]
    assert changed(parameters={"helix.lag": 0.02}) == ["helix.lag: 0.01 -> 0.02"]
    assert changed(parameters={}) == ["helix.lag: 0.01 -> nan"]
    assert changed(said=["fitting the believed model"]) == ["the way, from its step 2 on: trying helix -> the end"]


def test_a_move_that_is_left_out_is_in_no_scheme(monkeypatch):
    monkeypatch.setitem(every_move(), "best_half", every_move()["best_half"])  # put back at the end
    assert "best_half" in [step.move for step, _ in steps_of(BASE)]
    golden.leave_out("best_half")
    assert "best_half" not in [step.move for step, _ in steps_of(BASE)] and len(list(steps_of(BASE))) > 5


def test_every_campaign_has_its_trace():
    kept = [json.loads(line)["campaign"] for line in golden.KEPT.read_text().splitlines()]
    assert kept == list(golden.CAMPAIGNS)


@pytest.mark.long
def test_a_campaign_without_a_cause_walks_as_it_did():
    kept = {one["campaign"]: one for one in map(json.loads, golden.KEPT.read_text().splitlines())}
    now = golden.trace_of("blind 3010")
    assert (now["verdict"], now["effects"]) == ("adequate", []) and golden.differences(kept["blind 3010"], now) == []
