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
from testbed.engines import fast, predict
from testbed.machine import Cutter, Cutting, Mode, Model, Structure
from testbed.workshop import RPM, write_campaign
from tests.files.test_model_spreads import SIZES, SPREAD
from tests.support.campaign_files import BELIEVED, TRUE
from tests.support.planar_campaign import planar_campaign, write_planar
from tests.support.shell import Shell
from tests.support.synthetic_campaign import synthetic_campaign

GRID = ("--speed", "2600:4400:10", "--depth", "0.2:4:12", "--draws", 60)
PLAIN_FILES = ("plain/campaign.yaml", "-m", "plain/model.yaml")
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
    asked = ("plan", *PLAIN_FILES, "--speed", "2600:4400:5", "--depth", "1:4:3",
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


def test_a_plan_leaves_out_cuts_that_vibrate_too_much(shell):
    asked = ("plan", *PLAIN_FILES, "--speed", "2600:4400:4", "--depth", "1:4:2", "--draws", 40, "--count", 8)
    every = shell.json(*asked)
    calm = shell.json(*asked, "--vibration", "150um")
    assert every["most_vibration"] is None and calm["most_vibration"] == pytest.approx(150e-6)
    assert calm["next"] == [one for one in every["next"] if one["vibration"] <= 150e-6]
    assert 0 < len(calm["next"]) < len(every["next"]) and any("left out" in note for note in calm["notes"])
    for one in every["next"]:  # as large as may be, so never less than what is expected
        assert one["vibration"] >= one["expects"]["the model as it is"]["displacement"] * 0.99
    assert shell(*asked, "--vibration", "1nm") == 0 and "calm enough" in shell.out


def test_decays_and_a_deviation_of_the_coefficient_make_chances(shell, files):
    for number in range(2):
        clean = predict.predict_driven([TRUE], [(6e-5, 0.0)], np.zeros(2000), 3200.0, ("displacement",))[0, 0]
        noisy = clean + 5e-7 * np.random.default_rng(number).standard_normal(clean.size)
        np.savetxt(files / f"tap_{number}.csv", noisy * 1e6, header="x", comments="")
    (files / "taps.yaml").write_text("name: taps\nsampling_rate: 3200 Hz\nchannels:\n  displacement: {column: x, unit: um}"
                                     "\nrecords:\n  - {file: tap_0.csv, kind: ring-down}\n"
                                     "  - {file: tap_1.csv, kind: ring-down}\n")
    text = (files / "plain" / "model.yaml").read_text()
    (files / "stated.yaml").write_text(text.replace("630 N/mm^2", "630 +- 50 N/mm^2"))
    assert "deviation" in shell.refused("chart", "plain/model.yaml", "--campaign", "taps.yaml", *GRID)
    assert "holds no cut" in shell.refused("plan", "taps.yaml", "-m", "stated.yaml", "--speed", "2600:4400", "--depth", "1:4")
    found = shell.json("chart", "stated.yaml", "--campaign", "taps.yaml", *GRID, "-o", "pictures")
    drawn = {one["parameter"]: one["standard_deviation"] for one in found["drawn"]}
    assert set(drawn) == {"natural_frequency", "damping_ratio", "tangential_coefficient"}
    assert drawn["tangential_coefficient"] == pytest.approx(5e7) and drawn["natural_frequency"] < 0.01
    assert any(note.startswith("normal_coefficient: no record tells of it") for note in found["notes"])


def test_a_machine_in_x_and_y_gets_chances_and_a_plan(shell, files):
    modes = (Mode(2.0, 150.0, 0.015, 0.0), Mode(1.2, 230.0, 0.02, np.pi / 2, "tool"))
    model = Model(Structure.of(modes), Cutter(2, 20e-3), Cutting("down-milling", 0.2, 6e8, 2e8))
    (files / "planar").mkdir()
    places = [("displacement_x", "workpiece"), ("displacement_y", "tool")]
    cuts = planar_campaign(fast.simulate, model, ((4200, 0.3e-3), (3500, 0.2e-3)), places, 3, (6, 25, 12), rate=4000.0)
    write_planar(files / "planar", cuts, model.with_values({"tangential_coefficient": 6.6e8}))
    found = shell.json("chart", "planar/model.yaml", "--campaign", "planar/campaign.yaml", "--speed", "3500:4500:2", "--depth",
                       "0.1:2:3", "--draws", 20, "-o", "pictures")
    assert found["no_chance"] is None and np.array(found["stable_probability"]).shape == (3, 2)
    drawn = {one["parameter"] for one in found["drawn"]}
    assert {"modes[1].natural_frequency", "modes[0].direction", "tangential_coefficient", "modes[0].mass"} <= drawn
    assert any("modes[0].mass: not determined" in note for note in found["notes"])
    plan = shell.json("plan", "planar/campaign.yaml", "-m", "planar/model.yaml", "--speed", "3500:4500:2",
                      "--depth", "0.1:0.3:2", "--draws", 20)
    assert plan["no_plan"] is None and plan["next"][0]["vibration"] > 1e-6
    assert set(plan["next"][0]["expects"]["the model as it is"]) == {"displacement", "tool_displacement_y"}


@pytest.mark.parametrize(("arguments", "said"), [
    (("plan", *PLAIN_FILES, "--speed", "2500", "--depth", "1", "--vibration", "0.2"), "no unit"),
    (("plan", *PLAIN_FILES, "--speed", "2500", "--depth", "1", "--vibration", "0 mm"), "is not above 0"),
    (("chart", "spread.yaml", *GRID, "--risk", "0"), "is no chance between 0 and 100 %"),
    (("chart", "spread.yaml", *GRID, "--risk", "5 Hz"), "does not convert to a bare number"),
    (("chart", "spread.yaml", *GRID, "--campaign", "nowhere.yaml"), "nowhere.yaml"),
    (("chart", "spread.yaml", "--speed", "2500:4500:2000", "--depth", "0.1:4:1000"), "would take some"),
    (("plan", *PLAIN_FILES, "--speed", "2500", "--depth", "1:4:0"), "asks for 0 points"),
    (("plan", *PLAIN_FILES, "--speed", "2500:4500", "--depth", "one:two"), "is not a range"),
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
