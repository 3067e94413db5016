"""Process damping: the flank rubs on the waves it has just cut, a ploughing force against the edge's sinking
velocity.

    F_n = B b v_r / V,        v_r = x' sin(theta)

B (N/m) is the process damping coefficient, b the depth of cut, v_r the velocity at which the edge sinks radially into
the work, V = R Omega the cutting speed. On the structure along the feed: -B b x' sin^2(theta) / V while a tooth cuts,
so the damping grows with depth and falls with speed; its mean over a period is B b (1/T) integral of sin^2 dt / V.

Source: T. R. Sisson and R. L. Kegg (1969), An explanation of low-speed chatter effects, J. Engineering for Industry
91, 951-958; Y. Altintas, M. Eynian and H. Onozuka (2008), Identification of dynamic cutting force coefficients and
chatter stability with process damping, CIRP Annals 57, 371-374. Values of 1e5 to 1e6 N/m are met in steel and
aluminium.

Valid for waves that are short against their wavelength (v_r / V well below the clearance angle): the indented volume
is then proportional to the slope v_r / V. Where `contact_loss` has the edge clear of the work nothing rubs.

Start of a fit: the damping ratio identified at each test, plotted against depth over speed, has the slope B
mean(sin^2) / (2 m omega R).
"""

from testbed.effect import Effect, Parameter

EFFECT = Effect(
    title="Process damping (ploughing of the flank)",
    parameters=(
        Parameter("coefficient", "B", "N/m", "radial force per depth of cut and slope of the sinking edge, x' sin(theta) / V",
                  neutral=0.0, bounds=(0.0, 1.0e7), example=2.0e5, start=1.0e5),
    ),
    law="F_n = B b x' sin(theta) / V; b: depth of cut, V: cutting speed",
    source="Sisson and Kegg (1969), J. Eng. Ind. 91, 951; Altintas, Eynian and Onozuka (2008), CIRP Annals 57, 371",
    validity="slope of the waves x' / V well below the clearance angle",
    leaves="a damping ratio that grows with depth over speed; stable lobes rising at low speed; multipliers pulled in",
    confused_with=(
        ("quadratic_damping", "ring-downs: process damping acts only in the cut, the structure's own damping remains"),
        ("chip_force_exponent", "the same speed at two feeds: process damping does not depend on the chip"),
    ),
)


def normal_force(depth, edge_velocity, cutting_speed, chip, penetration, coefficient):
    if chip > penetration + 1e-12:  # contact_loss has the edge in the air
        return 0.0
    return coefficient * depth * edge_velocity / cutting_speed
