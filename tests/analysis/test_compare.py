"""Where a model fails: errors by record and segment, nuisances found again, and what the command prints and draws."""

import json
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from matplotlib.figure import Figure

from testbed.analysis.comparison.adequacy import LEFT_EXPLAINED, Adequacy, controlled, said_left
from testbed.analysis.comparison.compare_plots import by_test, spectrum, worst_record
from testbed.analysis.comparison.constancy import Constancy, TestFit
from testbed.analysis.estimate import Estimate
from testbed.cli import compare as compared
from testbed.cli import main
from testbed.cli._answer import Answer
from testbed.engines import fast
from testbed.workshop import write_campaign
from tests.support import report_pages as pages
from tests.support.campaign_files import BELIEVED, TRUE
from tests.support.synthetic_campaign import MARK_ANGLE, TESTS, synthetic_campaign

SIMULATE = partial(fast.simulate, steps=37)  # another step size than the fit's
FEW = TESTS[:3]


@pytest.fixture(scope="module")
def answer(tmp_path_factory):
    folder = tmp_path_factory.mktemp("complete")
    write_campaign(folder, synthetic_campaign(SIMULATE, TRUE, tests=FEW), BELIEVED)
    with pytest.raises(SystemExit) as stop:
        main(["compare", str(folder / "campaign.yaml"), "-m", str(folder / "model.yaml"), "--quiet",
              "--json", str(folder / "c.json"), "-o", str(folder / "pictures")])
    assert stop.value.code == 0
    return json.loads((folder / "c.json").read_text()), folder


def test_a_complete_model_leaves_the_noise(answer):
    found, _ = answer
    assert 0.9 < found["error"] / found["noise_floor"] < 1.02
    for record in found["records"]:
        assert record["held_out"]
        assert record["chi_square"] == pytest.approx(1.0, abs=0.1)
        assert {"idle", "entry", "steady", "ring-down"} <= {part["kind"] for part in record["segments"]}


def test_the_nuisances_are_found_again(answer):
    found, _ = answer
    angle = found["nuisances"]["mark_angle"]
    apart = (angle + MARK_ANGLE + np.pi) % (2 * np.pi) - np.pi  # the mark stands MARK_ANGLE before the tooth's entry
    assert abs(np.degrees(apart)) < 0.5
    for record, (rpm, _), hidden in zip(found["records"], FEW, synthetic_campaign(SIMULATE, TRUE, tests=FEW),
                                        strict=True):
        own = record["nuisances"]
        marks = hidden.recording.marks
        true_speed = 2 * np.pi * (len(marks) - 1) / (marks[-1] - marks[0])
        assert own["spindle_speed"] == pytest.approx(true_speed, rel=2e-5)
        assert abs(own["speed_error"]) < 6e-4
        assert own["entry_time"] < own["exit_time"]
        assert own["exit_time"] - own["entry_time"] == pytest.approx(70 * 60 / rpm, abs=1.5 * 60 / rpm)


def test_the_base_parameters_are_found_again(answer):
    parameters = answer[0]["parameters"]
    for path in ("natural_frequency", "damping_ratio", "tangential_coefficient", "normal_coefficient"):
        one = parameters[path]
        half = 0.5 * (one["high"] - one["low"])
        assert half > 0
        assert abs(one["value"] - TRUE.value(path)) < 2.0 * half  # four standard deviations: one draw of the noise
        assert one["value"] == pytest.approx(TRUE.value(path), rel=0.1)


def test_pictures_are_drawn(answer):
    names = {path.name for path in (answer[1] / "pictures").iterdir()}
    assert {f"{name}.{ending}" for name in ("residual_by_record", "worst_record", "residual_by_tooth_angle",
                                            "residual_spectrum", "misfit_on_chart", "constancy", "amplitude_dependence")
            for ending in ("png", "svg")} | {"report.html"} == names


@pytest.mark.parametrize(("units", "unit", "factor"), [({"displacement": "m"}, "µm", 1e6), ({"displacement": "V"}, "V", 1.0),
                                                       ({}, "µm", 1e6)])
def test_the_worst_record_is_drawn_in_the_channel_s_own_unit(units, unit, factor):
    found = pages.comparison()
    worst = max(range(len(found.records)), key=lambda place: found.records[place].chi_square)
    figure, lines = Figure(), Figure()
    worst_record(figure, found, units)
    spectrum(lines, found, units)
    above, below = figure.axes
    assert above.get_ylabel() == f"displacement [{unit}]" and below.get_ylabel() == f"residual [{unit}]"
    rest = found.errors[worst].residual[0]
    assert np.abs(below.lines[0].get_ydata()).max() == pytest.approx(factor * np.abs(rest).max())
    assert lines.axes[0].get_ylabel().endswith(f"[{unit}]")
    assert lines.axes[0].lines[0].get_ydata().max() < factor * np.abs(rest).max()
    said = {text.get_text() for text in figure.legends[0].get_texts()}
    assert {"measured", "predicted", "residual", "twice the noise"} < said
    assert said >= {segment.kind for segment in found.fitter.records[worst].segments}


def test_constants_are_drawn_within_their_bounds_and_every_axis_is_named():
    def test(number, low, value, high, conditions):
        return TestFit(f"cut {number}", conditions, {"tangential_coefficient": Estimate(value, low, high, "N/m^2"),
                                                     "natural_frequency": Estimate(100.0, 99.0, 101.5, "Hz")}, True)

    tests = tuple(test(number, 0.0, 1e6, 70e6, {}) for number in range(2))  # at the lower bound: nothing lies below it
    figure = Figure()
    by_test(figure, Constancy(tests, (), dict.fromkeys(("tangential_coefficient", "natural_frequency"), 0.5),
                              dict.fromkeys(("tangential_coefficient", "natural_frequency"), 1e-5)))
    frequency, coefficient = figure.axes
    ends = np.concatenate([path.vertices for path in coefficient.collections[0].get_paths()])[:, 1]
    assert (ends.min(), ends.max()) == (0.0, pytest.approx(70.0))  # N/mm^2
    assert [axis.get_xlabel() for axis in figure.axes] == ["test", "test"]
    assert [label.get_text() for label in coefficient.get_xticklabels()] == ["cut 0", "cut 1"]
    assert (frequency.get_ylabel(), coefficient.get_ylabel()) == ("$f_n$ [Hz]", "$K_t$ [N/mm^2]")


def test_what_is_left_is_told_in_plain_words():
    failing = [Adequacy("a", test, 1.0, 0.0, True) for test in ("rms", "autocorrelation", "tooth angle", "rms, force_y")]
    tests = [*failing, Adequacy("a", "tooth angle, force_y", 1.0, 0.9), Adequacy("b", "rms", 1.0, 0.9)]
    assert said_left(tests, "a") == "too large, not random, recurring with the tooth, too large in force_y"
    assert said_left(tests, "b") == "noise"


def test_compare_explains_what_is_left_where_something_is(answer, tmp_path, capsys):
    code, out, _ = run(capsys, "compare", answer[1] / "campaign.yaml", "-m", answer[1] / "model.yaml")
    assert code == 0 and "what is left is\n" in out and LEFT_EXPLAINED not in out
    assert len([line for line in out.splitlines() if line.endswith("  noise")]) == len(FEW)
    compared._say(Answer(None, False), pages.comparison(), [], BELIEVED)
    assert LEFT_EXPLAINED in capsys.readouterr().out


def test_false_discoveries_are_controlled():
    few = [Adequacy("r", str(number), 0.0, p) for number, p in enumerate((0.001, 0.012, 0.04, 0.2, 0.9))]
    assert [one.fails for one in controlled(few)] == [True, True, False, False, False]
    assert not any(one.fails for one in controlled([Adequacy("r", "t", 0.0, 0.06)]))


def run(capsys, *arguments):
    with pytest.raises(SystemExit) as stop:
        main([str(argument) for argument in arguments])
    return stop.value.code, *capsys.readouterr()


@pytest.mark.parametrize("command", [("compare",), ("diagnose",), ("identify", "--method", "waveform")])
def test_a_model_without_a_cutter_cannot_predict_a_cut(answer, tmp_path, capsys, command):
    bare = tmp_path / "bare.yaml"
    bare.write_text("structure: {mass: 1 kg, natural_frequency: 100 Hz, damping_ratio: 0.01}\n")
    code, out, err = run(capsys, command[0], answer[1] / "campaign.yaml", "-m", bare, *command[1:])
    assert code == 2 and out == ""
    assert err.count("\n") == 1 and "bare.yaml" in err and "cutter" in err


def test_flutes_that_disagree_are_refused(answer, tmp_path, capsys):
    text = (answer[1] / "campaign.yaml").read_text().replace("kind: cut,", "kind: cut, flutes: 3,")
    for path in answer[1].glob("cut_*.csv"):
        (tmp_path / path.name).write_bytes(path.read_bytes())
    (tmp_path / "campaign.yaml").write_text(text)
    code, _, err = run(capsys, "compare", tmp_path / "campaign.yaml", "-m", answer[1] / "model.yaml")
    assert code == 2 and "3 flutes" in err and err.count("\n") == 1


def test_a_ring_down_alone_is_compared(tmp_path: Path, capsys):
    rate, time = 2000.0, np.arange(4000) / 2000.0
    decay = 1e-4 * np.exp(-0.01 * 2 * np.pi * 80 * time) * np.cos(2 * np.pi * 80 * np.sqrt(1 - 1e-4) * time)
    noise = 2e-7 * np.random.default_rng(5).standard_normal(time.size)
    np.savetxt(tmp_path / "tap.csv", (decay + noise) * 1e6, header="x", comments="")
    (tmp_path / "c.yaml").write_text(f"name: taps\nsampling_rate: {rate:g} Hz\nchannels:\n  displacement: "
                                     "{column: x, unit: um}\nrecords:\n  - {file: tap.csv, kind: ring-down}\n")
    (tmp_path / "m.yaml").write_text("structure: {mass: 1 kg, natural_frequency: 82 Hz, damping_ratio: 0.02}\n")
    code, out, err = run(capsys, "compare", tmp_path / "c.yaml", "-m", tmp_path / "m.yaml", "--json", "-")
    assert code == 0, err
    found = json.loads(out)
    assert found["error"] < 1.05 * found["noise_floor"]
    assert found["parameters"]["natural_frequency"]["value"] == pytest.approx(80.0, rel=1e-4)
    assert found["parameters"]["damping_ratio"]["value"] == pytest.approx(0.01, rel=2e-2)
    assert found["records"][0]["held_out"] is False
