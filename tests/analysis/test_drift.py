"""Offset and drift of a sensor: what is left out of a record of any length."""

import numpy as np
import pytest

from testbed.analysis.fit.drift import DRIFT_ORDER, MOST_DRIFT, drift_basis, drift_terms, of_a_part, over

RATE = 200.0


def test_terms_grow_with_the_length_and_slowly_for_a_slow_structure():
    assert drift_terms(0.5, 150.0) == drift_terms(60.0, 1.0) == DRIFT_ORDER and drift_terms(60.0, 150.0) == DRIFT_ORDER + 60
    assert of_a_part(63, 0.5) == 32 and of_a_part(63, 0.01) == MOST_DRIFT and of_a_part(5, 0.5) == 5


@pytest.mark.parametrize("samples", [3000, 3001, 100])
@pytest.mark.parametrize("believed", [False, True])
def test_splines_are_the_matrix_that_they_write_out(samples, believed):
    splines = drift_basis(samples, 33)
    random = np.random.default_rng(1)
    if believed:
        kept = random.random(samples) > 0.1
        kept[samples // 3 : samples // 2] = False
        splines = over(splines, kept)
    matrix, rows = np.asarray(splines), random.standard_normal((2, 3, len(splines)))
    assert matrix.shape == splines.shape and splines.T.shape == splines.shape[::-1]
    assert np.allclose(matrix.T @ matrix, np.eye(matrix.shape[1]), atol=1e-10)
    assert np.allclose(rows @ splines, rows @ matrix) and np.allclose((rows @ splines) @ splines.T, (rows @ matrix) @ matrix.T)
    one = rows[0, 0]
    assert np.allclose(splines.T @ one, matrix.T @ one) and np.allclose(splines @ (splines.T @ one), matrix @ (matrix.T @ one))


@pytest.mark.parametrize("seconds", [5.0, 20.0, 60.0, 120.0])
def test_a_drift_that_turns_in_nine_seconds_goes_and_a_vibration_stays(seconds):
    time = np.arange(round(seconds * RATE)) / RATE
    basis = drift_basis(len(time), drift_terms(seconds, 150.0))
    drift, swing = np.sin(0.7 * time + 1.0), np.sin(2 * np.pi * 10.0 * time)
    left = [values - basis @ (basis.T @ values) for values in (drift, swing)]
    assert np.std(left[0]) < 1e-3 and np.std(left[1]) > 0.998 * np.std(swing)
