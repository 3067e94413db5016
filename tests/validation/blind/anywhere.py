"""What the blind campaigns on machines of any workshop come to, with speeds stated wrong and structures that still ring."""

from __future__ import annotations

from tests.validation.blind.count import counted
from tests.validation.blind.judge import ELSEWHERE
from tests.validation.claims import Section

LEAST = 60  # campaigns


def check() -> Section:
    """The committed results of `make blind` on such machines, counted."""
    title = "Blind campaigns on machines of any workshop (results of `make blind`, counted)"
    return counted(title, ELSEWHERE, ELSEWHERE.with_name("anywhere.txt"), LEAST)
