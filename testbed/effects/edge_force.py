"""Edge force: rubbing and ploughing at the cutting edge, a force in proportion to the depth of cut but not to the
chip.

    F_t = K_t b h + K_te b,        F_n = K_n b h + K_ne b

while the edge is between entry and exit. On the structure along the feed one tooth adds the constant wave -b (K_te
cos(theta) + K_ne sin(theta)), whose mean over a period is -b N / (2 pi) [K_te sin(theta) - K_ne cos(theta)] taken
between entry and exit.

Source: E. Budak, Y. Altintas and E. J. A. Armarego (1996), Prediction of milling force coefficients from orthogonal
cutting data, J. Manufacturing Science and Engineering 118, 216-224; Y. Altintas (2012), Manufacturing Automation, 2nd
ed., chapter 2. Aluminium 7075: K_te, K_ne of about 2e4 to 4e4 N/m.

Valid while the edge touches the work. The base model never lets go, nor does this force: it follows the engagement
and not the sign of the chip, so that a chip of exactly zero at the entry of up-milling is in the cut. With
`contact_loss` the force vanishes where the edge is clear of the work by more than 1e-12 m.

Start of a fit: the mean force against feed is a straight line, its value at zero feed the edge's.
"""

from testbed.effect import Effect, Parameter

EFFECT = Effect(
    title="Edge force (rubbing)",
    parameters=(
        Parameter("tangential", "K_te", "N/m", "tangential edge force per depth of cut",
                  neutral=0.0, bounds=(0.0, 1.0e6), example=2.5e4, start=1.0e4),
        Parameter("normal", "K_ne", "N/m", "normal edge force per depth of cut",
                  neutral=0.0, bounds=(0.0, 1.0e6), example=3.0e4, start=1.0e4),
    ),
    law="F_t = K_t b h + K_te b, F_n = K_n b h + K_ne b; b: depth of cut, h: chip thickness",
    source="Budak, Altintas and Armarego (1996), JMSE 118, 216; Altintas (2012), Manufacturing Automation, chapter 2",
    validity="edge in contact",
    leaves="a larger forced motion with the same multipliers; a force that does not vanish at zero feed",
    confused_with=(
        ("chip_force_exponent", "three feeds: a straight line off the origin (edge) against a bent one (power law)"),
        ("tool_wear", "the same cut repeated: wear grows with the length cut, the edge force stays"),
    ),
)


def tangential_force(depth, chip, penetration, tangential):
    if chip > penetration + 1e-12:  # contact_loss has the edge in the air
        return 0.0
    return tangential * depth


def normal_force(depth, chip, penetration, normal):
    if chip > penetration + 1e-12:
        return 0.0
    return normal * depth
