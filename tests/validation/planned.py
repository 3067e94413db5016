"""Pairs that a campaign leaves tied, and the cut that `plan` proposes: made, does it tell them apart?

The campaigns are those of `hard_pairs` whose records cannot separate their pair, with other seeds. Where the diagnosis is
undecided, `plan` is asked; its first cut that it says would separate the pair, else its first, is made by MuJoCo on the true
machine, measured as the campaign was, and all records are diagnosed again. Right: the hidden effect is named, alone.

`python -m tests.validation.planned [--count N] [--workers N]` asks seeds that are not answered yet, some 100 s of processor
each; every answer is a line of planned.jsonl. `tests.validation.run planned` counts them.
"""

# ruff: noqa: E402 - the number of threads is read when numpy is imported
from __future__ import annotations

import os

for _threads in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
    os.environ.setdefault(_threads, "1")

import json
import sys
import time
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import testbed
from testbed.analysis.fit.observe import observe
from testbed.analysis.search.next_test import COURSE
from testbed.files.campaign import Campaign
from testbed.workshop import RPM
from tests.support.campaign_files import BELIEVED
from tests.validation.blind.judge import answered, known_seeds, options_of
from tests.validation.claims import Claim, Section
from tests.validation.hard_pairs import ZETA, Case, Test, answer, cases, cuts

RESULTS = Path(__file__).with_suffix(".jsonl")
REACH = "2600 rpm:4600 rpm:9", "0.5 mm:3 mm:6"  # of the machine: around the cuts that were made
FIRST = 100  # seed
TIED = tuple(case for case in cases() if not case.separates and not case.absorbed and ZETA not in case.pair)


def asked(seed: int) -> dict[str, Any]:
    """One campaign: seeds go through the cases in turn."""
    case, begun = TIED[seed % len(TIED)], time.process_time()
    row = {"seed": seed, "pair": case.pair, "hidden": case.hidden}
    records = case.maker(case.truth, seed)
    before = _verdict(records)
    row |= {"before": before}
    if before["verdict"] == "undecided":
        row |= _with_planned(case, records, seed)
    return row | {"processor": round(time.process_time() - begun, 1)}


def _verdict(records: list) -> dict[str, Any]:
    found = testbed.diagnose(Campaign("tied", tuple(records)), BELIEVED, progress=False)
    return {"verdict": found.verdict, "effects": found.effects}


def _with_planned(case: Case, records: list, seed: int) -> dict[str, Any]:
    """What is planned, and the verdict with that cut beside the records."""
    made = testbed.plan(Campaign("tied", tuple(records)), BELIEVED, *REACH, count=1000, progress=False)
    if not made.next:
        return {"planned": None, "why": made.no_plan}
    cut = next((one for one in made.next if one.separates), made.next[0])
    noise = float(observe(records[0], BELIEVED).noise[0])
    test = Test(cut.spindle_speed / RPM, cut.axial_depth_of_cut * 1e3)
    more = cuts([test], noise=noise, course=COURSE)(case.truth, 1000 + seed)
    return {"planned": [round(test.rpm, 1), round(test.mm, 3)], "separates": cut.separates, "difference": cut.difference,
            "after": _verdict([*records, *more])}


def check() -> Section:
    """The section of the table, of the campaigns that are answered."""
    rows = [json.loads(line) for line in RESULTS.read_text().splitlines()]
    tied = [row for row in rows if row["before"]["verdict"] == "undecided"]
    named = [row for row in tied if _names(row.get("after"), row)]
    wrong = [row for row in tied if row.get("after", {}).get("verdict") == "missing_effect" and row not in named]
    early = [row for row in rows if row not in tied]
    claims = (
        Claim("tied pairs: the planned cut separates them, the hidden effect is named alone", ">= 90 %",
              f"{len(named)} of {len(tied)}", len(named) >= 0.9 * len(tied), ""),
        Claim("another is named", "0", f"{len(wrong)} of {len(tied)}", not wrong, ""),
        Claim("campaigns that were not tied with these seeds: the hidden effect named, or nothing", "told",
              f"{sum(_names(row['before'], row) for row in early)} named, "
              f"{sum(row['before']['verdict'] == 'adequate' for row in early)} adequate, of {len(early)}", None, ""),
    )
    table = ("Campaign by campaign", ("seed", "pair", "hidden", "before", "planned", "said to separate", "after", "processor"),
             tuple((str(row["seed"]), " / ".join(row["pair"]), row["hidden"], _told(row["before"]), _cut(row),
                    ", ".join(row.get("separates", ())) or "-", _told(row["after"]) if "after" in row else "-",
                    f"{row['processor']:.0f} s") for row in rows))  # fmt: skip
    return Section("Tied pairs and the cut that is planned", claims, (table,))


def _names(found: dict[str, Any] | None, row: dict[str, Any]) -> bool:
    return bool(found) and found["verdict"] == "missing_effect" and list(found["effects"]) == [row["hidden"]]


def _told(found: dict[str, Any]) -> str:
    return answer(SimpleNamespace(**found))


def _cut(row: dict[str, Any]) -> str:
    planned = row.get("planned")
    return f"{planned[0]:.0f} rpm, {planned[1]:.2f} mm" if planned else row.get("why") or "-"


def main(arguments: list[str]) -> int:
    """Ask what is not asked yet."""
    options = options_of(arguments, __doc__, 5 * len(TIED), FIRST)
    asked_for = set(range(options.first, options.first + options.count)) - known_seeds(RESULTS)
    for row in answered(asked, sorted(asked_for), RESULTS, options.workers):
        print(row["seed"], row["hidden"], row["before"], row.get("planned"), row.get("after"), flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
