"""Windows of one length out of a run, each with the part of the run it lies in."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from fractions import Fraction
from typing import Any, Literal

import numpy as np

from testbed.recording import Recording

Part = Literal["idle", "entry", "cut", "exit", "ring-down", "whole cut"]
IN_CUT: Part = "cut"
OUT_OF_CUT: tuple[Part, ...] = ("idle", "ring-down")
FINEST = 1000  # largest numerator and denominator of a ratio of sampling rates: the filter grows with it


@dataclass(frozen=True)
class Windowing:
    """Samples of a window, and samples from the start of one to the start of the next."""

    length: int
    step: int

    def most(self, samples: int) -> int:
        """Windows of a run of so many samples."""
        return max(0, (samples - self.length) // self.step + 1)


def windows_of(recording: Recording, how: Windowing) -> Iterator[dict[str, Any]]:
    """The columns of every window of a run that is a window's own: number, start, part of the run, signals.

    A window with a sample that is no finite number is left out, and its number with it. Views of the recording's samples.
    """
    entry, leave, passes = _course(recording)
    for number in range(how.most(len(recording))):
        first = number * how.step
        signals = {name: values[first:first + how.length] for name, values in recording.channels.items()}
        if not all(np.isfinite(values).all() for values in signals.values()):
            continue
        start = recording.start + first / recording.sampling_rate
        part = _part(start, start + (how.length - 1) / recording.sampling_rate, entry, leave)
        inside = entry <= start < leave
        yield {"window": number, "start": start, "segment": part, **signals,
               "passes_in_cut": int(np.searchsorted(passes, start, "right")) - 1 if inside else None}


def _course(recording: Recording) -> tuple[float, float, np.ndarray]:
    """When the first tooth enters and when the cut ends (s; infinite if the run ended before), and the cut's pass times."""
    known, passes = recording.conditions, recording.pass_times
    first = int(known["idle_passes"])
    last = first + int(known["passes"])
    entry, leave = (float(passes[place]) if passes.size > place else math.inf for place in (first, last))
    return entry, leave, passes[first:last]


def _part(start: float, stop: float, entry: float, leave: float) -> Part:
    """Where a window from its first sample to its last (s) lies; `whole cut`: over the entry and the exit."""
    if stop < entry:
        return "idle"
    if start >= leave:
        return "ring-down"
    if start < entry:
        return "entry" if stop < leave else "whole cut"
    return IN_CUT if stop < leave else "exit"


def ratio_of(rate: float, source: float) -> Fraction | None:
    """rate over source as a fraction of small numbers; None where there is none, or where it is above 1."""
    ratio = Fraction(rate / source).limit_denominator(FINEST)
    close = abs(float(ratio) * source - rate) <= 1e-9 * rate
    return ratio if close and 0 < ratio <= 1 else None


def resampled(recording: Recording, rate: float) -> Recording:
    """The recording at a lower rate (Hz), low-passed before; marks, pass times and labels are times and stay.

    A polyphase filter (scipy's resample_poly, a Kaiser window): 6 dB down at half the new rate. ValueError where `ratio_of`
    is None.
    """
    from scipy.signal import resample_poly

    ratio = ratio_of(rate, recording.sampling_rate)
    if ratio is None:
        raise ValueError(f"{recording.sampling_rate:g} Hz is not brought to {rate:g} Hz")
    if ratio == 1:
        return recording
    channels = {name: resample_poly(values, ratio.numerator, ratio.denominator, padtype="line") if len(values) else values
                for name, values in recording.channels.items()}
    return replace(recording, channels=channels, sampling_rate=rate, filled=np.empty(0, int))


def labelled(run: Mapping[str, Any], part: str) -> dict[str, Any]:
    """The window's `label` and `chatter` from those of its run and the part it lies in.

    Wholly in the cut it has the run's. Before the entry and after the exit no tooth cuts: `no_cut`, no chatter, however loud
    the structure still rings. Across the entry or the exit it is neither: unknown, whatever the run, so that no class loses
    more windows than another.
    """
    if part == IN_CUT:
        return {"label": run["label"], "chatter": run["chatter"]}
    if part in OUT_OF_CUT:
        return {"label": "no_cut", "chatter": False}
    return {"label": "unknown", "chatter": None}
