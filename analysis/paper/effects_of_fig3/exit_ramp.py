"""Exit ramp: the cutter leaves the work through a flat end face, and its engagement shrinks with the feed.

A tooth at theta reaches R sin(theta) ahead of the axis. Once the axis has come to within R sin_m of the end face the
part of the arc that reaches furthest ahead is in the air:

    in the cut where sin(theta) < sin_m (1 - p),      p = (s - s_0) / (g R sin_m)

s: feed travelled; s_0: at the first touch of the end face; sin_m: largest sin(theta) in the cut; g: extent, 1 for a square
end face at right angles to the feed. The gate is rounded over a tenth, for a real corner is not sharp. Geometry as at
the entry: Y. Altintas (2012), Manufacturing Automation, 2nd ed., chapter 2. Valid for a straight feed; start a fit at g = 1.
"""

import math

from testbed.effect import Effect, Parameter

ROUNDING = 0.1

EFFECT = Effect(
    title="Geometric ramp of the engagement at exit",
    parameters=(
        Parameter("extent", "g", "1", "length of the ramp over the geometric one, R sin_m",
                  neutral=0.0, bounds=(0.0, 2.0), example=0.15, start=1.0),
        Parameter("begin", "s_0", "m", "feed travelled at the first touch of the end face",
                  neutral=1.0, bounds=(0.0, 1.0), example=5e-3, vanishes=False),
    ),
    law="in the cut where sin(theta) < sin_m (1 - p)",
    source="Altintas (2012), Manufacturing Automation, chapter 2",
    validity="flat end face at right angles to a straight feed",
    leaves="a forced motion that fades over many passes, and hardly any ring-down after it",
    confused_with=(("entry_ramp", "which end of the cut it is"),),
)


def engagement(phase, entry_angle, engagement_angle, feed_travel, radius, extent, begin):
    first, last = entry_angle, entry_angle + engagement_angle
    highest = max(math.sin(first), math.sin(last))
    if first < 0.5 * math.pi < last:
        highest = 1.0
    if feed_travel <= begin or extent <= 0.0:
        return 1.0
    progress = (feed_travel - begin) / (extent * radius * highest)
    u = (1.0 - progress * (1.0 + ROUNDING) - math.sin(entry_angle + phase) / highest + ROUNDING) / ROUNDING
    if u <= 0.0:
        return 0.0
    if u >= 1.0:
        return 1.0
    return u * u * (3.0 - 2.0 * u)
