"""Dry friction: Coulomb's constant force against the motion, with a stick that holds.

    F = -F_c z / z_c while |z| <= z_c, F = -F_c sign(z) beyond,
    dz/dt = v                                 while it sticks (|z| < z_c, or the motion leads back)
    dz/dt = -r sign(z) (|z| - z_c)            while it slips

z is the elastic deflection of the contact and z_c where it breaks away, so F_c / z_c is the stiffness before sliding.
Source: W. D. Iwan (1966), A distributed-element model for hysteresis and its steady-state dynamic response, J. Appl.
Mech. 33, 893-900 (the spring and slider in series, Jenkins' element); P. Dupont, V. Hayward, B. Armstrong and F. Altpeter
(2002), Single state elastoplastic friction models, IEEE Trans. Automatic Control 47, 787-792 (why a stick must be elastic:
Dahl's and LuGre's bristles creep under a load that vibrates; this one does not). The state relaxes to z_c, at a rate r of
three times the frequency of the stuck structure, so that a coarse step cannot carry it past.

Valid for a joint or guideway whose static and kinetic friction are alike. The slope of the force jumps at breakaway and
dz/dt with it. Out of the cut the fast engine goes from event to event by exact maps, unless another law of the structure or a
speed that falls with the load is beside it. Elsewhere integration keeps second order, and a step that resolves z_c does not
mend that: in free vibration of 30 um, F_c = 2 N, the order is 2.1, 2.2 and 2.1 at z_c = 0.02, 0.2 and 2 um (160, 40 and 40 to
10240 steps a period, the error 1e-2 to 5e-8 at 0.2 um), and 1.2 at 20 um, where it hardly slides. Over a cycle of amplitude
X it dissipates 4 F_c X: a free vibration loses 4 F_c / k of its amplitude every cycle, then stops. The loop has no linear
delay equation: about a sliding motion the small perturbation depends on its sign at every turning point, and while the joint
sticks any deflection it stopped at is an equilibrium (a multiplier of exactly 1 for each).

Start of a fit: k over 4 times the loss of amplitude a cycle at the end of a ring-down.
"""

import math

from testbed.effect import Effect, Parameter

SLIP_RATE = 3.0  # relaxation while slipping, over the frequency of the stuck structure

EFFECT = Effect(
    title="Dry (Coulomb) friction on the structure",
    parameters=(
        Parameter("force", "F_c", "N", "friction force while sliding",
                  neutral=0.0, bounds=(0.0, 100.0), example=2.0, start=0.2),
        Parameter("presliding_displacement", "z_c", "m", "elastic displacement at which the contact breaks away",
                  neutral=0.2e-6, bounds=(0.02e-6, 20.0e-6), example=0.2e-6, start=0.2e-6, vanishes=False),
    ),
    law="F = -F_c z / z_c (|z| <= z_c), dz/dt = v while stuck; F = -F_c sign(z) while sliding; z: the contact's deflection",
    source="Iwan (1966), J. Appl. Mech. 33, 893; Dupont, Hayward, Armstrong and Altpeter (2002), IEEE TAC 47, 787",
    validity="equal static and kinetic friction, one contact, sliding along x",
    leaves="a ring-down whose envelope falls in a straight line and ends abruptly; more damping at small amplitude",
    confused_with=(
        ("quadratic_damping", "a ring-down of large amplitude: this damps most at its end, drag at its beginning"),
        ("process_damping", "a ring-down outside the cut, where process damping is absent"),
    ),
    states=("deflection",),
    slider=("deflection", "presliding_displacement"),
    smooth=False,
    no_linear_answer="dry friction has no linear delay equation: stuck, it is a spring of F_c / z_c beside the structure's own "
    "(give the model that stiffness); sliding, its equivalent damping 4 F_c / (pi X omega) falls with the amplitude X "
    "(simulate at the amplitude asked for)",
)


def derivative_deflection(deflection, velocity, mass, stiffness, force, presliding_displacement):
    beyond = abs(deflection) - presliding_displacement
    if beyond < 0.0 or deflection * velocity < 0.0:
        return velocity
    rate = SLIP_RATE * math.sqrt((stiffness + force / presliding_displacement) / mass)
    return -rate * beyond if deflection > 0.0 else rate * beyond


def structure_force(deflection, force, presliding_displacement):
    return -force * min(1.0, max(-1.0, deflection / presliding_displacement))


def highest_frequency(mass, stiffness, force, presliding_displacement):
    return math.sqrt((stiffness + force / presliding_displacement) / mass)
