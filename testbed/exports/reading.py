"""What an exported folder, or one of its Parquet files, is."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from testbed.exports.schema import FORMAT, KEY
from testbed.exports.writing import MANIFEST, file_hash, manifest_hash
from testbed.problem import InputProblem


def is_export(path: str | Path) -> bool:
    """True for a folder of `testbed export`, or a Parquet file out of one."""
    place = Path(path)
    if place.is_dir():
        return (place / MANIFEST).is_file()
    return place.suffix == ".parquet" and place.is_file() and _about_file(place) is not None


def _about_file(path: Path) -> dict[str, Any] | None:
    try:
        import pyarrow.parquet as pq
    except ImportError:
        return None
    try:
        found = json.loads((pq.read_schema(path).metadata or {})[KEY])
    except (KeyError, ValueError, OSError):
        return None
    return found if isinstance(found, dict) and "format" in found and "units" in found else None


def describe(path: str | Path, check: bool = True) -> dict[str, Any]:
    """What the set is: name, origin, runs, splits, columns, baseline; of a single file its rows and columns.

    check: compare every shard with its hash; InputProblem names one that is missing or damaged, or a newer format.
    """
    place = Path(path)
    if place.is_dir():
        return _folder(place, check)
    import pyarrow.parquet as pq

    about = _about_file(place)
    if about is None:
        raise InputProblem(path, "is no shard of `testbed export`", "give the exported folder")
    file = pq.ParquetFile(place)
    columns = [{"name": field.name, "unit": (field.metadata or {}).get(b"unit", b"").decode(),
                "role": (field.metadata or {}).get(b"role", b"").decode()} for field in file.schema_arrow]
    return {"kind": "exported_shard", "about": about, "runs": file.metadata.num_rows, "columns": columns,
            "split": place.name.split("-")[0]}


def _folder(place: Path, check: bool) -> dict[str, Any]:
    try:
        content = json.loads((place / MANIFEST).read_text(encoding="utf-8"))
        newer = int(content["format"]) > FORMAT
        shards = {name: (str(one["sha256"]), int(one["rows"])) for name, one in content["shards"].items()}
    except (OSError, ValueError, KeyError, TypeError, AttributeError):
        raise InputProblem(place / MANIFEST, "is damaged", "export the data set again") from None
    if newer:
        raise InputProblem(place, f"is of a newer testbed (format {content['format']})", "update testbed")
    if manifest_hash(content) != content.get("hash", manifest_hash(content)):  # older exports have none
        raise InputProblem(place / MANIFEST, "was changed after it was written", "export the data set again")
    for name, (digest, _) in shards.items():
        file = (place / name).resolve()
        if not file.is_relative_to(place.resolve()) or not file.is_file():
            raise InputProblem(place / name, "is missing", "export the data set again")
        if check and file_hash(file) != digest:
            raise InputProblem(place / name, "is damaged (its hash differs)", "export the data set again")
    return {"kind": "exported_set", **content}
