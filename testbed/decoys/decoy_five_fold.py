"""A decoy: a force on the edge that turns five times as fast as the tooth, whatever the chip.

    F_t = a b cos(5 theta)
"""

import math

from testbed.effect import Effect, Parameter

EFFECT = Effect(
    title="Decoy: an edge force that turns five times a tooth's turn",
    parameters=(
        Parameter("amplitude", "a", "N/m", "force per depth of cut",
                  neutral=0.0, bounds=(-1.0e6, 1.0e6), example=5.0e3, start=5.0e2),
    ),
    law="F_t = a b cos(5 theta)",
    source="made up: no machine has it",
    validity="nowhere",
    leaves="nothing that a machine leaves",
)


def tangential_force(angle, depth, amplitude):
    return amplitude * depth * math.cos(5.0 * angle)
