"""The other pages of the site say what the code has: gates with their numbers, files of the fit, tables of a data set."""

import math
import re
from importlib import import_module

import click
import h5py
import pytest

import testbed
from testbed.catalogue import catalogue
from testbed.cli import testbed as commands
from testbed.files.synonyms import meant
from testbed.machine import Cutting
from tests.support import doc_pages
from tests.support.doc_pages import ROOT, codes
from tests.support.shell import Shell

SEARCH, FIT = doc_pages.read("how_the_search_works.md"), doc_pages.read("how_the_fit_works.md")
PAGES = [page for page in sorted((ROOT / "docs").rglob("*.md"))]
GATES = doc_pages.tables(SEARCH)["The gates"].rows


@pytest.mark.parametrize("gate", GATES, ids=[codes(row[1])[0] for row in GATES])
def test_a_gate_has_the_number_of_the_code(gate):
    module, constant = codes(gate[1])[0].split(".")
    folder = "fit" if module == "evidence" else "search"
    assert getattr(import_module(f"testbed.analysis.{folder}.{module}"), constant) == float(gate[2])


@pytest.mark.parametrize(("text", "folder"), [(FIT, "fit"), (SEARCH, "search")])
def test_files_that_a_page_names_are_there(text, folder):
    named = re.findall(r"\(`(\w+)`(?:, `(\w+)`)?\)", text)
    named += [codes(row[2]) for row in doc_pages.tables(text)["The valleys"].rows] if folder == "fit" else []
    files = {name for names in named for name in names if name}
    assert len(files) >= 5
    there = {path.stem for path in (ROOT / "analysis" / folder).rglob("*.py")}
    assert files <= there, files - there


def test_counts_of_the_search_stand_in_the_validation():
    text = (ROOT / "VALIDATION.md").read_text(encoding="utf-8")
    for row in doc_pages.tables(SEARCH)["How often it is right"].rows:
        assert f"| {row[1]} (" in text, row


def test_the_tables_of_a_data_set_are_named(tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert Shell(capsys)("run", "identification", "-o", "tests.h5") == 0
    page = doc_pages.read("data_sets.md")
    named = {name for row in doc_pages.tables(page)["Tables"].rows for name in codes(row[0])}
    patterns = [re.compile(re.sub("CHANNEL|PARAMETER", r"[\\w.]+", name) + "$") for name in named]
    with h5py.File("tests.h5") as file:
        tables = [name for name in file if not file[name].is_scale]
        attributes = set(file.attrs)
    assert len(tables) > 20 and [name for name in tables if not any(one.match(name) for one in patterns)] == []
    assert attributes == {name for row in doc_pages.tables(page)["Attributes of the file"].rows for name in codes(row[0])}


def test_immersions_of_the_glossary_are_those_of_a_width_of_cut():
    rows = doc_pages.tables(doc_pages.read("glossary.md"))["Immersion: 0.5 here is a slot"].rows
    for _, width, immersion in rows:
        angle = math.acos(1 - 2 * float(width))
        assert float(immersion.strip("`")) == pytest.approx(angle / (2 * math.pi), abs=5e-4)
        assert Cutting(immersion=float(immersion)).engagement_angle == pytest.approx(angle, abs=0.01)
    told = re.search(r"`(radial_immersion)`, `(ap)`, `(ae)`, `(fz)`, `(rpm)`, `(fs)`", doc_pages.read("glossary.md"))
    keys = ("radial_depth", "depth_of_cut", "feed", "spindle_speed", "sampling_rate")
    assert all(meant(word, keys) for word in told.groups())


@pytest.mark.parametrize("page", PAGES, ids=[page.stem for page in PAGES])
def test_commands_that_a_page_names_exist(page):
    known = {*commands.list_commands(click.Context(commands)), "COMMAND"}
    text = page.read_text(encoding="utf-8")
    lines = [line for block in doc_pages.blocks(text, "sh") for line in block.splitlines()]
    assert {name for name in re.findall(r"`testbed (\w+)", text)} <= known
    assert {line.split()[1] for line in lines if line.startswith("testbed")} <= known


REFERENCE = re.findall(r"^::: (\S+)\n    options:\n      (?:members: \[(.*)\]|heading: testbed\.(\w+))",
                       doc_pages.read("python.md"), re.MULTILINE)


def test_the_python_reference_shows_every_command_that_the_package_has():
    shown = {name for _, _, name in REFERENCE if name}
    assert {name for name in testbed.__all__ if name in commands.list_commands(click.Context(commands))} <= shown
    assert all(getattr(testbed, name).__module__ + "." + name == path for path, _, name in REFERENCE if name)


@pytest.mark.parametrize(("path", "members", "name"), REFERENCE, ids=[path for path, _, _ in REFERENCE])
def test_what_the_python_reference_shows_has_docstrings(path, members, name):
    shown = [getattr(testbed, name)] if name else [getattr(import_module(path), one) for one in members.split(", ")]
    for one in shown:
        parts = [value for name, value in vars(one).items() if not name.startswith("_") and (callable(value) or
                 isinstance(value, (property, classmethod, staticmethod)))] if isinstance(one, type) else []
        assert all(each.__doc__ for each in (one, *parts)), one
        assert not one.__doc__.startswith(f"{one.__name__}("), f"{one}: a dataclass's own signature is no docstring"


def test_every_effect_has_what_the_gallery_shows():
    for name, effect in catalogue().items():
        assert all((effect.title, effect.law, effect.source, effect.validity, effect.leaves)), name
        assert all(other in catalogue() for other, _ in effect.confused_with if "_" in other and " " not in other), name


def test_no_picture_is_a_large_raster():
    pictures = [path for folder in ("docs", "models", "testbed", "tests") for path in (ROOT / folder).rglob("*.[pjg][npi]*[gf]")
                if path.suffix in (".png", ".jpg", ".jpeg", ".gif")]
    assert len(pictures) > 2 and all(path.stat().st_size < 200_000 for path in pictures)
