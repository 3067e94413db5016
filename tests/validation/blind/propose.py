"""Blind campaigns with an effect of no catalogue: what is proposed for it, added, and what that leaves.

    python -m tests.validation.blind.propose [--workers N]

Those that `judge` found unexplained are diagnosed again, the missing force is explained, the effect file that comes of it is
added to the believed machine as `testbed add --effects` would, and the errors on held-out conditions are written, one line of
proposed.jsonl a campaign. A stopped run goes on where it was.
"""

from __future__ import annotations

import os

for _threads in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
    os.environ.setdefault(_threads, "1")

import argparse
import json
import sys
import tempfile
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any

from testbed.analysis.fit.observe import observe
from testbed.analysis.fit.observed import Observed
from testbed.analysis.force.explain_force import left_unexplained
from testbed.analysis.force.explanation import Explanation, formula_text, write_effect
from testbed.analysis.force.formula_trial import Jury
from testbed.analysis.search.add_effect import add_effect
from testbed.analysis.search.diagnose import diagnose
from testbed.api.fitting import engine_of
from testbed.catalogue import catalogue
from testbed.machine import Model
from tests.validation.blind.count import VISIBLE, misfit
from tests.validation.blind.judge import ELSEWHERE, ENGINE, FOLDER, RESULTS, answered, drawn, known_seeds
from tests.validation.blind.make import records_of
from tests.validation.claims import Claim, Section

PROPOSED = FOLDER / "proposed.jsonl"
NAME = "proposal"


def proposed(seed: int) -> dict[str, Any]:
    """One campaign made, diagnosed, and what was left explained and added. Errors in units of the record, held out."""
    known, makers, truth = drawn(seed)
    observed = [observe(record, truth.believed) for record in records_of(truth, makers)]
    found = diagnose(ENGINE, observed, truth.believed, known)
    told = {"seed": seed, "hidden": list(truth.effects), "verdict": found.verdict, "formula": "", "share": 0.0}
    explanations = left_unexplained(ENGINE, observed, found, known)
    if not explanations or not explanations[0].formula:
        return told
    explanation = Jury(engine_of, truth.believed, known).likeliest(explanations)
    return told | added_to(truth.believed, observed, explanation)


def added_to(believed: Model, observed: Sequence[Observed], explanation: Explanation) -> dict[str, Any]:
    """The formula written, read and added, and the errors before and after."""
    with tempfile.TemporaryDirectory() as folder:
        write_effect(explanation, folder, NAME)
        wider = catalogue(folder)
        added = add_effect(engine_of(wider), observed, believed, wider[NAME], wider)
    return {"formula": formula_text(explanation.formula), "share": explanation.share, "before": added.before,
            "after": added.after, "noise_floor": added.noise_floor, "unheard": list(added.unheard), "heard": added.in_fit()}


def faults_told(propose: Callable[[int], dict[str, Any]], seed: int) -> dict[str, Any]:
    """What is proposed for a seed, or what went wrong."""
    try:
        return propose(seed)
    except Exception as problem:  # a fault is a result of this benchmark, and must not end it
        return {"seed": seed, "fault": repr(problem)}


def _heard(one: dict[str, Any]) -> dict[str, Any]:
    """The errors of a campaign over those records that had a say in the fit."""
    return dict(zip(("before", "after", "noise_floor"), one["heard"], strict=True)) if one.get("unheard") else one


def check() -> Section:
    """The committed results, counted."""
    return counted("Effects of no catalogue, proposed and added (results of `make blind`, counted)", PROPOSED)


def counted(title: str, results: Path) -> Section:
    """What the answers of a file come to."""
    if not results.exists():
        return Section(title, (Claim("campaigns", "all that were unexplained", "0", None, "run `make blind`"),))
    remark = results.with_suffix(".txt")
    every = [one for one in map(json.loads, results.read_text().splitlines()) if one.get("made", True)]
    sound = [one for one in every if "fault" not in one]
    written = [one for one in sound if one["formula"]]
    loud = [one for one in sound if not one["formula"] or one["before"] > VISIBLE * one["noise_floor"]]
    below = [one for one in loud if one["formula"] and misfit(one, "after") < 0.5 * misfit(one, "before")]
    followed = [one for one in loud if one["formula"] and misfit(_heard(one), "after") < 0.5 * misfit(_heard(one), "before")]
    reach = [one for one in written if one["noise_floor"] < 0.5 * one["before"]]
    plain = [one for one in reach if one["after"] < 0.5 * one["before"]]
    rows = tuple((str(one["seed"]), " + ".join(one["hidden"]), one["formula"] or "none",
                  *(f"{one[key] / one['noise_floor']:.2f}" if key in one else "-" for key in ("before", "after")),
                  f"{_heard(one)['after'] / _heard(one)['noise_floor']:.2f}" if one.get("unheard") else "")
                 for one in sorted(sound, key=lambda one: one["seed"]))
    claims = (
        Claim("faults of the program", "0", str(len(every) - len(sound)), len(every) == len(sound),
              f"seeds {min(one['seed'] for one in every)} to {max(one['seed'] for one in every)}"),
        Claim("unexplained campaigns for which an effect was proposed", "told", f"{len(written)} of {len(sound)}", None),
        Claim("after adding it: held-out error beyond the noise, where there is any (above 1.02 floors), below half", "all",
              f"{len(below)} of {len(loud)}", len(below) == len(loud)),
        Claim("the same over records that had a say in the fit (one that no model follows has none)", "all",
              f"{len(followed)} of {len(loud)}", len(followed) == len(loud)),
        Claim("held-out error itself below half, where the noise lets it", "told",
              f"{len(plain)} of {len(reach)}", None),
    )
    head = ("seed", "hidden", "proposed", "error / noise before", "after", "without records that had no say")
    return Section(title, claims, (("What was proposed", head, rows),), remark.read_text().strip() if remark.exists() else "")


def main(arguments: list[str]) -> int:
    """Propose for the unexplained campaigns of results.jsonl and anywhere.jsonl that proposed.jsonl does not hold yet."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--workers", type=int, default=2)
    options = parser.parse_args(arguments)
    known = known_seeds(PROPOSED)
    judged = [json.loads(line) for results in (RESULTS, ELSEWHERE) for line in results.read_text().splitlines()]
    seeds = [one["seed"] for one in judged if one["kind"] == "unknown" and one.get("verdict") == "unexplained"
             and one["seed"] not in known]
    for told in answered(partial(faults_told, proposed), seeds, PROPOSED, options.workers):
        print(f"{told.get('hidden')} -> {told.get('fault', told.get('formula'))}", flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
