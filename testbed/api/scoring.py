"""The work behind `testbed.score`: sealed campaigns, and workers that identify them.

A method is given recordings as sensors give them and a belief drawn about the truth; the truth itself stays here.
"""

from __future__ import annotations

import math
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

from testbed.api.methods import method_named
from testbed.problem import InputProblem
from testbed.recording import quantity_of

# of a belief about the truth: of frequencies, dampings and coefficients the logarithm
_FREQUENCY, _DAMPING, _COEFFICIENT, _DIRECTION_RAD = 0.015, math.log(2.5), math.log(2.0), math.radians(10.0)


@dataclass(frozen=True)
class Order:
    """What a worker needs to know: data set, whether noise is added, seed, folders of effects."""

    data: str
    add: bool
    seed: int
    folders: tuple[str, ...]


class Sealed:
    """A data set's campaigns by noise level, without the truth, and the truth beside them."""

    def __init__(self, order: Order) -> None:
        from testbed.catalogue import catalogue
        from testbed.store.data_set import read_data_set

        self.order, self.catalogue = order, catalogue(*order.folders)
        source = read_data_set(order.data)
        _one_machine(source)
        self.truth = source.true_model(self.catalogue)
        self.groups = _groups(source)

    @property
    def parameters(self) -> tuple[str, ...]:
        """Paths of what is scored: of a machine in x and y all that its records may tell, of another what all methods find."""
        from testbed.analysis.multipliers.score import PARAMETERS

        known = ("mass", "immersion")  # without a force only products with a mass are told
        return tuple(path for path in self.truth.base_parameters if path.split(".")[-1] not in known) \
            if self.truth.planar else PARAMETERS

    @property
    def displaced(self) -> bool:
        """Whether a channel is a displacement."""
        return any(quantity_of(name) == "displacement" for name in self.groups[self.quietest][0][0].recording.channels)

    @property
    def quietest(self) -> float:
        """The least noise (m) that the data have."""
        return min(self.groups)

    @property
    def tests(self) -> int:
        """Operating points that every campaign has."""
        return min(len(campaign) for campaigns in self.groups.values() for campaign in campaigns)

    def campaign(self, case: Any) -> list[Any]:
        """The records of a case. Which tests it has depends on the number of tests and the repeat alone."""
        import numpy as np

        seed = self.order.seed
        if self.order.add:
            quiet = self.groups[self.quietest]
            more = math.sqrt(max(0.0, case.noise**2 - self.quietest**2))
            random = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(round(case.noise * 1e12), case.number)))
            records = [_noisier(record, more, random) for record in quiet[case.number % len(quiet)]]
        else:
            records = self.groups[case.noise][case.number]
        if case.tests >= len(records):
            return records
        random = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(case.tests, case.number, 1)))
        return [records[place] for place in sorted(random.permutation(len(records))[:case.tests].tolist())]

    def belief(self, number: int) -> Any:
        """Where an identification starts: of every mode the frequency within 1.5 %, the damping within a factor of 2.5, in x
        and y the direction within 10 deg; both cutting coefficients within a factor of 2. Drawn for each repeat, so that no
        method can know the way back."""
        import numpy as np

        random = np.random.default_rng(np.random.SeedSequence(self.order.seed, spawn_key=(number, 2)))
        truth = self.truth
        values = {}

        def off(path: str, reach: float) -> None:
            values[path] = truth.value(path) * math.exp(reach * random.uniform(-1.0, 1.0))

        for place in range(len(truth.structure.modes)):
            off(truth.mode_path(place, "natural_frequency"), _FREQUENCY)
            damping = truth.mode_path(place, "damping_ratio")
            off(damping, _DAMPING)
            values[damping] = min(values[damping], 0.9)
            if truth.structure.planar:
                direction = truth.mode_path(place, "direction")
                values[direction] = truth.value(direction) + _DIRECTION_RAD * random.uniform(-1.0, 1.0)
        off("tangential_coefficient", _COEFFICIENT)
        ratio = values["tangential_coefficient"] / truth.value("tangential_coefficient")
        return truth.with_values(values | {"normal_coefficient": truth.value("normal_coefficient") * ratio})


def _one_machine(source: Any) -> None:
    for path, values in source.truth.items():
        if path != "mark_angle" and len(values) and not (values == values[0]).all():
            raise InputProblem(source.path, f"its machine differs from run to run ({path})",
                               "score a data set of one machine")


def _groups(source: Any) -> dict[float, list[list[Any]]]:
    """Noise level -> campaigns: each a record of every operating point, one campaign a repeat."""
    from testbed.api.records import records_of

    found: dict[float, dict[tuple[float, float], list[Any]]] = {}
    levels = next((rms for name, rms in source.noise.items() if quantity_of(name) == "displacement"), None)
    if levels is None and any(len(set(rms.tolist())) > 1 for rms in source.noise.values()):
        raise InputProblem(source.path, "has several levels of noise and no displacement",
                           "score a data set with a displacement, or with one level of noise")
    by_run = {} if levels is None else {f"run {run}": float(level)
                                        for run, level in zip(source.scenario_run, levels, strict=True)}
    for record in records_of(source):
        point = (record.conditions["spindle_speed"], record.conditions["axial_depth_of_cut"])
        found.setdefault(by_run.get(record.name, 0.0), {}).setdefault(point, []).append(record)
    places = {point for points in found.values() for point in points}
    if max(len(points) for points in found.values()) < len(places):
        raise InputProblem(source.path, "no level of noise was applied to all its tests",
                           "score a data set whose noise is one level, or a list of levels")
    groups = {}
    for level, points in found.items():
        count = min(len(records) for records in points.values())
        groups[level] = [[records[repeat] for records in points.values()] for repeat in range(count)]
    return groups


def _noisier(record: Any, noise: float, random: Any) -> Any:
    recording = record.recording
    channels = {name: values + noise * random.standard_normal(len(recording)) if quantity_of(name) == "displacement" else values
                for name, values in recording.channels.items()}
    return replace(record, recording=replace(recording, channels=channels))


def identified(sealed: Sealed, case: Any) -> Any:
    """The Outcome of one case. A ValueError or ArithmeticError of the method is a failure, told with its reason."""
    from testbed.analysis.multipliers.score import Outcome

    records, belief, method = sealed.campaign(case), sealed.belief(case.number), method_named(case.method)
    begin = time.process_time()
    try:
        answer = method(sealed, records, belief)
    except InputProblem as problem:
        if case.method.endswith(".py"):
            raise
        return Outcome(None, str(problem), time.process_time() - begin)
    except (ValueError, ArithmeticError) as problem:
        return Outcome(None, str(problem), time.process_time() - begin)
    spent = time.process_time() - begin
    found = {name: one if isinstance(one, tuple) else (one.value, one.low, one.high)
             for name, one in answer.items() if name in sealed.parameters}
    return Outcome(found, "", spent)


def study(sealed: Sealed, cases: Sequence[Any], workers: int) -> Iterator[Any]:
    """Outcomes of cases, in their order, whatever the number of workers."""
    if workers <= 1:
        yield from (identified(sealed, case) for case in cases)
        return
    from functools import partial

    from testbed.system.processes import WorkerDied, as_done_in_processes
    from testbed.system.threads import ordered

    try:
        yield from ordered(as_done_in_processes(_work, cases, workers, partial(_begin, sealed.order)))
    except WorkerDied:
        raise InputProblem(sealed.order.data, "a worker died while identifying", "try --workers 1") from None


_own: list[Sealed] = []  # of a worker's process


def _begin(order: Order) -> None:
    _own[:] = [Sealed(order)]


def _work(case: Any) -> Any:
    return identified(_own[0], case)
