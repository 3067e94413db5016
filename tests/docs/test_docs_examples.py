"""Every example of docs/files.md is read by the program: whole files, the example of every key, values told as defaults."""

import re
import shlex
from dataclasses import replace
from functools import partial

import click
import numpy as np
import pytest
from ruamel.yaml import YAML

from testbed import units
from testbed.catalogue import catalogue
from testbed.cli import _demo_loop
from testbed.cli import testbed as commands
from testbed.engines import fast
from testbed.files import yaml_text
from testbed.files.campaign import load_campaign
from testbed.files.model_file import model_from, read_model
from testbed.files.taps_file import TapsEntry
from testbed.scenario.design_file import SECTIONS
from testbed.scenario.scenario_file import read_scenario, scenario_from
from testbed.scenario.variables import MARK
from testbed.workshop import write_campaign
from tests.support import doc_pages
from tests.support.asked_files import channels_of, write_records
from tests.support.campaign_files import BELIEVED, TRUE
from tests.support.doc_pages import ROOT, codes
from tests.support.synthetic_campaign import synthetic_campaign

FILES = doc_pages.read("files.md")
KEYS = doc_pages.tables(FILES)
EFFECTS = catalogue()
CAMPAIGN = """
name: rig
sampling_rate: 12800 Hz
channels: {displacement: {column: disp, unit: um}, tachometer: {column: tach}}
records: [{file: a.csv, kind: cut, spindle_speed: 3810 rpm, depth_of_cut: 2.9 mm, feed: 0.1 mm/tooth}]
"""
NOISE = "{white: 1 um, hum: 1 um, spikes: 5 um, spike_rate: 2 Hz}"
DRAWN = "{coefficient: {uniform: [1e5 N/m, 2e5 N/m]}}"
SPEEDS = "{from: 2000 rpm, to: 5000 rpm%s}"
# where a table's keys stand in a whole file: its kind, the path, and what stands there beside a key
PLACES = {
    "model.yaml: top level": ("model", (), None), "structure": ("model", ("structure",), None),
    "modes": ("model", ("structure", "modes", 1), None),
    "cutter": ("model", ("cutter",), None), "cutting": ("model", ("cutting",), None),
    "campaign.yaml: top level": ("campaign", (), None), "records": ("campaign", ("records", 0), None),
    "Keys of the campaign and of a record": ("campaign", (), None), "channels": ("campaign", ("channels",), None),
    "Keys of a channel": ("campaign", ("channels", "displacement"), None),
    "scenario.yaml: top level": ("scenario", (), None), "model of a scenario": ("scenario", ("model",), "{}"),
    "cut": ("scenario", ("cut",), "{}"), "spread": ("scenario", ("cut", "spread"), "{}"),
    "tests and sweep": ("scenario", ("tests", 0), None),
    "An axis of equal steps": ("scenario", ("sweep",), f"{{spindle_speed: {SPEEDS % ', count: 4'}, depth_of_cut: 1 mm}}"),
    "sample": ("scenario", ("sample",), f"{{runs: 4, over: {{spindle_speed: {SPEEDS % ''}, depth_of_cut: 1 mm}}}}"),
    "A range of over": ("scenario", ("sample",), f"{{runs: 4, over: {{spindle_speed: {SPEEDS % ''}, depth_of_cut: 1 mm}}}}"),
    "refine": ("scenario", ("refine",), '{spindle_speed: "3000, 3500 rpm", depth_of_cut: "1, 2 mm"}'),
    "random": ("scenario", ("random", "damping_ratio"), "{}"), "sensors": ("scenario", ("sensors",), "{}"),
    "A sensor's keys": ("scenario", ("sensors", "displacement"), "{bits: 12, range: 2 mm}"),
    "A noise recipe": ("scenario", ("sensors", "displacement"), f"{{noise: {NOISE}}}"),
    "engine": ("scenario", ("engine",), "{}"),
    "taps.yaml: top level": ("taps", (), None), "Keys of the file and of a tap": ("taps", (), None),
    "taps": ("taps", ("taps", 0), None), "A channel of a tap": ("taps", ("taps", 4, "real"), None),
    "response": ("taps", ("response",), None),
}
BELOW = {"An axis of equal steps": ("spindle_speed",), "A range of over": ("over", "spindle_speed"),
         "A noise recipe": ("noise",)}
MODE = "{natural_frequency: 900 Hz, damping_ratio: 0.02, mass: 50 gram, direction: 30 deg%s}"
MODES = f"{{modes: [{MODE.replace('900', '800') % ''}, {MODE % ', on: tool'}]}}"
ALONE = ({"immersion", "radial_depth"}, {"mass", "stiffness"}, set(SECTIONS))  # one of these excludes the others


def yaml(text):
    return YAML(typ="safe").load(text)


def examples(kind):
    return doc_pages.examples(FILES, kind)


def _put(data, path, value):
    """Set a value in a tree of mappings and lists, whose mappings are made on the way; what it excludes goes."""
    for place, key in enumerate(path[:-1]):
        if isinstance(data, dict):
            _excluded(data, key)
            data = data.setdefault(key, [] if isinstance(path[place + 1], int) else {})
        else:
            data = data[key]
    _excluded(data, path[-1])
    data[path[-1]] = value


def _without(data, path, key):
    """The data without a key of the mapping at a path, which may be absent itself."""
    place = data
    for one in path:
        place = place[one] if isinstance(one, int) else place.get(one, {})
    place.pop(key, None)
    return data


def _excluded(data, key):
    for others in ALONE:
        if key in others and isinstance(data, dict):
            for other in others - {key}:
                data.pop(other, None)


def _whole(heading, key, example):
    """(kind, data) of a whole file that holds a table's key; without it where the example is None."""
    kind, path, beside = PLACES[heading]
    data = yaml(CAMPAIGN if kind == "campaign" else examples(kind)[0])
    if key == "key" and kind == "campaign":  # of a file with variables
        data["records"][0]["file"] = "a.mat"
        data["channels"] = {"displacement": {"column": 1, "unit": "um"}, "tachometer": {"column": 2}}
        if heading == "Keys of a channel":
            data["records"][0]["channels"] = {"tachometer": {"key": "run_3.signals"}}
    if heading == "random":
        special = {MARK: (("random",), "{}"), "present": (("random", "process_damping"), DRAWN)}
        path, beside = special.get(key, (path, beside))
    if heading == "Keys of a channel" and key in ("pulses_per_revolution", "edge"):
        path = ("channels", "tachometer")
    if heading == "modes" or key == "modes":  # in place of one mode along the feed
        data["structure"] = yaml(MODES)
    if "sensor" in heading:  # on what moves in x and y
        data["model"] = {**yaml(examples("model")[0]), "structure": yaml(MODES)}
    if key == "pitch":
        data["cutter"]["flutes"] = 4
    if beside is not None:
        _put(data, path, yaml(beside))
    path = (*path, *BELOW.get(heading, ()))
    if example is None:
        return kind, _without(data, path, key)
    value = yaml(example)
    whole = heading == "random" and isinstance(value, dict) and key in value  # a distribution is its mapping
    _put(data, path if whole else (*path, key), value)
    return kind, data


def _examples_of_keys():
    for heading in PLACES:
        for row in KEYS[heading].rows:
            for cell in codes(row[KEYS[heading].titles.index("example")]):
                for key in codes(row[0]):
                    yield heading, key, cell
                    if heading == "Keys of the campaign and of a record":
                        yield "records", key, cell


@pytest.mark.parametrize(("heading", "key", "example"), list(_examples_of_keys()))
def test_the_example_of_every_key_is_read(heading, key, example, tmp_path):
    assert _read(*_whole(heading, key, example), tmp_path) is not None


def _defaults():
    for heading in PLACES:
        for row in KEYS[heading].rows:
            absent = row[KEYS[heading].titles.index("where it is absent")] if heading != "channels" else ""
            if re.fullmatch(r"`[^`]+`", absent):
                yield heading, codes(row[0])[0], codes(absent)[0]


@pytest.mark.parametrize(("heading", "key", "default"), list(_defaults()))
def test_a_value_told_for_an_absent_key_is_what_is_taken(heading, key, default, tmp_path):
    absent, given, other = (_read(*_whole(heading, key, one), tmp_path) for one in (
        None, default, next(codes(row[-1])[0] for row in KEYS[heading].rows if codes(row[0])[0] == key)))
    assert _comparable(absent) == _comparable(given) != _comparable(other)


def test_there_are_defaults_and_examples_to_try():
    assert len(list(_defaults())) > 20 and len(list(_examples_of_keys())) > 100


def _comparable(found):
    if not hasattr(found, "records"):
        return replace(found, text="", file="") if hasattr(found, "course") else found
    return [(one.name, {name: values.tolist() for name, values in one.recording.channels.items()}, one.recording.marks.tolist(),
             one.recording.on_tool, dict(one.conditions)) for one in found.records]


def _read(kind, data, folder):
    """What the program reads from the data of a file, with the files beside it that it needs."""
    path = folder / f"{kind}.yaml"
    with path.open("w") as file:
        YAML(typ="safe").dump(data, file)
    if kind == "model":
        return read_model(path)
    if kind == "campaign":
        write_records(data, folder)
        return load_campaign(path)
    if kind == "taps":  # what its files hold is the matter of tests/analysis/test_tap.py
        return yaml_text.validate(yaml_text.load(path), TapsEntry)
    (folder / "model.yaml").write_text(examples("model")[0])
    return read_scenario(path)


@pytest.mark.parametrize("row", KEYS["effects"].rows, ids=lambda row: codes(row[0])[0])
def test_the_example_of_every_effect_s_parameter_is_read(row):
    name, _, parameter = codes(row[0])[0].partition(".")
    example, text = codes(row[3])[0], examples("model")[0]
    given = {one.name: units.format_quantity(one.example, one.unit) for one in EFFECTS[name].parameters} | (
        {parameter: example} if parameter else {})
    inside = ", ".join(f"{key}: {value}" for key, value in given.items())
    model = model_from(yaml_text.parse(f"{text}effects: {{{name}: {{{inside}}}}}\n", "m"))
    assert set(given) <= set(model.effects[name])


@pytest.mark.parametrize("text", examples("model"))
def test_a_model_is_read(text):
    model = model_from(yaml_text.parse(text, "model.yaml"))
    assert model.cutter is not None and model.structure.mass == 2.573


@pytest.mark.parametrize("text", examples("scenario"))
def test_a_scenario_is_read(text, tmp_path):
    (tmp_path / "model.yaml").write_text(examples("model")[0])
    (tmp_path / "s.yaml").write_text(text)
    scenario = scenario_from(yaml_text.load(tmp_path / "s.yaml"))
    runs = [scenario.run(place) for place in range(len(scenario))]
    assert len(runs) >= 3 and all(run.sampling.count > 100 for run in runs)


@pytest.mark.parametrize("text", examples("campaign"))
def test_a_campaign_is_read(text, tmp_path):
    (tmp_path / "campaign.yaml").write_text(text)
    data = yaml(text)
    write_records(data, tmp_path)
    campaign = load_campaign(tmp_path / "campaign.yaml")
    assert [one.kind for one in campaign.records] == [one["kind"] for one in data["records"]]
    for record, given in zip(campaign.records, data["records"], strict=True):
        wanted = {name for name, one in channels_of(data, given).items() if one != "none"} - {"time"}
        assert set(record.recording.channels) == wanted
        if "tachometer" in wanted:  # one mark a revolution, at the speed that is stated
            turn = float(np.median(np.diff(record.recording.marks)))
            assert 2 * np.pi / turn == pytest.approx(record.conditions["spindle_speed"], rel=0.02)
        if record.kind == "cut":
            assert record.cut(record.conditions.get("flutes", 1)).feed_per_tooth > 1e-5


def test_the_first_campaign_names_what_the_demo_leaves(tmp_path):
    cut = synthetic_campaign(partial(fast.simulate, steps=20), TRUE, tests=((3810, 2.9),), course=(2, 4, 2))
    first, written = yaml(examples("campaign")[0]), yaml(write_campaign(tmp_path, cut, BELIEVED)[0].read_text())
    assert first["folder"] == "demo/workshop" and first["sampling_rate"] == f"{_demo_loop.RATE:g} Hz"
    assert first["channels"] == written["channels"] and first["name"] == "workshop"
    stated = [(one["spindle_speed"], one["depth_of_cut"], one["feed"], one["file"]) for one in first["records"]]
    assert stated == [(f"{rpm} rpm", f"{depth} mm", f"{feed} mm/tooth", f"cut_{number}.csv")
                      for number, (rpm, depth, feed) in enumerate(_demo_loop.CUTS)]


@pytest.mark.parametrize("text", doc_pages.blocks(FILES, "python"))
def test_an_effect_of_one_s_own_is_read(text, tmp_path):
    name = re.match(r"# (\w+)\.py\n", text).group(1)
    (tmp_path / f"{name}.py").write_text(text)
    assert name not in EFFECTS and catalogue(tmp_path)[name].hooks


@pytest.mark.parametrize("line", [line for block in doc_pages.blocks(FILES, "sh") for line in block.splitlines()])
def test_every_line_of_shell_is_a_command_with_options_that_exist(line):
    program, name, *arguments = shlex.split(line)
    assert program == "testbed"
    assert commands.get_command(click.Context(commands), name).make_context(name, arguments).params is not None


def test_links_lead_somewhere():
    for page in (*(ROOT / "docs").rglob("*.md"), *ROOT.glob("*.md")):
        for link in re.findall(r"\]\(([^)#:]+)\)", page.read_text(encoding="utf-8")):
            assert (page.parent / link).exists() or link == "gallery.md", f"{page.name}: {link}"  # written when the site is
