"""Laws of no catalogue hidden in machines in x and y: what is proposed for them, added, and what that leaves.

    python -m tests.validation.blind.plane_propose [--count N] [--first SEED] [--workers N]

The campaigns are those of `plane` in which such a law is hidden. The believed machine is fitted, its missing force explained
as `testbed diagnose --propose` does, and the effect file added as `testbed add --effects` would; a line of plane_proposed.jsonl
each.
"""

from __future__ import annotations

import os

for _threads in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
    os.environ.setdefault(_threads, "1")

import sys
from functools import partial
from typing import Any

import numpy as np

from testbed.analysis.fit.observe import observe
from testbed.analysis.force.formula_trial import Jury
from testbed.analysis.force.planar_formula import explanations_about
from testbed.analysis.search.candidate_round import by_noise
from testbed.analysis.search.refit_from_prior import from_believed
from testbed.api.fitting import engine_of
from testbed.catalogue import catalogue
from tests.validation.blind.judge import ENGINE, FOLDER, answered, known_seeds, options_of
from tests.validation.blind.plane_made import KINDS, draw, measured
from tests.validation.blind.propose import added_to, counted, faults_told
from tests.validation.claims import Section

RESULTS = FOLDER / "plane_proposed.jsonl"
FIRST, COUNT = 8000, 200


def proposed(seed: int) -> dict[str, Any]:
    """One campaign made and fitted, and what it lacks explained and added. Errors in units of the record, held out."""
    makers, known = catalogue(str(FOLDER / "laws")), catalogue()
    truth = draw(seed, makers)
    told: dict[str, Any] = {"seed": seed, "hidden": list(truth.effects), "formula": "", "share": 0.0}
    try:
        records = measured(truth, makers)
    except ValueError as problem:  # a cut ran away
        return told | {"made": False, "reason": str(problem)}
    observed = [observe(record, truth.believed) for record in records]
    base = by_noise(from_believed(ENGINE, observed, truth.believed, (), known))
    best = Jury(engine_of, truth.believed, known).likeliest(explanations_about(engine_of, base.fitter, base.fit, known))
    return told | added_to(truth.believed, observed, best) if best.formula else told


def check() -> Section:
    """The committed results, counted."""
    return counted("Effects of no catalogue in x and y, proposed and added", RESULTS)


def main(arguments: list[str]) -> int:
    """Propose for the campaigns with a law of no catalogue whose answers are not known yet."""
    options = options_of(arguments, __doc__, COUNT, FIRST)
    known, kinds = known_seeds(RESULTS), (list(KINDS), list(KINDS.values()))
    seeds = [seed for seed in range(options.first, options.first + options.count) if seed not in known
             and str(np.random.default_rng([5757, seed]).choice(kinds[0], p=kinds[1])) == "unknown"]
    for told in answered(partial(faults_told, proposed), seeds, RESULTS, options.workers):
        print(f"{told.get('hidden')} -> {told.get('fault', told.get('formula'))}", flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
