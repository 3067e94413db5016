"""The tutorials of docs/ do what they say: every file is written, every line run in an empty folder, every answer compared."""

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from tests.support.doc_pages import ROOT

PAGES = sorted((ROOT / "docs" / "tutorials").glob("*.md"))
NUMBER = re.compile(r"(?<![\w.])[+-]?\d+(?:\.\d+)?(?:e[+-]?\d+)?|(?<=[\d.])[+-]\d+\.\d+(?=j)")
ALIKE = 0.02  # relative difference of two numbers: answers differ in their last digits from processor to processor
PROGRAM = "import sys; from testbed.cli import main; main(sys.argv[1:])"


def blocks(page):
    """(language, text) of every block of a page, in order."""
    return re.findall(r"^```(\w+)\n(.*?)^```", page.read_text(encoding="utf-8"), re.MULTILINE | re.DOTALL)


def told(expected, line):
    """Whether a line of an answer is the one expected: words as they are, numbers nearly, `...` at the end is anything."""
    open_end, expected = expected.endswith("..."), expected.removesuffix("...").rstrip()
    words, values = NUMBER.sub("#", " ".join(expected.split())), NUMBER.findall(expected)
    found, numbers = NUMBER.sub("#", " ".join(line.split())), NUMBER.findall(line)
    same = found.startswith(words) if open_end else found == words
    pairs = [(float(one), float(other)) for one, other in zip(values, numbers, strict=False)]
    return same and all(abs(one - other) <= ALIKE * abs(one) for one, other in pairs)


@pytest.fixture
def shell(tmp_path, monkeypatch):
    """Runs a block of shell in an empty folder, with this source's `testbed` and this `python`; returns what it says."""
    programs = tmp_path / "programs"
    programs.mkdir()
    for name, words in (("testbed", f"-c '{PROGRAM}'"), ("python", "")):
        (programs / name).write_text(f'#!/bin/sh\nexec "{sys.executable}" {words} "$@"\n')
        (programs / name).chmod(0o755)
    folder = tmp_path / "empty"
    folder.mkdir()
    monkeypatch.chdir(folder)
    there = {**os.environ, "PATH": f"{programs}:{os.environ['PATH']}", "PYTHONPATH": str(ROOT)}

    def run(text):
        done = subprocess.run(["sh", "-e", "-c", text], env=there, capture_output=True, text=True, timeout=1800)
        assert done.returncode == 0, f"{text}{done.stderr}"
        return done.stdout

    return run


def test_three_readers_have_a_tutorial():
    index = (ROOT / "docs" / "index.md").read_text(encoding="utf-8")
    assert len(PAGES) == 3 and all(f"](tutorials/{page.name})" in index for page in PAGES)


def test_an_answer_is_told_from_another():
    line = "run 0  2600 rpm  -0.9293+0.2215j  yes"
    assert told("run 0 2600 rpm -0.9291+0.2214j yes", line) and told("run 0 2600 rpm ...", line)
    for other in ("run 0 2600 rpm -0.9291+0.2314j yes", "run 0 2900 rpm ...", "run 0 2600 rpm -0.9291+0.2214j no", "run 0"):
        assert not told(other, line), other


@pytest.mark.long
@pytest.mark.parametrize("page", PAGES, ids=[page.stem for page in PAGES])
def test_a_tutorial_runs_from_nothing(page, shell):
    answer, compared = "", 0
    for language, text in blocks(page):
        if language == "sh":
            answer = shell(text)
        elif language == "text":
            lines = iter(answer.splitlines())
            for expected in text.splitlines():
                assert any(told(expected, line) for line in lines), f"{page.name}: not said, or in another order: {expected}"
                compared += 1
        else:
            Path(re.match(r"# (\S+)\n", text).group(1)).write_text(text)
    assert compared >= 5
