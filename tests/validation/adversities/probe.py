"""What the probes of files have in common: an adversity, sound texts to begin with, and a campaign of one file."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from tests.validation.adversities.runner import REFUSED

MODEL = """structure: {mass: 2.573 kg, natural_frequency: 147.5 Hz, damping_ratio: 0.005}
cutter: {flutes: 1, diameter: 19.05 mm, helix_angle: 0 deg}
cutting: {direction: up-milling, immersion: 0.162, tangential_coefficient: 600 N/mm^2, normal_coefficient: 180 N/mm^2}
"""
SCENARIO = """name: small
seed: 1
model:
  structure: {mass: 2.573 kg, natural_frequency: 147 Hz, damping_ratio: 0.005}
  cutter: {flutes: 1, diameter: 19.05 mm, helix_angle: 0 deg}
  cutting: {direction: up-milling, immersion: 0.162, tangential_coefficient: 550 N/mm^2, normal_coefficient: 200 N/mm^2}
cut: {feed: 0.1 mm/tooth, idle: 5 rev, cutting: 40 rev, ring_down: 40 rev}
tests:
  - {spindle_speed: 3810 rpm, depth_of_cut: 2 mm}
  - {spindle_speed: 2850 rpm, depth_of_cut: 1 mm}
sensors:
  sampling_rate: 12800 Hz
  displacement: {noise: 0.5 um, bits: 16, range: 1 mm}
"""
CAMPAIGN = """name: rig
sampling_rate: 12800 Hz
channels: {displacement: {column: disp, unit: um}}
records:
  - {file: FILE, kind: cut, spindle_speed: 3810 rpm, depth_of_cut: 2 mm, feed: 0.1 mm/tooth}
"""
DEEP = 5000  # of what is nested, and characters of a long name
TABLE = "disp\n" + "".join(f"{value:.3f}\n" for value in 20 * np.sin(np.arange(3000) / 14))
Make = Callable[[Path], Sequence[object]]


@dataclass(frozen=True)
class Probe:
    """An adversity. make: writes what it needs into a folder and gives the command line; codes: those that are an answer."""

    kind: str
    name: str
    make: Make
    codes: Sequence[int] = REFUSED


def campaign(folder: Path, file: str = "cut.csv", more: str = "", command: str = "inspect") -> Sequence[object]:
    """The command line for a campaign of one file, which is written."""
    (folder / "campaign.yaml").write_text(more + "\n" + CAMPAIGN.replace("FILE", file))
    return (command, "campaign.yaml") if command == "inspect" else (command, "campaign.yaml", "-m", "model.yaml")
