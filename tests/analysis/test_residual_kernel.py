"""Residuals in two passes over the samples against the plain formula."""

import numpy as np
import pytest

from testbed.analysis.fit.fit_state import of_rows
from testbed.analysis.fit.residual_kernel import difference, fill_residuals

FAR, LARGEST = 1e3, 50.0
RNG = np.random.default_rng(4)


def plainly(predicted, data, scale, drift, counted):
    rest = (data - np.clip(np.nan_to_num(predicted, nan=FAR), -FAR, FAR)) / scale[:, None]
    rest = rest if counted is None else rest[..., counted]
    return np.clip(rest - (rest @ drift) @ drift.T, -LARGEST, LARGEST).reshape(len(predicted), -1)


@pytest.mark.parametrize("samples", (7, 1024, 2500))  # less than a block of samples, one, and some and a part
@pytest.mark.parametrize("terms", (0, 3))
@pytest.mark.parametrize("masked", (False, True))
def test_fill_residuals_is_the_plain_formula(samples, terms, masked):
    predicted, data, scale = RNG.normal(size=(4, 2, samples)), RNG.normal(size=(2, samples)), np.array([0.3, 2.0])
    predicted[1, 0, 2], predicted[2, 1, 3], predicted[3] = np.nan, -1e9, np.nan
    counted = np.flatnonzero(RNG.random(samples) < 0.7) if masked else None
    values = samples if counted is None else len(counted)
    drift = np.linalg.qr(RNG.normal(size=(values, 3)))[0][:, :terms]
    found = np.full((4, 2 * values + 2), 7.0)
    fill_residuals(predicted, data, scale, drift, counted, (FAR, LARGEST), found)
    np.testing.assert_allclose(found[:, :-2], plainly(predicted, data, scale, drift, counted), rtol=1e-11, atol=1e-12)
    assert (found[:, -2:] == 7.0).all()


def test_predictions_that_are_a_view_give_the_same():
    whole = RNG.normal(size=(3, 6, 500))
    data, scale, drift = RNG.normal(size=(2, 400)), np.ones(2), np.ones((400, 1)) / 20.0
    found, copied = np.empty((3, 800)), np.empty((3, 800))
    fill_residuals(whole[:, 1:3, :400], data, scale, drift, None, (FAR, LARGEST), found)
    fill_residuals(whole[:, 1:3, :400].copy(), data, scale, drift, None, (FAR, LARGEST), copied)
    assert (found == copied).all()


def test_difference_leaves_the_columns_behind():
    rows = RNG.normal(size=(3, 20))
    before = rows.copy()
    difference(rows, 18, np.array([0.5, -2.0]))
    np.testing.assert_allclose(rows[1:, :18], (before[1:, :18] - before[0, :18]) / np.array([[0.5], [-2.0]]), rtol=1e-14)
    assert (rows[0] == before[0]).all() and (rows[:, 18:] == before[:, 18:]).all()


def test_products_are_those_of_residual_and_slopes():
    rows = RNG.normal(size=(6, 40))
    part = of_rows(rows, 3, [{"displacement": 1.0}, {"angle": 1.0}])
    own, shared = part.own.T, part.shared.T
    for found, plain in zip(part.products, (own @ own.T, own @ shared.T, own @ rows[0], shared @ shared.T, shared @ rows[0]),
                            strict=True):  # fmt: skip
        np.testing.assert_allclose(found, plain, rtol=1e-12)
