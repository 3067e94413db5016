"""Cuts of random machines whose class is known from their multipliers, as a recorder would give them.

The motion is the fast engine's; the class comes from Chebyshev collocation, which shares no code with it nor with the judge.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from testbed.analysis.linear.collocation import collocation_multipliers
from testbed.analysis.linear.delay_equation import milling_equation
from testbed.analysis.linear.stability import CLASSES, classify, stability_chart
from testbed.cut import Cut, whole_cut_sampling
from testbed.engines.fast import simulate
from testbed.machine import Cutter, Cutting, Model, Structure
from testbed.recording import Recording

CHANNELS = ("displacement", "acceleration", "velocity", "force_x")
KINDS = ("stable", "neimark_sacker", "flip")
FAR = (0.95, 1.05)  # |mu| a tooth between which a cut is at the border
DEGREES = (24, 34)  # of the collocation, which must agree
AGREE = 1e-6
DEPTHS = 40
A_TURN, STILL = 200, 1e-30  # samples a revolution by which a motion's change is asked; of a channel that does not move
SETTLED = 1e-3  # of the motion, that revolutions of a stable cut without noise may still differ by
UNITS = {"displacement": "m", "velocity": "m/s", "acceleration": "m/s^2", "force_x": "N"}


@dataclass(frozen=True)
class Drawn:
    """A record, and what is hidden from the judge: class, |mu| a tooth, angle of mu (rad), and how the cut was recorded."""

    recording: Recording
    truth: str
    modulus: float
    angle: float
    flutes: int
    channel: str
    idle: bool
    marks: bool
    hum: bool
    runout: bool


def machine(random: np.random.Generator, kind: str) -> tuple[Model, Cut, complex] | None:
    """A random machine and cut with the largest multiplier; None where it is not of the kind, or not known."""
    flutes = int(random.integers(1, 7))
    tangential = 10 ** random.uniform(8.5, 9.3)
    immersion = 10 ** random.uniform(-1.5, math.log10(0.5))
    mass, natural = 10 ** random.uniform(-1.0, 0.7), 10 ** random.uniform(1.9, 3.2)
    model = Model(Structure(mass, natural, 10 ** random.uniform(-2.5, -1.3)), Cutter(flutes, 0.016),
                  Cutting(("up-milling", "down-milling")[random.integers(2)], immersion, tangential,
                          random.uniform(0.1, 0.6) * tangential))
    swings = 10 ** random.uniform(-0.5, 0.8)  # within a tooth pass
    speed = 2 * math.pi * natural / (swings * flutes)
    omega, zeta = model.structure.natural_frequency_rad, model.structure.damping_ratio
    depths = 2 * mass * omega**2 * zeta / tangential * np.logspace(-0.5, 1.8, DEPTHS)
    chart = stability_chart(model, np.array([speed]), depths)  # a first look: the likely depths
    likely = np.flatnonzero((chart.classes[:, 0] == CLASSES.index(kind)) & (np.abs(chart.largest[:, 0]) < 2.0))
    if not len(likely):
        return None
    cut = Cut(speed, float(random.choice(depths[likely])), 10 ** random.uniform(-4.7, -3.7))
    equation = milling_equation(model, cut)
    coarse, fine = (collocation_multipliers(equation, degree)[0] for degree in DEGREES)
    if not abs(abs(coarse) - abs(fine)) < AGREE or FAR[0] < abs(fine) < FAR[1] or not 0.2 < abs(fine) < 2.0:
        return None
    return (model, cut, complex(fine)) if classify(np.array([fine])) == kind else None


def draw(seed: int, kind: str) -> Drawn:
    """One record of that kind: hum, runout, noise, contact loss, some without idling, tachometer or the right speed."""
    random = np.random.default_rng([53, seed])
    while True:
        found = machine(random, kind)
        if found is None:
            continue
        drawn = _recorded(random, kind, *found)
        if drawn is not None:
            return drawn


def _recorded(random: np.random.Generator, kind: str, model: Model, cut: Cut, largest: complex) -> Drawn | None:
    flutes = model.cutter.flutes
    channel = CHANNELS[random.choice(4, p=(0.4, 0.35, 0.1, 0.15))]
    turns = int(random.integers(max(20, -(-40 // flutes)), 121))
    idle, after = (int(random.integers(low, high)) for low, high in ((8, 30), (0, 25)))
    from_within = bool(random.random() < 0.2)
    ready = int(random.integers(20, 60)) if from_within else 0
    plain = model.with_effect("contact_loss")
    runout = flutes > 1 and bool(random.random() < 0.7)
    if runout:  # chips of uneven teeth differ by up to two fifths of the feed
        size = cut.feed_per_tooth * random.uniform(0.02, 0.4) / (2 * math.sin(math.pi / flutes))
        plain = plain.with_effect("runout", offset=size, angle=random.uniform(-3, 3))
    whole = Cut(cut.spindle_speed, cut.axial_depth_of_cut, cut.feed_per_tooth, idle * flutes, (turns + ready) * flutes,
                after * flutes)
    fastest = max(model.structure.natural_frequency, flutes * cut.spindle_speed / (2 * math.pi))
    rate = float(np.round(fastest * 10 ** random.uniform(0.9, 1.5)))
    sampling = whole_cut_sampling(whole, flutes, rate)
    motion = simulate(plain, whole, sampling, channels=(channel,))
    if motion.outcome != "ok" or not _as_told(plain, whole, kind):
        return None
    period = 2 * math.pi / cut.spindle_speed
    clean = np.asarray(motion.channels[channel])
    inside = clean[(motion.time > (idle + 1) * period) & (motion.time < (idle + ready + turns) * period)]
    size, time = float(inside.std()), motion.time
    values, hum = spoiled(random, clean, size, time)
    if from_within:
        kept = (time > (idle + ready) * period) & (time < (idle + ready + turns) * period)
        values, time = values[kept], time[kept]
    marks, known = clocked(random, cut, flutes, time)
    recording = Recording({channel: values}, rate, {channel: UNITS[channel]}, "synthetic", start=float(time[0]), marks=marks,
                          conditions=known)
    return Drawn(recording, kind, abs(largest), abs(float(np.angle(largest))), flutes, channel, not from_within,
                 marks.size > 0, hum, runout)


def clocked(random: np.random.Generator, cut: Cut, flutes: int, time: np.ndarray) -> tuple[np.ndarray, dict[str, float]]:
    """A tachometer's marks (s), half of the time, and the conditions as stated: without marks the speed is up to 3 % off."""
    period = 2 * math.pi / cut.spindle_speed
    marked = bool(random.random() < 0.5)
    marks = np.arange(random.uniform(0, period), time[-1], period)
    known = {"spindle_speed": cut.spindle_speed * (1.0 if marked else 1.0 + random.uniform(-0.03, 0.03)), "flutes": flutes,
             "axial_depth_of_cut": cut.axial_depth_of_cut, "feed_per_tooth": cut.feed_per_tooth}
    return marks[marks > time[0]] if marked else np.empty(0), known


def spoiled(random: np.random.Generator, clean: np.ndarray, size: float, time: np.ndarray) -> tuple[np.ndarray, bool]:
    """A channel of that size with noise, drift and, more often than not, hum, which is told."""
    values = clean + size * 10 ** random.uniform(-2.7, -0.7) * random.standard_normal(len(clean))
    hum = bool(random.random() < 0.6)
    if hum:
        mains = (50.0, 60.0)[random.integers(2)] * (1 + 2e-4 * random.standard_normal())
        for order in (1, 2, 3, 5, 7):
            level = size * 10 ** random.uniform(-1.7, -0.3) / order**0.5
            values = values + level * np.cos(2 * math.pi * mains * order * time + random.uniform(0, 6.3))
    return values + size * (random.uniform(-1, 1) + random.uniform(-0.3, 0.3) * time / time[-1]), hum


def accelerated(seed: int, kind: str) -> tuple[Recording, float]:
    """A run of a data set with an accelerometer alone, no runout, and the rms of its noise: what `testbed export` reads."""
    random = np.random.default_rng([54, seed])
    found = None
    while found is None or not _as_told(found[0].with_effect("contact_loss"), found[1], kind):
        found = machine(random, kind)
    model, cut, _ = found
    flutes = model.cutter.flutes
    idle, passes = 5 * flutes, flutes * -(-int(random.integers(80, 200)) // flutes)
    whole = Cut(cut.spindle_speed, cut.axial_depth_of_cut, cut.feed_per_tooth, idle, passes, 5 * flutes)
    rate = 30.0 * max(model.structure.natural_frequency, flutes * cut.spindle_speed / (2 * math.pi))
    sampling = whole_cut_sampling(whole, flutes, rate)
    run = simulate(model.with_effect("contact_loss"), whole, sampling, channels=("acceleration",))
    values = np.asarray(run.channels["acceleration"])
    noise = float(values.std()) * 10 ** random.uniform(-3.0, -1.5)
    marks = np.arange(random.uniform(0, 2 * math.pi / cut.spindle_speed), run.time[-1], 2 * math.pi / cut.spindle_speed)
    known = {**run.conditions, "idle_passes": idle, "passes": passes, "flutes": flutes}
    return replace(run, channels={"acceleration": values + noise * random.standard_normal(len(values))}, marks=marks,
                   conditions=known), noise  # fmt: skip


def from_turn_to_turn(values: np.ndarray) -> float:
    """How much a channel of A_TURN samples a revolution changes between its last two, as a share of that in its last four."""
    rows = np.asarray(values)[: len(values) // A_TURN * A_TURN].reshape(-1, A_TURN)
    return float(np.std(rows[-1] - rows[-2])) / max(float(np.std(rows[-4:])), STILL)


def _as_told(model: Model, cut: Cut, kind: str) -> bool:
    """Whether the motion itself, without noise, does what the multipliers say: repeats every revolution only if stable.

    A blow of the entry may throw a cut that is stable in the small into lasting chatter, where teeth leave the work.
    """
    flutes = model.cutter.flutes
    turn = cut.tooth_passing_period(flutes) * flutes
    last = Cut(cut.spindle_speed, cut.axial_depth_of_cut, cut.feed_per_tooth, 0, cut.passes)
    sampling = whole_cut_sampling(last, flutes, A_TURN / turn)
    change = from_turn_to_turn(simulate(model, last, sampling).channels["displacement"])
    return change < 0.05 if kind == "stable" else kind == "flip" and model.cutter.flutes % 2 == 0 or change > SETTLED
