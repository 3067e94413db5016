"""Times written as dates and times of day: `2020-01-31 10:15:30.125`, `10:15:30,125`, `1:05:07 PM`, `05:07.1`."""

from __future__ import annotations

import re
from array import array
from collections.abc import Iterable

import numpy as np

_DATE = r"(?P<date>\d{4}[-/.]\d{1,2}[-/.]\d{1,2}|\d{1,2}[-/.]\d{1,2}[-/.]\d{2,4})"
_CLOCK = re.compile(
    rf"(?:{_DATE}[T ]\s*)?(?:(?P<hour>\d{{1,2}}):(?P<minute>\d\d):(?P<second>\d\d(?:[.,]\d+)?)"
    r"|(?P<minutes>\d{1,3}):(?P<rest>\d\d[.,]\d+))\s*(?P<half>[AaPp]\.?[Mm]\.?)?"
    r"\s*(?:Z|UTC|[+-]\d\d:?\d\d)?"
)
_DAY = 86400.0


def is_clock(text: str) -> bool:
    """Whether a field is a time of day, with or without a date before it."""
    return _CLOCK.fullmatch(text.strip()) is not None


def seconds(fields: Iterable[str]) -> np.ndarray | None:
    """Seconds since the first of the fields, shape (rows,); None where one of them is no time of day.

    A date that changes, or a time that falls by more than half a day, is the next day's.
    """
    found, days, before = array("d"), 0, ("", 0.0)
    for field in fields:
        match = _CLOCK.fullmatch(field.strip())
        if match is None:
            return None
        hour = int(match["hour"] or 0)
        if match["half"]:
            hour = hour % 12 + 12 * (match["half"][0] in "Pp")
        second = float((match["second"] or match["rest"]).replace(",", "."))
        moment = 3600.0 * hour + 60.0 * int(match["minute"] or match["minutes"]) + second
        date = match["date"] or ""
        if found and (date != before[0] if date else moment < before[1] - 0.5 * _DAY):
            days += 1
        before = (date, moment)
        found.append(days * _DAY + moment)
    return np.round(np.array(found) - found[0], 9)
