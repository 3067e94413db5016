"""The work behind `testbed score`: sealed campaigns, the methods by name, and workers that identify them.

A method is given recordings as sensors give them and a belief drawn about the truth; the truth itself stays here.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from testbed.problem import InputProblem
from testbed.system.interruption import deaf, deaf_from_birth

METHODS = ("multipliers", "published", "waveform")
_BELIEF = {"natural_frequency": 0.015, "damping_ratio": math.log(2.5), "tangential_coefficient": math.log(2.0)}


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
        from testbed.api.believed import refuse_planar
        from testbed.cli._options import catalogue_of
        from testbed.store.data_set import read_data_set

        self.order, self.catalogue = order, catalogue_of(order.folders)
        source = read_data_set(order.data)
        _one_machine(source)
        self.truth = source.true_model(self.catalogue)
        refuse_planar(self.truth, order.data)
        self.groups = _groups(source)

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
        """Where an identification starts: frequency within 1.5 %, damping within a factor of 2.5, both cutting
        coefficients within one of 2; drawn for each repeat, so that no method can know the way back."""
        import numpy as np

        random = np.random.default_rng(np.random.SeedSequence(self.order.seed, spawn_key=(number, 2)))
        frequency, damping, coefficient = (math.exp(reach * random.uniform(-1.0, 1.0)) for reach in _BELIEF.values())
        truth = self.truth
        return truth.with_values({
            "natural_frequency": truth.value("natural_frequency") * frequency,
            "damping_ratio": min(truth.value("damping_ratio") * damping, 0.9),
            "tangential_coefficient": truth.value("tangential_coefficient") * coefficient,
            "normal_coefficient": truth.value("normal_coefficient") * coefficient})


def _one_machine(source: Any) -> None:
    for path, values in source.truth.items():
        if path != "mark_angle" and len(values) and not (values == values[0]).all():
            raise InputProblem(source.path, f"its machine differs from run to run ({path})",
                               "score a data set of one machine")


def _groups(source: Any) -> dict[float, list[list[Any]]]:
    """Noise level -> campaigns: each a record of every operating point, one campaign a repeat."""
    from testbed.api.records import records_of

    found: dict[float, dict[tuple[float, float], list[Any]]] = {}
    by_run = {f"run {run}": float(level) for run, level in zip(source.scenario_run, source.noise["displacement"],
                                                               strict=True)} if "displacement" in source.noise else {}
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
    channels = dict(recording.channels)
    if "displacement" in channels:
        channels["displacement"] = channels["displacement"] + noise * random.standard_normal(len(recording))
    return replace(record, recording=replace(recording, channels=channels))


def method_named(name: str) -> Callable[[Sealed, Sequence[Any], Any], Mapping[str, Any]]:
    """The function of a method: (sealed, records, belief) -> parameter -> something with value, low, high."""
    if name.endswith(".py"):
        return _outsider(Path(name))
    return {"multipliers": _multipliers, "published": _published, "waveform": _waveform}[name]


def _multipliers(sealed: Sealed, records: Sequence[Any], belief: Any) -> Mapping[str, Any]:
    from testbed.api.identification import identify_by_multipliers

    # a belief has the true ratio of the coefficients
    return identify_by_multipliers(belief, records, sealed.order.data, 0, ratio_doubt=0.0).parameters


def _waveform(sealed: Sealed, records: Sequence[Any], belief: Any) -> Mapping[str, Any]:
    from testbed.api.identification import identify_by_waveform

    return identify_by_waveform(belief, records, sealed.order.data, sealed.catalogue, sealed.order.data).parameters


def _published(sealed: Sealed, records: Sequence[Any], belief: Any) -> Mapping[str, Any]:
    from testbed.analysis.multipliers.identify_as_published import identify_as_published
    from testbed.api.identification import cut_tests, start_from_ring_downs

    tests = cut_tests(records, belief.cutter.flutes, sealed.order.data)
    start = start_from_ring_downs(belief, records, tests)
    return identify_as_published(start, [(test.recording, test.cut) for test in tests])


def _outsider(path: Path) -> Callable[[Sealed, Sequence[Any], Any], Mapping[str, Any]]:
    """A user's `identify(recordings, belief)`. It gets copies, and a belief without the true machine's effects."""
    function = load_method(path)

    def method(sealed: Sealed, records: Sequence[Any], belief: Any) -> Mapping[str, Any]:
        recordings = [replace(one, marks=one.marks.copy(), conditions=dict(one.conditions),
                              channels={name: values.copy() for name, values in one.channels.items()})
                      for one in (record.recording for record in records)]
        try:
            answer = function(recordings, replace(belief, effects={}))
        except (ValueError, ArithmeticError):
            raise
        except Exception as fault:
            raise InputProblem(path, f"identify failed with {type(fault).__name__} ({fault})",
                               "raise a ValueError where the recordings do not suffice", _line_in(fault, path)) from fault
        return _checked(path, answer)

    return method


def load_method(path: Path) -> Callable[[Any, Any], Any]:
    """The function `identify` of a Python file. InputProblem where there is none."""
    import importlib.util

    if not path.is_file():
        raise InputProblem(path, "no such file", f"give a Python file, or one of {', '.join(METHODS)}")
    spec = importlib.util.spec_from_file_location(f"method_{path.stem}", path)
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    try:
        spec.loader.exec_module(module)
    except (Exception, SystemExit) as fault:
        line = fault.lineno if isinstance(fault, SyntaxError) else _line_in(fault, path)
        raise InputProblem(path, f"cannot be imported ({type(fault).__name__}: {fault})", "correct it", line) from None
    function = getattr(module, "identify", None)
    if not callable(function):
        raise InputProblem(path, "has no function `identify`", "define identify(recordings, belief)")
    return function


def _line_in(fault: BaseException, path: Path) -> int | None:
    """The last line of the user's own file on the way to a fault."""
    import traceback

    lines = [frame.lineno for frame in traceback.extract_tb(fault.__traceback__) if Path(frame.filename) == path.resolve()
             or frame.filename == str(path)]
    return lines[-1] if lines else None


def _checked(path: Path, answer: Any) -> Mapping[str, tuple[float, float, float]]:
    form = "return {name: (value, low, high)}, SI; low and high may be NaN"
    if not isinstance(answer, Mapping) or not answer:
        raise InputProblem(path, f"identify returned {type(answer).__name__}, not values by name", form)
    checked = {}
    for name, three in answer.items():
        try:
            value, low, high = (float(number) for number in three)
        except (TypeError, ValueError):
            raise InputProblem(path, f"identify returned no (value, low, high) for {name}", form) from None
        if not math.isfinite(value) or low > high:
            raise ValueError(f"{name}: {value:g} within {low:g} to {high:g}")
        checked[str(name)] = (value, low, high)
    from testbed.analysis.multipliers.score import PARAMETERS

    if not set(PARAMETERS) & set(checked):
        raise InputProblem(path, f"identify returned none of {', '.join(PARAMETERS)}", form)
    return checked


def identified(sealed: Sealed, case: Any) -> Any:
    """The Outcome of one case. A ValueError or ArithmeticError of the method is a failure, told with its reason."""
    from testbed.analysis.multipliers.score import PARAMETERS, Outcome

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
             for name, one in answer.items() if name in PARAMETERS}
    return Outcome(found, "", spent)


def study(sealed: Sealed, cases: Sequence[Any], workers: int) -> Iterator[Any]:
    """Outcomes of cases, in their order, whatever the number of workers."""
    if workers <= 1:
        yield from (identified(sealed, case) for case in cases)
        return
    import multiprocessing
    from concurrent.futures import ProcessPoolExecutor
    from concurrent.futures.process import BrokenProcessPool

    pool = ProcessPoolExecutor(workers, mp_context=multiprocessing.get_context("spawn"), initializer=_begin,
                               initargs=(sealed.order,))
    try:
        with deaf_from_birth():
            answers = pool.map(_work, cases)
        yield from answers
    except BrokenProcessPool:
        raise InputProblem(sealed.order.data, "a worker died while identifying", "try --workers 1") from None
    finally:
        for process in list((pool._processes or {}).values()):
            process.terminate()
        pool.shutdown(cancel_futures=True)


_own: list[Sealed] = []  # of a worker's process


def _begin(order: Order) -> None:
    deaf()
    _own[:] = [Sealed(order)]


def _work(case: Any) -> Any:
    return identified(_own[0], case)
