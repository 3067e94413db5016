"""`testbed chart` with chances and `testbed plan`: the same bits from a seed, and no chance without grounds."""

from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from testbed.analysis.probable.chance import by_surface, chance_of, each_drawn
from testbed.analysis.probable.draws import of_spreads
from testbed.api.probable import filled
from testbed.catalogue import catalogue
from testbed.engines import fast
from testbed.workshop import RPM, write_campaign
from tests.files.test_model_spreads import SIZES, SPREAD
from tests.support.campaign_files import BELIEVED, TRUE
from tests.support.shell import Shell
from tests.support.synthetic_campaign import synthetic_campaign

GRID = ("--speed", "2600:4400:10", "--depth", "0.2:4:12", "--draws", 60)
PLAIN = SPREAD.partition("effects:")[0]


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    """Campaigns of short cuts: of the believed machine, and with a hidden effect."""
    folder = tmp_path_factory.mktemp("files")
    for name, model in (("plain", TRUE), ("damped", TRUE.with_effect("process_damping", coefficient=2e5))):
        (folder / name).mkdir()
        cuts = synthetic_campaign(partial(fast.simulate, steps=37), model, seed=4, tests=((3810, 2.9), (2850, 2.9)),
                                  rate=3200.0, course=(10, 35, 15))
        write_campaign(folder / name, cuts, BELIEVED)
    (folder / "spread.yaml").write_text(PLAIN)
    return folder


@pytest.fixture
def shell(files, capsys, monkeypatch):
    monkeypatch.chdir(files)
    return Shell(capsys)


def test_deviations_in_the_file_make_chances(shell):
    found = shell.json("chart", "spread.yaml", *GRID, "-o", "pictures")
    chance = np.array(found["stable_probability"], float)
    assert chance.shape == (12, 10) and chance.min() == 0.0 and chance.max() == 1.0 and np.any((chance > 0.2) & (chance < 0.8))
    certain = np.array(found["class"]) == "stable"
    assert np.all(certain[chance == 1.0]) and not certain[chance == 0.0].any()
    best = found["recommended"]
    assert best["stable_probability"] >= 0.95 and found["no_chance"] is None
    rates = np.outer(found["axial_depth_of_cut"], found["spindle_speed"])
    assert best["spindle_speed"] * best["axial_depth_of_cut"] == pytest.approx(rates[chance * 60 / 61 >= 0.95].max())
    low, high = (np.array(found[f"stability_limit_{name}"], float) for name in ("low", "high"))
    assert np.all((low <= high) | np.isnan(low) | np.isnan(high)) and np.isfinite(low).sum() > 3
    assert {one["parameter"] for one in found["drawn"]} == set(SIZES) - {"process_damping.coefficient"}
    assert Path("pictures/probable_stability.png").stat().st_size > 5000
    assert shell.json("chart", "spread.yaml", *GRID, "-o", "pictures") == found
    other = shell.json("chart", "spread.yaml", *GRID, "-o", "pictures", "--seed", 1)
    assert other["stable_probability"] != found["stable_probability"] and other["class"] == found["class"]
    riskier = shell.json("chart", "spread.yaml", *GRID, "-o", "pictures", "--risk", "0.3")["recommended"]
    assert riskier["spindle_speed"] * riskier["axial_depth_of_cut"] >= best["spindle_speed"] * best["axial_depth_of_cut"]


def test_a_campaign_makes_chances_about_the_machine_it_shows(shell):
    found = shell.json("chart", "plain/model.yaml", "--campaign", "plain/campaign.yaml", *GRID, "-o", "pictures")
    drawn = {one["parameter"]: one for one in found["drawn"]}
    assert set(drawn) == {"natural_frequency", "damping_ratio", "tangential_coefficient", "normal_coefficient"}
    assert drawn["natural_frequency"]["value"] == pytest.approx(TRUE.structure.natural_frequency, rel=1e-4)
    fitted = shell.json("compare", "plain/campaign.yaml", "-m", "plain/model.yaml")["parameters"]
    for name, one in drawn.items():  # as wide as the intervals
        assert one["standard_deviation"] == pytest.approx((fitted[name]["high"] - fitted[name]["low"]) / 3.92, rel=0.05)
    assert found["recommended"] is not None and any("fitted to plain/campaign.yaml" in note for note in found["notes"])


def test_no_chance_is_given_where_the_model_does_not_explain_the_records(shell):
    found = shell.json("chart", "damped/model.yaml", "--campaign", "damped/campaign.yaml", *GRID, "-o", "refused")
    assert found["stable_probability"] is found["recommended"] is found["stability_limit_low"] is None
    assert "more than noise" in found["no_chance"] and "testbed diagnose" in found["no_chance"]
    plain = shell.json("chart", "damped/model.yaml", *GRID, "-o", "refused")
    assert plain["stability_limit"] == found["stability_limit"]  # the chart is drawn all the same
    assert Path("refused/stability_chart.png").exists() and not Path("refused/probable_stability.png").exists()


def test_a_plan_stays_within_reach_and_risk(shell):
    asked = ("plan", "plain/campaign.yaml", "-m", "plain/model.yaml", "--speed", "2600:4400:5", "--depth", "1:4:3",
             "--draws", 60)
    found = shell.json(*asked)
    assert found["explanations"] == ["the model as it is"] and found["no_plan"] is None and found["candidates"] == 15
    rates = [one["information_per_minute"] for one in found["next"]]
    assert len(rates) > 2 and rates == sorted(rates, reverse=True) and min(rates) > 0
    for one in found["next"]:
        assert one["stable_probability"] >= 0.95 and 1e-3 <= one["axial_depth_of_cut"] <= 4e-3
        assert set(one["expects"]["the model as it is"]) == {"displacement"}
    assert shell.json(*asked) == found
    text = shell(*asked, "--count", 1)
    assert text == 0 and "peak to peak" in shell.out


@pytest.mark.parametrize(("arguments", "said"), [
    (("chart", "spread.yaml", *GRID, "--risk", "0"), "is no chance between 0 and 100 %"),
    (("chart", "spread.yaml", *GRID, "--risk", "5 Hz"), "does not convert to a bare number"),
    (("chart", "spread.yaml", *GRID, "--campaign", "nowhere.yaml"), "nowhere.yaml"),
    (("chart", "spread.yaml", "--speed", "2500:4500:2000", "--depth", "0.1:4:1000"), "would take some"),
    (("plan", "plain/campaign.yaml", "-m", "plain/model.yaml", "--speed", "2500", "--depth", "1:4:0"), "asks for 0 points"),
    (("plan", "plain/campaign.yaml", "-m", "plain/model.yaml", "--speed", "2500:4500", "--depth", "one:two"), "is not a range"),
])
def test_bad_questions_are_refused_in_one_line(shell, arguments, said):
    assert said in shell.refused(*arguments)


def test_with_effects_a_surface_comes_to_what_every_machine_says():
    """The sum of parabolas against the linearised loop of every machine drawn, across the limit of stability."""
    model = replace(TRUE.with_effect("process_damping", coefficient=2e5),
                    spreads=(("tangential_coefficient", 8e7), ("process_damping.coefficient", 6e4)))
    known, speeds, depths = of_spreads(model, catalogue()), np.array([3200 * RPM]), np.linspace(3.3e-4, 6e-4, 4)
    fill = partial(filled, catalogue=catalogue())
    every = chance_of(each_drawn(fill, known, speeds, depths, 40, 1)).probability[:, 0]
    near = chance_of(by_surface(fill, known, speeds, depths, 40, 1)).probability[:, 0]
    assert np.all(np.abs(every - near) <= 0.051) and every[0] - every[-1] > 0.5
