"""Where the numbers of a channel come from, and what they mean."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from testbed.machine import Carrier
from testbed.recording import CHANNEL_UNITS


@dataclass(frozen=True)
class Source:
    """Where a channel comes from: column (name or number from 1), unit as text (None: the file's), scale (unit per
    raw value), for a tachometer its pulses and edge; file and key: where the channel is not in the record's own file.
    on: what its sensor sits on."""

    column: str | int
    unit: str | None = None
    scale: float = 1.0
    pulses_per_revolution: int = 1
    edge: Literal["rising", "falling"] = "rising"
    file: str | None = None
    key: str | None = None
    on: Carrier = "workpiece"


def base_name(channel: str) -> str:
    """`displacement_2` -> `displacement`: further responses carry a number."""
    head, _, tail = channel.rpartition("_")
    return head if head in CHANNEL_UNITS and tail.isdigit() else channel
