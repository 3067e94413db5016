"""Segments, noise floor and spectral lines of synthetic cuts, against when things really happened."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.fft import next_fast_len

from testbed.analysis.records.hum import hum_lag, without_hum
from testbed.analysis.records.lines import amplitude_spectrum, comb_speed, find_peaks, follow_line, spectral_lines
from testbed.analysis.records.noise import noise_floor, samples_of
from testbed.analysis.records.orders import turns_of
from testbed.analysis.records.segments import Segment, _levels, find_segments, main_channel
from testbed.recording import Recording
from tests.support.synthetic_cut import FREQUENCY, RHO, Truth, milling_record


def _kinds(segments: tuple[Segment, ...]) -> list[str]:
    return [part.kind for part in segments]


def _contact_ends(truth: Truth) -> float:
    """When the last tooth really leaves: in its last revolution it cuts for a fraction rho of it."""
    return truth.exit - (1 - RHO) * truth.period


@pytest.mark.parametrize("noise", [0.3e-6, 1e-6, 5e-6])
@pytest.mark.parametrize(
    "case",
    [
        {},
        {"rpm": 2850.0},
        {"rpm": 3050.0, "depth": 2.7e-3, "cut": 25},
        {"seed": 4, "offset": -2e-4},
        {"ring": 200},
        {"tachometer": False},
    ],
)
def test_entry_and_exit_are_found_within_a_revolution(case: dict, noise: float) -> None:
    recording, truth = milling_record(noise=noise, **case)
    segments = find_segments(recording)
    assert _kinds(segments)[:3] == ["idle", "entry", "steady"] and "ring-down" in _kinds(segments)
    assert abs(segments[0].stop - truth.entry) < 0.3 * truth.period
    ring = next(part for part in segments if part.kind == "ring-down")
    assert abs(ring.start - _contact_ends(truth)) < 0.3 * truth.period
    assert segments[0].start == recording.start and segments[-1].stop == pytest.approx(
        len(recording) / recording.sampling_rate
    )
    assert all(a.stop == b.start for a, b in zip(segments, segments[1:], strict=False))


@pytest.mark.parametrize("noise", [0.3e-6, 5e-6])
def test_a_hum_and_a_strong_drift_do_not_hide_the_cut(noise: float) -> None:
    recording, truth = milling_record(noise=noise, hum=3e-6, drift=1e-4)
    segments = find_segments(recording)
    assert abs(segments[0].stop - truth.entry) < 0.5 * truth.period
    ring = next(part for part in segments if part.kind == "ring-down")
    assert abs(ring.start - _contact_ends(truth)) < truth.period


@pytest.mark.parametrize("noise", [0.3e-6, 5e-6])
def test_what_a_record_lacks_is_not_found(noise: float) -> None:
    assert "idle" not in _kinds(find_segments(milling_record(noise=noise, idle=0)[0]))
    assert "ring-down" not in _kinds(find_segments(milling_record(noise=noise, ring=0)[0]))
    growing = milling_record(noise=noise, rpm=3050.0, depth=2.7e-3, cut=25, idle=0)[0]
    assert _kinds(find_segments(growing))[0] == "entry"
    only = np.random.default_rng(1).standard_normal(20000) * noise
    silent = Recording(
        {"displacement": only}, 12800.0, {"displacement": "m"}, "measured", conditions={"spindle_speed": 400.0}
    )
    assert "ring-down" not in _kinds(find_segments(silent)) and "entry" not in _kinds(find_segments(silent))


def test_of_a_cut_any_scrap_may_be_left_at_the_records_start() -> None:
    whole, truth = milling_record(noise=1e-6)
    for left in np.linspace(0.0, 2.0, 41):  # revolutions of cutting
        begin = round((_contact_ends(truth) - left * truth.period) * whole.sampling_rate)
        channels = {name: values[begin:] for name, values in whole.channels.items()}
        recording = replace(whole, channels=channels, marks=np.empty(0))
        segments = find_segments(recording)
        assert segments[-1].stop == pytest.approx(segments[0].start + len(recording) / recording.sampling_rate)


def test_the_stable_cut_settles_and_the_quieter_sensor_sees_it_later() -> None:
    starts = []
    for noise in (0.3e-6, 5e-6):
        recording, truth = milling_record(noise=noise)
        steady = next(part for part in find_segments(recording) if part.kind == "steady")
        starts.append((steady.start - truth.entry) / truth.period)
    # |mu| = 0.8: a transient of 30 um is below 5 um after 8 revolutions, below 0.3 um after 20
    assert 4 < starts[1] < 10 < starts[0] < 22


def test_a_ring_down_ends_where_it_is_lost_in_the_noise() -> None:
    recording, truth = milling_record(noise=5e-6, ring=200)
    ring, after = find_segments(recording)[-2:]
    assert (ring.kind, after.kind) == ("ring-down", "idle")
    level = 30e-6 * np.exp(-2 * np.pi * FREQUENCY * 0.0032 * ring.duration)
    assert 0.3e-6 < level < 10e-6


@pytest.mark.parametrize(("frequency", "noise"), [(180.6, 0.5e-6), (180.05, 6.4e-6)], ids=["ambient", "hum"])
def test_a_vibration_near_the_mains_is_hum_only_as_closely_as_its_frequency_is_known(frequency, noise) -> None:
    time = np.arange(6000) / 12800.0
    values = 9e-6 * np.sin(2 * np.pi * frequency * time) + 0.5e-6 * np.random.default_rng(5).standard_normal(len(time))
    recording = Recording({"displacement": values}, 12800.0, {"displacement": "m"}, "measured")
    found = noise_floor(recording, (Segment("idle", 0.0, time[-1]),))
    assert found.basis == "idle" and found.rms == pytest.approx(noise, rel=0.1)


@pytest.mark.filterwarnings("error")
def test_a_record_that_is_all_an_old_motion_dying_away_has_no_cut() -> None:
    time = np.arange(12363) / 9100.0
    decay = 2.2e-5 * np.exp(-2 * np.pi * 302.6 * 0.0041 * time) * np.sin(2 * np.pi * 302.6 * time)
    noise = 3e-6 * np.random.default_rng(7).standard_normal(len(time))
    marks = np.arange(0.004, 1.35, 60 / 3302)
    recording = Recording({"displacement": decay + noise}, 9100.0, {"displacement": "m"}, "measured", marks=marks)
    assert _kinds(find_segments(recording)) == ["idle"]


@pytest.mark.parametrize("idle", [2, 3])
def test_a_cut_begins_where_an_old_motion_as_loud_is_no_decay_any_more(idle: int) -> None:
    recording, truth = milling_record(idle=idle, rpm=1100.0, cut=30)
    moved = recording.channels["displacement"]
    time = np.arange(len(moved)) / recording.sampling_rate
    ring = 1.2 * np.ptp(moved) * np.exp(-14.0 * time) * np.sin(2 * np.pi * FREQUENCY * time + 0.4)
    loud = replace(recording, channels={"displacement": moved + ring})
    segments = find_segments(loud)
    assert segments[0].kind == "idle" and abs(segments[0].stop - truth.entry) < 0.1 * truth.period


@pytest.mark.parametrize("seed", range(4))
def test_a_cut_begins_where_an_old_motion_in_the_noise_of_single_samples_is_no_decay_any_more(seed: int) -> None:
    recording, truth = milling_record(idle=14, cut=60, noise=0.0, seed=seed)
    moved = recording.channels["displacement"]
    moved = 4.0 * (moved - moved[0]) / np.ptp(moved)  # both motions, and the noise that hides them, in units of the noise
    time = np.arange(len(moved)) / recording.sampling_rate
    ring = 2.0 * np.exp(-3.0 * time) * np.sin(2 * np.pi * FREQUENCY * time + 0.4)
    noise = np.random.default_rng(seed).standard_normal(len(time))
    segments = find_segments(replace(recording, channels={"displacement": 1e-6 * (moved + ring + noise)}))
    assert segments[0].kind == "idle" and abs(segments[0].stop - truth.entry) < 2.0 * truth.period
    assert segments[1].kind in ("entry", "steady")


def test_a_tap_is_quiet_then_rings() -> None:
    random = np.random.default_rng(2)
    time = np.arange(25600) / 12800
    decay = np.where(time > 0.5, 2e-5 * np.exp(-8 * (time - 0.5)) * np.sin(2 * np.pi * 146.6 * (time - 0.5)), 0.0)
    recording = Recording(
        {"displacement": decay + 2e-7 * random.standard_normal(len(time))}, 12800.0, {"displacement": "m"}, "measured"
    )
    segments = find_segments(recording, kind="ring-down")
    assert _kinds(segments)[:2] == ["idle", "ring-down"] and abs(segments[1].start - 0.5) < 0.01
    assert find_segments(recording, kind="excited") == ()
    assert _kinds(find_segments(recording, kind="idle")) == ["idle"]


def test_a_tap_after_a_short_idling_begins_with_the_blow_and_a_decay_with_the_record() -> None:
    time = np.arange(8000) / 5000.0
    decay = 3e-5 * np.exp(-15 * time) * np.sin(2 * np.pi * 95 * time)
    noise = 1e-7 * np.random.default_rng(4).standard_normal(8000)
    late = Recording({"displacement": np.roll(decay, 280) * (time > 0.055) + noise}, 5000.0, {"displacement": "m"}, "measured")
    ring = next(one for one in find_segments(late, kind="ring-down") if one.kind == "ring-down")
    assert 0.05 < ring.start < 0.065  # idling for a few periods only
    early = Recording({"displacement": decay + noise}, 5000.0, {"displacement": "m"}, "measured")
    assert find_segments(early, kind="ring-down")[0].kind == "ring-down"


def test_the_main_channel_is_the_one_that_moves() -> None:
    channels = {name: np.zeros(3) for name in ("tachometer", "force_y", "acceleration")}
    assert main_channel(Recording(channels, 1.0, dict.fromkeys(channels, "1"), "measured")) == "acceleration"


@pytest.mark.parametrize("noise", [0.3e-6, 1e-6, 5e-6])
@pytest.mark.parametrize(
    ("case", "basis", "slack"),
    [
        ({}, "idle", 0.03),
        ({"idle": 2, "rpm": 1300.0, "cut": 12, "ring": 0}, "idle", 0.05),  # short, and the cut does not repeat itself
        ({"idle": 0}, "ring-down", 0.05),
        ({"idle": 0, "rpm": 3050.0, "depth": 2.7e-3, "cut": 25}, "ring-down", 0.05),
        ({"idle": 0, "ring": 0}, "repeated periods", 0.25),
        ({"idle": 0, "ring": 0, "rpm": 3050.0, "depth": 2.7e-3, "cut": 25}, "high-frequency residual", 0.05),
    ],
)
def test_the_noise_floor_from_every_basis(case: dict, basis: str, slack: float, noise: float) -> None:
    recording, truth = milling_record(noise=noise, **case)
    found = noise_floor(recording, find_segments(recording))
    assert found.basis == basis and found.rms == pytest.approx(truth.noise, rel=slack)


def test_a_transient_that_dies_slowly_is_waited_for_where_only_the_cut_tells_the_noise() -> None:
    recording, truth = milling_record(noise=0.1e-6, idle=0, ring=0, cut=120)
    found = noise_floor(recording, find_segments(recording))
    assert found.basis == "repeated periods" and 0.95 < found.rms / truth.noise < 1.2  # over the whole cut it is 1.29


def test_hum_tooth_passing_and_natural_lines_are_told_apart() -> None:
    recording, truth = milling_record(hum=1e-6, noise=0.3e-6)
    values, segments = recording.channels["displacement"], find_segments(recording)
    parts = {part.kind: values[samples_of(recording, part)] for part in segments}
    options = {"spindle_speed": 2 * np.pi / truth.period, "natural_frequencies": (FREQUENCY,), "idle": parts["idle"]}
    steady = spectral_lines(parts["steady"], 12800.0, **options)
    assert [line.order for line in steady if line.kind == "tooth-passing"][:3] == [2, 1, 3]
    assert all(line.kind != "other" for line in steady[:6])  # no side lobe of a strong line is a line
    hum = [line for line in steady if line.kind == "hum"]
    assert len(hum) >= 1 and abs(hum[0].frequency - 50) < 0.5 and hum[0].amplitude == pytest.approx(1e-6, rel=0.1)
    ring = spectral_lines(parts["ring-down"], 12800.0, **options)
    assert ring[0].kind == "natural" and abs(ring[0].frequency - FREQUENCY) < 0.2


@pytest.mark.parametrize(("rpm", "depth", "kind"), [(3635.0, 2.0e-3, "half tooth-passing"), (3050.0, 2.7e-3, "other")])
def test_chatter_that_repeats_every_other_pass_is_told_from_chatter_of_its_own_frequency(rpm, depth, kind) -> None:
    recording, truth = milling_record(rpm=rpm, depth=depth, cut=100)
    last = slice(round((120 * truth.period - 40 * truth.period) * 12800), round(120 * truth.period * 12800))
    values = recording.channels["displacement"][last]
    lines = spectral_lines(values, 12800.0, spindle_speed=2 * np.pi / truth.period)
    strange = [line for line in lines if line.kind not in ("tooth-passing", "spindle")]
    assert [line.kind for line in strange[:2]] == [kind, kind]
    halves = [line for line in lines if line.kind == "half tooth-passing"]
    assert all(line.order % 2 and abs(line.frequency * truth.period - line.order / 2) < 0.05 for line in halves)
    turned = spectral_lines(values, 12800.0, spindle_speed=np.pi / truth.period, flutes=2)  # of two teeth it may be runout
    assert not any(line.kind == "half tooth-passing" for line in turned)


def test_the_speed_is_found_from_the_spectrum_alone() -> None:
    recording, truth = milling_record(noise=1e-6)
    part = next(part for part in find_segments(recording) if part.kind == "steady")
    values = recording.channels["displacement"][samples_of(recording, part)]
    found = comb_speed(values, 12800.0, 1.05 * 2 * np.pi / truth.period)
    assert found is not None and found.basis == "tooth-passing lines"
    assert found.spindle_speed == pytest.approx(2 * np.pi / truth.period, rel=2e-4)
    noises = [np.random.default_rng(seed).standard_normal(8000) for seed in range(12)]
    assert [comb_speed(noise, 12800.0, 400.0) for noise in noises] == [None] * 12


@pytest.mark.parametrize("off", [0.7, 0.8, 1.25, 1.5])
def test_the_speed_of_another_test_written_down_is_not_advised(off) -> None:
    recording, truth = milling_record(noise=1e-6)
    part = next(part for part in find_segments(recording) if part.kind == "steady")
    values = recording.channels["displacement"][samples_of(recording, part)]
    found = comb_speed(values, 12800.0, off * 2 * np.pi / truth.period)  # a comb at 4/5 of the true one has some of its lines
    assert found is not None and found.basis == "tooth-passing lines"
    assert found.spindle_speed == pytest.approx(2 * np.pi / truth.period, rel=2e-4)


def test_a_ring_near_a_line_of_the_mains_is_no_hum() -> None:
    """A dying ring of 355.7 Hz agrees with itself one mains period later; the cut that follows makes it look even."""
    time, random = np.arange(15000) / 16000, np.random.default_rng(9)
    after = np.maximum(time - 0.18, 0.0)
    ring = 4.4 * np.exp(-14.0 * time) * np.cos(2 * np.pi * 355.7 * time) * (time < 0.18)
    motion = ring + (time >= 0.18) * 3.5 * np.cos(2 * np.pi * 355.7 * after) + 0.2 * random.standard_normal(15000)
    assert hum_lag(motion, 16000.0, 434.0) == 0
    humming = 3.0 * np.cos(2 * np.pi * 150.02 * time) + 0.2 * random.standard_normal(15000)
    assert hum_lag(humming, 16000.0, 434.0) == 320


@pytest.mark.parametrize("turning", [39.93, 39.55, 40.2, 41.7])
def test_many_harmonics_are_of_the_stated_spindle_though_its_teeth_are_not_known(turning) -> None:
    time, random = np.arange(6200) / 1e4, np.random.default_rng(8)
    lines = [np.cos(2 * np.pi * 2 * order * turning * time + order**2) / order for order in range(1, 60)]
    found = comb_speed(np.sum(lines, axis=0) + 0.03 * random.standard_normal(6200), 1e4, 2 * np.pi * 39.9)
    assert found is not None and found.spindle_speed == pytest.approx(2 * np.pi * turning, rel=1e-4)


def test_side_bands_give_the_speed_and_a_drifting_line_is_followed() -> None:
    time = np.arange(10000) / 5000
    phase = 2 * np.pi * (720 * time - 10 * time**2)
    values = np.cos(phase) * (1 + 0.4 * np.cos(2 * np.pi * 300 * time)) + 0.02 * np.random.default_rng(
        3
    ).standard_normal(10000)
    times, frequencies, _ = follow_line(values, 5000.0, 718.0, window=0.15)
    assert np.abs(frequencies - (720 - 20 * times)).max() < 1.5
    still = np.cos(2 * np.pi * 720 * time) * (1 + 0.4 * np.cos(2 * np.pi * 300 * time)) + 0.01 * np.random.default_rng(
        3
    ).standard_normal(10000)
    found = comb_speed(still, 5000.0, 5000 * np.pi / 30, flutes=4)
    assert (
        found is not None
        and found.basis == "side bands"
        and found.spindle_speed == pytest.approx(4500 * np.pi / 30, rel=1e-3)
    )


def test_a_long_record_is_looked_at_piece_by_piece_as_a_short_one_is(monkeypatch):
    random = np.random.default_rng(3)
    count = 65537  # a prime
    time = np.arange(count) / 6400.0
    values = np.sin(2 * np.pi * 147.3 * time) + 0.1 * random.standard_normal(count)
    whole = turns_of(values, time, np.empty(0), 1 / 63.5).rows
    level = _levels(values, 100).level
    lines = find_peaks(values, 6400.0, 1)
    monkeypatch.setattr("testbed.analysis.records.orders.PIECE", 5000)
    monkeypatch.setattr("testbed.analysis.records.segments.AT_ONCE", 3000)
    monkeypatch.setattr("testbed.analysis.records.lines.ANY_LENGTH", 1000)
    assert np.allclose(turns_of(values, time, np.empty(0), 1 / 63.5).rows, whole, rtol=0, atol=1e-13)
    assert np.allclose(_levels(values, 100).level, level, rtol=1e-12)
    assert len(amplitude_spectrum(values, 6400.0)[0]) == next_fast_len(4 * count, real=True) // 2 + 1
    found = find_peaks(values, 6400.0, 1)
    assert np.allclose(found, lines, rtol=0.02) and abs(found[0][0] - 147.3) < 0.01


def test_hum_is_taken_out_where_its_period_lies_between_samples() -> None:
    """At 14404 Hz a period of the mains is 288.08 samples: the next whole number leaves much more of the harmonics."""
    time = np.arange(20000) / 14404.0
    hum = sum(np.cos(2 * np.pi * 50.0 * order * time + order) / order for order in (1, 3, 5, 7))
    lag = hum_lag(hum, 14404.0, 542.7)
    assert lag == pytest.approx(288.08)
    left, whole = without_hum(hum, lag), without_hum(hum, 288)
    assert len(left) == len(hum) and left.std() < 1e-4 * hum.std() < 0.1 * whole.std()
    late = np.where(np.arange(20000) < 9000, 0.0, np.cos(2 * np.pi * 173.0 * time))
    assert not without_hum(hum + late, lag)[:9000].std() > 1e-4  # nothing is seen before it came
