"""Value checks and time bases: what a damaged or careless file holds is found and said."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from testbed.problem import InputProblem
from testbed.readers import checks, tachometer
from testbed.readers.assemble import Source, assemble
from testbed.readers.table import Table
from testbed.readers.timebase import from_column, repetition, settle

HERE = Path("file.csv")
RATE = 12800.0


def _signal(rows: int = 4000, seed: int = 3) -> np.ndarray:
    random = np.random.default_rng(seed)
    return 20 * np.sin(2 * np.pi * 146.6 * np.arange(rows) / RATE) + 0.3 * random.standard_normal(rows)


def _assemble(columns: dict[str, np.ndarray], rate: float | None = RATE, **options):
    names = {"displacement": Source("disp", "um")} | {name: Source(name, "N") for name in columns if name == "force"}
    return assemble(Table(HERE, columns), names, sampling_rate=rate, **options)


@pytest.mark.parametrize(
    ("damage", "said"),
    [
        (
            lambda x: np.where(np.arange(len(x)) % 1000 == 77, np.nan, x),
            "4 of 4000 samples are no number, the first is sample 78",
        ),
        (lambda x: np.full_like(x, 2.5), "constant at 2.5"),
        (lambda x: x[:1], "one sample"),
        (lambda x: np.where(np.arange(len(x)) == 5, 1e40, x), "1e\\+40"),
    ],
)
def test_useless_channels_are_refused(damage, said: str) -> None:
    with pytest.raises(InputProblem, match=said):
        _assemble({"disp": damage(_signal())})


def test_a_sound_channel_raises_no_note() -> None:
    _, notes = _assemble({"disp": _signal()})
    assert notes == ()


@pytest.mark.parametrize(
    ("damage", "said"),
    [
        (lambda x: np.clip(x, -15, 15), "clipped"),
        (lambda x: np.minimum(x, 17), "clipped"),
        (lambda x: np.where(np.arange(len(x)) == 1234, -x + 60, x), "lone spike, the first is sample 1235"),
        (lambda x: np.where((np.arange(len(x)) > 800) & (np.arange(len(x)) < 850), 0.0, x), "49 samples stand still"),
        (lambda x: np.where((np.arange(len(x)) > 1000) & (np.arange(len(x)) < 1013), x[1000], x), "13 samples stand still"),
        (lambda x: np.round(x / 8) * 8, "different values"),
        (lambda x: np.concatenate([x[:1003], x[1040:]]), "jumps at sample 1004"),
        (lambda x: np.where((np.arange(len(x)) > 1203) & (np.arange(len(x)) < 1207), 0.0, x), "jumps at sample 1205"),
        (lambda x: np.where(np.arange(len(x)) == 0, -70.0, x), "jumps at sample 2"),
    ],
)
def test_doubtful_channels_are_noted(damage, said: str) -> None:
    _, notes = _assemble({"disp": damage(_signal())})
    assert any(said in note for note in notes), notes


def test_blows_teeth_and_loud_noise_are_no_jumps() -> None:
    random, time = np.random.default_rng(4), np.arange(20000) / 12800
    noise = random.standard_normal(time.size)
    blow = np.where(abs(time - 0.5) < 4e-4, np.cos((time - 0.5) * np.pi / 8e-4), 0.0)
    teeth = np.where((time * 63.5) % 1 < 0.16, 1.0, 0.0)
    growing = noise * np.exp(4 * time)
    for values in (noise, np.round(noise), 100 * blow + 0.1 * noise, teeth + 0.01 * noise, growing, np.round(20 * growing)):
        assert checks.jumps(values) == []


def test_numbers_that_lost_bytes_are_seen_and_small_ones_are_not() -> None:
    values = np.random.default_rng(6).normal(size=200)
    raw = bytearray(values.tobytes())
    raw[80 * 8 + 4 : 82 * 8] = bytes(12)  # a hole: half of one number and the whole of the next
    broken = np.frombuffer(bytes(raw))
    assert list(checks.broken_numbers(broken)) == [80]
    assert any("sample 81 is" in note and "lost" in note for note in checks.channel_notes("force", broken))
    fading = np.exp(-np.arange(8000) / 10.0) * np.cos(np.arange(8000))  # down to the smallest numbers there are, and to zero
    idle = np.where(np.arange(200) < 100, 0.0, values)
    for sound in (values, fading, idle, values.astype("f4") * np.float32(1e-37)):
        assert len(checks.broken_numbers(np.asarray(sound, dtype=float))) == 0


def test_a_quantised_signal_is_neither_clipped_nor_stuck() -> None:
    _, notes = _assemble({"disp": np.round(_signal() / 0.5) * 0.5})
    assert not any("clipped" in note or "still" in note for note in notes), notes


def test_channels_of_unequal_length_are_refused() -> None:
    with pytest.raises(InputProblem, match="unequal length"):
        _assemble({"disp": _signal(), "force": _signal()[:-7]})


@pytest.mark.parametrize(("factor", "phase"), [(2, 0), (2, 1), (3, 2), (8, 5)])
def test_repeated_samples_are_found_and_the_true_rate_reported(factor: int, phase: int) -> None:
    stored = np.repeat(_signal(), factor)[(factor - phase) % factor :]
    assert repetition([stored]) == (factor, phase % factor)
    recording, notes = _assemble({"disp": stored}, rate=factor * RATE)
    assert recording.sampling_rate == RATE and any("stored" in note for note in notes)
    assert np.allclose(recording.channels["displacement"][1:100] * 1e6, _signal()[1 + (phase > 0) : 100 + (phase > 0)])


def test_repetition_is_not_seen_in_sound_or_coarse_signals() -> None:
    assert repetition([_signal()]) == (1, 0)
    assert repetition([np.round(_signal() / 5)]) == (1, 0)


@pytest.mark.parametrize(("digits", "rate"), [(9, 12800.0), (6, 12800.0), (4, 12800.0), (3, 12800.0), (9, 610.3515625)])
def test_a_rounded_time_column_gives_its_rate(digits: int, rate: float) -> None:
    time = np.round(3.0 + np.arange(40000) / rate, digits)
    base = from_column(HERE, time, "t")
    assert base.sampling_rate == pytest.approx(rate, rel=2e-9 if digits == 9 else 10.0**-digits / 3)
    assert bool(base.notes) == (digits < 6) and base.start == time[0]


@pytest.mark.parametrize(
    ("damage", "said"),
    [
        (lambda t: np.where(np.arange(len(t)) == 50, np.nan, t), "no number, the first is row 51"),
        (lambda t: np.concatenate([t[:500], t[:500]]), "runs back at row 501"),
        (lambda t: np.zeros_like(t), "does not advance"),
        (lambda t: t + 0.3 / RATE * np.sin(np.arange(len(t)) * 0.01) * np.arange(len(t)) / 100, "uneven|runs back"),
    ],
)
def test_a_column_that_is_no_time_is_refused(damage, said: str) -> None:
    with pytest.raises(InputProblem, match=said):
        from_column(HERE, damage(np.arange(1000) / RATE), "t")


def test_few_missing_rows_are_filled_and_said_many_are_refused() -> None:
    signal = 20 * np.sin(2 * np.pi * 50 * np.arange(4000) / RATE)
    time = np.arange(4000) / RATE
    kept = np.delete(np.arange(4000), [1000, 2500])
    recording, notes = _assemble({"time": time[kept], "disp": signal[kept]}, rate=None)
    assert len(recording) == 4000 and any("2 samples are missing at 2 places" in note for note in notes)
    assert np.abs(recording.channels["displacement"] * 1e6 - signal).max() < 0.02
    kept = np.delete(np.arange(4000), np.arange(1000, 1100))
    with pytest.raises(InputProblem, match="100 samples are missing"):
        _assemble({"time": time[kept], "disp": signal[kept]}, rate=None)


@pytest.mark.parametrize("digits", [12, 6])
@pytest.mark.parametrize(
    ("spoil", "said"),
    [
        (lambda t: np.where(np.arange(len(t)) == 3000, t[2999], t), "1 wrong stamp, the first at row 3001 (0.23"),
        (lambda t: np.where(np.isin(t, t[[700, 3000]]), t + 0.9 / RATE, t), "2 wrong stamps, the first at row 701"),
    ],
)
def test_a_time_that_stands_twice_is_a_wrong_stamp_and_no_missing_sample(spoil, said: str, digits: int) -> None:
    signal = _signal()
    time = np.round(spoil(np.arange(4000) / RATE), digits)
    recording, notes = _assemble({"time": time, "disp": signal}, rate=None)
    assert recording.sampling_rate == RATE and recording.conditions["dropped_samples"] == 0
    assert np.array_equal(recording.channels["displacement"], signal * 1e-6)
    assert len(notes) == 1 and said in notes[0] and "no sample is missing" in notes[0]


def test_a_time_that_stands_twice_beside_a_gap_elsewhere_is_not_taken_for_a_wrong_stamp() -> None:
    kept = np.delete(np.arange(4001), 1000)
    time = kept / RATE
    time[3000] = time[2999]
    _, notes = _assemble({"time": time, "disp": _signal(4001)[kept]}, rate=None)
    assert any("samples are missing" in note for note in notes)


def test_contradicted_and_missing_rates() -> None:
    time = np.arange(4000) / RATE
    with pytest.raises(InputProblem, match="campaign.yaml says 10000 Hz, the time column 12800 Hz"):
        _assemble({"time": time, "disp": _signal()}, rate=10000.0)
    with pytest.raises(InputProblem, match="campaign.yaml says 10000 Hz, the file 12800 Hz"):
        settle(HERE, 10000.0, 12800.0, 0.0, None)
    assert settle(HERE, 12800.0, 1 / 0.000078, 6.4e-3, None).sampling_rate == 12800.0
    recording, _ = _assemble({"time": time, "disp": _signal()}, rate=10000.0, time="none")
    assert recording.sampling_rate == 10000.0
    with pytest.raises(InputProblem, match="no sampling rate"):
        _assemble({"disp": _signal()}, rate=None)
    with pytest.raises(InputProblem, match="column 'ramp' rises evenly"):
        _assemble({"ramp": time, "disp": _signal()}, rate=None)


def test_an_index_called_time_is_no_time() -> None:
    recording, notes = _assemble({"time": np.arange(4000.0), "disp": _signal()})
    assert recording.sampling_rate == RATE and any("counts samples" in note for note in notes)


def test_a_temperature_called_t_is_no_time() -> None:
    warm = 20 + np.random.default_rng(1).standard_normal(4000)
    recording, notes = assemble(
        Table(HERE, {"t": warm, "disp": _signal()}), {"displacement": Source("disp", "um")}, sampling_rate=RATE
    )
    assert recording.sampling_rate == RATE and any("'t'" in note for note in notes)


def test_time_in_milliseconds_is_read_by_its_unit() -> None:
    table = Table(HERE, {"time": np.arange(4000) / RATE * 1e3, "disp": _signal()}, {"time": "ms", "disp": "um"})
    recording, _ = assemble(table, {"displacement": Source("disp")})
    assert recording.sampling_rate == pytest.approx(RATE, rel=1e-9)


@pytest.mark.parametrize(("unit", "said"), [("furlong", "unknown unit"), ("N", "cannot be in N"), (None, "no unit")])
def test_unknown_wrong_and_missing_units_are_refused(unit: str | None, said: str) -> None:
    with pytest.raises(InputProblem, match=said):
        assemble(Table(HERE, {"disp": _signal()}), {"displacement": Source("disp", unit)}, sampling_rate=RATE)


def test_an_uncalibrated_channel_keeps_its_unit_and_scale_calibrates() -> None:
    table = Table(HERE, {"disp": _signal()})
    recording, notes = assemble(table, {"displacement": Source("disp", "mV")}, sampling_rate=RATE)
    assert recording.units["displacement"] == "V" and any("uncalibrated" in note for note in notes)
    assert recording.channels["displacement"][10] == pytest.approx(_signal()[10] * 1e-3)
    recording, notes = assemble(table, {"displacement": Source("disp", "um", 250.0)}, sampling_rate=RATE)
    assert recording.channels["displacement"][10] == pytest.approx(_signal()[10] * 250e-6) and notes == ()


def test_model_frequency_and_speed_notes() -> None:
    assert checks.rate_notes(1000.0, 401.0) and not checks.rate_notes(1000.0, 399.0)
    assert checks.speed_notes(500.0, 450.0, "tachometer") and not checks.speed_notes(500.0, 499.0, "tachometer")


@pytest.mark.parametrize("edge", ["rising", "falling"])
@pytest.mark.parametrize("noise", [0.0, 0.05])
def test_marks_are_found_between_samples(edge: str, noise: float) -> None:
    period, rate = 60 / 3810, 12800.0
    random = np.random.default_rng(2)
    time = np.arange(int(1.0 * rate)) / rate
    phase = (time - 0.0031) % period
    # a pulse with ramps of three samples
    pulse = np.clip((phase + 1.5 / rate) % period / (3 / rate), 0, 1) - np.clip(
        (phase - 0.002 + 1.5 / rate) % period / (3 / rate), 0, 1
    ) * (phase + 1.5 / rate > 0.002) * (phase < period - 1.5 / rate)
    found, _, notes = tachometer.marks(
        5 * pulse + noise * random.standard_normal(len(time)), rate, rising=edge == "rising"
    )
    true = np.arange(0.0031 + (0.002 if edge == "falling" else 0), 1.0, period)
    assert len(found) == len(true) and notes == []
    assert np.abs(found - true).max() < (1e-9 if noise == 0 else 0.1 / rate)
    assert tachometer.speed(found) == pytest.approx(2 * np.pi / period, rel=1e-4)


def test_lost_marks_are_said_and_do_not_bias_the_speed() -> None:
    marks = np.delete(np.arange(60) * 0.015, [20, 41])
    pulse = np.zeros(12000)
    for mark in marks:
        pulse[round(mark * 12800) : round(mark * 12800) + 20] = 5.0
    found, _, notes = tachometer.marks(pulse, 12800.0)
    assert any("2 gaps" in note for note in notes)
    assert tachometer.speed(found) == pytest.approx(2 * np.pi / 0.015, rel=1e-4)


def test_a_spindle_at_rest_has_no_marks() -> None:
    random = np.random.default_rng(5)
    found, _, notes = tachometer.marks(0.1 + 0.03 * random.standard_normal(20000), 12800.0)
    assert len(found) == 0 and len(notes) == 1 and "no regular pulses" in notes[0]
    slowing = np.cumsum(np.geomspace(0.01, 0.04, 60))  # a speed that falls to a quarter has marks
    pulse = np.zeros(20000)
    for mark in slowing:
        pulse[round(mark * 12800) : round(mark * 12800) + 20] = 5.0
    assert len(tachometer.marks(pulse, 12800.0)[0]) == 60


def test_several_pulses_a_revolution_give_one_mark_each() -> None:
    pulse = (np.arange(12800) % 100 < 20).astype(float)
    found, *_ = tachometer.marks(pulse, 12800.0, pulses_per_revolution=4)
    assert np.allclose(np.diff(found), 400 / 12800)


def test_uneven_slots_are_told_apart_and_even_ones_are_not() -> None:
    random = np.random.default_rng(6)
    for first in range(3):  # whichever slot a record begins with
        turns = np.add.outer(np.arange(20), (np.array([0.0, 0.30, 0.65]))).ravel()[first:]
        edges = 0.02 * turns + 2e-6 * random.standard_normal(turns.size)
        found, slots = tachometer.same_slot(edges, 3)
        assert slots == 1 and found.size >= 19
        assert (found / 0.02) % 1.0 == pytest.approx(0.30, abs=1e-3)
    even = 0.01 * np.arange(60) + 2e-6 * random.standard_normal(60)
    found, slots = tachometer.same_slot(even, 2)
    assert slots == 2 and found.size == 30 and found[0] == even[0]


def test_an_accelerations_teeth_are_neither_spikes_nor_missing_samples() -> None:
    values = 1e-3 * np.random.default_rng(5).standard_normal(4000)
    values[400:4000:700] += 1.0  # six teeth, one sample each
    assert any("spike" in note or "jump" in note for note in checks.channel_notes("displacement", values))
    assert not any("spike" in note or "jump" in note for note in checks.channel_notes("acceleration", values))
    one = np.where(np.arange(4000) < 900, 0.0, 5.0) + 1e-3 * np.random.default_rng(5).standard_normal(4000)
    assert any("jump" in note for note in checks.channel_notes("velocity", one))
    assert not any("jump" in note for note in checks.channel_notes("acceleration", one))  # the first tooth looks the same


def test_a_converter_s_idling_hides_no_stretch_that_stands_still_amid_motion() -> None:
    time, noise = np.arange(20000) / 12800, 1.5 * np.random.default_rng(1).standard_normal(20000)
    steps = np.round(np.where(time > 0.3, 60 * np.sin(2 * np.pi * 200 * time), 0.0) + noise)
    assert checks.stuck_stretch(steps) is None  # while it idles, up to six in a row are the same by chance
    steps[12000:12012] = steps[12000]
    assert checks.stuck_stretch(steps) == (12000, 12)
