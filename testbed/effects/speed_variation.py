"""Speed variation: the spindle speed swings about its mean.

    n(t) = n0 (1 + a sin(2 pi f t + phi))

t counts from the start of the record's simulation. The delay is then not 60 / n: a tooth meets the surface left one
pitch of spindle *angle* before, tau(t) solves integral of n from t - tau to t = pitch.
Source: J. S. Sexton, R. D. Milne and B. J. Stone (1977), A stability analysis of single-point machining with varying
spindle speed, Appl. Math. Modelling 1, 310-318; T. Insperger and G. Stepan (2004), Stability analysis of turning with
periodic spindle speed modulation via semidiscretization, J. Vibration and Control 10, 1835-1855.

Valid for 0 <= a < 1, as a drive's ripple, a belt, or a variation made on purpose. Where n0 / (f pitch) is a ratio of
whole numbers the loop is periodic and has multipliers; otherwise it has a mean rate of growth only.

Start of a fit: a and f from the tachometer's intervals, or from the side lines at +-f of the tooth passing frequency.
"""

import math

from testbed.effect import Effect, Parameter

EFFECT = Effect(
    title="Sinusoidal variation of the spindle speed",
    parameters=(
        Parameter("amplitude", "a", "1", "amplitude of the speed over its mean",
                  neutral=0.0, bounds=(0.0, 0.5), example=0.05, start=0.005),
        Parameter("frequency", "f", "Hz", "frequency of the variation",
                  neutral=5.0, bounds=(0.01, 500.0), example=5.0, start=5.0, vanishes=False),
        Parameter("phase", "phi", "rad", "phase where the record's simulation begins",
                  neutral=0.0, bounds=(-2.0 * math.pi, 2.0 * math.pi), example=0.0, start=0.0, vanishes=False,
                  each_record=True),
    ),
    law="n = n_0 (1 + a sin(2 pi f t + phi)); the delay is one pitch of spindle angle",
    source="Sexton, Milne and Stone (1977), Appl. Math. Model. 1, 310; Insperger and Stepan (2004), J. Vib. Control 10, 1835",
    validity="0 <= a < 1",
    leaves="side lines at +-f about every tooth passing harmonic; chatter that comes and goes with the speed",
    confused_with=(
        ("speed_droop", "a long cut: droop settles and grows with depth of cut, variation goes on and does not"),
        ("ambient_vibration", "idling: ambient vibration is there, side lines of the cut are not"),
    ),
)


def speed(time, amplitude, frequency, phase):
    return amplitude * math.sin(2.0 * math.pi * frequency * time + phase)


def highest_frequency(frequency):
    return 2.0 * math.pi * frequency
