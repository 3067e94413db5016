"""YAML files with the line of every key, and their checking: whatever is wrong is said in one line, with its place.

ruamel.yaml rather than PyYAML, which reads `1e6` as text and lets a repeated key win in silence.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import accumulate, pairwise
from pathlib import Path
from typing import Annotated, Any, TypeVar, get_args

from pydantic import BaseModel, BeforeValidator, ConfigDict, ValidationError, model_validator

from testbed.files.door import content
from testbed.files.synonyms import meant
from testbed.problem import InputProblem
from testbed.units import UnitProblem, nearest, parse_quantity, parse_sampling_rate

MAX_BYTES = 500_000  # some 5,000 records; the parser takes 10 s for the worst of them
DEEPEST = 200
SLOWEST, FASTEST = 1e-3, 1e9  # Hz
LONGEST_LINE = 20_000  # characters
MAX_NODES = 400_000
Path_ = tuple[str | int, ...]
# the key that tells a kind of file, and what such files are called
_MARKS = {"structure": "model.yaml", "records": "campaign.yaml", "taps": "taps.yaml", "model": "scenario"}


class Strict(BaseModel):
    """A mapping of the file: unknown keys, NaN and silent conversions are refused."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False, strict=True)

    @model_validator(mode="before")
    @classmethod
    def _no_split_number(cls, data: object) -> object:
        """YAML takes `{depth_of_cut: 2,9 mm}` for 2 and a key `9 mm` without a value. Raises UnitProblem."""
        for (key, value), (after, rest) in pairwise(data.items() if isinstance(data, dict) else ()):
            if rest is None and str(after)[:1].isdigit() and isinstance(value, int):
                raise UnitProblem(f"{key} '{value},{after}' holds a comma", f"write a decimal point: {value}.{after}")
        return data


Checked = TypeVar("Checked", bound=Strict)


def quantity(si: str, check: Callable[[float], str | None] | None = None) -> Any:
    """A pydantic field type, for a file's annotations that no type checker reads: see `in_unit`."""
    return Annotated[float, in_unit(si, check)]


def in_unit(si: str, check: Callable[[float], str | None] | None = None) -> BeforeValidator:
    """`Annotated[float, in_unit("m")]` is a text with a unit, read in the SI unit `si`; `check` says what is wrong."""

    return BeforeValidator(_checked(lambda value: parse_quantity(value, si), check))


def _checked(parse: Callable[[object], float], check: Callable[[float], str | None] | None) -> Callable[[object], float]:
    def read(value: object) -> float:
        number = parse(value)
        wrong = check(number) if check else None
        if wrong:
            raise UnitProblem(f"'{value}' {wrong}", "correct the value")
        return number

    return read


def above_zero(number: float) -> str | None:
    """What is wrong with a number that must be above 0."""
    return None if number > 0 else "must be above 0"


def _rate(number: float) -> str | None:
    return above_zero(number) or (None if SLOWEST <= number <= FASTEST else "is the rate of no converter")


SAMPLING_RATE = BeforeValidator(_checked(parse_sampling_rate, _rate))  # Annotated[float, SAMPLING_RATE], in Hz


def at_least_zero(number: float) -> str | None:
    """What is wrong with a number that must not be negative."""
    return None if number >= 0 else "must be at least 0"


@dataclass(frozen=True)
class Document:
    """A YAML file: plain `data`, its `text`, and the line (from 1) of every path of keys and indices."""

    file: str
    data: Any
    text: str
    lines: dict[Path_, int]

    def at(self, path: Path_) -> Any:
        """The plain value at a path of keys and indices."""
        value = self.data
        for key in path:
            value = value[key]
        return value

    def problem(self, path: Path_, what: str, do: str = "") -> InputProblem:
        """The one line that names the file, the line and the field."""
        known = path
        while known and known not in self.lines:
            known = known[:-1]
        field = ".".join(str(key) for key in path)
        return InputProblem(self.file, f"{field}: {what}" if field else what, do, line=self.lines.get(known, 1))


def load(file: str | Path) -> Document:
    """Read a YAML file whose top level is a mapping. InputProblem if it is missing, not text or too large."""
    try:
        text = content(file, MAX_BYTES, "give a YAML file, not data").decode("utf-8-sig")
    except UnicodeDecodeError:
        raise InputProblem(file, "is not a UTF-8 text file", "save it as UTF-8") from None
    return parse(text, str(file))


def parse(text: str, file: str) -> Document:
    """A YAML text whose top level is a mapping; `file` is the name to use in messages."""
    from ruamel.yaml import YAML
    from ruamel.yaml.error import MarkedYAMLError

    text = _bounded(text, file)
    try:
        tree = YAML(typ="rt").load(text)
    except MarkedYAMLError as problem:
        mark = problem.problem_mark or problem.context_mark
        # ruamel adds advice for programmers to some messages; the first line is what is wrong.
        said = (problem.problem or problem.context or "not YAML").splitlines()[0]
        do = "indent with spaces instead of tabs" if "'\\t'" in said else "correct the line"
        raise InputProblem(file, f"not valid YAML: {said}", do,
                           line=mark.line + 1 if mark else None) from None
    except Exception as problem:  # what the parser makes of a text that it was not made for is the text's fault
        said = (str(problem).splitlines() or ["not YAML"])[0]
        raise InputProblem(file, f"not valid YAML: {said}", "correct the file") from None
    if not isinstance(tree, dict):
        raise InputProblem(file, "holds no `key: value` mapping", "start from an example in scenarios/ or the README")
    lines: dict[Path_, int] = {}
    try:
        data = _plain(tree, (), lines, file)
    except RecursionError:
        raise InputProblem(file, "a YAML alias contains itself", "write the values out") from None
    return Document(file, data, text, lines)


def _bounded(text: str, file: str) -> str:
    """The text with very long comments cut off: the parser goes over them again and again. InputProblem for others."""
    lines = text.split("\n")
    for number, line in enumerate(lines):
        if len(line) <= LONGEST_LINE:
            continue
        if line.strip() and not line.lstrip().startswith("#"):
            raise InputProblem(file, f"a line of {len(line)} characters", "give a YAML file, not data", line=number + 1)
        lines[number] = line[:LONGEST_LINE].rstrip()
    depths = accumulate((one in "[{") - (one in "]}") for one in text)
    if max(depths, default=0) > DEEPEST:
        raise InputProblem(file, f"more than {DEEPEST} brackets within each other", "give a YAML file, not data")
    return "\n".join(lines)


def _plain(node: Any, path: Path_, lines: dict[Path_, int], file: str) -> Any:
    """Plain Python values of a ruamel tree, noting the line of every path on the way."""
    if len(lines) > MAX_NODES:
        raise InputProblem(file, f"holds more than {MAX_NODES} values", "give a smaller file")
    if isinstance(node, dict):
        plain: dict[Any, Any] = {}
        for key, value in node.items():
            name = key if isinstance(key, str) else str(key)
            place = (*path, name)
            lines[place] = _line(node, key)
            plain[name] = _plain(value, place, lines, file)
        return plain
    if isinstance(node, list):
        items = []
        for index, value in enumerate(node):
            lines[*path, index] = _line(node, index)
            items.append(_plain(value, (*path, index), lines, file))
        return items
    if node is None or isinstance(node, bool):
        return node
    if isinstance(node, str) and not node.isascii() and any("\ud800" <= one <= "\udfff" for one in node):
        raise InputProblem(file, "half a character, which no text holds", "write it out", line=lines.get(path))
    for kind in (int, float, str):
        if isinstance(node, kind):
            return kind(node)
    return str(node)


def _line(node: Any, key: Any) -> int:
    """Line (from 1) of a key or an item; the container's own line where a merge brought it in."""
    place = node.lc.data.get(key) if node.lc.data else None
    return (place[0] if place else node.lc.line) + 1


def validate(document: Document, kind: type[Checked], path: Path_ = ()) -> Checked:
    """Check the part of a document at `path`; InputProblem with the line, the field and the nearest known name."""
    data = document.at(path)
    if not isinstance(data, dict):
        fields = ", ".join(_names(kind))
        raise document.problem(path, "is empty" if data is None else f"'{data}' is not a mapping", f"give {fields}")
    _refuse_other_kind(document, kind, path, data)
    try:
        return kind.model_validate(data)
    except ValidationError as problems:
        found = problems.errors()
        # A misspelt key is also a missing one; the misspelling is what helps.
        first = next((error for error in found if error["type"] == "extra_forbidden"), found[0])
        where = tuple(first["loc"])
        what, do = _said(kind, first, where)
        raise document.problem(path + where, what, do) from None


def _refuse_other_kind(document: Document, kind: type[Strict], path: Path_, data: dict[str, Any]) -> None:
    """InputProblem for a whole file that is another kind of file than the one asked for: two arguments were exchanged."""
    own = [mark for mark in _MARKS if mark in _names(kind)]
    other = next((mark for mark in _MARKS if mark in data and mark not in _names(kind)), None)
    if not path and own and other and not any(mark in data for mark in own):
        raise document.problem((other,), f"the file is a {_MARKS[other]}", f"give a {_MARKS[own[0]]} here")


def _said(kind: type[Strict], error: Any, where: Path_) -> tuple[str, str]:
    """What is wrong and what to do, from one pydantic error."""
    cause = error.get("ctx", {}).get("error")
    if isinstance(cause, UnitProblem):
        return cause.what, cause.do
    if error["type"] == "missing":
        return "is missing", "add it"
    if error["type"] == "extra_forbidden":
        return "unknown key", did_you_mean(str(where[-1]), _names(_kind_at(kind, where[:-1])))
    if error["type"] == "literal_error":
        return f"'{error['input']}' is not known", f"one of {error['ctx']['expected']}"
    if error["type"] == "value_error":
        return str(cause), ""
    if error["type"] == "model_type":
        return f"'{error['input']}' is not a mapping", f"give {', '.join(_names(_kind_at(kind, where)))}"
    if error["type"] == "too_short":
        return "is empty", "name at least one"
    if error["type"] == "int_type":
        return _no_whole_number(error["input"])
    if error["type"] == "string_type":
        return f"'{error['input']}' is no text", "write a text, in quotes if it is a number"
    said = error["msg"].removeprefix("Input ")
    return f"'{error['input']}' {said}", "correct the value"


def _no_whole_number(value: object) -> tuple[str, str]:
    if isinstance(value, str) and value.strip().isdigit():
        return f"'{value}' is text", f"write the number without quotes: {value.strip()}"
    return f"'{value}' is no whole number", "write one, such as 1"


def did_you_mean(name: str, known: Any) -> str:
    """`did you mean X?`, or what to write for a word of the shop, and all that is known."""
    names = [str(item) for item in known]
    word, close = meant(name, names), nearest(name, names)
    said = f"write {word}; " if word else f"did you mean {close}? " if close else ""
    return f"{said}known: {', '.join(names) or 'none'}"


def _names(kind: type[BaseModel]) -> list[str]:
    return [field.alias or name for name, field in kind.model_fields.items()]


def _kind_at(kind: type[BaseModel], where: Path_) -> type[BaseModel]:
    """The mapping type that a path of fields leads to, through Optional, list and the like."""
    for key in where:
        fields = {field.alias or name: field.annotation for name, field in kind.model_fields.items()}
        found = _model_in(fields.get(str(key))) if not isinstance(key, int) else kind
        kind = found or kind
    return kind


def _model_in(annotation: Any) -> type[BaseModel] | None:
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return annotation
    return next((found for part in get_args(annotation) if (found := _model_in(part))), None)
