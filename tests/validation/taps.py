"""The tap test on machines that are known: blows with noise in, modes out, and what their stability limits are worth."""

from __future__ import annotations

import json
import math
import tempfile
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np

from testbed.analysis.tap.tap import TapResult, tap_test
from testbed.files.taps_file import load_taps
from testbed.machine import Mode
from tests.support.made_taps import B2, B3, Hammer, write_taps
from tests.support.real_data import MEASUREMENTS
from tests.validation.claims import Claim, Section, below

MACHINES = SENSORS = 50
CLOSE = 0.03  # of a frequency, that the modes of a close pair are apart
LEAST_FACTOR, MOST_FACTOR = 1.5, 1000.0  # of a scale that is wrong
NAMES = ("natural_frequency", "damping_ratio", "mass")
HALF_DOWN = (math.pi / 2, math.pi)  # rad, from entry to exit
TEETH, TANGENTIAL, NORMAL_SHARE = 2, 1319.4e6, 788.8 / 1319.4  # the cutter of B2


def random_machine(seed: int) -> tuple[list[Mode], Hammer]:
    """2 to 6 modes along x and y, half the machines with a close pair; 1 to 8 blows."""
    random = np.random.default_rng([77, seed])
    count = int(random.integers(2, 7))
    pair = seed % 2 == 0
    modes: list[Mode] = []
    while len(modes) < count:
        axis = 0.0 if len(modes) % 2 == 0 else math.pi / 2
        frequency = 10 ** random.uniform(math.log10(250.0), math.log10(2500.0))
        if pair and len(modes) == 2:
            frequency = modes[0].natural_frequency * (1.0 + CLOSE * random.uniform(0.7, 1.0))
        elif any(mode.direction == axis and abs(frequency / mode.natural_frequency - 1.0) < 0.1 for mode in modes):
            continue
        stiffness = 10 ** random.uniform(6.8, 7.6)
        damping = 10 ** random.uniform(-2.2, -1.4) if not (pair and len(modes) in (0, 2)) else 10 ** random.uniform(-2.2, -1.8)
        modes.append(Mode(stiffness / (2 * math.pi * frequency) ** 2, frequency, damping, axis, "tool"))
    return modes, Hammer(blows=1 + seed % 8, spacing=0.6)


def receptance(modes: Sequence[Any], frequency: np.ndarray) -> np.ndarray:
    """(lines, 2, 2), m/N, of modes with mass, natural_frequency (Hz), damping_ratio and shape."""
    s, total = 2j * np.pi * frequency, np.zeros((len(frequency), 2, 2), dtype=complex)
    for mode in modes:
        omega = 2 * np.pi * mode.natural_frequency
        answer = 1.0 / (mode.mass * (s**2 + 2 * mode.damping_ratio * omega * s + omega**2))
        total += answer[:, None, None] * np.outer(mode.shape, mode.shape)
    return total


def zeroth_order_limit(modes: Sequence[Any]) -> float:
    """Least depth (m) at which a half-immersion down-milling cut chatters at some speed, after Altintas and Budak (1995)."""
    def terms(t: float, share: float) -> np.ndarray:
        return np.array([[math.cos(2 * t) - 2 * share * t + share * math.sin(2 * t),
                          -math.sin(2 * t) - 2 * t + share * math.cos(2 * t)],
                         [-math.sin(2 * t) + 2 * t + share * math.cos(2 * t),
                          -math.cos(2 * t) - 2 * share * t - share * math.sin(2 * t)]])

    directional = 0.5 * (terms(HALF_DOWN[1], NORMAL_SHARE) - terms(HALF_DOWN[0], NORMAL_SHARE))
    frequency = np.concatenate([mode.natural_frequency * np.linspace(0.9, 1.3, 20001) for mode in modes])
    values = np.linalg.eigvals(directional @ receptance(modes, frequency))
    kappa = values.imag / values.real
    depth = -2 * math.pi * values.real * (1 + kappa**2) / (TEETH * TANGENTIAL) / np.abs(values) ** 2
    return float(depth[depth > 0].min())


def measured(modes: Sequence[Mode], hammer: Hammer, seed: int, pairs: str = "xx yy",
             signs: dict[str, float] | None = None) -> TapResult:
    """The tap test of blows on a machine."""
    with tempfile.TemporaryDirectory() as folder:
        return tap_test(load_taps(write_taps(Path(folder), modes, pairs, hammer, seed, signs)))


def matched(found: TapResult, modes: Sequence[Mode]) -> list[tuple[Any, Mode]]:
    """Found modes with the true ones they are, each once, the nearest of its direction."""
    left, pairs = list(found.modes), []
    for mode in modes:
        same = [one for one in left if abs(math.sin(one.direction.value - mode.direction)) < 0.5]
        if same:
            best = min(same, key=lambda one: abs(one.natural_frequency.value / mode.natural_frequency - 1.0))
            left.remove(best)
            pairs.append((best, mode))
    return pairs


def one(seed: int) -> dict[str, Any]:
    """A random machine: errors of its modes, intervals that hold, and of its limit."""
    modes, hammer = random_machine(seed)
    found = measured(modes, hammer, seed)
    pairs = matched(found, modes)
    errors = {name: [getattr(one, name).value / getattr(mode, name) - 1.0 for one, mode in pairs] for name in NAMES}
    held = [getattr(one, name).low <= getattr(mode, name) <= getattr(one, name).high for one, mode in pairs for name in NAMES]
    limit = zeroth_order_limit([one.mode() for one in found.modes]) / zeroth_order_limit(modes) - 1.0
    return {"seed": seed, "true": len(modes), "found": len(found.modes), "errors": errors, "held": held, "limit": limit,
            "blows": hammer.blows, "residual": found.residual}


def wrong(seed: int) -> dict[str, bool]:
    """A sensor of a machine of oblique modes turned round or of a wrong scale, the axes exchanged: whether each is told."""
    random = np.random.default_rng([78, seed])
    frequencies = np.cumprod(random.uniform(1.2, 1.6, 3)) * 400.0
    modes = [Mode(10 ** random.uniform(-1.0, 0.0), float(one), random.uniform(0.01, 0.03), random.uniform(-1.4, 1.4), "tool")
             for one in frequencies]
    hammer, axis = Hammer(blows=3, spacing=0.5), "xy"[seed % 2]
    turned = measured(modes, hammer, seed, "xx yy xy yx", {pair: -1.0 for pair in ("xx", "yy", "xy", "yx") if pair[1] == axis})
    straight = [Mode(mode.mass, mode.natural_frequency, mode.damping_ratio, 0.0, "tool") for mode in modes]
    plain = measured(straight, hammer, seed, "xx", {"xx": -1.0})
    with tempfile.TemporaryDirectory() as folder:
        path = write_taps(Path(folder), modes, "xx yy xy yx", hammer, seed)
        for one, other in (("xx", "xy"), ("yy", "yx")):
            places = [Path(folder) / f"{name}.csv" for name in (one, "spare", other)]
            places[0].rename(places[1])
            places[2].rename(places[0])
            places[1].rename(places[2])
        swapped = tap_test(load_taps(path))
    factor = math.exp(random.uniform(math.log(LEAST_FACTOR), math.log(MOST_FACTOR)) * random.choice([-1.0, 1.0]))
    scaled = {pairs: measured(modes, hammer, seed, pairs, {pair: factor for pair in pairs.split() if pair[1] == axis})
              for pairs in ("xx yy xy yx", "xx yy xy")}
    true = factor if axis == "y" else 1.0 / factor
    right = measured(modes, hammer, seed, "xx yy xy yx")
    return {"four": _scale_told(scaled["xx yy xy yx"], true), "three": _scale_told(scaled["xx yy xy"], true),
            "right": [check.agrees for check in right.scales] == [True] and _right(right, modes),
            "turned": _told(turned, "turned round") and _right(turned, modes),
            "alone": _told(plain, "turned round") and _right(plain, straight),
            "exchanged": _told(swapped, "exchanged") and _right(swapped, modes)}


def _scale_told(found: TapResult, factor: float) -> bool:
    """Whether the factor by which y reads too much against x is told within 10 %, and no mass is."""
    (check,) = found.scales
    return (check.agrees is False and abs(check.ratio.value / factor - 1.0) < 0.1
            and not any(mode.mass.determined for mode in found.modes))


def _told(found: TapResult, words: str) -> bool:
    return any(words in note for note in found.notes)


def _right(found: TapResult, modes: Sequence[Mode]) -> bool:
    true = sorted(modes, key=lambda mode: mode.natural_frequency)
    return len(found.modes) == len(true) and all(
        abs(one.natural_frequency.value / mode.natural_frequency - 1.0) < 1e-3
        and abs(one.mass.value / mode.mass - 1.0) < 0.05
        and abs(math.sin(one.direction.value - mode.direction)) < 0.05
        for one, mode in zip(found.modes, true, strict=True))


def _worst(found: TapResult, modes: Sequence[Mode]) -> tuple[float, float, float]:
    """Largest errors in frequency, damping and stiffness."""
    pairs = matched(found, modes)
    return (max(abs(one.natural_frequency.value / mode.natural_frequency - 1.0) for one, mode in pairs),
            max(abs(one.damping_ratio.value / mode.damping_ratio - 1.0) for one, mode in pairs),
            max(abs(one.mode().stiffness / mode.stiffness - 1.0) for one, mode in pairs))


def _published() -> list[Claim]:
    claims = []
    for name, modes in (("B2", B2), ("B3", B3)):
        found = measured(modes, Hammer(), 0)
        frequency, damping, stiffness = _worst(found, modes)
        limit = zeroth_order_limit([one.mode() for one in found.modes]) / zeroth_order_limit(modes) - 1.0
        claims += [Claim(f"{name}: modes", "4", str(len(found.modes)), len(found.modes) == 4),
                   below(f"{name}: natural frequencies", 100 * frequency, 0.1, " %"),
                   below(f"{name}: damping ratios", 100 * damping, 2.0, " %"),
                   below(f"{name}: stiffnesses", 100 * stiffness, 2.0, " %"),
                   below(f"{name}: least limit of a cut, zeroth order", 100 * abs(limit), 1.0, " %")]
    return claims


def _measured_tool() -> list[Claim]:
    """A measured tool (tap_test), by its hammer record and by its receptance: 300 to 3000 Hz."""
    if not (MEASUREMENTS / "tap_test").is_dir():
        return [Claim("measured tool: residual, record and receptance", "<= 9 %", "not measured", None, "tap_test is not here")]
    found = []
    for file, columns in (("impact_Point1_time.txt", "time: {column: 1, unit: s}, force: {column: 2, unit: N}, "
                           "response: {column: 3, unit: m/s^2}"),
                          ("FRF_Point_1.txt", "frequency: {column: 1, unit: Hz}, real: {column: 2, unit: m/N}, "
                           "imaginary: {column: 3, unit: m/N}")):
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "taps.yaml"
            path.write_text(f"folder: {json.dumps(str(MEASUREMENTS / 'tap_test'))}\nband: [300 Hz, 3000 Hz]\n"
                            f"taps: [{{file: {file}, direction: x, on: tool, {columns}}}]\n")
            found.append(tap_test(load_taps(path)))
    record, spectrum = found
    both = [(getattr(one, name), getattr(other, name)) for one, other in zip(record.modes, spectrum.modes, strict=False)
            for name in NAMES]
    alike = sum(max(one.low, other.low) <= min(one.high, other.high) for one, other in both)
    return [below("measured tool: residual, record and receptance", 100 * max(one.residual for one in found), 9.0, " %"),
            Claim("measured tool: modes", "5", " and ".join(str(len(one.modes)) for one in found),
                  all(len(one.modes) == 5 for one in found), "five real modes leave 10 % at the least, however weighed"),
            Claim("measured tool: intervals of record and receptance that overlap", f"{len(both)} of {len(both)}",
                  f"{alike} of {len(both)}", alike == len(both))]


def check() -> Section:
    """The section of VALIDATION.md."""
    with ProcessPoolExecutor(2) as pool:
        machines = list(pool.map(one, range(MACHINES)))
        sensors = list(pool.map(wrong, range(SENSORS)))
    return _section(machines, sensors)


def _section(machines: Sequence[dict[str, Any]], sensors: Sequence[dict[str, bool]]) -> Section:
    held = [inside for found in machines for inside in found["held"]]
    counted = sum(found["true"] == found["found"] for found in machines)
    share = 100 * sum(held) / len(held)
    claims = [*_published(), *_measured_tool(),
              Claim("random machines: number of modes right", f"{MACHINES} of {MACHINES}", f"{counted} of {MACHINES}",
                    counted == MACHINES),
              below("random machines: least limit of a cut", 100 * max(abs(one["limit"]) for one in machines), 2.0, " %"),
              Claim("random machines: 95 % intervals that hold the truth", "90 to 99 %", f"{share:.1f} %", 90 <= share <= 99,
                    f"{len(held)} intervals")]
    for name, said in (("turned", "told and mended: one axis' sensor turned round, four responses"),
                       ("alone", "told and mended: a sensor turned round, one response"),
                       ("exchanged", "told and mended: sensors' axes exchanged, four responses"),
                       ("four", "told: one axis' scale wrong, four responses"),
                       ("three", "told: one axis' scale wrong, one cross response"),
                       ("right", "nothing wrong, four responses: nothing told, modes right")):
        right = sum(found[name] for found in sensors)
        claims.append(Claim(said, f"{SENSORS} of {SENSORS}", f"{right} of {len(sensors)}",
                            right == len(sensors)))
    rows = [(str(found["seed"]), str(found["blows"]), f"{found['found']} of {found['true']}", f"{100 * found['limit']:.2f}",
             *(f"{100 * max(map(abs, found['errors'][name])):.3f}" for name in NAMES),
             f"{sum(found['held'])} of {len(found['held'])}") for found in machines]
    return Section("The tap test", tuple(claims), (("Random machines (errors in %, the largest of the machine)",
                   ("seed", "blows", "modes", "limit", "frequency", "damping", "mass", "intervals that hold"), tuple(rows)),),
                   "Blows with noise of 0.03 % of the peak in the force and 0.1 % in the response. 2 to 6 modes along x and y, "
                   "half the machines with a pair within 3 %, 1 to 8 blows. Scales wrong by 1.5 to 1000, either way. A factor "
                   "common to all responses is told by nothing, nor axes exchanged without cross responses.")
