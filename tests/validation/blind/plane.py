"""Blind campaigns of machines in x and y:  python -m tests.validation.blind.plane [--count N] [--first SEED] [--workers N]

What is hidden, and how it is cut, is in `plane_made`. Every answer is a line of plane.jsonl, written when it is known.
"""

from __future__ import annotations

import os

for _threads in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
    os.environ.setdefault(_threads, "1")

import json
import math
import sys
import time
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from typing import Any

from testbed.analysis.fit.observe import observe
from testbed.analysis.search.candidate import Candidate
from testbed.analysis.search.diagnose import diagnose
from testbed.catalogue import catalogue
from testbed.files.campaign import Record
from tests.validation.blind.count import counted, share
from tests.validation.blind.judge import ENGINE, FOLDER, answered, beside_the_truth, known_seeds, options_of, said
from tests.validation.blind.plane_made import Hidden, draw, measured
from tests.validation.claims import Claim, Section

RESULTS = FOLDER / "plane.jsonl"
LEAST = 60  # campaigns that there should be
# by slip, words by one of which an answer names it
SAID = {"mode": ("lacks a mode", "second_mode"), "direction": ("moves along",), "carrier": ("carries", "exchanged"),
        "axes": ("x and y are exchanged",), "parts": ("tool and workpiece", "carries"), "sign": ("the other way",),
        "pitch": ("pitch",), "flutes": ("flutes cut, not", "flute cut, not")}


def judged(seed: int) -> dict[str, Any]:
    """One campaign made, diagnosed and compared with its truth. Effects of the diagnosis come from the product's catalogue."""
    makers = catalogue(str(FOLDER / "laws"))
    told: dict[str, Any] = {"seed": seed}
    try:
        truth = draw(seed, makers)
        told |= {"kind": truth.kind, "slip": truth.slip, "noise": truth.noise, "tachometer": truth.marked,
                 "flutes": truth.model.cutter.flutes,
                 "hidden": {name: dict(values) for name, values in truth.effects.items()},
                 "modes": len(truth.model.structure.modes), "sensors": truth.sensors, "records": len(truth.tests),
                 "unequal": bool(truth.model.cutter.pitch_angles)}
        records = measured(truth, makers)
    except ValueError as problem:
        return told | {"made": False, "reason": str(problem)}
    try:
        return told | answer(truth, records)
    except Exception as problem:  # a fault is a result of this benchmark, and must not end it
        return told | {"made": True, "fault": repr(problem)}


def answer(truth: Hidden, records: Sequence[Record], **more: Any) -> dict[str, Any]:
    """What a diagnosis says of the records, and the true values beside those found. more: for `diagnose`."""
    processor, known = time.process_time(), catalogue()
    observed = [observe(record, truth.believed) for record in records]
    found = diagnose(ENGINE, observed, truth.believed, known, **more)
    told = {"made": True, "processor": round(time.process_time() - processor, 1), "sentence": found.sentence} | said(found)
    if truth.kind == "pair":
        told["alone"] = dict.fromkeys(truth.effects, math.inf)
    best = found.best
    if isinstance(best, Candidate) and truth.effects and set(found.effects) == set(truth.effects):
        told["parameters"] = beside_the_truth(best, known, partial(_true, truth))
    return told


def _true(truth: Hidden, path: str, near: float) -> float | None:
    """The true value of a parameter, of a direction the turn by 180 deg that is nearer; None where it has none."""
    try:
        value = truth.model.value(path)
    except KeyError:
        return None
    return value + math.pi * round((near - value) / math.pi) if path.endswith("direction") else value


def check() -> Section:
    """The committed results, counted."""
    section = counted("Blind campaigns of machines in x and y", RESULTS, RESULTS.with_suffix(".txt"), LEAST)
    rows = [one for one in map(json.loads, RESULTS.read_text().splitlines()) if one["made"] and "fault" not in one]
    slips = [one for one in rows if one["kind"] == "slip"]
    seen = [one for one in slips if one["baseline"] > 1.02 * one["noise_floor"] or one["verdict"] == "unexplained"]
    right = [one for one in slips if one in seen and any(word in one["sentence"] for word in SAID[one["slip"]])]
    wrong = [one for one in slips if one["verdict"] == "missing_effect"
             and not (one["slip"] == "mode" and one["effects"] == ["second_mode"])]
    missed = [one for one in seen if one not in right]
    claims = (Claim("a slip in what is written down of machine or channels: named as such", ">= 95 %", share(right, seen),
                    len(right) >= 0.95 * len(seen) if seen else None, _which(missed)),
              Claim("a slip: named as an effect", "<= 2 %", share(wrong, slips),
                    len(wrong) <= 0.02 * len(slips) if slips else None, _which(wrong)))
    return replace(section, claims=(*section.claims, *claims))


def _which(rows: Sequence[dict[str, Any]]) -> str:
    return ", ".join(f"{one['seed']} {one['slip']}" for one in rows)


def main(arguments: list[str]) -> int:
    """Judge the seeds whose answers are not known yet."""
    options = options_of(arguments, __doc__, 60, 8000)
    known = known_seeds(RESULTS)
    seeds = [seed for seed in range(options.first, options.first + options.count) if seed not in known]
    for told in answered(judged, seeds, RESULTS, options.workers):
        print(told.get("kind"), told.get("slip"), list(told.get("hidden", ())), "->", told.get("verdict", told.get("reason")),
              told.get("effects", ""), told.get("fault", ""), told.get("processor", ""), flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
