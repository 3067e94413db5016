"""Offset and slow drift of a sensor, which enter a record linearly: what is slow beside a structure's vibration is left out.

A short record's is a polynomial. A long record's may turn often: cubic splines of equal spans, one each DRIFT_TIME, so that
what is left out of a record ends at the same frequency however long it is.
"""

from __future__ import annotations

from typing import Any

import numpy as np

DRIFT_ORDER = 3  # offset and slow drift: this many terms, and one more for every
DRIFT_TIME, DRIFT_PERIODS = 1.0, 100.0  # s of the record, or as many periods of the structure where they are longer
MOST_DRIFT = 10  # terms of a polynomial; splines beyond
SEEN = 1e-10  # of the largest: what of a spline the samples must show for it to count


def drift_terms(duration: float, frequency: float) -> int:
    """Terms for a record (s) of a structure whose natural frequency (Hz) is this: what is slow is so beside its vibration."""
    return DRIFT_ORDER + int(duration / max(DRIFT_TIME, DRIFT_PERIODS / frequency))


def of_a_part(terms: int, share: float) -> int:
    """Terms for a share of a record that has so many."""
    return min(terms, max(MOST_DRIFT, round(terms * share)))


def drift_basis(samples: int, terms: int = DRIFT_ORDER) -> Any:
    """Orthonormal columns (samples, terms) that span the drift of a record: polynomials as an array, or Splines."""
    if terms > MOST_DRIFT:
        return Splines(samples, terms - 3)
    if terms == 0:
        return np.zeros((samples, 0))
    powers = np.polynomial.legendre.legvander(np.linspace(-1, 1, samples), terms - 1)
    return np.asfortranarray(np.linalg.qr(powers)[0])  # column by column it is projected out twice as fast


def over(basis: Any, believed: np.ndarray | None) -> Any:
    """Orthonormal columns for the samples that are believed alone; believed: (samples,), bool, or None: for all."""
    if believed is None:
        return basis
    if isinstance(basis, Splines):
        return Splines(len(basis), basis.spans, believed)
    return np.asfortranarray(np.linalg.qr(basis[believed])[0])


class Splines:
    """Orthonormal columns that span the cubic splines of equal spans: a matrix (samples, terms) that is never written out.

    As all spans are sampled alike, a table of one does for all: it takes no memory, and its time does not grow with the terms.
    `rows @ splines`, `splines @ terms` and `splines.T` are as a matrix's; np.asarray writes it out.
    """

    __array_ufunc__ = None  # an array before `@` leaves it to this

    def __init__(self, samples: int, spans: int, believed: np.ndarray | None = None) -> None:
        """believed: (samples,), those that are rows of the matrix; all, where None."""
        each = -(-samples // spans)
        self.samples, self.spans, self._believed, self._turned = samples, -(-samples // each), believed, False
        at = (np.arange(each) + 0.5) / each
        rising, falling = (at**3, (1 - at) ** 3), (3 * at**3 - 6 * at**2 + 4, 3 * (1 - at) ** 3 - 6 * (1 - at) ** 2 + 4)
        self._table = np.column_stack([rising[1], falling[0], falling[1], rising[0]]) / 6
        sizes, vectors = np.linalg.eigh(self._products())
        seen = sizes > SEEN * sizes[-1]
        self._weights = vectors[:, seen] / np.sqrt(sizes[seen])

    def _products(self) -> np.ndarray:
        """Scalar products of the splines, (spans + 3, spans + 3)."""
        counts = np.ones(self.samples) if self._believed is None else self._believed.astype(float)
        found, spans = np.zeros((self.spans + 3, self.spans + 3)), np.arange(self.spans)
        for one in range(4):
            for other in range(4):
                found[spans + one, spans + other] += self._of_spans(counts, self._table[:, one] * self._table[:, other])
        return found

    def _of_spans(self, values: np.ndarray, table: np.ndarray) -> np.ndarray:
        """Products of the values (..., samples) of each span with a table (samples a span, ...): (..., spans, ...)."""
        each = len(table)
        whole = values.shape[-1] // each
        first = values[..., : whole * each].reshape(*values.shape[:-1], whole, each) @ table
        if whole == self.spans:
            return first
        rest = values[..., whole * each :] @ table[: values.shape[-1] - whole * each]
        return np.concatenate([first, np.expand_dims(rest, values.ndim - 1)], axis=values.ndim - 1)

    @property
    def shape(self) -> tuple[int, int]:
        """(samples, terms), or the other way round."""
        rows = self.samples if self._believed is None else int(np.count_nonzero(self._believed))
        terms = self._weights.shape[1]
        return (terms, rows) if self._turned else (rows, terms)

    def __len__(self) -> int:
        return self.shape[0]

    @property
    def T(self) -> Splines:  # noqa: N802 - as numpy's
        """The transposed matrix."""
        turned = Splines.__new__(Splines)
        turned.__dict__ |= self.__dict__ | {"_turned": not self._turned}
        return turned

    def __matmul__(self, right: np.ndarray) -> np.ndarray:
        return np.asarray((np.asarray(right).T @ self.T).T)

    def __rmatmul__(self, left: np.ndarray) -> np.ndarray:
        if self._turned:
            return self._from_terms(left @ self._weights.T)
        if self._believed is not None:
            whole = np.zeros((*left.shape[:-1], self.samples))
            whole[..., self._believed] = left
            left = whole
        found, parts = np.zeros((*left.shape[:-1], self.spans + 3)), self._of_spans(left, self._table)
        for one in range(4):
            found[..., one : one + self.spans] += parts[..., one]
        return found @ self._weights

    def _from_terms(self, terms: np.ndarray) -> np.ndarray:
        """Values (..., samples) of splines with these coefficients (..., spans + 3)."""
        four = np.stack([terms[..., one : one + self.spans] for one in range(4)], axis=-1)
        values = (four @ self._table.T).reshape(*terms.shape[:-1], -1)[..., : self.samples]
        return values if self._believed is None else values[..., self._believed]

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> np.ndarray:
        """The matrix, written out."""
        whole = np.eye(min(self.shape)) @ (self if self._turned else self.T)
        return whole if self._turned else whole.T
