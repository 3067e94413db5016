"""docs/files.md names every key that a file may have and no other, and its tables say what the program has."""

from dataclasses import fields
from typing import get_args

import pytest

from testbed import readers, units
from testbed.catalogue import catalogue
from testbed.effect import HOOKS
from testbed.files import channel_units, manifest, model_file, structure_file, taps_file, yaml_text
from testbed.noise import NoiseRecipe
from testbed.readers import checks, hdf5, table, timebase
from testbed.scenario import axis, design_file, scenario_file
from testbed.scenario.draws import KINDS
from testbed.scenario.variables import MARK, variables
from testbed.sweeps import cluster
from tests.support import doc_pages
from tests.support.campaign_files import TRUE
from tests.support.doc_pages import codes

FILES = doc_pages.read("files.md")
KEYS = doc_pages.tables(FILES)
EFFECTS = catalogue()


def of(kind):
    """The keys of a pydantic model."""
    return {field.alias or name for name, field in kind.model_fields.items()}


SHARED = of(manifest._Conditions)
MODELS = {
    "model.yaml: top level": model_file._ModelFile, "structure": structure_file._Structure,
    "modes": structure_file._Mode, "cutter": model_file._Cutter,
    "cutting": model_file._Cutting, "Keys of the campaign and of a record": manifest._Conditions,
    "Keys of a channel": manifest.ChannelEntry, "scenario.yaml: top level": scenario_file._ScenarioFile,
    "cut": scenario_file._Cut, "spread": scenario_file._Spread, "An axis of equal steps": axis._Spaced,
    "sample": design_file._Sample, "A range of over": design_file._Ends, "refine": design_file._Refine,
    "sensors": scenario_file._Sensors, "A sensor's keys": scenario_file._Channel, "engine": scenario_file._Engine,
    "campaign.yaml: top level": manifest.ManifestEntry, "records": manifest.RecordEntry,
    "Keys of the file and of a tap": taps_file._Shared, "taps.yaml: top level": taps_file.TapsEntry, "taps": taps_file.TapEntry,
    "A channel of a tap": taps_file.TapChannel, "response": taps_file.TapResponse,
}
OTHERS = {
    "Kinds of record": set(get_args(manifest.Kind)), "channels": set(manifest.CHANNELS), "model of a scenario": {"file"},
    "tests and sweep": set(variables(TRUE, EFFECTS)), "random": {*KINDS, "deviation", "present", MARK},
    "A noise recipe": {"white", *(one.name for one in fields(NoiseRecipe))},
}


@pytest.mark.parametrize("heading", [*MODELS, *OTHERS])
def test_a_table_names_the_keys_that_are_read_and_no_others(heading):
    shared = {"campaign.yaml: top level": SHARED, "records": SHARED, "taps.yaml: top level": of(taps_file._Shared),
              "taps": of(taps_file._Shared), "response": of(taps_file.TapChannel)}.get(heading, set())
    known = OTHERS.get(heading) or of(MODELS[heading]) - shared
    assert sorted(KEYS[heading].keys()) == sorted(known)


def test_every_mapping_that_is_read_has_a_table():
    def below(kind):
        return {one for each in kind.__subclasses__() for one in {each, *below(each)}}

    elsewhere = {cluster._ClusterFile, scenario_file._Timing}  # docs/running_on_a_cluster.md
    assert {one for one in below(yaml_text.Strict) if one.__module__.startswith("testbed.")} - elsewhere == {*MODELS.values()}
    assert all(f"{key}:" in doc_pages.read("running_on_a_cluster.md") for key in of(cluster._ClusterFile))


def _effect_row(name, parameter):
    low, high = parameter.bounds
    value, left_out = (units.format_quantity(one, parameter.unit) for one in (parameter.example, parameter.neutral))
    form = parameter.channels or parameter in EFFECTS[name].form
    return [f"`{name}.{parameter.name}`", parameter.unit, f"{low:g} to {high:g}", f"`{value}`",
            parameter.meaning + (f"; may be left out: then {left_out}" if form else "")]


def test_the_table_of_effects_is_the_catalogue():
    rows = []
    for name, effect in EFFECTS.items():
        rows += [_effect_row(name, one) for one in effect.every_parameter] or [
            [f"`{name}`", "", "", "`{}`", f"{effect.title}: no parameter, it is there or it is not"]]
    assert KEYS["effects"].rows == rows


def test_the_table_of_units_is_that_of_the_program():
    assert [codes(cell) for cell in KEYS["Units"].column("units")] == [list(known) for known in units.TABLE.values()]
    assert set(channel_units.UNCALIBRATED) <= set(codes(FILES))


def test_the_table_of_hooks_is_the_contract():
    assert KEYS["An effect of your own"].rows == [[f"`{name}`", hook.unit, hook.meaning] for name, hook in HOOKS.items()]
    assert [hook.joins == "python" for hook in HOOKS.values()] == [False] * (len(HOOKS) - 4) + [True] * 4


def test_what_readers_look_for_is_named():
    wanted = {*readers._ENDINGS, *readers._REFUSED, *table._TIME_NAMES, *hdf5._RATE_NAMES, *hdf5._STEP_NAMES}
    assert wanted <= set(codes(FILES)), wanted - set(codes(FILES))
    endings = {ending for cell in KEYS["Files that are read"].column("name ends in") for ending in codes(cell)}
    assert endings == set(readers._ENDINGS)


@pytest.mark.parametrize("said", [
    f"at most {yaml_text.MAX_BYTES // 1000} kB", f"fewer than {checks._FEWEST} samples",
    f"by more than {100 * timebase._AGREE:g} %", f"0 to {design_file.MOST_LEVELS}",
    f"up to {design_file.MAX_RUNS // 1_000_000} million runs",
])
def test_numbers_in_words_are_those_of_the_program(said):
    assert said in FILES
