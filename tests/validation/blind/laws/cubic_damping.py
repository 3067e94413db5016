"""Cubic damping: a law that no catalogue holds, for the blind campaigns.

    F = -c x'^3
"""

from testbed.effect import Effect, Parameter

EFFECT = Effect(
    title="Cubic damping",
    parameters=(
        Parameter("coefficient", "c", "N s^3/m^3", "strength", neutral=0.0, bounds=(0.0, 1.0e15), example=5.0e3,
                  start=5.0e3),
    ),
    law="F = -c x'^3",
    source="made up for the blind campaigns",
    validity="everywhere",
    leaves="what the catalogue should not explain",
)


def structure_force(velocity, coefficient):
    return -coefficient * velocity * velocity * velocity
