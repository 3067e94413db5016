"""Immersion error: the radial depth of cut is not the one believed, and a tooth stays in the cut longer or shorter.

    rho = rho_believed (1 + e),        rho = arccos(1 - 2 a / D) / (2 pi), at most 0.5 (a slot)

Up-milling keeps its entry at theta = 0 and moves its exit; down-milling keeps its exit at pi and moves its entry. A
relative error e of the immersion is an error of about 2 e in the radial depth a, for a is nearly quadratic in rho.

Source: the definition of rho in B. P. Mann and K. A. Young (2006), Proc. R. Soc. A 462, 2145-2160; the geometry of
engagement in Y. Altintas (2012), Manufacturing Automation, 2nd ed., chapter 2.

Valid for a straight flank; wall deflection that changes along the cut is not a constant immersion. A wrong rho is
largely absorbed by the cutting coefficients: 0.108 for 0.162 doubles the identified K_t.

Start of a fit: the length of the pulse of force or acceleration over the spindle period, where one is measured.
"""

from testbed.effect import Effect, Parameter

EFFECT = Effect(
    title="Error of the radial immersion",
    parameters=(
        Parameter("error", "e", "1", "true immersion over the believed one, less 1",
                  neutral=0.0, bounds=(-0.6, 1.0), example=0.15, start=0.05),
    ),
    law="rho = rho_believed (1 + e), the share of a revolution that a tooth is in the work",
    source="Mann and Young (2006), Proc. R. Soc. A 462, 2145; Altintas (2012), Manufacturing Automation, chapter 2",
    validity="straight flank, constant radial depth",
    leaves="cutting coefficients far from a dynamometer's; a pulse of another length",
    confused_with=(
        ("helix", "two axial depths: the pulse grows with the depth only with a helix"),
        ("edge_force", "three feeds: an immersion error scales with the feed, an edge force does not"),
    ),
)


def immersion(immersion, error):
    return min(0.5, immersion * (1.0 + error))
