"""What each move of the fit is worth, over a sample of blind and outside campaigns that nobody chose.

    python -m tests.validation.ablation                    walk the sample; a row of ablation.jsonl a campaign
    python -m tests.validation.ablation --without MOVE     walk those in which the move helped once more, without it
    python -m tests.validation.ablation --again N          walk those N anew that were walked longest ago
    python -m tests.validation.ablation --table            print what the rows say

The sample: every SIXTH blind campaign of the rig and of any workshop, and all outside ones, whose answers were kept before
(results.jsonl, anywhere.jsonl, outside/results.jsonl). A row says how often each move was asked, how often it helped, and by
how much the cost fell, in all fits of the search; a move that never helped has changed nothing, since a trial that is not kept
leaves the fit as it was. Guards of the search are counted likewise: how often each was asked, and gave another answer than
none, or than what it was given. A stopped run goes on where it was. Answers that were kept age while the search changes: a
campaign walked anew says whether its answer still holds.
"""

from __future__ import annotations

import os

for _threads in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
    os.environ.setdefault(_threads, "1")

import argparse
import json
import sys
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor, as_completed
from contextlib import ExitStack
from dataclasses import replace
from datetime import date
from functools import partial
from pathlib import Path
from typing import Any
from unittest import mock

from testbed.analysis.fit.moves import every_move
from testbed.analysis.fit.solve import Goal, Move, Trial
from testbed.analysis.search import candidate_round, diagnose, forward_search, score_test, weak_effects
from tests.validation import outside
from tests.validation.blind import judge
from tests.validation.golden import leave_out, trace_of

ROWS = Path(__file__).with_suffix(".jsonl")
SIXTH = 6
MAKERS = ((judge.RESULTS, "blind", SIXTH), (judge.ELSEWHERE, "blind", SIXTH),
          (Path(outside.__file__).with_name("results.jsonl"), "outside", 1))  # fmt: skip


def sample() -> dict[str, dict[str, Any]]:
    """The campaigns, by name, each with the answer that was kept of it."""
    found = {}
    for path, maker, step in MAKERS:
        rows = sorted((row for row in map(json.loads, path.read_text().splitlines()) if row.get("made")),
                      key=lambda row: row["seed"])
        found |= {f"{maker} {row['seed']}": row for row in rows[::step]}
    return found


def counted(name: str, move: Move, into: dict[str, list[float]]) -> Move:
    """The move, with a count: [asked, helped, by how much the cost fell]. A trial after which none is asked for was kept."""
    tally = into.setdefault(name, [0, 0, 0.0])

    def propose(fitter: Any, fit: Any, goal: Goal) -> Iterator[Trial]:
        tally[0] += 1
        for trial in move.propose(fitter, fit, goal):
            try:
                yield trial
            except GeneratorExit:
                tally[1] += 1
                tally[2] += fit.cost - trial.fit.cost
                return

    return replace(move, propose=propose)


def _another(given: tuple, found: Any) -> bool:
    return found is not given[0]


def _something(given: tuple, found: Any) -> bool:
    return any(one is not None for one in found) if isinstance(found, tuple) else bool(found)


def _other_end(given: tuple, found: Any) -> bool:
    return found.end.effects != given[0].end.effects


def _names_one(given: tuple, found: Any) -> bool:
    return found is not None and bool(found.end.effects)


def _exchange(given: tuple, found: Any) -> bool:
    return found[0] is not given[0] or bool(found[1])


def _rivals_tie(given: tuple, found: Any) -> bool:
    return bool(found[1])


# by module and name: whether an answer of this guard is a change of what it was given
GUARDS: dict[tuple[Any, str], Callable[[tuple, Any], bool]] = {
    **dict.fromkeys([(forward_search, name) for name in ("nesting_guard", "backward", "refit_from_prior", "reweighted")],
                    _another),
    **dict.fromkeys([(forward_search, name) for name in ("_with_finer_steps", "_switched", "_first_form")], _something),
    (forward_search, "exchanged"): _exchange, (forward_search, "with_rivals"): _rivals_tie,
    (forward_search, "with_weak_effect"): _other_end, (forward_search, "of_a_base_that_fits"): _names_one,
    **dict.fromkeys([(candidate_round, name) for name in ("_others_in_time", "no_swing", "_put")], _something),
    (weak_effects, "nesting_guard"): _another, (weak_effects, "hum_of"): _something,
    **dict.fromkeys([(diagnose, name) for name in ("missing_mode", "explained_otherwise", "_without_irregular", "contradicted",
                                                   "other_way", "_swung", "too_slow", "foretells_little")], _something),
    **dict.fromkeys([(diagnose, name) for name in ("_without_late", "instead_of", "with_odd_records", "restarted",
                                                   "with_form_asked", "of_a_machine", "never_nothing")], _another),
}  # fmt: skip


def _watched(room: Any, name: str, into: dict[str, list[int]]) -> Any:
    """A patch of one guard that counts [asked, changed something]."""
    tally = into.setdefault(f"{room.__name__.rpartition('.')[2]}.{name}", [0, 0])
    guard, changes = getattr(room, name), GUARDS[room, name]

    def asked(*given: Any, **more: Any) -> Any:
        found = guard(*given, **more)
        tally[0] += 1
        tally[1] += changes(given, found)
        return found

    return mock.patch.object(room, name, asked)


def _from_far(into: dict[str, list[int]]) -> Any:
    """The same of a candidate begun from far: whether it came lower."""
    tally, guard = into.setdefault("score_test.from_far", [0, 0]), score_test.from_far

    def asked(current: Any, entry: Any, *rest: Any, **more: Any) -> None:
        before = entry.reached
        guard(current, entry, *rest, **more)
        tally[0] += 1
        tally[1] += entry.reached < before

    return mock.patch.object(score_test, "from_far", asked)


def walked(name: str, without: str) -> dict[str, Any]:
    """One campaign's row."""
    moves, tallies, guards = every_move(), dict[str, list[float]](), dict[str, list[int]]()
    whole = dict(moves)
    leave_out(without)
    for one in list(moves):
        moves[one] = counted(one, moves[one], tallies)
    try:
        with ExitStack() as patches:
            for patch in (*(_watched(room, guard, guards) for room, guard in GUARDS), _from_far(guards)):
                patches.enter_context(patch)
            trace = trace_of(name)
    except Exception as fault:  # it is a result, and must not end the run
        return {"campaign": name, "without": without, "fault": repr(fault)}
    finally:
        moves.clear()
        moves.update(whole)
    costs = [step["cost"] for step in trace["steps"]]
    return {"campaign": name, "without": without, "verdict": trace["verdict"], "effects": trace["effects"],
            "cost": costs[-1] if costs else None, "simulations": trace["simulations"], "processor": trace["processor"],
            "day": date.today().isoformat(), "moves": {one: tally for one, tally in tallies.items() if tally[0]},
            "guards": {one: tally for one, tally in guards.items() if tally[0]}}


def rows() -> list[dict[str, Any]]:
    """What was found so far."""
    return list(map(json.loads, ROWS.read_text().splitlines())) if ROWS.exists() else []


def table() -> str:
    """By move: how often it was asked and helped; of campaigns walked without it, answers that changed, and simulations."""
    kept, found = sample(), rows()
    whole = {row["campaign"]: row for row in found if not row["without"] and "fault" not in row}
    same = [name for name, row in whole.items() if _answer(row) == _answer(kept[name])]
    lines = [f"{len(whole)} campaigns; the answer that was kept: {len(same)}",
             "| move | asked | helped | campaigns where it helped | without it: walked | other answer | simulations |",
             "| --- | --- | --- | --- | --- | --- | --- |"]
    for name in every_move():
        tallies = [row["moves"].get(name, [0, 0, 0.0]) for row in whole.values()]
        again = [row for row in found if row["without"] == name and row["campaign"] in whole and "fault" not in row]
        other = [row for row in again if _answer(row) != _answer(whole[row["campaign"]])]
        spent = sum(row["simulations"] for row in again), sum(whole[row["campaign"]]["simulations"] for row in again)
        lines.append(f"| {name} | {sum(one[0] for one in tallies):.0f} | {sum(one[1] for one in tallies):.0f} | "
                     f"{sum(one[1] > 0 for one in tallies)} | {len(again)} | {len(other)} | "
                     f"{f'{spent[1]:.0f} to {spent[0]:.0f}' if again else '-'} |")
    lines += ["", "| guard of the search | asked | changed something | campaigns where it did |", "| --- | --- | --- | --- |"]
    counted = [row["guards"] for row in whole.values() if "guards" in row]
    for name in sorted({name for row in counted for name in row}):
        tallies = [row.get(name, [0, 0]) for row in counted]
        lines.append(f"| {name} | {sum(one[0] for one in tallies)} | {sum(one[1] for one in tallies)} | "
                     f"{sum(one[1] > 0 for one in tallies)} |")
    changed = [f"{name}: {'+'.join(kept[name]['effects']) or kept[name]['verdict']} kept, "
               f"{'+'.join(row['effects']) or row['verdict']} now, hidden {'+'.join(kept[name]['hidden']) or 'nothing'}"
               for name, row in whole.items() if name not in same]
    return "\n".join([*lines, "", *changed])


def _answer(row: dict[str, Any]) -> tuple[str, frozenset[str]]:
    """The verdict, and what it names: of what stays unexplained, a row may hold what was tried."""
    return row["verdict"], frozenset(row["effects"] if row["verdict"] == "missing_effect" else ())


def main(arguments: list[str]) -> int:
    """Walk what is not walked yet, or print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--without", default="", choices=sorted(every_move()), metavar="MOVE")
    parser.add_argument("--only", default="", help="campaigns whose name has this text")
    parser.add_argument("--again", type=int, default=0, metavar="N", help="those N anew that were walked longest ago")
    parser.add_argument("--table", action="store_true")
    parser.add_argument("--workers", type=int, default=2)
    options = parser.parse_args(arguments)
    if options.table:
        print(table())
        return 0
    found = rows()
    done = {row["campaign"]: row.get("day", "") for row in found if row["without"] == options.without}
    names = [name for name in sample() if name not in done and options.only in name]
    if options.again:
        names = sorted((name for name in done if options.only in name), key=lambda name: done[name])[: options.again]
    if options.without:
        whole = {row["campaign"]: row.get("moves", {}) for row in found if not row["without"]}
        names = [name for name in names if whole.get(name, {}).get(options.without, [0, 0])[1]]
    with ProcessPoolExecutor(options.workers) as pool, ROWS.open("a") as file:
        for task in as_completed([pool.submit(partial(walked, without=options.without), name) for name in names]):
            row = task.result()
            file.write(json.dumps(row) + "\n")
            file.flush()
            print(*(row.get(key, "") for key in ("campaign", "verdict", "effects", "processor", "fault")), flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
