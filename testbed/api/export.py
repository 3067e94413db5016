"""A data set as a training set: Parquet with a card, splits, labels and baseline scores."""

from __future__ import annotations

import json
import os
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, TypeAlias

from testbed.api.believed import EffectsLike, File, effects_of
from testbed.api.inspect import sampling_rate
from testbed.api.quantity import Quantity
from testbed.api.result import Result, Table, plain
from testbed.api.watch import Progress
from testbed.api.working import working
from testbed.problem import InputProblem

if TYPE_CHECKING:
    from testbed.store.data_set import DataSet

LICENCES = {"CC-BY-4.0": "https://creativecommons.org/licenses/by/4.0/", "CC0-1.0":
            "https://creativecommons.org/publicdomain/zero/1.0/", "MIT": "https://opensource.org/license/mit"}
SPLIT_BY = ("condition", "machine")
SHARES = (70.0, 15.0, 15.0)
SHORTEST_WINDOW = 8  # samples
SplitBy: TypeAlias = Literal["condition", "machine"]
_SAID = ("runs", "splits", "shards", "classes", "labels", "behaviours", "contact_losses", "contact_unknown", "outcomes",
         "baseline")


@dataclass(frozen=True, repr=False, eq=False)
class TrainingSet(Result):
    """A training set that was written. folder: where. content: what its `export.json` says of it."""

    folder: Path
    content: Mapping[str, Any]
    notes: tuple[str, ...] = ()

    @property
    def splits(self) -> Mapping[str, Mapping[str, int]]:
        """Of train, validation and test: rows, runs, and groups that are held together."""
        return self.content["splits"]  # type: ignore[no-any-return]

    @property
    def baseline(self) -> Mapping[str, Any]:
        """Scores of two simple methods on what is held out, beside the naive answers'."""
        return self.content["baseline"]  # type: ignore[no-any-return]

    def _answer(self) -> Mapping[str, Any]:
        return {"folder": os.fspath(self.folder), **{key: self.content[key] for key in _SAID}}

    def _table(self) -> Table:
        found = self.splits
        keys = dict.fromkeys(key for one in found.values() for key in one)
        return Table("split", {"split": list(found), **{key: [one.get(key, 0) for one in found.values()] for key in keys}}, {})

    def _headline(self) -> str:
        return f"{self.folder}, {self.content['runs']} runs in {len(self.content['shards'])} Parquet files"


def export(data: File | DataSet, folder: File, *, window: int | None = None, step: int | None = None,
           rate: Quantity | None = None, shares: Sequence[float] = SHARES, split_by: SplitBy = "condition",
           licence: str = "CC-BY-4.0", description: str = "", seed: int = 0, effects: EffectsLike = (),
           progress: Progress = None) -> TrainingSet:
    """Write a data set as Parquet files with a dataset card, a Croissant description and a datasheet: `testbed export`.

    data: a data set, or testbed.load of one. folder: to write; it must not exist yet. window: rows are windows of so many
    samples with a label each, a new one every `step` samples; by default a row is a run. rate: a lower sampling rate, "10 kHz"
    or Hz; signals are filtered. shares: of train, validation and test. split_by: what lies in one split as a whole. licence:
    CC-BY-4.0, CC0-1.0 or MIT. description: what the card says first. seed: of the division. effects: folders of one's own
    effects. progress: a function of (title, done, all), or False. Raises InputProblem.
    """
    from testbed.exports.windows import Windowing
    from testbed.exports.writing import Order, new_folder, plan, write_shards
    from testbed.store.data_set import DataSet, read_data_set

    if step is not None and window is None:
        raise InputProblem("step", "goes with a window", "give both, or neither")
    for name, number, least in (("window", window, SHORTEST_WINDOW), ("step", step, 1)):
        if number is not None and number < least:
            raise InputProblem(name, f"{number} is below {least}", f"give {least} or more")
    for name, given, known in (("licence", licence, tuple(LICENCES)), ("split_by", split_by, SPLIT_BY)):
        if given not in known:
            raise InputProblem(name, f"there is no '{given}'", f"give {', '.join(known)}")
    _require_pyarrow()
    with working(progress) as watch:
        windows = None if window is None else Windowing(window, step or window)
        order = Order(checked_shares(shares), seed, split_by, windows, None if rate is None else sampling_rate(rate, "rate"))
        catalogue = effects_of(effects).known
        source = data if isinstance(data, DataSet) else read_data_set(Path(data))
        planned = plan(source, catalogue, order)
        from testbed.api.labelling import Notes

        notes = Notes(source, planned, catalogue)
        with new_folder(Path(folder)) as place:
            with watch.counted("exporting") as show:
                written = write_shards(source, place, planned, notes.of_run, show, notes.of_row)
            content = _documents(place, source, planned, written, notes,
                                 {"licence": licence, "licence_url": LICENCES[licence], "description": description})
        return TrainingSet(Path(folder), plain(content))


def checked_shares(shares: Sequence[float]) -> tuple[float, ...]:
    """Three shares, the first above 0. InputProblem where they are none."""
    found = tuple(float(share) for share in shares)
    if len(found) != 3 or not all(0 <= share < 1e6 for share in found) or found[0] <= 0:
        said = ", ".join(f"{share:g}" for share in found)
        raise InputProblem("shares", f"'{said}' are no shares", "give three numbers, the first above 0, such as 70, 15, 15")
    return found


def _require_pyarrow() -> None:
    from importlib.util import find_spec

    if find_spec("pyarrow") is None:
        raise InputProblem("testbed export", "needs pyarrow to write Parquet", "pip install 'machining-testbed[formats]'")


def _documents(folder: Path, source: Any, planned: Any, written: Any, notes: Any, said: dict[str, str]) -> dict[str, Any]:
    """Everything beside the shards; returns the content of `export.json`."""
    from testbed.exports.card import card
    from testbed.exports.croissant import croissant
    from testbed.exports.datasheet import datasheet
    from testbed.exports.writing import write_manifest

    description = said["description"] or f"Simulated milling cuts of the scenario {source.name}, with every run's truth."
    content = write_manifest(folder, planned, written, {
        **said, "description": " ".join(description.split()), "runs": len(source), "classes": notes.classes,
        "labels": notes.labels, "behaviours": notes.behaviours, "contact_losses": notes.contact_losses,
        "contact_unknown": notes.contact_unknown, "outcomes": Counter(source.outcome.tolist()), "baseline": notes.baseline()})
    (folder / "README.md").write_text(card(content, planned.columns), encoding="utf-8")
    (folder / "DATASHEET.md").write_text(datasheet(content, source.scenario_text, source.model_text), encoding="utf-8")
    (folder / "croissant.json").write_text(json.dumps(croissant(content, planned.columns), indent=2) + "\n", encoding="utf-8")
    return dict(content)
