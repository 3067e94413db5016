"""Did it chatter? Told from the record alone, by the motion of a simulator that shares no code with the engines."""

from dataclasses import replace

import numpy as np
import pytest

from testbed.analysis.records.chatter import judge_cut
from testbed.analysis.records.chatter_line import chatter_track
from testbed.analysis.records.lines import SpectralLine, fed_by_the_cut
from testbed.analysis.records.passing_speed import cut_speeds
from testbed.analysis.records.record_report import report
from testbed.analysis.records.segments import find_segments
from testbed.cut import Cut
from testbed.machine import Cutter, Cutting, Model, Structure
from tests.support.independent_simulator import simulate
from tests.validation import planar_chatter

RATE, START = 5000.0, 2.0
TIME = START + np.arange(40000) / RATE
RIG = Model(Structure(2.573, 146.5976, 0.0032), Cutter(), Cutting("up-milling", 0.162, 5.55768e8, 1.667304e8))
PUBLISHED = ((3050, 2.7, "neimark_sacker"), (3565, 2.1, "neimark_sacker"), (3635, 2.0, "flip"), (3810, 2.9, None),
             (2850, 2.9, None))  # rpm, mm, what the experiment showed (Mann and Young 2006)


def cut(rpm, depth, *, idle=12, passes=90, flutes=1, noise=5e-7):
    """The record of a cut with contact loss on the paper's rig, or on its like with more flutes."""
    speed = rpm * np.pi / 30
    model = replace(RIG, cutter=Cutter(flutes))
    course = Cut(speed, depth * 1e-3, 1.016e-4, idle, passes, 20)
    made = simulate(model, course, contact_loss=True, noise=noise, offset=3e-5, seed=rpm)
    return replace(made, conditions={"spindle_speed": speed, "flutes": flutes, "feed_per_tooth": 1.016e-4})


def judged(recording):
    return judge_cut(recording, find_segments(recording))


def changed(recording, add):
    values = recording.channels["displacement"]
    return replace(recording, channels={"displacement": values + add(recording.time)})


@pytest.mark.parametrize(("rpm", "depth", "kind"), PUBLISHED)
def test_the_published_cuts_are_told_apart(rpm, depth, kind):
    made = cut(rpm, depth)
    found = judged(made)
    assert (found.verdict, found.kind) == ("none" if kind is None else "chatter", kind)
    if kind is None:
        assert found.frequency is None and found.ratio is None and found.reason
    else:
        assert 146.0 < found.frequency < 153.0 and found.ratio > 2.0
    nominal = {**made.conditions, "spindle_speed": 1.02 * made.conditions["spindle_speed"]}
    blind = judged(replace(made, marks=np.empty(0), conditions=nominal))
    assert (blind.verdict, blind.kind) == (found.verdict, found.kind)


def test_the_kind_is_read_from_the_growth_where_the_line_lies_near_a_half_and_is_loud():
    """Case B (mu = -0.979 + 0.257j), recorded from the entry on: by the place of its line it may be a flip as well."""
    found = judged(cut(3565, 2.1, idle=0, passes=240))
    assert (found.verdict, found.kind) == ("chatter", "neimark_sacker")


def test_neither_hum_nor_the_natural_frequency_vetoes_what_the_cut_feeds():
    """Case A chatters at three times the mains, where its structure rings, too: the line is named for what feeds it."""
    hum = lambda time: 6e-6 * np.sin(2 * np.pi * 49.1 * 3 * time) + 9e-6 * np.sin(2 * np.pi * 150 * time)  # noqa: E731
    made = changed(cut(3050, 2.7), hum)
    found = report(made, "A", "cut", ())
    assert found.chatter.verdict == "chatter" and found.lines[0].kind == "chatter"
    assert found.lines[0].frequency == pytest.approx(found.chatter.frequency, abs=1.0)
    assert found.chatter_line.loudest[1] == pytest.approx(found.chatter.frequency, abs=2.0)
    said = found.as_json()["chatter"]
    assert {"verdict", "kind", "frequency", "ratio"} <= set(said) and said["kind"] == "neimark_sacker"


def test_hum_as_loud_as_the_cut_is_no_chatter():
    loud = lambda time: sum(2e-5 * np.sin(2 * np.pi * 50.0 * k * time + k) for k in (1, 2, 3))  # noqa: E731
    stable = changed(cut(3810, 2.9), loud)
    assert judged(stable).verdict == "none"
    within = slice(int(25 * 60 / 3810 * stable.sampling_rate), int(95 * 60 / 3810 * stable.sampling_rate))
    first, last = stable.time[within][[0, -1]]
    clip = replace(stable, channels={"displacement": stable.channels["displacement"][within]}, start=float(first),
                   marks=stable.marks[(stable.marks > first) & (stable.marks < last)])  # fmt: skip
    assert judged(clip).verdict == "none"  # several of its lines are the mains', and none has side bands


def test_a_line_on_the_mains_alone_is_not_known_where_nothing_was_recorded_before():
    stable = cut(3810, 2.9, idle=0, passes=100)
    found = judged(changed(stable, lambda time: 4e-5 * np.sin(2 * np.pi * 150.0 * time)))
    assert found.verdict == "unknown" and found.frequency == pytest.approx(150.0, abs=0.5) and "hum" in found.reason


def test_a_transient_that_dies_is_no_chatter_and_one_that_grows_is():
    assert judged(cut(3810, 2.9, passes=40)).verdict == "none"
    assert judged(cut(3050, 2.2, passes=40)).verdict == "chatter"


def test_what_repeats_with_the_spindle_is_runout_when_small_and_stays_open_when_large():
    stable = cut(1905, 1.0, flutes=2, passes=160, idle=20)  # two teeth: every other one cuts deeper
    turning = 1905 / 60

    def teeth(size):
        engaged = (stable.time > 20 / turning / 2) & (stable.time < 180 / turning / 2)
        return judged(changed(stable, lambda time: size * engaged * np.sin(2 * np.pi * turning * time)))

    assert judged(stable).verdict == "none" and teeth(4e-6).verdict == "none"
    found = teeth(1.5e-4)
    assert found.kind == "flip_or_runout" and found.frequency == pytest.approx(turning, rel=1e-3)


def test_what_cannot_be_known_is_said():
    short = cut(3050, 2.7, idle=2, passes=6)
    assert judged(short).verdict == "unknown" and "short" in judged(short).reason
    noisy = cut(3810, 0.01, idle=0, noise=1e-3)
    assert judged(noisy).verdict == "unknown"
    turned = replace(cut(3050, 2.7), units={"displacement": "V"})
    assert judged(turned).verdict == "chatter"  # louder than the teeth, whatever the volt is
    deaf = replace(short, channels={"tachometer": short.channels["displacement"]}, units={"tachometer": "V"})
    assert judge_cut(deaf, ()).verdict == "unknown"


def test_the_speed_of_a_cut_that_chatters_is_found_by_side_bands():
    made = cut(3050, 2.7)
    values = made.channels["displacement"][made.time > 0.4]
    speeds, _ = cut_speeds(values, made.sampling_rate, 1.025 * made.conditions["spindle_speed"], 1)
    assert speeds[0] == pytest.approx(made.conditions["spindle_speed"], rel=1e-3)


def growing(lowest=680.0, highest=750.0):
    """(signal, its frequency at each sample): a line that comes up from 5 s on and sinks in frequency, over hum and noise."""
    size = 1.0 / (1.0 + np.exp(-(TIME - 6.0) / 0.15)) * (TIME < 8.0)
    frequency = highest - (highest - lowest) * size
    hum = 0.05 * np.sin(2 * np.pi * 750.0 * TIME) + 0.3 * np.sin(2 * np.pi * 300.0 * TIME)
    noise = 0.05 * np.random.default_rng(2).standard_normal(TIME.size)
    return size * np.sin(2 * np.pi * np.cumsum(frequency) / RATE) + hum + noise, frequency


def test_the_line_is_followed_both_ways_in_time():
    signal, frequency = growing()
    track = chatter_track(signal, RATE, 690.0, 7.0, START)
    assert track.time[0] == pytest.approx(5.72, abs=0.15) and track.time[-1] == pytest.approx(8.0, abs=0.15)
    assert np.all(np.diff(track.time) > 0)
    inside = track.time < 7.9  # the last windows reach behind the end
    truth = np.interp(track.time, TIME, frequency)
    assert np.abs(track.frequency - truth)[inside].max() < 8.0
    assert np.abs(track.frequency - truth)[inside & (track.time > 6.3)].max() < 2.0
    assert track.frequency[0] > 730.0 and track.loudest[1] == pytest.approx(680.0, abs=2.0)
    said = track.as_json()
    assert said["first_frequency"] == track.frequency[0] and len(said["time"]) == len(said["frequency"])
    assert chatter_track(signal[:300], RATE, 690.0, START + 0.03, START) is None  # shorter than its window


def test_lines_that_the_cut_feeds_are_named_so_and_the_teeth_keep_theirs():
    lines = [SpectralLine(690.0, 3.0, "hum", 23), SpectralLine(300.0, 2.0, "tooth-passing", 1),
             SpectralLine(390.5, 1.0, "natural"), SpectralLine(450.0, 0.5, "hum", 9)]  # fmt: skip
    named = fed_by_the_cut(lines, 690.0, 2 * np.pi * 75.0, 4)
    assert [line.kind for line in named] == ["chatter", "tooth-passing", "chatter", "hum"] and named[0].order == 0


@pytest.mark.parametrize("seed", [10, 37])
def test_a_sensor_that_hardly_moves_with_the_chip_hears_chatter(seed):
    """Modes on tool and workpiece: against the feed the line is faint, against the orders of its own channel it is not."""
    recording, _ = planar_chatter.draw(seed, "neimark_sacker")
    found = judged(recording)
    assert found.verdict == "chatter"
    orders = found.frequency * 2 * np.pi / recording.conditions["spindle_speed"]
    assert abs(orders - round(orders)) > 0.02
