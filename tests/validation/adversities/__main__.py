"""The table of adversities: python -m tests.validation.adversities [MODULE ...] (some minutes)."""

from __future__ import annotations

import importlib
import json
import sys
from collections import Counter
from pathlib import Path

MODULES = ("files", "scarce_memory", "data_sets", "installation")  # and write_faults, which takes longer
RESULTS = Path(__file__).parent / "results.jsonl"


def main(chosen: list[str]) -> None:
    """Run every module that is there, print the counts by kind, keep each probe's result as a line of JSON."""
    asked, answered = Counter[str](), Counter[str]()
    with RESULTS.open("w", encoding="utf-8") as file:
        for name in chosen or MODULES:
            place = f"tests.validation.adversities.{name}"
            for title, right, seen in importlib.import_module(place).run():
                kind = title.partition(":")[0]
                asked[kind] += 1
                answered[kind] += right
                file.write(json.dumps({"module": name, "name": title, "answered": right, "seen": seen}) + "\n")
                file.flush()
                if not right:
                    print(f"not as asked: {title}: {seen}")
    print("| kind | probes | answered as asked |\n|---|---|---|")
    for kind, count in asked.items():
        print(f"| {kind} | {count} | {answered[kind]} |")
    print(f"| all | {asked.total()} | {answered.total()} |")


if __name__ == "__main__":
    main(sys.argv[1:])
