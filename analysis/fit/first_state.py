"""What a structure does when the record of a cut begins, as its first samples show it."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from testbed.analysis.fit.nuisances import Nuisances
from testbed.analysis.fit.observed import Observed
from testbed.machine import Structure

FEWEST = 6  # samples of a period from which displacement, velocity and offset can be read


def first_state(record: Observed, structure: Structure) -> tuple[tuple[float, float], ...]:
    """Of every mode, displacement (m) and velocity (m/s) at the first sample of a free vibration, which the record shows.

    Read from the first period of the slowest one, offset beside it. At rest where the record begins in the cut, or enters it
    before, or is too coarse. What seems to be a cut from the first sample on, and is none, is a structure that still swings.
    """
    modes, still = structure.modes, tuple((0.0, 0.0) for _ in structure.modes)
    entry = min((one.start for one in record.segments if one.kind != "idle" and one.start > record.start), default=math.inf)
    count = round(2 * math.pi / min(mode.natural_frequency_rad for mode in modes) * record.rate)
    rows = [row for row, sensor in enumerate(record.sensors) if sensor is not None and (row == 0 or structure.planar)]
    free = not record.starts_in_cut and count <= record.samples and record.start + count / record.rate <= entry
    if not rows or count < FEWEST or not free:
        return still
    blocks, values = [], []
    for place, row in enumerate(rows):
        sensor = record.sensors[row]
        assert sensor is not None
        unit = modes[0].natural_frequency_rad ** sensor.order
        weight = unit / record.noise[row] / (modes[0].natural_frequency_rad ** record.sensors[rows[0]].order  # type: ignore[union-attr]
                                             / record.noise[rows[0]])
        columns = []
        for mode in modes:
            omega = mode.natural_frequency_rad
            phase = omega * np.arange(count) / record.rate + 0.5 * math.pi * sensor.order
            size = weight * mode.seen(sensor.on, sensor.axis) * (omega / modes[0].natural_frequency_rad) ** sensor.order
            columns += [size * np.cos(phase), size * np.sin(phase)]
        columns += [np.full(count, weight * float(other == place)) for other in range(len(rows))]
        blocks.append(np.stack(columns, axis=1))
        values.append(weight * (record.data[row, :count] / unit))
    found = np.linalg.lstsq(np.concatenate(blocks), np.concatenate(values), rcond=None)[0]
    return tuple((float(found[2 * place]), float(found[2 * place + 1]) * mode.natural_frequency_rad)
                 for place, mode in enumerate(modes))


def begun_as_seen(record: Observed, own: Nuisances, structure: Structure) -> Nuisances:
    """The nuisances of a record with the state at its beginning that its first samples show."""
    (displacement, velocity), *further = first_state(record, structure)
    states = [(path, value) for paths, pair in zip(record.further_states, further, strict=True)
              for path, value in zip(paths, pair, strict=True)]
    return replace(own, displacement=displacement, velocity=velocity, states=tuple(states))
