"""Whether anything but noise is left of a record: tests of its residual, with the false discoveries controlled.

A record that was left out of the fit is foretold with parameters that the others leave open: its residual varies by
I + J C J^T in units of the noise, J its slopes and C the covariance of the fit without it. It is judged in units of that, and
how far it lies along J beside its own share: whether it asks for other parameters than the records that foretell it. Both
follow from the joint fit, by 1 / (1 - leverage); where the others leave much open, a fit without the record may end far from
where slopes hold.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import chdtrc, fdtrc

from testbed.analysis.fit.fit_state import WaveformFit
from testbed.analysis.fit.held_out import RecordError, conditions_of
from testbed.analysis.fit.least_squares import COLLINEAR
from testbed.analysis.fit.nuisances import Nuisances
from testbed.analysis.fit.observed import Observed
from testbed.analysis.fit.waveform import Fitter
from testbed.analysis.information import autocorrelation, independent
from testbed.analysis.records.spindle_clock import turns_of

LAGS = 20  # autocorrelations that the Ljung-Box test looks at
SECTORS = 36  # of the tooth's turn, for the test against its angle
FALSE_DISCOVERIES = 0.05  # share of false alarms among the tests that fail (Benjamini and Hochberg 1995)
_TINY = 1e-9  # share of what is told, to which rounding leaves 0 and 1
TRIVIAL = 0.02  # of the noise: what the rms may exceed it by before it counts


@dataclass(frozen=True)
class Adequacy:
    """One test of a record's residual: statistic, p value, and whether it fails with the false discoveries controlled."""

    record: str
    test: str
    statistic: float
    p_value: float
    fails: bool = False


def tooth_angle(record: Observed, angle: float, own: Nuisances) -> np.ndarray:
    """Angle (rad) of the spindle since a tooth last stood at its entry, at every sample of a cut: 0 to one pitch."""
    time = record.start + np.arange(record.samples) / record.rate
    if record.marks is not None:
        turns = np.interp(time, record.marks, turns_of(record.marks)) - (angle + own.angle) / (2 * math.pi)
    else:
        turns = (time - record.pass_start(0, angle, own)) / record.period * own.speed
    return (turns * 2 * math.pi) % (2 * math.pi / record.flutes)


_LEFT = {"rms": "too large", "autocorrelation": "not random", "tooth angle": "recurring with the tooth",
         "parameters": "asking for other parameters"}
LEFT_EXPLAINED = ("more than noise is left where it is too large, not random (one sample foretells the next), recurring with "
                  "the angle of the tooth, or asking for other parameters than the other records do; what those leave open of "
                  "the parameters counts as noise")


def said_left(tests: Sequence[Adequacy], record: str) -> str:
    """In words, what a record's residual is, by the tests that fail."""
    failing = [test.test.partition(", ") for test in tests if test.record == record and test.fails]
    return ", ".join(_LEFT[name] + (f" in {channel}" if channel else "") for name, _, channel in failing) or "noise"


def adequacy_tests(record: Observed, error: RecordError, angle: float, own: Nuisances) -> list[Adequacy]:
    """Every channel's rms against its noise (an F test), Ljung-Box on the effective sample size, dependence on tooth angle.

    Of several channels the tests of the second and further ones are named with theirs.
    """
    return [replace(test, test=test.test if place == 0 else f"{test.test}, {channel}")
            for place, channel in enumerate(record.channels)
            for test in _channel_tests(record, error.residual[place] / record.noise[place], angle, own)]


def _channel_tests(record: Observed, rest: np.ndarray, angle: float, own: Nuisances) -> list[Adequacy]:
    """The tests of one channel's residual (samples,) in units of its noise."""
    rest = rest - rest.mean()
    correlation = autocorrelation(rest)
    size = max(independent(correlation), LAGS + 2.0)
    idle = max((s.stop - s.start for s in record.segments if s.kind == "idle"), default=0.0) * record.rate
    ratio = float(rest @ rest) / len(rest)
    p_rms = float(fdtrc(size, max(idle, 100.0), ratio / (1.0 + TRIVIAL) ** 2))
    lags = np.arange(1, LAGS + 1)
    ljung_box = size * (size + 2.0) * float(np.sum(correlation[1:LAGS + 1] ** 2 / np.maximum(size - lags, 1.0)))
    tests = [Adequacy(record.name, "rms", math.sqrt(ratio), p_rms),
             Adequacy(record.name, "autocorrelation", ljung_box, float(chdtrc(LAGS, ljung_box)))]
    if record.cut is not None:
        place = (tooth_angle(record, angle, own) * record.flutes / (2 * math.pi) * SECTORS).astype(int) % SECTORS
        count = np.bincount(place, minlength=SECTORS)
        mean = np.bincount(place, rest, minlength=SECTORS) / np.maximum(count, 1)
        statistic = float(np.sum(count * mean**2)) * size / len(rest) / max(ratio, 1e-300)
        tests.append(Adequacy(record.name, "tooth angle", statistic, float(chdtrc(SECTORS - 1, statistic))))
    return tests


def less_open(fitter: Fitter, fit: WaveformFit, errors: Sequence[RecordError]) -> tuple[list[RecordError], list[Adequacy]]:
    """Held-out errors with residuals in units of what noise and the other conditions make of them, times the noise, and a test
    of every condition's parameters. Of one condition as they are.
    """
    groups, found = conditions_of(fitter.records), list(errors)
    tests: list[Adequacy] = []
    if len(groups) < 2:
        return found, tests
    told = [part.information for part in fit.parts]
    whole, pull = (sum(each[1:], each[0]) for each in map(list, zip(*told, strict=True)))
    axes = _axes(whole)
    for group in groups:
        share, turn = np.linalg.eigh(axes.T @ sum(told[place][0] for place in group) @ axes)
        ways = axes @ turn  # along each, of 1 that all records tell, this group tells a share
        share = np.clip(share, _TINY, 1.0 - _TINY)
        own = ways.T @ sum(told[place][1] for place in group)
        at_rest = own - share * (ways.T @ pull)  # pull of the group where those of all records are in balance
        step = ways @ ((at_rest / np.sqrt(1.0 - share) - own) / share)
        for place in group:
            record, part = fitter.records[place], fit.parts[place]
            rest = fit.residuals[place] + part.without_own(part.shared @ step)[: record.size]
            found[place] = replace(errors[place], residual=record.on_samples(rest) * record.scale[:, None])
        statistic = float(np.sum(at_rest**2 / (share * (1.0 - share))))
        tests.append(Adequacy(fitter.records[group[0]].name, "parameters", statistic, float(chdtrc(len(share), statistic))))
    return found, tests


def _axes(information: np.ndarray) -> np.ndarray:
    """Independent steps (unknowns, k) of one standard error each, of what is told at all."""
    size = np.sqrt(np.maximum(np.diag(information), 1e-300))
    values, vectors = np.linalg.eigh(information / np.outer(size, size))
    kept = values > COLLINEAR
    return vectors[:, kept] / np.sqrt(values[kept]) / size[:, None]


def controlled(tests: Sequence[Adequacy], level: float = FALSE_DISCOVERIES) -> list[Adequacy]:
    """The tests, each marked whether it fails (Benjamini and Hochberg 1995, J. R. Stat. Soc. B 57, 289)."""
    order = sorted(range(len(tests)), key=lambda place: tests[place].p_value)
    last = max((rank for rank, place in enumerate(order, 1) if tests[place].p_value <= level * rank / len(tests)), default=0)
    failing = set(order[:last])
    return [replace(test, fails=place in failing) for place, test in enumerate(tests)]
