"""A single tap by a sensor that reached its limit: every command that fits says so, and calls nothing held out."""

import json
from pathlib import Path

import numpy as np
import pytest

from tests.support.shell import Shell

RATE = 8000.0
NOTE = "tap: channel displacement: 5 samples are clipped at "


@pytest.fixture
def testbed(capsys, tmp_path, monkeypatch):
    """A decay at 80 Hz of 50 um in 1 um of noise, stuck at 52 um for five samples about its first peak."""
    monkeypatch.chdir(tmp_path)
    time = np.arange(4000) / RATE
    values = 50.0 * np.exp(-0.01 * 2 * np.pi * 80 * time) * np.sin(2 * np.pi * 80 * time)
    values += np.random.default_rng(5).standard_normal(time.size)
    values[23:28] = 52.0
    np.savetxt("tap.csv", values, header="x", comments="", fmt="%.5f")
    Path("c.yaml").write_text(
        f"name: taps\nsampling_rate: {RATE:g} Hz\nchannels:\n  displacement: "
        "{column: x, unit: um}\nrecords:\n  - {file: tap.csv, kind: ring-down}\n"
    )
    Path("m.yaml").write_text("structure: {mass: 1 kg, natural_frequency: 82 Hz, damping_ratio: 0.02}\n")
    return Shell(capsys)


def doubted(testbed, found):
    """Whether the answer carries the note, and says it once."""
    return [note for note in found["notes"] if note.startswith(NOTE)] and testbed.err.count(NOTE) == 1


def test_diagnose(testbed):
    found = testbed.json("diagnose", "c.yaml", "-m", "m.yaml", "-o", "page")
    assert found["verdict"] == "adequate" and found["held_out"] is False
    assert sum("the signal left its range in tap. " in note for note in found["notes"]) == 1
    assert "error, in the fit" in testbed.err and "nothing was held out, for" in testbed.err
    assert "error, held out" not in testbed.err
    page = Path("page/report.html").read_text()
    assert doubted(testbed, found) and NOTE in page
    assert "Nothing was held out" in page and "error, held out" not in page


def test_add(testbed):
    found = testbed.json("add", "quadratic_damping", "-m", "m.yaml", "-c", "c.yaml", "-o", "new.yaml", "--report", "page")
    assert doubted(testbed, found) and NOTE in Path("page/report.html").read_text()
    assert [one["held_out"] for one in found["records"]] == [False]
    assert not any(NOTE in warning or "on records" in warning for warning in found["warnings"])


def test_identify(testbed):
    assert doubted(testbed, testbed.json("identify", "c.yaml", "-m", "m.yaml", "--method", "waveform"))
    assert testbed("identify", "c.yaml", "-m", "m.yaml", "--method", "waveform", "--quiet", "--json", "i.json") == 0
    assert testbed.out == testbed.err == "" and json.loads(Path("i.json").read_text())["notes"]
