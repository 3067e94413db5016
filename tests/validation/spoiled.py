"""Campaigns with one thing wrong with the recorder: do intervals still hold the truth, or is the value withheld?

Clipped: each record at half of its largest swing. Clock: the sampling rate is stated 0.5 % off, tachometer and all. The
machines are drawn about the published rig, the motion is the fast engine's, with all that a measurement adds.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from testbed.analysis.fit.estimates import estimates
from testbed.analysis.fit.held_out import errors_in_fit, pooled
from testbed.analysis.fit.model_fit import model_fit
from testbed.analysis.fit.observe import observe
from testbed.api.fitting import plant_of
from testbed.catalogue import catalogue
from testbed.engines import fast
from testbed.files.campaign import Record
from testbed.machine import Cutter, Cutting, Model, Structure
from tests.support.synthetic_campaign import TESTS, synthetic_record
from tests.validation.claims import Claim, Section

FIRST, CAMPAIGNS, CUTS = 700, 25, 3
HALF, CLOCK = 0.5, 0.005
COURSE = (8, 40, 20)  # revolutions of idling, cutting, ringing down
PARAMETERS = ("natural_frequency", "damping_ratio", "tangential_coefficient", "normal_coefficient")
OFF = (0.01, 0.25, 0.2, 0.2)  # of each, what is believed of it


def clipped(record: Record, random: np.random.Generator) -> Record:
    """The record, cut off at half of its largest swing about its middle."""
    channels = {}
    for name, values in record.recording.channels.items():
        middle = float(np.median(values))
        most = HALF * float(np.abs(values - middle).max())
        channels[name] = np.clip(values, middle - most, middle + most)
    return replace(record, recording=replace(record.recording, channels=channels))


def off_clock(record: Record, random: np.random.Generator) -> Record:
    """The record at a sampling rate that is stated too high or too low, and the tachometer by the same clock."""
    recording, factor = record.recording, 1.0 + CLOCK
    return replace(record, recording=replace(recording, sampling_rate=factor * recording.sampling_rate,
                                             start=recording.start / factor, marks=recording.marks / factor))


KINDS: dict[str, Callable[[Record, np.random.Generator], Record]] = {
    "as it was": lambda record, random: record, "clipped by half": clipped, "a clock 0.5 % off": off_clock}


def campaign(seed: int, spoil: Callable[[Record, np.random.Generator], Record]) -> tuple[Model, Model, list[Record]]:
    """(the true machine, the believed one, cuts as recorded)."""
    random = np.random.default_rng([5317, seed])
    true = Model(Structure(2.573, 146.4225 * random.uniform(0.995, 1.005), 0.0032 * random.uniform(0.8, 1.5)), Cutter(),
                 Cutting("up-milling", 0.162, 5.5e8 * random.uniform(0.9, 1.1), 2.0e8 * random.uniform(0.9, 1.1)))
    believed = true.with_values({name: true.value(name) * (1.0 + off * random.uniform(-1, 1))
                                 for name, off in zip(PARAMETERS, OFF, strict=True)})  # fmt: skip
    chosen = random.choice(len(TESTS), CUTS, replace=False)
    simulate = partial(fast.simulate, steps=37)
    records = [synthetic_record(simulate, true, TESTS[one][0], 1e-3 * TESTS[one][1], 100 * seed + number, course=COURSE,
                                rate=6400.0) for number, one in enumerate(chosen)]  # fmt: skip
    return true, believed, [spoil(record, random) for record in records]


def judged(seed: int, kind: str) -> dict[str, Any]:
    """Of each parameter: held, missed or withheld; and the error of the fit over its noise floor."""
    true, believed, records = campaign(seed, KINDS[kind])
    known = catalogue()
    fitter, fit = model_fit(plant_of(known), [observe(record, believed) for record in records], believed, known)
    error, noise = pooled(errors_in_fit(fitter, fit))
    told: dict[str, Any] = {"seed": seed, "kind": kind, "error": error / noise}
    for path, one in estimates(fitter, fit, known).items():
        if path in PARAMETERS:
            told[path] = "withheld" if not one.determined else "held" if one.low <= true.value(path) <= one.high else "missed"
    return told


def check(campaigns: int = CAMPAIGNS) -> Section:
    """All kinds, so many campaigns each."""
    claims, rows = [], []
    for kind in KINDS:
        answers = [judged(FIRST + number, kind) for number in range(campaigns)]
        said = Counter(one[path] for one in answers for path in PARAMETERS)
        told = said["held"] + said["missed"]
        whole = sum(all(one[path] != "missed" for path in PARAMETERS) for one in answers)
        claims.append(Claim(f"{kind}: 95 % intervals that hold the truth", "90 to 99 %, or withheld",
                            f"{said['held']} of {told}", said["held"] >= 0.9 * told,
                            f"{said['withheld']} withheld; all four in {whole} of {campaigns}"))
        rows += [(kind, path, *(str(sum(one[path] == word for one in answers)) for word in ("held", "missed", "withheld")))
                 for path in PARAMETERS]
    return Section("What is wrong with the recorder: intervals", tuple(claims),
                   (("Parameter by parameter", ("recorder", "parameter", "held", "missed", "withheld"), tuple(rows)),))
