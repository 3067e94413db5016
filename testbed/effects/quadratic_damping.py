"""Quadratic damping: a drag that grows with the square of the velocity.

    F = -c2 |v| v

Source: A. H. Nayfeh and D. T. Mook (1979), Nonlinear Oscillations, Wiley, chapter 3. Over a cycle
x = X sin(omega t) it dissipates as a viscous damper of c_eq = 8 c2 X omega / (3 pi) does.

Valid for turbulent drag and for joints whose loss factor rises with amplitude. The law is continuous with its slope but
not with its curvature where v changes sign, so integration keeps third order, not fourth.

The exponent 2 is the law's; another, q, makes it F = -c2 |v| v (|v| / v_r)^(q - 2), of the same force at the reference
velocity v_r. A diagnosis that has named the law frees it, to see whether it is this one.

Start of a fit: the damping ratio of a ring-down against its amplitude has the slope 4 c2 / (3 pi m).
"""

from testbed.effect import Effect, Parameter

EXPONENT = 2.0

EFFECT = Effect(
    title="Quadratic damping of the structure",
    parameters=(
        Parameter("coefficient", "c_2", "N s^2/m^2", "force per velocity squared",
                  neutral=0.0, bounds=(0.0, 1.0e5), example=500.0, start=10.0),
    ),
    form=(
        Parameter("exponent", "q", "1", "power of the velocity",
                  neutral=EXPONENT, bounds=(1.0, 9.0), example=3.0, vanishes=False),
        Parameter("reference_velocity", "v_r", "m/s", "velocity at which the force does not depend on the exponent",
                  neutral=0.1, bounds=(1e-9, 1e6), example=0.1, vanishes=False),
    ),
    law="F = -c_2 |v| v",
    source="Nayfeh and Mook (1979), Nonlinear Oscillations, chapter 3",
    validity="drag of turbulent fluid or of joints that loosen with amplitude",
    leaves="a damping ratio that rises in proportion to the amplitude: a ring-down steep at first, slow at the end",
    confused_with=(
        ("dry_friction", "a ring-down of large amplitude: dry friction damps most at its end, this at its beginning"),
        ("process_damping", "a ring-down outside the cut, where process damping is absent"),
    ),
    smooth=False,
)


def structure_force(velocity, coefficient, exponent, reference_velocity):
    force = -coefficient * abs(velocity) * velocity
    if exponent == EXPONENT or velocity == 0.0:
        return force
    return force * (abs(velocity) / reference_velocity) ** (exponent - EXPONENT)
