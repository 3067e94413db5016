"""A decoy: a restoring force that ripples with the displacement, as if the structure slid over a washboard.

    F = -a sin(2 pi x / 4 um)
"""

import math

from testbed.effect import Effect, Parameter

EFFECT = Effect(
    title="Decoy: a force that ripples with the displacement",
    parameters=(
        Parameter("amplitude", "a", "N", "amplitude of the ripple",
                  neutral=0.0, bounds=(-100.0, 100.0), example=1.0, start=0.1),
    ),
    law="F = -a sin(2 pi x / 4 um)",
    source="made up: no machine has it",
    validity="nowhere",
    leaves="nothing that a machine leaves",
)


def structure_force(displacement, amplitude):
    return -amplitude * math.sin(2.0 * math.pi * displacement / 4.0e-6)
