"""`testbed identify` as a user meets it: a cut too short to use, and an effect that the model has already."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from testbed.analysis.estimate import Estimate
from testbed.analysis.multipliers import identify as search
from testbed.analysis.multipliers.identify import at_an_end
from testbed.api.identification import identify_by_multipliers
from testbed.api.words import interval_shown
from testbed.engines import fast
from testbed.files.model_file import read_model
from testbed.workshop import write_campaign
from tests.support.campaign_files import BELIEVED, TRUE
from tests.support.shell import Shell
from tests.support.synthetic_campaign import synthetic_campaign

LONG, SHORT, SILENT = (10, 40, 30), (10, 4, 60), (10, 40, 0)  # revolutions of idling, cutting, ringing down
TESTS = ((3810, 2.9), (2850, 2.9), (4200, 1.5))
EFFECT, PATH, STRENGTH = "process_damping", "process_damping.coefficient", 6.0e5


@pytest.fixture
def testbed(capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return Shell(capsys)


def cuts(*courses, true=TRUE):
    """A measured cut for each course."""
    return [
        synthetic_campaign(fast.simulate, true, seed=number, tests=TESTS[number : number + 1], course=course, rate=6400.0)[0]
        for number, course in enumerate(courses)
    ]


def clipped(record):
    """The record of a sensor that is stuck at its limit for five samples about the largest one."""
    values = record.recording.channels["displacement"].copy()
    top = int(np.argmax(values))
    values[top - 2 : top + 3] = values[top] + 0.05 * np.ptp(values)
    return replace(record, recording=replace(record.recording, channels={"displacement": values}))


def test_a_cut_too_short_is_left_out_and_a_clipped_one_is_doubted(testbed):
    first, second, short = cuts(LONG, LONG, SHORT)
    write_campaign(Path(), [first, second, clipped(short)], BELIEVED)
    found = testbed.json("identify", "campaign.yaml", "-m", "model.yaml")
    assert [test["used"] for test in found["tests"]] == [True, True, False]
    assert "tooth periods in the cut; at least 6 are needed" in found["tests"][2]["reason"]
    assert "cut_2 was left out: " in testbed.err and found["tests"][2]["measured"] == []
    assert found["parameters"]["natural_frequency"]["value"] == pytest.approx(TRUE.structure.natural_frequency, abs=0.1)
    assert any(note.startswith("cut_2: channel displacement: ") and "are clipped" in note for note in found["notes"])
    assert all(f"{note}\n" in testbed.err for note in found["notes"])


def test_where_only_short_cuts_are_left_they_are_named(testbed):
    write_campaign(Path(), cuts(SHORT, SHORT), BELIEVED)
    said = testbed.refused("identify", "campaign.yaml", "-m", "model.yaml")
    assert said.startswith("error: campaign.yaml: only 0 numbers for 3 parameters; tests left out: cut_0 (")
    assert ", cut_1 (" in said and said.count("tooth periods in the cut; at least 6 are needed") == 2


def test_multipliers_that_a_linear_machine_explains_by_half_are_told(testbed):
    """A misfit that widens the intervals is no proof that they hold the machine: damping of the cut passes for its own."""
    write_campaign(Path(), cuts(LONG, LONG, LONG, true=TRUE.with_effect(EFFECT, coefficient=1e5)), BELIEVED)
    found = testbed.json("identify", "campaign.yaml", "-m", "model.yaml")
    assert 5.0 < found["chi_square"] < 30.0 and found["at_bound"] == []
    said = f"the misfit per degree of freedom is {found['chi_square']:.2g}. The intervals are widened for it, but "
    (note,) = [note for note in found["notes"] if note.startswith(said)]
    assert note.endswith("see testbed compare and testbed diagnose") and f"{note}\n" in testbed.err


def test_a_parameter_at_the_end_of_the_range_searched_is_told(testbed):
    """No frequency about the believed one explains these cuts, and no decay tells another: the damping goes to its end."""
    write_campaign(Path(), cuts(SILENT, SILENT, SILENT), BELIEVED.with_values({"natural_frequency": 220.0}))
    found = testbed.json("identify", "campaign.yaml", "-m", "model.yaml")
    assert found["at_bound"] == ["damping_ratio"] and found["parameters"]["damping_ratio"]["value"] < 1e-5
    (note,) = [note for note in found["notes"] if note.startswith("damping_ratio at the end of the range searched: ")]
    assert "from 0.8 to 1.25 times the frequency" in note
    assert "from 0.01 to 100 times the coefficients" in note and f"{note}\n" in testbed.err


def test_a_frequency_that_every_free_decay_contradicts_is_taken_from_them(testbed):
    """926.8 Hz believed, 146.42 Hz rings after every cut: of the many frequencies that multipliers have, one is near."""
    write_campaign(Path(), cuts(LONG, LONG, LONG), BELIEVED.with_values({"natural_frequency": 926.8}))
    found = testbed.json("identify", "campaign.yaml", "-m", "model.yaml")
    assert found["parameters"]["natural_frequency"]["value"] == pytest.approx(146.42, rel=2e-3)
    coefficient = found["parameters"]["tangential_coefficient"]
    assert coefficient["low"] < TRUE.cutting.tangential_coefficient < coefficient["high"] < 2.0 * coefficient["low"]
    assert any(note.startswith("the free decays ring at 146.") and "926.8 Hz" in note for note in found["notes"])


def test_the_ends_of_the_ranges_are_those_of_the_search(monkeypatch):
    searched, fitted = set(), search.least_squares

    def noted(*given, bounds, **more):
        searched.add(tuple(map(tuple, np.exp(bounds))))
        return fitted(*given, bounds=bounds, **more)

    monkeypatch.setattr(search, "least_squares", noted)
    identify_by_multipliers(BELIEVED, cuts((10, 40, 0), (10, 40, 0)), "campaign.yaml", 0)  # no free decay to begin from
    (ends,) = searched
    for place, name in enumerate(("natural_frequency", "damping_ratio", "tangential_coefficient")):
        for end, inwards in zip((ends[0][place], ends[1][place]), (1.01, 0.99), strict=True):
            value = end * BELIEVED.value(name)
            assert at_an_end(BELIEVED, BELIEVED.with_values({name: value})) == (name,)
            assert at_an_end(BELIEVED, BELIEVED.with_values({name: inwards * value})) == ()
    still = BELIEVED.with_values({"normal_coefficient": 0.0})
    assert at_an_end(still, still) == ()  # of no force there is no range


def test_the_waveform_corrects_an_effect_that_the_model_has(testbed):
    records = cuts((10, 30, 15), (10, 30, 15), (10, 30, 15), true=TRUE.with_effect(EFFECT, coefficient=STRENGTH))
    write_campaign(Path(), records, BELIEVED.with_effect(EFFECT, coefficient=STRENGTH / 3))
    found = testbed.json("identify", "campaign.yaml", "-m", "model.yaml", "--method", "waveform", "-o", "new.yaml")
    one = found["parameters"][PATH]
    assert one["value"] == pytest.approx(STRENGTH, rel=0.1) and one["unit"] == "N/m"
    assert one["low"] < one["value"] < one["high"] < 1.3 * STRENGTH
    assert all(abs(complex(*test["measured"][0]) - complex(*test["model"][0])) < 0.05 for test in found["tests"])
    assert read_model("new.yaml").value(PATH) == one["value"] and f"\n{PATH} " in testbed.err


def test_waveforms_that_the_model_does_not_explain_are_told(testbed):
    write_campaign(Path(), cuts((8, 20, 10), (8, 20, 10), true=TRUE.with_effect(EFFECT, coefficient=STRENGTH)), BELIEVED)
    found = testbed.json("identify", "campaign.yaml", "-m", "model.yaml", "--method", "waveform")
    assert found["chi_square"] > 1.1 and any("may bend its parameters" in note for note in found["notes"])


def test_of_noise_alone_no_interval_is_told_without_a_word(testbed):
    noise = np.random.default_rng(5)
    records = []
    for record in cuts((8, 12, 6), (8, 12, 6)):
        values = 4e-6 * noise.standard_normal(len(record.recording))
        records.append(replace(record, recording=replace(record.recording, channels={"displacement": values})))
    write_campaign(Path(), records, BELIEVED)
    found = testbed.json("identify", "campaign.yaml", "-m", "model.yaml", "--method", "waveform")
    assert any(note.startswith("almost only noise") for note in found["notes"])
    verdict = testbed.json("diagnose", "campaign.yaml", "-m", "model.yaml")
    assert verdict["verdict"] == "undecided" and verdict["effects"] == [] and "noise" in verdict["sentence"]
    compared = testbed.json("compare", "campaign.yaml", "-m", "model.yaml")
    silence = "cut_0, cut_1: almost only noise was measured, which does not test the model"
    assert compared["adequate"] is None and compared["notes"][-1] == silence and testbed.err.count(silence) == 1
    rows = {line.split()[0]: line for line in testbed.err.splitlines() if line.strip()}
    for name, one in compared["parameters"].items():  # people and programs are told the same
        assert one["determined"] == ("not determined" not in rows[name])


def test_an_interval_is_shown_with_the_digits_that_tell_its_ends_apart():
    assert interval_shown(Estimate(146.49979, 146.49952, 146.50006, "Hz")) == ("146.49979 Hz", "146.49952 Hz", "146.50006 Hz")
    assert interval_shown(Estimate(5.5e8, 5.4e8, 5.6e8, "N/m^2")) == ("550 N/mm^2", "540 N/mm^2", "560 N/mm^2")
    for wide in (Estimate(5.0, 5e-120, 5e120, "1"), Estimate(5.0, float("nan"), float("nan"), "1")):
        assert interval_shown(wide) == ("5", "not determined", "not determined")
        assert wide.as_json() == {"value": 5.0, "low": None, "high": None, "unit": "1", "determined": False}
    known = {"value": 5.0, "low": 4.0, "high": 6.0, "unit": "1", "determined": True}
    assert Estimate(5.0, 4.0, 6.0, "1").as_json() == known
    assert interval_shown(Estimate(5.0, 0.1, 60.0, "1"))[1:] == ("not determined", "not determined")  # over decades
    assert Estimate(0.0, -1.0, 1.0, "1", size=1.0).determined and not Estimate(5.0, 4.0, 6.0, "1", bounded=False).determined


def as_velocity(record, seed):
    """The record of a vibrometer without a tachometer: noise of 20 um/s rms."""
    recording = record.recording
    values = np.gradient(recording.channels["displacement"], 1.0 / recording.sampling_rate)
    values = values + 2e-5 * np.random.default_rng(seed).standard_normal(values.size)
    measured = replace(recording, channels={"velocity": values}, units={"velocity": "m/s"}, marks=recording.marks[:0])
    return replace(record, recording=measured)


def test_a_velocity_without_a_tachometer_tells_the_multipliers_too():
    records = [synthetic_campaign(fast.simulate, TRUE, seed=number, tests=TESTS[number : number + 1], course=LONG, rate=12800.0,
                                  noise=1e-10, speed_error=5e-3)[0] for number in range(3)]  # fmt: skip
    measured = [as_velocity(record, place) for place, record in enumerate(records)]
    found = identify_by_multipliers(BELIEVED, measured, "campaign.yaml", 0)
    assert all(test["used"] for test in found.tests) and found.quality["chi_square"] < 5.0
    stated = [record.conditions["spindle_speed"] for record in records]
    assert max(abs(test["spindle_speed"] / one - 1.0) for test, one in zip(found.tests, stated, strict=True)) > 1e-3
    for name in ("natural_frequency", "damping_ratio", "tangential_coefficient", "normal_coefficient"):
        one = found.parameters[name]
        assert one.low < TRUE.value(name) < one.high, name


def test_speeds_that_nobody_measured_are_told_beside_those_stated(testbed):
    records = [synthetic_campaign(fast.simulate, TRUE, seed=number, tests=TESTS[number : number + 1], course=LONG, rate=6400.0,
                                  speed_error=8e-3)[0] for number in range(3)]  # fmt: skip
    write_campaign(Path(), records, BELIEVED)
    with_marks = testbed.json("identify", "campaign.yaml", "-m", "model.yaml")
    assert not any("without a tachometer" in note for note in with_marks["notes"])
    lines = [line for line in Path("campaign.yaml").read_text().splitlines() if "tachometer" not in line]
    Path("campaign.yaml").write_text("\n".join(lines) + "\n")
    found = testbed.json("identify", "campaign.yaml", "-m", "model.yaml")
    (note,) = [note for note in found["notes"] if note.startswith("without a tachometer, the speed is read from the vibration")]
    assert " rpm (stated 3810 rpm)" in note
    for test, other in zip(found["tests"], with_marks["tests"], strict=True):
        assert test["spindle_speed"] == pytest.approx(other["spindle_speed"], rel=1e-4)
    one, other = (answer["parameters"]["tangential_coefficient"] for answer in (found, with_marks))
    assert one["value"] == pytest.approx(other["value"], rel=0.02) and one["low"] < other["value"] < one["high"]
