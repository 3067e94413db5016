"""README and the tour say what works: their commands are run, their YAML is read, their files exist."""

import os
import re
import shlex
import subprocess
import sys
from pathlib import Path

import click
import numpy as np
import pytest

from testbed.cli import main
from testbed.cli import testbed as commands
from testbed.files.campaign import load_campaign
from testbed.files.model_file import read_model
from testbed.store.data_set import read_data_set
from tests.support.made_taps import B2, write_taps

ROOT = Path(__file__).parents[2]
README = (ROOT / "README.md").read_text(encoding="utf-8")
TOUR = (ROOT / "docs" / "tour.md").read_text(encoding="utf-8")


def blocks(text):
    return re.findall(r"^```(\w+)\n(.*?)^```", text, re.MULTILINE | re.DOTALL)


def lines(text):
    return [line.split(" #")[0].strip() for kind, block in blocks(text) if kind == "sh" for line in block.splitlines()]


BLOCKS, LINES = blocks(TOUR), [*lines(README), *lines(TOUR)]
COMMANDS = [shlex.split(line)[1:] for line in lines(TOUR) if line.startswith("testbed")]
LONG = {"compare", "diagnose", "add", "plan", "paper"}  # minutes; their options are checked here, their work in other tests


def named_yaml():
    found = {}
    for kind, text in BLOCKS:
        if kind == "yaml":
            found[re.match(r"# (\S+)\n", text).group(1)] = text
    return found


def write_cuts(folder):
    """The tour's three cuts as the CSV files that its campaign names."""
    data = read_data_set(folder / "tests.h5")
    for number, recording in enumerate(data, 1):
        nearest = np.rint((recording.marks - recording.start) * recording.sampling_rate).astype(int)
        tachometer = np.zeros(len(recording))
        for width in range(12):
            tachometer[np.clip(nearest + width, 0, len(recording) - 1)] = 5.0
        table = np.column_stack([recording.channels["displacement"] * 1e6, tachometer])
        np.savetxt(folder / f"cut_{number}.csv", table, "%.4f", ",", header="disp_um,tach_V", comments="")


def test_every_line_of_shell_is_a_known_command():
    targets = set(re.findall(r"^(\w+):", (ROOT / "Makefile").read_text(), re.MULTILINE))
    for line in LINES:
        program, first, *_ = line.split()
        assert program in ("testbed", "make") or line == "pip install .", line
        assert program != "make" or first in targets, line
    assert lines(README)[:3] == ["pip install .", "make demo", "make test"] and len(COMMANDS) > 10


def test_what_the_readme_shows_is_part_of_the_tour():
    shown = {line for line in lines(README) if line.startswith("testbed")}
    assert len(shown) > 3 and shown <= {line.removesuffix(" --workers 2") for line in lines(TOUR)}
    assert named_yaml()["model.yaml"] == dict(blocks(README))["yaml"]
    assert README.count("\n") <= 90


@pytest.mark.parametrize("arguments", COMMANDS, ids=" ".join)
def test_every_option_exists(arguments):
    command = commands.get_command(click.Context(commands), arguments[0])
    assert command is not None
    context = command.make_context(arguments[0], list(arguments[1:]))
    assert context.params["quiet"] is False


@pytest.mark.long
def test_the_tour_runs(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    for name, text in named_yaml().items():
        Path(name).write_text(text)
    for axis, pair in (("x", "xx"), ("y", "yy")):
        write_taps(tmp_path, B2, pair)
        Path(f"{pair}.csv").rename(f"hammer_{axis}.csv")
    Path("taps.yaml").write_text(named_yaml()["taps.yaml"])
    done = 0
    for arguments in COMMANDS:
        if arguments[0] in LONG | {"view"}:
            continue
        with pytest.raises(SystemExit) as stop:
            main(list(arguments))
        said = capsys.readouterr()
        assert stop.value.code == 0, f"{arguments}: {said.err}"
        assert said.out.strip(), arguments
        done += 1
        if arguments[0] == "run":
            write_cuts(tmp_path)
    assert done >= len(COMMANDS) - len(LONG) - 2
    assert read_model("identified.yaml").value("natural_frequency") == pytest.approx(146.5976, abs=0.1)
    campaign = load_campaign("campaign.yaml")
    assert [record.cut(1).axial_depth_of_cut for record in campaign.records] == [2.9e-3, 2.9e-3, 2.0e-3]
    assert Path("pictures/stability_chart.png").stat().st_size > 5000


def test_the_rig_is_drawn_or_the_reason_said(tmp_path):
    command = next(arguments for arguments in COMMANDS if arguments[:2] == ["view", "flexure"])
    done = subprocess.run([sys.executable, "-c", "from testbed.cli import main; main()", *command], cwd=tmp_path,
                          env={**os.environ, "PYTHONPATH": str(ROOT)}, capture_output=True, text=True, timeout=120)
    drawn = (tmp_path / "rig.png").exists()
    assert (done.returncode, drawn) == (0, True) or ("draws nothing" in done.stderr and not drawn)


def test_the_files_it_names_exist():
    links = re.findall(r"\]\(([^)#:]+)\)", README) + re.findall(r"`((?:models|testbed|scenarios|analysis)/[^`]*)`", README)
    assert len(links) > 4
    for link in links:
        assert (ROOT / link).exists(), link
    assert (ROOT / "models/flexure/rig.png").stat().st_size < 300_000


def test_the_changelog_holds_the_version():
    version = re.search(r'^version = "(.*)"', (ROOT / "pyproject.toml").read_text(), re.MULTILINE).group(1)
    assert f"## {version} " in (ROOT / "CHANGELOG.md").read_text()
