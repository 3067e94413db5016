"""Quadratic stiffness: a law that no catalogue holds, for the blind campaigns.

    F = -c x^2
"""

from testbed.effect import Effect, Parameter

EFFECT = Effect(
    title="Quadratic stiffness",
    parameters=(
        Parameter("coefficient", "c", "N/m^2", "strength", neutral=0.0, bounds=(-1.0e17, 1.0e17), example=1.5e9,
                  start=1.5e9),
    ),
    law="F = -c x^2",
    source="made up for the blind campaigns",
    validity="everywhere",
    leaves="what the catalogue should not explain",
)


def structure_force(displacement, coefficient):
    return -coefficient * displacement * displacement
