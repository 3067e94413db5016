"""The chatter line: followed while it drifts, and left alone where the strongest line belongs to the spindle."""

import numpy as np
import pytest

from analysis.records.chatter import chatter_track
from analysis.records.lines import SpectralLine

RATE, START = 5000.0, 2.0
TIME = START + np.arange(40000) / RATE
CHATTER = SpectralLine(690.0, 1.0, "other")


def growing(lowest=680.0, highest=750.0):
    """(signal, its frequency at each sample): a line that comes up from 5 s on and sinks in frequency, over hum and noise."""
    size = 1.0 / (1.0 + np.exp(-(TIME - 6.0) / 0.15)) * (TIME < 8.0)
    frequency = highest - (highest - lowest) * size
    hum = 0.05 * np.sin(2 * np.pi * 750.0 * TIME) + 0.3 * np.sin(2 * np.pi * 300.0 * TIME)
    noise = 0.05 * np.random.default_rng(2).standard_normal(TIME.size)
    return size * np.sin(2 * np.pi * np.cumsum(frequency) / RATE) + hum + noise, frequency


def test_the_line_is_followed_both_ways_in_time():
    signal, frequency = growing()
    track = chatter_track(signal, RATE, [CHATTER, SpectralLine(300.0, 0.3, "tooth-passing", 1)], 7.0, START)
    assert track.time[0] == pytest.approx(5.72, abs=0.15) and track.time[-1] == pytest.approx(8.0, abs=0.15)
    assert np.all(np.diff(track.time) > 0)
    inside = track.time < 7.9  # the last windows reach behind the end
    truth = np.interp(track.time, TIME, frequency)
    assert np.abs(track.frequency - truth)[inside].max() < 8.0
    assert np.abs(track.frequency - truth)[inside & (track.time > 6.3)].max() < 2.0
    assert track.frequency[0] > 730.0 and track.loudest[1] == pytest.approx(680.0, abs=2.0)
    said = track.as_json()
    assert said["first_frequency"] == track.frequency[0] and len(said["time"]) == len(said["frequency"])


def test_where_the_strongest_line_has_a_cause_there_is_no_chatter():
    signal, _ = growing()
    for lines in ([], [SpectralLine(690.0, 1.0, "natural")], [SpectralLine(300.0, 2.0, "tooth-passing", 1), CHATTER]):
        assert chatter_track(signal, RATE, lines, 7.0, START) is None
    assert chatter_track(signal[:300], RATE, [CHATTER], START + 0.03, START) is None  # shorter than its window
