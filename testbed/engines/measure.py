"""What the sensor's own effects make of the simulated channels (both engines)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from testbed.cut import Sampling
from testbed.effect import Effect, arguments_of
from testbed.engines.model_arrays import active_effects
from testbed.machine import Model
from testbed.recording import MOTION_UNITS

_RATE_OF = {"displacement": "velocity", "velocity": "acceleration"} | {
    f"{sensor}{one}_{axis}": f"{sensor}{rate}_{axis}" for sensor in ("", "tool_") for axis in ("x", "y")
    for one, rate in (("displacement", "velocity"), ("velocity", "acceleration"))}
# what a hook is told of a channel: motion along the feed, at the workpiece, goes by its short name
_QUANTITY = {f"{one}_x": one for one in MOTION_UNITS}


def _with_rates(channels: Sequence[str], known: Mapping[str, Any]) -> dict[str, int]:
    """The wanted channels and those that hold their rates of change, each with how often a wanted one is differentiated."""
    order = dict.fromkeys(channels, 0)
    for name in channels:
        rate, count = _RATE_OF.get(name, ""), 1
        while rate in known:
            order[rate] = min(count, order.get(rate, count))
            rate, count = _RATE_OF.get(rate, ""), count + 1
    return order


def senses(model: Model, catalogue: Mapping[str, Effect]) -> bool:
    """Whether the model has effects of the sensor itself."""
    return any("measure" in catalogue[name].hooks for name in model.effects)


def asks_rates(model: Model, catalogue: Mapping[str, Effect]) -> bool:
    """Whether an effect of the sensor itself asks for the rate of change of what it senses."""
    return any("rate" in arguments_of(catalogue[name], "measure") for name in model.effects)


def _differences(signal: np.ndarray, sampling_rate: float) -> np.ndarray:
    return np.gradient(signal, 1.0 / sampling_rate) if len(signal) > 1 else np.zeros_like(signal)


def measured_channels(model: Model, catalogue: Mapping[str, Effect], signals: Mapping[str, np.ndarray],
                      channels: Sequence[str], sampling: Sampling) -> dict[str, np.ndarray]:
    """The wanted channels after every active `measure` hook, in the catalogue's order.

    signals: the channels as they are (samples,); a hook is given its channel's rate of change, as the hooks before it
    have left that rate (by differences where no channel holds it). Hooks that ask for the true signal add to what reaches
    the sensor, so they come before those that only alter what it gives.
    """
    active = [(catalogue[name], values) for name, values in active_effects(model, catalogue).items()
              if "measure" in catalogue[name].hooks]
    if not active:
        return {name: np.array(signals[name]) for name in channels}
    active.sort(key=lambda pair: "true_signal" not in arguments_of(pair[0], "measure"))
    order = _with_rates(channels, signals)
    measured = {name: np.array(signals[name]) for name in order}
    true = dict(measured)
    time = sampling.start + np.arange(sampling.count) / sampling.rate
    for place, (effect, values) in enumerate(active):
        hook, wanted = effect.hooks["measure"], arguments_of(effect, "measure")
        later = sum("rate" in arguments_of(other, "measure") for other, _ in active[place + 1 :])
        before = dict(measured)
        for quantity, signal in before.items():
            if quantity == "spindle_angle" or order[quantity] > later:  # a rate that no later hook asks for
                continue
            offers = {"signal": signal, "true_signal": true[quantity], "sampling_rate": sampling.rate,
                      "quantity": _QUANTITY.get(quantity, quantity), "time": time, **values}
            if "rate" in wanted:
                rate = before.get(_RATE_OF.get(quantity, ""))
                offers["rate"] = _differences(signal, sampling.rate) if rate is None else rate
            measured[quantity] = np.asarray(hook(**{key: offers[key] for key in wanted}), dtype=float)
    return {name: measured[name] for name in channels}
