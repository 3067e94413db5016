"""Golden traces: how some campaigns walk through the diagnosis, kept, so that a change of it is compared step by step.

    python -m tests.validation.golden                       compare with golden.jsonl; exit code 1 where a verdict changed
    python -m tests.validation.golden --write               keep what is found now, in place of what was kept
    python -m tests.validation.golden --only "blind 3002"   some campaigns alone; the text may be part of a name
    python -m tests.validation.golden --without best_half   an ablation: without a move of the fit

A trace has the verdict, each step of the search (effects, cost, errors, gain in BIC, the moves of the fit that helped), the
parameters of the best set, the simulations of every record that were spent, and what the search said on its way. The campaigns:
cheap ones, another cause each, so that all of them take some minutes on two cores. Add others to the tuples below, and write.
"""

from __future__ import annotations

import os

for _threads in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
    os.environ.setdefault(_threads, "1")

import argparse
import json
import sys
import tempfile
import time
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import Any

from testbed.analysis.fit.budget import BUDGET, Budgeted
from testbed.analysis.fit.moves import every_move
from testbed.analysis.fit.observe import observe
from testbed.analysis.search.candidate import Candidate, Tried
from testbed.analysis.search.diagnose import diagnose
from testbed.catalogue import catalogue
from testbed.files.campaign import load_campaign
from testbed.files.model_file import read_model
from tests.validation.blind.judge import ENGINE, drawn
from tests.validation.blind.make import records_of
from tests.validation.outside import files, plan

KEPT = Path(__file__).with_suffix(".jsonl")
BLIND = (3002, 3006, 3010, 3024, 3032)  # 3000 on: the published rig; 4000: any machine
OUTSIDE = (106,)
CAMPAIGNS = tuple(f"blind {seed}" for seed in BLIND) + tuple(f"outside {seed}" for seed in OUTSIDE)
SAME = 1e-6  # relative: beyond rounding, short of any step of a fit
DIGITS = 9  # significant, of what is kept


def trace_of(name: str) -> dict[str, Any]:
    """The trace of one campaign by its name, `blind SEED` or `outside SEED`."""
    maker, _, seed = name.partition(" ")
    begin = time.process_time()
    model, records = _blind(int(seed)) if maker == "blind" else _outside(int(seed))
    known, said = catalogue(), list[str]()
    observed = [observe(record, model) for record in records]
    counted = Budgeted(ENGINE, observed, BUDGET)  # diagnose counts for itself, and ends there
    found = diagnose(counted, observed, model, known, progress=said.append)
    return {"campaign": name, "verdict": found.verdict, "effects": list(found.effects), "steps": list(map(_step, found.steps)),
            "parameters": _parameters(found.best),
            "noise_floor": _rounded(found.noise_floor), "simulations": round(counted.spent),
            "said": [text for text in said if "simulations" not in text], "processor": round(time.process_time() - begin, 1)}


def _blind(seed: int) -> tuple[Any, Sequence[Any]]:
    _, makers, truth = drawn(seed)
    return truth.believed, records_of(truth, makers)


def _outside(seed: int) -> tuple[Any, Sequence[Any]]:
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        files.write(plan.draw(seed), folder)
        return read_model(folder / "model.yaml", catalogue()), load_campaign(folder / "campaign.yaml").records


def _step(one: Tried) -> dict[str, Any]:
    cost = one.fit.cost if isinstance(one, Candidate) else float("nan")
    numbers = {"cost": cost, "error_fit": one.error_fit, "error_held_out": one.error_held_out, "delta_bic": one.delta_bic}
    helped = list(one.fit.helped) if isinstance(one, Candidate) else []
    return {"effects": list(one.effects), **{key: _rounded(value) for key, value in numbers.items()}, "moves": helped}


def _parameters(one: Tried) -> dict[str, float]:
    """Every parameter that was free in the fit, and all of the effects named."""
    if not isinstance(one, Candidate):
        return {}
    model = one.fit.state.model
    free = [path for path in one.fit.names if path in model.base_parameters]
    effects = [f"{name}.{key}" for name, values in model.effects.items() for key in values]
    return {path: _rounded(model.value(path)) for path in (*free, *effects)}


def _rounded(value: float) -> float:
    return float(f"{value:.{DIGITS}g}")


def differences(kept: Mapping[str, Any], now: Mapping[str, Any]) -> list[str]:
    """What of a trace is another, in words, the gravest first; empty where nothing is."""
    found = [f"{key}: {kept[key]} -> {now[key]}" for key in ("verdict", "effects") if kept[key] != now[key]]
    ways = [[step["effects"] for step in one["steps"]] for one in (kept, now)]
    if ways[0] != ways[1]:
        found.append(f"steps: {ways[0]} -> {ways[1]}")
    else:
        found += [f"step {place}, {key}: {step[key]:g} -> {other[key]:g}"
                  for place, (step, other) in enumerate(zip(kept["steps"], now["steps"], strict=True))
                  for key in ("cost", "error_fit", "error_held_out", "delta_bic") if not _same(step[key], other[key])]
        found += [f"step {place}, moves that helped: {step['moves']} -> {other['moves']}"
                  for place, (step, other) in enumerate(zip(kept["steps"], now["steps"], strict=True))
                  if step.get("moves", other["moves"]) != other["moves"]]  # a trace that was kept before has none
    paths = sorted(kept["parameters"].keys() | now["parameters"].keys())
    values = [(path, *(one["parameters"].get(path, float("nan")) for one in (kept, now))) for path in paths]
    found += [f"{path}: {value:g} -> {other:g}" for path, value, other in values if not _same(value, other)]
    place = next((place for place, pair in enumerate(zip(kept["said"], now["said"], strict=False)) if pair[0] != pair[1]), None)
    if place is not None or len(kept["said"]) != len(now["said"]):
        place = min(len(kept["said"]), len(now["said"])) if place is None else place
        ends = [(one["said"][place : place + 1] or ["the end"])[0] for one in (kept, now)]
        found.append(f"the way, from its step {place + 1} on: {ends[0]} -> {ends[1]}")
    return found


def _same(one: float, other: float) -> bool:
    return one == other or one != one and other != other or abs(one - other) <= SAME * max(abs(one), abs(other))


def leave_out(move: str) -> None:
    """Take a move out of every scheme of the fit, in this process."""
    if move:
        del every_move()[move]


def _traces(names: Sequence[str], workers: int, without: str) -> Iterator[dict[str, Any]]:
    with ProcessPoolExecutor(workers, initializer=leave_out, initargs=(without,)) as pool:
        yield from pool.map(trace_of, names)


def main(arguments: list[str]) -> int:
    """Compare, or write; 1 where a verdict or a name changed."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--write", action="store_true")
    parser.add_argument("--only", default="")
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--without", default="", choices=sorted(every_move()), metavar="MOVE")
    options = parser.parse_args(arguments)
    kept = {one["campaign"]: one for one in map(json.loads, KEPT.read_text().splitlines())} if KEPT.exists() else {}
    names = [name for name in CAMPAIGNS if options.only in name]
    changed, alike, spent = [], 0, [0.0, 0.0]
    for now in _traces(names, options.workers, options.without):
        name = now["campaign"]
        before = kept.get(name)
        other = ["new"] if before is None else differences(before, now)
        answer = f"{now['verdict']} {'+'.join(now['effects'])}, {now['processor']:.0f} s"
        print(f"{name}: {answer}: {'; '.join(other[:6]) or 'the same'}", flush=True)
        if before is not None:
            spent = [spent[0] + before["simulations"], spent[1] + now["simulations"]]
            alike += not other
            changed += [name] if before["verdict"] != now["verdict"] or before["effects"] != now["effects"] else []
        if options.write:
            kept[name] = now
            KEPT.write_text("".join(json.dumps(kept[one]) + "\n" for one in CAMPAIGNS if one in kept))
    print(f"{alike} of {len(names)} the same; verdict or name changed: {', '.join(changed) or 'none'}; "
          f"simulations {spent[0]:.0f} -> {spent[1]:.0f}")
    return 0 if options.write or not changed else 1


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
