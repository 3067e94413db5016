"""Entry ramp: the cutter comes into the work from the front, and its engagement grows with the feed.

Before a flat front face a tooth at theta reaches R sin(theta) ahead of the axis. At a feed travel s past the first
touch,

    in the cut where sin(theta) > sin_m - s / (g R),        sin_m = largest sin(theta) between entry and exit

so the engagement is complete after g R sin_m: 8 mm or 80 feeds for a 19 mm cutter at immersion 0.162. g, the extent,
is 1 for a square front face at right angles to the feed, less where the front was cut before, 0 for an instant entry.
Up-milling begins at its exit angle, down-milling at its entry. The edge of the gate is rounded over a share w = 0.1
of the reach about where it is sharp, for a real corner is not sharp and an integrator needs a smooth law:

    share in the cut = S((sin(theta) / sin_m - 1 + p) / w + 1 / 2),
    p = s / (g R sin_m),    S(u) = 35 u^4 - 84 u^5 + 70 u^6 - 20 u^7

Where the chip is thin, at sin(theta) near 0, that is complete a share w / 2 later.

Source: geometry; the milling entry as in Y. Altintas (2012), Manufacturing Automation, 2nd ed., chapter 2, and F.
Koenigsberger and J. Tlusty (1970), Machine Tool Structures, Pergamon. The rounding is this project's.

Valid for a flat front face and a straight feed. The rounded gate is three times differentiable, so that the fourth
order of integration is kept.

Start of a fit: g = 1, or the feed travelled until the forced motion is steady, over R sin_m.
"""

import math

from testbed.effect import Effect, Parameter

ROUNDING = 0.1  # share of the reach over which the gate opens

EFFECT = Effect(
    title="Geometric ramp of the engagement at entry",
    parameters=(
        Parameter("extent", "g", "1", "feed travelled until all of the arc is cut, over R sin_m",
                  neutral=0.0, bounds=(0.0, 2.0), example=0.5, start=1.0),
    ),
    law="in the cut where sin(theta) > sin_m - s / (g R); s: feed travelled since the first touch, sin_m: largest sin(theta) "
        "of the whole arc",
    source="Altintas (2012), Manufacturing Automation, chapter 2; Koenigsberger and Tlusty (1970)",
    validity="flat front face at right angles to a straight feed",
    leaves="a forced motion that grows over many passes, and hardly any entry transient to identify multipliers from",
    confused_with=(
        ("tool_wear", "a long cut: the ramp ends after R sin_m of feed"),
        ("immersion_error", "the steady part of a long cut: the ramp leaves it alone"),
        ("speed_droop", "the tachometer: a ramp leaves the speed alone"),
    ),
)


def engagement(phase, entry_angle, engagement_angle, feed_travel, radius, extent):
    first, last = entry_angle, entry_angle + engagement_angle
    highest = max(math.sin(first), math.sin(last))
    if first < 0.5 * math.pi < last:
        highest = 1.0
    if extent <= 0.0 or feed_travel >= (1.0 + 0.5 * ROUNDING) * extent * radius * highest:
        return 1.0
    progress = feed_travel / (extent * radius * highest)
    u = (math.sin(entry_angle + phase) / highest - 1.0 + progress) / ROUNDING + 0.5
    if u <= 0.0:
        return 0.0
    if u >= 1.0:
        return 1.0
    return u**4 * (35.0 + u * (-84.0 + u * (70.0 - 20.0 * u)))
