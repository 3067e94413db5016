"""The fit begun where the cutting coefficients as believed lead: free from the beginning, they went to where no machine is.

On the way there the passes of entries and exits have bent to suit them.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence

from testbed.analysis.fit.fit_state import WaveformFit
from testbed.analysis.fit.free_parameters import at_a_bound
from testbed.analysis.fit.moves import FRONTS
from testbed.analysis.fit.observed import Observed
from testbed.analysis.fit.solve import Goal, Move, Trial, solve
from testbed.analysis.fit.starts import base_fit
from testbed.analysis.fit.waveform import Fitter
from testbed.machine import Model

EXPLAINED = 1.1  # mean square residual up to which coefficients are believed, whatever they are


def propose(fitter: Fitter, fit: WaveformFit, goal: Goal) -> Iterator[Trial]:
    """The fit with all but the coefficients fitted first, where a parameter is at its bound or the cut is that of no tool."""
    if goal.prior is None or not (at_a_bound(fitter.free, fit.state.model) or _cuts_like_no_tool(fit)):
        return
    yield from begun_without(fitter, fitter.records, goal.prior, lambda path: path.endswith("_coefficient"))


MOVE = Move(propose)


def begun_without(fitter: Fitter, records: Sequence[Observed], prior: Model, held: Callable[[str], bool],
                  as_believed: bool = False) -> Iterator[Trial]:  # fmt: skip
    """The fit to records begun by one from the prior in which parameters are held.

    held: whether the one of a path is; as_believed: see `base_fit`.
    """
    free = [one for one in fitter.unknowns if not held(one.path)]
    found, begun = base_fit(fitter.engine, records, prior, free=free, as_believed=as_believed)
    whole = fitter if records is fitter.records else fitter.on(found.records)
    yield Trial(*solve(whole, whole.fit(begun.state), FRONTS))


def _cuts_like_no_tool(fit: WaveformFit) -> bool:
    """Whether a fit has a normal force that pulls, or is larger than the tangential one.

    Of one mode along the feed and equal teeth, only a fit that leaves more than noise: that is left of too few parameters.
    """
    model, cutting = fit.state.model, fit.state.model.cutting
    if cutting is None or fit.variance < EXPLAINED and not model.planar:
        return False
    return not 0.0 <= cutting.normal_coefficient <= cutting.tangential_coefficient
