"""Units as measuring software writes them beside the samples: `Newtons`, `g's`, `m/s2`, `[ms^-2]`, `KHZ`, `mV/V`.

Wider than the table of `testbed.units`, which holds for what a user writes: here a misread unit is looked for among those
of the channel's own dimension only, and what is no unit of samples (a sensitivity, a level in dB) is told apart.
"""

from __future__ import annotations

import re
import unicodedata
from functools import lru_cache

from testbed.units import TABLE, Unit, UnitProblem, known_units, nearest, spelled, unit_named

UNCALIBRATED = ("counts", "count", "fs", "a.u.", "au", "arbitrary", "arb", "arb.", "arbitrary units", "adc", "lsb", "digits",
                "raw", "bits", "cts", "eu", "none", "n/a", "unitless", "dimensionless", "%fs", "amps", "strain",
                "ohms")  # fmt: skip
# A transducer's own output: no motion and no force until its calibration is known.
_RAW_OUTPUT = ("mV/V", "V/V", "A", "mA", "uA", "nC", "pC", "ohm", "ue", "um/m")
_MEASURED = ("m", "m/s", "m/s^2", "N", "rad", "rad/s", "s", "Hz", "V", "1")  # dimensions that a channel of a record has
_WORDS = {
    "m": "m meter meters metre metres", "mm": "mm millimeter millimeters millimetre millimetres",
    "um": "um micron microns micrometer micrometers micrometre micrometres", "nm": "nanometer nanometers nanometre nanometres",
    "cm": "centimeter centimeters centimetre centimetres", "in": "inch inches in.", "ft": "foot feet ft.",
    "mil": "mil mils thou", "s": "s sec secs second seconds sec. sek sekunden",
    "ms": "ms msec msecs millisec millisecond milliseconds",
    "us": "us usec usecs microsec microsecond microseconds", "min": "minute minutes mins", "h": "hr hrs hour hours",
    "N": "newton newtons", "kN": "kilonewton kilonewtons", "lbf": "lb lbs pound pounds lb_f lb-f pound-force lb.",
    "kgf": "kp kilopond", "V": "volt volts", "mV": "millivolt millivolts", "uV": "microvolt microvolts",
    "g": "g's gs gee gees g-force gravity g_n gn g0", "mg": "milli-g millig", "rad": "rad radian radians rads",
    "deg": "deg degree degrees degs", "mrad": "milliradian milliradians", "Hz": "hz hertz cps", "kHz": "khz kilohertz",
    "%": "percent pct",
    "rpm": "rpm r.p.m. r/min rev/min u/min 1/min min^-1 min-1 tr/min revs/min turns/min rev./min", "m/s": "mps", "in/s": "ips",
    "m/s^2": "mps2 mps^2 mpss", "cm/s^2": "gal gals", "rev": "revs turn turns",
}  # fmt: skip
_KNOWN = {word: unit for unit, words in _WORDS.items() for word in words.split()}
_SYMBOLS = {unit for si in _MEASURED for unit in TABLE[si]}
# written in capitals or small letters alone; MN may be a mega- or a millinewton, NM a torque
_FOLDED = {unit.casefold(): unit for unit in sorted(_SYMBOLS) if unit not in ("mN", "nm")}
_SENSITIVITY = re.compile(r"(?:[mu]?V|[np]?C|m?A|counts?|LSB)/(?!V$|m?in$|h$)\(?(.+?)\)?", re.IGNORECASE)
_POWER = re.compile(r"(.*?)\s*\^?(\d)")


def channel_unit(text: str, wanted: str | None = None) -> Unit:
    """The unit of a measured channel, in whatever spelling, or uncalibrated: counts, full scale, a bridge's mV/V.

    wanted: SI unit of the channel, in which a likely meaning is looked for. Raises UnitProblem.
    """
    known = _recognised(text)
    if known is not None:
        return unit_named(known)
    sensitivity = _SENSITIVITY.fullmatch(spelled(text.strip("[]() ")))
    if sensitivity:
        raise UnitProblem(
            f"'{text}' is a sensor's sensitivity, no unit of its samples",
            f"give `unit: V` for volts as they are, or `unit: {sensitivity[1]}` with `scale`, {sensitivity[1]} per value",
        )
    if re.match(r"db\b", text.strip("[]() ").lower()):
        raise UnitProblem(f"'{text}' is a level, no unit of samples", "export the samples on a linear scale")
    if wanted not in TABLE or wanted == "1":
        return unit_named(text)
    units = known_units(wanted)
    close = nearest(spelled(text), units)
    hint = f"did you mean {close}? " if close else ""
    raise UnitProblem(
        f"unknown unit '{text}'", f"{hint}known here are {', '.join(units)}, and V, counts or a.u. for an uncalibrated channel"
    )


def is_channel_unit(text: str) -> bool:
    """Whether a text names a unit of samples; a bare number or an empty text does not."""
    return bool(text.strip()) and not text.strip().isdigit() and _recognised(text) is not None


def unit_suffix(name: str, wanted: str) -> str:
    """The unit that a column's name ends with (`acc_g`, `vel_mm_s`), of the wanted dimension or in volts; "" without.

    `in` and `min` are passed over: as endings they are the input and the smallest value.
    """
    parts = name.strip().split("_")
    for first in range(1, len(parts)):
        for text in ("_".join(parts[first:]), "/".join(parts[first:])):
            unit = None if text in ("in", "min") or text.isdigit() else _recognised(text)
            if unit is not None and unit_named(unit).si in (wanted, "V"):
                return text
    return ""


@lru_cache(maxsize=1024)
def _recognised(text: str) -> str | None:
    """The table's spelling of a unit, or None."""
    bare = unicodedata.normalize("NFKC", text).replace("−", "-").strip()
    bare = bare.strip('[]{}<>"') if not re.fullmatch(r"\(.*\)", bare) else bare[1:-1]
    bare = " ".join(bare.split())
    lower = bare.casefold()
    if lower in UNCALIBRATED or spelled(bare) in _RAW_OUTPUT:
        return "1"
    for form in (bare, _composed(bare)):
        unit = spelled(form)
        if unit in _SYMBOLS:
            return unit
        if unit.casefold() in _KNOWN:
            return _KNOWN[unit.casefold()]
    unit = spelled(_composed(bare))
    if unit in (unit.upper(), unit.lower()) and unit.casefold() in _FOLDED:
        return _FOLDED[unit.casefold()]
    return unit if any(unit in units for units in TABLE.values()) else None


def _composed(text: str) -> str:
    """A product of words and powers as one quotient: `meters per second squared`, `m s^-2` and `m/sec/sec` are `m/s^2`."""
    unit = re.sub(r"\s*\bper\b\s*", "/", text, flags=re.IGNORECASE)
    unit = re.sub(r"\s*\b(?:squared|square|sq)\b\.?\s*", "^2", unit, flags=re.IGNORECASE)
    product = re.fullmatch(r"([A-Za-zµμ]+?)\s*[.*·]?\s*s(?:ec)?\s*\^?\(?-([12])\)?", unit)
    if product:
        unit = f"{product[1]}/s^{product[2]}"
    top, *below = (part.strip() for part in unit.split("/"))
    if not below or not top:
        return unit
    powers: dict[str, int] = {}
    for part in below:
        match = _POWER.fullmatch(part)
        word, power = (match[1].strip(), int(match[2])) if match else (part, 1)
        word = _word(word)
        powers[word] = powers.get(word, 0) + power
    return f"{_word(top)}/" + " ".join(f"{word}^{power}" if power > 1 else word for word, power in powers.items())


def _word(text: str) -> str:
    return _KNOWN.get(spelled(text).casefold(), spelled(text)) if text not in _SYMBOLS else text
