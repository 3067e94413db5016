"""The dataset card: README.md with the YAML head that the hub's loaders read, columns, splits and baseline scores."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

from testbed.exports.schema import Column

_HEAD = """---
pretty_name: {title}
license: {licence}
language: en
tags: [milling, chatter, vibration, delay-differential-equation, system-identification, synthetic]
task_categories: [tabular-classification, tabular-regression]
size_categories: ["{size}"]
configs:
- config_name: default
  default: true
  data_files:
{files}
---
"""
_SIZES = ((1_000, "n<1K"), (10_000, "1K<n<10K"), (100_000, "10K<n<100K"), (1_000_000, "100K<n<1M"), (math.inf, "1M<n<10M"))
GROUPS = {"condition": "conditions", "machine": "machines"}  # by what the set was divided
_ROLES = {"condition": "What a machinist knows", "signal": "What the sensors gave", "label": "Labels",
          "truth": "True parameters of the simulated machine", "simulation": "How the run was made"}


def table(titles: Sequence[str], rows: Sequence[Sequence[object]]) -> str:
    """A Markdown table."""
    lines = [titles, ["---"] * len(titles), *rows]
    return "\n".join("| " + " | ".join(str(cell).replace("|", "\\|") for cell in line) + " |" for line in lines)


def card(content: Mapping[str, Any], listed: Sequence[Column]) -> str:
    """README.md from the content of `export.json`."""
    about, splits, windows = content["about"], content["splits"], content["about"].get("window")
    rows = sum(one["rows"] for one in splits.values())
    files = "\n".join(f"  - split: {name}\n    path: data/{name}-*.parquet" for name, one in splits.items() if one["rows"])
    head = _HEAD.format(title=_quoted(about["name"]), licence=content["licence"].lower(), files=files,
                        size=next(name for most, name in _SIZES if rows < most))
    noun = "windows" if windows else "runs"
    shares = ", ".join(f"{one['rows']} in {name}" for name, one in splits.items())
    of_runs = f" of {content['runs']} runs" if windows else ""
    parts = [head + f"# {about['name']}: simulated milling, for training", content["description"],
             f"{rows} {noun}{of_runs}, {shares}. Sampling rate "
             f"{about['sampling_rate']:g} Hz. Every number is SI. Read DATASHEET.md before you train on it."]
    if windows:
        parts.append(_WINDOWS.format(**windows))
    parts += [_LOAD.replace("runs", noun), "## Splits", _SPLITS[about["split_by"]], _split_table(content), "## Labels",
              table(("label", *splits), [(name, *(content["labels"].get(split, {}).get(name, 0) for split in splits))
                                         for name in _named(content["labels"])]),
              "## Columns", _COLUMNS]
    for role, title in _ROLES.items():
        parts += [f"### {title}", table(("column", "type", "unit", "meaning"), [
            (f"`{each.name}`", each.kind, each.unit, each.meaning) for each in listed if each.role == role])]
    parts += ["## Baseline", *_baseline(content, {each.name: each.unit for each in listed})]
    return "\n\n".join(parts) + "\n"


_LOAD = """```python
from datasets import load_dataset
runs = load_dataset("PATH/OF/THIS/FOLDER")["train"]     # no network needed
import pandas
runs = pandas.read_parquet("PATH/OF/THIS/FOLDER/data")  # all splits
```"""
_WINDOWS = """A row is a window of {length} samples; the next one of its run starts {step} samples later. `label` and
`chatter` are the window's own: before the first tooth enters and after the last one leaves, nothing cuts, so there is no
chatter, however the structure rings; across entry and exit the label is unknown. An unknown `chatter` is null, never
false: leave such windows out. Early in an unstable cut the chatter is still small: `passes_in_cut` and
`largest_multiplier_modulus` tell how long it has grown and how fast."""
_ALIKE = """
a larger set made the same way leaves every run where it was. Neighbouring conditions of a dense grid are alike: a score on the
test split says how a method does between conditions that it knows, not beyond them."""
_SPLITS = {
    "condition": f"""A split holds whole operating conditions (spindle speed, depth, feed, number of teeth), never some of the
runs of one. Which split a condition falls into is fixed by a hash of the condition:{_ALIKE}
A machine may lie in several splits.""",
    "machine": f"""A split holds whole machines, each told by all its true parameters, never some of the runs of one. Which
split a machine falls into is fixed by a hash of these:{_ALIKE}
A condition may lie in several splits: the machines of the test split are strangers, their conditions need not be."""}
_COLUMNS = "Conditions and signals are fit to be inputs. Labels, truth and simulation columns are not known of a real cut."


def _quoted(text: str) -> str:
    return '"' + " ".join(text.split()).replace("\\", "").replace('"', "'") + '"'


def contact_counts(content: Mapping[str, Any], split: str) -> tuple[object, int]:
    """(runs of a split in which a tooth left the work, runs that do not tell); `-` for the first where none tells."""
    unknown = int(content.get("contact_unknown", {}).get(split, 0))
    runs = content["splits"][split]["runs"]
    return "-" if runs and unknown == runs else content["contact_losses"].get(split, 0), unknown


def _named(counts: Mapping[str, Mapping[str, int]]) -> list[str]:
    """The names that are counted in any split."""
    return sorted({name for inside in counts.values() for name in inside})


def _split_table(content: Mapping[str, Any]) -> str:
    classes = _named(content["classes"])
    rows = [(name, one["groups"], one["runs"], *(content["classes"].get(name, {}).get(each, 0) for each in classes),
             *contact_counts(content, name)) for name, one in content["splits"].items()]
    return table(("split", GROUPS[content["about"]["split_by"]], "runs", *classes, "with contact loss",
                  "contact loss not known"), rows)


def _baseline(content: Mapping[str, Any], units: Mapping[str, str]) -> list[str]:
    scores, about = content["baseline"], content["about"]
    windows, groups = "window" in about, GROUPS[about["split_by"]]
    if windows:
        said = (f"A simple method on {len(scores['features'])} features of each window (level, its growth, shares of the "
                "spectrum at and off the tooth harmonics, the conditions) and their squares, on windows that are known to "
                "chatter or not")
    else:
        said = (f"Two simple methods on {len(scores['features'])} features of each run (once-per-tooth samples, their delay "
                "embedding, the spectrum, the free decay, the conditions) and their squares")
    parts = [f"{said}, trained on {scores['trained_on_rows']} {'windows' if windows else 'runs'} of the train split, the "
             "penalty chosen on validation. Naive: always the commonest class, or the mean, of the train split."]
    if scores["classifier"]:
        parts += [f"**{'Chatter' if windows else 'Stability class'}**, by softmax regression", table(
            ("split", groups, "windows" if windows else "runs", "accuracy", "naive", "mean recall", "naive"),
            [(one["split"], one["groups"], one["rows"], *(f"{one[key]:.3f}" for key in (
                "accuracy", "naive_accuracy", "recall", "naive_recall"))) for one in scores["classifier"]])]
    if scores["regressor"]:
        parts += ["**Parameters**, by ridge regression", table(
            ("parameter", "unit", "split", "runs", "rms error", "naive", "variance explained"),
            [(one["parameter"], units.get(one["parameter"], "1"), one["split"], one["rows"], f"{one['rms']:.3g}",
              f"{one['naive_rms']:.3g}", "-" if one["explained"] is None else f"{one['explained']:.2f}")
             for one in scores["regressor"]])]
    return parts + [f"Note: {note}." for note in scores["notes"]]
