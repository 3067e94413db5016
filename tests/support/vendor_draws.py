"""What the files of measuring software hold (`vendor_files`): a hammer's force, the response and a rate, drawn."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

GRAVITY = 9.80665
RATES = (1000.0, 2048.0, 4000.0, 5000.0, 6400.0, 10000.0, 12800.0)


@dataclass
class Made:
    """A file's record for campaign.yaml (without its file), what it holds in SI (None: it must be refused), and its rate."""

    name: str
    channels: dict
    force: np.ndarray | None
    response: np.ndarray | None
    rate: float
    unit: str = "m/s^2"  # of the response as it must be told
    more: dict = field(default_factory=dict)
    told: str = ""  # what a note must hold
    rate_error: float = 1e-6
    drive: str = "force"


class Draw:
    """One draw: rate, length, force (N) and response (m/s^2), numbers as printed with nine digits."""

    def __init__(self, seed: int, folder: Path) -> None:
        self.random = np.random.default_rng([53, seed])
        self.folder, self.rate = folder, float(self.random.choice(RATES))
        self.rows = int(self.random.integers(700, 2500))
        self.time = np.arange(self.rows) / self.rate
        start, width = int(self.random.integers(20, 60)), int(self.random.integers(5, 12))
        force = np.zeros(self.rows)
        force[start : start + width] = 80 * np.sin(np.pi * np.arange(width) / width)
        since = np.maximum(self.time - start / self.rate, 0.0)
        turn = 2 * np.pi * self.rate * self.random.uniform(0.02, 0.06)
        ringing = 30 * np.exp(-0.01 * turn * since) * np.sin(turn * since)
        self.force = np.round(force + 0.05 * self.random.standard_normal(self.rows), 6)
        self.response = np.round(ringing + 0.02 * self.random.standard_normal(self.rows), 6)

    def rows_of(
        self, *columns: np.ndarray, fmt: str = "%.9g", sep: str = "\t", time: str = "%.9f", end: str = "\n", tail: str = ""
    ) -> str:
        """Lines of the time and columns."""
        return "".join(
            sep.join([time % t, *(fmt % value for value in row)]) + tail + end
            for t, *row in zip(self.time, *columns, strict=True)
        )

    def file(self, name: str, text: str | bytes, encoding: str = "utf-8") -> str:
        """Write it; the name again."""
        (self.folder / name).write_bytes(text if isinstance(text, bytes) else text.encode(encoding))
        return name

    def made(self, name: str, force: str | int = "F", response: str | int = "a", **more) -> Made:
        """The usual case: both channels by name, units from the file, numbers as drawn."""
        channels = {"force": {"column": force}, "acceleration": {"column": response}}
        return Made(name, channels, self.force, self.response, self.rate, **more)
