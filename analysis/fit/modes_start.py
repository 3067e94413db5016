"""Several modes as the free decays of records show them: frequencies and damping ratios, whatever each decay begins with.

In a free decay every channel is a sum of the modes of the part its sensor sits on, with amplitudes and phases of its own: for
given frequencies and dampings a linear problem. Those are found by least squares over what it leaves (variable projection:
Golub and Pereyra 1973, SIAM J. Numer. Anal. 10, 413), on growing windows, so that phases do not run apart.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy.optimize import least_squares

from testbed.analysis.fit.observed import Observed
from testbed.machine import Carrier, Model

WINDOWS = (0.1, 0.3, 1.0)  # shares of each decay that are fitted one after the other
FEWEST = 64  # samples of a decay
LOUD = 3.0  # times the noise, from which a channel of a decay says anything
MOST_SAMPLES = 4000  # of a decay
SOFT = 0.01  # of a channel's own size, that is forgiven
RANGE = (0.15, 2.0)  # of the logarithms of frequency and damping ratio, to either side of the believed ones
BELIEF = (0.05, 1.0)  # standard deviations of those: they hold a mode that no decay shows


class _Decay(NamedTuple):
    """Channels (rows, samples) of sensors on one part, in units of their noise, and the times (s) of the samples."""

    on: Carrier
    values: np.ndarray
    time: np.ndarray


def modes_start(records: Sequence[Observed], model: Model) -> Model:
    """The model with the frequencies and damping ratios of its modes that the records' free decays show; as it was without."""
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
    for place, (omega, damping) in enumerate(found):
        values[model.mode_path(place, "natural_frequency")] = float(omega) / (2 * math.pi)
        values[model.mode_path(place, "damping_ratio")] = min(float(damping), 0.5)
    return model.with_values(values)


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
        for on in ("workpiece", "tool"):
            rows = [row for row, sensor in enumerate(record.sensors) if sensor is not None and sensor.on == on
                    and len(places) >= FEWEST and np.std(record.data[row, places]) > LOUD * record.noise[row]]
            if rows:
                values = record.data[rows][:, places]
                scale = np.hypot(record.noise[rows], SOFT * values.std(axis=1))
                found.append(_Decay(on, values / scale[:, None], (places - first) / record.rate))
    return found


def _left(decay: _Decay, modes: np.ndarray, share: float) -> np.ndarray:
    """What vibrations of these (rad/s, damping ratio) with an offset and a slope leave of the first share of a decay."""
    count = max(FEWEST, round(share * len(decay.time)))
    time, values = decay.time[:count], decay.values[:, :count]
    columns = [np.ones(len(time)), time / max(float(decay.time[-1]), 1e-300)]
    for omega, damping in modes:
        envelope = np.exp(-damping * omega * time)
        turned = omega * math.sqrt(max(1.0 - damping**2, 0.0)) * time
        columns += [envelope * np.cos(turned), envelope * np.sin(turned)]
    basis = np.linalg.qr(np.stack(columns, axis=1))[0]
    return (values - (values @ basis) @ basis.T).ravel()
