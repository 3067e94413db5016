"""Beyond the paper: a stability chart with the probability that the identified machine cuts stably."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from testbed.analysis.information import Z_95
from testbed.analysis.linear.delay_equation import milling_equation
from testbed.analysis.linear.stability import stability_chart
from testbed.analysis.linear.temporal_elements import characteristic_multipliers
from testbed.analysis.multipliers.floquet import EmpiricalMultipliers, empirical_multipliers
from testbed.analysis.multipliers.identify import identify_multipliers
from testbed.analysis.paper.bench import IDENTIFIED, MASS, Bench, clean_record, course_of, cut_at, measured
from testbed.analysis.paper.errors import START, TESTS
from testbed.analysis.paper.fig6 import DEPTHS, SPEEDS
from testbed.analysis.paper.part import Part, Picture, Statement, Table
from testbed.analysis.paper.style import PAGE, RED, figure, letter, rpm
from testbed.analysis.paper.table2 import machine
from testbed.cut import Cut
from testbed.machine import Model

LEVELS = (0.5e-6, 5e-6)
LOW, HIGH = 0.025, 0.975


def logarithms(model: Model) -> np.ndarray:
    """log of omega, zeta and Gamma1."""
    assert model.cutting is not None
    return np.log([model.structure.natural_frequency_rad, model.structure.damping_ratio,
                   model.cutting.tangential_coefficient / MASS])


def slopes(model: Model, cut: Cut) -> np.ndarray:
    """Derivative (2, 3) of real and imaginary part of the largest multiplier by log omega, log zeta, log Gamma1."""
    def largest(point: np.ndarray) -> np.ndarray:
        value = characteristic_multipliers(milling_equation(machine(*np.exp(point)), cut), 12)[0]
        return np.array([value.real, abs(value.imag)])

    here, step = logarithms(model), np.array([1e-6, 1e-3, 1e-4])
    return np.column_stack([(largest(here + step[k] * unit) - largest(here - step[k] * unit)) / (2 * step[k])
                            for k, unit in enumerate(np.eye(3))])


def parameter_covariance(model: Model, cuts: Sequence[Cut], spreads: Sequence[np.ndarray | None]) -> np.ndarray:
    """Covariance (3, 3) of log omega, log zeta, log Gamma1 from that of each test's largest multiplier.

    spreads: covariance (2, 2) of its real and imaginary part; None where it is not used. First order:
    (sum J^T C^-1 J)^-1 with J the slopes.
    """
    information = np.zeros((3, 3))
    for cut, spread in zip(cuts, spreads, strict=True):
        if spread is not None:
            found = slopes(model, cut)
            information += found.T @ np.linalg.solve(spread, found)
    return np.linalg.inv(information)


def spread_of(found: EmpiricalMultipliers) -> np.ndarray | None:
    """Covariance (2, 2) of the largest multiplier, with 3e-4 for what it does not hold; None where it is not believed."""
    if not found.believed:
        return None
    return found.covariance[np.ix_([0, found.rank], [0, found.rank])] + (3e-4) ** 2 * np.eye(2)


@dataclass(frozen=True)
class Band:
    """Over (depths, speeds): share of machines that cut stably; spectral radius that 2.5 and 97.5 % of them stay below."""

    stable: np.ndarray
    low: np.ndarray
    high: np.ndarray


def band(centre: Model, covariance: np.ndarray, speeds: np.ndarray, depths: np.ndarray, draws: int,
         random: np.random.Generator) -> Band:
    """The charts of machines drawn from the parameters' distribution."""
    radii = np.array([stability_chart(machine(*np.exp(point)), speeds, depths).spectral_radius
                      for point in random.multivariate_normal(logarithms(centre), covariance, draws)], np.float32)
    low, high = np.quantile(radii, (LOW, HIGH), axis=0)
    return Band(np.mean(radii < 1, axis=0), low, high)


def _draw(bands: dict[float, Band], speeds: np.ndarray, depths: np.ndarray, truth: np.ndarray) -> Any:
    drawn = figure(PAGE, 2.9)
    panels = drawn.subplots(1, len(bands), sharey=True)
    for axes, panel, (level, one) in zip(panels, "ab", bands.items(), strict=True):
        mesh = axes.pcolormesh(rpm(1.0) * speeds, depths * 1e3, one.stable, cmap="Blues", vmin=0, vmax=1.4, shading="nearest",
                               rasterized=True)
        for radius in (one.low, one.high):  # smoother than contours of the share, which is 0 or 1 in almost all cells
            axes.contour(rpm(1.0) * speeds, depths * 1e3, radius, levels=[1.0], colors="black", linewidths=0.5)
        axes.contour(rpm(1.0) * speeds, depths * 1e3, truth, levels=[1.0], colors=RED, linewidths=0.8, linestyles="--")
        axes.set(xlabel="spindle speed (rpm)", xlim=SPEEDS, ylim=DEPTHS, xticks=range(2500, 4501, 500))
        letter(axes, panel, f"{level * 1e6:g} µm noise")
    panels[0].set_ylabel("axial depth of cut (mm)")
    bar = drawn.colorbar(mesh, ax=panels, boundaries=np.linspace(0, 1, 41), ticks=[0, 0.5, 1], shrink=0.8, pad=0.02)
    bar.set_label("probability of a stable cut")
    return drawn


def make(bench: Bench) -> Part:
    """The part."""
    speeds = np.linspace(*SPEEDS, bench.count(161, 41)) * math.pi / 30.0
    depths = np.linspace(*DEPTHS, bench.count(82, 21))[1:] * 1e-3
    cuts = [course_of(cut_at(*test), ring_down=2) for test in TESTS[:3]]
    clean = [clean_record(bench.reference, IDENTIFIED, cut) for cut in cuts]
    truth = stability_chart(IDENTIFIED, speeds, depths).spectral_radius
    bands, rows, missed, shares = {}, [], {}, {}
    for level in LEVELS:
        found = [empirical_multipliers(measured(one, bench.random("band", level, place), level))
                 for place, one in enumerate(clean)]
        centre = identify_multipliers(START, cuts, found, starts=2).model
        covariance = parameter_covariance(centre, cuts, [spread_of(one) for one in found])
        bands[level] = band(centre, covariance, speeds, depths, bench.count(150, 10), bench.random("draws", level))
        stable = bands[level].stable
        undecided = (stable > LOW) & (stable < HIGH)
        sure = ~undecided
        missed[level] = float(np.mean(((stable > 0.5) != (truth < 1))[sure]))
        shares[level] = float(np.mean(undecided))
        spread = np.sqrt(np.diag(covariance))
        off = logarithms(centre) - logarithms(IDENTIFIED)
        cells = (f"{error:+.3%} ({Z_95 * one:.3%})" for error, one in zip(off, spread, strict=True))
        rows.append((f"{level * 1e6:g} µm", *cells, f"{shares[level]:.2%}", f"{missed[level]:.2%}"))
    # 0.01 of the complex multiplier: its real and imaginary part share it
    error = np.sqrt(np.diag(parameter_covariance(IDENTIFIED, cuts, [0.5e-4 * np.eye(2)] * len(cuts))))
    omega = error[0] * IDENTIFIED.structure.natural_frequency_rad
    statements = (
        Statement("extension", "what an error of 0.01 in each of three multipliers does",
                  "zeta 15 %, omega 0.5 rad/s, Gamma1 2 %",
                  f"zeta {error[1]:.0%}, omega {omega:.2f} rad/s, Gamma1 {error[2]:.1%}",
                  0.075 < error[1] < 0.3 and 0.25 < omega < 1.0 and 0.01 < error[2] < 0.04,
                  "to first order, within a factor of 2; which tests were meant is not known", "inferred"),
        Statement("extension", "a chart from identified parameters has a band of doubt about its limit", "not in the paper",
                  "; ".join(f"{level * 1e6:g} µm: {shares[level]:.2%} of the area" for level in LEVELS), None,
                  "probability between 2.5 and 97.5 %", "target"),
        Statement("extension", "outside the band the chart is right", "<= 2.5 % wrong", "; ".join(
            f"{level * 1e6:g} µm: {missed[level]:.2%}" for level in LEVELS), max(missed.values()) <= 0.025, "", "target"))
    text = ("One identification of three tests at each noise level; machines are drawn from the parameters' distribution, "
            "which follows from the multipliers' covariance, and each gets its chart. The band holds the noise's doubt "
            "alone: not that of the immersion, of the ratio of the coefficients, or of what the model lacks.",)
    caption = ("Probability of a stable cut. Black: 2.5 and 97.5 %. Red, dashed: the limit of the machine that made the data.")
    head = ("noise", "omega: error (95 %)", "zeta", "Gamma1", "band's area", "wrong outside it")
    return Part("band", "Extension: a stability chart with its doubt", text,
                (Picture("band", caption, _draw(bands, speeds, depths, truth)),),
                (Table("Identified parameters and the band", head, tuple(rows)),), statements,
                {"band_area": {str(level): share for level, share in shares.items()},
                 "wrong_outside": {str(level): share for level, share in missed.items()}})
