"""The first page of VALIDATION.md: what is promised, found and missed, made from the sections behind it.

The sentences stand in first_page.md; the numbers are read from the sections, so that none is written twice.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

TEMPLATE = Path(__file__).with_suffix(".md")
CLAIMS = "| claim | target | found |  | remark |"


class Claimed(NamedTuple):
    """A line of a section's table of claims, its cells as they stand in the Markdown."""

    what: str
    target: str
    found: str
    word: str


# the claim that stands for a section, where that is not its first
HEADLINES = {
    "Identification from three stable cuts (made by MuJoCo, fitted by temporal elements)":
        "zeta: rms error at 0.5 um, 100 seeds",
    "Diagnosis: real hardware": "milling_force: held-out error after the named effects",
    "Diagnosis: free decays alone, garbage": "campaigns of garbage in which an effect is named missing",
    "Blind campaigns (results of `make blind`, counted)": "one hidden effect worth more than 3 %: named right",
    "Blind campaigns on machines of any workshop (results of `make blind`, counted)":
        "one hidden effect worth more than 3 %: named right",
    "Campaigns of an outside simulator, by the command line (results of `make blind`, counted)":
        "one hidden effect worth more than 3 %: named right",
    "Effects of no catalogue, proposed and added (results of `make blind`, counted)":
        "after adding it: held-out error beyond the noise, where there is any (above 1.02 floors), below half",
    "Weak effects: hardly visible above the noise (results of `make blind`, counted)":
        "certain (gain in BIC above 100 over the best rival): named right",
    "Nuisances of measured campaigns (6 campaigns of 3 cuts, made by MuJoCo)": "base parameters inside their 95 % intervals",
    "Sweeps, simulated and stored": "transients simulated and stored, none, 100000 runs, 2 processors' time",
    "Mann and Young (2006), reproduced": "published statements that agree; for the others there is a reason",
    "Identification under noise, three methods on the same sealed cuts": "waveform: 95 % intervals that hold the truth",
    "Charts of ordinary cutters": "cells called stable that are not",
    "Charts of machines in x and y": "cells called stable that are not",
    "Blind campaigns of machines in x and y": "one hidden effect worth more than 3 %: named right",
    "The tap test": "random machines: least limit of a cut",
}
# sections that were written by hand, without a table of claims: claim, target, found
BY_HAND = {
    "Memory against the length and the number of records (51.2 kHz, one channel and a tachometer, HDF5)":
        Claimed("`compare` of ten records of 60 s: largest memory", "4 GB", "not measured (3.97 GB for 330 s)", "-"),
    "Hostile, wrong and damaged files":
        Claimed("command lines answered by one line and exit code 2, nothing left behind", "all", "636 of 650", "-"),
    "Long records whose sensor drifts":
        Claimed("a right model, drift of 3 um that turns in 9 s: what is left is noise", "all", "8 of 8", "-"),
}  # fmt: skip


def page(sections: Sequence[str], checks: Sequence[str], versions: str) -> str:
    """The first page of these sections (Markdown, each from its heading on); checks: the names of all that can be run."""
    missed = [(_link(_title(one)), *claim[:3]) for one in sections for claim in claims(one) if claim.word == "MISSED"]
    text = "\n".join(sections)
    unrun = ", ".join(f"`{name}`" for name in checks if _file(name) not in text and f"run {name}`" not in text)
    missed_table = _table(("section", "claim", "target", "found"), missed) if missed else ""
    return TEMPLATE.read_text().format(
        found=_table(("section", "claim", "target", "found", "claims held", "command"), [_line(one) for one in sections]),
        missed=f"Claims missed: {len(missed)}. {versions}\n\n{missed_table}".rstrip(), unrun=unrun or "none")


def headings() -> tuple[str, ...]:
    """The page's own headings, which are no sections."""
    return tuple(line for line in TEMPLATE.read_text().splitlines() if line.startswith("## "))


def versions_in(text: str) -> str:
    """The versions that a file written earlier says its numbers are from."""
    found = re.search(r"^Claims missed: \d+\. (.*)$", text, re.MULTILINE)
    return found[1] if found else ""


def claims(section: str) -> list[Claimed]:
    """The lines of a section's table of claims; none where it has no such table."""
    _, found, rest = section.partition(CLAIMS + "\n")
    rows = rest.split("\n\n")[0].splitlines()[1:] if found else []
    return [Claimed(*_cells(row)[:4]) for row in rows]


def _line(section: str) -> tuple[str, ...]:
    title, told = _title(section), claims(section)
    first = BY_HAND.get(title) or _headline(title, told)
    judged = [one.word == "passed" for one in told if one.word in ("passed", "MISSED")]
    held = f"{sum(judged)} of {len(judged)}" if judged else "not judged"
    return _link(title), *first[:3], held, _command(section)


def _headline(title: str, told: Sequence[Claimed]) -> Claimed:
    by_name: Mapping[str, Claimed] = {one.what: one for one in told}
    return by_name.get(HEADLINES.get(title, ""), told[0] if told else Claimed("", "", "", "-"))


def _command(section: str) -> str:
    """How a section is made: the name of its check, or the command that its text gives."""
    if found := re.search(r"tests/validation/([\w/]+)\.py", section):
        return f"`{found[1].replace('/', '.')}`"
    found = re.search(r"`python -m tests\.validation\.run (\w+)`|`(python -m tests\.validation\.[^`]+)`", section)
    return f"`{found[1] or found[2]}`" if found else ""


def _file(check: str) -> str:
    return f"tests/validation/{check.replace('.', '/')}.py"


def _title(section: str) -> str:
    return section.split("\n", 1)[0].removeprefix("## ")


def _link(title: str) -> str:
    """A link to a section, by the anchor that GitHub gives its heading; what is in brackets is left out of the words."""
    anchor = re.sub(r"[^\w\- ]", "", title.lower()).replace(" ", "-")
    return f"[{re.sub(r' [(].*[)]', '', title) if '(2006)' not in title else title}](#{anchor})"


def _cells(row: str) -> list[str]:
    return [cell.strip() for cell in row.removeprefix("| ").removesuffix(" |").split(" | ")]


def _table(header: tuple[str, ...], rows: Sequence[tuple[str, ...]]) -> str:
    """Rows of cells that are Markdown already."""
    return "\n".join("| " + " | ".join(cells) + " |" for cells in (header, ("---",) * len(header), *rows))
