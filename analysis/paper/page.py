"""The page of `testbed paper`: one table of all statements, then the figures and tables, static, readable on a phone."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape
from pathlib import Path

from testbed.analysis.paper.part import Part, Picture, Statement, Table, picture_files
from testbed.system.atomic import write_text

TITLE = "Mann and Young (2006), reproduced"
_STYLE = """body{font:16px/1.55 system-ui,sans-serif;max-width:62rem;margin:1.5rem auto;padding:0 1rem;color:#1c1c1c;
background:#fff}h1{font-size:1.6rem}h2{margin-top:2.5rem;font-size:1.25rem;border-top:1px solid #ddd;padding-top:1rem}
figure{margin:1rem 0}img{width:100%;height:auto}figcaption,.small{font-size:.875rem;color:#444}
.pair{display:flex;flex-wrap:wrap;gap:1rem}.pair figure{flex:1 1 18rem;margin:0}
.scroll{overflow-x:auto;-webkit-overflow-scrolling:touch}table{border-collapse:collapse;margin:.75rem 0;font-size:.875rem}
caption{text-align:left;font-weight:600;padding:.25rem 0}th,td{padding:.3rem .6rem;text-align:left;vertical-align:top;
border-bottom:1px solid #ddd}th{white-space:nowrap}.num td{white-space:nowrap}.yes{color:#1d6b3f}.no{color:#a32620;
font-weight:600}.open{color:#555}
@media(max-width:40rem){.claims thead{display:none}.claims tr{display:block;border-bottom:2px solid #ccc;padding:.5rem 0}
.claims td{display:block;border:0;padding:.1rem 0}.claims td::before{content:attr(data-head) ": ";color:#666}
.claims td:empty{display:none}}"""
SOURCES = {"paper": "paper", "inferred": "inferred", "unknown": "unknown", "target": "this project"}
_HEADS = ("place", "claim", "published", "found", "agrees", "why", "who says it")
INFERRED = (
    "The text of the paper is not at hand here: its equations were read from the sister papers (Bayly et al. 2003; Mann et al. "
    "2004, 2005; Insperger and Stepan 2002) and checked numerically. A statement marked 'paper' is certain; 'inferred' means "
    "a reading with a reason; 'this project' a target of its own.",
    "Inferred: the parameters of the delayed Mathieu equation (kappa 0.2, eps 1, b -0.2, delta -0.3 to 5); the radial "
    "immersion 0.162, the only range that reproduces all published outcomes being 0.155-0.187; Gamma2 = 0.3 Gamma1, which "
    "multipliers cannot tell; a section of x(t) against x(t - tau).",
    "Unknown, a working choice here: how the tool entered and left (a step to full engagement, an abrupt stop); the paper's "
    "own testing conditions of tables 1 and 2; its further tests in figure 6; damping of its converged estimates; its noise "
    "(0.5 µm here).",
)


def _statements(parts: Sequence[Part]) -> str:
    head = "".join(f"<th>{name}</th>" for name in _HEADS)
    rows = "".join(_statement(one) for part in parts for one in part.statements)
    return f'<table class="claims"><thead><tr>{head}</tr></thead><tbody>{rows}</tbody></table>'


def _statement(one: Statement) -> str:
    word, kind = {True: ("yes", "yes"), False: ("no", "no"), None: ("-", "open")}[one.agrees]
    cells = (one.place, one.claim, one.published, one.found, word, one.why, SOURCES[one.source])
    return "<tr>" + "".join(f'<td data-head="{head}"{f" class={kind!r}" if head == "agrees" else ""}>{escape(cell)}</td>'
                            for head, cell in zip(_HEADS, cells, strict=True)) + "</tr>"


def _table(one: Table) -> str:
    head = "".join(f"<th>{escape(name)}</th>" for name in one.head)
    rows = "".join("<tr>" + "".join(f"<td>{escape(cell)}</td>" for cell in row) + "</tr>" for row in one.rows)
    return (f'<div class="scroll"><table class="num"><caption>{escape(one.title)}</caption><thead><tr>{head}</tr></thead>'
            f"<tbody>{rows}</tbody></table></div>")


def _picture(folder: Path, one: Picture) -> str:
    files = picture_files(folder, one)
    if not files:
        return ""
    drawing = escape(files[-1].name)  # a vector one, where there is one: small type can be enlarged, alone too
    return (f'<figure><a href="{drawing}"><img src="{drawing}" loading="lazy" '
            f'alt="{escape(one.caption)}"></a><figcaption>{escape(one.caption)}</figcaption></figure>')


def _part(folder: Path, part: Part) -> str:
    pictures = "".join(_picture(folder, one) for one in part.pictures)
    if len(part.pictures) > 1:
        pictures = f'<div class="pair">{pictures}</div>'
    return (f'<h2 id="{part.name}">{escape(part.title)}</h2>' + "".join(f"<p>{escape(said)}</p>" for said in part.text)
            + pictures + "".join(map(_table, part.tables)))


def count(parts: Sequence[Part]) -> tuple[int, int, int]:
    """Statements that agree, that do not, and that cannot be decided."""
    verdicts = [one.agrees for part in parts for one in part.statements]
    return verdicts.count(True), verdicts.count(False), verdicts.count(None)


def write_page(parts: Sequence[Part], folder: Path, quick: bool, seed: int) -> Path:
    """paper.html in a folder that holds the pictures."""
    agree, differ, still = count(parts)
    note = ('<p class="no">A quick look: few repeats and coarse grids; the numbers are not those of a whole run.</p>'
            if quick else "")
    body = (f"<h1>{TITLE}</h1><p>B. P. Mann and K. A. Young, “An empirical approach for delayed oscillator stability and "
            'parametric identification”, Proc. R. Soc. A 462, 2145-2160, <a href="https://doi.org/10.1098/rspa.2005.1677">'
            "doi 10.1098/rspa.2005.1677</a>. Every picture and number below was computed by <code>testbed paper</code> "
            f"(seed {seed}).</p>{note}<h2 id=\"statements\">Published and found</h2><p>{agree} statements agree, {differ} do "
            f"not, {still} cannot be decided.</p>{_statements(parts)}<h2 id=\"inferred\">What is inferred or unknown</h2>"
            + "".join(f"<p>{escape(said)}</p>" for said in INFERRED) + "".join(_part(folder, part) for part in parts))
    target = folder / "paper.html"
    write_text(target, '<!doctype html>\n<html lang="en"><head><meta charset="utf-8"><meta name="viewport" '
               f'content="width=device-width,initial-scale=1"><title>{TITLE}</title><style>{_STYLE}</style></head>\n<body>'
               f"{body}\n</body></html>\n")
    return target
