"""How many modes a band holds: stable poles are taken one by one, as long as the information criterion asks for one more."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from testbed.analysis.tap.poles import Stabilisation
from testbed.analysis.tap.real_modes import Fit, Lines, fit_modes, residues, shapes_of

MOST_MODES = 12
DECISIVE = 10.0  # gain of BIC that one more mode must bring
_AHEAD = 2  # modes more, that are tried before the search ends
_MUCH = 0.3  # of the measured response, weighted: a fit that leaves more is no end of the search
_SOME = 0.999  # of what was left, that one mode more must take away to be looked at
TAKES = 0.72  # of the squared misfit beyond the noise, that one more mode may leave at the most
_TRIED = 2  # of the candidates that leave least with poles held, how many are fitted in full
_FEW, _MORE = 3, 40  # steps of a fit within the search: where much is left, and after
_LONGEST = 50  # lines over which neighbouring misfits may go together
_APART = 0.5  # of its damping ratio, by which a mode that becomes two is moved either way
_SAME = 0.002  # of a frequency and as much of damping: a candidate that stands already


@dataclass(frozen=True)
class Step:
    """One number of modes: the best fit with it, its gain of BIC over the fit chosen before, and over how many lines its misfit
    goes together."""

    fit: Fit
    gain: float
    together: float


def together(lines: Lines, misfit: np.ndarray) -> float:
    """Over how many neighbouring lines a misfit goes together: 1 where it is noise."""
    total, place = 0.0, 0
    for one in lines.laplace:
        real, imaginary = misfit[place : place + len(one)], misfit[place + len(one) : place + 2 * len(one)]
        place += 2 * len(one)
        values = real + 1j * imaginary
        power = float(np.vdot(values, values).real)
        if power <= 0.0:
            continue
        length = 1.0
        for lag in range(1, min(_LONGEST, len(values) // 3)):
            share = float(np.vdot(values[:-lag], values[lag:]).real) / power
            if share < 2.0 / np.sqrt(len(values)):
                break
            length += 2.0 * share
        total += length * len(one)
    return max(1.0, total / (lines.count / 2))


def criterion(lines: Lines, fit: Fit, goes: float) -> float:
    """BIC with the noise's size unknown, of as many independent lines as the misfit shows."""
    rows = lines.count / goes
    unknowns = fit.parameters.size + 2 * len(lines.responses)
    return rows * np.log(max(fit.cost, 1e-300) / rows) + unknowns * np.log(rows)


def choose(lines: Lines, found: Stabilisation, asked: int | None = None) -> tuple[list[Step], int, int]:
    """Fits with 0, 1, 2, ... modes, how many are chosen: as many as `asked`, if stable poles go so far; how many data ask for.

    A mode more is asked for where BIC falls by DECISIVE with it and it takes away enough of what is no noise: real structures
    are no sum of a few real modes, and small modes would mend that for ever. Two modes more may earn it together. While a fit
    leaves much, all its misfit goes together and proves nothing: the search goes on.
    """
    empty = fit_modes(lines, np.empty((0, 2 + lines.basis.shape[0])), np.empty(0))
    steps, chosen, size = [Step(empty, 0.0, 1.0)], 0, empty.cost
    while len(steps) <= MOST_MODES and (len(steps) <= (asked or 0) or len(steps) - chosen <= _AHEAD
                                        or steps[-1].fit.cost > _MUCH**2 * size):
        much = steps[-1].fit.cost > _MUCH**2 * size
        trial = _one_more(lines, steps[-1].fit, found, much)
        if trial is None or not much and trial.cost > _SOME * steps[-1].fit.cost:
            break
        if much and trial.cost <= _MUCH**2 * size:  # from here on, what is left is asked for what it is
            trial = fit_modes(lines, trial.parameters, trial.signs, _MORE)
        goes = together(lines, trial.misfit)
        steps.append(Step(trial, criterion(lines, steps[chosen].fit, goes) - criterion(lines, trial, goes), goes))
        more, least = len(steps) - 1 - chosen, steps[chosen].fit.beyond_noise
        if steps[-1].gain > DECISIVE * more and trial.beyond_noise <= TAKES**more * least:
            chosen = len(steps) - 1
    return steps, min(asked, len(steps) - 1) if asked else chosen, chosen


def _one_more(lines: Lines, fit: Fit, found: Stabilisation, much: bool) -> Fit | None:
    """The best fit with one mode more: a stable pole that is not taken or, where little is left, a mode that becomes two."""
    have = np.exp(fit.parameters[:, :2])
    trials = [np.vstack([have, [2.0 * np.pi * frequency, damping]]) for frequency, damping, _ in found.stable
              if not _taken(have, 2.0 * np.pi * frequency, damping)]
    for place in range(0 if much else len(have)):
        omega, damping = have[place]
        apart = max(_APART * damping, 2.0 * _SAME)
        pair = [[omega * (1.0 - apart), damping * (1.0 - _APART)], [omega * (1.0 + apart), damping * (1.0 - _APART)]]
        trials.append(np.vstack([np.delete(have, place, axis=0), pair]))
    candidates: list[tuple[float, int, np.ndarray, np.ndarray]] = []
    for poles in trials:
        free, cost = residues(lines, poles[:, 0], poles[:, 1])
        candidates.append((cost, len(candidates), poles, free))
    best: Fit | None = None
    for _, _, poles, free in sorted(candidates, key=lambda one: one[:2])[:_TRIED]:
        shapes, signs = shapes_of(lines, free)
        trial = fit_modes(lines, np.column_stack([np.log(poles), shapes]), signs, _FEW if much else _MORE)
        if best is None or trial.cost < best.cost:
            best = trial
    return best


def _taken(have: np.ndarray, omega: float, damping: float) -> bool:
    return any(abs(omega / one - 1.0) < _SAME and abs(damping - other) < max(_SAME, 0.2 * damping) for one, other in have)
