"""Held-out residuals: is what is left called noise where nothing is hidden, and more where something is that the records show?

Campaigns are those of `probable`: three stable cuts, loud noise. What shows is told by the likelihood: the gain in BIC of the
fit with the hidden effect, begun at its true values, on the effective sample size. Judged is twice: by the residuals of the
records left out as they are, as before, and less what the other records leave open. Campaigns are counted one by one into
judged.jsonl (`python -m tests.validation.judged KIND FIRST LAST`, 4 s of processor time each).
"""

from __future__ import annotations

import json
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from testbed.analysis.comparison.adequacy import adequacy_tests, controlled
from testbed.analysis.comparison.compare import compare
from testbed.analysis.fit.evidence import DELTA_BIC, bic, effective_size
from testbed.analysis.fit.model_fit import model_fit
from testbed.engines import predict
from tests.validation.claims import Claim, Section
from tests.validation.probable import EVERY, campaign, machine

PLAIN = "nothing"
Draw = Callable[[Callable[[float, float], float], float], dict[str, float]]
# by the effect: its parameters, from uniform draws and the tangential coefficient
HIDDEN: dict[str, Draw] = {
    "process_damping": lambda draw, tangential: {"coefficient": draw(2e-4, 6e-4) * tangential},
    "chip_force_exponent": lambda draw, tangential: {"exponent": draw(0.7, 0.95)},
    "immersion_error": lambda draw, tangential: {"error": draw(0.05, 0.2)},
    "edge_force": lambda draw, tangential: {"tangential": draw(2e-6, 1e-5) * tangential,
                                            "normal": draw(2e-6, 1e-5) * tangential},
}
RESULTS = Path(__file__).with_name("judged.jsonl")


def one(kind: str, seed: int) -> dict[str, Any]:
    """A campaign judged; gain in BIC of the hidden effect, None where its fit ended elsewhere, at a higher cost."""
    random = np.random.default_rng([59, seed, kind != PLAIN])
    truth, believed = machine(random)
    values = {}
    if kind != PLAIN:
        values = HIDDEN[kind](lambda low, high: float(random.uniform(low, high)), truth.cutting.tangential_coefficient)
        truth = truth.with_effect(kind, **values)
    records = campaign(truth, random, seed)
    found = compare(predict, records, believed, EVERY)
    raw = [test for record, error, own in zip(found.fitter.records, found.errors, found.fit.state.nuisances, strict=True)
           for test in adequacy_tests(record, error, found.fit.state.angle, own)]
    gain = None
    if values:
        _, fit = model_fit(predict, records, believed.with_effect(kind, **values), EVERY)
        size = effective_size(fit)
        gain = bic(found.fit, size) - bic(fit, size) if fit.cost < found.fit.cost else None
    return {"kind": kind, "seed": seed, "gain": gain, "before": any(test.fails for test in controlled(raw)),
            "now": any(test.fails for test in found.tests)}


def check() -> Section:
    """The section of the table, of the campaigns that are counted."""
    rows = [json.loads(line) for line in RESULTS.read_text().splitlines()]
    plain = [row for row in rows if row["kind"] == PLAIN]
    shown = [row for row in rows if row["kind"] != PLAIN and row["gain"] is not None and row["gain"] > DELTA_BIC]
    unseen = [row for row in rows if row["kind"] != PLAIN and row not in shown]

    def more(some: list[dict[str, Any]], when: str) -> str:
        return f"{sum(row[when] for row in some)} of {len(some)}"

    claims = (
        Claim("nothing hidden: said to hold more than noise", "<= 5 %", more(plain, "now"),
              sum(row["now"] for row in plain) <= 0.05 * len(plain), f"{more(plain, 'before')} by the residuals as they are"),
        Claim("an effect hidden that shows (gain in BIC above 10): said to hold more than noise", "all", more(shown, "now"),
              all(row["now"] for row in shown), f"{more(shown, 'before')} by the residuals as they are"),
    )
    kinds = (("nothing hidden", plain), ("hidden, and it shows", shown), ("hidden, and it does not", unseen))
    table = tuple((name, more(some, "before"), more(some, "now")) for name, some in kinds)
    return Section("Held-out residuals: noise, or more", claims,
                   (("Said to hold more than noise", ("campaigns", "by the residuals as they are",
                                                      "less what the others leave open"), table),),
                   "Campaigns as under Chance of stability; hidden: process_damping, chip_force_exponent, immersion_error, "
                   "edge_force, faint to strong.")


if __name__ == "__main__":
    for each in range(int(sys.argv[2]), int(sys.argv[3])):
        with RESULTS.open("a") as file:
            file.write(json.dumps(one(sys.argv[1], each)) + "\n")
    print(check())
