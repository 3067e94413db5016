"""The Python API gives the very answers of the command line, and its objects do what a notebook asks of them."""

from functools import partial
from pathlib import Path

import matplotlib.figure
import numpy as np
import pytest

import testbed
from testbed.engines import fast
from testbed.workshop import write_campaign
from tests.support.api_answers import behaves, same
from tests.support.campaign_files import BELIEVED, TRUE
from tests.support.made_taps import B2, Hammer, write_taps
from tests.support.shell import Shell
from tests.support.synthetic_campaign import TESTS, synthetic_campaign

SIMULATE = partial(fast.simulate, steps=37)  # another step size than the fit's


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("campaign")
    write_campaign(folder, synthetic_campaign(SIMULATE, TRUE, tests=TESTS[:3]), BELIEVED)
    return folder


@pytest.fixture
def shell(capsys, folder, monkeypatch):
    monkeypatch.chdir(folder)
    return Shell(capsys)


def test_multipliers(shell):
    found = same(shell, testbed.multipliers("model.yaml", "3810 rpm", "2.9 mm"),
                 "multipliers", "model.yaml", "--speed", "3810", "--depth", "2.9")
    behaves(found)
    assert found.stability == "stable" and found.spectral_radius == abs(found.multipliers[0]) > 0.5
    assert isinstance(found.plot(), matplotlib.figure.Figure)
    again = testbed.multipliers("model.yaml", found.spindle_speed, found.axial_depth_of_cut)
    assert again.json == found.json  # plain numbers are SI


def test_multipliers_with_effects(shell):
    Path("damped.yaml").write_text(Path("model.yaml").read_text() + "effects: {process_damping: {coefficient: 1.0e5 N/m}}\n")
    same(shell, testbed.multipliers("damped.yaml", "3810 rpm", "2.9 mm", feed="0.2 mm/tooth", count=3),
         "multipliers", "damped.yaml", "--speed", "3810", "--depth", "2.9", "--feed", "0.2 mm/tooth", "--count", "3")


def test_inspect(shell, tmp_path):
    found = same(shell, testbed.inspect("campaign.yaml"), "inspect", "campaign.yaml")
    behaves(found)
    assert len(found.records) == found.total == 3 and found.records[0].speed_basis == "tachometer"
    assert len(found.plot(found.records[1].name).axes) == 3
    assert len(found.save_plots(tmp_path, progress=False)) == 6
    bare = same(shell, testbed.inspect("cut_0.csv", rate="12.8 kHz"), "inspect", "cut_0.csv", "--rate", "12.8 kHz")
    assert bare.columns and bare.records[0].recording.sampling_rate == 12800.0


def test_compare(shell, tmp_path):
    told = []
    found = same(shell, testbed.compare("campaign.yaml", "model.yaml", progress=lambda *step: told.append(step)),
                 "compare", "campaign.yaml", "-m", "model.yaml")
    behaves(found)
    assert told == [("fitting the believed model to all records", 0, None)]
    assert found.adequate and found.converged and 0.9 < found.error / found.noise_floor < 1.05
    assert found.model.structure.natural_frequency == found.parameters["natural_frequency"].value
    seen = found.waveform(found.records[0].name)
    assert np.ptp(seen.predicted) > 10 * np.ptp(seen.residual) > 0
    whole = seen.to_xarray()
    assert whole.measured.dims == ("channel", "time")
    assert float(abs(whole.measured - whole.predicted - whole.residual).max()) < 1e-9 * np.ptp(seen.measured)
    assert {"worst_record", "residual_spectrum", "misfit_on_chart"} <= set(found.plots)
    assert len(found.plot("residual_by_record").axes) == 1 and len(seen.plot().axes) == 2
    with pytest.raises(testbed.InputProblem, match="there are residual_by_record"):
        found.plot("nonsense")
    page = found.report(tmp_path / "page", progress=False)
    assert page == tmp_path / "page" / "report.html" and "campaign.yaml against model.yaml" in page.read_text()


@pytest.mark.parametrize("method", ["multipliers", "waveform"])
def test_identify(shell, method, tmp_path):
    found = same(shell, testbed.identify("campaign.yaml", "model.yaml", method=method),
                 "identify", "campaign.yaml", "-m", "model.yaml", "--method", method, "-o", str(tmp_path / "told.yaml"))
    behaves(found)
    assert found.parameters["natural_frequency"].value == pytest.approx(146.42, abs=0.05)
    assert found.save_model(tmp_path / "new.yaml").read_bytes() == (tmp_path / "told.yaml").read_bytes()
    assert len(found.plot().axes) == 1


def test_chart(shell, tmp_path):
    grid = ("--speed", "2500:4500:9", "--depth", "0.5:4:5")
    found = same(shell, testbed.chart("model.yaml", "2500 rpm:4500 rpm:9", "0.5 mm:4 mm:5", data="campaign.yaml"),
                 "chart", "model.yaml", *grid, "--data", "campaign.yaml", "-o", str(tmp_path))
    assert found.largest_multiplier.shape == found.error.shape == (5, 9) and len(found.tests) == 3
    assert len(found.to_pandas()) == 45 and found.to_xarray().modulus.dims == ("axial_depth_of_cut", "spindle_speed")
    assert repr(found).startswith("<Chart: 9 speeds x 5 depths, ") and found._repr_html_().count("<tr>") == 10
    shown = [path.name for path in found.save_plots(tmp_path)]
    assert shown == ["stability_chart.png", "stability_chart.svg"]
    with pytest.raises(testbed.InputProblem, match="no chance is known"):
        found.plot_chance()
    numbers = testbed.chart("model.yaml", found.spindle_speed, found.axial_depth_of_cut.tolist(), data="campaign.yaml")
    assert numbers.json == found.json


def test_chart_with_chances(shell, tmp_path):
    Path("unsure.yaml").write_text(Path("model.yaml").read_text().replace("630 N/mm^2", "630 +- 60 N/mm^2"))
    found = same(shell, testbed.chart("unsure.yaml", "3000 rpm:4200 rpm:7", "0.5 mm:3 mm:4", draws=40, seed=3, risk="10%"),
                 "chart", "unsure.yaml", "--speed", "3000:4200:7", "--depth", "0.5:3:4", "--draws", "40", "--seed", "3",
                 "--risk", "10%", "-o", str(tmp_path))
    assert 0.0 <= found.stable_probability.min() < found.stable_probability.max() <= 1.0
    assert found.to_xarray().stable_probability.shape == (4, 7) and found.recommended.stable_probability >= 0.9
    assert len(found.plot_chance().axes) >= 1


def test_tap(shell, tmp_path, monkeypatch):
    pytest.importorskip("sdypy.EMA")
    path = write_taps(tmp_path, B2, hammer=Hammer(blows=2, spacing=1.0))
    monkeypatch.chdir(tmp_path)
    found = same(shell, testbed.tap(path.name), "tap", path.name, "-o", "told.yaml")
    behaves(found)
    frequencies = sorted(one.natural_frequency for one in B2)
    assert [one.natural_frequency.value for one in found.modes] == pytest.approx(frequencies, rel=2e-3)
    assert found.save_model("new.yaml").read_bytes() == Path("told.yaml").read_bytes()
    assert found.model.structure.modes[0].mass == found.modes[0].mass.value and found.guessed == ()
    assert len(found.plot().axes) == sum(len(group.responses) for group in found.detail.groups) > 0
    assert found.report("tap.html").read_text().startswith("<!")


@pytest.fixture(scope="module")
def damped(tmp_path_factory):
    """A campaign of short cuts with an effect that the model lacks."""
    folder = tmp_path_factory.mktemp("damped")
    cuts = synthetic_campaign(SIMULATE, TRUE.with_effect("process_damping", coefficient=2e5), seed=4, tests=TESTS[:2],
                              rate=3200.0, course=(10, 35, 15))
    write_campaign(folder, cuts, BELIEVED)
    return folder


@pytest.mark.long
def test_diagnose(shell, damped, tmp_path, monkeypatch):
    monkeypatch.chdir(damped)
    campaign, model = testbed.load("campaign.yaml"), testbed.load("model.yaml")
    found = same(shell, testbed.diagnose(campaign, model), "diagnose", "campaign.yaml", "-m", "model.yaml", "-o", str(tmp_path))
    behaves(found)
    assert found.verdict == "missing_effect" and found.effects == ("process_damping",)
    assert found.error["with_effects"] < found.error["baseline"] and "process_damping" in found.model.effects
    assert found.report(tmp_path / "ours.html").read_bytes() == (tmp_path / "report.html").read_bytes()
    assert len(found.plot().axes) == 1


@pytest.mark.long
def test_plan(shell, damped, monkeypatch):
    monkeypatch.chdir(damped)
    grid = ("--speed", "2600:4400:4", "--depth", "0.4:2:3", "--draws", "40", "--seed", "2", "--count", "2")
    found = same(shell, testbed.plan("campaign.yaml", "model.yaml", "2600 rpm:4400 rpm:4", "0.4 mm:2 mm:3", draws=40, seed=2,
                                     count=2), "plan", "campaign.yaml", "-m", "model.yaml", *grid)
    behaves(found)
    assert len(found.next) == 2 and found.no_plan is None and found.candidates == 12
    assert found.explanations == ("process_damping",) and len(found.plot().axes) == 1


@pytest.mark.long
def test_add(shell, damped, tmp_path, monkeypatch):
    monkeypatch.chdir(damped)
    found = same(shell, testbed.add("process_damping", testbed.load("campaign.yaml"), testbed.load("model.yaml")), "add",
                 "process_damping", "-m", "model.yaml", "-c", "campaign.yaml", "-o", str(tmp_path / "told.yaml"))
    behaves(found)
    assert found.after < found.before and found.save_model(tmp_path / "new.yaml").read_bytes() == \
        (tmp_path / "told.yaml").read_bytes()
    assert found.report(tmp_path).read_text().startswith("<!") and len(found.plot().axes) == 1
    assert testbed.multipliers(found.model, "3810 rpm", "2 mm").stability == "stable"


@pytest.mark.parametrize(("ask", "command"), [
    (lambda: testbed.multipliers("nix.yaml", "3810 rpm", "2 mm"), "multipliers nix.yaml --speed 3810 --depth 2"),
    (lambda: testbed.multipliers("model.yaml", "0.01 rpm", "2 mm"), "multipliers model.yaml --speed 0.01 --depth 2"),
    (lambda: testbed.compare("model.yaml", "model.yaml"), "compare model.yaml -m model.yaml"),
    (lambda: testbed.inspect("nix.csv"), "inspect nix.csv"),
    (lambda: testbed.add("runnout", "campaign.yaml", "model.yaml"), "add runnout -m model.yaml -c campaign.yaml -o new.yaml"),
    (lambda: testbed.diagnose("campaign.yaml", "nix.yaml"), "diagnose campaign.yaml -m nix.yaml"),
    (lambda: testbed.chart("nix.yaml", "3000 rpm", "2 mm"), "chart nix.yaml --speed 3000 --depth 2 -o pictures"),
    (lambda: testbed.tap("model.yaml"), "tap model.yaml"),
    (lambda: testbed.sweep("nix.yaml", "nix.h5"), "run nix.yaml -o nix.h5"),
])
def test_bad_input_is_told_in_the_command_s_one_line(shell, ask, command):
    with pytest.raises(testbed.InputProblem) as problem:
        ask()
    assert isinstance(problem.value, ValueError)
    assert shell.refused(*command.split()) == f"error: {problem.value}\n"


@pytest.mark.parametrize(("speed", "depth", "said"), [
    ("3810", "2 mm", "speed: '3810' has no unit: write '3810 rpm'"),
    (3810e6, "2 mm", "speed: 3.81e.09 rad/s is beyond any cut"),
    (400.0, 2.9e4, "depth: 29000 m is beyond any cut"),
    (400.0, "2.9 kg", "depth: '2.9 kg' is not a range"),
    (0.0, "2 mm", "speed: 0 rad/s must be above 0"),
    (float("nan"), "2 mm", "speed: nan is not finite"),
    ("2000:3000:3 rpm", "2 mm", "speed: '2000:3000:3 rpm' is not a range"),
    ("2000 rpm:3000 rpm:3", "2 mm", "speed: '2000 rpm:3000 rpm:3' is a range"),
    (True, "2 mm", "speed: True is no quantity"),
])
def test_quantities_are_checked(shell, speed, depth, said):
    with pytest.raises(testbed.InputProblem, match=said):
        testbed.multipliers("model.yaml", speed, depth)
