"""Fig. 7: the published cases in time, in section and in frequency, each with its verdict."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from analysis.lines import amplitude_spectrum
from analysis.paper.bench import IDENTIFIED, RATE, Bench, measured
from analysis.paper.part import Part, Picture, Statement, Table
from analysis.paper.style import OUTCOME_COLOURS, PAGE, figure, letter, named, rpm, shown
from analysis.published import PUBLISHED, PublishedTest, linear_multipliers
from analysis.stability import classify
from analysis.verdict import SampleVerdict, once_per_tooth_samples, simulated_verdict
from testbed.cut import Cut, whole_cut_sampling
from testbed.recording import Recording

NOISE = 0.5e-6
SPECTRUM_TO = 500.0  # Hz


@dataclass(frozen=True)
class Case:
    """A published case: its record, once-per-tooth samples (m), both verdicts and the largest multiplier."""

    test: PublishedTest
    record: Recording
    samples: np.ndarray
    seen: SampleVerdict
    multiplier: complex
    linear: str


def case(bench: Bench, test: PublishedTest, passes: int) -> Case:
    """Simulate one case with loss of contact and the sensor's noise."""
    cut = Cut(test.spindle_speed, test.axial_depth_of_cut, passes=passes)
    clean = bench.reference(IDENTIFIED.with_effect("contact_loss"), cut, whole_cut_sampling(cut, 1, RATE))
    record = measured(clean, bench.random("fig7", test.name), NOISE)
    samples = once_per_tooth_samples(record)
    multipliers = linear_multipliers(IDENTIFIED, test)
    return Case(test, record, samples, simulated_verdict(samples, NOISE), complex(multipliers[0]), classify(multipliers))


def _spectrum(axes: Any, one: Case) -> None:
    """Amplitude of the second half of the record, tooth-passing lines marked."""
    signal = one.record.channels["displacement"]
    frequency, amplitude = amplitude_spectrum(signal[signal.size // 2:], one.record.sampling_rate)
    inside = (frequency > 5.0) & (frequency <= SPECTRUM_TO)
    power = np.maximum((amplitude[inside] * 1e6) ** 2, 1e-12)
    tooth = rpm(one.test.spindle_speed) / 60.0
    for line in np.arange(tooth, SPECTRUM_TO, tooth):
        axes.axvline(line, color="0.75", lw=0.5, ls="--", zorder=0)
    axes.semilogy(frequency[inside], power, color="0.15", lw=0.5)
    axes.set(xlim=(0, SPECTRUM_TO), ylim=(1e-6, 10 * power.max()))


def _draw(cases: list[Case]) -> Any:
    drawn = figure(PAGE, 1.55 * len(cases) + 0.3)
    panels = drawn.subplots(len(cases), 3, width_ratios=(1.5, 1.0, 1.5), squeeze=False)
    for row, one in zip(panels, cases, strict=True):
        colour = OUTCOME_COLOURS.get(one.seen.outcome, "black")
        samples = one.samples * 1e6
        row[0].plot(samples, ".", color=colour, ms=1.8)
        row[0].set(ylabel=r"$x_n$ (µm)", xlim=(0, samples.size))
        late = samples[-100:]
        row[1].plot(late[1:], late[:-1], ".", color=colour, ms=2.4)
        middle, half = 0.5 * (late.max() + late.min()), max(0.62 * float(np.ptp(late)), 10.0)
        row[1].set(xlim=(middle - half, middle + half), ylim=(middle - half, middle + half), ylabel=r"$x_{n-1}$ (µm)")
        row[1].set_box_aspect(1)
        _spectrum(row[2], one)
        row[2].set_ylabel("power (µm²)")
        letter(row[0], one.test.name, f"{rpm(one.test.spindle_speed):.0f} rpm, {one.test.axial_depth_of_cut * 1e3:.1f} mm: "
               f"{named(one.seen.outcome)}")
    panels[-1, 0].set_xlabel("tooth pass $n$")
    panels[-1, 1].set_xlabel(r"$x_n$ (µm)")
    panels[-1, 2].set_xlabel("frequency (Hz)")
    return drawn


def make(bench: Bench) -> Part:
    """The part."""
    # B grows by 1.3 % a tooth: it needs hundreds of teeth to show what it grows into
    cases = [case(bench, test, 600 if test.name == "B" else 300) for test in PUBLISHED]
    statements = tuple(
        Statement(f"fig. 7{one.test.name}" if one.test.name != "E" else "case E",
                  f"{rpm(one.test.spindle_speed):.0f} rpm, {one.test.axial_depth_of_cut * 1e3:.1f} mm is "
                  f"{named(one.test.outcome)}", named(one.test.outcome),
                  f"{named(one.linear)} (mu = {shown(one.multiplier)}); simulated: "
                  f"{named(one.seen.outcome)}, {one.seen.reason}",
                  one.test.outcome == one.linear == one.seen.outcome) for one in cases)
    rows = tuple((one.test.name, f"{rpm(one.test.spindle_speed):.0f}", f"{one.test.axial_depth_of_cut * 1e3:.1f}",
                  named(one.test.outcome), shown(one.multiplier, 5), f"{abs(one.multiplier):.5f}", named(one.linear),
                  named(one.seen.outcome), "yes" if one.test.outcome == one.linear == one.seen.outcome else "no")
                 for one in cases)
    table = Table("Verdicts", ("case", "rpm", "mm", "experiment", "largest multiplier", "modulus", "linear", "simulated",
                               "agree"), rows)
    text = ("Simulated by MuJoCo with loss of contact, which bounds what grows, and 0.5 µm noise; the verdict is read from the "
            "once-per-tooth samples alone. Which delay the paper's section uses is not known: here it is one tooth period.",)
    caption = ("Cases A to D of the paper, and E. Left: displacement once per tooth. Middle: the last 100 of these against the "
               "one a delay before. Right: power spectrum of the second half; dashed: tooth-passing frequency and multiples.")
    return Part("fig7", "Figure 7: the cases A to E", text, (Picture("fig7", caption, _draw(cases)),), (table,), statements,
                {one.test.name: {"multiplier": one.multiplier, "linear": one.linear, "simulated": one.seen.outcome,
                                 "published": one.test.outcome} for one in cases})
