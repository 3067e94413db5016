"""A third mode of vibration: the law of the second mode once more, with parameters and states of its own.

    m3 (q'' + 2 zeta3 w3 q' + w3^2 q) = e . F,    m3 = m / r,    w3 = 2 pi f3,    e = (cos phi, sin phi)
    workpiece against tool: r + e q               sensor: r + p e q

Modes along the feed (phi = 0) add up, in the cut, at the sensor and on a dynamometer:
    X/F = sum over the modes of p_i r_i / (m (w_i^2 - w^2 + 2 i zeta_i w_i w)),    r_1 = p_1 = 1.

Source: D. J. Ewins (2000), Modal Testing, 2nd ed., Research Studies Press, chapter 2 (receptance as a sum of modes).
The functions are those of `second_mode`, so that the law is written once.

Valid for modes that stay apart (proportional damping). Alone it is `second_mode` under another name, with
the same likelihood for any record; a search therefore proposes it only for a model that has `second_mode` already.

Start of a fit: f3 from the highest peak of the residual's spectrum once the second mode is in the model; scan f3.
"""

import math

from testbed.effect import Effect, Parameter
from testbed.effects.second_mode import (  # noqa: F401  an effect's hooks are found by being in its file
    derivative_deflection,
    derivative_deflection_rate,
    highest_frequency,
    measure,
    relative_displacement,
    relative_displacement_y,
    relative_velocity,
    relative_velocity_y,
    sensed_displacement,
    sensed_displacement_y,
    sensed_velocity,
    sensed_velocity_y,
)

EFFECT = Effect(
    title="Third mode of the structure",
    parameters=(
        Parameter("mass_ratio", "r", "1", "modal mass of the first mode over that of the third, seen at the tool",
                  neutral=0.0, bounds=(0.0, 20.0), example=0.5, start=0.05),
        Parameter("frequency", "f_3", "Hz", "natural frequency of the third mode",
                  neutral=750.0, bounds=(1e-3, 1e6), example=750.0, start=750.0, vanishes=False),
        Parameter("damping_ratio", "zeta_3", "1", "damping ratio of the third mode",
                  neutral=0.01, bounds=(0.0, 0.3), example=0.01, start=0.01, vanishes=False),
        Parameter("participation", "p", "1", "motion of the third mode at the sensor over that at the tool",
                  neutral=1.0, bounds=(-5.0, 5.0), example=1.0, start=1.0, vanishes=False),
        Parameter("transverse_ratio", "rho", "1", "frequency of the third mode in the reading of force_y over that of force_x",
                  neutral=1.0, bounds=(0.2, 5.0), example=1.0, start=1.0, vanishes=False, channels=("force_y",)),
        Parameter("direction", "phi", "rad", "direction of the third mode, from x towards y",
                  neutral=0.0, bounds=(-math.pi, math.pi), example=0.0, start=0.5, vanishes=False,
                  channels=("displacement_y", "velocity_y", "acceleration_y")),
    ),
    law="q'' + 2 zeta_3 w_3 q' + w_3^2 q = r F / m, m: the model's mass, F: the force along the mode's direction e; "
        "the cut feels e q besides, the sensor sees p e q",
    source="Ewins (2000), Modal Testing, 2nd ed., chapter 2",
    validity="separate modes with proportional damping",
    leaves="a third frequency in entry transients and ring-downs; a third peak of the receptance; shifted lobes",
    confused_with=(
        ("second_mode", "nothing, where it stands alone: the law is the same; a hammer test shows how many peaks there are"),
        ("ambient_vibration", "a ring-down: the mode decays and starts with the cut, ambient vibration does neither"),
    ),
    states=("deflection", "deflection_rate"),
    oscillators=(("deflection", "deflection_rate"),),
    requires=("second_mode",),
)
