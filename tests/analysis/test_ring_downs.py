"""Ring-downs as they come: slow and fast, several blows, growth, coarse steps and a stop, motion as fast as the sampling."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from testbed.analysis.fit.observe import observe
from testbed.analysis.fit.structure_start import decay_start
from testbed.analysis.records.blows import find_blows, grows
from testbed.analysis.records.decay_modes import decay_modes
from testbed.analysis.records.noise import noise_floor
from testbed.analysis.records.record_report import report
from testbed.analysis.records.ring_downs import notes_of, ring_downs, separated
from testbed.analysis.records.segments import find_segments
from testbed.analysis.records.white_noise import read_white_noise
from testbed.cli.inspect import command as inspect_command
from testbed.files.campaign import Record, load_campaign
from testbed.machine import Model, Structure
from testbed.recording import Recording
from tests.support.made_decays import decay, recorded, rubbed, rung, taps

THREE = ((0.5, 20.0), (2.0, 14.0), (3.5, 25.0))


def modes_in(recording: Recording) -> list:
    """The modes of all ring-downs of a record."""
    return [mode for ring in ring_downs(recording, find_segments(recording, kind="ring-down")) for mode in ring.modes]


@pytest.mark.parametrize("frequency", [0.1, 0.8, 12.0, 900.0, 20e3])
@pytest.mark.parametrize("per_swing", [3.5, 37.0])
def test_frequency_and_damping_of_a_decay_whatever_its_time_scale(frequency: float, per_swing: float) -> None:
    rate, samples = per_swing * frequency, round(30 * per_swing)
    time = np.arange(samples) / rate
    values = 3e-4 * (decay(time, 0.0, frequency, 0.01, 0.7) + 0.003 * np.random.default_rng(1).standard_normal(samples))
    recording = recorded(values, rate)
    (found,) = modes_in(recording)
    assert found.natural_frequency.value == pytest.approx(frequency, rel=1e-3)
    assert found.damping_ratio.value == pytest.approx(0.01, rel=0.05)


def test_two_modes_ring_beside_each_other() -> None:
    time, random = np.arange(8000) / 4000.0, np.random.default_rng(2)
    values = 100 * decay(time, 0.0, 147.5, 0.005, 1.0) + 40 * decay(time, 0.0, 190.0, 0.008, -0.9)
    recording = recorded(values + 0.2 * random.standard_normal(8000), 4000.0)
    found = modes_in(recording)
    assert [one.natural_frequency.value for one in found] == pytest.approx([147.5, 190.0], rel=1e-4)
    assert [one.damping_ratio.value for one in found] == pytest.approx([0.005, 0.008], rel=0.01)


MACHINE = ((456.8, 0.0112, 0.35, 1.0), (516.5, 0.0246, 1.31, 0.7), (1448.9, 0.017, -0.61, 0.5))


def test_modes_in_x_and_y_give_their_shapes_and_directions() -> None:
    time, random = np.arange(12000) / 25600.0, np.random.default_rng(3)
    along_x, along_y = rung(MACHINE, time) + 2e-3 * random.standard_normal((2, len(time)))
    for names in (("acceleration_x", "acceleration_y"), ("acceleration_y", "acceleration_x")):  # in any order
        channels = {name: along_x if name.endswith("x") else along_y for name in names}
        found = modes_in(Recording(channels, 25600.0, dict.fromkeys(names, "m/s^2"), "measured"))
        found.sort(key=lambda one: one.natural_frequency.value)
        assert [one.natural_frequency.value for one in found] == pytest.approx([456.8, 516.5, 1448.9], rel=1e-3)
        assert [one.damping_ratio.value for one in found] == pytest.approx([0.0112, 0.0246, 0.017], rel=0.02)
        assert [one.direction.value for one in found] == pytest.approx([0.35, 1.31, -0.61], abs=0.01)
        assert found[2].shape["acceleration_y"].value == pytest.approx(np.tan(-0.61), abs=0.01)
        assert all(one.low < one.value < one.high for mode in found for one in (mode.natural_frequency, mode.damping_ratio))


def test_a_displacement_and_an_acceleration_show_one_shape() -> None:
    time, random, turning = np.arange(6000) / 6400.0, np.random.default_rng(5), 2 * np.pi * 300.0
    motion = 1e-5 * decay(time, 0.0, 300.0, 0.01, 0.3)
    other = -0.5e-5 * turning**2 * decay(time, 0.0, 300.0, 0.01, 0.3 + 2.0 * (np.pi - np.arccos(0.01)))
    channels = {"displacement": motion + 1e-8 * random.standard_normal(6000),
                "acceleration_y": other + 0.1 * random.standard_normal(6000)}
    (found,) = modes_in(Recording(channels, 6400.0, {"displacement": "m", "acceleration_y": "m/s^2"}, "measured"))
    assert found.shape["acceleration_y"].value == pytest.approx(-0.5, abs=0.01) and found.direction is None


@pytest.mark.parametrize("apart", [1.03, 1.012])
def test_a_close_pair_is_two_modes_and_noise_is_none(apart: float) -> None:
    time, random = np.arange(20000) / 10000.0, np.random.default_rng(4)
    values = decay(time, 0.0, 400.0, 0.004, 1.0) + 0.6 * decay(time, 0.0, 400.0 * apart, 0.003, 2.0)
    found = decay_modes((values + 0.01 * random.standard_normal(20000))[None])
    assert np.sort(np.abs(found.poles)) * 1e4 / (2 * np.pi) == pytest.approx([400.0, 400.0 * apart], rel=1e-3)
    assert decay_modes(random.standard_normal((2, 5000))) is None and decay_modes(np.zeros((1, 500))) is None


def test_a_bent_spring_s_decay_and_a_lasting_tone_are_no_further_modes() -> None:
    time, random = np.arange(16000) / 8000.0, np.random.default_rng(6)
    amplitude = np.exp(-0.006 * 2 * np.pi * 120 * time)
    phase = 2 * np.pi * 120 * time + 20.0 * (1.0 - amplitude**2)  # its frequency falls by some 15 Hz with the amplitude
    bent = decay_modes((amplitude * np.cos(phase) + 0.003 * random.standard_normal(16000))[None])
    assert bent is None or len(bent) == 1 and bent.bends is not None
    hum = decay(time, 0.0, 120.0, 0.006) + 0.1 * np.sin(2 * np.pi * 50 * time) + 0.003 * random.standard_normal(16000)
    found = decay_modes(hum[None])
    assert len(found) == 1 and [why for _, why in found.left_out] == ["does not die away"]


def test_a_far_off_prior_starts_from_the_mode_that_moves_most() -> None:
    time, random = np.arange(8000) / 4000.0, np.random.default_rng(7)
    values = 1e-5 * (decay(time, 0.0, 150.0, 0.006, 1.0) + 0.7 * decay(time, 0.0, 420.0, 0.002, 0.2))
    record = Record("tap", "ring-down", recorded(values + 1e-8 * random.standard_normal(8000), 4000.0))
    for believed, wanted in ((220.0, 150.0), (425.0, 420.0)):
        model = Model(Structure(2.0, believed, 0.01), None, None)
        assert decay_start([observe(record, model)], model).structure.natural_frequency == pytest.approx(wanted, rel=1e-3)


def test_each_of_several_blows_is_found_and_a_ring_down_of_its_own() -> None:
    values = taps(1000.0, 5000, THREE, 50.0, 0.02, 0.02, 7)
    record = Record("taps", "ring-down", recorded(values, 1000.0, "acceleration"))
    parts = separated([record])
    assert [part.name for part in parts] == ["taps blow 1", "taps blow 2", "taps blow 3"]
    assert "three blows (at 0.5" in parts[0].notes[0] and all(part.kind == "ring-down" for part in parts)
    assert sum(len(part.recording) for part in parts) == pytest.approx(5000, abs=100)
    seen = report(record.recording, "taps", "ring-down", ())
    assert seen.blows == pytest.approx([0.5, 2.0, 3.5], abs=0.01)
    assert [one.damping_ratio.value for ring in seen.ring_downs for one in ring.modes] == pytest.approx([0.02] * 3, rel=0.01)
    with pytest.raises(ValueError, match=r"three blows .* give from and to"):
        observe(record, Model(Structure(2.0, 48.0, 0.01), None, None))


def test_a_blow_on_what_still_rings_is_found_and_a_beat_is_none() -> None:
    ringing = taps(1000.0, 3000, ((0.0, 1.0), (0.9, 1.0)), 60.0, 0.003, 0.003, 3)
    assert find_blows(ringing) == pytest.approx([0, 900], abs=20)
    time = np.arange(6000) / 1000.0
    for other in (61.0, 66.0, 90.0, 120.0):
        beat = decay(time, 0.0, 60.0, 0.002, 1.0) + 0.9 * decay(time, 0.0, other, 0.002, 0.4)
        assert len(find_blows(beat + 1e-3 * np.random.default_rng(4).standard_normal(6000))) <= 1


def test_a_record_that_grows_is_no_free_decay_and_all_of_it_is_used() -> None:
    time = np.arange(4000) / 2000.0
    values = 1e-6 * np.exp(2.5 * time) * np.sin(2 * np.pi * 80 * time) + 2e-8 * np.random.default_rng(5).standard_normal(4000)
    record = Record("growing", "ring-down", recorded(values, 2000.0))
    assert grows(values) == pytest.approx(np.exp(4.5), rel=0.2)
    seen = report(record.recording, "growing", "ring-down", ())
    assert any("its vibration grows" in note for note in seen.notes) and seen.share > 0.95
    assert seen.ring_downs[0].modes[0].damping_ratio.value == pytest.approx(-2.5 / (2 * np.pi * 80), rel=0.05)
    observed = observe(record, Model(Structure(2.0, 80.0, 0.01), None, None))
    assert observed.samples > 3800
    assert grows(values[::-1]) is None and notes_of(recorded(values[::-1], 2000.0), "ring-down") == []


def test_coarse_steps_and_a_stop_leave_the_noise_of_rounding(tmp_path: Path) -> None:
    lines = ["name: rubbed", "sampling_rate: 100 Hz", "records:"]
    for number, amplitude in ((1, 110.0), (2, 70.0)):
        values = 2 * np.round(rubbed(amplitude, 3.0, 0.05, 1.06, 100.0, 500) / 2)
        np.savetxt(tmp_path / f"{number}.csv", values, fmt="%.0f", header="x", comments="")
        lines.append(f"  - {{file: {number}.csv, kind: ring-down, channels: {{displacement: {{column: x, unit: mm}}}}}}")
    (tmp_path / "c.yaml").write_text("\n".join(lines))
    model = Model(Structure(0.8, 3.1, 0.08), None, None)
    for record in load_campaign(tmp_path / "c.yaml").records:
        assert len(record.recording.filled) == 0  # steps are no spikes
        observed = observe(record, model)
        seen = report(record.recording, "x", "ring-down", ())
        assert observed.noise[0] == pytest.approx(2e-3 / np.sqrt(12), rel=1e-6) == seen.noise.rms
    moving = recorded(record.recording.channels["displacement"][:180], 100.0)
    floor = noise_floor(moving, find_segments(moving, kind="ring-down"))
    assert floor.rms == pytest.approx(2e-3 / np.sqrt(12), rel=0.25)


@pytest.mark.parametrize("share", [0.18, 0.27, 0.36, 0.44, 0.49])
def test_the_noise_beside_a_tone_as_fast_as_the_sampling(share: float) -> None:
    random = np.random.default_rng(6)
    tone = np.sin(2 * np.pi * share * np.arange(4000)) + 0.01 * random.standard_normal(4000)
    assert noise_floor(recorded(tone, 4000.0), ()).rms == pytest.approx(0.01, rel=0.1)
    short = recorded(tone[:100], 4000.0)
    floor = noise_floor(short, ())
    assert floor.rms <= np.std(tone[:100]) * 1.0001 and not floor.known
    seen = report(short, "short", "file", ())
    assert seen.as_json()["noise_floor"] is None and any("the noise is not known" in note for note in seen.notes)
    ringing = recorded(decay(np.arange(4000) / 4000, 0.2, share * 4000, 0.003) + 0.01 * random.standard_normal(4000), 4000.0)
    assert noise_floor(ringing, find_segments(ringing, kind="ring-down")).rms == pytest.approx(0.01, rel=0.1)


def test_white_noise_itself_is_known() -> None:
    found = read_white_noise(np.random.default_rng(8).standard_normal(5000))
    assert found.known and found.rms == pytest.approx(1.0, rel=0.06)


@pytest.mark.parametrize("per_turn", [2.3, 4.7, 7.0, 9.4, 33.3])
def test_a_clip_of_more_revolutions_than_samples_a_revolution_is_read(per_turn: float) -> None:
    time, random = np.arange(round(130 * per_turn)) / 1000.0, np.random.default_rng(9)
    turning = 1000.0 / per_turn
    motion = np.sin(2 * np.pi * turning * time) + np.exp(-0.05 * turning * time) * np.sin(2 * np.pi * 0.37 * turning * time)
    clip = Recording({"displacement": motion + 0.02 * random.standard_normal(len(time))}, 1000.0, {"displacement": "m"},
                     "measured", conditions={"spindle_speed": 2 * np.pi * turning})
    seen = report(clip, "clip", "cut", ())
    assert seen.noise is not None and seen.noise.rms == pytest.approx(0.02, rel=0.4) or not seen.noise.known


def test_inspect_says_blows_vibrations_and_how_much_is_used(tmp_path: Path) -> None:
    values = taps(1000.0, 5000, THREE, 50.0, 0.02, 0.02, 7)
    np.savetxt(tmp_path / "taps.csv", values, fmt="%.4f", header="acc", comments="")
    (tmp_path / "c.yaml").write_text(
        "name: taps\nsampling_rate: 1000 Hz\nrecords:\n"
        "  - {file: taps.csv, kind: ring-down, channels: {acceleration: {column: acc, unit: m/s^2}}}\n")
    told = CliRunner().invoke(inspect_command, [str(tmp_path / "c.yaml")], catch_exceptions=False).output
    assert "three blows (at 0.5" in told and told.count("free vibration") == 3 and "used in a fit: 0.5" in told
    assert "49.99 Hz natural" in told or "50 Hz natural" in told
    answer = CliRunner().invoke(inspect_command, [str(tmp_path / "c.yaml"), "--quiet", "--json", "-"]).stdout
    record = json.loads(answer)["records"][0]
    assert len(record["blows"]) == 3 and 0.85 < record["used"]["share"] < 0.95
    assert record["ring_downs"][2]["modes"][0]["natural_frequency"]["value"] == pytest.approx(50.0, rel=1e-4)
