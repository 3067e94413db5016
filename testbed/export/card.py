"""The dataset card: README.md with the YAML head that the hub's loaders read, columns, splits and baseline scores."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

from testbed.export.schema import Column

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
_ROLES = {"condition": "What a machinist knows", "signal": "What the sensors gave", "label": "Labels",
          "truth": "True parameters of the simulated machine", "simulation": "How the run was made"}


def table(titles: Sequence[str], rows: Sequence[Sequence[object]]) -> str:
    """A Markdown table."""
    lines = [titles, ["---"] * len(titles), *rows]
    return "\n".join("| " + " | ".join(str(cell).replace("|", "\\|") for cell in line) + " |" for line in lines)


def card(content: Mapping[str, Any], listed: Sequence[Column]) -> str:
    """README.md from the content of `export.json`."""
    about, splits, runs = content["about"], content["splits"], content["runs"]
    shares = ", ".join(f"{one['runs']} in {name}" for name, one in splits.items())
    files = "\n".join(f"  - split: {name}\n    path: data/{name}-*.parquet" for name, one in splits.items() if one["runs"])
    head = _HEAD.format(title=_quoted(about["name"]), licence=content["licence"].lower(), files=files,
                        size=next(name for most, name in _SIZES if runs < most))
    parts = [head + f"# {about['name']}: simulated milling, for training", content["description"],
             f"{runs} runs, {shares}. Sampling rate {about['sampling_rate']:g} Hz. Every number is SI. Read DATASHEET.md "
             "before you train on it.", _LOAD,
             "## Splits", _SPLITS, _split_table(content), "## Columns", _COLUMNS]
    for role, title in _ROLES.items():
        parts += [f"### {title}", table(("column", "type", "unit", "meaning"), [
            (f"`{each.name}`", each.kind, each.unit, each.meaning) for each in listed if each.role == role])]
    parts += ["## Baseline", *_baseline(content["baseline"], {each.name: each.unit for each in listed})]
    return "\n\n".join(parts) + "\n"


_LOAD = """```python
from datasets import load_dataset
runs = load_dataset("PATH/OF/THIS/FOLDER")["train"]     # no network needed
import pandas
runs = pandas.read_parquet("PATH/OF/THIS/FOLDER/data")  # all splits
```"""
_SPLITS = """A split holds whole operating conditions (spindle speed, depth, feed, number of teeth), never some of the runs of
one. Which split a condition falls into is fixed by a hash of the condition: a larger set made the same way leaves every
run where it was. Neighbouring conditions of a dense grid are alike: a score on the test split says how a
method does between conditions that it knows, not beyond them."""
_COLUMNS = "Conditions and signals are fit to be inputs. Labels, truth and simulation columns are not known of a real cut."


def _quoted(text: str) -> str:
    return '"' + " ".join(text.split()).replace("\\", "").replace('"', "'") + '"'


def contact_counts(content: Mapping[str, Any], split: str) -> tuple[object, int]:
    """(runs of a split in which a tooth left the work, runs that do not tell); `-` for the first where none tells."""
    unknown = int(content.get("contact_unknown", {}).get(split, 0))
    runs = content["splits"][split]["runs"]
    return "-" if runs and unknown == runs else content["contact_losses"].get(split, 0), unknown


def _split_table(content: Mapping[str, Any]) -> str:
    classes = sorted({name for counts in content["classes"].values() for name in counts})
    rows = [(name, one["groups"], one["runs"], *(content["classes"].get(name, {}).get(each, 0) for each in classes),
             *contact_counts(content, name)) for name, one in content["splits"].items()]
    return table(("split", "conditions", "runs", *classes, "with contact loss", "contact loss not known"), rows)


def _baseline(scores: Mapping[str, Any], units: Mapping[str, str]) -> list[str]:
    parts = [f"Two simple methods on {len(scores['features'])} features of each run (once-per-tooth samples, their delay "
             f"embedding, the spectrum, the free decay, the conditions) and their squares, trained on "
             f"{scores['trained_on_runs']} runs of the train split, their penalty chosen on validation. Naive: always the "
             "commonest class, or the mean, of the train split."]
    if scores["classifier"]:
        parts += ["**Stability class**, by softmax regression", table(
            ("split", "conditions", "runs", "accuracy", "naive", "mean recall", "naive"),
            [(one["split"], one["groups"], one["runs"], *(f"{one[key]:.3f}" for key in (
                "accuracy", "naive_accuracy", "recall", "naive_recall"))) for one in scores["classifier"]])]
    if scores["regressor"]:
        parts += ["**Parameters**, by ridge regression", table(
            ("parameter", "unit", "split", "runs", "rms error", "naive", "variance explained"),
            [(one["parameter"], units.get(one["parameter"], "1"), one["split"], one["runs"], f"{one['rms']:.3g}",
              f"{one['naive_rms']:.3g}", "-" if one["explained"] is None else f"{one['explained']:.2f}")
             for one in scores["regressor"]])]
    return parts + [f"Note: {note}." for note in scores["notes"]]
