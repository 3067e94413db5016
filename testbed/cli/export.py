"""`testbed export`: a data set as a training set, Parquet with a card, that other programs open."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from typing import Any

import click

from testbed.api.result import plain
from testbed.cli._answer import Answer, progress
from testbed.cli._options import RATE, catalogue_of, effects_option, shared
from testbed.problem import InputProblem

LICENCES = {"CC-BY-4.0": "https://creativecommons.org/licenses/by/4.0/", "CC0-1.0":
            "https://creativecommons.org/publicdomain/zero/1.0/", "MIT": "https://opensource.org/license/mit"}
SPLIT_BY = ("condition", "machine")


@click.command(short_help="A training set for others: Parquet with a card, splits, labels and baseline scores.",
               epilog="Example: testbed export sweep.h5 -o training_set")
@click.argument("data", metavar="DATA.h5")
@click.option("-o", "--output", required=True, metavar="FOLDER", help="The folder to write; it must not exist yet.")
@click.option("--window", type=click.IntRange(8), metavar="SAMPLES",
              help="Rows are windows of this length, with a label each; by default a row is a run.")
@click.option("--step", type=click.IntRange(1), metavar="SAMPLES",
              help="From one window's start to the next one's; by default the length: no overlap.")
@click.option("--rate", type=RATE, metavar="RATE",
              help="A lower sampling rate for the signals, such as 10kHz; they are filtered.")
@click.option("--split", "split_text", default="70,15,15", show_default=True, metavar="A,B,C",
              help="Shares of train, validation and test.")
@click.option("--split-by", type=click.Choice(SPLIT_BY), default="condition", show_default=True,
              help="What lies in one split as a whole: an operating condition, or a machine.")
@click.option("--licence", type=click.Choice(list(LICENCES)), default="CC-BY-4.0", show_default=True,
              help="Under which you give it away.")
@click.option("--description", default="", metavar="TEXT", help="What the card says first; by default the scenario's.")
@effects_option
@shared
def command(data: str, output: str, window: int | None, step: int | None, rate: float | None, split_text: str, split_by: str,
            licence: str, description: str, folders: tuple[str, ...], json_file: str | None, seed: int | None,
            quiet: bool) -> None:
    """Write DATA.h5 as Parquet files with a dataset card, a Croissant description and a datasheet.

    Splits hold whole operating conditions (or machines), chosen by a hash of these, so that they stay when runs are added;
    --seed gives another division. With --window a row is a window of a run, labelled stable, neimark_sacker, flip, no_cut or
    unknown, with a chatter flag. The card holds the scores of simple methods on what is held out.
    """
    from testbed.cli._training import Notes
    from testbed.export.windows import Windowing
    from testbed.export.writing import Order, new_folder, plan, write_shards
    from testbed.store.data_set import read_data_set

    if step is not None and window is None:
        raise click.UsageError("--step goes with --window")
    answer = Answer(json_file, quiet)
    windows = None if window is None else Windowing(window, step or window)
    order = Order(_shares(split_text), seed or 0, split_by, windows, rate)
    _require_pyarrow()
    catalogue = catalogue_of(folders)
    source = read_data_set(data)
    planned = plan(source, catalogue, order)
    notes = Notes(source, planned, catalogue)
    with new_folder(output) as folder:
        with progress("exporting", quiet) as show:
            written = write_shards(source, folder, planned, notes.of_run, show, notes.of_row)
        content = _documents(folder, source, planned, written, notes,
                             {"licence": licence, "licence_url": LICENCES[licence], "description": description})
    _say(answer, output, content)
    answer.finish(plain({"folder": output, **{key: content[key] for key in (
        "runs", "splits", "shards", "classes", "labels", "behaviours", "contact_losses", "contact_unknown", "outcomes",
        "baseline")}}))


def _shares(text: str) -> tuple[float, ...]:
    try:
        shares = tuple(float(part) for part in text.split(","))
    except ValueError:
        shares = ()
    if len(shares) != 3 or not all(0 <= share < 1e6 for share in shares) or shares[0] <= 0:
        raise click.UsageError(f"--split '{text}': give three numbers, the first above 0, such as 70,15,15")
    return shares


def _require_pyarrow() -> None:
    from importlib.util import find_spec

    if find_spec("pyarrow") is None:
        raise InputProblem("testbed export", "needs pyarrow to write Parquet", "pip install 'machining-testbed[formats]'")


def _documents(folder: Any, source: Any, planned: Any, written: Any, notes: Any, said: dict[str, str]) -> dict[str, Any]:
    """Everything beside the shards; returns the content of `export.json`."""
    import json

    from testbed.export.card import card
    from testbed.export.croissant import croissant
    from testbed.export.datasheet import datasheet
    from testbed.export.writing import write_manifest

    description = said["description"] or f"Simulated milling cuts of the scenario {source.name}, with every run's truth."
    content = write_manifest(folder, planned, written, {
        **said, "description": " ".join(description.split()), "runs": len(source), "classes": notes.classes,
        "labels": notes.labels, "behaviours": notes.behaviours, "contact_losses": notes.contact_losses,
        "contact_unknown": notes.contact_unknown, "outcomes": Counter(source.outcome.tolist()), "baseline": notes.baseline()})
    (folder / "README.md").write_text(card(content, planned.columns), encoding="utf-8")
    (folder / "DATASHEET.md").write_text(datasheet(content, source.scenario_text, source.model_text), encoding="utf-8")
    (folder / "croissant.json").write_text(json.dumps(croissant(content, planned.columns), indent=2) + "\n", encoding="utf-8")
    return content


def _say(answer: Answer, output: str, content: Mapping[str, Any]) -> None:
    from testbed.export.card import GROUPS, contact_counts

    size = sum(one["bytes"] for one in content["shards"].values())
    rows = sum(one["rows"] for one in content["shards"].values())
    windows = "window" in content["about"]
    groups = GROUPS[content["about"].get("split_by", "condition")]  # older exports do not say
    what = f"{rows} windows of {content['runs']} runs" if windows else f"{content['runs']} runs"
    answer.say(f"{output}: {what}, {len(content['shards'])} Parquet files, {size / 1e6:.1f} MB")
    classes = sorted({name for counts in content["classes"].values() for name in counts})
    answer.table(("split", groups, "runs", *classes, "contact loss", "not known"), [
        (name, one["groups"], one["runs"], *(content["classes"].get(name, {}).get(each, 0) for each in classes),
         *contact_counts(content, name)) for name, one in content["splits"].items()])
    if windows:
        labels = sorted({name for counts in content["labels"].values() for name in counts})
        answer.table(("split", "windows", *labels), [
            (name, one["rows"], *(content["labels"].get(name, {}).get(each, 0) for each in labels))
            for name, one in content["splits"].items()])
    scores = content["baseline"]
    for one in scores["classifier"]:
        if one["split"] == "test":
            answer.say(f"baseline on {one['groups']} {groups} held out: accuracy {one['accuracy']:.3f} (naive "
                       f"{one['naive_accuracy']:.3f}), mean recall {one['recall']:.3f} (naive {one['naive_recall']:.3f})")
    for one in scores["regressor"]:
        if one["split"] == "test":
            answer.say(f"baseline, {one['parameter']}: rms error {one['rms']:.3g} (naive {one['naive_rms']:.3g})")
    for note in scores["notes"]:
        answer.say(f"note: {note}")


def describe_export(place: str, answer: Answer) -> None:
    """What `testbed inspect` says of an exported folder or of one of its files."""
    from testbed.export.reading import describe

    found = describe(place)
    about = found["about"]
    signals = [f"{name} [{about['units'][name]}]" for name in about["units"]
               if any(column["name"] == name and column["role"] == "signal" for column in found["columns"])]
    answer.say(f"{place}: simulated cuts of {about['name']} at {about['sampling_rate']:g} Hz, seed {about['seed']}, "
               f"{about['engine']} engine; content of the data set {about['source_content_hash'][:16]}")
    answer.say("signals: " + ", ".join(signals))
    if found["kind"] == "exported_shard":
        rows = "windows" if "window" in about else "runs"
        answer.say(f"one file of the split {found['split']}: {found['runs']} {rows}, {len(found['columns'])} columns")
    else:
        _say(answer, place, found)
        answer.say(f"licence: {found['licence']}; every file has the hash that was written with it")
    answer.finish(plain(found))
