"""DATA of the commands that fit: a data set of `testbed run`, or a campaign.yaml, as records of one kind."""

from __future__ import annotations

import os
from dataclasses import replace
from pathlib import Path
from typing import Any

from testbed.api.believed import DataLike
from testbed.problem import InputProblem

KNOWN = ("spindle_speed", "axial_depth_of_cut", "feed_per_tooth", "flutes")  # what a machinist knows of a cut


def load_records(path: DataLike) -> tuple[Any, ...]:
    """The records of a data set or a campaign (testbed.files.campaign.Record), each blow by itself.

    InputProblem where the file, or the object, is neither.
    """
    from testbed.store.data_set import DataSet, is_data_set, read_data_set

    if not isinstance(path, (str, os.PathLike)):
        from testbed.analysis.records.ring_downs import separated
        from testbed.files.campaign import Campaign

        if isinstance(path, DataSet):
            return records_of(path)
        if isinstance(path, Campaign):
            return separated(path.records)
        raise InputProblem("data", f"a {type(path).__name__} holds no records",
                           "give a campaign.yaml or a data set, or what testbed.load makes of one")
    name = Path(path)
    if name.suffix.lower() in (".yaml", ".yml"):
        from testbed.analysis.records.ring_downs import separated
        from testbed.files.campaign import load_campaign

        return separated(load_campaign(name).records)
    if name.is_file() and not is_data_set(name) and name.suffix.lower() not in (".h5", ".hdf5"):
        raise InputProblem(path, "is no data set of `testbed run` and no campaign.yaml",
                           "write a campaign.yaml that names your files")
    return records_of(read_data_set(name))


def records_of(data: Any) -> tuple[Any, ...]:
    """The finished runs of a data set as records: what its sensors gave, nothing of the truth."""
    from testbed.files.campaign import Record
    from testbed.files.manifest import Feed

    records = []
    for recording in data:
        if recording.outcome != "ok":
            continue
        given = {key: recording.conditions[key] for key in KNOWN}
        seen = replace(recording, pass_times=recording.pass_times[:0], conditions=given | {"kind": "cut"})
        records.append(Record(f"run {recording.conditions['run']}", "cut", seen, given, file=data.path,
                              feed=Feed(given["feed_per_tooth"], "tooth")))
    if not records:
        raise InputProblem(data.path, "has no run that ended well", "simulate other cuts")
    return tuple(records)


def unfit(path: object, name: str, problem: Exception) -> InputProblem:
    """What is to be said of a record that cannot be fitted."""
    return InputProblem(path, f"record '{name}': {problem}", "look at it with testbed inspect, or take it out")
