"""Helix: the edge winds round the cutter, so each height of it enters and leaves the cut at its own time.

    theta(z) = theta(0) - z tan(beta) / R,        F = integral over [0, b] of the straight edge's force per depth dz

The lag over the depth is b tan(beta) / R; entry and exit are ramps of that length, and where it equals the pitch the
force is constant. The part of each edge that is in the cut is integrated by Gauss-Legendre points that move with it.
The force has a corner where either end of the edge enters or leaves: the steps end there, so that fourth order is kept.
For one mode along the feed only the size of the total angle counts, the model's `cutter.helix_angle` and this one together:
its sign is of no consequence (the axial force does not act), so give and read it as positive.

Source: W. A. Kline, R. E. DeVor and J. R. Lindberg (1982), The prediction of cutting forces in end milling with
application to cornering cuts, Int. J. Machine Tool Design and Research 22, 7-22;
stability: M. Zatarain, J. Munoa, G. Peigne and T. Insperger (2006), Analysis of the influence of mill helix angle on
chatter stability, CIRP Annals 55, 365-368.

Valid for a cylindrical cutter, a rigid tool over the depth of cut, and a helix within +-85 deg in all. The angle is
counted beyond the model's `cutter.helix_angle`.

Start of a fit: the rise time of the force at entry is b tan(beta) / (R Omega).
"""

from testbed.effect import Effect, Parameter

EFFECT = Effect(
    title="Helix angle of the cutter",
    parameters=(
        Parameter("angle", "beta", "rad", "helix angle beyond the model's",
                  neutral=0.0, bounds=(-0.8, 0.8), example=0.5, start=0.2),
    ),
    law="theta(z) = theta(0) - z tan(beta_0 + beta) / R, beta_0 the model's; force integrated over the depth; of the two "
        "angles' sum only the size counts, so give and read it as positive",
    source="Kline, DeVor and Lindberg (1982), IJMTDR 22, 7; Zatarain et al. (2006), CIRP Annals 55, 365",
    validity="cylindrical cutter, tool rigid over the depth of cut",
    leaves="rounded entry and exit: high harmonics of the tooth passing fall with depth; closed islands of flip",
    confused_with=(
        ("sensor_lag", "a shallow and a deep cut: the rounding grows with depth (helix) or does not (sensor)"),
        ("immersion_error", "two depths at one radial depth: the window grows with the axial depth only with a helix"),
        ("entry_ramp", "a long cut: the ramp ends after R sin(exit angle) of feed, the helix stays"),
    ),
)


def helix_angle(helix_angle, angle):
    return helix_angle + angle
