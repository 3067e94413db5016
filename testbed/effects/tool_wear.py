"""Tool wear: the edge grows blunt as it cuts, and the cutting coefficients grow with the length of feed travelled.

    K_t, K_n -> (1 + w L) K_t, (1 + w L) K_n,        L = length cut before the record + feed travel since the entry

L is a length of feed: how far the workpiece has travelled under the cutter while it cut, whatever the number of flutes. It is
not the path of an edge along its arcs, which at an immersion rho is pi D rho a tooth pass where the feed is some 0.1 mm.

Source: flank wear in proportion to the length cut in the steady stage, force in proportion to the wear land: Y.
Altintas (2012), Manufacturing Automation, 2nd ed., Cambridge, chapter 2 (tool wear and breakage); F. W. Taylor
(1907), On the art of cutting metals, Trans. ASME 28, 31-350 (a life that is a length at given conditions).

Valid in the steady stage of wear, between breaking-in and the end of life. `length_cut_before` of the record holds
what the tool cut earlier: without it only the growth within the record is seen, and w is measured against the force
at its start.

Start of a fit: the coefficient identified from each test against the length cut before it is a line of slope w K.
"""

from testbed.effect import Effect, Parameter

EFFECT = Effect(
    title="Tool wear",
    parameters=(
        Parameter("rate", "w", "1/m", "relative growth of the cutting coefficients per length of feed travelled",
                  neutral=0.0, bounds=(0.0, 100.0), example=5.0, start=0.5),
    ),
    law="K(L) = K (1 + w L), L the feed travelled in the cut, earlier records' (length_cut_before) and this one's; not the "
        "path of an edge along its arcs",
    source="Altintas (2012), Manufacturing Automation, chapter 2; Taylor (1907), Trans. ASME 28, 31",
    validity="steady stage of wear",
    leaves="forces and forced motion that grow slowly along a cut and from test to test",
    confused_with=(
        ("speed_droop", "a repeated cut: wear goes on where it stopped, the drive starts afresh"),
        ("entry_ramp", "a second cut: the ramp repeats at each entry and ends, wear does neither"),
    ),
)


def force_factor(length_cut, rate):
    return 1.0 + rate * length_cut
