"""A second mode of vibration, driven by the cut, felt by it, and seen by the sensor.

    m2 (q'' + 2 zeta2 w2 q' + w2^2 q) = e . F,    m2 = m / r,    w2 = 2 pi f2,    e = (cos phi, sin phi)
    workpiece against tool: r + e q               sensor: r + p e q

Source: D. J. Ewins (2000), Modal Testing, 2nd ed., Research Studies Press, chapter 2 (receptance as a sum of modes):
    X/F = 1 / (m (w1^2 - w^2 + 2 i zeta1 w1 w)) + p r / (m (w2^2 - w^2 + 2 i zeta2 w2 w)).
The mode shape is 1 at the tool and p at the sensor; r, the ratio of the modal masses, is 0 where the mode cannot be
moved. A dynamometer reads the force less the inertia force of the mass p m that shakes on it in this mode,
    F_read = F + p r (H - 1) F,    H = w2^2 / (s^2 + 2 zeta2 w2 s + w2^2),
with rho w2 in place of w2 where it reads across the feed (force_y), for its mount is not as stiff there.

It moves along the feed (phi = 0) unless a direction is given; only motion measured across the feed tells one.

Valid for two modes that stay apart (proportional damping). Force channels are filtered as if straight
between samples. `third_mode` is the same law once more, with parameters and states of its own.

Start of a fit: f2 from the highest peak of the residual's spectrum that is no multiple of the tooth passing frequency;
scan f2, for the misfit has a minimum at every harmonic.
"""

import math

import numpy as np

from testbed.effect import Effect, Parameter

EFFECT = Effect(
    title="Second mode of the structure",
    parameters=(
        Parameter("mass_ratio", "r", "1", "modal mass of the first mode over that of the second, seen at the tool",
                  neutral=0.0, bounds=(0.0, 20.0), example=0.5, start=0.05),
        Parameter("frequency", "f_2", "Hz", "natural frequency of the second mode",
                  neutral=480.0, bounds=(1e-3, 1e6), example=480.0, start=480.0, vanishes=False),
        Parameter("damping_ratio", "zeta_2", "1", "damping ratio of the second mode",
                  neutral=0.01, bounds=(0.0, 0.3), example=0.01, start=0.01, vanishes=False),
        Parameter("participation", "p", "1", "motion of the second mode at the sensor over that at the tool",
                  neutral=1.0, bounds=(-5.0, 5.0), example=1.0, start=1.0, vanishes=False),
        Parameter("transverse_ratio", "rho", "1", "frequency of the second mode in the reading of force_y over that of force_x",
                  neutral=1.0, bounds=(0.2, 5.0), example=1.0, start=1.0, vanishes=False, channels=("force_y",)),
        Parameter("direction", "phi", "rad", "direction of the second mode, from x towards y",
                  neutral=0.0, bounds=(-math.pi, math.pi), example=0.0, start=0.5, vanishes=False,
                  channels=("displacement_y", "velocity_y", "acceleration_y")),
    ),
    law="q'' + 2 zeta_2 w_2 q' + w_2^2 q = r F / m, m: the model's mass, F: the force along the mode's direction e; "
        "the cut feels e q besides, the sensor sees p e q",
    source="Ewins (2000), Modal Testing, 2nd ed., chapter 2",
    validity="two separate modes with proportional damping",
    leaves="a second frequency in entry transients and ring-downs; shifted lobes; chatter at the second frequency",
    confused_with=(
        ("ambient_vibration", "a ring-down: the mode decays and starts with the cut, ambient vibration does neither"),
        ("helix", "one cut at two speeds: a mode keeps its frequency, the harmonics of the tooth passing move"),
        ("third_mode", "nothing, where it stands alone: the law is the same; name the first further mode second_mode"),
    ),
    states=("deflection", "deflection_rate"),
    oscillators=(("deflection", "deflection_rate"),),
)


def derivative_deflection(deflection_rate):
    return deflection_rate


def derivative_deflection_rate(applied_force, applied_force_y, mass, deflection, deflection_rate, mass_ratio, frequency,
                               damping_ratio, direction):
    omega = 2.0 * math.pi * frequency
    if direction != 0.0:
        applied_force = math.cos(direction) * applied_force + math.sin(direction) * applied_force_y
    pull = 2.0 * damping_ratio * omega * deflection_rate + omega * omega * deflection
    return mass_ratio * applied_force / mass - pull


def relative_displacement(deflection, direction):
    return deflection if direction == 0.0 else math.cos(direction) * deflection


def relative_velocity(deflection_rate, direction):
    return deflection_rate if direction == 0.0 else math.cos(direction) * deflection_rate


def relative_displacement_y(deflection, direction):
    return 0.0 if direction == 0.0 else math.sin(direction) * deflection


def relative_velocity_y(deflection_rate, direction):
    return 0.0 if direction == 0.0 else math.sin(direction) * deflection_rate


def sensed_displacement(deflection, participation, direction):
    return participation * deflection if direction == 0.0 else participation * math.cos(direction) * deflection


def sensed_velocity(deflection_rate, participation, direction):
    return participation * deflection_rate if direction == 0.0 else participation * math.cos(direction) * deflection_rate


def sensed_displacement_y(deflection, participation, direction):
    return 0.0 if direction == 0.0 else participation * math.sin(direction) * deflection


def sensed_velocity_y(deflection_rate, participation, direction):
    return 0.0 if direction == 0.0 else participation * math.sin(direction) * deflection_rate


def highest_frequency(frequency):
    return 2.0 * math.pi * frequency


def measure(signal, true_signal, quantity, sampling_rate, mass_ratio, frequency, damping_ratio, participation,
            transverse_ratio):
    if quantity not in ("force_x", "force_y") or len(signal) == 0:
        return signal
    from scipy.signal import cont2discrete, lfilter, lfilter_zi  # slow to import, wanted by few

    omega = 2.0 * math.pi * frequency * (transverse_ratio if quantity == "force_y" else 1.0)
    resonance = [omega**2], [1.0, 2.0 * damping_ratio * omega, omega**2]
    top, bottom, _ = cont2discrete(resonance, 1.0 / sampling_rate, "foh")
    numerator = np.ravel(top)
    through, _ = lfilter(numerator, bottom, true_signal, zi=lfilter_zi(numerator, bottom) * true_signal[0])
    return signal + participation * mass_ratio * (through - true_signal)
