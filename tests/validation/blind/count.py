"""What the blind campaigns come to: named right, named wrong, false alarms, intervals."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from testbed.analysis.search.false_alarms import FalseAlarms
from tests.validation.blind.judge import RESULTS
from tests.validation.claims import Claim, Section

VISIBLE = 1.02  # error over noise floor above which something is visible
WORTH = 0.03  # misfit, relative to the record, from which an effect must be named
QUIET = ("adequate", "not_converged")  # verdicts that say of no effect, known or unknown, that it is there


def misfit(one: dict[str, Any], which: str = "baseline") -> float:
    """What the hidden effect leaves unexplained: an error, the base model's or another, beyond the noise."""
    return math.sqrt(max(one[which] ** 2 - one["noise_floor"] ** 2, 0.0))


def share(part: Sequence[Any], whole: Sequence[Any]) -> str:
    """k of n, and the percentage."""
    return f"{len(part)} of {len(whole)}" + (f" ({len(part) / len(whole):.0%})" if whole else "")


def interval(count: int, of: int) -> str:
    """The exact 95 % interval (Clopper and Pearson 1934) of the probability behind `count` of `of`; empty without a trial."""
    if not of:
        return ""
    low, high = FalseAlarms(of, count, ()).interval
    return f"95 %: {100 * low:.0f} to {100 * high:.0f} %"


def _claim(what: str, target: str, part: Sequence[Any], whole: Sequence[Any], good: bool | None) -> Claim:
    return Claim(what, target, share(part, whole), good if whole else None, interval(len(part), len(whole)))


def check() -> Section:
    """The committed results of `make blind` on the published rig, counted."""
    return counted("Blind campaigns (results of `make blind`, counted)", RESULTS, RESULTS.with_name("remark.txt"), 200)


def counted(title: str, results: Path, remark: Path, least: int) -> Section:
    """The answers of a file, counted; remark: a file that says how they came about; least: campaigns that there should be."""
    if not results.exists():
        return Section(title, (Claim("blind campaigns", f"at least {least}", "0", None, "run `make blind`"),))
    made = [one for one in map(json.loads, results.read_text().splitlines()) if one["made"]]
    every = [one for one in made if "fault" not in one]
    kinds = {kind: [one for one in every if one["kind"] == kind] for kind in ("one", "pair", "none", "unknown")}
    worth = [one for one in kinds["one"] if misfit(one) > WORTH]
    right = [one for one in worth if _named_right(one)]
    named = [one for one in every if one["verdict"] == "missing_effect"]
    wrong = [one for one in worth if one["verdict"] == "missing_effect" and not set(one["effects"]) <= set(one["hidden"])]
    alarms = [one for one in kinds["none"] if one["verdict"] not in QUIET]
    seen = [one for one in kinds["one"] if one["baseline"] > VISIBLE * one["noise_floor"]]
    seen_right = [one for one in seen if _named_right(one)]
    pairs = [one for one in kinds["pair"] if misfit(one) > WORTH]
    both = [one for one in pairs if _named_right(one)]
    complete = [one for one in pairs if one["effects"] and set(one["effects"]) <= set(one["hidden"])
                and one["with_effects"] <= VISIBLE * one["noise_floor"]]
    visible = [one for one in pairs if min(one["alone"].values()) > VISIBLE]
    visible_both = [one for one in visible if one in both]
    unknown = [one for one in kinds["unknown"] if misfit(one) > WORTH]
    said = [one for one in unknown if one["verdict"] == "unexplained"]
    closed = [one for one in right if one["with_effects"] <= 1.05 * one["noise_floor"]]
    values = [value for one in right for path, value in one.get("parameters", {}).items() if "." in path and value["true"]]
    inside = [value for value in values if value["low"] <= value["true"] <= value["high"]]
    claims = (
        Claim("campaigns", f"at least {least}", str(len(made)), len(made) >= least,
              f"seeds {min(one['seed'] for one in made)} to {max(one['seed'] for one in made)}"),
        Claim("faults of the program", "0", str(len(made) - len(every)), len(made) == len(every)),
        _claim("one hidden effect worth more than 3 %: named right", ">= 95 %", right, worth, len(right) >= 0.95 * len(worth)),
        _claim("one hidden effect worth more than 3 %: named wrong", "<= 2 %", wrong, worth, len(wrong) <= 0.02 * len(worth)),
        _claim(f"one hidden effect, however small, that lifts the error above {VISIBLE} noise floors: named right", "told",
               seen_right, seen, None),
        _claim("nothing hidden: false alarms", "<= 2 %", alarms, kinds["none"], len(alarms) <= 0.02 * len(kinds["none"])),
        _claim("two hidden effects: both named", ">= 85 %", both, pairs, len(both) >= 0.85 * len(pairs)),
        _claim("two hidden effects: both, or one that leaves nothing visible of the other", "told", complete, pairs, None),
        _claim(f"two hidden effects, either of which alone, fitted from the truth, leaves more than {VISIBLE} noise floors: "
               "both named", ">= 85 %", visible_both, visible, len(visible_both) >= 0.85 * len(visible)),
        _claim("effect of no catalogue: said so", ">= 80 %", said, unknown, len(said) >= 0.8 * len(unknown)),
        _claim("those among them whose law was told as a power of the displacement or the velocity", "told",
               [one for one in said if one.get("other_law")], said, None),
        _claim("after a right naming: error within 1.05 noise floors", "all", closed, right, len(closed) == len(right)),
        _claim("true parameters inside their 95 % interval", "90-99 %", inside, values,
               0.90 <= len(inside) / max(1, len(values)) <= 0.99),
        _claim("those of the machine and of every effect, after all right namings", "told", *_calibration(every), None),
    )
    tables = (_by_effect(worth), _missed(worth + pairs + unknown + kinds["none"], named))
    return Section(title, claims, tables, remark.read_text().strip() if remark.exists() else "")


def _named_right(one: dict[str, Any]) -> bool:
    """Whether the effects named are those hidden, and said to be all."""
    return one["verdict"] == "missing_effect" and set(one["effects"]) == set(one["hidden"])


def _answered_right(one: dict[str, Any]) -> bool:
    """Whether the answer is that which the truth asks for."""
    if one["kind"] == "none":
        return one["verdict"] in QUIET
    return one["verdict"] == "unexplained" if one["kind"] == "unknown" else _named_right(one)


def _calibration(every: Sequence[dict[str, Any]]) -> tuple[list, list]:
    """(those inside their interval, all) of the parameters of campaigns in which what is hidden was named, nothing else."""
    right = [one for one in every if one["hidden"] and _named_right(one)]
    values = [value for one in right for value in one.get("parameters", {}).values() if value["true"]]
    return [value for value in values if value["low"] <= value["true"] <= value["high"]], values


def _by_effect(worth: Sequence[dict[str, Any]]) -> tuple[str, tuple[str, ...], tuple[tuple[str, ...], ...]]:
    names = sorted({name for one in worth for name in one["hidden"]})
    rows = []
    for name in names:
        mine = [one for one in worth if name in one["hidden"]]
        right = [one for one in mine if one["effects"] == [name]]
        others = sorted({f"{one['verdict']}: {' + '.join(one['effects']) or 'none'}" for one in mine if one not in right})
        times = sorted(one["processor"] for one in mine if "processor" in one)
        rows.append((name, share(right, mine), f"{times[len(times) // 2]:.0f}" if times else "-", "; ".join(others)))
    return "By effect (worth more than 3 %)", ("effect", "named right", "processor s, median", "otherwise"), tuple(rows)


def _missed(of_note: Sequence[dict[str, Any]], named: Sequence[dict[str, Any]]) -> tuple[str, tuple[str, ...], tuple]:
    rows = []
    for one in of_note:
        if not _answered_right(one):
            rows.append((str(one["seed"]), one["kind"], " + ".join(one["hidden"]) or "none", f"{misfit(one):.3f}",
                         f"{one['noise'] * 1e6:.1f}", "yes" if one["tachometer"] else "no", one["verdict"],
                         " + ".join(one["effects"]) or "none", f"{one['with_effects'] / one['noise_floor']:.2f}"))
    head = ("seed", "kind", "hidden", "misfit", "noise, um", "tachometer", "verdict", "named", "error / noise")
    return f"All that were not named right, of {len(named)} namings", head, tuple(rows)
