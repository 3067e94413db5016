"""Pairs of causes that pass for each other: for each a campaign that separates them and one that cannot.

The records come from MuJoCo, the fits from the fast engine. Where the records separate a pair, the hidden cause must be
named, alone; where they cannot, both must be told as tied, or nothing be missed because the base model took it up: the
damping ratio the curvature of a short decay or the damping of the flank, all of it a little wear or droop in a short cut.
The name of the other alone is wrong everywhere.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from types import SimpleNamespace

import numpy as np

from testbed.analysis.fit.observe import observe
from testbed.analysis.search.candidate import Candidate
from testbed.analysis.search.diagnose import diagnose
from testbed.analysis.search.diagnosis import Diagnosis
from testbed.catalogue import catalogue
from testbed.cut import Cut, Sampling
from testbed.engines import mujoco_engine, predict
from testbed.files.campaign import Record
from testbed.machine import Model
from testbed.recording import Recording
from testbed.workshop import RPM, Measurement, measured_cut
from tests.support.campaign_files import BELIEVED, TRUE
from tests.validation.claims import Claim, Section

ENGINE = SimpleNamespace(predict_cuts=predict.predict_cuts, predict_driven=predict.predict_driven)
RATE = 6400.0  # samples/s
FEED = 0.1016e-3  # m a tooth
COURSE = (30, 40, 16)  # revolutions of idling (the noise is read from it), cutting, ringing down
REST = 9600  # samples before a free vibration, from which the noise is read
ZETA = "damping_ratio"
STRONG_DAMPING = 0.0064  # damping ratio where that is what is hidden, 1.6 times the believed one


@dataclass(frozen=True)
class Test:
    """One cut of a campaign. length: m of feed that the tool had cut before."""

    rpm: float
    mm: float
    feed: float = FEED
    length: float = 0.0


Maker = Callable[[Model, int], list[Record]]


def cuts(tests: Sequence[Test], *, noise: float = 1e-6, course: Sequence[int] = COURSE, marks: bool = True) -> Maker:
    """A maker of cuts, measured with `noise` (rms, m), with or without the tachometer."""

    def make(model: Model, seed: int) -> list[Record]:
        records = []
        for number, test in enumerate(tests):
            cut = Cut(test.rpm * RPM, test.mm * 1e-3, test.feed, *course, length_cut_before=test.length)
            one = measured_cut(
                mujoco_engine.simulate, model, cut, Measurement(rate=RATE, noise=noise), 100 * seed + number, f"{number + 1}"
            )
            records.append(one if marks else replace(one, recording=replace(one.recording, marks=np.empty(0))))
        return records

    return make


def part_of(maker: Maker, last: float, first: float = 0.0) -> Maker:
    """The same records from the time `first` (s) or their start up to `last`, still in the cut."""

    def make(model: Model, seed: int) -> list[Record]:
        kept = []
        for record in maker(model, seed):
            whole = record.recording
            begin, end = (max(0, round((time - whole.start) * whole.sampling_rate)) for time in (first, last))
            start, signal = whole.start + begin / whole.sampling_rate, whole.channels["displacement"][begin:end]
            marks = whole.marks[(whole.marks >= start) & (whole.marks < last)]
            seen = replace(whole, channels={"displacement": signal}, start=start, marks=marks)
            kept.append(replace(record, recording=seen))
        return kept

    return make


def decays(amplitudes: Sequence[float], duration: float, *, noise: float = 1e-6) -> Maker:
    """A maker of free vibrations from the given displacements (m) after a little rest, without a cut."""

    def make(model: Model, seed: int) -> list[Record]:
        records = []
        count, rest = round(duration * RATE), REST
        for number, amplitude in enumerate(amplitudes):
            passes = int(duration * 50.0) + 3  # at 3000 rpm
            cut = Cut(3000.0 * RPM, 0.0, FEED, passes, 1, 0, initial_displacement=amplitude)
            motion = mujoco_engine.simulate(model, cut, Sampling(RATE, count)).channels["displacement"]
            random = np.random.default_rng(100 * seed + number)
            signal = np.concatenate([np.zeros(rest), motion]) + noise * random.standard_normal(rest + count) + 3e-6
            recording = Recording({"displacement": signal}, RATE, {"displacement": "m"}, "synthetic")
            records.append(Record(f"{number + 1}", "ring-down", recording, {}, ()))
        return records

    return make


@dataclass(frozen=True)
class Case:
    """One campaign: the pair, which of it is hidden (by its parameters), how it is measured, and whether that separates."""

    pair: tuple[str, str]
    hidden: str
    values: dict[str, float]
    maker: Maker
    separates: bool
    plan: str
    absorbed: str = ""  # what may take the hidden effect up unseen: the free damping ratio, or any of the base

    @property
    def key(self) -> str:
        """A name for the terminal."""
        return f"{'/'.join(self.pair)} {'separates' if self.separates else 'cannot'} {self.hidden}"

    @property
    def truth(self) -> Model:
        """The machine that is cut with."""
        return TRUE.with_values({ZETA: STRONG_DAMPING}) if self.hidden == ZETA else TRUE.with_effect(self.hidden, **self.values)

    @property
    def wanted(self) -> str:
        """The answer that is asked for, in words."""
        if self.separates:
            return "adequate, damping ratio right" if self.hidden == ZETA else self.hidden
        if ZETA in self.pair:
            return "adequate" if self.hidden == ZETA else "adequate, damping ratio bent"
        both = f"undecided: {', '.join(self.pair)}"
        return {"": both, ZETA: f"{both}; or adequate, damping ratio bent",
                "any": f"undecided, {self.hidden} among the tied; or adequate"}[self.absorbed]  # fmt: skip

    def right(self, found: Diagnosis) -> bool:
        """Whether the verdict is the one asked for."""
        away = damping_of(found) / self.truth.structure.damping_ratio - 1.0
        if self.hidden == ZETA:
            return found.verdict == "adequate" and (not self.separates or abs(away) < 0.05)
        if self.separates:
            return found.verdict == "missing_effect" and found.effects == (self.hidden,)
        if found.verdict == "undecided":
            asked = {self.hidden} if self.absorbed == "any" else set(self.pair)
            return asked <= set(found.effects)
        return found.verdict == "adequate" and (self.absorbed == "any" or (self.absorbed == ZETA and away > 0.05))


def damping_of(found: Diagnosis) -> float:
    """The damping ratio of the refitted believed model."""
    assert isinstance(found.base, Candidate)
    return found.base.fit.state.model.structure.damping_ratio


SPREAD = (Test(3810, 2.9), Test(2850, 2.9), Test(3500, 0.8))
FEEDS = (Test(3810, 2.5, 0.05e-3), Test(3810, 2.5, 0.2e-3), Test(2850, 2.5, 0.1e-3))
LENGTHS = (Test(3810, 2.5, FEED, 0.0), Test(3810, 2.5, FEED, 0.1), Test(2850, 1.5, FEED, 0.2))
LAG = ("helix", {"angle": 0.7}, "sensor_lag", {"time_constant": 3.0e-4})
SMALL_LAG = ("helix", {"angle": 0.7}, "sensor_lag", {"time_constant": 2.0e-4})  # more is more than any helix does
FRICTION = ("dry_friction", {"force": 0.3, "presliding_displacement": 0.2e-6}, "quadratic_damping", {"coefficient": 60.0})
FLANK = ("process_damping", {"coefficient": 2.0e5}, ZETA, {})
EDGE = ("edge_force", {"tangential": 2.5e3, "normal": 4.0e3}, "chip_force_exponent", {"exponent": 0.85})
WEAR = ("tool_wear", {"rate": 5.0}, "speed_droop", {"droop": 0.05, "time_constant": 0.2})
DEEP, MIDDLE = (Test(3810, 2.9),), (Test(3810, 2.0),)
# pair; whether these records separate it; what may take it up; the records; what they are
CAMPAIGNS: tuple[tuple[tuple[str, dict, str, dict], bool, str, Maker, str], ...] = (
    (LAG, True, "", cuts(SPREAD), "3 cuts, 0.8 and 2.9 mm, 2850 to 3810 rpm"),
    (LAG, True, "", cuts(DEEP, noise=0.5e-6), "1 whole cut, 0.5 um noise"),
    (SMALL_LAG, False, "", part_of(cuts(DEEP, noise=0.5e-6), 1.0, 0.85),
     "0.15 s from within 1 cut, 0.5 um noise, a lag of 0.2 ms"),
    (FRICTION, True, "", decays((3e-4, 1e-4, 3e-5), 1.0), "3 ring-downs from 30 to 300 um"),
    (FRICTION, False, ZETA, decays((1e-4, 1e-4), 0.12, noise=2e-6), "2 ring-downs from 100 um, 0.12 s, 2 um noise"),
    (FLANK, True, "", cuts(SPREAD), "3 cuts, 0.8 and 2.9 mm, 2850 to 3810 rpm, with ring-downs"),
    (FLANK, False, ZETA, part_of(cuts(MIDDLE * 2, noise=2e-6), 1.05), "2 cuts alike, ended in the cut, 2 um noise"),
    (EDGE, True, "", cuts(FEEDS), "3 cuts, feeds of 0.05, 0.1 and 0.2 mm"),
    (EDGE, False, "", cuts(MIDDLE, noise=2e-6), "1 cut, 2 um noise"),
    (WEAR, True, "", cuts(LENGTHS, marks=False), "3 cuts after 0, 100 and 200 mm, no tachometer"),
    (WEAR, False, "any", cuts(MIDDLE, noise=2e-6, course=(30, 24, 14), marks=False), "1 short cut, no tachometer, 2 um noise"),
)


def cases() -> list[Case]:
    """Every campaign, with either of its pair hidden."""
    return [
        Case((one, other), hidden, values, maker, separates, plan, absorbed)
        for (one, own, other, others), separates, absorbed, maker, plan in CAMPAIGNS
        for hidden, values in ((one, own), (other, others))
    ]


def told(case: Case, seed: int = 3) -> Diagnosis:
    """The diagnosis of a case's campaign."""
    records = [observe(record, BELIEVED) for record in case.maker(case.truth, seed)]
    return diagnose(ENGINE, records, BELIEVED, catalogue())


def answer(found: Diagnosis) -> str:
    """Verdict and names in a few words."""
    return f"{found.verdict}: {', '.join(found.effects)}" if found.effects else found.verdict


def check() -> Section:
    """The section of the table."""
    claims, rows = [], []
    for case in cases():
        found = told(case)
        right = case.right(found)
        print(f"{case.key}: {answer(found)}{'' if right else '  MISSED'}", file=sys.stderr, flush=True)
        sort = "can be told" if case.separates else "cannot be told"
        what = f"{' / '.join(case.pair)}, {sort}: {case.hidden} hidden"
        claims.append(Claim(what, case.wanted, answer(found), right, case.plan))
        before, after = found.baseline / found.noise_floor, found.with_effects / found.noise_floor
        true = case.truth.structure.damping_ratio
        rows.append((case.plan, case.hidden, f"{before:.3f}", f"{after:.3f}", f"{damping_of(found):.5f} of {true:.5f}"))
    return Section("Pairs hard to tell apart: a campaign that separates each and one that cannot", tuple(claims),
                   (("Behind it", ("campaign", "hidden", "error / noise before", "after", "damping ratio, base fit of true"),
                     tuple(rows)),))  # fmt: skip
