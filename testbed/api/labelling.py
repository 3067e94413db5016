"""The work behind `testbed.export`: the labels of every run, and what is gathered on the way for counts and baseline scores."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from typing import Any

from testbed.api.believed import in_the_work
from testbed.problem import InputProblem

MOST_LABELS = 4096  # machines and conditions whose multipliers are remembered


class Notes:
    """Labels of every run, and what is gathered along the way: counts, and features for the baseline."""

    def __init__(self, source: Any, planned: Any, catalogue: Any) -> None:
        from testbed.analysis.multipliers.baseline_scores import MOST_TRAINED

        self.source, self.planned, self.catalogue = source, planned, catalogue
        self.model = source.true_model(catalogue)
        self.paths = [path for path in source.truth if path != "mark_angle"]
        self.classes: dict[str, Counter[str]] = {}
        self.labels: dict[str, Counter[str]] = {}
        self.contact_losses: Counter[str] = Counter()
        self.contact_unknown: Counter[str] = Counter()  # runs whose records do not tell: neither with nor without
        self.behaviours: dict[str, Counter[str]] = {}
        self.known: dict[Any, Any] = {}
        self.features: list[Any] = []
        self.rows: list[int] = []  # the run of each
        self.stability: list[str | None] = []
        self.modulus: list[float] = []
        self.met = 0
        self.every = max(1, -(-self._most() // (2 * MOST_TRAINED)))  # of many rows the baseline sees an even share

    def _most(self) -> int:
        from testbed.exports.writing import longest

        windows = self.planned.order.windows
        samples = longest(self.source, self.planned.about["sampling_rate"])
        return len(self.source) * (windows.most(samples) if windows else 1)

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
        if self.planned.order.windows is None and index % self.every == 0:
            self._remember(index, features(recording), linear.stability)
            self.modulus.append(float("nan") if linear.modulus is None else linear.modulus)
        return found

    def of_row(self, index: int, row: Mapping[str, Any]) -> None:
        """Count a row of run `index` and, of a window, look at its samples."""
        self.labels.setdefault(self.planned.split[index], Counter())[row["label"]] += 1
        if self.planned.order.windows is None:
            return
        if self.met % self.every == 0 and row["chatter"] is not None:
            from testbed.analysis.multipliers.window_features import window_features
            from testbed.analysis.records.segments import main_channel_of

            channel = row[main_channel_of(self.source.channels)]
            self._remember(index, window_features(channel, row["sampling_rate"], row["spindle_speed"],
                                                  row["axial_depth_of_cut"], row["feed_per_tooth"], row["flutes"]),
                           "chatter" if row["chatter"] else "no chatter")
        self.met += 1

    def _remember(self, index: int, features: Any, name: str | None) -> None:
        self.rows.append(index)
        self.features.append(features)
        self.stability.append(name)

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
        model = in_the_work(model)[0]
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
        """The simple methods, trained and scored: of runs class and parameters, of windows chatter or not."""
        import numpy as np

        from testbed.analysis.multipliers import baseline_scores, window_features
        from testbed.exports.schema import truth_column

        runs = self.planned.order.windows is None
        names: tuple[str, ...] = baseline_scores.FEATURES if runs else window_features.FEATURES
        parameters = {}
        if runs:
            rows = np.array(self.rows)
            parameters = {truth_column(path): self.source.truth[path][rows] for path in self.paths}
            parameters["largest_multiplier_modulus"] = np.array(self.modulus)
        values = np.array(self.features).reshape(-1, len(names))
        return baseline_scores.as_json(baseline_scores.baseline(
            values, [self.planned.split[row] for row in self.rows], [self.planned.group[row] for row in self.rows],
            self.stability, parameters), names)
