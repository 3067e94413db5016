"""Judge the commands on outside campaigns:  python -m tests.validation.outside.judge [--count N] [--first SEED] [--workers N]

Each campaign is written as files into a folder that is removed again; `testbed diagnose` is asked what is missing,
`testbed add` adds what it named, `testbed compare` fits what it called complete. An answer is a line of
results.jsonl, so that a stopped run goes on where it was.
"""

from __future__ import annotations

import json
import os
import resource
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

from tests.validation.blind.judge import answered, known_seeds, options_of
from tests.validation.outside.files import write
from tests.validation.outside.plan import Plan, draw
from tests.validation.outside.simulator import TURN

RESULTS = Path(__file__).with_name("results.jsonl")
BASE = {"natural_frequency": "omega", "damping_ratio": "zeta", "tangential_coefficient": "kt", "normal_coefficient": "kn"}


def command(folder: Path, *arguments: str) -> tuple[dict[str, Any], float]:
    """(answer, processor seconds) of a `testbed` command run in a folder. RuntimeError with its last lines where it failed."""
    environment = os.environ | {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    done = subprocess.run([sys.executable, "-m", "testbed", *arguments, "--json", "answer.json"], cwd=folder, env=environment,
                          capture_output=True, text=True)  # fmt: skip
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    if done.returncode:
        raise RuntimeError(f"testbed {arguments[0]} ended with {done.returncode}: {done.stderr[-300:].strip()}")
    taken = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return json.loads((folder / "answer.json").read_text()), taken


def judged(seed: int) -> dict[str, Any]:
    """One campaign written, diagnosed and compared with its truth."""
    plan = draw(seed)
    hidden = plan.hidden or {name: {"strength": value} for name, value in plan.law.items()}
    told = {"seed": seed, "kind": plan.kind, "hidden": hidden,
            "noise": plan.sensors.noise, "tachometer": plan.sensors.tachometer != "none", "flutes": plan.base.flutes,
            "records": len(plan.tests), "made": True}  # fmt: skip
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        write(plan, folder)
        try:
            return told | _asked(plan, folder)
        except RuntimeError as problem:  # a fault is a result, and must not end the run
            return told | {"fault": str(problem)}


def _asked(plan: Plan, folder: Path) -> dict[str, Any]:
    """What the commands answer; errors are of records left out of the fit."""
    found, taken = command(folder, "diagnose", "campaign.yaml", "-m", "model.yaml")
    error, named = found["error"], found["effects"]
    told = {"processor": taken, "verdict": found["verdict"], "effects": named, "baseline": error["baseline"],
            "with_effects": error["with_effects"], "noise_floor": error["noise_floor"], "other_law": found["other_law"]}
    if named and found["verdict"] == "missing_effect":
        fitted, _ = command(folder, "add", *named, "-m", "model.yaml", "-c", "campaign.yaml", "-o", "with.yaml")
        told["added"] = fitted["error"]["after"]
    else:
        fitted, _ = command(folder, "compare", "campaign.yaml", "-m", "model.yaml")
    told["parameters"] = {
        path: {"value": one["value"], "low": one["low"], "high": one["high"], "true": true_value(plan, path, one["value"])}
        for path, one in fitted["parameters"].items() if one["low"] is not None
    }
    if plan.kind == "pair":
        told["alone"] = {name: _left_by(plan, name, folder) for name in plan.hidden}
    return told


def _left_by(plan: Plan, name: str, folder: Path) -> float:
    """Error over noise of the fit that begins at the truth without the other effect: is that one visible at all?"""
    model = (folder / "model.yaml").read_text()
    known = next(one for one in command(folder, "effects")[0]["effects"] if one["name"] == name)
    units = {one["name"]: "" if one["unit"] == "1" else f" {one['unit']}" for one in known["parameters"]}
    values = {one["name"]: plan.hidden[name].get(one["name"], one["example"]) for one in known["parameters"]}
    lines = "".join(f"    {parameter}: {value!r}{units[parameter]}\n" for parameter, value in values.items())
    (folder / "alone.yaml").write_text(f"{model}effects:\n  {name}:\n{lines}")
    found, _ = command(folder, "compare", "campaign.yaml", "-m", "alone.yaml")
    return found["error"] / found["noise_floor"]


def true_value(plan: Plan, path: str, found: float) -> float | None:
    """A parameter's true value by the product's name, where the campaign has one.

    Which tooth is the first is not measured: the angle of a runout is that of the tooth by which it comes nearest to `found`.
    """
    if path in BASE:
        return getattr(plan.base, BASE[path]) / (TURN if path == "natural_frequency" else 1.0)
    effect, _, parameter = path.partition(".")
    true = plan.hidden.get(effect, {}).get(parameter)
    if true is None or path != "runout.angle":
        return true
    pitch = TURN / plan.base.flutes
    return true + round((found - true) / pitch) * pitch


def main(arguments: list[str]) -> int:
    """Judge the seeds whose answers are not known yet."""
    options = options_of(arguments, __doc__, 40, 1)
    known = known_seeds(RESULTS)
    seeds = [seed for seed in range(options.first, options.first + options.count) if seed not in known]
    for told in answered(judged, seeds, RESULTS, options.workers):
        answer = f"{told.get('verdict', told.get('fault'))} {told.get('effects', '')}"
        print(f"{told['kind']} {list(told['hidden'])} -> {answer}", flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
