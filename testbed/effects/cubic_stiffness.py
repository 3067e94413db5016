"""Cubic stiffness: the structure stiffens (or softens) with the square of its displacement.

    F = -k3 x^3            (Duffing's oscillator: m x'' + c x' + k x + k3 x^3 = F_cut)

Source: G. Duffing (1918), Erzwungene Schwingungen bei veraenderlicher Eigenfrequenz, Vieweg, Braunschweig; closed
form of the free vibration: A. H. Nayfeh and D. T. Mook (1979), Nonlinear Oscillations, Wiley, chapter 2. The backbone
is omega = pi sqrt(omega0^2 + k3 X^2 / m) / (2 K(p)), p = k3 X^2 / (2 (k + k3 X^2)), K the complete elliptic integral of
the first kind of parameter p; for small X it is omega0 (1 + 3 k3 X^2 / (8 k)).

Valid for a symmetric structure while |k3| X^2 stays below k; a softening structure (k3 < 0) has no equilibrium beyond
X = sqrt(k / -k3). A flexure clamped at both ends hardens with k3 of the order of k over its thickness squared.

The exponent 3 is the law's; another, q, makes it F = -k3 x^3 (|x| / x_r)^(q - 3), of the same force at the reference
displacement x_r. A diagnosis that has named the law frees it, to see whether it is this one.

Start of a fit: the frequency of a ring-down against its amplitude squared has the slope 3 omega0 k3 / (8 k).
"""

from testbed.effect import Effect, Parameter

EXPONENT = 3.0

EFFECT = Effect(
    title="Cubic stiffness of the structure",
    parameters=(
        Parameter("coefficient", "k_3", "N/m^3", "cubic stiffness; positive hardens, negative softens",
                  neutral=0.0, bounds=(-1.0e15, 1.0e15), example=5.0e13, start=1.0e12),
    ),
    form=(
        Parameter("exponent", "q", "1", "power of the displacement",
                  neutral=EXPONENT, bounds=(1.0, 9.0), example=5.0, vanishes=False),
        Parameter("reference_displacement", "x_r", "m", "displacement at which the force does not depend on the exponent",
                  neutral=1e-4, bounds=(1e-12, 1e6), example=1e-4, vanishes=False),
    ),
    law="F = -k_3 x^3",
    source="Duffing (1918); Nayfeh and Mook (1979), Nonlinear Oscillations, chapter 2",
    validity="symmetric structure, |k_3| X^2 below the linear stiffness",
    leaves="a vibration frequency that drifts with amplitude, third harmonics, chatter of limited amplitude",
    confused_with=(
        ("contact_loss", "a ring-down of large amplitude, where nothing cuts: only the structure's own law can act"),
        ("quadratic_damping", "the same ring-down: stiffness moves the frequency, damping bends the envelope"),
    ),
)


def structure_force(displacement, coefficient, exponent, reference_displacement):
    force = -coefficient * displacement * displacement * displacement
    if exponent == EXPONENT or displacement == 0.0:
        return force
    return force * (abs(displacement) / reference_displacement) ** (exponent - EXPONENT)
