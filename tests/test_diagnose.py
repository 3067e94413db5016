"""Does the diagnosis name what was hidden, and nothing where nothing was? The data come from another step size than the fit."""

from functools import partial
from types import SimpleNamespace

import pytest
from campaign_files import BELIEVED
from synthetic_campaign import synthetic_campaign

from analysis.diagnose import diagnose
from analysis.diagnosis import as_json
from analysis.observed import observe
from testbed.effect import catalogue
from testbed.engines import fast, predict
from testbed.machine import Cutter, Cutting, Model, Structure

TRUE = Model(Structure(2.573, 146.42, 0.0032), Cutter(), Cutting())
CANDIDATES = {name: catalogue()[name] for name in ("process_damping", "edge_force", "tool_wear")}
PLANT = SimpleNamespace(predict_cuts=partial(predict.predict_cuts, catalogue=catalogue()),
                        predict_driven=partial(predict.predict_driven, catalogue=catalogue()))


def verdict(true):
    records = synthetic_campaign(partial(fast.simulate, steps=37), true, seed=4)
    return diagnose(PLANT, [observe(record, BELIEVED) for record in records[:5]], BELIEVED, CANDIDATES)


def test_nothing_hidden_is_called_adequate():
    found = verdict(TRUE)
    assert found.verdict == "adequate" and found.effects == ()
    assert found.baseline == pytest.approx(found.noise_floor, rel=0.02)


def test_a_hidden_effect_is_named_and_its_strength_found():
    name, parameter, value = "process_damping", "coefficient", 2.0e5
    found = verdict(TRUE.with_effect(name, **{parameter: value}))
    assert found.verdict == "missing_effect" and found.effects == (name,)
    answer = as_json(found, BELIEVED)
    assert answer["error"]["baseline"] > 1.1 * answer["error"]["noise_floor"]
    assert answer["error"]["with_effects"] < 1.03 * answer["error"]["noise_floor"]
    best = next(one for one in answer["candidates"] if one["effects"] == [name])
    assert best["parameters"][f"{name}.{parameter}"] == pytest.approx(value, rel=0.03)
