"""Chatter told from runout, hum and transients by made signals, each of which holds one thing that misleads."""

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lfilter

from testbed.analysis.multipliers.run_labels import observed
from testbed.analysis.records.chatter import judge_cut
from testbed.analysis.records.cut_end import CutEnd
from testbed.analysis.records.cut_span import still_cutting
from testbed.analysis.records.orders import turns_of
from testbed.analysis.records.passing_speed import cut_speeds
from testbed.analysis.records.segments import Segment, find_segments
from testbed.recording import Recording
from tests.validation.chatter_cuts import draw

RATE, TURN = 5000.0, 0.05  # Hz, s
IDLE, CUT = 20, 80  # revolutions


def recorded(values, quantity, unit, flutes, marks=True):
    time = np.arange(len(values)) / RATE
    known = {"spindle_speed": 2 * math.pi / TURN, "flutes": flutes, "feed_per_tooth": 1e-4}
    noise = 1e-3 * values.std() * np.random.default_rng(1).standard_normal(len(values))
    return Recording({quantity: values + noise}, RATE, {quantity: unit}, "synthetic", conditions=known,
                     marks=np.arange(0.01, time[-1], TURN) if marks else np.empty(0))


def parts(idle=IDLE, cut=CUT):
    return (Segment("idle", 0.0, idle * TURN), Segment("steady", idle * TURN, (idle + cut) * TURN))


def force(chips, idle=IDLE, cut=CUT):
    """Pulses (N) of a fifth of a pass from teeth whose chips (turns, flutes) are those."""
    flutes = len(chips(0))
    sizes = np.concatenate([np.zeros(idle * flutes), *(chips(turn) for turn in range(cut))])
    place = np.arange(int((idle + cut) * TURN * RATE)) / RATE / TURN * flutes
    return sizes[place.astype(int)] * np.clip(
        np.sin(math.pi * (place % 1.0) / 0.2), 0.0, None) * (place % 1.0 < 0.2) * 100.0


def judged(values, quantity="force_x", unit="N", flutes=4, segments=None):
    return judge_cut(recorded(values, quantity, unit, flutes), segments or parts())


def test_a_force_of_uneven_teeth_is_runout_where_a_cutter_beside_its_axis_makes_it_and_a_flip_where_every_other_tooth_cuts():
    eccentric = 1.0 + 0.9 * np.cos(np.pi / 2 * np.arange(4))
    assert judged(force(lambda turn: eccentric)).verdict == "none"
    found = judged(force(lambda turn: np.array([1.8, 0.2, 1.8, 0.2])))
    assert (found.verdict, found.kind) == ("chatter", "flip_or_runout")
    assert found.frequency * TURN % 4 == pytest.approx(2.0)


def test_two_teeth_are_told_by_what_stands_at_once():
    def uneven(share):
        return lambda turn: np.array([1.0 + share(turn), 1.0 - share(turn)])

    at_once = judged(force(uneven(lambda turn: 0.8)), flutes=2)
    grown = judged(force(uneven(lambda turn: 0.8 * min(1.0, 0.05 * 1.2**turn))), flutes=2)
    assert at_once.verdict == "none"
    assert (grown.verdict, grown.kind) == ("chatter", "flip")  # runout stands from the first revolutions on


def motion(line, flutes=1, cut=CUT, size=1e-4, course=None, idle=IDLE):
    """Displacement (m): tooth passing of a tenth of the line, and the line at an order of the spindle; course of its size."""
    turns = np.arange(int((idle + cut) * TURN * RATE)) / RATE / TURN
    on = turns >= idle
    course = course(turns - idle) if course else 1.0
    return on * size * (0.1 * np.cos(2 * math.pi * flutes * turns) + course * np.cos(2 * math.pi * line * turns))


def teeth(flutes=2, size=1e-5):
    """Displacement (m) at the tooth passing alone, a tenth of the feed."""
    return motion(0.0, flutes, size=10 * size, course=lambda turns: 0.0)


def test_a_faint_line_with_side_bands_is_the_cut_s_where_it_is_sharp_and_no_idling_has_it():
    """The sensor sits on a part that hardly moves: the line is a hundredth of the feed, and a fifth of the tooth passing."""
    sizes = {5.09: 2e-6, 3.09: 1e-6, 7.09: 5e-7}
    lines = sum(motion(order, 2, size=size) - teeth(2, 0.1 * size) for order, size in sizes.items())
    assert judged(teeth() + lines, "displacement", "m", 2).verdict == "chatter"
    everywhere = teeth() + lines + 2e-6 * np.cos(2 * math.pi * 5.09 * np.arange(len(lines)) / RATE / TURN)
    everywhere[: int(IDLE * TURN * RATE)] = lines[-int(IDLE * TURN * RATE):]
    assert judged(everywhere, "displacement", "m", 2).verdict == "none"  # stood there before the teeth cut


def test_what_noise_keeps_swinging_is_no_chatter_however_it_leads():
    noise = np.random.default_rng(5).standard_normal(len(teeth()))
    damping, turned = 0.02, 2 * math.pi * 5.4 / TURN / RATE
    swings = lfilter([1.0], [1.0, -2 * math.exp(-damping * turned) * math.cos(turned), math.exp(-2 * damping * turned)], noise)
    swings *= np.arange(len(noise)) > IDLE * TURN * RATE
    assert judged(teeth() + 3e-6 * swings / swings.std(), "displacement", "m", 2).verdict == "none"
    assert judged(teeth(size=1e-6) + 3e-6 * swings / swings.std(), "displacement", "m", 2).verdict == "none"


def test_a_cut_chatters_where_one_of_its_channels_shows_it():
    """The other stands out more: nothing but its teeth, and little noise."""
    shows, deaf = (recorded(values, "displacement", "m", 2) for values in (motion(2.37, 2), teeth(size=1e-3)))
    both = replace(deaf, channels={"displacement_x": deaf.channels["displacement"],
                                   "displacement_y": shows.channels["displacement"]},
                   units={"displacement_x": "m", "displacement_y": "m"})  # fmt: skip
    found = judge_cut(both, parts())
    assert (found.verdict, found.channel) == ("chatter", "displacement_y")


def test_idling_of_a_few_periods_tells_nothing_of_a_line():
    whole = turns_of(motion(9.3)[int(IDLE * TURN * RATE):], np.arange(CUT * int(TURN * RATE)) / RATE, np.empty(0), TURN)
    idle = np.random.default_rng(3).standard_normal(int(3 * TURN * RATE))
    end = CutEnd(whole.last(19), whole, 1, idle, RATE, 0, 1e-4, False, True)
    assert math.isnan(end.before(1.0)) and end.before(9.3) > 0.0


def test_chatter_that_beats_does_not_die_and_a_transient_does():
    beats = motion(2.37, course=lambda turns: 0.6 + 0.4 * np.cos(2 * math.pi * turns / 38.0 - 1.2))
    assert judged(beats, "displacement", "m", 1).verdict == "chatter"
    dies = motion(2.37, course=lambda turns: 0.95 ** np.clip(turns, 0.0, None))
    assert judged(dies, "displacement", "m", 1).verdict == "none"


def test_a_high_line_in_an_odd_number_of_revolutions_is_found_in_both_halves():
    values = motion(9.3, cut=41)[int(IDLE * TURN * RATE):]
    whole = turns_of(values, np.arange(len(values)) / RATE, np.empty(0), TURN)
    end = CutEnd(whole.last(19), whole, 1, np.empty(0), RATE, 0, 1e-4, False, True)
    line = end.lines()[0]
    assert line.order == pytest.approx(9.3, abs=0.01)
    assert line.kept == pytest.approx(1.0, abs=0.1) and line.kept_before == pytest.approx(1.0, abs=0.1)


@pytest.mark.parametrize(("line", "kind"), [(2.5, "flip"), (2.3, None), (1.8, "neimark_sacker")])
def test_a_line_near_an_odd_half_of_the_tooth_passing_that_was_loud_at_once_tells_no_kind(line, kind):
    found = judged(motion(line, flutes=5, size=3e-4), "displacement", "m", 5)
    assert (found.verdict, found.kind) == ("chatter", kind)


def test_lines_that_belong_to_no_family_tell_no_kind():
    """A line and its side bands hold most of a Neimark-Sacker; of lines at any places, none tells a kind."""
    values = sum(motion(line, flutes=5, size=3e-4) for line in (1.8, 6.1, 0.73, 7.57))
    assert judged(values, "displacement", "m", 5).kind is None
    family = sum(motion(line, flutes=5, size=3e-4) for line in (1.8, 6.8, 3.2, 8.2))
    assert judged(family, "displacement", "m", 5).kind == "neimark_sacker"


@pytest.mark.parametrize(("hertz", "verdict"), [(50.6, "chatter"), (50.02, "unknown")])
def test_a_line_is_on_the_mains_only_as_nearly_as_its_place_is_known(hertz, verdict):
    """Of the last 12 revolutions one bin is 1.7 Hz; the line stands so high that a third of that is told."""
    values = motion(hertz * TURN, cut=24, idle=0)
    assert judged(values, "displacement", "m", 1, parts(0, 24)).verdict == verdict


def places(*called):
    return [(kind, round(start * RATE), round(stop * RATE)) for kind, start, stop in called]


def test_what_cuts_still_is_named_so():
    values, turn = motion(2.37), TURN * RATE
    called = places(("idle", 0.0, 1.0), ("steady", 1.0, 1.4), ("ring-down", 1.4, 5.0))
    assert still_cutting(called, values, turn) == places(("idle", 0.0, 1.0), ("steady", 1.0, 5.0))
    rings = motion(2.37, course=lambda turns: np.where(turns < 8, 1.0, 0.97 ** (turns - 8)))
    assert still_cutting(called, rings, turn) == called
    hum = 1e-5 * np.sin(2 * math.pi * 50.0 * np.arange(int(5.0 * RATE)) / RATE)
    idles = hum + np.concatenate([values[: int(4.0 * RATE)], values[: int(1.0 * RATE)]])
    astray = places(("idle", 0.0, 1.0), ("entry", 1.0, 4.0), ("steady", 4.0, 5.0))
    assert still_cutting(astray, idles, turn) == places(("idle", 0.0, 1.0), ("entry", 1.0, 4.0), ("idle", 4.0, 5.0))


def test_a_simulated_flip_whose_level_wanders_is_cut_to_its_end():
    """Its segments were steady up to a half of the cut, then an exit of as many revolutions, which is as loud."""
    drawn = draw(400205, "flip")
    turn = 2 * math.pi / drawn.recording.conditions["spindle_speed"]
    found = find_segments(drawn.recording)
    assert "exit" not in [part.kind for part in found]
    steady = next(part for part in found if part.kind == "steady")
    assert 65 * turn < steady.duration < 85 * turn


def test_the_speed_is_heard_from_runout_where_the_teeth_are_faint():
    turns = np.arange(int(CUT * TURN * RATE)) / RATE / TURN
    values = sum(np.cos(2 * math.pi * order * turns + order) for order in (1, 2, 4, 5, 7, 8, 10, 11, 13, 14))
    values = values + 0.3 * np.random.default_rng(2).standard_normal(len(values))
    (speed, *_), sure = cut_speeds(values, RATE, 1.02 * 2 * math.pi / TURN, 6)
    assert sure and speed == pytest.approx(2 * math.pi / TURN, rel=1e-3)


@pytest.mark.parametrize(("course", "behaviour"), [
    (lambda turns: 0.6 + 0.4 * np.cos(2 * math.pi * turns / 38.0 - 1.2), "neimark_sacker"),
    (lambda turns: 0.975 ** np.clip(turns, 0.0, None), "stable"),
])  # fmt: skip
def test_a_run_with_an_accelerometer_alone_is_classed_by_its_lines_where_its_samples_leave_it_open(course, behaviour):
    values = motion(2.37, course=course, size=3.0, cut=90)
    run = recorded(values, "acceleration", "m/s^2", 1)
    known = {**run.conditions, "idle_passes": IDLE, "passes": 88}
    run = replace(run, conditions=known, pass_times=np.arange(IDLE + 90) * TURN)
    assert observed(run, {"acceleration": 1e-3}) == behaviour
