"""Universal files, data set 58, by pyuff (extra `formats`): time histories and frequency responses."""

from __future__ import annotations

import contextlib
import io
import warnings
from pathlib import Path
from typing import Any

import numpy as np

from testbed.problem import InputProblem
from testbed.readers.table import FORMATS_EXTRA, Table, listed, simplest_between, unique_names

# The step is printed with six digits; the rate within that rounding that has the fewest digits was meant.
_ROUNDING = 5e-6
_OVER_FREQUENCY = {2: "an auto spectrum", 3: "a cross spectrum", 4: "a frequency response", 5: "a transmissibility",
                   6: "a coherence", 9: "a spectral density", 10: "an energy spectral density", 12: "a spectrum"}  # fmt: skip
_UNIT_OF_TYPE = {8: "m", 11: "m/s", 12: "m/s^2", 13: "N"}


def read_uff(path: Path) -> Table:
    """Time histories as columns; frequency responses as `frequency`, `NAME re`, `NAME im`.

    Units follow the data set's codes (SI in the standard). Raises InputProblem.
    """
    try:
        import pyuff
    except ImportError:
        raise InputProblem(path, "UFF needs the package pyuff", FORMATS_EXTRA) from None
    if b"    -1" not in path.read_bytes()[:4096]:
        raise InputProblem(path, "not a universal file (no data set opens with -1)", "check the format")
    try:
        with warnings.catch_warnings(), contextlib.redirect_stdout(io.StringIO()):
            warnings.simplefilter("ignore")
            content = pyuff.UFF(str(path))
            kinds = [int(kind) for kind in content.get_set_types()]
            wanted = [index for index, kind in enumerate(kinds) if kind == 58]
            sets: list[dict[str, Any]] = [content.read_sets(index) for index in wanted]
            return _table(path, sets, kinds)
    except InputProblem:
        raise
    except Exception as error:  # a damaged file raises anything
        raise InputProblem(
            path, f"not readable as UFF 58 ({type(error).__name__}: {str(error)[:80]})", "export it again"
        ) from None


def _table(path: Path, sets: list[dict[str, Any]], kinds: list[int]) -> Table:
    if not sets:
        there = listed(map(str, sorted(set(kinds))), "")
        raise InputProblem(path, "no data set 58 (functions)", f"it holds {len(kinds)} data sets of the kinds {there}")
    notes: list[str] = []
    names = unique_names([_name(entry, number) for number, entry in enumerate(sets, 1)], notes)
    columns: dict[str, np.ndarray] = {}
    units: dict[str, str] = {}
    spectra: dict[str, str] = {}
    directions: dict[str, tuple[int, int]] = {}
    steps = set()
    for name, entry in zip(names, sets, strict=True):
        data, axis = np.asarray(entry["data"]), np.asarray(entry["x"], dtype=float)
        stated = int(entry.get("num_pts", len(data)))
        if stated != len(data):
            raise InputProblem(
                path,
                f"data set '{name}' holds {len(data)} samples, its header says {stated}",
                "the file is damaged: export it again",
            )
        if np.iscomplexobj(data) or entry.get("abscissa_spec_data_type") == 18:
            columns.setdefault("frequency", axis)
            units["frequency"] = "Hz"
            columns[f"{name} re"], columns[f"{name} im"] = data.real.astype(float), data.imag.astype(float)
            what = _OVER_FREQUENCY.get(int(entry.get("func_type", 0) or 0), "a function of frequency")
            spectra |= dict.fromkeys((name, f"{name} re", f"{name} im", "frequency"), what)
            directions[name] = (int(entry.get("rsp_dir", 0) or 0), int(entry.get("ref_dir", 0) or 0))
            units |= dict.fromkeys((f"{name} re", f"{name} im"), _quotient(entry))
            continue
        columns[name] = data.astype(float)
        units[name] = str(entry.get("ordinate_axis_units_lab", "") or "").strip().replace(
            "NONE", ""
        ) or _UNIT_OF_TYPE.get(int(entry.get("ordinate_spec_data_type", 0) or 0), "")
        if int(entry.get("abscissa_spacing", 1) or 0) == 0:
            columns.setdefault("time", axis)
            units["time"] = "s"
        elif float(entry.get("abscissa_inc", 0) or 0) > 0:
            steps.add(float(entry["abscissa_inc"]))
    if len(steps) > 1:
        raise InputProblem(
            path,
            f"data sets with different steps ({listed((f'{step:g} s' for step in sorted(steps)), '')})",
            "export them at one rate",
        )
    rate = None
    if steps:
        step = steps.pop()
        rate = simplest_between((1 - _ROUNDING) / step, (1 + _ROUNDING) / step)
    return Table(path, columns, units, rate, _ROUNDING, tuple(notes), spectra=spectra, directions=directions)


def _quotient(entry: dict[str, Any]) -> str:
    """The unit of a response over a force: by its types, which are in SI, else by its label."""
    top, below = (_UNIT_OF_TYPE.get(int(entry.get(f"{part}_spec_data_type", 0) or 0), "") for part in ("ordinate", "orddenom"))
    label = str(entry.get("ordinate_axis_units_lab", "") or "").strip().replace("NONE", "")
    return label if "/" in label and not (top and below) else f"{top}/{below}" if top and below else ""


def _name(entry: dict[str, Any], number: int) -> str:
    text = str(entry.get("id1", "") or "").strip()
    if not text or text.upper() == "NONE":
        return f"{entry.get('rsp_ent_name', 'response')} {entry.get('rsp_node', number)}".replace(
            "NONE", "response"
        ).strip()
    return text
