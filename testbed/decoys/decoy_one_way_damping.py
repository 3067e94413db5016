"""A decoy: a damper that works on one side of the position of rest only.

    F = -c v where x > 0
"""

from testbed.effect import Effect, Parameter

EFFECT = Effect(
    title="Decoy: a damper on one side only",
    parameters=(
        Parameter("coefficient", "c", "N s/m", "damping on that side",
                  neutral=0.0, bounds=(-50.0, 50.0), example=5.0, start=0.5),
    ),
    law="F = -c v where x > 0",
    source="made up: no machine has it",
    validity="nowhere",
    leaves="nothing that a machine leaves",
    smooth=False,
)


def structure_force(displacement, velocity, coefficient):
    return -coefficient * velocity if displacement > 0.0 else 0.0
