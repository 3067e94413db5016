"""Where the fit of an effect that recurs in time starts: a line of unknown frequency, with a phase of its own in every record.

While its amplitude is small, such an effect changes the prediction in proportion to a cos and a sin part. So for every
frequency asked about, two predictions and a least-squares solution tell its amplitude, its phase and what it would explain,
after what the model's own unknowns can make up for.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from testbed.analysis.fit.fit_state import WaveformFit
from testbed.analysis.fit.nuisances import Nuisances
from testbed.analysis.fit.observed import Observed
from testbed.analysis.fit.prediction import predict
from testbed.analysis.fit.shown_range import parameter_bounds
from testbed.analysis.fit.waveform import Fitter
from testbed.analysis.records.lines import standing_out
from testbed.effect import Effect, Parameter

SMALL = 1e-4  # of the example, at which a prediction is still linear in the amplitude
SCREENED = 3  # records, the worst fitted, that are asked and on which starting points are compared
FASTEST = 0.5  # of the tooth passing frequency: speed that varies faster is no longer a speed
REST, FEWEST = 0.02, 64  # shares of the energy left out before and after the part that rings, and the samples it has at least
MOST = 96  # frequencies asked about
KEPT = 4  # frequencies that a fit starts from
SAME = 0.02  # relative distance up to which lines are one
DRIFT, SLOW = 5.0, 1.0 / 30.0  # Hz, or that share of a record's main frequency if that is less: slower is drift
ALONE = 5.5  # times its surroundings that a line of one record alone must stand
LEVELS = (1.0, 3.0)  # times the amplitude of the linear solution: what is large shows less than in proportion


def residual_peaks(records: Sequence[Observed], fit: WaveformFit, count: int = 6) -> list[float]:
    """Frequencies (Hz) of the strongest lines in the residuals.

    A line of one record alone must stand higher over its surroundings: among so many frequencies, chance makes some.
    """
    found: list[tuple[float, float, int]] = []
    loud: set[float] = set()
    for index, (record, rest) in enumerate(zip(records, fit.residuals, strict=True)):
        for values in record.on_samples(rest):
            for part in (values, *_where_it_rings(record, values)):
                for frequency, amplitude, height in standing_out(part, record.rate, count=count):
                    found.append((amplitude, frequency, index))
                    if height > ALONE or len(records) == 1:
                        loud.add(frequency)
    kept: list[float] = []
    drifting = min([DRIFT, *(SLOW * record.main_frequency / (2 * math.pi) for record in records)])
    for _, frequency, index in sorted(found, reverse=True):
        if frequency <= drifting or any(abs(frequency / other - 1) <= SAME for other in kept):
            continue
        if frequency in loud or any(where != index and abs(frequency / other - 1) <= SAME for _, other, where in found):
            kept.append(frequency)
    return kept[:count]


def _where_it_rings(record: Observed, values: np.ndarray) -> list[np.ndarray]:
    """The part that holds nearly all of what is left (samples,) of a record without a cut, if that is a small part of it.

    A mode that has long died away is a broad hill in the spectrum of the whole record, and stands out of that of this part.
    """
    if record.cut is not None:
        return []
    energy = np.cumsum(values**2)
    first, last = np.searchsorted(energy, np.array([REST, 1.0 - REST]) * energy[-1])
    return [values[first : last + 1]] if FEWEST <= last + 1 - first < len(values) / 2 else []


def recurring_starts(fitter: Fitter, effect: Effect, fit: WaveformFit) -> list[dict[str, float]]:
    """Amplitudes and frequencies a fit of the effect starts from, best first; phases are turned record by record."""
    names = {
        "amplitude": next(one for one in effect.parameters if one.vanishes),
        "frequency": next(one for one in effect.parameters if one.unit == "Hz"),
        "phase": next(one for one in effect.parameters if one.each_record),
    }
    worst = fit.worst(SCREENED)
    asked = _asked(fitter, effect, fit, names["frequency"], worst)
    if not asked:
        return [effect.example()]
    answers = [_explained(fitter, fit, effect, names, index, asked) for index in worst]
    gain = np.sum([one[:, 0] for one in answers], axis=0)
    amplitude = np.median([one[:, 1] for one in answers], axis=0)
    starts = []
    for place in _separate(gain):
        for level in LEVELS:
            low, high = names["amplitude"].bounds
            value = min(max(level * float(amplitude[place]), low), 0.5 * high)
            starts.append(
                {names["amplitude"].name: value, names["frequency"].name: asked[place], names["phase"].name: 0.0}
            )
    return starts


def _asked(fitter: Fitter, effect: Effect, fit: WaveformFit, frequency: Parameter, worst: Sequence[int]) -> list[float]:
    """Frequencies (Hz) worth asking about: the residual's lines, or, of the speed, all that the records can tell apart."""
    records = [fitter.records[index] for index in worst]
    low, high = parameter_bounds(frequency, records)
    if "speed" not in effect.hooks:
        return [peak for peak in residual_peaks(fitter.records, fit) if low <= peak <= high]
    longest = max(record.samples / record.rate for record in records)
    fastest = FASTEST * min((record.flutes / record.period for record in records if record.cut is not None), default=0.0)
    step = 0.5 / longest
    values = np.arange(1, MOST + 1) * step
    if values[-1] < fastest:  # even steps where the records are long, wider ones above
        half = MOST // 2
        values = np.concatenate([values[:half], np.geomspace(values[half], fastest, MOST - half)])
    return [float(value) for value in values if low <= value <= min(high, max(fastest, step))]


def _explained(
    fitter: Fitter, fit: WaveformFit, effect: Effect, names: dict[str, Parameter], index: int, asked: Sequence[float]
) -> np.ndarray:
    """(frequencies, 2): what a small effect at each frequency explains of one record's squares, and its amplitude."""
    record, state, part = fitter.records[index], fit.state, fit.parts[index]
    rest = fit.residuals[index]
    basis = np.linalg.qr(np.hstack([part.shared, part.own])[: rest.size])[0]
    small = SMALL * (names["amplitude"].example - names["amplitude"].neutral)
    plain: tuple = (state.model, state.angle, state.nuisances[index])
    found = np.zeros((len(asked), 2))
    for first in range(0, len(asked), 8):
        some = asked[first : first + 8]
        variants = [plain]
        for frequency in some:
            for phase in (0.0, 0.5 * math.pi):
                values = {names["amplitude"].name: names["amplitude"].neutral + small, names["frequency"].name: frequency}
                model = state.model.with_effect(effect.name, **values, **{names["phase"].name: phase})
                variants.append((model, state.angle, _unshifted(state.nuisances[index], effect.name)))
        predicted = predict(fitter.engine, record, variants)
        if not np.isfinite(predicted).all():
            continue
        slopes = record.project(predicted[1:] - predicted[0]).reshape(len(variants) - 1, -1) / small
        slopes = slopes - (slopes @ basis) @ basis.T
        for place in range(len(some)):
            pair = slopes[2 * place : 2 * place + 2].T
            solved = np.linalg.lstsq(pair, rest, rcond=1e-6)[0]
            found[first + place] = float(np.sum((pair @ solved) ** 2)), float(np.hypot(*solved))
    return found


def _unshifted(nuisances: Nuisances, name: str) -> Nuisances:
    kept = tuple((path, shift) for path, shift in nuisances.shifts if not path.startswith(f"{name}."))
    return replace(nuisances, shifts=kept)


def _separate(gain: np.ndarray) -> list[int]:
    """Places of the highest gains, no two of them neighbours."""
    kept: list[int] = []
    for place in np.argsort(-gain):
        if all(abs(int(place) - other) > 2 for other in kept) or len(gain) <= 6:  # lines are apart already
            kept.append(int(place))
        if len(kept) == KEPT:
            break
    return kept
