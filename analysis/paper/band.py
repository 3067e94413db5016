"""Beyond the paper: a stability chart with the probability that the identified machine cuts stably."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from analysis.delay_equation import milling_equation
from analysis.floquet import EmpiricalMultipliers, empirical_multipliers
from analysis.identify import identify_multipliers
from analysis.paper.bench import IDENTIFIED, MASS, Bench, clean_record, course_of, cut_at, measured
from analysis.paper.errors import START, TESTS
from analysis.paper.fig6 import DEPTHS, ELEMENTS, SPEEDS
from analysis.paper.part import Part, Picture, Statement, Table
from analysis.paper.style import PAGE, RED, figure, letter, rpm
from analysis.paper.table2 import machine
from analysis.stability import stability_chart
from analysis.temporal_elements import characteristic_multipliers
from testbed.cut import Cut
from testbed.machine import Model

LEVELS = (0.5e-6, 5e-6)
LOW, HIGH = 0.025, 0.975


def logarithms(model: Model) -> np.ndarray:
    """log of omega, zeta and Gamma1."""
    assert model.cutting is not None
    return np.log([model.structure.natural_frequency_rad, model.structure.damping_ratio,
                   model.cutting.tangential_coefficient / MASS])


def parameter_covariance(model: Model, cuts: Sequence[Cut], found: Sequence[EmpiricalMultipliers]) -> np.ndarray:
    """Covariance (3, 3) of log omega, log zeta, log Gamma1 from that of each test's largest multiplier.

    First order: (sum J^T C^-1 J)^-1 with J the derivative of real and imaginary part of the model's largest multiplier.
    """
    def largest(point: np.ndarray, cut: Cut) -> np.ndarray:
        value = characteristic_multipliers(milling_equation(machine(*np.exp(point)), cut), 12)[0]
        return np.array([value.real, abs(value.imag)])

    here, information, step = logarithms(model), np.zeros((3, 3)), np.array([1e-6, 1e-3, 1e-4])
    for cut, one in zip(cuts, found, strict=True):
        if not one.believed:
            continue
        slopes = np.column_stack([(largest(here + step[k] * unit, cut) - largest(here - step[k] * unit, cut)) / (2 * step[k])
                                  for k, unit in enumerate(np.eye(3))])
        spread = one.covariance[np.ix_([0, one.rank], [0, one.rank])] + (3e-4) ** 2 * np.eye(2)
        information += slopes.T @ np.linalg.solve(spread, slopes)
    return np.linalg.inv(information)


def probability(centre: Model, covariance: np.ndarray, speeds: np.ndarray, depths: np.ndarray, draws: int,
                random: np.random.Generator) -> np.ndarray:
    """Share of machines drawn from the parameters' distribution that cut stably, (depths, speeds)."""
    stable = np.zeros((depths.size, speeds.size))
    for point in random.multivariate_normal(logarithms(centre), covariance, draws):
        stable += stability_chart(machine(*np.exp(point)), speeds, depths, elements=4).spectral_radius < 1
    return stable / draws


def _draw(charts: dict[float, np.ndarray], speeds: np.ndarray, depths: np.ndarray, truth: np.ndarray) -> Any:
    drawn = figure(PAGE, 2.9)
    panels = drawn.subplots(1, len(charts), sharey=True)
    for axes, panel, (level, chart) in zip(panels, "ab", charts.items(), strict=True):
        mesh = axes.pcolormesh(rpm(1.0) * speeds, depths * 1e3, chart, cmap="Blues", vmin=0, vmax=1.4, shading="nearest",
                               rasterized=True)
        axes.contour(rpm(1.0) * speeds, depths * 1e3, chart, levels=[LOW, HIGH], colors="black", linewidths=0.5)
        axes.contour(rpm(1.0) * speeds, depths * 1e3, truth, levels=[1.0], colors=RED, linewidths=0.8, linestyles="--")
        axes.set(xlabel="spindle speed (rpm)", xlim=SPEEDS, ylim=DEPTHS, xticks=range(2500, 4501, 500))
        letter(axes, panel, f"{level * 1e6:g} µm noise")
    panels[0].set_ylabel("axial depth of cut (mm)")
    bar = drawn.colorbar(mesh, ax=panels, boundaries=np.linspace(0, 1, 41), ticks=[0, 0.5, 1], shrink=0.8)
    bar.set_label("probability of a stable cut")
    return drawn


def make(bench: Bench) -> Part:
    """The part."""
    speeds = np.linspace(*SPEEDS, bench.count(161, 41)) * math.pi / 30.0
    depths = np.linspace(*DEPTHS, bench.count(82, 21))[1:] * 1e-3
    cuts = [course_of(cut_at(*test), ring_down=2) for test in TESTS[:3]]
    clean = [clean_record(bench.reference, IDENTIFIED, cut) for cut in cuts]
    truth = stability_chart(IDENTIFIED, speeds, depths, elements=ELEMENTS).spectral_radius
    charts, rows, missed, shares = {}, [], {}, {}
    for level in LEVELS:
        found = [empirical_multipliers(measured(one, bench.random("band", level, place), level))
                 for place, one in enumerate(clean)]
        centre = identify_multipliers(START, cuts, found, starts=2).model
        covariance = parameter_covariance(centre, cuts, found)
        charts[level] = probability(centre, covariance, speeds, depths, bench.count(150, 10), bench.random("draws", level))
        undecided = (charts[level] > LOW) & (charts[level] < HIGH)
        sure = ~undecided
        missed[level] = float(np.mean(((charts[level] > 0.5) != (truth < 1))[sure]))
        shares[level] = float(np.mean(undecided))
        spread = np.sqrt(np.diag(covariance))
        off = logarithms(centre) - logarithms(IDENTIFIED)
        cells = (f"{error:+.3%} ({1.96 * one:.3%})" for error, one in zip(off, spread, strict=True))
        rows.append((f"{level * 1e6:g} µm", *cells, f"{shares[level]:.2%}", f"{missed[level]:.2%}"))
    statements = (
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
                (Picture("band", caption, _draw(charts, speeds, depths, truth)),),
                (Table("Identified parameters and the band", head, tuple(rows)),), statements,
                {"band_area": {str(level): share for level, share in shares.items()},
                 "wrong_outside": {str(level): share for level, share in missed.items()}})
