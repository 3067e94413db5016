"""Whether a driven structure's response moves against its force: a sensor, or the hammer's sign, is then turned round.

A structure takes up power from what drives it, at every frequency: Re(conj(F) V) >= 0 where the force acts (D. J. Ewins,
Modal Testing, 2nd ed., 2000, chapter 2: the real part of a point mobility). No positive mass answers to a response by which
it gives power back; with its sign turned it does.
"""

from __future__ import annotations

import math

import numpy as np

STRONG = 0.05  # of the strongest line of the cross spectrum, and of the power: lines from which the sign is read
AGAINST = -0.1  # share of those lines' power that is taken up, below which it is given back; of machines it is 0.14 and more
SURE = 6.0  # times what the noise of the response makes of the power by chance


def moves_against(force: np.ndarray, response: np.ndarray, rate: float, order: int, noise: float) -> bool:
    """Whether a response (samples,) says that the structure gives power back to a force (samples,), N, beyond chance.

    rate: Hz; order: how often the displacement is differentiated in the response; noise: of the response, standard deviation.
    """
    omega = 2 * math.pi * np.fft.rfftfreq(len(force), 1.0 / rate)[1:-1]
    drive = np.fft.rfft(force - force.mean())[1:-1]
    cross = np.conj(drive) * np.fft.rfft(response - response.mean())[1:-1]
    if not np.any(cross):
        return False
    power = cross * (1j * omega) ** (1 - order)
    loud = np.abs(cross) > STRONG * np.abs(cross).max()
    loud &= np.abs(power) > STRONG * np.abs(power[loud]).max()
    taken_up = float(power[loud].real.sum())
    weighed = np.abs(drive[loud] * omega[loud] ** (1 - order))
    by_chance = noise * math.sqrt(0.5 * len(force) * float(np.sum(weighed**2)))
    return taken_up < AGAINST * float(np.abs(power[loud]).sum()) and taken_up < -SURE * by_chance
