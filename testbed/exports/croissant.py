"""The set's description as Croissant JSON-LD (MLCommons, version 1.0): files with their hashes, fields with their types.

Source: Akhtar et al. (2024), Croissant: a metadata format for ML-ready datasets, doi 10.1145/3650203.3663326.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from testbed.exports.schema import Column

_CONTEXT: dict[str, Any] = {
    "@language": "en", "@vocab": "https://schema.org/", "citeAs": "cr:citeAs", "column": "cr:column",
    "conformsTo": "dct:conformsTo", "cr": "http://mlcommons.org/croissant/", "rai": "http://mlcommons.org/croissant/RAI/",
    "data": {"@id": "cr:data", "@type": "@json"}, "dataType": {"@id": "cr:dataType", "@type": "@vocab"},
    "dct": "http://purl.org/dc/terms/", "equivalentProperty": "cr:equivalentProperty",
    "examples": {"@id": "cr:examples", "@type": "@json"}, "extract": "cr:extract",
    "field": "cr:field", "fileProperty": "cr:fileProperty", "fileObject": "cr:fileObject", "fileSet": "cr:fileSet",
    "format": "cr:format", "includes": "cr:includes", "isLiveDataset": "cr:isLiveDataset", "jsonPath": "cr:jsonPath",
    "key": "cr:key", "md5": "cr:md5", "parentField": "cr:parentField", "path": "cr:path", "recordSet": "cr:recordSet",
    "references": "cr:references", "regex": "cr:regex", "repeated": "cr:repeated", "replace": "cr:replace",
    "samplingRate": "cr:samplingRate", "sc": "https://schema.org/", "separator": "cr:separator", "source": "cr:source",
    "subField": "cr:subField", "transform": "cr:transform"}
_TYPES = {"float": "sc:Float", "float32 list": "sc:Float", "float list": "sc:Float", "int": "sc:Integer",
          "bool": "sc:Boolean", "text": "sc:Text", "text list": "sc:Text"}
PARQUET = "application/x-parquet"


def croissant(content: Mapping[str, Any], listed: Sequence[Column]) -> dict[str, Any]:
    """croissant.json from the content of `export.json`."""
    about = content["about"]
    files = [{"@type": "cr:FileObject", "@id": name, "name": name, "contentUrl": name, "encodingFormat": PARQUET,
              "contentSize": f"{one['bytes']} B", "sha256": one["sha256"]} for name, one in content["shards"].items()]
    present = [name for name, one in content["splits"].items() if one["rows"]]
    sets = [{"@type": "cr:FileSet", "@id": f"{split}-files", "name": f"{split}-files", "encodingFormat": PARQUET,
             "includes": f"data/{split}-*.parquet"} for split in present]
    return {"@context": _CONTEXT, "@type": "sc:Dataset", "conformsTo": "http://mlcommons.org/croissant/1.0",
            "name": about["name"], "description": content["description"], "license": content["licence_url"],
            "version": "1.0.0", "url": "data", "isLiveDataset": False, "distribution": [*files, *sets],
            "recordSet": [_record_set(split, listed) for split in present]}


def _record_set(split: str, listed: Sequence[Column]) -> dict[str, Any]:
    fields = []
    for each in listed:
        field: dict[str, Any] = {"@type": "cr:Field", "@id": f"{split}/{each.name}", "name": each.name,
                                 "description": f"{each.meaning} ({each.unit}; {each.role})", "dataType": _TYPES[each.kind],
                                 "source": {"fileSet": {"@id": f"{split}-files"}, "extract": {"column": each.name}}}
        if each.kind.endswith("list"):
            field["repeated"] = True
        fields.append(field)
    return {"@type": "cr:RecordSet", "@id": split, "name": split, "field": fields}
