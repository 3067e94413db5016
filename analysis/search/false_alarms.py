"""How often the diagnosis names an effect where nothing is hidden: a parametric bootstrap at the user's own conditions.

The refitted believed model is taken for the truth: it predicts every record with the record's own nuisances, noise of the
measured size is added, and the whole diagnosis is made again, many times.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import betaincinv

from testbed.analysis.fit.observed import Observed
from testbed.analysis.fit.prediction import Engine, predict
from testbed.analysis.search.candidate import Candidate
from testbed.analysis.search.diagnose import diagnose
from testbed.effect import Effect


@dataclass(frozen=True)
class FalseAlarms:
    """How many of `count` campaigns without a hidden effect had one named, with the 95 % interval of the rate."""

    count: int
    alarms: int
    named: tuple[tuple[str, ...], ...]

    @property
    def interval(self) -> tuple[float, float]:
        """95 % interval of the rate, Clopper and Pearson (1934, Biometrika 26, 404)."""
        low = betaincinv(self.alarms, self.count - self.alarms + 1, 0.025) if self.alarms else 0.0
        high = betaincinv(self.alarms + 1, self.count - self.alarms, 0.975) if self.alarms < self.count else 1.0
        return float(low), float(high)


def false_alarms(
    engine: Engine,
    base: Candidate,
    catalogue: Mapping[str, Effect],
    count: int,
    seed: int,
    progress: Callable[[str], None] = lambda text: None,
) -> FalseAlarms:
    """Repeat the diagnosis on `count` campaigns drawn from the base fit. Reproducible from `seed`."""
    state = base.fit.state
    named = []
    for number in range(count):
        progress(f"campaign {number + 1} of {count} without a hidden effect")
        random = np.random.default_rng([seed, number])
        drawn = [
            _drawn(engine, record, (state.model, state.angle, own), random)
            for record, own in zip(base.fitter.records, state.nuisances, strict=True)
        ]
        found = diagnose(engine, drawn, state.model, catalogue)
        if found.verdict in ("missing_effect", "undecided"):
            named.append(found.effects)
    return FalseAlarms(count, len(named), tuple(named))


def _drawn(engine: Engine, record: Observed, variant: tuple, random: np.random.Generator) -> Observed:
    """The record as the model would have given it, with new noise; offset and drift stay as they were."""
    clean = predict(engine, record, [variant])[0]
    slow = ((record.data - clean) @ record.drift) @ record.drift.T
    return replace(record, data=clean + slow + record.noise[:, None] * random.standard_normal(record.data.shape))
