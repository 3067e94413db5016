"""A page under construction: headings that ask, pictures that answer, tables; written as one static HTML file.

plotly.js is put in once, and only where a picture needs it; nothing is fetched, and the page's own policy forbids it.
"""

from __future__ import annotations

import base64
import json
import mimetypes
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from html import escape
from importlib.resources import files
from pathlib import Path
from typing import Any

from testbed.system.atomic import write_text

_POLICY = "default-src 'none'; script-src 'unsafe-inline'; style-src 'unsafe-inline'; img-src data: blob:"
# first of all, so that nothing goes wrong unseen: the document itself says what failed or was refused
_WATCH = (
    "<script>function fault(text){const d=document.documentElement.dataset;d.errors=(d.errors||'')+text+' | '}"
    "addEventListener('error',(e)=>fault(e.message));"
    "document.addEventListener('securitypolicyviolation',(e)=>fault('refused: '+e.blockedURI))</script>"
)


@dataclass(frozen=True)
class Panel:
    """One state of a picture: plotly traces and layout (colours `@ink`, `@muted`, `@grid` are the theme's), and a sentence."""

    traces: Sequence[Mapping[str, Any]]
    layout: Mapping[str, Any] = field(default_factory=dict)
    says: str = ""


@dataclass(frozen=True)
class Cell:
    """A table's cell with a colour of its own: heat from 0 (calm) to 1 (worst)."""

    text: str
    heat: float


def heat_colour(heat: float) -> str:
    """From pale green over yellow to red, all light enough for dark letters."""
    stops = ((0.0, (196, 232, 208)), (0.35, (250, 238, 180)), (0.7, (247, 190, 130)), (1.0, (240, 140, 130)))
    heat = min(max(heat, 0.0), 1.0)
    for (low, first), (high, last) in zip(stops, stops[1:], strict=False):
        if heat <= high:
            share = (heat - low) / (high - low)
            return "#" + "".join(f"{round(a + share * (b - a)):02x}" for a, b in zip(first, last, strict=True))
    return "#f08c82"


@dataclass
class Page:
    """Parts of HTML in order, the pictures' data beside them."""

    title: str
    parts: list[str] = field(default_factory=list)
    pictures: list[dict[str, Any]] = field(default_factory=list)
    contents: list[str] = field(default_factory=list)

    def heading(self, text: str) -> None:
        """A section's heading: best a question."""
        self.contents.append(text)
        self.parts.append(f'<h2 id="s{len(self.contents)}">{escape(text)}</h2>')

    def text(self, text: str, small: bool = False) -> None:
        """A paragraph."""
        self.parts.append(f"<p{' class=small' if small else ''}>{escape(text)}</p>")

    def answer(self, text: str) -> None:
        """The sentence that answers the heading."""
        self.parts.append(f'<p class="answer">{escape(text)}</p>')

    def verdict(self, text: str, good: bool | None = None) -> None:
        """The whole page in one sentence; green, red or neither."""
        colour = {True: " good", False: " bad", None: ""}[good]
        self.parts.append(f'<p class="verdict{colour}">{escape(text)}</p>')

    def tiles(self, numbers: Sequence[tuple[str, str]]) -> None:
        """The few numbers to be seen first: (name, value)."""
        inside = "".join(f"<div><b>{escape(value)}</b><span>{escape(name)}</span></div>" for name, value in numbers)
        self.parts.append(f'<div class="tiles">{inside}</div>')

    def code(self, text: str) -> None:
        """Something to type."""
        self.parts.append(f"<pre>{escape(text)}</pre>")

    def table(self, titles: Sequence[str], rows: Sequence[Sequence[object]]) -> None:
        """A table with a head; it scrolls by itself on a narrow screen. A column that holds long words is set as text."""
        long = [any(_is_long(row[column]) for row in rows) for column in range(len(titles))]
        head = "".join(f"<th{' class=long' * words}>{escape(title)}</th>" for title, words in zip(titles, long, strict=True))
        body = "".join("<tr>" + "".join(map(_cell, row, long)) + "</tr>" for row in rows)
        self.parts.append(f'<div class="wide"><table><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table></div>')

    def picture(self, path: Path, says: str) -> None:
        """A picture from a file, put into the page."""
        kind = mimetypes.guess_type(path.name)[0] or "image/png"
        data = base64.b64encode(path.read_bytes()).decode()
        scrolls = " class=wide" if kind == "image/svg+xml" else ""  # legible on a phone
        self.parts.append(
            f'<figure{scrolls}><img alt="{escape(says)}" title="{escape(path.name)}" '
            f"src='data:{kind};base64,{data}'></figure>"
        )

    def figure(self, panel: Panel, describe: str = "") -> None:
        """A picture with a single state."""
        self._figure("", {"": panel}, describe)

    def choices(
        self,
        choosers: Sequence[tuple[str, Sequence[str]]],
        panels: Mapping[Any, Panel],
        layout: Mapping[str, Any] | None = None,
        describe: str = "",
    ) -> None:
        """A picture with selects: (what is chosen, the options); panels by the options' numbers. layout: shared by all."""
        controls = "".join(_select(name, options) for name, options in choosers)
        named = {"|".join(map(str, key)): panel for key, panel in panels.items()}
        self._figure(f'<div class="choose">{controls}</div>', named, describe, layout)

    def ticks(
        self,
        question: str,
        names: Sequence[str],
        ticked: Sequence[str],
        chooser: tuple[str, Sequence[str]],
        panels: Mapping[tuple[frozenset[str], int], Panel],
        missing: str,
        layout: Mapping[str, Any] | None = None,
    ) -> None:
        """A picture with boxes to tick and one select; panels by (names ticked, option). missing: said of other sets."""
        boxes = "".join(
            f'<label><input type="checkbox" value="{escape(name)}"{" checked" if name in ticked else ""}>{escape(name)}</label>'
            for name in names
        )
        controls = (
            f'<div class="choose"><span>{escape(question)}</span>{boxes}</div><div class="choose">{_select(*chooser)}</div>'
        )
        named = {f"{'+'.join(sorted(key))}|{option}": panel for (key, option), panel in panels.items()}
        self._figure(controls, named, question, layout, missing)

    def _figure(
        self,
        controls: str,
        panels: Mapping[str, Panel],
        describe: str,
        layout: Mapping[str, Any] | None = None,
        missing: str = "",
    ) -> None:
        spec: dict[str, Any] = {
            "panels": {
                key: {"traces": list(panel.traces), "layout": dict(panel.layout), "says": panel.says}
                for key, panel in panels.items()
            }
        }
        if layout:
            spec["layout"] = dict(layout)
        if missing:
            spec["missing"] = missing
        said = '<p class="outcome" data-says aria-live="polite"></p>' if any(panel.says for panel in panels.values()) else ""
        self.parts.append(
            f'<figure data-picture="{len(self.pictures)}">{controls}{said}'
            f'<div class="plot" role="img" aria-label="{escape(describe)}"></div></figure>'
        )
        self.pictures.append(spec)

    def html(self) -> str:
        """The whole page."""
        own = files("testbed.analysis.report")
        style = own.joinpath("page.css").read_text(encoding="utf-8")
        scripts = watch = ""
        if self.pictures:
            watch = _WATCH
            from plotly.offline import get_plotlyjs

            rows: dict[str, tuple[int, Any]] = {}
            pictures = _shared(self.pictures, rows)
            every = {"rows": [packed for _, packed in rows.values()], "pictures": pictures}
            data = json.dumps(every, separators=(",", ":"), allow_nan=False).replace("<", "\\u003c")
            scripts = (
                f'<script type="application/json" id="pictures">{data}</script>\n<script>{get_plotlyjs()}</script>\n'
                f"<script>{own.joinpath('page.js').read_text(encoding='utf-8')}</script>"
            )
        items = "".join(f'<li><a href="#s{place}">{escape(text)}</a></li>' for place, text in enumerate(self.contents, 1))
        lead = next((place for place, part in enumerate(self.parts) if part.startswith("<h2")), len(self.parts))
        contents = [f"<nav><ol>{items}</ol></nav>"] if len(self.contents) > 2 else []
        body = "\n".join([*self.parts[:lead], *contents, *self.parts[lead:]])
        return (
            f'<!doctype html>\n<html lang="en"><head><meta charset="utf-8"><title>{escape(self.title)}</title>'
            f'<meta name="viewport" content="width=device-width, initial-scale=1">'
            f'<meta http-equiv="Content-Security-Policy" content="{_POLICY}"><style>{style}</style>{watch}</head>\n'
            f"<body><h1>{escape(self.title)}</h1>\n{body}\n{scripts}\n</body></html>\n"
        )

    def write(self, path: Path) -> Path:
        """Write the page; returns its path."""
        write_text(path, self.html())
        return path


def _shared(value: Any, rows: dict[str, tuple[int, Any]]) -> Any:
    """The value with every packed row replaced by its number among `rows`, so that what several pictures show is
    carried once."""
    if isinstance(value, Mapping):
        if "i2" in value:
            key = f"{value['i2']} {value['scale']} {value['offset']} {'log' in value}"
            return {"packed": 1, "row": rows.setdefault(key, (len(rows), value))[0]}
        return {key: _shared(item, rows) for key, item in value.items()}
    return [_shared(item, rows) for item in value] if isinstance(value, (list, tuple)) else value


def _cell(value: object, words: bool) -> str:
    if isinstance(value, Cell):
        return f'<td class="heat" style="background:{heat_colour(value.heat)}">{escape(value.text)}</td>'
    text = escape(str(value))
    return f'<td class="long">{text}</td>' if words else f"<td>{text}</td>"


def _is_long(value: object) -> bool:
    """Whether a cell holds words that are to be broken into lines."""
    return not isinstance(value, Cell) and len(str(value)) > 36


def _select(name: str, options: Sequence[str]) -> str:
    items = "".join(f'<option value="{place}">{escape(option)}</option>' for place, option in enumerate(options))
    return f"<label>{escape(name)} <select>{items}</select></label>"
