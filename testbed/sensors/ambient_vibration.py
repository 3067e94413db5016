"""Ambient vibration: a line from the surroundings that the sensor picks up, cut or no cut.

    displacement: + a sin(2 pi f t + phi)    velocity, acceleration: + its first and second derivative

t counts from the start of the record's simulation.
Source: elementary kinematics of a vibrating sensor mount; C. M. Harris and A. G. Piersol (2002), Shock and Vibration
Handbook, 5th ed., McGraw-Hill (a relative displacement is read against the mount's own motion).

Valid where the line (a pump, a neighbouring machine, the mains) comes in through the sensor's mount and is too small to
move the tooth against the workpiece. A sensor with a lag of its own lags this line too. Force channels are left alone.

Start of a fit: amplitude, frequency and phase of the highest line in the idle part of a record.
"""

import math

import numpy as np

from testbed.effect import Effect, Parameter

EFFECT = Effect(
    title="Ambient vibration at the sensor",
    parameters=(
        Parameter("amplitude", "a", "m", "amplitude of the line, as a displacement",
                  neutral=0.0, bounds=(0.0, 1.0e-3), example=3.0e-6, start=0.2e-6),
        Parameter("frequency", "f", "Hz", "frequency of the line",
                  neutral=50.0, bounds=(1e-3, 1e6), example=50.0, start=50.0, vanishes=False),
        Parameter("phase", "phi", "rad", "phase where the record's simulation begins",
                  neutral=0.0, bounds=(-2.0 * math.pi, 2.0 * math.pi), example=0.5, start=0.0, vanishes=False,
                  each_record=True),
    ),
    law="x_read = x + a sin(2 pi f t + phi)",
    source="Harris and Piersol (2002), Shock and Vibration Handbook, 5th ed.",
    validity="a steady line that enters through the sensor's mount and leaves the cut alone",
    leaves="a line of constant amplitude through idling, cutting and ring-down alike",
    confused_with=(
        ("second_mode", "idling: the line is there, the mode is not"),
        ("runout", "one cut at two speeds: the line stays, the once-per-revolution line of runout moves"),
    ),
)


def measure(signal, quantity, time, amplitude, frequency, phase):
    omega = 2.0 * math.pi * frequency
    order = {"displacement": 0, "velocity": 1, "acceleration": 2}.get(quantity)
    if order is None:
        return signal
    return signal + amplitude * omega**order * np.sin(omega * time + phase + 0.5 * math.pi * order)
