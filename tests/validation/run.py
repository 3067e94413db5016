"""Run every check and write VALIDATION.md:  python -m tests.validation.run [name ...]"""

# ruff: noqa: E402 - the number of threads is read when numpy is imported
from __future__ import annotations

import os

for _threads in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):  # small matrices: threads of BLAS only wait for each other
    os.environ.setdefault(_threads, "1")

import importlib
import platform
import sys
import time
from importlib.metadata import version
from pathlib import Path

from tests.validation.claims import Section

CHECKS = ("published", "multipliers", "engines", "verdicts", "identification", "hammer", "effects", "absorption", "diagnosis",
          "blind.count", "paper", "score", "bit_flips", "kills", "throughput", "fuzz_readers")
TARGET = Path(__file__).resolve().parents[2] / "VALIDATION.md"
HEAD = """# Validation

Written by `make validate` (`python -m tests.validation.run`), which runs every check again. What is compared with what is in
the head of each file of tests/validation.
"""
_WORDS = {True: "passed", False: "MISSED", None: "not checked"}


def _row(cells: tuple[str, ...]) -> str:
    return "| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |"


def _table(header: tuple[str, ...], rows: list[tuple[str, ...]]) -> str:
    return "\n".join([_row(header), _row(tuple("---" for _ in header)), *map(_row, rows)])


def as_text(name: str, section: Section, seconds: float) -> str:
    """A section as Markdown."""
    rows = [(claim.what, claim.target, claim.found, _WORDS[None if claim.passed is None else bool(claim.passed)],
             claim.note) for claim in section.claims]
    parts = [f"## {section.title}", f"tests/validation/{name.replace('.', '/')}.py, {seconds:.0f} s",
             _table(("claim", "target", "found", "", "remark"), rows)]
    for title, header, lines in section.tables:
        parts += [f"**{title}**", _table(header, list(lines))]
    return "\n\n".join(parts) + "\n"


def main(names: list[str]) -> int:
    """Run the named checks (all when there is none, and only then is the file rewritten); 1 if a claim is missed."""
    texts, missed = [], 0
    for name in names or CHECKS:
        begin = time.perf_counter()
        section = importlib.import_module(f"tests.validation.{name}").check()
        missed += sum(claim.passed is not None and not claim.passed for claim in section.claims)
        texts.append(as_text(name, section, time.perf_counter() - begin))
        print(texts[-1], flush=True)
    if not names:
        packages = ", ".join(f"{package} {version(package)}" for package in ("mujoco", "numpy", "scipy", "numba"))
        tail = f"Claims missed: {missed}. Python {platform.python_version()}, {packages}.\n"
        TARGET.write_text("\n".join([HEAD, *texts, tail]))
        print(f"written to {TARGET}")
    return 1 if missed else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
