"""What blind campaigns come to whose one effect, if any, lifts the error above the noise by 0.3 to 3 % alone."""

from __future__ import annotations

import json
from collections.abc import Sequence
from typing import Any

from tests.validation.blind.count import share
from tests.validation.blind.judge import FAINTLY
from tests.validation.claims import Claim, Section

TITLE = "Weak effects: hardly visible above the noise (results of `make blind`, counted)"
REMARK = ("100 of each were asked for; these are as many as were judged. All but 6010 by the version before it was asked that "
          "an effect foretell a third of what it explains: 6010, named chip_force_exponent then, was judged again with that.")
CERTAIN = 100.0  # gain in BIC over the best rival, from which an effect must be named


def lead(one: dict[str, Any]) -> float:
    """Gain in BIC of the hidden effect over its best rival, or over the model without any effect."""
    gains = {tuple(each["effects"]): each["delta_bic"] for each in one["candidates"] if len(each["effects"]) == 1}
    own = gains.pop(tuple(one["hidden"]), 0.0)
    return own - max([0.0, *gains.values()])


def check() -> Section:
    """The committed results, counted."""
    rows = [one for one in map(json.loads, FAINTLY.read_text().splitlines()) if one["made"]]
    every = [one for one in rows if "fault" not in one]
    hidden, none = ([one for one in every if one["kind"] == kind] for kind in ("one", "none"))
    certain = [one for one in hidden if lead(one) > CERTAIN]
    right = [one for one in certain if one["verdict"] == "missing_effect" and one["effects"] == list(one["hidden"])]
    wrong = [one for one in hidden if one["verdict"] == "missing_effect" and one["effects"] != list(one["hidden"])]
    nothing = [one for one in certain if one["verdict"] == "adequate"]
    alarms = [one for one in none if one["verdict"] != "adequate"]
    claims = (
        Claim("campaigns with a hidden effect, and with none", "told", f"{len(hidden)} and {len(none)}", None,
              f"seeds {min(one['seed'] for one in rows)} to {max(one['seed'] for one in rows)}"),
        Claim("faults of the program", "0", str(len(rows) - len(every)), len(rows) == len(every)),
        Claim(f"certain (gain in BIC above {CERTAIN:.0f} over the best rival): named right", ">= 95 %", share(right, certain),
              len(right) >= 0.95 * len(certain)),
        Claim("certain: called nothing", "0", share(nothing, certain), not nothing),
        Claim("named wrong", "<= 2 %", share(wrong, hidden), len(wrong) <= 0.02 * len(hidden)),
        Claim("nothing hidden: said otherwise than adequate", "0", share(alarms, none), not alarms),
    )
    return Section(TITLE, claims, (_table(hidden),), REMARK)


def _table(hidden: Sequence[dict[str, Any]]) -> tuple[str, tuple[str, ...], tuple[tuple[str, ...], ...]]:
    rows = tuple((str(one["seed"]), *one["hidden"], f"{one['baseline'] / one['noise_floor']:.4f}", f"{lead(one):.0f}",
                  one["verdict"], " + ".join(one["effects"]) or "none") for one in hidden)
    return "Each", ("seed", "hidden", "error / noise", "lead in BIC", "verdict", "named"), rows
