"""What the campaigns of the outside simulator come to, judged by the commands `diagnose`, `add` and `compare`."""

from __future__ import annotations

from tests.validation.blind.count import counted
from tests.validation.claims import Section
from tests.validation.outside.judge import RESULTS

LEAST = 40  # campaigns


def check() -> Section:
    """The committed results of `make blind` on them, counted."""
    return counted("Campaigns of an outside simulator, by the command line (results of `make blind`, counted)", RESULTS,
                   RESULTS.with_name("remark.txt"), LEAST)  # fmt: skip
