"""Records that agree with the model one by one, but not together: the machine was another one in every test.

Material cut away, another clamping or a warmer spindle changes a constant between tests. No effect of a catalogue acts between
them, and a search would only look for what nibbles at the difference.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import chdtrc

from testbed.analysis.estimate import Estimate
from testbed.analysis.fit.estimates import estimates, matters
from testbed.analysis.fit.observed import Observed
from testbed.analysis.fit.prediction import Engine
from testbed.analysis.information import Z_95
from testbed.analysis.search.outlier_records import SOUND
from testbed.analysis.search.refit_from_prior import from_believed
from testbed.effect import Effect
from testbed.machine import BASE_UNITS, Model, base_parameter

FEWEST = 3  # records
BY_CHANCE = 1e-6  # chance of so large a scatter of one parameter's values, were they one, below which they are not
TRUSTED = 4e-5  # of a value: no interval is believed to be narrower, because of the engine's own error
TOLD = 8  # records whose values are told one by one


@dataclass(frozen=True)
class Differing:
    """A parameter of the machine that is not one in all records: its estimates in the order of the records, their chance."""

    path: str
    values: Mapping[str, Estimate]
    chance: float

    @property
    def unit(self) -> str:
        """SI unit of the parameter."""
        return BASE_UNITS[base_parameter(self.path) or ""]

    @property
    def sentence(self) -> str:
        """In words, what the records have it as."""
        found = [one.value for one in self.values.values()]
        if len(found) > TOLD:
            return f"{self.path}, from {min(found):.5g} to {max(found):.5g} {self.unit}"
        each = ", ".join(f"{name} {one.value:.5g}" for name, one in self.values.items())
        return f"{self.path} ({self.unit}: {each})"


def each_alone(engine: Engine, records: Sequence[Observed], model: Model, catalogue: Mapping[str, Effect],
               worst_first: Sequence[int]) -> list[Differing]:  # fmt: skip
    """The parameters that differ from record to record, the surest first; none where a record alone disagrees with the model.

    worst_first: places of the records in the order in which they are asked: the first that disagrees ends it.
    """
    if len(records) < FEWEST:
        return []
    found = {}
    for place in worst_first:
        alone = from_believed(engine, [records[place]], model, (), catalogue)
        if float(alone.fit.mean_squares[0]) > SOUND:
            return []
        found[place] = estimates(alone.fitter, alone.fit, catalogue)
    names = {records[place].name: found[place] for place in sorted(found)}
    return differing(names)


def differing(found: Mapping[str, Mapping[str, Estimate]]) -> list[Differing]:
    """Those parameters of the machine whose values (by record, by path) scatter by more than their intervals, and matter."""
    told = []
    for path in dict.fromkeys(path for one in found.values() for path in one if base_parameter(path)):
        values = {name: one[path] for name, one in found.items() if path in one and one[path].known}
        if len(values) < FEWEST:
            continue
        value = np.array([one.value for one in values.values()])
        turns = base_parameter(path) == "direction"  # half a turn is the same, and 0 is no size
        value = value[0] + np.remainder(value - value[0] + 0.5 * math.pi, math.pi) - 0.5 * math.pi if turns else value
        error = np.array([max(one.high - one.low, TRUSTED * abs(one.value)) / (2.0 * Z_95) for one in values.values()])
        mean = float(np.sum(value / error**2) / np.sum(error**-2.0))
        chance = float(chdtrc(len(value) - 1, float(np.sum(((value - mean) / error) ** 2))))
        if chance < BY_CHANCE and float(value.std(ddof=1)) > matters(path) * (1.0 if turns else abs(mean)):
            told.append(Differing(path, values, chance))
    return sorted(told, key=lambda one: one.chance)



def said_apart(apart: Sequence[Differing]) -> str:
    """In words, that each record alone agrees with the model, and in which parameters they differ."""
    which = " and ".join(one.sentence for one in apart)
    return (f"Each record alone agrees with the model as it is, down to its noise, but has its own {which}: the machine was "
            "another in every test (material cut away, another clamping, warmer), or that depends on the conditions.")
