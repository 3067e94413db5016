"""`testbed export`: a data set as a training set, Parquet with a card, that other programs open."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from typing import Any

import click

from testbed.api.result import plain
from testbed.cli._answer import Answer, progress
from testbed.cli._options import catalogue_of, effects_option, shared
from testbed.problem import InputProblem

LICENCES = {"CC-BY-4.0": "https://creativecommons.org/licenses/by/4.0/", "CC0-1.0":
            "https://creativecommons.org/publicdomain/zero/1.0/", "MIT": "https://opensource.org/license/mit"}
MOST_LABELS = 4096  # machines and conditions whose multipliers are remembered


@click.command(short_help="A training set for others: Parquet with a card, splits, labels and baseline scores.",
               epilog="Example: testbed export sweep.h5 -o training_set")
@click.argument("data", metavar="DATA.h5")
@click.option("-o", "--output", required=True, metavar="FOLDER", help="The folder to write; it must not exist yet.")
@click.option("--split", "split_text", default="70,15,15", show_default=True, metavar="A,B,C",
              help="Shares of train, validation and test, by operating condition.")
@click.option("--licence", type=click.Choice(list(LICENCES)), default="CC-BY-4.0", show_default=True,
              help="Under which you give it away.")
@click.option("--description", default="", metavar="TEXT", help="What the card says first; by default the scenario's.")
@effects_option
@shared
def command(data: str, output: str, split_text: str, licence: str, description: str, folders: tuple[str, ...],
            json_file: str | None, seed: int | None, quiet: bool) -> None:
    """Write DATA.h5 as Parquet files with a dataset card, a Croissant description and a datasheet.

    Splits hold whole operating conditions, chosen by a hash of the condition, so that they stay when runs are added; --seed
    gives another division. The card holds the scores of two simple methods on the conditions held out.
    """
    from testbed.export.writing import new_folder, plan, write_shards
    from testbed.store.data_set import read_data_set

    answer = Answer(json_file, quiet)
    shares = _shares(split_text)
    _require_pyarrow()
    catalogue = catalogue_of(folders)
    source = read_data_set(data)
    planned = plan(source, catalogue, shares, seed or 0)
    notes = _Notes(source, planned, catalogue)
    with new_folder(output) as folder:
        with progress("exporting", quiet) as show:
            written = write_shards(source, folder, planned, notes.of_run, show)
        content = _documents(folder, source, planned, written, notes,
                             {"licence": licence, "licence_url": LICENCES[licence], "description": description})
    _say(answer, output, content)
    answer.finish(plain({"folder": output, **{key: content[key] for key in (
        "runs", "splits", "shards", "classes", "behaviours", "contact_losses", "contact_unknown", "outcomes", "baseline")}}))


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


class _Notes:
    """Labels of every run, and what is gathered along the way: counts, and features for the baseline."""

    def __init__(self, source: Any, planned: Any, catalogue: Any) -> None:
        self.source, self.planned, self.catalogue = source, planned, catalogue
        self.model = source.true_model(catalogue)
        self.paths = [path for path in source.truth if path != "mark_angle"]
        self.classes: dict[str, Counter[str]] = {}
        self.contact_losses: Counter[str] = Counter()
        self.contact_unknown: Counter[str] = Counter()  # runs whose records do not tell: neither with nor without
        self.behaviours: dict[str, Counter[str]] = {}
        self.known: dict[Any, Any] = {}
        self.features: list[Any] = []
        self.rows: list[int] = []
        self.stability: list[str | None] = []
        self.modulus: list[float] = []
        from testbed.analysis.multipliers.baseline_scores import MOST_TRAINED

        self.every = max(1, -(-len(source) // (2 * MOST_TRAINED)))  # of many runs the baseline sees an even share

    def of_run(self, index: int, recording: Any) -> Mapping[str, Any]:
        """The label columns of a run."""
        from testbed.analysis.multipliers.baseline_scores import features
        from testbed.analysis.multipliers.run_labels import labels

        model = self._model(index)
        linear = self._linear(model, index)
        noise = {name: float(values[index]) for name, values in self.source.noise.items()}
        found = labels(recording, linear, model, noise)
        split = self.planned.split[index]
        self.classes.setdefault(split, Counter())[found["stability"] or "none"] += 1
        self.contact_losses[split] += bool(found["contact_loss"])
        self.contact_unknown[split] += found["contact_loss"] is None
        self.behaviours.setdefault(split, Counter())[found["behaviour"]] += 1
        if index % self.every == 0:
            self.rows.append(index)
            self.features.append(features(recording))
            self.stability.append(linear.stability)
            self.modulus.append(float("nan") if linear.modulus is None else linear.modulus)
        return found

    def _model(self, index: int) -> Any:
        """The machine of one run: the data set's, with the run's own true values; a neutral effect is left out."""
        values = {path: float(self.source.truth[path][index]) for path in self.paths}
        model = self.model
        for effect in list(model.effects):
            own = [(value, path.partition(".")[2]) for path, value in values.items() if path.startswith(f"{effect}.")]
            if own and all(value == self.catalogue[effect].parameter(name).neutral for value, name in own):
                model = model.without_effect(effect)
        here = {path: value for path, value in values.items() if "." not in path or path.partition(".")[0] in model.effects
                or path in model.base_parameters}
        return model if all(model.value(path) == value for path, value in here.items()) else model.with_values(here)

    def _linear(self, model: Any, index: int) -> Any:
        from testbed.analysis.multipliers.run_labels import NO_CLASS, class_of_linear, linear_class
        from testbed.api.multipliers import of_cut as multipliers
        from testbed.cut import Cut

        given = self.source.conditions
        speed, depth, feed = (float(given[name][index]) for name in ("spindle_speed", "axial_depth_of_cut", "feed_per_tooth"))
        cut = Cut(speed, depth, feed)
        if set(model.effects) == {"contact_loss"}:  # a periodic motion of even teeth never leaves the work
            model = model.without_effect("contact_loss")
        if (model, cut) not in self.known:
            if len(self.known) >= MOST_LABELS:
                self.known.clear()
            try:
                if not model.effects:
                    self.known[model, cut] = class_of_linear(model, cut)
                    return self.known[model, cut]
                found = multipliers(model, cut, self.catalogue, "label")
                self.known[model, cut] = linear_class(found["multipliers"], found["period_passes"])
            except InputProblem:
                self.known[model, cut] = NO_CLASS
        return self.known[model, cut]

    def baseline(self) -> dict[str, Any]:
        """The two simple methods, trained and scored."""
        import numpy as np

        from testbed.analysis.multipliers.baseline_scores import as_json, baseline
        from testbed.export.schema import truth_column

        rows = np.array(self.rows)
        parameters = {truth_column(path): self.source.truth[path][rows] for path in self.paths}
        parameters["largest_multiplier_modulus"] = np.array(self.modulus)
        return as_json(baseline(np.array(self.features), [self.planned.split[row] for row in rows],
                                [self.planned.group[row] for row in rows], self.stability, parameters))


def _documents(folder: Any, source: Any, planned: Any, written: Any, notes: _Notes, said: dict[str, str]) -> dict[str, Any]:
    """Everything beside the shards; returns the content of `export.json`."""
    import json

    from testbed.export.card import card
    from testbed.export.croissant import croissant
    from testbed.export.datasheet import datasheet
    from testbed.export.writing import write_manifest

    description = said["description"] or f"Simulated milling cuts of the scenario {source.name}, with every run's truth."
    content = write_manifest(folder, planned, written, {
        **said, "description": " ".join(description.split()), "runs": len(source), "classes": notes.classes,
        "behaviours": notes.behaviours, "contact_losses": notes.contact_losses, "contact_unknown": notes.contact_unknown,
        "outcomes": Counter(source.outcome.tolist()), "baseline": notes.baseline()})
    (folder / "README.md").write_text(card(content, planned.columns), encoding="utf-8")
    (folder / "DATASHEET.md").write_text(datasheet(content, source.scenario_text, source.model_text), encoding="utf-8")
    (folder / "croissant.json").write_text(json.dumps(croissant(content, planned.columns), indent=2) + "\n", encoding="utf-8")
    return content


def _say(answer: Answer, output: str, content: Mapping[str, Any]) -> None:
    from testbed.export.card import contact_counts

    size = sum(one["bytes"] for one in content["shards"].values())
    answer.say(f"{output}: {content['runs']} runs, {len(content['shards'])} Parquet files, {size / 1e6:.1f} MB")
    classes = sorted({name for counts in content["classes"].values() for name in counts})
    answer.table(("split", "conditions", "runs", *classes, "contact loss", "not known"), [
        (name, one["groups"], one["runs"], *(content["classes"].get(name, {}).get(each, 0) for each in classes),
         *contact_counts(content, name)) for name, one in content["splits"].items()])
    scores = content["baseline"]
    for one in scores["classifier"]:
        if one["split"] == "test":
            answer.say(f"baseline on {one['groups']} conditions held out: accuracy {one['accuracy']:.3f} (naive "
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
        answer.say(f"one file of the split {found['split']}: {found['runs']} runs, {len(found['columns'])} columns")
    else:
        _say(answer, place, found)
        answer.say(f"licence: {found['licence']}; every file has the hash that was written with it")
    answer.finish(plain(found))
