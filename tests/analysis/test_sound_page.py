"""The page on which a chart is heard carries the very cuts that it names: their lines are where the multipliers say."""

import base64
import json
import re

import numpy as np
import pytest

import testbed
from testbed.analysis.report.sound_page import FADED_S, SimulatedCut, sound_page
from testbed.files.model_file import write_model
from testbed.machine import Cutter, Cutting, Mode, Model, Structure
from tests.support.shell import Shell

RIG = Model(Structure(2.573, 146.6, 0.0032), Cutter(), Cutting("up-milling", 0.162, 5.5e8, 2e8))
TWO = Model(Structure.of((Mode(2.5, 146.6, 0.01, 1.4), Mode(0.6, 310.0, 0.02, 0.1, "tool"))), Cutter(2, 20e-3),
            Cutting("down-milling", 0.2, 6e8, 2e8))


def carried(page):
    """(what the page carries, its samples as floats)."""
    text = page.read_text(encoding="utf-8")
    assert "http" not in text.replace("http-equiv", "") and "default-src 'none'" in text
    found = json.loads(re.search(r'<script type="application/json" id="sound">(.*?)</script>', text, re.S)[1])
    return found, np.frombuffer(base64.b64decode(found["samples"]), np.int8) / 127.0, text


def share_of(values, rate, base):
    """Share of the power within 1.5 lines of multiples of a frequency (Hz)."""
    power = np.abs(np.fft.rfft(values * np.hanning(len(values)))) ** 2
    frequency = np.fft.rfftfreq(len(values), 1.0 / rate)
    near = np.abs(frequency - base * np.round(frequency / base)) < 1.5 * frequency[1]
    return float(power[near & (frequency > 0.5 * base)].sum() / power[1:].sum())


def test_a_stable_cut_sounds_of_its_teeth_and_a_chattering_one_does_not(tmp_path):
    chart = testbed.chart(RIG, "2500 rpm:4500 rpm:81", "0.1 mm:4 mm:40")
    found, samples, text = carried(chart.report(tmp_path / "chart.html"))
    kinds = np.frombuffer(base64.b64decode(found["classes"]), np.int8).reshape(40, 81)
    assert (kinds == chart.detail.classes).all() and len(found["cuts"]) == 13 * 8 and found["rate"] == 8000.0
    assert "acceleration of the workpiece along x" in text and "flexible along the feed only" in text

    def teeth(rpm, mm):
        one = min(found["cuts"], key=lambda cut: abs(cut["speed"] - rpm) / 2000 + abs(cut["depth"] - mm) / 4)
        heard = samples[one["first"]:one["first"] + one["count"]]
        assert one["count"] == pytest.approx((0.5 - FADED_S) * 8000, abs=1) and np.abs(heard).max() == 1.0
        return share_of(heard, 8000.0, one["speed"] / 60.0), one["gain"], share_of(heard, 8000.0, one["speed"] / 120.0)

    stable, chatter, flip = teeth(3833, 1.8), teeth(3167, 2.3), teeth(3667, 2.9)
    assert stable[0] > 0.98 and chatter[0] < 0.7 and chatter[1] > stable[1]
    assert flip[2] > 0.9 > flip[0] + 0.2  # every second tooth alike


def test_in_x_and_y_the_slowest_mode_s_carrier_is_heard(tmp_path):
    chart = testbed.chart(TWO, "3500 rpm:4500 rpm:3", "0 mm:0.4 mm:2")
    found, _, text = carried(chart.report(tmp_path))
    assert "acceleration of the workpiece along y" in text and len(found["cuts"]) == 6
    silent, loud = found["cuts"][0], found["cuts"][-1]
    assert (silent["depth"], silent["said"], silent["count"]) == (0.0, "silent", 0) and loud["count"] > 0


def test_what_diverged_is_said_to_have_no_sound(tmp_path):
    chart = testbed.chart(RIG, "3000 rpm:4000 rpm:3", "1 mm:2 mm:2").detail
    tone = np.sin(np.arange(4000) * 0.3)
    cuts = [SimulatedCut(320.0, 1e-3, None), SimulatedCut(330.0, 1e-3, tone), SimulatedCut(340.0, 1e-3, 1e-4 * tone)]
    found, samples, _ = carried(sound_page(tmp_path / "page.html", chart, cuts, 8000.0, "workpiece along x"))
    lost, one, faint = found["cuts"]
    assert (lost["count"], lost["said"]) == (0, "without a sound: it diverged") and one["gain"] == 1.0 and faint["gain"] == 0.1
    heard = samples[one["first"]:one["first"] + one["count"]]
    turned = np.abs(np.diff(np.concatenate([heard, heard])))  # no click where the end meets the beginning
    assert turned.max() < 0.32


def test_the_command_writes_it_beside_the_pictures(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    write_model(RIG, tmp_path / "rig.yaml")
    (tmp_path / "report.html").write_text("of a comparison")
    assert Shell(capsys)("chart", "rig.yaml", "--speed", "3000:4000:3", "--depth", "1:2:2", "--page") == 0
    assert len(carried(tmp_path / "chart.html")[0]["cuts"]) == 6
    assert (tmp_path / "report.html").read_text() == "of a comparison" and (tmp_path / "stability_chart.png").is_file()
