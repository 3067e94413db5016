"""Several modes as the free decays of records show them: frequencies, damping ratios, directions, whatever a decay begins with.

In a free decay every channel is a sum of the modes of the part its sensor sits on, with amplitudes and phases of its own: for
given frequencies and dampings a linear problem. Those are found by least squares over what it leaves (variable projection:
Golub and Pereyra 1973, SIAM J. Numer. Anal. 10, 413), on growing windows, so that phases do not run apart. By how much
a mode shows along x and along y is its direction, in every decay the same.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy.optimize import least_squares

from testbed.analysis.fit.observed import Observed
from testbed.machine import Carrier, Mode, Model
from testbed.recording import Sensor

WINDOWS = (0.1, 0.3, 1.0)  # shares of each decay that are fitted one after the other
FEWEST = 64  # samples of a decay
LOUD = 3.0  # times the noise, from which a channel, and those beside it, say anything of a decay
MOST_SAMPLES = 4000  # of a decay
SOFT = 0.01  # of a channel's own size, that is forgiven
RANGE = (0.15, 2.0)  # of the logarithms of frequency and damping ratio, to either side of the believed ones
BELIEF = (0.05, 1.0)  # standard deviations of those: they hold a mode that no decay shows
SHOWN = 10.0  # times its standard error, that a mode's motion must have for its direction to be read,
LINE = 0.2  # and that motion across it at the most, as a share: more is another mode's


class _Decay(NamedTuple):
    """Channels (rows, samples) of sensors on one part, in units of `scale`, the times (s) of the samples, and those sensors."""

    on: Carrier
    values: np.ndarray
    time: np.ndarray
    scale: np.ndarray
    sensors: tuple[Sensor, ...]


def modes_start(records: Sequence[Observed], model: Model) -> Model:
    """The model with the frequencies, damping ratios and directions that the records' free decays show; as it was without."""
    decays, modes = [decay for record in records for decay in _decays(record)], model.structure.modes
    if not decays:
        return model
    believed = np.array([(mode.natural_frequency_rad, mode.damping_ratio) for mode in modes])
    belief, reach = np.tile(BELIEF, len(modes)), np.tile(RANGE, len(modes))

    def rest(moved: np.ndarray, share: float) -> np.ndarray:
        values = believed * np.exp(moved.reshape(-1, 2))
        parts = [_left(decay, values[[mode.on == decay.on for mode in modes]], share) for decay in decays]
        return np.concatenate([*parts, moved / belief])

    moved = np.zeros(believed.size)
    for share in WINDOWS:
        moved = least_squares(rest, moved, bounds=(-reach, reach), x_scale=0.1 * belief, args=(share,), max_nfev=30).x
    found = believed * np.exp(moved.reshape(-1, 2))
    values = {}
    for place, ((omega, damping), motions) in enumerate(zip(found, _motions(decays, found, modes), strict=True)):
        values[model.mode_path(place, "natural_frequency")] = float(omega) / (2 * math.pi)
        values[model.mode_path(place, "damping_ratio")] = min(float(damping), 0.5)
        direction = _direction(motions, modes[place].direction)
        if direction is not None:
            values[model.mode_path(place, "direction")] = direction
    return model.with_values(values)


def _direction(motions: Sequence[np.ndarray], believed: float) -> float | None:
    """The direction (rad) along which a mode moves, nearest to the `believed` one; None where no decay tells it.

    motions: of the mode in each decay, see `_motions`.
    """
    if not motions:
        return None
    _, sizes, turned = np.linalg.svd(np.concatenate(motions))
    if sizes[0] < SHOWN * math.sqrt(2.0 * len(motions)) or sizes[1] > LINE * sizes[0]:
        return None
    return believed + math.remainder(math.atan2(turned[0, 1], turned[0, 0]) - believed, math.pi)


def _motions(decays: Sequence[_Decay], found: np.ndarray, modes: Sequence[Mode]) -> list[list[np.ndarray]]:
    """For every mode, its two phases along x and y (phases, axes) in each decay that has both, in standard errors.

    found: (rad/s, damping ratio) of all modes.
    """
    motions: list[list[np.ndarray]] = [[] for _ in modes]
    for decay in decays:
        on = [place for place, mode in enumerate(modes) if mode.on == decay.on]
        columns = _columns(decay.time, float(decay.time[-1]), found[on])
        amplitudes = np.linalg.lstsq(columns, decay.values.T, rcond=None)[0] * decay.scale
        errors = np.sqrt(np.diag(np.linalg.inv(columns.T @ columns)))
        rows = {(sensor.order, sensor.axis): row for row, sensor in reversed(list(enumerate(decay.sensors)))}
        pairs = [[rows[order, 0], rows[order, 1]] for order, axis in rows if axis == 0 and (order, 1) in rows]
        for (number, place), pair in itertools.product(enumerate(on), sorted(pairs)):
            own = [2 + 2 * number, 3 + 2 * number]
            motions[place].append(amplitudes[np.ix_(own, pair)] / (errors[own][:, None] * decay.scale[pair].max()))
    return motions


def _decays(record: Observed) -> list[_Decay]:
    """The free decays of a record, apart for the sensors on workpiece and tool."""
    found = []
    for segment in record.segments:
        if segment.kind != "ring-down":
            continue
        begun = segment.start - record.start + (record.period if record.cut is not None else 0.0)  # where no tooth still cuts
        first, last = max(0, round(begun * record.rate)), round((segment.stop - record.start) * record.rate)
        every = max(1, (last - first) // MOST_SAMPLES)
        places = np.arange(first, min(last, record.samples), every)
        for on in ("workpiece", "tool") if len(places) >= FEWEST else ():
            rows = [row for row, sensor in enumerate(record.sensors) if sensor is not None and sensor.on == on]
            values = record.data[rows][:, places]
            if rows and np.any(values.std(axis=1) > LOUD * record.noise[rows]):  # a quiet one beside it tells the direction
                scale = np.hypot(record.noise[rows], SOFT * values.std(axis=1))
                sensors = tuple(sensor for row in rows if (sensor := record.sensors[row]) is not None)
                found.append(_Decay(on, values / scale[:, None], (places - first) / record.rate, scale, sensors))
    return found


def _left(decay: _Decay, modes: np.ndarray, share: float) -> np.ndarray:
    """What vibrations of these (rad/s, damping ratio) with an offset and a slope leave of the first share of a decay."""
    count = max(FEWEST, round(share * len(decay.time)))
    values = decay.values[:, :count]
    basis = np.linalg.qr(_columns(decay.time[:count], float(decay.time[-1]), modes))[0]
    return (values - (values @ basis) @ basis.T).ravel()


def _columns(time: np.ndarray, last: float, modes: np.ndarray) -> np.ndarray:
    """Shape (times, 2 + 2 modes): an offset, a slope, and the two phases of each free vibration (rad/s, damping ratio)."""
    columns = [np.ones(len(time)), time / max(last, 1e-300)]
    for omega, damping in modes:
        envelope = np.exp(-damping * omega * time)
        turned = omega * math.sqrt(max(1.0 - damping**2, 0.0)) * time
        columns += [envelope * np.cos(turned), envelope * np.sin(turned)]
    return np.stack(columns, axis=1)
