"""What nobody tells: the true speed of a cut without a tachometer, and a structure that still rings when a record begins."""

import math
from dataclasses import replace
from functools import partial

import numpy as np
import pytest

from testbed.analysis.comparison.compare import compare
from testbed.analysis.fit.observe import observe
from testbed.analysis.records.noise import noise_floor
from testbed.analysis.records.passing_speed import heard_speed, passing_speed
from testbed.analysis.records.segments import Segment, find_segments
from testbed.api.fitting import plant_of
from testbed.catalogue import catalogue
from testbed.cut import Cut
from testbed.engines import fast
from testbed.files.manifest import Feed
from testbed.machine import Cutter, Cutting, Model, Structure
from testbed.workshop import RPM, Measurement, measured_cut
from tests.support.campaign_files import BELIEVED, TRUE

RATE = 10000.0
STIFF = Model(Structure(0.35, 600.0, 0.009), Cutter(flutes=2, diameter=12e-3),
              Cutting("down-milling", 0.0913, 5.9e8, 1.25e8))
RUMOUR = STIFF.with_values({"natural_frequency": 589.0, "damping_ratio": 0.0101, "tangential_coefficient": 4.8e8,
                            "normal_coefficient": 1.5e8})
RINGING = 15e-6  # m, louder than the cut


def cut(rpm, depth, seed, *, model=STIFF, speed_error=0.0, ringing=0.0, noise=2e-6, rate=RATE):
    """A cut by another step size than the fit's, of a structure that may still ring at its start; no tachometer."""
    stated = Cut(rpm * RPM, depth * 1e-3, 1e-4, 60, 150, 50, initial_displacement=ringing)
    how = Measurement(rate=rate, noise=noise, speed_error=speed_error, mark_angle=0.3 + seed, late=20)
    record = measured_cut(partial(fast.simulate, steps=37), model, stated, how, seed, f"cut {seed}")
    return replace(record, recording=replace(record.recording, marks=np.empty(0)))


def test_the_speed_is_heard_from_all_harmonics_to_a_part_of_a_pass():
    random = np.random.default_rng(2)
    passing, time = 171.0, np.arange(int(0.9 * RATE)) / RATE
    teeth = sum(size * np.cos(2 * math.pi * passing * order * time + order) for order, size in ((1, 1.0), (2, 0.6), (5, 0.5)))
    chatter = 8.0 * np.cos(2 * math.pi * 4.21 * passing * time)
    for stated in (0.985, 1.0, 1.012):
        for motion in (teeth, teeth + chatter):
            heard = passing_speed(motion + 2.0 * random.standard_normal(time.size), RATE, stated * passing * math.pi, 2)
            assert abs(heard / (passing * math.pi) - 1.0) * 0.9 * passing < 0.2, stated


def test_a_speed_of_another_test_is_heard_where_single_lines_show_it():
    record = cut(4300, 1.66, 7)
    values = record.recording.channels["displacement"][int(1.0 * RATE):int(1.9 * RATE)]
    for wrong in (0.8, 0.93, 1.2):
        assert heard_speed(values, RATE, wrong * 4300 * RPM, 2) == pytest.approx(4300 * RPM, rel=2e-3), wrong


def test_noise_or_a_moment_tells_no_speed():
    random = np.random.default_rng(3)
    assert all(passing_speed(random.standard_normal(9000), RATE, 500.0, 2) is None for _ in range(40))
    assert passing_speed(np.cos(np.arange(200.0)), RATE, 500.0, 2) is None


def test_a_fit_begins_at_the_speed_that_the_cut_has():
    """Stated up to 1 % wrong and not measured: over a cut of 150 passes the phase would run round and round."""
    tests = ((5200, 1.84), (4300, 1.66), (3600, 1.78), (5800, 1.72))
    records = [cut(rpm, depth, seed, speed_error=0.01, ringing=RINGING * (seed % 2))
               for seed, (rpm, depth) in enumerate(tests, 3)]
    found = compare(plant_of(catalogue()), [observe(record, RUMOUR) for record in records], RUMOUR, catalogue())
    assert found.error == pytest.approx(found.noise_floor, rel=0.02)
    for name in ("natural_frequency", "damping_ratio", "tangential_coefficient"):
        one = found.parameters[name]
        assert abs(one.value - STIFF.value(name)) < one.high - one.low, name
    assert found.parameters["tangential_coefficient"].value == pytest.approx(5.9e8, rel=0.08)


@pytest.mark.parametrize("effects", [{}, {"dry_friction": {"force": 1.0, "presliding_displacement": 2e-7}}])
def test_what_rings_from_before_is_idling(effects):
    model = TRUE
    for name, values in effects.items():
        model = model.with_effect(name, **values)
    record = cut(3810, 0.6, 5, model=model, ringing=60e-6, noise=5e-7, rate=6400.0)
    first, second = find_segments(record.recording)[:2]
    entry = 60 * 60 / 3810
    assert first.kind == "idle" and second.kind in ("entry", "steady")
    assert first.stop == pytest.approx(entry, abs=0.7 * 60 / 3810)


@pytest.mark.parametrize("power", [1.0, 1.6])
def test_an_old_motion_is_no_noise(power):
    """One free decay is fitted; what dies otherwise is waited for."""
    random = np.random.default_rng(6)
    record = cut(4300, 1.66, 7)
    values = record.recording.channels["displacement"].copy()
    time = np.arange(values.size) / RATE
    values += 40e-6 * np.exp(-((25.0 * time) ** power)) * np.cos(2 * math.pi * 600.0 * time) + 1e-9 * random.standard_normal()
    recording = replace(record.recording, channels={"displacement": values})
    assert noise_floor(recording, find_segments(recording)).rms == pytest.approx(2e-6, rel=0.06)


def test_a_table_travels_as_stated_whatever_the_spindle_does():
    record = cut(4300, 1.66, 8, speed_error=0.01)
    stated = Feed(2 * 1e-4 * 4300 / 60, "second")
    by_tooth, by_travel = observe(record, STIFF), observe(replace(record, feed=stated), STIFF)
    true = 2 * math.pi / by_travel.period
    assert by_tooth.cut.feed_per_tooth == pytest.approx(1e-4)
    assert abs(true / (4300 * RPM) - 1.0) > 1e-3
    assert by_travel.cut.feed_per_tooth == pytest.approx(1e-4 * 4300 * RPM / true)


def test_the_believed_rig_is_found_from_a_wrong_speed_too():
    records = [cut(rpm, depth, seed, model=TRUE, speed_error=0.008, noise=1e-6, rate=6400.0)
               for seed, (rpm, depth) in enumerate(((3810, 2.9), (2850, 2.9), (3500, 0.8)))]
    found = compare(plant_of(catalogue()), [observe(record, BELIEVED) for record in records], BELIEVED, catalogue())
    assert found.error == pytest.approx(found.noise_floor, rel=0.02)


def test_a_record_that_idles_after_all_does_not_start_in_the_cut():
    """Where so much vibrates that no idling is seen, the fit finds it, and with it what rings from before."""
    tests = ((3810, 0.8, 3e-5), (2850, 2.9, 0.0), (3500, 0.8, 0.0))
    records = [observe(cut(rpm, depth, seed, model=TRUE, ringing=ringing, noise=7e-7, rate=6400.0), TRUE)
               for seed, (rpm, depth, ringing) in enumerate(tests)]
    whole = Segment("steady", records[0].start, records[0].start + records[0].samples / records[0].rate)
    records[0] = replace(records[0], starts_in_cut=True, segments=(whole,))
    found = compare(plant_of(catalogue()), records, TRUE, catalogue())
    assert not found.fitter.records[0].starts_in_cut
    assert found.error == pytest.approx(found.noise_floor, rel=0.03)
