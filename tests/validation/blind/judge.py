"""Diagnose blind campaigns and count:  python -m tests.validation.blind.judge [--count N] [--first SEED] [--workers N]

Every campaign's answer is one line of results.jsonl, of seeds from 4000 on of anywhere.jsonl, from 6000 on of faint.jsonl,
written when it is known, so that a stopped run goes on where it was.
"""

from __future__ import annotations

import os

for _threads in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
    os.environ.setdefault(_threads, "1")

import argparse
import json
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from pathlib import Path
from types import SimpleNamespace
from typing import Any

from testbed.analysis.fit.estimates import estimates
from testbed.analysis.fit.held_out import held_out_errors, pooled
from testbed.analysis.fit.model_fit import model_fit
from testbed.analysis.fit.observe import observe
from testbed.analysis.search.candidate import Candidate
from testbed.analysis.search.diagnose import diagnose
from testbed.analysis.search.diagnosis import Diagnosis
from testbed.catalogue import catalogue
from testbed.engines import predict
from tests.validation.blind.draw import draw
from tests.validation.blind.make import records_of

FOLDER = Path(__file__).resolve().parent
RESULTS = FOLDER / "results.jsonl"
ELSEWHERE = FOLDER / "anywhere.jsonl"
ANYWHERE = 4000  # seeds from here on are of machines of any workshop, those before of the published rig
FAINTLY = FOLDER / "faint.jsonl"
FAINT = 6000  # seeds from here on hide an effect that is hardly visible, or none, on the published rig
ENGINE = SimpleNamespace(predict_cuts=predict.predict_cuts, predict_driven=predict.predict_driven)


def drawn(seed: int) -> tuple[Any, Any, Any]:
    """(the product's catalogue, that which campaigns are made with, the truth of one)."""
    known, makers = catalogue(), catalogue(str(FOLDER / "laws"))
    laws = {name: name for name in makers if name not in known}
    return known, makers, draw(seed, makers, laws, anywhere=ANYWHERE <= seed < FAINT, faint=seed >= FAINT)


def judged(seed: int) -> dict[str, Any]:
    """One campaign made, diagnosed and compared with its truth. Effects of the diagnosis come from the product's catalogue."""
    known, makers, truth = drawn(seed)
    told = {"seed": seed, "kind": truth.kind, "hidden": {name: dict(values) for name, values in truth.effects.items()},
            "noise": truth.noise, "tachometer": truth.tachometer, "flutes": truth.model.cutter.flutes,
            "records": len(truth.tests)}
    try:
        records = records_of(truth, makers)
    except ValueError as problem:
        return told | {"made": False, "reason": str(problem)}
    try:
        return told | _diagnosed(truth, records, known)
    except Exception as problem:  # a fault is a result of this benchmark, and must not end it
        return told | {"made": True, "fault": repr(problem)}


def said(found: Diagnosis) -> dict[str, Any]:
    """What a diagnosis says, as it is counted."""
    return {"verdict": found.verdict, "effects": list(found.effects), "baseline": found.baseline,
            "with_effects": found.with_effects, "noise_floor": found.noise_floor,
            "other_law": None if found.form is None else found.form.as_json()}


def beside_the_truth(best: Candidate, known: Any, true: Callable[[str, float], float | None]) -> dict[str, Any]:
    """The parameters of a set of effects as found, each with its true value. true: of a path, near the value found."""
    return {path: {"value": one.value, "low": one.low, "high": one.high, "true": true(path, one.value)}
            for path, one in estimates(best.fitter, best.fit, known).items() if path != "mark_angle"}


def _diagnosed(truth: Any, records: Any, known: Any) -> dict[str, Any]:
    begin, processor = time.perf_counter(), time.process_time()
    observed = [observe(record, truth.believed) for record in records]
    found = diagnose(ENGINE, observed, truth.believed, known)
    told = {"made": True, "seconds": time.perf_counter() - begin, "processor": time.process_time() - processor} | said(found)
    if truth.seed >= FAINT:  # by what the answer came about
        told["candidates"] = [{"effects": list(one.effects), "delta_bic": one.delta_bic, "error_held_out": one.error_held_out}
                              for one in found.fitted]
    if isinstance(found.best, Candidate):
        told["parameters"] = beside_the_truth(found.best, known, lambda path, _: _true(truth, path))
    if truth.kind == "pair":
        told["alone"] = {name: _left_by(name, truth, observed, known) for name in truth.effects}
    return told


def _left_by(name: str, truth: Any, observed: Any, known: Any) -> float:
    """Error over noise floor of the fit that begins at the truth without the other effect: is that one visible at all?"""
    model = truth.believed.with_effect(name, **truth.effects[name])
    error, noise = pooled(held_out_errors(*model_fit(ENGINE, observed, model, known)))
    return error / noise


def _true(truth: Any, path: str) -> float | None:
    try:
        return float(truth.model.value(path))
    except (KeyError, AttributeError, ValueError):
        return None


def known_seeds(path: Path) -> set[int]:
    """The seeds that a file of answers holds, one a line; none where there is no file yet."""
    return {json.loads(line)["seed"] for line in path.read_text().splitlines()} if path.exists() else set()


def answered(
    answer: Callable[[int], dict[str, Any]], seeds: Sequence[int], path: Path, workers: int
) -> Iterator[dict[str, Any]]:
    """The answers on seeds as they come, each written to the file first, its number and seed printed."""
    with ProcessPoolExecutor(workers) as pool, path.open("a") as file:
        for number, done in enumerate(as_completed([pool.submit(answer, seed) for seed in seeds]), 1):
            told = done.result()
            file.write(json.dumps(told) + "\n")
            file.flush()
            print(f"{number}/{len(seeds)} seed {told['seed']} ", end="")
            yield told


def options_of(arguments: list[str], about: str | None, count: int, first: int) -> argparse.Namespace:
    """How many seeds are asked for, from which on, by how many workers; about: what --help says."""
    parser = argparse.ArgumentParser(description=about)
    parser.add_argument("--count", type=int, default=count)
    parser.add_argument("--first", type=int, default=first)
    parser.add_argument("--workers", type=int, default=2)
    return parser.parse_args(arguments)


def main(arguments: list[str]) -> int:
    """Judge the seeds whose answers are not known yet."""
    options = options_of(arguments, __doc__, 200, 1000)
    results = RESULTS if options.first < ANYWHERE else ELSEWHERE if options.first < FAINT else FAINTLY
    known = known_seeds(results)
    seeds = [seed for seed in range(options.first, options.first + options.count) if seed not in known]
    for told in answered(judged, seeds, results, options.workers):
        print(f"{told['kind']} {list(told['hidden'])} -> {told.get('verdict', told.get('reason'))} {told.get('effects', '')}",
              flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
