"""How blind campaigns are counted: what is a false alarm, and how sure a share of few campaigns is."""

import json

import pytest

from tests.validation.blind import count


def campaign(kind, verdict, hidden=(), effects=(), baseline=0.5):
    return {"seed": 1, "kind": kind, "made": True, "hidden": {name: {} for name in hidden}, "effects": list(effects),
            "verdict": verdict, "baseline": baseline, "with_effects": 0.01, "noise_floor": 0.01, "noise": 1e-6,
            "tachometer": True, "processor": 1.0}


def claims(campaigns, tmp_path, monkeypatch):
    results = tmp_path / "results.jsonl"
    results.write_text("".join(json.dumps(one) + "\n" for one in campaigns))
    monkeypatch.setattr(count, "RESULTS", results)
    return {one.what: one for one in count.check().claims}


@pytest.mark.parametrize(("verdict", "alarm"), [("adequate", False), ("not_converged", False), ("missing_effect", True),
                                                ("undecided", True), ("unexplained", True)])
def test_whatever_is_said_to_be_there_where_nothing_is_hidden_is_a_false_alarm(verdict, alarm, tmp_path, monkeypatch):
    found = claims([campaign("none", verdict)], tmp_path, monkeypatch)["nothing hidden: false alarms"]
    assert found.found.startswith(f"{int(alarm)} of 1 ") and found.passed is not alarm


def test_every_share_tells_how_sure_it_is(tmp_path, monkeypatch):
    right = [campaign("one", "missing_effect", ["helix"], ["helix"]) for _ in range(10)]
    found = claims([*right, campaign("none", "adequate")], tmp_path, monkeypatch)
    named = found["one hidden effect worth more than 3 %: named right"]
    assert named.note == "95 %: 69 to 100 %"  # 0.025 ** (1 / 10) = 0.69
    assert found["one hidden effect worth more than 3 %: named wrong"].note == "95 %: 0 to 31 %"
    assert found["nothing hidden: false alarms"].note == "95 %: 0 to 98 %"
    shares = [one for one in found.values() if "%)" in one.found]
    assert len(shares) >= 4 and all(one.note.startswith("95 %: ") for one in shares)
    assert found["two hidden effects: both named"].note == ""


def test_what_is_said_to_be_another_law_is_not_named_right(tmp_path, monkeypatch):
    refuted = campaign("one", "unexplained", ["quadratic_damping"], ["quadratic_damping"])
    told = campaign("unknown", "unexplained", ["cubic_damping"], ["quadratic_damping"]) | {"other_law": {"value": 3.0}}
    found = claims([refuted, told, campaign("none", "adequate")], tmp_path, monkeypatch)
    assert found["one hidden effect worth more than 3 %: named right"].found.startswith("0 of 1 ")
    law = "those among them whose law was told as a power of the displacement or the velocity"
    assert found["effect of no catalogue: said so"].found.startswith("1 of 1 ") and found[law].found.startswith("1 of 1 ")
    assert [row[0] for row in count.check().tables[1][2]] == ["1"] and count.check().tables[1][2][0][1] == "one"
