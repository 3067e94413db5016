"""The Python API gives the very answers of the command line, and its objects do what a notebook asks of them."""

import json
import pkgutil
from functools import partial
from pathlib import Path

import matplotlib.figure
import numpy as np
import pytest

import testbed
from testbed.api.result import json_text
from testbed.engines import fast
from testbed.workshop import write_campaign
from tests.support.campaign_files import BELIEVED, TRUE
from tests.support.made_taps import B2, Hammer, write_taps
from tests.support.shell import Shell
from tests.support.synthetic_campaign import TESTS, synthetic_campaign

SIMULATE = partial(fast.simulate, steps=37)  # another step size than the fit's

SCENARIO = """seed: 3
model:
  structure: {mass: 2.573 kg, natural_frequency: 146.6 Hz, damping_ratio: 0.0032}
  cutter: {flutes: 1, diameter: 19.05 mm}
  cutting: {immersion: 0.162, tangential_coefficient: 550 N/mm^2, normal_coefficient: 165 N/mm^2}
cut: {idle: 5 rev, cutting: 30 rev, ring_down: 30 rev}
tests:
  - {spindle_speed: 3810 rpm, depth_of_cut: 2.9 mm}
  - {spindle_speed: 2850 rpm, depth_of_cut: 2.9 mm}
  - {spindle_speed: 4100 rpm, depth_of_cut: 2.0 mm}
sensors: {displacement: {noise: 0.1 um}}
engine: {name: fast}
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("campaign")
    write_campaign(folder, synthetic_campaign(SIMULATE, TRUE, tests=TESTS[:3]), BELIEVED)
    return folder


@pytest.fixture
def shell(capsys, folder, monkeypatch):
    monkeypatch.chdir(folder)
    return Shell(capsys)


def same(shell, found, *command):
    """The command's JSON, to the last digit and in the same order."""
    assert shell(*command, "--json", "-") == 0, shell.err
    assert found.json == shell.out and found.to_dict() == json.loads(shell.out)
    assert len(found.json) > 200
    return found


def behaves(found):
    """What every answer does."""
    assert repr(found).startswith(f"<{type(found).__name__}: ") and len(repr(found)) < 500
    html = found._repr_html_()
    assert html.startswith("<p><b>") and html.count("<tr>") > 1
    frame, arrays = found.to_pandas(), found.to_xarray()
    assert len(frame) > 0 and all(len(variable) == len(frame) for variable in arrays.variables.values())
    with pytest.raises(AttributeError):
        found.notes = ()


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


def test_score(shell, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("cuts.yaml").write_text(SCENARIO)
    made = testbed.sweep("cuts.yaml", "cuts.h5", progress=False)
    told = []
    found = testbed.score(made.data, noise=("1 um", 2e-6), repeats=2, tests=(2,), seed=4,
                          progress=lambda *one: told.append(one))
    order = ("--noise", "1um,2um", "--repeats", "2", "--tests", "2", "--seed", "4")
    assert shell("score", "cuts.h5", *order, "--json", "-") == 0
    ours, theirs = found.to_dict(), json.loads(shell.out)
    assert ours.pop("cost") and theirs.pop("cost")  # of processor time, no two are alike
    assert ours == theirs and ours["method"] == "multipliers" and len(found.scores) == 6
    behaves(found)
    assert told[-1] == ("identifying", 4, 4) and found.truth["natural_frequency"] == 146.6
    assert all(one.rms < 0.05 * one.truth for one in found.scores if one.parameter == "natural_frequency")
    assert len(found.plot().axes) == 6 and {"score.md", "score_noise.png"} <= {one.name for one in found.save("out")}
    with pytest.raises(testbed.InputProblem, match="there are score_noise, score_cost"):
        found.plot("score_tests")
    for wrong, said in (({"noise": "1 kg"}, "noise: "), ({"noise": -1.0}, "below 0"), ({"repeats": 0}, "0 is below 1"),
                        ({"tests": (4,)}, "holds 3 tests, not 4"), ({"method": "wavefrom"}, "did you mean waveform")):
        with pytest.raises(testbed.InputProblem, match=said):
            testbed.score("cuts.h5", **wrong)


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


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """A data set of three cuts."""
    folder = tmp_path_factory.mktemp("made")
    (folder / "cuts.yaml").write_text(SCENARIO)
    return testbed.sweep(folder / "cuts.yaml", folder / "cuts.h5", progress=False).data


def test_verify(shell, made, tmp_path):
    found = same(shell, testbed.verify(made.path), "verify", str(made.path))
    assert found.intact and found.runs == 3 and "intact" in repr(found)
    whole = Path(made.path).read_bytes()
    (tmp_path / "bad.h5").write_bytes(whole[:9000] + bytes([whole[9000] ^ 1]) + whole[9001:])
    broken = testbed.verify(tmp_path / "bad.h5", quick=True)
    assert not broken.intact and broken.damage[0].startswith("the file's bytes are not those") and len(broken.to_pandas()) > 0


@pytest.mark.parametrize(("asked", "order"), [
    ({"seed": 3}, ("--seed", "3")),
    ({"window": 512, "step": 256, "rate": "6.4 kHz", "shares": (60, 20, 20)},
     ("--window", "512", "--step", "256", "--rate", "6.4kHz", "--split", "60,20,20"))])
def test_export(shell, made, tmp_path, monkeypatch, asked, order):
    pytest.importorskip("pyarrow")
    monkeypatch.chdir(tmp_path)
    found = testbed.export(made, "ours", **asked)
    assert shell("export", str(made.path), "-o", "theirs", *order, "--json", "-") == 0, shell.err
    assert found.json.replace('"ours"', '"theirs"') == shell.out
    behaves(found)
    assert found.splits.keys() == {"train", "validation", "test"} and found.baseline["features"]
    ours, theirs = ({path.relative_to(name): path.read_bytes() for path in Path(name).rglob("*.*")}
                    for name in ("ours", "theirs"))
    assert ours == theirs and {"README.md", "croissant.json"} < {str(path) for path in ours}


def test_export_refuses_in_one_line(made, tmp_path):
    for wrong, said in (({"step": 9}, "step: goes with a window"), ({"window": 4}, "4 is below 8"),
                        ({"shares": (1, 2)}, "'1, 2' are no shares"), ({"licence": "mine"}, "there is no 'mine'"),
                        ({"split_by": "run"}, "give condition, machine"),
                        ({"rate": "3 kg"}, "rate: ")):
        with pytest.raises(testbed.InputProblem, match=said):
            testbed.export(made, tmp_path / "new", **wrong)
    with pytest.raises(testbed.InputProblem, match="exists already"):
        testbed.export(made, tmp_path)


def test_effects(shell, tmp_path, monkeypatch):
    known = testbed.list_effects()
    assert shell("effects", "--json", "-") == 0 and json.loads(shell.out) == {
        "effects": [json.loads(json_text(testbed.effect_card(name))) for name in known]}
    assert shell("effects", "runout", "--no-picture", "--json", "-") == 0
    assert shell.out == json_text(testbed.effect_card("runout"))
    with pytest.raises(testbed.InputProblem, match="did you mean runout"):
        testbed.effect_card("runnout")
    monkeypatch.chdir(tmp_path)
    effect, test = testbed.new_effect("my_drag", "mine")
    assert testbed.effect_card("my_drag", "mine")["file"] == str(effect) and test.name == "test_my_drag.py"
    assert shell("effects", "--new", "my_drag") == 0 and Path("my_drag.py").read_text() == effect.read_text()
    with pytest.raises(testbed.InputProblem, match="exists already"):
        testbed.new_effect("my_drag", "mine")


def test_every_command_is_a_function_but_those_that_make_something_to_look_at():
    commands = {path.stem for path in (Path(testbed.__file__).parent / "cli").glob("*.py") if not path.stem.startswith("_")}
    named = {"run": "sweep", "effects": "list_effects"}
    assert {one for one in commands if named.get(one, one) not in testbed.__all__} == \
        {"benchmark", "demo", "doctor", "init", "paper", "view"}
    for name in set(testbed.__all__) - {"__version__"}:  # no submodule takes a public name's place
        assert getattr(testbed, name).__module__.startswith("testbed."), name


def test_a_walk_through_the_package_ends():
    names = [one.name for one in pkgutil.walk_packages(testbed.__path__, "testbed.")]
    assert "testbed.api.chart" in names and not any(name.startswith("testbed.testbed") for name in names)
    assert len(names) == len(set(names)) < 1000
