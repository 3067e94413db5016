"""What the sensor's own effects make of the simulated channels (both engines)."""

from __future__ import annotations

import inspect
from collections.abc import Mapping, Sequence

import numpy as np

from testbed.cut import Sampling
from testbed.effect import Effect
from testbed.engines.packing import active_effects
from testbed.machine import Model

_RATE_OF = {"displacement": "velocity", "velocity": "acceleration"}


def _with_rates(channels: Sequence[str], signals: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    """The wanted channels, and after them those whose values are the rates of change of others."""
    chain = {name: np.array(signals[name]) for name in channels}
    for name in channels:
        rate = _RATE_OF.get(name, "")
        while rate in signals:
            chain.setdefault(rate, np.array(signals[rate]))
            rate = _RATE_OF.get(rate, "")
    return chain


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
    active.sort(key=lambda pair: "true_signal" not in inspect.signature(pair[0].hooks["measure"]).parameters)
    measured = _with_rates(channels, signals)
    true = dict(measured)
    time = sampling.start + np.arange(sampling.count) / sampling.rate
    for effect, values in active:
        hook = effect.hooks["measure"]
        wanted = inspect.signature(hook).parameters
        before = dict(measured)
        for quantity, signal in before.items():
            if quantity == "spindle_angle":
                continue
            offers = {"signal": signal, "true_signal": true[quantity], "sampling_rate": sampling.rate,
                      "quantity": quantity, "time": time, **values}
            if "rate" in wanted:
                rate = before.get(_RATE_OF.get(quantity, ""))
                offers["rate"] = _differences(signal, sampling.rate) if rate is None else rate
            measured[quantity] = np.asarray(hook(**{key: offers[key] for key in wanted}), dtype=float)
    return {name: measured[name] for name in channels}
