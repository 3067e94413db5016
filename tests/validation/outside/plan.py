"""What an outside campaign hides, drawn from one seed: machine, belief, tests, sensors, effects and how strong they are."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial, reduce

import numpy as np

from tests.validation.outside.simulator import TURN, Cutting, run, sampled

KINDS = {"one": 0.5, "pair": 0.2, "none": 0.15, "unknown": 0.15}
# the simulator's quantities by the product's effects and parameters
EFFECTS = {
    "cubic_stiffness": {"coefficient": "cubic"},
    "quadratic_damping": {"coefficient": "quadratic_damping"},
    "dry_friction": {"force": "friction", "presliding_displacement": "breakaway"},
    "edge_force": {"tangential": "edge_tangential", "normal": "edge_normal"},
    "process_damping": {"coefficient": "flank"},
    "runout": {"offset": "offset", "angle": "offset_angle"},
    "tool_wear": {"rate": "wear"},
    "speed_droop": {"droop": "droop", "time_constant": "droop_time"},
    "speed_variation": {"amplitude": "swing", "frequency": "swing_frequency"},
    "chip_force_exponent": {"exponent": "exponent"},
    "second_mode": {"mass_ratio": "mass_ratio", "frequency": "omega2", "damping_ratio": "zeta2",
                    "participation": "participation"},
    "sensor_lag": {"time_constant": "lag"},
    "helix": {"angle": "helix_lag"},
    "immersion_error": {"error": "window"},
}
LAWS = ("quintic", "cubic_damping", "wall_stiffness", "van_der_pol")
BESIDE = {"helix", "chip_force_exponent"}  # the simulator has no power law along a helix
SPEEDY = ("speed_droop", "speed_variation")  # a tachometer would show them, and hide nothing
WEAKEST, STRONGEST = 1.0, 30.0  # what is hidden moves the records by, in standard deviations of the noise
FEW = 2  # records by which a strength is found; tool wear takes all
COARSE = 4000.0  # Hz, at which they are looked at for that
SMALLER = 0.85  # by which the depth is reduced until no tooth leaves the work
LONGEST = 5e-6  # s, a step
Hide = Callable[[Cutting, float], Cutting]  # (a cut, a strength) -> the cut with the effect in it


@dataclass(frozen=True)
class Test:
    """One record: the cut as it was, its stated speed (rpm) and feed (m a tooth), state (m, m/s) and duration (s)."""

    cut: Cutting
    rpm: float
    feed: float
    state: tuple[float, float]
    duration: float


@dataclass(frozen=True)
class Sensors:
    """How it was measured and written. noise m (rms); late: share of the last cut after which its record begins, or 0."""

    noise: float
    rate: float
    tachometer: str  # none, pulse, digital or soft
    mark_angle: float
    form: str  # csv, times or hdf5
    feed_form: str  # tooth, revolution or minute
    bits: int = 0
    hum: float = 0.0  # m
    spike: bool = False
    stuck: bool = False
    late: float = 0.0


@dataclass(frozen=True)
class Plan:
    """A campaign before it is measured. believed: values the user has, by the simulator's names; hidden: by effect."""

    seed: int
    kind: str
    direction: str
    immersion: float
    base: Cutting
    believed: dict[str, float]
    hidden: dict[str, dict[str, float]]
    law: dict[str, float]
    tests: tuple[Test, ...]
    sensors: Sensors


def _between(random: np.random.Generator, low: float, high: float) -> float:
    return math.exp(random.uniform(math.log(low), math.log(high)))


def _machine(random: np.random.Generator, hidden: tuple[str, ...]) -> tuple[Cutting, str, float]:
    """(machine at rest, milling direction, immersion)."""
    flutes = int(random.integers(2 if "runout" in hidden else 1, 5))
    immersion, direction = _between(random, 0.08, 0.22), str(random.choice(["up-milling", "down-milling"]))
    window = TURN * immersion
    kt, omega = _between(random, 4.5e8, 1.1e9), TURN * _between(random, 75.0, 650.0)
    mass, entry = _between(random, 1e6, 4e6) / omega**2, 0.0 if direction == "up-milling" else math.pi - window
    rest = dict.fromkeys(("depth", "travel", "speed", "first_angle", "begin", "end"), 0.0)
    cutting = Cutting(mass, omega, _between(random, 0.005, 0.02), kt, kt * random.uniform(0.2, 0.45), flutes,
                      random.uniform(5e-3, 13e-3), entry, window, **rest)  # fmt: skip
    return cutting, direction, immersion


def _tests(random: np.random.Generator, base: Cutting, hidden: tuple[str, ...], table: bool) -> tuple[Test, ...]:
    """Five to eight tests; table: it travels as stated whatever the spindle does, else a feed a tooth as stated."""
    flutes, tests, length, stated_wrong = base.flutes, [], 0.0, random.uniform(0.0, 0.006)
    bears = base.mass * base.omega**2 / base.kt / flutes * 0.16 / (base.window / TURN)
    slow = "process_damping" in hidden
    for _ in range(int(random.integers(5, 9))):
        rpm = round(60.0 * base.omega / TURN / flutes / _between(random, 4.0 if slow else 1.3, 14.0 if slow else 6.0))
        speed = rpm * TURN / 60.0 * (1.0 + random.uniform(-stated_wrong, stated_wrong))
        feed, pitch = round(random.uniform(0.05, 0.15), 3) * 1e-3, TURN / flutes / speed
        begin = 3.0 * pitch + random.uniform(0.1, 0.4)
        at_entry, anywhere = (base.entry - speed * begin) % TURN, random.uniform(0.0, TURN)
        first = at_entry if random.uniform() < 0.7 else anywhere
        end = begin + max(35.0 * pitch, random.uniform(0.4, 1.0))
        travel = feed * flutes * (rpm / 60.0 if table else speed / TURN)
        cut = base._replace(depth=bears * random.uniform(0.15, 0.7), travel=travel, speed=speed, first_angle=first,
                            begin=begin, end=end, swing_phase=random.uniform(0.0, TURN), length_before=length)  # fmt: skip
        away, phase = _between(random, 1e-6, 1e-5), random.uniform(0.0, TURN)
        state = (away * math.cos(phase), away * base.omega * math.sin(phase))
        tests.append(Test(cut, rpm, feed, state, end + random.uniform(0.1, 0.5)))
        length += travel * (end - begin)
    return tuple(tests)


def at_strength(name: str, drawn: dict[str, float], cut: Cutting, strength: float) -> Cutting:
    """A cut with an effect's drawn values at a strength that goes up from 0."""
    values = _told(name, drawn, strength)
    if name == "helix":
        return cut._replace(helix_lag=cut.depth * math.tan(values["angle"]) / cut.radius)
    if name == "immersion_error":
        window = cut.window * (1.0 + values["error"])
        return cut._replace(window=window, entry=cut.entry if cut.entry == 0.0 else math.pi - window)
    if name == "second_mode":
        values["frequency"] *= TURN
    return cut._replace(**{field: values[parameter] for parameter, field in EFFECTS[name].items()})


def _scaled(name: str) -> tuple[str, ...]:
    """The parameters that vanish with the effect."""
    return {"dry_friction": ("force",), "runout": ("offset",), "speed_droop": ("droop",), "speed_variation": ("amplitude",),
            "second_mode": ("mass_ratio",)}.get(name, tuple(EFFECTS[name]))  # fmt: skip


def _values(random: np.random.Generator, name: str, base: Cutting) -> dict[str, float]:
    """An effect's values at strength 1, about the largest that is met with."""
    stiffness, sign = base.mass * base.omega**2, float(random.choice([-1.0, 1.0]))
    return {
        "cubic_stiffness": {"coefficient": stiffness / (2e-3) ** 2 * 10.0},
        "quadratic_damping": {"coefficient": 300.0},
        "dry_friction": {"force": stiffness * 1e-6, "presliding_displacement": _between(random, 5e-8, 5e-7)},
        "edge_force": {"tangential": random.uniform(0.5, 1.0) * 3e4, "normal": random.uniform(0.5, 1.0) * 3e4},
        "process_damping": {"coefficient": 3e5},
        "runout": {"offset": 2e-5, "angle": random.uniform(0.0, TURN)},
        "tool_wear": {"rate": 4.0},
        "speed_droop": {"droop": 0.3, "time_constant": random.uniform(0.08, 0.3)},
        "speed_variation": {"amplitude": 0.02, "frequency": random.uniform(1.5, 7.0)},
        "chip_force_exponent": {"exponent": 0.65},
        "second_mode": {"mass_ratio": 1.5, "frequency": base.omega / TURN * random.uniform(1.9, 4.5),
                        "damping_ratio": _between(random, 0.006, 0.03), "participation": random.uniform(0.6, 1.3)},
        "sensor_lag": {"time_constant": 2.0 / base.omega},
        "helix": {"angle": 0.75},
        "immersion_error": {"error": 0.3 * sign},
    }[name]  # fmt: skip


def _with_law(name: str, base: Cutting, cut: Cutting, strength: float) -> Cutting:
    """A cut with a law of no catalogue; strength 1 is about the largest that is met with."""
    stiffness, speed = base.mass * base.omega**2, base.omega * 1e-4  # at a motion of 0.1 mm
    if name == "wall_stiffness":
        return cut._replace(wall_stiffness=stiffness * strength, wall=1e-5)
    size = {"quintic": stiffness / 1e-4**4, "cubic_damping": 0.2 * stiffness * 1e-4 / speed**3,
            "van_der_pol": 0.2 * stiffness / 1e-4 / speed}[name] * 3e2  # fmt: skip
    return cut._replace(**{name: size * strength})


def steady(test: Test, cut: Cutting) -> bool:
    """Whether the run neither diverges nor leaves the work; a linear chip law holds with every tooth of a runout in it."""
    times, _, _, thinnest = run(cut, *test.state, test.duration, 2 * LONGEST)
    out = 0.0 if cut.offset == 0.0 else 2.0 * cut.offset
    return bool(times[-1] >= test.duration - 1e-3 and thinnest > out)


def displacement(test: Test, cut: Cutting, rate: float, longest: float = LONGEST) -> np.ndarray:
    """The sensor's displacement (n,) m, without noise."""
    times, angles, seen, _ = run(cut, *test.state, test.duration, longest)
    return sampled(times, angles, seen, np.arange(0.0, test.duration - 1e-6, 1.0 / rate))[0]


def _moved(tests: tuple[Test, ...], hide: Hide, strength: float, noise: float) -> float:
    """RMS over the noise of what the hidden effect changes; infinite where a run diverges."""
    squares, count = 0.0, 0
    for test in tests:
        with_it, without = (displacement(test, cut, COARSE, 2 * LONGEST) for cut in (hide(test.cut, strength), test.cut))
        if len(with_it) != len(without) or not np.isfinite(with_it).all() or np.abs(with_it).max() > 5e-3:
            return math.inf
        squares, count = squares + float(np.sum((with_it - without) ** 2)), count + len(without)
    return math.sqrt(squares / count) / noise


def _strength(tests: tuple[Test, ...], hide: Hide, wanted: float, noise: float) -> float:
    """The strength at which what is hidden moves the records by `wanted`, or 1 where it never does."""
    low, high = math.log(1e-4), 0.0
    for _ in range(9):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if _moved(tests, hide, math.exp(middle), noise) < wanted else (low, middle)
    return math.exp(low)


def _sensors(random: np.random.Generator, base: Cutting, motion: float, marked: bool, table: bool) -> Sensors:
    """Sensors for a motion of so much (rms, m)."""
    frequency = base.omega / TURN
    rate = float(random.choice([r for r in (4000.0, 5120.0, 8000.0, 10000.0, 12800.0, 16000.0, 25600.0) if r > 30 * frequency]))
    return Sensors(
        motion / _between(random, 15.0, 150.0), rate, str(random.choice(["pulse", "digital", "soft"])) if marked else "none",
        random.uniform(0.0, TURN), str(random.choice(["csv", "times", "hdf5"])),
        "minute" if table else str(random.choice(["tooth", "revolution"])), bits=12 if random.uniform() < 0.3 else 0,
        hum=motion / 300.0 if random.uniform() < 0.25 else 0.0, spike=bool(random.uniform() < 0.2),
        stuck=bool(random.uniform() < 0.2), late=random.uniform(0.2, 0.5) if random.uniform() < 0.25 else 0.0)  # fmt: skip


def _names(random: np.random.Generator, count: int) -> tuple[str, ...]:
    while True:
        names = tuple(str(name) for name in random.permutation(list(EFFECTS)))[:count]
        if not BESIDE.issubset(names):
            return names


def draw(seed: int) -> Plan:
    """The plan of one seed."""
    random = np.random.default_rng([1905, seed])
    kind = str(random.choice(list(KINDS), p=list(KINDS.values())))
    names = _names(random, {"one": 1, "pair": 2}.get(kind, 0))
    law = str(random.choice(LAWS)) if kind == "unknown" else ""
    base, direction, immersion = _machine(random, names)
    table = bool(random.uniform() < 0.3)
    tests = tuple(_bearable(test) for test in _tests(random, base, names, table))
    motion = float(np.concatenate([displacement(test, test.cut, COARSE) for test in tests]).std())
    marked = bool(random.uniform() < 0.7) and not set(names) & set(SPEEDY)
    sensors = _sensors(random, base, motion, marked, table)
    hidden, laws, hides = _hidden(random, names, law, base, tests, sensors.noise)
    believed = {name: getattr(base, name) * (1.0 + float(random.choice([-1, 1])) * random.uniform(0.3, 1.0) * off)
                for name, off in (("omega", 0.05), ("zeta", 0.2), ("kt", 0.2), ("kn", 0.2))}  # fmt: skip
    tests = tuple(_bearable(test, hides) for test in tests)
    return Plan(seed, kind, direction, immersion, base, believed, hidden, laws, tests, sensors)


def _hidden(random: np.random.Generator, names: tuple[str, ...], law: str, base: Cutting, tests: tuple[Test, ...],
            noise: float) -> tuple[dict[str, dict[str, float]], dict[str, float], list[tuple[Hide, float]]]:
    """(effects' true parameters, the law's strength by its name, everything that is hidden with its strength)."""
    effects, laws, hides = {}, {}, []
    for name in (*names, *([law] if law else [])):
        drawn = _values(random, name, base) if name in EFFECTS else {}
        hide = partial(at_strength, name, drawn) if drawn else partial(_with_law, name, base)
        wanted = _between(random, WEAKEST, STRONGEST)
        strength = _strength(tests if name == "tool_wear" else tests[:FEW], hide, wanted, noise)
        hides.append((hide, strength))
        if drawn:
            effects[name] = _told(name, drawn, strength)
        else:
            laws[name] = strength
    return effects, laws, hides


def _told(name: str, drawn: dict[str, float], strength: float) -> dict[str, float]:
    """An effect's true parameters, by the product's names."""
    if name == "chip_force_exponent":
        return {"exponent": 1.0 + (drawn["exponent"] - 1.0) * strength}
    return {parameter: value * strength if parameter in _scaled(name) else value for parameter, value in drawn.items()}


def _bearable(test: Test, hides: Sequence[tuple[Hide, float]] = ()) -> Test:
    """The test with what is hidden in it, at the first depth at which the tool stays in the work."""
    plain = test.cut
    while True:
        cut = reduce(lambda one, hidden: hidden[0](one, hidden[1]), hides, plain)
        if steady(test, cut):
            return replace(test, cut=cut)
        plain = plain._replace(depth=plain.depth * SMALLER)
