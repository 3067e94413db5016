"""`testbed export`: a data set as a training set, Parquet with a card, that other programs open."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import click

from testbed.api.export import LICENCES, SHORTEST_WINDOW, SPLIT_BY, SplitBy
from testbed.api.result import plain
from testbed.cli._answer import Answer
from testbed.cli._options import RATE, effects_option, shared


@click.command(short_help="A training set for others: Parquet with a card, splits, labels and baseline scores.",
               epilog="Example: testbed export sweep.h5 -o training_set")
@click.argument("data", metavar="DATA.h5")
@click.option("-o", "--output", required=True, metavar="FOLDER", help="The folder to write; it must not exist yet.")
@click.option("--window", type=click.IntRange(SHORTEST_WINDOW), metavar="SAMPLES",
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
def command(data: str, output: str, window: int | None, step: int | None, rate: float | None, split_text: str,
            split_by: SplitBy, licence: str, description: str, folders: tuple[str, ...], json_file: str | None,
            seed: int | None, quiet: bool) -> None:
    """Write DATA.h5 as Parquet files with a dataset card, a Croissant description and a datasheet.

    Splits hold whole operating conditions (or machines), chosen by a hash of these, so that they stay when runs are added;
    --seed gives another division. With --window a row is a window of a run, labelled stable, neimark_sacker, flip, no_cut or
    unknown, with a chatter flag. The card holds the scores of simple methods on what is held out.
    """
    from testbed.api.export import export

    if step is not None and window is None:
        raise click.UsageError("--step goes with --window")
    answer, shares = Answer(json_file, quiet), _shares(split_text)
    found = export(data, output, window=window, step=step, rate=rate, shares=shares, split_by=split_by, licence=licence,
                   description=description, seed=seed or 0, effects=folders, progress=answer.watch)
    _say(answer, output, found.content)
    answer.finish(found.to_dict())


def _shares(text: str) -> tuple[float, ...]:
    from testbed.api.export import checked_shares

    try:
        return checked_shares([float(part) for part in text.split(",")])
    except ValueError:
        raise click.UsageError(f"--split '{text}': give three numbers, the first above 0, such as 70,15,15") from None


def _say(answer: Answer, output: str, content: Mapping[str, Any]) -> None:
    from testbed.exports.card import GROUPS, contact_counts

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
    from testbed.exports.reading import describe

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
