"""Sensor lag: a sensor of first order, too slow for the fastest part of the motion.

    T y' + y = u,    H(i w) = 1 / (1 + i w T): amplitude 1 / sqrt(1 + (w T)^2), phase -atan(w T)

Source: E. O. Doebelin (2004), Measurement Systems, 5th ed., McGraw-Hill, chapter 3 (first-order instrument).

Valid for an amplifier, a filter or a sensor whose bandwidth 1 / (2 pi T) is limited by one pole. The motion between two
samples is taken as the cubic through their values and rates, for which the response is exact. The sensor starts in rest
at the first sample.

A lag turns the phase of the cut against the tachometer and passes for another cutting coefficient: the residual can be
white while K_t is wrong by a third. Start of a fit: a tenth of the sampling interval, then its delay against a
ring-down's phase.
"""

import math

import numpy as np

from testbed.effect import Effect, Parameter

EFFECT = Effect(
    title="First-order lag of the sensor",
    parameters=(
        Parameter("time_constant", "T", "s", "time constant of the sensor, 1 / (2 pi bandwidth)",
                  neutral=0.0, bounds=(0.0, 10.0), example=2.0e-4, start=2.0e-5),
    ),
    law="T y' + y = u; u: what is measured, y: the reading",
    source="Doebelin (2004), Measurement Systems, 5th ed., chapter 3",
    validity="one pole; samples close enough for a cubic between them",
    leaves="late and flattened transients; a bias of K_t against the tachometer, and of amplitude at high speed",
    confused_with=(
        ("helix", "a shallow against a deep cut at one speed: helix lag grows with depth, a sensor's does not"),
        ("immersion_error", "one cut at two speeds: a lag in time is another angle at another speed"),
    ),
)


_POINTS, _WEIGHTS = np.polynomial.legendre.leggauss(16)


def _moments(a):
    """Integrals over s from 0 to 1 of a exp(-a (1 - s)) s^k, k = 0..3."""
    if a < 2.0:  # the recursion would lose digits
        s = 0.5 * (_POINTS + 1.0)
        return [float(np.sum(0.5 * _WEIGHTS * a * np.exp(-a * (1.0 - s)) * s**k)) for k in range(4)]
    moments = [-math.expm1(-a)]
    for k in range(1, 4):
        moments.append(1.0 - k / a * moments[-1])
    return moments


def measure(signal, rate, sampling_rate, time_constant):
    if len(signal) == 0:
        return signal
    from scipy.signal import lfilter  # slow to import, wanted by few

    h = 1.0 / sampling_rate
    one, s, s2, s3 = _moments(h / time_constant)
    step = ((one - 3.0 * s2 + 2.0 * s3) * signal[:-1] + (3.0 * s2 - 2.0 * s3) * signal[1:]
            + h * ((s - 2.0 * s2 + s3) * rate[:-1] + (s3 - s2) * rate[1:]))
    decay = math.exp(-h / time_constant)
    lagged, _ = lfilter([1.0], [1.0, -decay], step, zi=[decay * signal[0]])
    return np.concatenate([signal[:1], lagged])
