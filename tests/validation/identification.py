"""Identification from three stable cuts that MuJoCo made, with and without noise, scored against the truth."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from testbed.analysis.information import Z_95
from testbed.analysis.multipliers.identify import identify
from testbed.cut import Cut, whole_cut_sampling
from testbed.engines import mujoco_engine
from testbed.recording import Recording
from tests.validation.claims import GAMMA, MASS, PAPER, Claim, Section, rpm

RATE = 12800.0
TESTS = ((3810, 2.9), (2850, 2.9), (4100, 2.0))
NOISE = 0.5e-6  # m
COUNTS = 2e-3 / 2**16  # m, one of the 16-bit counts over +-1 mm
# the paper's starting guess: omega 930 rad/s, Gamma1 5e8; damping as one reads it off any decay
START = replace(PAPER, structure=replace(PAPER.structure, natural_frequency=930 / (2 * math.pi), damping_ratio=0.005),
                cutting=replace(PAPER.cutting, tangential_coefficient=5e8 * MASS, normal_coefficient=1.5e8 * MASS))
TRUTH = {"natural_frequency": 921.1 / (2 * math.pi), "damping_ratio": 0.0032, "tangential_coefficient": GAMMA * MASS}


def clean_records(steps: int | None = 60) -> list[tuple[Recording, Cut]]:
    """The three cuts without noise, from rest at a step entry, with marks."""
    records = []
    for speed, depth in TESTS:
        cut = rpm(speed, depth, idle_passes=10, passes=60, ring_down_passes=5)
        records.append((mujoco_engine.simulate(PAPER, cut, whole_cut_sampling(cut, 1, RATE), steps=steps), cut))
    return records


def noisy(records: list[tuple[Recording, Cut]], noise: float, seed: int) -> list[tuple[Recording, Cut]]:
    """The records as a 16-bit sensor with white noise and an offset gives them; marks lag by an unknown angle."""
    random = np.random.default_rng([2006, seed])
    result = []
    for recording, cut in records:
        clean = recording.channels["displacement"]
        signal = clean + noise * random.standard_normal(clean.size) + 3e-6 * random.standard_normal()
        lag = random.uniform(0.0, 2 * math.pi) / cut.spindle_speed
        result.append((replace(recording, channels={"displacement": np.round(signal / COUNTS) * COUNTS},
                               marks=recording.marks + lag), cut))
    return result


def errors(records: list[tuple[Recording, Cut]]) -> dict[str, tuple[float, bool, float]]:
    """Relative error of every parameter, whether its interval holds the truth, and the relative sigma it states."""
    found = identify(START, records).parameters
    return {name: (found[name].value / truth - 1.0, found[name].low <= truth <= found[name].high,
                   (found[name].high - found[name].low) / (2 * Z_95 * truth))
            for name, truth in TRUTH.items()}


def check(seeds: int = 100) -> Section:
    """The section of the table."""
    records = clean_records()
    free = errors(records)
    results, failures = [], []
    for seed in range(seeds):
        try:
            results.append(errors(noisy(records, NOISE, seed)))
        except (ValueError, ArithmeticError) as problem:
            failures.append(f"seed {seed}: {problem}")
    rows, claims = [], []
    # name, what the error is multiplied by, unit, targets without and with noise
    kinds = (("damping_ratio", "zeta", 100.0, " %", 1.0, 15.0), ("natural_frequency", "omega", 921.1, " rad/s", 0.1, 0.5),
             ("tangential_coefficient", "Gamma1", 100.0, " %", 0.5, 3.0))
    for name, symbol, scale, unit, clean, _ in kinds:
        value = abs(free[name][0]) * scale
        claims.append(Claim(f"{symbol} without noise", f"<= {clean:g}{unit}", f"{value:.2g}{unit}", bool(value <= clean)))
    for name, symbol, scale, unit, _, loud in kinds:
        all_errors = np.array([one[name][0] for one in results]) * scale
        rms, bias = float(np.sqrt(np.mean(all_errors**2))), float(all_errors.mean())
        stated = float(np.mean([one[name][2] for one in results])) * scale / all_errors.std(ddof=1)
        cover = 100.0 * sum(one[name][1] for one in results) / len(results)
        claims.append(Claim(f"{symbol}: rms error at 0.5 um, {seeds} seeds", f"<= {loud:g}{unit}", f"{rms:.2g}{unit}",
                            bool(rms <= loud)))
        claims.append(Claim(f"{symbol}: 95 % intervals that hold the truth", "90 to 99 %", f"{cover:.0f} %",
                            bool(90 <= cover <= 99), f"stated sigma over true spread: {stated:.2f}"))
        rows.append((symbol, f"{bias:+.2g}{unit}", f"{all_errors.std(ddof=1):.2g}{unit}", f"{rms:.2g}{unit}",
                     f"{cover:.0f} %"))
    claims.append(Claim("identifications that gave no answer", "0", str(len(failures)), not failures,
                        failures[0] if failures else ""))
    return Section("Identification from three stable cuts (made by MuJoCo, fitted by temporal elements)", tuple(claims),
                   ((f"0.5 um noise, 16 bits, {len(results)} seeds",
                     ("parameter", "bias", "spread", "rms", "coverage"), tuple(rows)),))
