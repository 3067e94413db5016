"""What sensors do wrong: turned round, their axes exchanged, their mass on the structure; told where the responses tell it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from testbed.analysis.tap.frequency_response import FEWEST_LINES, FrequencyResponse
from testbed.analysis.tap.poles import poles

_SURE_SIGN = 0.5  # of the imaginary part's size, that has one sign at a drive point


def exchanged(responses: Sequence[FrequencyResponse]) -> list[FrequencyResponse]:
    """The responses as they are if every sensor's x is y and its y is x."""
    return [replace(one, sensed=(one.sensed[1], one.sensed[0])) for one in responses]


def unloaded(one: FrequencyResponse, mass: float, notes: list[str]) -> FrequencyResponse:
    """The response without the mass of the sensor that sat on it: exact at a drive point."""
    if mass == 0.0:
        return one
    if not one.drive_point:
        notes.append(f"{one.name}: the sensor's mass is undone at drive points only")
        return one
    factor = 1.0 / (1.0 - mass * one.laplace**2 * one.receptance)  # s^2 m: the force that the sensor took
    return replace(one, receptance=one.receptance * factor, deviations=one.deviations * factor**2)


def sign_share(one: FrequencyResponse, low: float, high: float) -> float:
    """Share of a drive point's peaks whose imaginary part has the sign it must have: 1 all, -1 none."""
    mask = one.believed(low, high)
    if np.count_nonzero(mask) < FEWEST_LINES:
        return 1.0
    stable = poles([one], [mask]).stable
    places = np.searchsorted(one.frequency, stable[:, 0]).clip(0, len(one.frequency) - 1)
    part = one.receptance.imag[places]
    return -float(np.sum(part) / max(float(np.sum(np.abs(part))), 1e-300)) if len(part) else 1.0


def turned(responses: Sequence[FrequencyResponse], band: tuple[float, float], notes: list[str]) -> list[FrequencyResponse]:
    """Responses that move against the force at a drive point turned, and with them what the same sensor shows elsewhere."""
    found, against = list(responses), set()
    for place, one in enumerate(found):
        if not one.drive_point:
            continue
        share = sign_share(one, *band) * float(np.sign(np.dot(one.along, one.sensed)))
        if share < -_SURE_SIGN:
            found[place] = one.turned()
            against.add((one.on, one.sensed))
            notes.append(f"{one.name}: the response moves against the force. Its sensor was taken as turned round")
        elif share < _SURE_SIGN:
            notes.append(f"{one.name}: its modes answer now with the force, now against it: "
                               "force and sensor are not at one point, or not in one direction")
    for place, one in enumerate(found):
        if not one.drive_point and (one.on, one.sensed) in against:
            found[place] = one.turned()
            notes.append(f"{one.name}: turned, too: the drive point shows that this sensor is turned round")
    return found
