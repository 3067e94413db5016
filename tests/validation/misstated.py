"""Campaigns of a plain machine with one condition written down wrongly in all records: is that said, and no effect named?

The records are those of tests/validation/outside (a simulator that shares no code with the product) with nothing hidden. Then
one number of campaign.yaml or model.yaml is written as people write it wrongly: a feed a revolution as one a tooth, a radius
for a diameter, inches for millimetres, another number of flutes, another sampling rate, rad/s for rpm, a mass ten times off.

Asked by `python -m tests.validation.misstated [--count N] [--first SEED] [--workers N]`; every answer is a line of
misstated.jsonl, written when it is known, so that a stopped run goes on where it was. `tests.validation.run misstated` counts.
"""

from __future__ import annotations

import json
import os
import resource
import subprocess
import sys
import tempfile
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from ruamel.yaml import YAML

from tests.validation.blind.judge import answered, known_seeds, options_of
from tests.validation.claims import Claim, Section
from tests.validation.outside.files import write
from tests.validation.outside.plan import COARSE, Plan, _bearable, _machine, _sensors, _tests, displacement

CLOCK = ("if the sampling rate was", "if the spindle speed was", "every cut turns at", "sampling_rate, pulses_per_revolution")
SCALE = ("both cutting coefficients came out",)
# condition -> (words by one of which an answer names it, and not only that something is to be checked; how many campaigns)
KINDS = {"feed": (("if the feed per tooth was",), 10), "flutes": (("flutes cut, not", "flute cut, not"), 8), "rate": (CLOCK, 6),
         "speed": (CLOCK, 5), "depth": (SCALE, 5), "mass": (SCALE, 4), "coefficient": (SCALE, 2)}
FEEDS = ("revolution as tooth", "tooth as revolution", 2.0, 0.5, 1 / 25.4)
RATES = (0.5, 2.0, 10.0 / 12.8, 12.8 / 10.0, 1.25, 0.8)
SPEEDS = (2.0, 0.5, 2 * np.pi / 60 * 10, 60.0 / 50.0)
DEPTHS = (2.0, 0.5, 10.0, 25.4, 1 / 25.4)
EACH = tuple(kind for kind, (_, count) in KINDS.items() for _ in range(count))
FIRST = 300
SECONDS = 900  # of the processor, after which an answer counts as none
REMARK = """A depth, a mass and the coefficients' unit change nothing but the coefficients: they are named together."""
RESULTS = Path(__file__).with_suffix(".jsonl")


def plain(seed: int, least_flutes: int, marked: bool | None) -> Plan:
    """A campaign with nothing hidden. marked: whether it has a tachometer, drawn where None."""
    random = np.random.default_rng([1907, seed])
    while True:
        base, direction, immersion = _machine(random, ())
        if base.flutes >= least_flutes:
            break
    tests = tuple(_bearable(test) for test in _tests(random, base, (), False))
    motion = float(np.concatenate([displacement(test, test.cut, COARSE) for test in tests]).std())
    sensors = _sensors(random, base, motion, bool(random.uniform() < 0.6) if marked is None else marked, False)
    believed = {name: getattr(base, name) * (1.0 + float(random.choice([-1, 1])) * random.uniform(0.3, 1.0) * off)
                for name, off in (("omega", 0.05), ("zeta", 0.2), ("kt", 0.2), ("kn", 0.2))}  # fmt: skip
    return Plan(seed, "none", direction, immersion, base, believed, {}, {}, tests, replace(sensors, hum=0.0))


def _number(text: str) -> tuple[float, str]:
    value, unit = text.split(" ", 1)
    return float(value), unit


def _scaled(text: str, factor: float, unit: str = "") -> str:
    value, own = _number(text)
    return f"{value * factor:.9g} {unit or own}"


def misstate(folder: Path, kind: str, draw: Any, flutes: int) -> str:
    """Write one condition of the campaign in a folder wrongly, and say how: stated over true."""
    yaml = YAML()
    campaign, model = (yaml.load((folder / name).read_text()) for name in ("campaign.yaml", "model.yaml"))
    records, told = campaign["records"], ""
    if kind == "feed":
        how = FEEDS[draw.integers(len(FEEDS))]
        for one in records:
            value, unit = _number(one["feed"])
            tooth = value / (flutes if unit == "mm/rev" else 1)
            one["feed"] = (f"{tooth * flutes:.9g} mm/tooth" if how == "revolution as tooth" else
                           f"{tooth:.9g} mm/rev" if how == "tooth as revolution" else f"{tooth * how:.9g} mm/tooth")
        told = str(how)
    elif kind == "flutes":
        others = [n for n in range(1, 7) if n != flutes]
        other = int(others[draw.integers(len(others))])
        model["cutter"]["flutes"], told = other, f"{other} for {flutes}"
    elif kind == "rate":
        factor = RATES[draw.integers(len(RATES))]
        campaign["sampling_rate"], told = _scaled(str(campaign["sampling_rate"]), factor), f"{factor:.4g}"
    elif kind in ("speed", "depth"):
        factors = SPEEDS if kind == "speed" else DEPTHS
        factor = factors[draw.integers(len(factors))]
        key = {"speed": "spindle_speed", "depth": "depth_of_cut"}[kind]
        for one in records:
            one[key] = _scaled(one[key], factor)
        told = f"{factor:.4g}"
    elif kind == "mass":
        factor = (10.0, 0.1)[draw.integers(2)]
        model["structure"]["mass"], told = _scaled(model["structure"]["mass"], factor), f"{factor:g}"
    else:
        factor = (1e-3, 1e3)[draw.integers(2)]
        for name in ("tangential_coefficient", "normal_coefficient"):
            model["cutting"][name] = _scaled(model["cutting"][name], factor)
        told = f"{factor:g}"
    for name, content in (("campaign.yaml", campaign), ("model.yaml", model)):
        yaml.dump(content, folder / name)
    return told


def prepared(job: tuple[int, str], folder: Path) -> str:
    """The campaign of a seed with a condition of this kind wrong, as files in a folder; how it is wrong."""
    seed, kind = job
    draw = np.random.default_rng([1908, seed])
    unmarked = kind in ("rate", "speed")
    plan = plain(seed, 2 if kind == "feed" else 1, False if unmarked else None)
    if kind == "rate":
        plan = replace(plan, sensors=replace(plan.sensors, form="csv"))
    plan = replace(plan, sensors=replace(plan.sensors, feed_form="tooth" if kind == "feed" else plan.sensors.feed_form))
    write(plan, folder)
    return misstate(folder, kind, draw, plan.base.flutes)


def told(seed: int) -> dict[str, Any]:
    """What `testbed diagnose` says of the campaign of a seed, whose kind follows from it."""
    kind = EACH[(seed - FIRST) % len(EACH)]
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        answer: dict[str, Any] = {"seed": seed, "kind": kind, "how": prepared((seed, kind), folder), "effects": [], "said": ""}
        environment = os.environ | {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
        before = resource.getrusage(resource.RUSAGE_CHILDREN).ru_utime
        done = subprocess.run([sys.executable, "-m", "testbed", "diagnose", "campaign.yaml", "-m", "model.yaml", "--json",
                               "answer.json"], cwd=folder, env=environment, capture_output=True, text=True,
                              preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_CPU, (SECONDS, SECONDS)))  # fmt: skip
        answer["processor"] = resource.getrusage(resource.RUSAGE_CHILDREN).ru_utime - before
        if not (folder / "answer.json").exists():
            refused = done.returncode == 2
            return answer | {"verdict": "refused" if refused else "no answer", "said": done.stderr.strip()[-500:]}
        found = json.loads((folder / "answer.json").read_text())
        return answer | {"verdict": found["verdict"], "effects": found["effects"], "error": found["error"],
                         "said": " ".join([found["sentence"], *found["notes"]])}


def named(answer: dict[str, Any]) -> bool:
    """Whether the answer says which condition is to be checked; speed and sampling rate cannot be told apart, and are one."""
    return any(word in answer["said"] for word in KINDS[answer["kind"]][0]) and not answer["effects"]


def check() -> Section:
    """The committed answers, counted."""
    answers = [json.loads(line) for line in RESULTS.read_text().splitlines()]
    hits, effects = [named(one) for one in answers], [one for one in answers if one["effects"]]
    silent = [one for one, hit in zip(answers, hits, strict=True) if not hit and not one["effects"]]
    rows = tuple((str(one["seed"]), one["kind"], one["how"], one["verdict"], "yes" if hit else "no",
                  " + ".join(one["effects"]) or "none", f"{one['processor']:.0f} s")
                 for one, hit in zip(answers, hits, strict=True))
    # a few campaigns judge nothing
    of_all = sum(hits) >= 0.95 * len(hits) if len(hits) >= len(EACH) else None
    return Section(
        "A condition written down wrongly in all records, by `testbed diagnose`",
        (Claim("named as such, no effect beside it", f">= 95 % of {len(EACH)}", f"{sum(hits)} of {len(hits)}", of_all),
         Claim("an effect is named", "0", str(len(effects)), False if effects else None if of_all is None else True),
         Claim("neither", "told", str(len(silent)), None)),
        (("Campaign by campaign (written over true)",
          ("seed", "condition", "how", "verdict", "named", "effects", "processor"), rows),),
        remark=REMARK)


def main(arguments: list[str]) -> int:
    """Ask the seeds whose answers are not known yet."""
    options = options_of(arguments, __doc__, len(EACH), FIRST)
    known = known_seeds(RESULTS)
    seeds = [seed for seed in range(options.first, options.first + options.count) if seed not in known]
    for one in answered(told, seeds, RESULTS, options.workers):
        print(f"{one['kind']} {one['how']} -> {one['verdict']} {'named' if named(one) else ''} {one['effects']}", flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
