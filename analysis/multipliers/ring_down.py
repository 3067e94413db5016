"""Natural frequencies and damping ratios of a structure in free decay, and from an impact test.

A free decay is a sum of damped sinusoids on an offset and a slope. Amplitudes are linear and projected out, so only
frequency and damping of each mode are searched (variable projection); displacement, velocity and acceleration decay
alike. An impact test is fitted in frequency: one mode with residual terms for the modes left and right of the band.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import median_filter
from scipy.optimize import least_squares

from testbed.analysis.information import Z_95
from testbed.recording import Recording


@dataclass(frozen=True)
class RingDown:
    """Modes of a free decay, strongest first.

    natural_frequency (modes,): undamped, Hz; damping_ratio (modes,); each with 95 % intervals `_low`, `_high`;
    covariance (2 modes, 2 modes) of [frequencies, damping ratios]; amplitude (modes,): at the start, the channel's
    unit; noise: rms of the residual; start, stop: the window used, s.
    """

    natural_frequency: np.ndarray
    damping_ratio: np.ndarray
    natural_frequency_low: np.ndarray
    natural_frequency_high: np.ndarray
    damping_ratio_low: np.ndarray
    damping_ratio_high: np.ndarray
    covariance: np.ndarray
    amplitude: np.ndarray
    noise: float
    start: float
    stop: float


def _columns(time: np.ndarray, parameters: np.ndarray, trend: int) -> np.ndarray:
    """Sine and cosine of each mode and powers of time below `trend`, (samples, 2 modes + trend)."""
    columns = []
    for frequency, damping in parameters.reshape(2, -1).T:
        omega = 2.0 * math.pi * frequency
        zeta = min(max(damping, -0.99), 0.99)
        envelope = np.exp(-zeta * omega * time)
        turned = omega * math.sqrt(1.0 - zeta**2) * time
        columns += [envelope * np.cos(turned), envelope * np.sin(turned)]
    span = time[-1] - time[0]
    columns += [(time / span) ** power for power in range(trend)]
    return np.column_stack(columns)


def _residual(parameters: np.ndarray, time: np.ndarray, data: np.ndarray, trend: int) -> np.ndarray:
    basis, _ = np.linalg.qr(_columns(time, parameters, trend))
    return data - basis @ (basis.T @ data)


def _peak(data: np.ndarray, rate: float, lowest: float) -> float:
    """Frequency (Hz) of the tallest spectral peak above `lowest`, refined by a parabola through its neighbours."""
    window = np.hanning(2 * data.size)[data.size:]  # falling only: a decay is strongest at its start
    spectrum = np.abs(np.fft.rfft(data * window, 4 * data.size))
    step = rate / (4 * data.size)
    spectrum[:max(1, int(lowest / step))] = 0.0
    k = int(np.clip(np.argmax(spectrum), 1, spectrum.size - 2))
    left, top, right = np.log(spectrum[k - 1:k + 2] + 1e-300)
    return (k + 0.5 * (left - right) / (left - 2.0 * top + right)) * step


def _first_guess(data: np.ndarray, rate: float, trend: int, n_modes: int) -> np.ndarray:
    """One mode after the other: the peak of what is left, its damping by a scan."""
    time = np.arange(data.size) / rate
    frequencies: list[float] = []
    dampings: list[float] = []
    left = _residual(np.empty((2, 0)).ravel(), time, data, trend) if trend else data - data.mean()
    for _ in range(n_modes):
        frequency = _peak(left, rate, 1.5 * rate / data.size)
        trials = np.geomspace(1e-4, 0.3, 30)
        costs = [np.sum(_residual(np.array([*frequencies, frequency, *dampings, zeta]), time, data, trend) ** 2)
                 for zeta in trials]
        frequencies.append(frequency)
        dampings.append(float(trials[int(np.argmin(costs))]))
        left = _residual(_refined(np.array(frequencies + dampings), time, data, trend).x, time, data, trend)
    return np.array(frequencies + dampings)


def _refined(parameters: np.ndarray, time: np.ndarray, data: np.ndarray, trend: int):
    """Least squares of frequencies and damping ratios from these."""
    modes = parameters.size // 2
    low = np.concatenate([np.full(modes, 0.2 / (time[-1] - time[0])), np.full(modes, -0.2)])
    high = np.concatenate([np.full(modes, 0.5 * (time.size - 1) / (time[-1] - time[0])), np.full(modes, 0.95)])
    return least_squares(_residual, np.clip(parameters, 1.001 * low, 0.999 * high), args=(time, data, trend),
                         bounds=(low, high), x_scale=np.abs(parameters) + 1e-4, xtol=1e-13, ftol=1e-13, gtol=1e-13)


def _window_length(parameters: np.ndarray, amplitude: np.ndarray, noise: float, rate: float, total: int) -> int:
    """Samples until the slowest decay has sunk to half the noise's rms: later ones would only teach the offset."""
    omega_zeta = 2.0 * math.pi * parameters.reshape(2, -1)[0] * np.maximum(parameters.reshape(2, -1)[1], 1e-6)
    lives = np.log(np.maximum(2.0 * amplitude / max(noise, 1e-300), 3.0)) / omega_zeta
    return int(np.clip(1.3 * lives.max() * rate, min(64, total), total))


def fit_ring_down(data: np.ndarray, rate: float, n_modes: int = 1, start: float = 0.0, slope: bool = True) -> RingDown:
    """Fit free decay `data` (samples,) taken at `rate` (Hz), its first sample at `start` (s).

    ValueError for fewer samples than 8 per unknown, for data that are not finite, or that do not move.
    """
    data = np.asarray(data, float)
    trend = 2 if slope else 1
    if data.size < 8 * (4 * n_modes + trend):
        raise ValueError(f"{data.size} samples of free decay are too few for {n_modes} modes")
    if not np.all(np.isfinite(data)) or np.ptp(data) == 0.0:
        raise ValueError("the free decay holds no motion, or values that are not finite")
    scale = float(np.std(data))
    length = data.size
    parameters = _first_guess(data / scale, rate, trend, n_modes)
    for _ in range(3):  # the window follows from the fit and the fit from the window
        time, part = np.arange(length) / rate, data[:length] / scale
        found = _refined(parameters, time, part, trend)
        parameters = found.x
        columns = _columns(time, parameters, trend)
        weights = np.linalg.lstsq(columns, part, rcond=None)[0]
        noise = math.sqrt(2.0 * found.cost / max(1, length - columns.shape[1] - parameters.size))
        amplitude = np.hypot(weights[0:2 * n_modes:2], weights[1:2 * n_modes:2])
        longer = _window_length(parameters, amplitude, noise, rate, data.size)
        if abs(longer - length) < 0.02 * length:
            break
        length = longer
    covariance = np.linalg.pinv(found.jac.T @ found.jac) * noise**2
    order = np.argsort(-amplitude)
    both = np.concatenate([order, order + n_modes])
    values, covariance = parameters[both], covariance[np.ix_(both, both)]
    spread = Z_95 * np.sqrt(np.diag(covariance))
    low, high = values - spread, values + spread
    return RingDown(values[:n_modes], values[n_modes:], low[:n_modes], high[:n_modes], low[n_modes:], high[n_modes:],
                    covariance, amplitude[order] * scale, noise * scale, start, start + time[-1])


def ring_down(recording: Recording, *, start: float | None = None, stop: float | None = None,
              channel: str = "displacement", n_modes: int = 1) -> RingDown:
    """Modes of the free decay in `recording` between `start` and `stop` (s).

    By default the decay starts at the recording's condition `exit_time`, or at its largest excursion where there is
    none, and lasts to the end.
    """
    time, data = recording.time, np.asarray(recording.channels[channel], float)
    if start is None:
        peak = float(time[int(np.argmax(np.abs(data - np.median(data))))])
        start = float(recording.conditions.get("exit_time", peak))
    stop = float(time[-1]) if stop is None else stop
    inside = (time >= start) & (time <= stop)
    if not inside.any():
        raise ValueError(f"no samples of free decay after {start:g} s")
    return fit_ring_down(data[inside], recording.sampling_rate, n_modes, float(time[inside][0]))


@dataclass(frozen=True)
class ImpactMode:
    """A mode found in a frequency response: undamped frequency (Hz), damping ratio, and the modal mass (kg where force
    and response are calibrated); band (Hz) used; misfit relative to the response."""

    natural_frequency: float
    damping_ratio: float
    modal_mass: float
    band: tuple[float, float]
    misfit: float


def receptance(force: np.ndarray, response: np.ndarray, rate: float, kind: str = "acceleration"):
    """Frequencies (Hz, without zero) and receptance (displacement per force, complex) of one impact.

    The lines end where the blow's spectrum has sunk to a twentieth of its peak: it excites nothing beyond. kind:
    displacement, velocity or acceleration, which the response is.
    """
    order = {"displacement": 0, "velocity": 1, "acceleration": 2}[kind]
    force, response = np.asarray(force, float), np.asarray(response, float)
    quiet = max(4, force.size // 200)
    hit = np.fft.rfft(force - np.median(force[:quiet]))
    answer = np.fft.rfft(response - np.median(response[:quiet]))
    weak = np.nonzero(np.abs(hit) < 0.05 * np.abs(hit).max())[0]
    last = int(weak[weak > int(np.argmax(np.abs(hit)))][0]) if np.any(weak > int(np.argmax(np.abs(hit)))) else hit.size
    frequency = np.fft.rfftfreq(force.size, 1.0 / rate)[1:last]
    return frequency, answer[1:last] / hit[1:last] / (2j * math.pi * frequency) ** order


def _resonance_band(frequency: np.ndarray, response: np.ndarray) -> tuple[float, float]:
    """From where to where (Hz) the response exceeds a third of its tallest resonance.

    A resonance rises threefold above its surroundings on both sides; an accelerometer's drift divided by frequency
    squared, which falls steeply from zero, does not.
    """
    from scipy.signal import find_peaks  # slow to import, wanted by few

    size = median_filter(np.abs(response), 5, mode="nearest")
    peaks, _ = find_peaks(np.log(size + 1e-300), prominence=math.log(3.0), width=5)
    if not peaks.size:
        raise ValueError("no resonance stands out of the frequency response: give the band")
    top = int(peaks[np.argmax(size[peaks])])
    below, above = np.nonzero(size[:top] < size[top] / 3)[0], np.nonzero(size[top:] < size[top] / 3)[0]
    low = below[-1] if below.size else 0
    high = top + above[0] if above.size else size.size - 1
    return float(frequency[low]), float(frequency[high])


def fit_receptance(frequency: np.ndarray, response: np.ndarray, band: tuple[float, float] | None = None) -> ImpactMode:
    """Fit one mode and two residual terms (mass below, stiffness above) to a complex receptance in a band (Hz).

    The band, unless given, is where the response is above a third of its tallest resonance.
    ValueError when the band holds fewer than 8 lines.
    """
    band = _resonance_band(frequency, response) if band is None else band
    inside = (frequency >= band[0]) & (frequency <= band[1])
    f, h = frequency[inside], response[inside]
    if f.size < 8:
        raise ValueError(f"{f.size} lines between {band[0]:.0f} and {band[1]:.0f} Hz are too few for a mode")
    peak = f[int(np.argmax(np.abs(h)))]
    scale = np.abs(h).max()

    def solved(parameters: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        natural, zeta = parameters
        columns = np.column_stack([1.0 / (natural**2 - f**2 + 2j * zeta * natural * f) * natural**2, 1.0 + 0j * f,
                                   (peak / f) ** 2 + 0j])
        stacked = np.vstack([columns.real, columns.imag])
        data = np.concatenate([h.real, h.imag]) / scale
        weights = np.linalg.lstsq(stacked, data, rcond=None)[0]
        return data - stacked @ weights, weights

    starts = [np.array([peak, zeta]) for zeta in (0.003, 0.01, 0.03, 0.1)]
    def left(parameters: np.ndarray) -> np.ndarray:
        return solved(parameters)[0]

    fits = [least_squares(left, start, x_scale=[peak, 0.01]) for start in starts]
    found = fits[int(np.argmin([fit.cost for fit in fits]))]
    natural, zeta = float(found.x[0]), float(abs(found.x[1]))
    weights = solved(found.x)[1]
    mass = 1.0 / (weights[0] * scale * (2.0 * math.pi * natural) ** 2)
    misfit = math.sqrt(2.0 * found.cost) / float(np.linalg.norm(h) / scale)
    return ImpactMode(natural, zeta, float(mass), band, misfit)
