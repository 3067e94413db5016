"""Samples that a sensor did not measure are bridged and weigh nothing; what a motion, a force or a rest does stays."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from testbed.analysis.comparison.compare import compare
from testbed.analysis.fit.observe import observe
from testbed.api.fitting import plant_of
from testbed.catalogue import catalogue
from testbed.engines import fast
from testbed.readers.assemble import Source, assemble
from testbed.readers.bridge import bridged, unmeasured
from testbed.readers.spikes import quantum, spikes
from testbed.readers.table import Table
from tests.support.campaign_files import BELIEVED, TRUE
from tests.support.synthetic_campaign import synthetic_campaign

RATE = 12800.0
PLACE = 1525  # where the motion is fast
TWO = ((3810, 2.9), (2850, 2.9))


def signal(rows=4000, noise=0.3):
    return 20 * np.sin(2 * np.pi * 146.6 * np.arange(rows) / RATE) + noise * np.random.default_rng(3).standard_normal(rows)


def damaged(values, first, count, by):
    """A copy with `count` samples from `first` on replaced by a value, or shifted by a function of what they were."""
    found = values.copy()
    found[first : first + count] = by(found[first : first + count]) if callable(by) else by
    return found


@pytest.mark.parametrize(
    ("count", "by"), [(1, lambda x: x + 30), (12, lambda x: np.full_like(x, x[0])), (3, -300.0), (12, 0.0)],
    ids=("lone spike", "converter stands still", "dropout beyond the motion", "dropout to zero"))  # fmt: skip
def test_what_was_not_measured_is_bridged_and_told(count, by):
    sound = signal()
    recording, notes = assemble(Table(Path("file.csv"), {"disp": damaged(sound, PLACE, count, by)}),
                                {"displacement": Source("disp", "um")}, sampling_rate=RATE)
    assert set(range(PLACE, PLACE + count)) <= set(recording.filled) <= set(range(PLACE - 1, PLACE + count + 1))
    off = np.abs(recording.channels["displacement"] * 1e6 - sound)
    assert off.max() < (2.0 if count < 4 else 6.0)
    assert any("bridged" in note for note in notes)


def test_samples_that_a_file_lacks_count_as_little():
    rows = np.delete(np.arange(4000), [1200, 2500])
    table = Table(Path("file.csv"), {"time": rows / RATE, "disp": damaged(signal(), 3000, 1, 90.0)[rows]})
    recording, _ = assemble(table, {"displacement": Source("disp", "um")})
    assert list(recording.filled) == [1200, 2500, 3000] and len(recording) == 4000


@pytest.mark.parametrize("noise", [0.0, 0.3])
def test_a_sound_motion_is_left_as_it_is(noise):
    rest = np.where(np.arange(4000) < 900, 0.0, 1.0) * signal(noise=0.0) * (1 - np.exp(-np.arange(-900, 3100) / 200.0))
    blown = np.where((np.arange(4000) > 1000) & (np.arange(4000) < 1040), 25.0, 0.0)  # a step is no dropout
    for values in (signal(noise=noise), rest, np.round(signal(noise=noise) / 4) * 4, signal(noise=noise) + blown):
        assert not unmeasured("displacement", values).any()
        assert bridged(values, unmeasured("displacement", values)) is values


@pytest.mark.parametrize("frequency", [3.0, 7.0, 12.0])
@pytest.mark.parametrize("levels", [6, 20, 110])
def test_coarse_steps_of_a_converter_are_no_spikes(frequency, levels):
    """A decay in steps of its largest value over `levels`, which comes to rest: rounding leaves 4/3 of a step at the most."""
    time = np.arange(500) / 100.0
    decay = np.exp(-1.2 * time) * np.cos(2 * np.pi * frequency * time)
    step = 0.11 / levels
    coarse = step * np.round(decay * levels)
    assert quantum(coarse) == pytest.approx(step, rel=1e-6)
    assert not unmeasured("displacement", coarse).any() and not spikes(coarse)
    spoilt = coarse.copy()
    spoilt[200] += 8 * step
    assert spikes(spoilt) == [200]


@pytest.mark.parametrize("width", [4, 6, 12, 24])
@pytest.mark.parametrize("noise", [0.0, 1e-5, 1e-3])
def test_the_first_and_the_last_sample_of_a_blow_are_no_spikes(width, noise):
    blow = np.zeros(2000)
    blow[500 : 500 + width + 1] = np.sin(np.pi * np.arange(width + 1) / width)
    answer = np.convolve(blow, np.exp(-np.arange(800) / 150) * np.sin(0.3 * np.arange(800)))[:2000]
    for values in (blow, answer, np.gradient(answer)):
        assert spikes(values + noise * np.random.default_rng(2).standard_normal(2000)) == []


def test_the_spikes_of_a_force_are_its_own():
    assert unmeasured("displacement", damaged(signal(), PLACE, 1, 90.0)).any()
    for name in ("force_x", "acceleration", "tachometer"):
        assert not unmeasured(name, damaged(signal(), PLACE, 1, 90.0)).any()


def spoilt(record):
    """The record with a sample far off, as reading gives it: bridged with whatever is there."""
    values = record.recording.channels["displacement"]
    channels = {**record.recording.channels, "displacement": damaged(values, PLACE, 1, lambda x: x + 40 * np.std(values))}
    return replace(record, recording=replace(record.recording, channels=channels, filled=np.array([PLACE])))


def test_what_was_put_in_weighs_nothing_in_a_fit():
    sound = synthetic_campaign(fast.simulate, TRUE, tests=TWO, rate=6400.0, course=(12, 45, 20))
    records = [observe(spoilt(sound[0]), BELIEVED), observe(sound[1], BELIEVED)]
    assert records[0].count == records[0].samples - 1 and records[1].count == records[1].samples
    found = compare(plant_of(catalogue()), records, BELIEVED, catalogue())
    assert found.error == pytest.approx(found.noise_floor, rel=0.02)
    assert found.parameters["natural_frequency"].value == pytest.approx(TRUE.structure.natural_frequency, rel=3e-4)
    part = records[0].part(PLACE - 10, 64)
    assert part.filled[10] and part.count == 63
