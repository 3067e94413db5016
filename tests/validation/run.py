"""Run every check, or those named, and write VALIDATION.md:  python -m tests.validation.run [name ... | page]"""

# ruff: noqa: E402 - the number of threads is read when numpy is imported
from __future__ import annotations

import os

for _threads in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):  # small matrices: threads of BLAS only wait for each other
    os.environ.setdefault(_threads, "1")

import importlib
import platform
import sys
import time
from collections.abc import Sequence
from importlib.metadata import version
from importlib.util import find_spec
from pathlib import Path

from tests.validation import first_page
from tests.validation.claims import Section

CHECKS = ("published", "multipliers", "engines", "verdicts", "identification", "hammer", "nuisances", "effects", "absorption",
          "hardware", "diagnosis", "hard_pairs", "decoys", "blind.count", "blind.anywhere", "blind.faint", "blind.propose",
          "outside.agreement", "outside.count", "paper", "score", "bit_flips", "kills", "throughput", "fuzz_readers",
          "vendor_files", "ring_downs", "chatter", "planar_chatter", "charts", "planar_charts", "planar_verdicts",
          "planar_fits", "blind.plane", "blind.plane_propose", "own_scale", "misstated", "spoiled", "taps", "judged",
          "probable", "planned", "replay", "long_drift")
PAGE = "page"
TARGET = Path(__file__).resolve().parents[2] / "VALIDATION.md"
_WORDS = {True: "passed", False: "MISSED", None: "-"}


def _row(cells: tuple[str, ...]) -> str:
    return "| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |"


def _table(header: tuple[str, ...], rows: list[tuple[str, ...]]) -> str:
    return "\n".join([_row(header), _row(tuple("---" for _ in header)), *map(_row, rows)])


def as_text(name: str, section: Section, seconds: float) -> str:
    """A section as Markdown."""
    rows = [(claim.what, claim.target, claim.found, _WORDS[None if claim.passed is None else bool(claim.passed)],
             claim.note) for claim in section.claims]
    parts = [f"## {section.title}", f"tests/validation/{name.replace('.', '/')}.py, {seconds:.0f} s",
             *([section.remark] if section.remark else []), _table(("claim", "target", "found", "", "remark"), rows)]
    for title, header, lines in section.tables:
        parts += [f"**{title}**", _table(header, list(lines))]
    return "\n\n".join(parts) + "\n"


def _merged(old: str, texts: Sequence[str]) -> list[str]:
    """The file's sections with those that were run again in their place; new ones at the end."""
    kept = {part.split("\n", 1)[0]: part for part in ("## " + part for part in old.split("\n## ")[1:])}
    for heading in first_page.headings():
        kept.pop(heading, None)
    for text in texts:
        kept[text.split("\n", 1)[0]] = text
    return [part.rstrip() + "\n" for part in kept.values()]


def _versions() -> str:
    packages = ", ".join(f"{package} {version(package)}" for package in ("mujoco", "numpy", "scipy", "numba"))
    return f"Python {platform.python_version()}, {packages}."


def main(names: list[str]) -> int:
    """Run the named checks, or all, and put them into the file; 1 if a claim is missed, 2 for no check. PAGE: no check."""
    if names == [PAGE]:
        TARGET.write_text(whole(TARGET.read_text()))
        return 0
    if unknown := [name for name in names if find_spec(f"tests.validation.{name}") is None]:
        print(f"error: {unknown[0]}: no such check: one of {PAGE}, {', '.join(CHECKS)}", file=sys.stderr)
        return 2
    missed = 0
    for name in names or CHECKS:
        begin = time.perf_counter()
        section = importlib.import_module(f"tests.validation.{name}").check()
        missed += sum(claim.passed is not None and not claim.passed for claim in section.claims)
        text = as_text(name, section, time.perf_counter() - begin)
        print(text, flush=True)
        _write(text)  # at once: a long run that is stopped keeps what it found
    print(f"written to {TARGET}")
    return 1 if missed else 0


def whole(old: str, texts: Sequence[str] = ()) -> str:
    """The file with these sections put into it, and its first page as they say; without any, with the versions that it had."""
    sections = _merged(old, texts)
    versions = _versions() if texts else first_page.versions_in(old)
    return "\n".join([first_page.page(sections, CHECKS, versions), *sections])


def _write(text: str) -> None:
    TARGET.write_text(whole(TARGET.read_text() if TARGET.exists() else "", [text]))


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
