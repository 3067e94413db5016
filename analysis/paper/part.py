"""What a figure or table of the paper hands to the page: pictures, tables, text, and statements with their verdict."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

# who says it: the paper; the project's reading of the paper (inferred, or a working choice where the paper says
# nothing that is known); a target that the project set itself
Source = Literal["paper", "inferred", "unknown", "target"]


@dataclass(frozen=True)
class Statement:
    """A published statement beside what was found; agrees is None where it cannot be decided, `why` says why."""

    place: str
    claim: str
    published: str
    found: str
    agrees: bool | None
    why: str = ""
    source: Source = "paper"


@dataclass(frozen=True)
class Table:
    """A table for the page: every cell is text."""

    title: str
    head: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]


@dataclass(frozen=True)
class Picture:
    """A picture: `stem` names its files; figure is a matplotlib Figure, or None where the PNG was written already."""

    stem: str
    caption: str
    figure: Any = None
    width: float = 1.0  # of the page's


@dataclass(frozen=True)
class Part:
    """One figure or table of the paper. numbers: whatever a program may want of it, SI."""

    name: str
    title: str
    text: tuple[str, ...] = ()
    pictures: tuple[Picture, ...] = ()
    tables: tuple[Table, ...] = ()
    statements: tuple[Statement, ...] = ()
    numbers: dict[str, Any] = field(default_factory=dict)


def target(place: str, claim: str, limit: str, found: str, passed: bool, why: str = "") -> Statement:
    """A target of this project's own rather than a statement of the paper."""
    return Statement(place, claim, limit, found, bool(passed), why, "target")


def as_dict(part: Part) -> dict[str, Any]:
    """A part without its figures, for JSON."""
    return {"name": part.name, "title": part.title, "text": list(part.text),
            "pictures": [{"stem": one.stem, "caption": one.caption, "width": one.width} for one in part.pictures],
            "tables": [{"title": one.title, "head": list(one.head), "rows": [list(row) for row in one.rows]}
                       for one in part.tables],
            "statements": [vars(one) for one in part.statements], "numbers": part.numbers}


def from_dict(kept: dict[str, Any]) -> Part:
    """The part that `as_dict` wrote; its pictures are those on the disk."""
    return Part(kept["name"], kept["title"], tuple(kept["text"]),
                tuple(Picture(one["stem"], one["caption"], None, one["width"]) for one in kept["pictures"]),
                tuple(Table(one["title"], tuple(one["head"]), tuple(map(tuple, one["rows"]))) for one in kept["tables"]),
                tuple(Statement(**one) for one in kept["statements"]), kept["numbers"])


def picture_files(folder: Path, picture: Picture) -> list[Path]:
    """The files of a picture that there are: PNG always, SVG of diagrams."""
    return [path for ending in (".png", ".svg") if (path := folder / f"{picture.stem}{ending}").is_file()]
