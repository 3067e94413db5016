"""Effects without parameters (loss of contact): whether a model that lacks one would predict otherwise with it."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace

import numpy as np

from testbed.analysis.fit.fit_state import State
from testbed.analysis.fit.waveform import Fitter
from testbed.effect import Effect

SEEN = 0.1  # mean square change of a prediction, in noise, from which it matters


def switchable(fitter: Fitter, state: State, catalogue: Mapping[str, Effect]) -> Iterator[tuple[str, list[str]]]:
    """Effects without parameters that the state's model lacks, each with the records that it would change, as all else stands.

    A chip that becomes negative is cut by a model without loss of contact as if the tooth pulled at the work.
    """
    for name, effect in catalogue.items():
        if effect.parameters or name in state.model.effects:
            continue
        other = replace(state, model=state.model.with_effect(name))
        changed = [record.name for place, record in enumerate(fitter.records)
                   if record.cut is not None and _changes(fitter, place, state, other)]
        if changed:
            yield name, changed


def switch_note(fitter: Fitter, state: State, catalogue: Mapping[str, Effect]) -> list[str]:
    """In words, which such effects are to be added before the parameters of the model are believed."""
    return [f"{', '.join(changed)}: {name}, which the model lacks, would change what it predicts there: add it, too, before "
            "the parameters are believed"
            for name, changed in switchable(fitter, state, catalogue)]


def _changes(fitter: Fitter, place: int, state: State, other: State) -> bool:
    record = fitter.records[place]
    change = fitter.residual_of(place, other) - fitter.residual_of(place, state)
    size = record.scale / record.noise  # residuals may be weighed by more than the noise
    rows = change[: record.size].reshape(len(record.channels), -1) * size[:, None]
    return float(np.mean(rows**2)) > SEEN
