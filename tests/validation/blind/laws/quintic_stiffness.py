"""Quintic stiffness: a law that no catalogue holds, for the blind campaigns.

    F = -c x^5
"""

from testbed.effect import Effect, Parameter

EFFECT = Effect(
    title="Quintic stiffness",
    parameters=(
        Parameter("coefficient", "c", "N/m^5", "strength", neutral=0.0, bounds=(0.0, 1.0e30), example=2.0e22,
                  start=2.0e22),
    ),
    law="F = -c x^5",
    source="made up for the blind campaigns",
    validity="everywhere",
    leaves="what the catalogue should not explain",
)


def structure_force(displacement, coefficient):
    return -coefficient * displacement**5
