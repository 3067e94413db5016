"""Ring-downs as they come, by closed forms: slow and fast ones, several blows, tones near the sampling rate, rubbing, growth.

Every draw has its own rate, length, frequency, damping, noise and offset. What is found is right, said to be unknown, or wrong:
- decays of 0.1 Hz to 20 kHz: frequency within 1 %, damping within 20 %, where the interval of damping is narrower than that;
- two to four blows: all found, none more, each within one swing, and the damping of each within 20 %;
- fast tones and decays (0.15 to 0.49 of the sampling rate): the noise within 25 %, and never above the record's own rms;
- rubbing decays in coarse steps, most of them at rest in the end: the noise within 25 % of step / root 12;
- growing swings: told as such, and none of as many decays;
- one to five modes in one to three channels, half of them with a pair within 3 %: as many, frequency within 0.2 %, damping
  within 5 % or its interval and a half.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable

import numpy as np

from testbed.analysis.records.blows import grows
from testbed.analysis.records.decay_modes import decay_modes
from testbed.analysis.records.noise import Noise, noise_floor
from testbed.analysis.records.ring_downs import blow_times, ring_downs
from testbed.analysis.records.segments import find_segments
from testbed.recording import Recording
from tests.support.made_decays import decay, recorded, rubbed
from tests.validation.claims import Claim, Section

DRAWS = 60
RIGHT, UNKNOWN, WRONG = "right", "unknown", "wrong"


def _noise(floor: Noise, true: float, values: np.ndarray) -> str:
    if floor.rms > 1.0001 * float(np.std(values)):
        return WRONG
    if not floor.known:
        return UNKNOWN
    return RIGHT if abs(floor.rms / true - 1.0) < 0.25 else WRONG


def _seen(values: np.ndarray, rate: float) -> tuple[Recording, tuple, Noise]:
    recording = recorded(values, rate)
    segments = find_segments(recording, kind="ring-down")
    return recording, segments, noise_floor(recording, segments)


def slow_and_fast(random: np.random.Generator) -> str:
    """One decay of 0.1 Hz to 20 kHz."""
    frequency, damping = 10 ** random.uniform(-1, math.log10(2e4)), 10 ** random.uniform(-3.3, -1)
    per_swing = 10 ** random.uniform(math.log10(2.7), 2.2)
    swings, rate = max(random.uniform(8, 200), 200 / per_swing), per_swing * frequency
    time = np.arange(round(swings * per_swing)) / rate
    begin = 0.0 if random.random() < 0.5 else random.uniform(0.0, 0.4) * time[-1]
    values = decay(time, begin, frequency, damping, 0.8 if begin == 0.0 else 0.0) + random.uniform(-0.5, 0.5)
    values = 10 ** random.uniform(-7, 0) * (values + 10 ** random.uniform(-4, -1.5) * random.standard_normal(len(time)))
    recording, segments, _ = _seen(values, rate)
    found = [mode for ring in ring_downs(recording, segments) for mode in ring.modes]
    if not found:
        return UNKNOWN
    told = found[0].natural_frequency, found[0].damping_ratio
    if told[1].high - told[1].low > 0.4 * damping:
        return UNKNOWN
    near = abs(told[0].value / frequency - 1) < 0.01 and abs(told[1].value / damping - 1) < 0.2
    return RIGHT if near and not blow_times(recording) else WRONG


def several_blows(random: np.random.Generator) -> str:
    """Two to four blows, each clearly louder than what is left of the one before; of half the structures two modes ring."""
    count, frequency, damping = int(random.integers(2, 5)), 10 ** random.uniform(-0.5, 3.5), 10 ** random.uniform(-2.6, -1.4)
    rate = random.uniform(6, 50) * frequency
    gap = max(20 / frequency, random.uniform(1.3, 2.5) / (damping * 2 * math.pi * frequency))
    time = np.arange(round((count + 0.5) * gap * rate)) / rate
    begins = [gap * (number + 0.3 + random.uniform(-0.05, 0.05)) for number in range(count)]
    if random.random() < 0.3:
        begins[0] = 0.0
    other = random.uniform(1.05, 2.3) * frequency if random.random() < 0.5 else 0.0
    values = random.uniform(-1, 1) + 10 ** random.uniform(-4, -2) * random.standard_normal(len(time))
    for begin in begins:
        size, phase = random.uniform(0.8, 1.25), 0.0 if begin else 1.0
        values += size * decay(time, begin, frequency, damping, phase)
        values += 0.4 * size * decay(time, begin, other, damping, phase) if other else 0.0
    recording, segments, _ = _seen(values, rate)
    found = blow_times(recording)
    if len(found) != count:
        return WRONG
    placed = all(abs(one - begin) < 1.3 / frequency for one, begin in zip(found, begins, strict=True))
    rings = [mode for ring in ring_downs(recording, segments) for mode in ring.modes]
    main = [one for one in rings if abs(one.natural_frequency.value / frequency - 1) < 0.02]
    fine = len(main) == count and all(abs(one.damping_ratio.value / damping - 1) < 0.2 for one in main)
    return RIGHT if placed and fine else WRONG


def fast_tone(random: np.random.Generator) -> str:
    """A lasting tone, read as a bare file, or a decay, at 0.15 to 0.49 of the sampling rate."""
    samples, share, noise = int(random.integers(100, 20000)), random.uniform(0.15, 0.49), 10 ** random.uniform(-4, -0.5)
    rate = 10 ** random.uniform(0, 5.5)
    time, lasts = np.arange(samples) / rate, random.random() < 0.5
    begin, damping = random.uniform(0, 0.4) * time[-1], 10 ** random.uniform(-3.5, -1.5)
    pure = decay(time, begin, share * rate, 0.0 if lasts else damping, 0.3)
    values = pure + noise * random.standard_normal(samples)
    if lasts:
        values = np.sin(2 * math.pi * share * np.arange(samples) + 0.3) + noise * random.standard_normal(samples)
        return _noise(noise_floor(recorded(values, rate), ()), noise, values)
    return _noise(_seen(values, rate)[2], noise, values)


def rubbing(random: np.random.Generator) -> str:
    """Dry and viscous friction, read in coarse steps."""
    frequency, rate = 1.0, random.uniform(20, 60)
    steps = random.uniform(15, 60)  # of the converter, in the first swing
    samples = round(rate * random.uniform(8, 25))
    values = rubbed(1.0, frequency, random.uniform(0.005, 0.06), random.uniform(0.01, 0.06), rate, samples)
    step = 1.0 / steps
    return _noise(_seen(step * np.round((values + random.uniform(0, step)) / step), rate)[2], step / math.sqrt(12), values)


def growing(random: np.random.Generator) -> str:
    """Swings that grow by 3 to 1000 times, or, turned round, die away."""
    per_swing, swings = random.uniform(4, 60), random.uniform(20, 150)
    place = np.arange(round(per_swing * swings))
    growth = 10 ** random.uniform(0.5, 3) if random.random() < 0.5 else 10 ** random.uniform(-3, -0.5)
    noise = 10 ** random.uniform(-4, -1.5) * max(growth, 1.0)
    values = growth ** (place / len(place)) * np.sin(2 * math.pi * place / per_swing + 0.5)
    told = grows(values + noise * random.standard_normal(len(place))) is not None
    return RIGHT if told == (growth > 1.0) else WRONG


def several_modes(random: np.random.Generator) -> str:
    """One to five modes in one to three channels."""
    count, channels = int(random.integers(1, 6)), int(random.integers(1, 4))
    frequencies = 10 ** random.uniform(math.log10(4e-3), math.log10(0.3), count)
    dampings = 10 ** random.uniform(-2.7, -1.5, count)
    pair = count > 1 and random.random() < 0.5
    if pair:
        frequencies[1], dampings[:2] = frequencies[0] * (1 + random.uniform(0.021, 0.03)), 10 ** random.uniform(-2.7, -2.1, 2)
    kept = [0]
    for place in range(1, count):
        if pair and place == 1 or all(abs(frequencies[place] / frequencies[one] - 1) > 0.1 for one in kept):
            kept.append(place)
    frequencies, dampings = frequencies[kept], dampings[kept]
    time = np.arange(int(np.clip(max(3 / (2 * math.pi * dampings * frequencies)), 400, 40000)))
    values = 10 ** random.uniform(-4, -2) * random.standard_normal((channels, len(time))) + random.uniform(-1, 1, (channels, 1))
    for frequency, damping in zip(frequencies, dampings, strict=True):
        shape = 10 ** random.uniform(-1, 0) * random.choice([-1, 1], channels) * random.uniform(0.3, 1, channels)
        values += np.outer(shape, decay(time, 0.0, frequency, damping, random.uniform(0, 2 * math.pi)))
    found = decay_modes(values)
    if found is None or len(found) != len(kept):
        return WRONG
    order, by_size = np.argsort(frequencies), np.argsort(np.abs(found.poles))
    poles = found.poles[by_size]
    told, ratios = np.abs(poles) / (2 * math.pi), -poles.real / np.abs(poles)
    wide = 1.5 * 1.96 * np.sqrt(found.covariance[by_size, 0, 0]) / np.abs(poles)
    near = np.all(np.abs(told / frequencies[order] - 1) < 2e-3)
    return RIGHT if near and np.all(np.abs(ratios - dampings[order]) < np.maximum(0.05 * dampings[order], wide)) else WRONG


KINDS: tuple[tuple[str, Callable[[np.random.Generator], str], float], ...] = (
    ("decays of 0.1 Hz to 20 kHz: frequency and damping", slow_and_fast, 0.03),
    ("several blows: all found, damping of each", several_blows, 0.05),
    ("tones and decays near the sampling rate: noise", fast_tone, 0.03),
    ("rubbing decays in coarse steps: noise", rubbing, 0.05),
    ("growing swings told from decays", growing, 0.03),
    ("one to five modes in one to three channels", several_modes, 0.03),
)


def check() -> Section:
    """Count what is right, unknown and wrong over new draws of each kind."""
    claims = []
    for number, (what, draw, most) in enumerate(KINDS):
        random = np.random.default_rng([53, number])
        found = Counter(draw(random) for _ in range(DRAWS))
        told = f"{found[RIGHT]} right, {found[UNKNOWN]} said unknown, {found[WRONG]} wrong of {DRAWS}"
        claims.append(Claim(what, f"wrong <= {most:.0%}", told, found[WRONG] <= most * DRAWS))
    return Section("Ring-downs as they come (closed forms)", tuple(claims))
