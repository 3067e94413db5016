"""Contact loss: an edge that swings clear of the work cuts nothing, and the surface stays where it flew over.

    h = max(0, p),    p = feed position + x - S,    S <- max(S, feed position + x)    at each angle of the cutter

The next tooth meets the surface S left by the last tooth that did cut there, one, two or more passes ago: multiple
regeneration. Chatter is then bounded, and its amplitude is finite: the cut removes in the long run exactly the feed.

Source: J. Tlusty and F. Ismail (1981), Basic non-linearity in machining chatter, CIRP Annals 30, 299-304; in milling:
G. Stepan, R. Szalai, B. P. Mann, P. V. Bayly, T. Insperger, J. Gradisek and E. Govekar (2005), Nonlinear dynamics of
high-speed milling, J. Vibration and Acoustics 127, 197-203.

Integration keeps second order only (in chatter: 2e-4 of the peak at 20 steps in the cut, 3e-6 at 160), so take small
steps. The force has a kink where contact is lost and found, and the surface one at the same angle, met one pass later or
several. Locating loss and return within the step is not enough (order 2.1, the error a third at the best); with the
surface's kinks kept too it is 4.0 (tests/effects/located_contact.py), but both engines keep the surface at their grid's
points, and agree because they do. Valid for vibration along the feed that stays small against the cutter; an edge flying
over is taken to touch nowhere else.

No parameters: a model that names the effect has it. It says nothing in a stable cut, where no tooth lets go.
"""

from testbed.effect import Effect

EFFECT = Effect(
    title="Loss of contact with multiple regeneration",
    parameters=(),
    law="h = max(0, p), p = feed position + x - S; the surface S <- max(S, feed position + x)",
    source="Tlusty and Ismail (1981), CIRP Annals 30, 299; Stepan et al. (2005), J. Vibration and Acoustics 127, 197",
    validity="vibration along the feed, small against the cutter's radius",
    leaves="bounded chatter, impacts after flights, sub-harmonics; force exactly zero within the engagement",
    confused_with=(
        ("cubic_stiffness", "a ring-down of the chatter's amplitude: only the structure's law acts there"),
        ("process_damping", "amplitude of chatter against depth: damping moves the stability limit, contact loss not"),
    ),
    smooth=False,
)


def chip(penetration):
    return max(0.0, penetration)
