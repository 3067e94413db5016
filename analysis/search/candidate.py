"""Sets of effects that were tried: those that were fitted, and those that a first step ruled out."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from testbed.analysis.fit.fit_state import WaveformFit
from testbed.analysis.fit.held_out import RecordError, holds_out, pooled_where_known
from testbed.analysis.fit.waveform import Fitter

ADEQUATE = 1.02  # error over noise floor up to which nothing is looked for


@dataclass(frozen=True)
class Tried:
    """A set of effects tried: how well it predicts what it was not fitted to. One that a first step ruled out is no more."""

    effects: tuple[str, ...]
    parameters: Mapping[str, float]
    error_fit: float
    error_held_out: float
    delta_bic: float
    converged: bool
    errors: tuple[RecordError, ...] = ()

    @property
    def held_out(self) -> bool:
        """Whether a condition could be left out of the fit; of one condition alone, error_held_out is that in the fit."""
        return False

    @property
    def error_where_known(self) -> float:
        """The held-out error, but in the fit of a record that shows what no other does, where those others agree."""
        return pooled_where_known(self.errors) if self.errors else self.error_held_out

    def error_beside(self, noise: float) -> float:
        """The error by which sets of effects are chosen among: held out, but of one that where known leaves noise alone."""
        return self.error_where_known if self.error_where_known <= ADEQUATE * noise else self.error_held_out


@dataclass(frozen=True, kw_only=True)
class Candidate(Tried):
    """A set of effects that was fitted."""

    fit: WaveformFit
    fitter: Fitter

    @property
    def held_out(self) -> bool:
        """Whether a condition could be left out of the fit."""
        return holds_out(self.fitter.records)
