"""Residuals of many variants of one record, each in two passes over its samples: what a fit spends most of its arrays on."""

from typing import Any

import numpy as np
from numba import njit

from testbed.system.kernel_cache import kept

# sums may be taken in any order, so that several go forward at once; nothing is assumed of NaN or infinity
_SUMS = {"reassoc", "contract"}
_BLOCK = 1024  # samples that are worked on together: they stay in the fastest memory


def _part(function):
    return njit(fastmath=_SUMS, no_cpython_wrapper=True, error_model="numpy")(function)  # type: ignore[call-overload]


@_part
def _left(measured, guesses, share, far, rest):
    for place in range(rest.shape[0]):
        guess = guesses[place]
        guess = guess if guess < far else far  # so is a NaN
        rest[place] = (measured[place] - (guess if guess > -far else -far)) * share


@_part
def _dot(one, other):
    total = 0.0
    for place in range(one.shape[0]):
        total += one[place] * other[place]
    return total


@_part
def _subtract(rest, amount, course):
    for place in range(rest.shape[0]):
        rest[place] -= amount * course[place]


@_part
def _clip(rest, largest):
    for place in range(rest.shape[0]):
        value = rest[place] if rest[place] < largest else largest
        rest[place] = value if value > -largest else -largest


@kept(nogil=True, error_model="numpy")
def _fill(predicted, data, share, drift, far, largest, out):
    """See `fill_residuals`. share (channels,): of the scale; drift (terms, values that count)."""
    terms, values = drift.shape
    amounts = np.zeros(terms)
    for variant in range(predicted.shape[0]):
        for channel in range(predicted.shape[1]):
            first = channel * values
            amounts[:] = 0.0
            for begin in range(0, values, _BLOCK):
                end = min(begin + _BLOCK, values)
                rest = out[variant, first + begin : first + end]
                _left(data[channel, begin:end], predicted[variant, channel, begin:end], share[channel], far, rest)
                for term in range(terms):
                    amounts[term] += _dot(rest, drift[term, begin:end])
            for begin in range(0, values, _BLOCK):
                end = min(begin + _BLOCK, values)
                rest = out[variant, first + begin : first + end]
                for term in range(terms):
                    _subtract(rest, amounts[term], drift[term, begin:end])
                _clip(rest, largest)


@kept(nogil=True, error_model="numpy")
def difference(rows, size, steps):
    """Turn the first `size` values of rows 1, 2, ... into what they exceed row 0 by, over their steps; in place."""
    for row in range(1, rows.shape[0]):
        here, first, step = rows[row], rows[0], steps[row - 1]
        for place in range(size):
            here[place] = (here[place] - first[place]) / step


def fill_residuals(predicted: np.ndarray, data: np.ndarray, scale: np.ndarray, drift: Any, counted: np.ndarray | None,
                   limits: tuple[float, float], out: np.ndarray) -> None:  # fmt: skip
    """Into out (variants, channels * values that count) what predictions (variants, channels, samples) leave of the data.

    data (channels, samples); scale (channels,): what a residual of 1 stands for. drift (values that count, terms): orthonormal
    columns that are projected out, an array or `drift.Splines`; counted: places of the values that count, None where all do.
    limits: a prediction beyond the first, or none (NaN), is taken as that far off; a residual is no larger than the second.
    """
    if counted is not None:
        predicted, data = predicted[..., counted], data[:, counted]
    written = isinstance(drift, np.ndarray)
    columns = np.ascontiguousarray(drift.T) if written else np.empty((0, len(drift)))
    _fill(np.ascontiguousarray(predicted), np.ascontiguousarray(data), 1.0 / scale, columns,
          *(limits if written else (limits[0], np.inf)), out)  # fmt: skip
    for first in range(0, 0 if written else len(data) * len(drift), len(drift)):
        for row in out[:, first : first + len(drift)]:  # one by one: the record is long
            row -= (row @ drift) @ drift.T
            np.clip(row, -limits[1], limits[1], out=row)
