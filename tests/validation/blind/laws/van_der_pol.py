"""Damping that grows with displacement: a law that no catalogue holds, for the blind campaigns.

    F = -c x^2 x'
"""

from testbed.effect import Effect, Parameter

EFFECT = Effect(
    title="Damping that grows with displacement",
    parameters=(
        Parameter("coefficient", "c", "N s/m^3", "strength", neutral=0.0, bounds=(0.0, 1.0e15), example=8.0e9,
                  start=8.0e9),
    ),
    law="F = -c x^2 x'",
    source="made up for the blind campaigns",
    validity="everywhere",
    leaves="what the catalogue should not explain",
)


def structure_force(displacement, velocity, coefficient):
    return -coefficient * displacement * displacement * velocity
