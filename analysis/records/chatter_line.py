"""The chatter line of a cut: known at its end, followed through the record while it drifts as the amplitude grows."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from testbed.analysis.records.lines import follow_line

PERIODS = 100.0  # of the line in a window: long enough to tell it from neighbours, short enough for its drift
SEEN = 0.15  # of its largest amplitude: below it a neighbour, hum say, may lead the search astray
FAR = 10.0  # s, how far from the steady cut a line is followed
FEWEST = 6  # windows


@dataclass(frozen=True)
class LineTrack:
    """A line through the record: time (s), frequency (Hz), amplitude (the channel's unit), (windows,) each."""

    time: np.ndarray
    frequency: np.ndarray
    amplitude: np.ndarray

    def as_json(self) -> dict[str, float | list[float]]:
        """SI values, for `--json`."""
        return {"start": float(self.time[0]), "stop": float(self.time[-1]), "first_frequency": float(self.frequency[0]),
                "last_frequency": float(self.frequency[-1]), "loudest_frequency": self.loudest[1],
                "time": self.time.tolist(), "frequency": self.frequency.tolist(),
                "amplitude": self.amplitude.tolist()}  # fmt: skip

    @property
    def loudest(self) -> tuple[float, float]:
        """(time in s, frequency in Hz) where it is loudest."""
        place = int(np.argmax(self.amplitude))
        return float(self.time[place]), float(self.frequency[place])


def chatter_track(values: np.ndarray, rate: float, line: float, middle: float, start: float = 0.0) -> LineTrack | None:
    """A line (Hz) of the cut through a record (samples,); None where it cannot be followed.

    middle: a time (s) amid the stretch that it was found in; start: time of the first sample.
    """
    window = PERIODS / line
    half, here = round(0.5 * window * rate), round((middle - start) * rate)
    after = values[max(here - half, 0) : here + round(FAR * rate)]
    before = values[max(here - round(FAR * rate), 0) : here + half][::-1]
    if min(len(after), len(before)) <= 2 * half:
        return None
    later, frequencies, sizes = follow_line(after, rate, line, window=window, start=start + max(here - half, 0) / rate)
    earlier, *backwards = follow_line(before, rate, line, window=window)
    time = np.concatenate([(start + (here + half) / rate - earlier)[:0:-1], later])
    frequency = np.concatenate([backwards[0][:0:-1], frequencies])
    amplitude = np.concatenate([backwards[1][:0:-1], sizes])
    loud, begin = amplitude > SEEN * amplitude.max(), len(earlier) - 1
    if not loud[begin]:
        return None
    first = begin - int(np.argmin(np.append(loud[begin::-1], False))) + 1
    last = begin + int(np.argmin(np.append(loud[begin:], False)))
    part = slice(first, last)
    return LineTrack(time[part], frequency[part], amplitude[part]) if last - first >= FEWEST else None
