"""Errors a model makes on records that were held out of its fit, by operating condition.

Each condition is left out in turn: the shared parameters are refitted without it (Gauss-Newton from the joint optimum,
with the slopes at hand), then the condition's own nuisances alone are fitted and the record is predicted.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import chdtri

from testbed.analysis.fit.fit_state import State, WaveformFit
from testbed.analysis.fit.least_squares import gauss_newton_step
from testbed.analysis.fit.observed import Observed
from testbed.analysis.fit.waveform import Fitter
from testbed.recording import quantity_of

SUSPECT = 2.0  # squared error over that in sample, from which a record left out is looked at with a fit of its own
NOTABLE = 1.2  # the same, from which it matters whether the others agree with the joint fit
SHORTER = (1.0, 0.3, 0.1)  # shares of a step that are tried until one helps
REFIT = 4  # iterations of that fit
AGREE = 0.999  # probability that noise alone lets other records prefer their own parameters by less than they do


@dataclass(frozen=True)
class RecordError:
    """How far the prediction of one record is off.

    error: rms(measured - predicted) over rms(measured about its mean); noise_floor: rms of the noise over the same; residual:
    measured - predicted (channels, samples) in the channels' units. squares, size, noise_squares: the sums of squares that
    those ratios are made of, in the unit of `quantity` squared. noise_doubt: standard error of the noise floor over itself.
    squares_in_fit: those in the joint fit, told only of a record far from the others (ten times as loud, say) that was held
    out: they do not know what it shows, but what the joint fit makes of it suits them as well.
    """

    name: str
    error: float
    noise_floor: float
    residual: np.ndarray
    squares: float
    size: float
    noise_squares: float
    noise_doubt: float = 0.0
    quantity: str = ""
    squares_in_fit: float | None = None


def conditions_of(records: Sequence[Observed]) -> list[list[int]]:
    """Indices of the records of each operating condition."""
    groups: dict[tuple, list[int]] = {}
    for index, record in enumerate(records):
        groups.setdefault(record.condition, []).append(index)
    return list(groups.values())


def holds_out(records: Sequence[Observed]) -> bool:
    """Whether a condition can be left out of a fit: of one alone, every error is that in the fit."""
    return len(conditions_of(records)) > 1


def record_error(record: Observed, residual: np.ndarray) -> RecordError:
    """The error of one record from its residual (channels * samples,) in units of its scale.

    Channels of several quantities are weighed by their own size, so that the error is the rms of their relative errors.
    """
    rest = record.on_samples(residual) * record.scale[:, None]
    data = record.data if record.mask is None else record.data[:, record.mask]
    size = data - data.mean(axis=1, keepdims=True)
    quantities = sorted({quantity_of(name) for name in record.channels})
    scale = np.ones(len(record.channels)) if len(quantities) == 1 else 1.0 / np.maximum(size.std(axis=1), 1e-300)
    squares = float(np.sum((rest * scale[:, None]) ** 2))
    total = float(np.sum((size * scale[:, None]) ** 2))
    noise = float(np.sum((record.noise * scale) ** 2) * record.count)
    return RecordError(record.name, (squares / total) ** 0.5, (noise / total) ** 0.5, rest, squares, total, noise,
                       record.noise_doubt, " and ".join(quantities))


def errors_in_fit(fitter: Fitter, fit: WaveformFit) -> list[RecordError]:
    """The error of every record in the fit itself."""
    return [record_error(record, rest) for record, rest in zip(fitter.records, fit.residuals, strict=True)]


def pooled(errors: Sequence[RecordError]) -> tuple[float, float]:
    """(error, noise floor) over records: root of summed squares over summed squares.

    Newtons and metres cannot be summed: records of different quantities count by their samples, each relative to the size of
    all that measure the same.
    """
    shares = _shares(errors)
    error = sum(share * one.squares for share, one in zip(shares, errors, strict=True))
    return error**0.5, sum(share * one.noise_squares for share, one in zip(shares, errors, strict=True)) ** 0.5


def pooled_where_known(errors: Sequence[RecordError]) -> float:
    """The pooled error with records of which the others know nothing taken as they are in the joint fit."""
    squares = [one.squares if one.squares_in_fit is None else one.squares_in_fit for one in errors]
    return float(sum(share * square for share, square in zip(_shares(errors), squares, strict=True)) ** 0.5)


def pooled_doubt(errors: Sequence[RecordError]) -> float:
    """Standard error of the pooled noise floor over itself: how well the records' noise is known, each from its own samples."""
    parts = [share * one.noise_squares for share, one in zip(_shares(errors), errors, strict=True)]
    doubt = sum((one.noise_doubt * part) ** 2 for part, one in zip(parts, errors, strict=True)) ** 0.5
    return doubt / max(sum(parts), 1e-300)


def _shares(errors: Sequence[RecordError]) -> list[float]:
    """What every record's squares are multiplied by where they are pooled."""
    sizes: dict[str, float] = {}
    counts: dict[str, int] = {}
    for one in errors:
        sizes[one.quantity] = sizes.get(one.quantity, 0.0) + one.size
        counts[one.quantity] = counts.get(one.quantity, 0) + one.residual.size
    whole = sum(counts.values())
    return [counts[one.quantity] / whole / sizes[one.quantity] for one in errors]


def own_refit(fitter: Fitter, state: State, indices: Sequence[int], rounds: int = 2) -> State:
    """The state with the own unknowns of some records refitted at fixed machine parameters; no record gets worse."""
    changed = list(state.nuisances)
    for index in indices:
        single = fitter.of_records([index])
        own = replace(state, nuisances=(changed[index],))
        for _ in range(rounds):
            part = single.linearise(0, own)
            if part.own.shape[1] == 0:
                break
            move = -np.linalg.lstsq(part.own, part.residual, rcond=1e-12)[0]
            tried = (single.with_own(own, [share * move]) for share in SHORTER)
            better = next((one for one in tried if single.cost(one) < 0.5 * float(part.residual @ part.residual)), None)
            if better is None:
                break
            own = better
        changed[index] = own.nuisances[0]
    return replace(state, nuisances=tuple(changed))


def held_out_errors(fitter: Fitter, fit: WaveformFit) -> list[RecordError]:
    """Every record's error with its operating condition left out of the fit; in sample where there is one condition."""
    groups = conditions_of(fitter.records)
    if len(groups) < 2:
        return errors_in_fit(fitter, fit)
    errors: dict[int, RecordError] = {}
    for group in groups:
        others = [index for index in range(len(fitter.records)) if index not in group]
        state, agree = _stepped(fitter, fit, others)
        rests = _predicted(fitter, state, group)
        inside = sum(float(fit.residuals[index] @ fit.residuals[index]) for index in group)
        outside = sum(float(rest @ rest) for rest in rests)
        if not outside < SUSPECT * inside:
            state, agree = _refitted(fitter, fit, others)
            rests = _predicted(fitter, state, group)
        elif outside < NOTABLE * inside:
            agree = False  # what was left out is foretold: that error is told
        for index, rest in zip(group, rests, strict=True):
            record = fitter.records[index]
            in_fit = record_error(record, fit.residuals[index]).squares if agree else None
            errors[index] = replace(record_error(record, rest), squares_in_fit=in_fit)
    return [errors[index] for index in range(len(fitter.records))]


def _predicted(fitter: Fitter, state: State, group: Sequence[int]) -> list[np.ndarray]:
    """Residuals of the records left out, their own unknowns alone refitted."""
    state = own_refit(fitter, state, group)
    return [fitter.residual_of(index, state) for index in group]


def _stepped(fitter: Fitter, fit: WaveformFit, others: Sequence[int]) -> tuple[State, bool]:
    """The state without the group by one Gauss-Newton step from the joint optimum, with the slopes at hand.

    And whether the joint one suits the records left, as far as that step goes: see `_agree`.
    """
    move, _ = gauss_newton_step(fit.parts, 1e-9, used=others)
    known = fitter.cost(fit.state, others)
    share = 1.0
    while share > 0.1:
        moved = fitter.moved(fit.state, share * move)
        cost = fitter.cost(moved, others)
        if cost <= 1.05 * known:
            return moved, _agree(known - cost, fit.variance, len(fitter.names))
        share *= 0.5  # where the records left are not linear over so long a step
    return fit.state, False


def _refitted(fitter: Fitter, fit: WaveformFit, others: Sequence[int]) -> tuple[State, bool]:
    """The state without the group by a fit of the records left, where one step led astray; whether the joint one suits them."""
    left, joint = fitter.of_records(others), fit.state.of_records(others)
    found = left.fit(joint, iterations=REFIT)
    agree = _agree(left.cost(joint) - found.cost, found.variance, len(fitter.names))
    return replace(found.state, nuisances=fit.state.nuisances), agree


def _agree(saved: float, variance: float, parameters: int) -> bool:
    """Whether records agree with parameters that are not their own optimum, which would save so much of their cost.

    They do where it explains them no better than noise alone lets it (likelihood ratio).
    """
    return 2.0 * saved / max(1.0, variance) <= float(chdtri(parameters, 1.0 - AGREE))
