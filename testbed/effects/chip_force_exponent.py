"""Chip force exponent: the cutting force grows with a power of the chip thickness (Kienzle's law).

    F = K b h_0 (h / h_0)^q,        h_0 = 0.1 mm

so K is the chord of the law at the reference chip h_0, whatever q; q = 1 is the linear law, Kienzle's 1 - m_c is q.
At a chip near zero the slope of h^q grows without limit. Below e = 0.3 um the law is therefore rounded off to a straight
line and continued to negative chips as an odd function:

    F = K b h ((h^2 + e^2) / h_0^2)^((q - 1) / 2),

within 0.1 % of the power law for h > 10 e at q = 0.8, and differentiable in h and q everywhere. In up-milling every chip begins
at nothing: rounded at an edge's radius of some um, the law leaves 5e-3 of such a motion to a law that is not, and a fit makes
up for it by its coefficients.

Source: O. Kienzle (1952), Die Bestimmung von Kraeften und Leistungen an spanenden Werkzeugen und Werkzeugmaschinen,
VDI-Z 94, 299-305; in milling stability: G. Stepan (2001), Modelling nonlinear regenerative effects in metal cutting,
Phil. Trans. R. Soc. A 359, 739-757 (the three-quarter power, q = 0.75).

Valid for chips between the edge's radius and about 1 mm, one material, one tool; q of 0.6 to 0.9 is usual.

Start of a fit: log of the identified coefficient against log of the feed has the slope q - 1.
"""

from testbed.effect import Effect, Parameter

REFERENCE_CHIP = 1.0e-4  # m, h_0
ROUNDED = 3.0e-7  # m, e

EFFECT = Effect(
    title="Power law of the cutting force",
    parameters=(
        Parameter("exponent", "q", "1", "power of the chip thickness in the force",
                  neutral=1.0, bounds=(0.2, 1.5), example=0.75, start=0.9),
    ),
    law="F = K b h_0 (h / h_0)^q with h_0 = 0.1 mm, rounded below h = 0.3 um; b: depth of cut, h: chip thickness",
    source="Kienzle (1952), VDI-Z 94, 299; Stepan (2001), Phil. Trans. R. Soc. A 359, 739",
    validity="chips from the edge's radius to about 1 mm",
    leaves="coefficients that fall as the feed rises; a static force and a dynamic one that ask for different K",
    confused_with=(
        ("edge_force", "three feeds: the force against feed bends (power) or is a straight line off the origin (edge)"),
        ("process_damping", "two feeds at one speed: only the power law changes the multipliers with the feed"),
    ),
)


def force_factor(chip, exponent):
    ratio = (chip * chip + ROUNDED * ROUNDED) / (REFERENCE_CHIP * REFERENCE_CHIP)
    return ratio ** (0.5 * (exponent - 1.0))
