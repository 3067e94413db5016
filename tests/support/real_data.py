"""Where the real measurements are: beside the repository, or where TESTBED_MEASUREMENTS says."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

MANIFESTS = Path(__file__).resolve().parents[1] / "manifests"
MEASUREMENTS = Path(
    os.environ.get("TESTBED_MEASUREMENTS", Path(__file__).resolve().parents[3] / "shared" / "measurements")
)


def needs(folder: str) -> pytest.MarkDecorator:
    """Skips a test where a set of measurements is absent."""
    there = (MEASUREMENTS / folder).is_dir()
    return pytest.mark.skipif(not there, reason=f"the real measurements '{folder}' are not in {MEASUREMENTS}")
