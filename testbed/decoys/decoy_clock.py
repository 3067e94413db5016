"""A decoy: cutting coefficients that follow a clock.

    K = (1 + a sin(2 pi t / 0.31 s)) K
"""

import math

from testbed.effect import Effect, Parameter

EFFECT = Effect(
    title="Decoy: cutting coefficients that follow a clock",
    parameters=(
        Parameter("amplitude", "a", "1", "swing of both coefficients",
                  neutral=0.0, bounds=(-0.9, 0.9), example=0.2, start=0.02),
    ),
    law="K = (1 + a sin(2 pi t / 0.31 s)) K",
    source="made up: no machine has it",
    validity="nowhere",
    leaves="nothing that a machine leaves",
    no_linear_answer="its coefficients change with time, not with the angle of the tooth",
)


def force_factor(time, amplitude):
    return 1.0 + amplitude * math.sin(2.0 * math.pi * time / 0.31)
