"""Runout: the cutter turns about an axis beside its own, so each tooth runs on a circle of its own radius.

    R_i = R + e cos(lambda - 2 pi i / N)        tooth i of N

Tooth 0 is the one that stands at its entry angle at time 0, or, in a measured record, comes next after the mark.

A tooth on a larger circle takes a thicker chip and leaves a deeper surface; the next one finds less. The chip changes
by R_i - R_(i-1); over a revolution the changes add up to nothing, so without contact loss the mean force stays. The
motion then repeats once a revolution, not once a tooth. **With one flute the offset is constant and has no effect on
the chip.** Two teeth have one difference between them: of both parameters they show e cos(lambda) alone.

Source: W. A. Kline and R. E. DeVor (1983), The effect of runout on cutting geometry and forces in end milling, Int.
J. Machine Tool Design and Research 23, 123-140; T. L. Schmitz, J. Couey, E. Marsh, N. Mauntler and D. Hughes (2007),
Runout effects in milling: surface finish, surface location error, and stability, Int. J. Machine Tools and
Manufacture 47, 841-851.

Valid for a parallel offset small against the radius; entry and exit stay at the nominal angles. Where R_i - R_(i-1)
exceeds the feed a tooth misses the work altogether: add `contact_loss`, or its negative chip pulls.

Start of a fit: the line at the spindle frequency over that at the tooth passing, times half the feed; scan the angle.
"""

import math

from testbed.effect import Effect, Parameter

EFFECT = Effect(
    title="Runout of the cutter",
    parameters=(
        Parameter("offset", "e", "m", "distance of the cutter's axis from the spindle's",
                  neutral=0.0, bounds=(0.0, 5.0e-4), example=1.0e-5, start=5.0e-6),
        Parameter("angle", "lambda", "rad", "direction of the offset, from tooth 0, the next after the mark, towards tooth 1",
                  neutral=0.0, bounds=(-2.0 * math.pi, 2.0 * math.pi), example=0.3, start=0.5, vanishes=False),
    ),
    law="R_i = R + e cos(lambda - 2 pi i / N), the radius of tooth i of N",
    source="Kline and DeVor (1983), IJMTDR 23, 123; Schmitz et al. (2007), IJMTM 47, 841",
    validity="parallel offset small against the radius; two flutes or more",
    leaves="lines at the spindle frequency and its harmonics between those of the tooth passing; unequal teeth",
    confused_with=(
        ("speed_variation", "idling tachometer: runout is silent there, the teeth alone are unequal"),
        ("contact_loss", "a stable cut: runout shows once a revolution, a chattering tooth at any multiple"),
    ),
)


def edge_position(tooth, flutes, offset, angle):
    return offset * math.cos(angle - 2.0 * math.pi * tooth / flutes)
