"""Errors a model makes on records that were held out of its fit, by operating condition.

Each condition is left out in turn: the shared parameters are refitted without it (Gauss-Newton from the joint optimum,
with the slopes at hand), then the condition's own nuisances alone are fitted and the record is predicted.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from analysis.observed import Observed
from analysis.waveform import Fitter, State, WaveformFit

SUSPECT = 2.0  # squared error over that in sample, from which a record left out is looked at with a fit of its own
SHORTER = (1.0, 0.3, 0.1)  # shares of a step that are tried until one helps
REFIT = 4  # iterations of that fit


@dataclass(frozen=True)
class RecordError:
    """rms(measured - predicted) and rms(measured about its mean), both in the channel's unit over all channels, per record.

    noise_doubt: standard error of the noise floor over itself.
    """

    name: str
    error: float
    noise_floor: float
    residual: np.ndarray
    squares: float
    size: float
    noise_squares: float
    noise_doubt: float = 0.0


def conditions_of(records: Sequence[Observed]) -> list[list[int]]:
    """Indices of the records of each operating condition."""
    groups: dict[tuple, list[int]] = {}
    for index, record in enumerate(records):
        groups.setdefault(record.condition, []).append(index)
    return list(groups.values())


def record_error(record: Observed, residual: np.ndarray) -> RecordError:
    """The error of one record from its residual (channels * samples,) in units of its scale.

    Several channels are weighed by their own size, so that the error is the rms of the channels' relative errors.
    """
    rest = residual.reshape(record.data.shape) * record.scale[:, None]
    size = record.data - record.data.mean(axis=1, keepdims=True)
    scale = np.ones(len(record.channels)) if len(set(_units(record))) == 1 else 1.0 / np.maximum(size.std(axis=1), 1e-300)
    squares = float(np.sum((rest * scale[:, None]) ** 2))
    total = float(np.sum((size * scale[:, None]) ** 2))
    noise = float(np.sum((record.noise * scale) ** 2) * record.samples)
    return RecordError(
        record.name, (squares / total) ** 0.5, (noise / total) ** 0.5, rest, squares, total, noise, record.noise_doubt
    )


def _units(record: Observed) -> list[str]:
    return ["force" if name.startswith("force") else name.split("_")[0] for name in record.channels]


def pooled(errors: Sequence[RecordError]) -> tuple[float, float]:
    """(error, noise floor) over records: root of summed squares over summed squares."""
    total = sum(one.size for one in errors)
    return (sum(one.squares for one in errors) / total) ** 0.5, (sum(one.noise_squares for one in errors) / total) ** 0.5


def pooled_doubt(errors: Sequence[RecordError]) -> float:
    """Standard error of the pooled noise floor over itself: how well the records' noise is known, each from its own samples."""
    total = sum(one.noise_squares for one in errors)
    return sum((one.noise_doubt * one.noise_squares) ** 2 for one in errors) ** 0.5 / max(total, 1e-300)


def own_refit(fitter: Fitter, state: State, indices: Sequence[int], rounds: int = 2) -> State:
    """The state with the own unknowns of some records refitted at fixed machine parameters; no record gets worse."""
    changed = list(state.nuisances)
    for index in indices:
        single = Fitter(fitter.plant, [fitter.records[index]], fitter.unknowns)
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
        return [record_error(record, rest) for record, rest in zip(fitter.records, fit.residuals, strict=True)]
    errors: dict[int, RecordError] = {}
    for group in groups:
        others = [index for index in range(len(fitter.records)) if index not in group]
        rests = _predicted(fitter, _stepped(fitter, fit, others), group)
        inside = sum(float(fit.residuals[index] @ fit.residuals[index]) for index in group)
        if not sum(float(rest @ rest) for rest in rests) < SUSPECT * inside:
            rests = _predicted(fitter, _refitted(fitter, fit, others), group)
        for index, rest in zip(group, rests, strict=True):
            errors[index] = record_error(fitter.records[index], rest)
    return [errors[index] for index in range(len(fitter.records))]


def _predicted(fitter: Fitter, state: State, group: Sequence[int]) -> list[np.ndarray]:
    """Residuals of the records left out, their own unknowns alone refitted."""
    state = own_refit(fitter, state, group)
    return [fitter.residual_of(index, state) for index in group]


def _stepped(fitter: Fitter, fit: WaveformFit, others: Sequence[int]) -> State:
    """The state without the group by one Gauss-Newton step from the joint optimum, with the slopes at hand."""
    move, _ = fitter.step(fit.parts, 1e-9, used=others)
    known = fitter.cost(fit.state, others)
    share = 1.0
    while share > 0.1 and not fitter.cost(fitter.moved(fit.state, share * move), others) <= 1.05 * known:
        share *= 0.5  # where the records left are not linear over so long a step
    return fitter.moved(fit.state, share * move) if share > 0.1 else fit.state


def _refitted(fitter: Fitter, fit: WaveformFit, others: Sequence[int]) -> State:
    """The state without the group by a fit of the records left: where one step led astray."""
    left = Fitter(fitter.plant, [fitter.records[index] for index in others], fitter.unknowns)
    own = tuple(fit.state.nuisances[index] for index in others)
    found = left.fit(replace(fit.state, nuisances=own), iterations=REFIT).state
    return replace(found, nuisances=fit.state.nuisances)
