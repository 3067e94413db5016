"""The page that `testbed demo` ends with: tables and pictures, one HTML file beside them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from html import escape
from pathlib import Path

from testbed.atomic import write_text

_STYLE = """body{font:16px/1.5 system-ui,sans-serif;max-width:60rem;margin:2rem auto;padding:0 1rem;color:#222}
img{max-width:100%;height:auto}table{border-collapse:collapse;margin:1rem 0}th,td{padding:.25rem .75rem;text-align:right;
border-bottom:1px solid #ddd}th:first-child,td:first-child{text-align:left}h2{margin-top:2.5rem}"""


@dataclass
class Page:
    """A page under construction: parts of HTML, in order."""

    title: str
    parts: list[str] = field(default_factory=list)

    def heading(self, text: str) -> None:
        """A section's heading."""
        self.parts.append(f"<h2>{escape(text)}</h2>")

    def text(self, text: str) -> None:
        """A paragraph."""
        self.parts.append(f"<p>{escape(text)}</p>")

    def table(self, titles: Sequence[str], rows: Sequence[Sequence[object]]) -> None:
        """A table with a head."""
        head = "".join(f"<th>{escape(title)}</th>" for title in titles)
        body = "".join("<tr>" + "".join(f"<td>{escape(str(cell))}</td>" for cell in row) + "</tr>" for row in rows)
        self.parts.append(f"<table><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>")

    def picture(self, path: Path, says: str) -> None:
        """A picture that stands beside the page."""
        self.parts.append(f'<img src="{escape(path.name)}" alt="{escape(says)}">')

    def write(self, path: Path) -> Path:
        """Write the page; returns its path."""
        body = "\n".join(self.parts)
        write_text(path, f'<!doctype html>\n<html lang="en"><head><meta charset="utf-8"><title>{escape(self.title)}'
                         f"</title><style>{_STYLE}</style></head>\n<body><h1>{escape(self.title)}</h1>\n{body}\n"
                         "</body></html>\n")
        return path
