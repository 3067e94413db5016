"""The milling rig with a uni-directional flexure (flexure.xml; values and sources in parameters.yaml)."""

from __future__ import annotations

from testbed import models
from testbed.machine import Structure


def structure() -> Structure:
    """The mode along the feed, read from the compiled MuJoCo model: 2.573 kg, 146.4 Hz, damping ratio 0.0032."""
    return models.machine("flexure").structure()
