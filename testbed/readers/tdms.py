"""TDMS files of LabVIEW and DIAdem, by npTDMS (extra `formats`)."""

from __future__ import annotations

import logging
from pathlib import Path
from typing import Any

import numpy as np

from testbed.problem import InputProblem
from testbed.readers.table import FORMATS_EXTRA, Table, listed, simplest_between, unique_names

UNIT_NAMES = ("unit_string", "NI_UnitDescription", "unit", "Unit", "units")


def read_tdms(path: Path, *, key: str | None = None) -> Table:
    """Channels by their names (`group/channel` where a name occurs twice); `key` picks one group.

    Raises InputProblem; a file that was cut off is read as far as it goes, with a note.
    """
    try:
        from nptdms import TdmsFile
        from nptdms.log import log_manager
    except ImportError:
        raise InputProblem(path, "TDMS needs the package npTDMS", FORMATS_EXTRA) from None
    notes: list[str] = []
    log_manager.set_level(logging.CRITICAL)  # what it would print of a damaged file, file_status says as well
    found, others, groups, status = _contents(path, TdmsFile, key)
    if not found:
        raise InputProblem(
            path,
            f"no samples in group '{key}'" if key else "no numeric channel with samples",
            f"groups: {listed(groups, '')}",
        )
    if status.incomplete_final_segment:
        notes.append("the file's last segment is incomplete: it was cut off while being written")
    plain = [name for _, name, _, _ in found]
    labels = [name if plain.count(name) == 1 else f"{group}/{name}" for group, name, _, _ in found]
    names = unique_names(labels, notes)
    columns = {name: values for name, (_, _, values, _) in zip(names, found, strict=True)}
    units = {name: _unit(properties) for name, (_, _, _, properties) in zip(names, found, strict=True)}
    return Table(
        path, columns, units, _rate(path, [properties for *_, properties in found]), 1e-9, tuple(notes), unread=others
    )


def _unit(properties: dict[str, Any]) -> str:
    """The unit that a channel's properties state, as LabVIEW, DAQmx or DIAdem name it; "" without."""
    return next((str(properties[name]).strip() for name in UNIT_NAMES if str(properties.get(name, "")).strip()), "")


def _contents(
    path: Path, reader: Any, key: str | None
) -> tuple[list[tuple[str, str, np.ndarray, dict]], dict[str, str], list[str], Any]:
    """(group, channel, values, properties) of every numeric channel, why each other one is none, the groups' names and the
    file's status."""
    try:
        content = reader.read(path)
        status = content.file_status
        found, others = [], {}
        for group in content.groups():
            if key and group.name != key:
                continue
            for channel in group.channels():
                numeric = channel.dtype is not None and np.dtype(channel.dtype).kind in "fiu"
                if not len(channel) or not numeric:
                    others[channel.name] = "is not numeric" if len(channel) else "is empty"
                else:
                    found.append(
                        (group.name, channel.name, np.asarray(channel[:], dtype=float), dict(channel.properties))
                    )
        groups = [group.name for group in content.groups()]
    except Exception as error:  # a damaged file raises anything
        raise InputProblem(
            path, f"not readable as TDMS ({type(error).__name__}: {str(error)[:80]})", "export it again"
        ) from None
    return found, others, groups, status


def _rate(path: Path, properties: list[dict]) -> float | None:
    """The sampling rate all channels agree on."""
    steps = {
        float(entry["wf_increment"]) for entry in properties if isinstance(entry.get("wf_increment"), (int, float))
    }
    steps = {step for step in steps if 0 < step < float("inf")}
    if len(steps) > 1:
        raise InputProblem(
            path,
            f"channels sampled at different rates ({listed((f'{1 / step:.6g} Hz' for step in sorted(steps)), '')})",
            "give `key` (one group), or export at one rate",
        )
    if not steps:
        return None
    rate = 1.0 / steps.pop()
    return simplest_between(rate * (1 - 1e-9), rate * (1 + 1e-9))
