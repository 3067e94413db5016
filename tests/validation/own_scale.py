"""Machines of any scale and taps as they come: decays and driven records from 0.1 Hz to 20 kHz, turned sensors, several modes.

Decays are sums of damped cosines; driven records are each mode's exact state space for a force straight between its samples
(first-order hold), sampled eight times as finely as what is read; cuts are a plain Runge-Kutta's, their time stretched. None
shares code with the engine of the fit. Counted are draws that are right, said not to be determined, and wrong.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from types import SimpleNamespace

import numpy as np
from scipy.signal import cont2discrete, lfilter, ss2tf

from testbed.analysis.comparison.compare import compare
from testbed.analysis.fit.held_guesses import Held, with_guesses_held
from testbed.analysis.fit.model_fit import model_fit
from testbed.analysis.fit.observe import observe
from testbed.analysis.fit.record_hypotheses import taken_notes
from testbed.analysis.search.add_effect import add_effects
from testbed.analysis.search.diagnose import diagnose
from testbed.catalogue import catalogue
from testbed.engines import predict
from testbed.files.campaign import Record
from testbed.machine import Model, Structure
from testbed.recording import CHANNEL_UNITS, Recording
from tests.support import plain_cut
from tests.validation.claims import Claim, Section

ENGINE = SimpleNamespace(predict_cuts=predict.predict_cuts, predict_driven=predict.predict_driven)
DECAYS, DRIVEN, TURNED, PAIRS, THREES = 40, 30, 30, 30, 6
BLOW = 12  # samples that a blow lasts at the least: what a coarser one is between its samples, nobody knows
FINER = 8  # times the sampling rate at which a driven record is made
QUANTITIES = ("displacement", "velocity", "acceleration")
STRETCHES = (1.0, 100.0, 1.0 / 20.0)
CUTS = ((3810, 2.9e-3), (2850, 2.9e-3), (4300, 2.5e-3))  # rpm, m


@dataclass(frozen=True)
class Mode:
    """One mode: natural frequency (Hz), damping ratio, modal mass (kg) at the point that is driven and read."""

    frequency: float
    damping: float
    mass: float = 1.0

    @property
    def structure(self) -> Structure:
        """As a model has it."""
        return Structure(self.mass, self.frequency, self.damping)


def decaying(modes: Iterable[tuple[Mode, float, float]], rate: float, count: int) -> np.ndarray:
    """Free decay (samples,) of (mode, amplitude, phase) each."""
    time = np.arange(count) / rate
    found = np.zeros(count)
    for mode, amplitude, phase in modes:
        omega = 2 * math.pi * mode.frequency
        turned = omega * math.sqrt(1.0 - mode.damping**2) * time
        found += amplitude * np.exp(-mode.damping * omega * time) * np.cos(turned + phase)
    return found


def driven(modes: Iterable[Mode], force: np.ndarray, rate: float, quantity: str) -> np.ndarray:
    """Response (samples,) at the driven point, from rest, to a force straight between its samples."""
    found = np.zeros(len(force))
    for mode in modes:
        omega = 2 * math.pi * mode.frequency
        own = np.array([[0.0, 1.0], [-(omega**2), -2.0 * mode.damping * omega]])
        seen, through = {"displacement": ([1.0, 0.0], 0.0), "velocity": ([0.0, 1.0], 0.0),
                         "acceleration": (own[1], 1.0 / mode.mass)}[quantity]  # fmt: skip
        system = cont2discrete((own, np.array([[0.0], [1.0 / mode.mass]]), np.array([seen]), np.array([[through]])),
                               1.0 / rate, "foh")  # fmt: skip
        top, bottom = ss2tf(*system[:4])
        found += lfilter(top[0], bottom, force)
    return found


def force_of(rng: np.random.Generator, frequency: float, rate: float, count: int) -> np.ndarray:
    """A hammer's blow, or a shaker's sweep, about a frequency (Hz), at FINER times the rate."""
    time = np.arange(FINER * count) / (FINER * rate)
    if rng.random() < 0.7:
        past, width = time - time[-1] * rng.uniform(0.03, 0.1), max(rng.uniform(0.25, 0.5) / frequency, BLOW / rate)
        return np.where((past > 0.0) & (past < width), np.sin(math.pi * past / width) ** 2, 0.0)
    span, low, high = time[-1], 0.4 * frequency, 2.0 * frequency
    return np.sin(2 * math.pi * (low * time + 0.5 * (high - low) / span * time**2))


def record(name: str, kind: str, channels: dict[str, np.ndarray], rate: float) -> Record:
    """A record as a campaign reads it."""
    units = {channel: CHANNEL_UNITS[channel] for channel in channels}
    return Record(name, kind, Recording(channels, rate, units, "measured"))


def drawn_driven(rng: np.random.Generator, modes: list[Mode], rate: float, name: str, sign: float = 1.0) -> Record:
    """A driven record of these modes by one of the quantities, with noise of 0.1 to 3 %."""
    count, quantity = int(rng.choice([3000, 5000, 8000])), str(rng.choice(QUANTITIES))
    force = force_of(rng, modes[0].frequency, rate, count)
    values = sign * driven(modes, force, FINER * rate, quantity)[::FINER]
    values = values + 10 ** rng.uniform(-3.0, -1.5) * values.std() * rng.standard_normal(count)
    return record(name, "excited", {"force": force[::FINER], quantity: values}, rate)


def believed(rng: np.random.Generator, mode: Mode) -> Model:
    """A model that is a little off."""
    return Model(Structure(mode.mass * rng.uniform(0.8, 1.25), mode.frequency * rng.uniform(0.98, 1.02),
                           min(mode.damping * rng.uniform(0.5, 2.0), 0.3)))  # fmt: skip


def identified(records: list[Record], model: Model) -> tuple[Held, list[str]]:
    """The waveform fit as `identify` makes it, and its notes."""
    observed = [observe(one, model) for one in records]
    fitter, fit = model_fit(ENGINE, observed, model, catalogue())
    return with_guesses_held(fitter, fit, model, catalogue()), taken_notes(observed, fitter.records)


def near(value: float, truth: float, share: float) -> bool:
    """Whether a value is the true one to a share of it."""
    return abs(value / truth - 1.0) <= share


def single(records: list[Record], mode: Mode, model: Model, with_mass: bool) -> str:
    """right, not determined or wrong: of one mode by identify, compare and diagnose."""
    held, _ = identified(records, model)
    observed = [observe(one, model) for one in records]
    compared = compare(ENGINE, observed, model, catalogue())
    diagnosed = diagnose(ENGINE, observed, model, catalogue())
    truth = {"natural_frequency": (mode.frequency, 1e-3), "damping_ratio": (mode.damping, 0.05)}
    truth |= {"mass": (mode.mass, 0.02)} if with_mass else {}
    for found in (held.values, compared.parameters):
        if any(not found[path].determined for path in truth):
            return "not determined"
        if not all(near(found[path].value, *one) for path, one in truth.items()):
            return "wrong"
    agree = compared.error <= 1.05 * compared.noise_floor and diagnosed.verdict == "adequate"
    return "right" if agree else "wrong"


def decay_draw(seed: int) -> tuple[str, str]:
    """One mode's free decay, at any scale."""
    rng = np.random.default_rng([1, seed])
    mode = Mode(10 ** rng.uniform(-1.0, math.log10(20e3)), 10 ** rng.uniform(-3.0, -1.3))
    rate, count = mode.frequency * rng.uniform(8.0, 60.0), int(rng.choice([1500, 3000, 6000]))
    quantity, size = str(rng.choice(QUANTITIES)), 10 ** rng.uniform(-5.0, -2.0)
    values = decaying([(mode, size, rng.uniform(-1.5, 1.5))], rate, count)
    values = values + 10 ** rng.uniform(-2.7, -1.5) * size * rng.standard_normal(count)
    told = f"{mode.frequency:.3g} Hz, {mode.damping:.2g}, {quantity}"
    return single([record("decay", "ring-down", {quantity: values}, rate)], mode, believed(rng, mode), False), told


def driven_draw(seed: int) -> tuple[str, str]:
    """One mode under a measured force, at any scale."""
    rng = np.random.default_rng([2, seed])
    mode = Mode(10 ** rng.uniform(-1.0, math.log10(20e3)), 10 ** rng.uniform(-2.5, -1.3), 10 ** rng.uniform(-1.0, 1.5))
    one = drawn_driven(rng, [mode], mode.frequency * rng.uniform(15.0, 60.0), "tap")
    return single([one], mode, believed(rng, mode), True), f"{mode.frequency:.3g} Hz, {mode.damping:.2g}"


def turned_draw(seed: int) -> tuple[str, str]:
    """One to three records of one or two modes, of which one or all are turned round."""
    rng = np.random.default_rng([3, seed])
    first = Mode(10 ** rng.uniform(0.0, 3.5), 10 ** rng.uniform(-2.5, -1.5), 10 ** rng.uniform(-0.5, 1.0))
    modes = [first]
    if seed % 3 == 2:
        modes.append(Mode(first.frequency * rng.uniform(1.5, 2.5), first.damping, first.mass * rng.uniform(2.0, 5.0)))
    rate, count = first.frequency * rng.uniform(20.0, 50.0), int(rng.integers(1, 4))
    turned = {int(rng.integers(count))} if rng.random() < 0.7 else set(range(count))
    records = [drawn_driven(rng, modes, rate, f"tap_{place}", -1.0 if place in turned else 1.0) for place in range(count)]
    held, notes = identified(records, believed(rng, first))
    told = all(any(f"tap_{place} " in note for note in notes) == (place in turned) for place in range(count))
    mass = held.values["mass"]
    share = 0.02 if len(modes) == 1 else 0.3  # one mode for two is bent by the other
    what = f"{len(modes)} modes, {len(turned)} of {count} turned: mass {mass.value / first.mass:.4g} of the true one"
    if not mass.determined:
        return "not determined", what
    return "right" if told and near(mass.value, first.mass, share) else "wrong", what


def pair_draw(seed: int) -> tuple[str, str]:
    """A free decay of two modes, close ones among them, named by diagnose and found by add."""
    rng = np.random.default_rng([4, seed])
    first = Mode(10 ** rng.uniform(0.5, 3.3), 10 ** rng.uniform(-2.7, -1.7))
    apart = (1.04, 1.1, 1.3, 2.2, 3.5)[seed % 5] * rng.uniform(0.99, 1.01)
    second = Mode(first.frequency * (apart if rng.random() < 0.7 else 1.0 / apart), 10 ** rng.uniform(-2.5, -1.7))
    rate, quantity = max(first.frequency, second.frequency) * rng.uniform(6.0, 25.0), str(rng.choice(QUANTITIES))
    count, size = int(rng.choice([4000, 8000])), 10 ** rng.uniform(-5.0, -3.0)
    parts = [(first, size, rng.uniform(-1.5, 1.5)), (second, size * rng.uniform(0.2, 0.8), rng.uniform(-3.0, 3.0))]
    values = decaying(parts, rate, count) + 10 ** rng.uniform(-3.0, -2.0) * size * rng.standard_normal(count)
    model = believed(rng, first)
    observed = [observe(record("decay", "ring-down", {quantity: values}, rate), model)]
    found = diagnose(ENGINE, observed, model, catalogue())
    told = f"{first.frequency:.4g} and {second.frequency:.4g} Hz: {found.verdict} {' '.join(found.effects)}"
    if (found.verdict, found.effects) != ("missing_effect", ("second_mode",)):
        return "wrong" if found.verdict in ("missing_effect", "adequate") else "not determined", told
    added = add_effects(ENGINE, observed, model, [catalogue()["second_mode"]], catalogue())
    got = [("natural_frequency", "damping_ratio"), ("second_mode.frequency", "second_mode.damping_ratio")]
    seen = [(added.parameters[one].value, added.parameters[other].value) for one, other in got]
    right = all(near(one[0], mode.frequency, 1e-3) and near(one[1], mode.damping, 0.1)
                for one, mode in zip(sorted(seen), sorted([first, second], key=lambda mode: mode.frequency), strict=True))
    marked = {"second_mode.participation", "second_mode.mass_ratio"} <= set(added.model.not_determined)
    return "right" if right and marked else "wrong", told


def three_draw(seed: int) -> tuple[str, str]:
    """A tap at a drive point with three modes, a known force: named by diagnose."""
    rng = np.random.default_rng([5, seed])
    base = 10 ** rng.uniform(1.5, 3.0)
    modes = [Mode(base * ratio * rng.uniform(0.95, 1.05), 10 ** rng.uniform(-2.2, -1.6), 10 ** rng.uniform(-0.3, 0.5))
             for ratio in (1.0, 1.75, 2.8)]
    count, rate = 6000, 20.0 * base
    time = np.arange(FINER * count) / (FINER * rate)
    past, width = time - 0.05 * time[-1], 0.4 / base
    force = 200.0 * np.where((past > 0.0) & (past < width), np.sin(math.pi * past / width) ** 2, 0.0)
    quantity = QUANTITIES[seed % 3]
    values = driven(modes, force, FINER * rate, quantity)[::FINER]
    values = values + 0.0091 * values.std() * rng.standard_normal(count)
    model = believed(rng, modes[seed % 3])
    observed = [observe(record("tap", "excited", {"force": force[::FINER], quantity: values}, rate), model)]
    found = diagnose(ENGINE, observed, model, catalogue())
    end = found.best_fit.fit.state.model
    seen = sorted([end.structure.natural_frequency, *(one["frequency"] for one in end.effects.values() if "frequency" in one)])
    told = f"{quantity}, believed {model.structure.natural_frequency:.0f} Hz: {found.verdict} {' '.join(found.effects)}"
    if (found.verdict, set(found.effects)) != ("missing_effect", {"second_mode", "third_mode"}):
        return "not determined" if found.verdict in ("unexplained", "undecided") else "wrong", told
    right = all(near(one, mode.frequency, 2e-3) for one, mode in zip(seen, modes, strict=True))
    return "right" if right else "wrong", told


def stretched(one: Record, by: float) -> Record:
    """A cut with its time stretched: the same motion of a slower or faster machine."""
    recording = one.recording
    conditions = {**one.conditions, "spindle_speed": one.conditions["spindle_speed"] / by}
    return replace(one, conditions=conditions, recording=replace(
        recording, sampling_rate=recording.sampling_rate / by, marks=recording.marks * by, conditions=conditions))


def cut_rows() -> list[tuple[str, ...]]:
    """The machine found from cuts of three time scales, each brought back to the first."""
    cuts = [plain_cut.record(*one, seed) for seed, one in enumerate(CUTS)]
    powers = {"natural_frequency": 1.0, "damping_ratio": 0.0, "tangential_coefficient": 2.0, "normal_coefficient": 2.0}
    rows: list[tuple[str, ...]] = []
    for by in STRETCHES:
        values = {path: plain_cut.TRUE.value(path) / by**power for path, power in powers.items()}
        off = {path: value * share for (path, value), share in zip(values.items(), (1.01, 1.3, 0.9, 1.1), strict=True)}
        held, _ = identified([stretched(one, by) for one in cuts], plain_cut.TRUE.with_values(off))
        rows.append((f"{by:g}", *(f"{held.values[path].value / values[path] - 1.0:+.1e}" for path in powers),
                     f"{math.sqrt(held.fit.variance):.3f}"))  # fmt: skip
    return rows


def counted(draw: Callable[[int], tuple[str, str]], count: int) -> tuple[dict[str, int], list[str]]:
    """How many draws end how, and what those were that are not right."""
    found = {"right": 0, "not determined": 0, "wrong": 0}
    others = []
    for seed in range(count):
        how, what = draw(seed)
        found[how] += 1
        others += [] if how == "right" else [f"{seed} ({how}): {what}"]
    return found, others


def check() -> Section:
    """The section of the table."""
    kinds = (("free decay, 0.1 Hz to 20 kHz: identify, compare, diagnose", decay_draw, DECAYS, 0.95),
             ("driven record, 0.1 Hz to 20 kHz: identify, compare, diagnose", driven_draw, DRIVEN, 0.9),
             ("sensor or hammer turned round: told, mass right", turned_draw, TURNED, 0.95),
             ("free decay of two modes, 1.04 to 3.5 apart: named, frequencies and damping right, guesses marked", pair_draw,
              PAIRS, 0.9),
             ("tap with three modes: both named", three_draw, THREES, 0.9))  # fmt: skip
    claims: list[Claim] = []
    rows: list[tuple[str, ...]] = []
    missed: list[tuple[str, ...]] = []
    for what, draw, count, share in kinds:
        found, others = counted(draw, count)
        claims.append(Claim(what, f">= {math.ceil(share * count)} of {count}", f"{found['right']}",
                            found["right"] >= share * count))
        rows.append((what, *(str(value) for value in found.values())))
        missed += [(what, other) for other in others]
    cuts = cut_rows()
    worst = max(abs(float(row[1])) for row in cuts)
    claims.append(Claim("cut, its time stretched: natural frequency, worst", "<= 1e-3", f"{worst:.1e}", worst <= 1e-3))
    tables = (("How many", ("kind", "right", "not determined", "wrong"), tuple(rows)),
              ("Not right", ("kind", "draw"), tuple(missed)),
              ("Cuts with their time stretched: found over true, less 1", ("time", "natural frequency", "damping ratio", "K_t",
                                                                          "K_n", "left, in noise"), tuple(cuts)))
    return Section("Any scale, turned sensors, several modes", tuple(claims), tables)
