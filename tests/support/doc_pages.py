"""The pages of docs/ as tests read them: tables under their headings, blocks of code, and the key paths of a JSON answer."""

import re
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).parents[2]


@dataclass(frozen=True)
class Table:
    """A table of a page: the titles of its columns, and its rows of cells."""

    titles: list
    rows: list

    def column(self, title):
        """The cells under a title."""
        return [row[self.titles.index(title)] for row in self.rows]

    def keys(self):
        """What stands in backticks in the first cells."""
        return [key for row in self.rows for key in codes(row[0])]


def read(name):
    """The text of a page of docs/."""
    return (ROOT / "docs" / name).read_text(encoding="utf-8")


def codes(cell):
    """What stands in backticks in a piece of text."""
    return re.findall(r"`([^`]*)`", cell)


def blocks(text, language):
    """Blocks of code in a language."""
    return re.findall(rf"^```{language}\n(.*?)^```", text, re.MULTILINE | re.DOTALL)


def examples(text, kind):
    """The examples of a kind of file (`model`, `campaign`, `scenario`): blocks whose first line names it."""
    return [block for block in blocks(text, "yaml") if block.startswith(f"# {kind}.yaml")]


def tables(text):
    """The tables of a page by the heading above them, without its backticks."""
    found, heading, lines = {}, "", []
    for line in [*re.sub(r"^```.*?^```", "", text, flags=re.MULTILINE | re.DOTALL).splitlines(), "# end"]:
        if line.startswith("|"):
            lines.append([cell.strip() for cell in line.strip().strip("|").split("|")])
            continue
        if lines:
            assert heading not in found, f"two tables under '{heading}'"
            assert len({len(cells) for cells in lines}) == 1, f"a row of '{heading}' has more or fewer cells than its titles"
            found[heading], lines = Table(lines[0], lines[2:]), []
        if line.startswith("#"):
            heading = line.lstrip("# ").replace("`", "")
    return found


# -- paths of keys: tuples of names and "[]", those of a page with a word in capitals for any name --------------------------


def key_paths(value, path=()):
    """(paths of all values, paths of empty lists, empty mappings and nulls) of a JSON value; a list of numbers is a value."""
    if isinstance(value, dict) and value:
        parts = [key_paths(item, (*path, key)) for key, item in value.items()]
    elif isinstance(value, list) and any(isinstance(item, (dict, list)) for item in value):
        parts = [key_paths(item, (*path, "[]")) for item in value]
    else:
        return {_bare(path)}, {_bare(path)} if value in ({}, [], None) else set()
    return set().union(*(full for full, _ in parts)), set().union(*(hollow for _, hollow in parts))


def _bare(path):
    """A path without the brackets at its end: whether a key holds one value or a list of them is said by its words."""
    while path and path[-1] == "[]":
        path = path[:-1]
    return path


def named_paths(table):
    """The paths in a table's first cells. A key that begins with a dot continues the one before it; `...` is any path on."""
    found = []
    for row in table.rows:
        before = ()
        for code in codes(row[0]):
            parts = [part for name in code.removesuffix("...").strip(".").split(".") for part in _split(name)]
            before = (*before[:-1], *parts) if code.startswith(".") else tuple(parts)
            if not code.endswith("..."):
                before = _bare(before)
            found.append((*before, "...") if code.endswith("...") else before)
    return found


def _split(name):
    return [name.split("[")[0], *["[]"] * name.count("[]")]


def matches(named, path):
    """Whether a path of a page is that of a value."""
    if named[-1] == "...":
        named, path = named[:-1], path[: len(named) - 1]
    return len(named) == len(path) and all(one == other or (one.isupper() and other != "[]")
                                           for one, other in zip(named, path, strict=True))


def missing(named, answers):
    """Paths that answers have and a page does not name."""
    lacking = set()
    for answer in answers:
        full, hollow = key_paths(answer)
        for path in full:
            whole = any(matches(one, path) for one in named)
            begins = path in hollow and any(matches(one[: len(path)], path) for one in named)
            if not (whole or begins):
                lacking.add(".".join(path))
    return sorted(lacking)


def unheard(named, answers):
    """Paths that a page names and no answer has."""
    full = set().union(*(key_paths(answer)[0] for answer in answers))
    return sorted(".".join(one) for one in named if not any(matches(one, path) for path in full))
