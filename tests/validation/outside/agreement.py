"""The fast engine against the outside simulator, which shares no code with it: one cut with each effect."""

from __future__ import annotations

import math

import numpy as np
from scipy.optimize import brentq

from testbed.cut import Cut, Sampling
from testbed.engines import predict
from testbed.machine import Cutter, Cutting, Model, Structure
from tests.validation.claims import Claim, Section
from tests.validation.outside import simulator
from tests.validation.outside.plan import at_strength

BASE = simulator.Cutting(
    mass=1.5, omega=simulator.TURN * 240.0, zeta=0.012, kt=8e8, kn=2.6e8, flutes=2, radius=8e-3, entry=0.0,
    window=simulator.TURN * 0.15, depth=0.5e-3, travel=2 * 0.09e-3 * 65.0, speed=simulator.TURN * 65.0, first_angle=0.0,
    begin=0.0, end=1.0,
)  # fmt: skip
VALUES = {
    "cubic_stiffness": {"coefficient": 2e12},
    "quadratic_damping": {"coefficient": 200.0},
    "dry_friction": {"force": 0.5, "presliding_displacement": 2e-7},
    "edge_force": {"tangential": 1e4, "normal": 1.5e4},
    "process_damping": {"coefficient": 1e5},
    "runout": {"offset": 4e-6, "angle": 1.9},
    "tool_wear": {"rate": 2.0},
    "speed_droop": {"droop": 0.05, "time_constant": 0.1},
    "speed_variation": {"amplitude": 0.01, "frequency": 4.0, "phase": 0.0},
    "chip_force_exponent": {"exponent": 0.8},
    "second_mode": {"mass_ratio": 0.4, "frequency": 610.0, "damping_ratio": 0.01, "participation": 0.8},
    "sensor_lag": {"time_constant": 2e-4},
    "helix": {"angle": 0.4},
    "immersion_error": {"error": 0.1},
}
IDLE, PASSES = 6, 60
STATE = (5e-6, 0.0)  # m, m/s: it still rings when the first tooth enters
RATE, STEP, REFINEMENT = 12800.0, 2e-6, 4
# the two differ by what either rounds: the corner of a chip's power law, the slip of a joint; and the engine follows a swing
# back by the linear structure alone
LIMITS = {"chip_force_exponent": 2e-4, "dry_friction": 1e-3}
LIMIT = 1e-5


def difference(name: str, direction: str = "up-milling") -> float:
    """RMS of the difference of the two motions over that of the motion, in the cut; name: an effect, or "" for none."""
    cut = BASE._replace(entry=0.0 if direction == "up-milling" else math.pi - BASE.window)
    cut = at_strength(name, VALUES[name], cut, 1.0) if name else cut
    pitch = simulator.TURN / cut.flutes

    def turned(t: float) -> float:
        swing = simulator.TURN * cut.swing_frequency
        return cut.speed * (t + cut.swing / swing * (1.0 - math.cos(swing * t)))

    begin = brentq(lambda t: turned(t) - IDLE * pitch, 0.0, 2 * IDLE * pitch / cut.speed, xtol=1e-15)
    cut = cut._replace(begin=begin, end=begin + 2.0 * PASSES * pitch / cut.speed, first_angle=cut.entry)
    duration = 0.95 * (IDLE + PASSES) * pitch / cut.speed
    times, angles, seen, _ = simulator.run(cut, *STATE, duration, STEP)
    at = np.arange(0.0, duration - 1e-6, 1.0 / RATE)
    other = simulator.sampled(times, angles, seen, at)[0]
    course = Cut(cut.speed, cut.depth, cut.travel * pitch / cut.speed, IDLE, PASSES, 0, *STATE, swung_front=True)
    sampling = Sampling(RATE, len(at))
    own = predict.predict_cuts([_model(name, direction)], [course], [sampling], ("displacement",), refinement=REFINEMENT)[0, 0]
    return float(np.std(own - other) / np.std(other))


def _model(name: str, direction: str) -> Model:
    """The same machine in the product's words."""
    structure = Structure(BASE.mass, BASE.omega / simulator.TURN, BASE.zeta)
    cutting = Cutting(direction, BASE.window / simulator.TURN, BASE.kt, BASE.kn)
    plain = Model(structure, Cutter(flutes=BASE.flutes, diameter=2 * BASE.radius), cutting)
    return plain.with_effect(name, **VALUES[name]) if name else plain


def check() -> Section:
    """The section of the table."""
    claims = []
    for name in ("", *VALUES):
        limit, found = LIMITS.get(name, LIMIT), max(difference(name, way) for way in ("up-milling", "down-milling"))
        claims.append(Claim(name or "no effect", f"<= {limit:g}", f"{found:.1e}", found <= limit))
    return Section("Fast engine against a simulator by another hand, one cut with each effect", tuple(claims))
