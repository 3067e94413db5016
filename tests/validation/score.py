"""Identification under noise: three methods on the same sealed cuts that MuJoCo made, by `testbed score` itself.

The rig of the paper is cut once at each of six stable operating points, without noise; noise is added by the command, anew
for each identification. The fits use temporal elements and the fast engine: data and fits share no integration. Each
identification starts from a belief of its own, and has three or six of the cuts. A minute for the waveform fits and five for
the others, of two processors that have nothing else to do.
"""

from __future__ import annotations

import json
import tempfile
from pathlib import Path
from typing import Any

from testbed.cli import main
from tests.validation.claims import Claim, Section

REPEATS = 20
SCENARIO = """seed: 17
repeats: 1
model:
  structure: {mass: 2.573 kg, natural_frequency: 146.5976 Hz, damping_ratio: 0.0032}
  cutter: {flutes: 1, diameter: 19.05 mm}
  cutting: {immersion: 0.162, tangential_coefficient: 555.768 N/mm^2, normal_coefficient: 166.7304 N/mm^2}
cut: {feed: 0.1016 mm/tooth, idle: 10 rev, cutting: 60 rev, ring_down: 30 rev}
tests:
  - {spindle_speed: 3810 rpm, depth_of_cut: 2.9 mm}
  - {spindle_speed: 2850 rpm, depth_of_cut: 2.9 mm}
  - {spindle_speed: 4100 rpm, depth_of_cut: 2.0 mm}
  - {spindle_speed: 3300 rpm, depth_of_cut: 1.0 mm}
  - {spindle_speed: 2700 rpm, depth_of_cut: 1.5 mm}
  - {spindle_speed: 4300 rpm, depth_of_cut: 1.2 mm}
sensors:
  sampling_rate: 12800 Hz
  mark_angle: 40 deg
  displacement: {bits: 16, range: 1 mm}
engine: {name: mujoco}
"""


def _command(*arguments: object) -> None:
    try:
        main([str(argument) for argument in (*arguments, "--quiet")])
    except SystemExit as stop:
        if stop.code:
            raise RuntimeError(f"testbed {' '.join(map(str, arguments))} ended with {stop.code}") from None


def _scored(folder: Path, name: str, *arguments: object) -> dict[str, Any]:
    _command("score", folder / "cuts.h5", *arguments, "--seed", 3, "--json", folder / f"{name}.json")
    return json.loads((folder / f"{name}.json").read_text(encoding="utf-8"))


def check(repeats: int = REPEATS) -> Section:
    """The section of the table."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "cuts.yaml").write_text(SCENARIO, encoding="utf-8")
        _command("run", folder / "cuts.yaml", "-o", folder / "cuts.h5")
        noise = ("--noise", "0.5um,2um")
        quick = _scored(folder, "quick", *noise, "--method", "multipliers", "--method", "published", "--tests", "3,6",
                        "--repeats", repeats, "--workers", 2)
        again = _scored(folder, "again", "--noise", "0.5um", "--tests", 3, "--repeats", repeats, "--workers", 1)
        waveform = _scored(folder, "waveform", *noise, "--method", "waveform", "--tests", 3, "--repeats", repeats,
                           "--workers", 2)
    scores = quick["scores"] + waveform["scores"]
    return Section("Identification under noise, three methods on the same sealed cuts", _claims(scores, again["scores"]),
                   (_table(scores), _prices(quick["cost"] + waveform["cost"])))


def _of(scores: list[dict[str, Any]], **wanted: object) -> list[dict[str, Any]]:
    return [one for one in scores if all(one[key] == value for key, value in wanted.items())]


def _claims(scores: list[dict[str, Any]], again: list[dict[str, Any]]) -> tuple[Claim, ...]:
    claims = []
    for method in ("multipliers", "waveform"):
        own = _of(scores, method=method)
        inside = sum(one["coverage"] * (one["count"] - one["failures"]) for one in own if one["coverage"] is not None)
        given = sum(one["count"] - one["failures"] for one in own)
        share = inside / max(1, given)
        wide = [one["stated"] / one["rms"] for one in own if one["stated"] is not None and one["rms"]]
        claims.append(Claim(f"{method}: 95 % intervals that hold the truth", "90 to 99 %",
                            f"{inside:.0f} of {given}, {100 * share:.1f} %", bool(0.9 <= share <= 0.99),
                            f"the error they claim is {min(wide):.1f} to {max(wide):.1f} times the rms error" if wide else ""))
        each = _of(own, parameter="damping_ratio")
        failed = sum(one["failures"] for one in each)
        claims.append(Claim(f"{method}: identifications that gave no answer", "0",
                            f"{failed} of {sum(one['count'] for one in each)}", failed == 0,
                            "; ".join(reason for one in each for reason in one["reasons"][:1])))
    worst = []
    for one in _of(scores, method="multipliers"):
        paper = _of(scores, method="published", **{key: one[key] for key in ("parameter", "noise", "tests")})[0]
        if one["rms"] is not None and paper["rms"] is not None:
            worst.append(one["rms"] / paper["rms"])
    claims.append(Claim("multipliers with intervals against the paper's own way: rms error", "smaller in every case",
                        f"{min(worst):.2g} to {max(worst):.2g} times it", max(worst) < 1))
    same = again == _of(scores, method="multipliers", noise=5e-7, tests=3)
    claims.append(Claim("scores with one worker and with two", "equal bit by bit", "equal" if same else "they differ", same))
    return tuple(claims)


def _table(scores: list[dict[str, Any]]) -> tuple[str, tuple[str, ...], tuple[tuple[str, ...], ...]]:
    def share(one: dict[str, Any], key: str) -> str:
        return "-" if one[key] is None else f"{100 * one[key] / one['truth']:.2g} %"

    rows = tuple((one["parameter"], one["method"], str(one["tests"]), f"{one['noise'] * 1e6:g} um",
                  *(share(one, key) for key in ("bias", "spread", "rms", "stated")),
                  "-" if one["coverage"] is None else f"{100 * one['coverage']:.0f} %", f"{one['failures']} of {one['count']}")
                 for one in scores)
    return ("Errors in per cent of the truth", ("parameter", "method", "tests", "noise", "bias", "spread", "rms", "claimed",
                                                "coverage", "failed"), rows)


def _prices(cost: list[dict[str, Any]]) -> tuple[str, tuple[str, ...], tuple[tuple[str, ...], ...]]:
    rows = tuple((one["method"], str(one["tests"]), f"{one['noise'] * 1e6:g} um", f"{one['median']:.2g}") for one in cost)
    return "Processor time of one identification (s, median)", ("method", "tests", "noise", "s"), rows
