"""The structure as free decays and driven records show it, before any fit: frequency, damping, and mass by a measured force."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from testbed.analysis.fit.modes_start import modes_start
from testbed.analysis.fit.observed import Observed
from testbed.analysis.records.decay_modes import decay_modes
from testbed.analysis.records.free_decay import FreeDecay, fit_free_decay, spectral_peak
from testbed.machine import Model
from testbed.recording import DERIVATIVES

NEAR = 0.05  # of a frequency, within which it is the same mode's
LEAVES = 2.0  # times the noise, beyond which one vibration leaves others of a decay


def decay_start(records: Sequence[Observed], model: Model) -> Model:
    """The model with frequency and damping of the records' free decays, weighted by how well each knows its decay."""
    found = []
    for record in records:
        for segment in record.segments:
            if segment.kind != "ring-down" or record.channels[0].startswith("force"):
                continue
            first = max(0, round((segment.start - record.start) * record.rate))
            last = min(record.samples, round((segment.stop - record.start) * record.rate))
            first += (last - first) // 3  # the later, smaller part is the more linear one
            values = record.data[0, first:last]
            if len(values) < 64 or np.std(values) < 2.0 * record.noise[0]:
                continue
            fit = fit_free_decay(values, first, spectral_peak(values - values.mean()), 1.0 / len(values))
            if fit is None or fit.decay <= 0 or not fit.decay_error < fit.decay:
                continue
            frequency, damping, weight = _the_mode(values, fit, record, model.structure.natural_frequency)
            found.append((frequency, damping, weight))
    if not found:
        return model
    frequency, damping, weight = np.array(found).T
    near = np.abs(frequency / np.median(frequency) - 1) < NEAR
    if not near.any():  # of two modes that ring, half of the decays each: the one that is believed in
        believed = frequency[np.argmin(np.abs(frequency / model.structure.natural_frequency - 1))]
        near = np.abs(frequency / believed - 1) < NEAR
    weight = np.minimum(weight, 20 * np.median(weight)) * near
    return model.with_values(
        {
            "natural_frequency": float(np.sum(frequency * weight) / weight.sum()),
            "damping_ratio": float(np.sum(damping * weight) / weight.sum()),
        }
    )


def _the_mode(values: np.ndarray, alone: FreeDecay, record: Observed, believed: float) -> tuple[float, float, float]:
    """(natural frequency in Hz, damping ratio, weight) of the mode of a decay that a structure of one mode is to be.

    Where several ring, the fit of one alone is none of them: of the modes the one near the believed frequency (Hz), else the
    one that moves most, as displacement: an accelerometer shows fast ones largest.
    """
    pole, error = complex(-alone.decay, 2 * math.pi * alone.frequency), alone.decay_error
    modes = decay_modes(values[None, :]) if alone.rest > LEAVES * record.noise[0] else None
    if modes is not None and len(modes) > 1:
        sizes = np.abs(modes.residues[:, 0] / modes.poles ** DERIVATIVES.get(record.channels[0].split("_")[0], 0))
        away = np.abs(np.abs(modes.poles) * record.rate / (2 * math.pi * believed) - 1)
        place = int(np.argmin(away)) if away.min() < NEAR else int(np.argmax(sizes))
        if modes.poles[place].real < 0:
            pole, error = complex(modes.poles[place]), math.sqrt(max(float(modes.covariance[place, 0, 0]), 0.0))
    return abs(pole) * record.rate / (2 * math.pi), -pole.real / abs(pole), (pole.real / max(error, 1e-12)) ** 2


def excited_start(records: Sequence[Observed], model: Model) -> Model:
    """The model with mass, frequency and damping of the receptance between a measured force and the response.

    1 / H = k - m w^2 + i c w, fitted by least squares with the weights of Sanathanan and Koerner (1963, IEEE Trans.
    Autom. Control 8, 56) around the highest peak, from Welch's averaged spectra.
    """
    from scipy.signal import csd  # slow to import, wanted by few

    driven = [record for record in records if record.force is not None and record.kind == "excited"]
    if not driven:
        return model
    record = max(driven, key=lambda one: float(np.std(one.data[0])) * one.samples)
    force = np.asarray(record.force, dtype=float)
    length = min(record.samples, max(256, int(record.samples // 8)))
    frequency, cross = csd(force, record.data[0], record.rate, nperseg=length)
    _, power = csd(force, force, record.rate, nperseg=length)
    omega = 2 * math.pi * frequency[2:]
    response = cross[2:] / np.maximum(power[2:].real, 1e-300)
    loud = power[2:].real > 1e-4 * power[2:].real.max()
    order = record.sensors[0].order if record.sensors[0] else 0
    receptance = response / (1j * omega) ** order
    strength = np.where(loud, np.abs(response), 0.0)
    peak = int(np.argmax(strength))
    near = loud & (omega > 0.3 * omega[peak]) & (omega < 1.7 * omega[peak])
    w, h = omega[near], receptance[near]
    if len(w) < 8:
        return model
    weight, mass, damping, stiffness = np.ones(len(w)), 0.0, 0.0, 0.0
    for _ in range(8):
        columns = np.stack([-(w**2) * h, 1j * w * h, h], axis=1) * weight[:, None]
        scale = np.linalg.norm(columns, axis=0)
        rows = np.vstack([(columns / scale).real, (columns / scale).imag])
        right = np.concatenate([weight, np.zeros(len(w))])
        mass, damping, stiffness = np.linalg.lstsq(rows, right, rcond=None)[0] / scale
        weight = 1.0 / np.maximum(np.abs(stiffness - mass * w**2 + 1j * damping * w), 1e-300)
        weight /= weight.max()
    if not (mass > 0 and stiffness > 0 and damping > 0):
        return model
    natural = math.sqrt(stiffness / mass)
    zeta = min(damping / (2 * mass * natural), 0.5)
    return model.with_values({"mass": mass, "natural_frequency": natural / (2 * math.pi), "damping_ratio": zeta})


def structure_start(records: Sequence[Observed], model: Model) -> Model:
    """The model with the structure as free decays and driven records show it, before any fit."""
    if model.structure.planar:
        return modes_start(records, model)
    return excited_start(records, decay_start(records, model))
