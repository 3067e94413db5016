"""The lines of a text file, as its bytes and the places where they begin: texts in a list would take several times as much."""

from __future__ import annotations

import codecs
from collections.abc import Iterable, Iterator, Sequence
from itertools import islice
from pathlib import Path
from typing import overload

import numpy as np

from testbed.problem import InputProblem

_BLOCK = 1 << 20  # bytes read, and counted, at once
_AT_ONCE = 1 << 14  # lines decoded at once
_MINUS, _END = "\N{MINUS SIGN}", ord("\n")


class Lines(Sequence[str]):
    """Lines without their ends. ended: whether the last has one. `places` (count,): their indices in the file, from 0."""

    def __init__(self, text: bytearray, starts: np.ndarray, places: np.ndarray | None, ended: bool) -> None:
        """text: UTF-8, each line with its end. starts (all + 1,): where each line of the file begins, and the end of the last.
        places: those that are lines of this; all, where None.
        """
        self._text, self._starts, self.ended = text, starts, ended
        self.places = np.arange(len(starts) - 1, dtype=np.uint32) if places is None else places

    def __len__(self) -> int:
        return len(self.places)

    @overload
    def __getitem__(self, index: int) -> str: ...
    @overload
    def __getitem__(self, index: slice | np.ndarray) -> Lines: ...
    def __getitem__(self, index: int | slice | np.ndarray) -> str | Lines:
        if isinstance(index, (slice, np.ndarray)):
            return Lines(self._text, self._starts, self.places[index], self.ended)
        place = self.places[index]
        return self._text[self._starts[place] : self._starts[place + 1] - 1].decode()

    def __iter__(self) -> Iterator[str]:
        for first in range(0, len(self.places), _AT_ONCE):
            yield from self.texts(first, first + _AT_ONCE)

    def texts(self, first: int, stop: int) -> list[str]:
        """The lines from `first` to before `stop`."""
        places = self.places[first:stop]
        if len(places) and int(places[-1]) - int(places[0]) == len(places) - 1:
            return self._text[self._starts[places[0]] : self._starts[places[-1] + 1] - 1].decode().split("\n")
        return [self._text[begin : end - 1].decode()
                for begin, end in zip(self._starts[places].tolist(), self._starts[places + 1].tolist(), strict=True)]

    def opening_with(self, signs: bytes) -> np.ndarray:
        """Indices of the lines whose first byte is one of `signs`, no sign of ASCII, a blank or the line's end."""
        sought = np.ones(256, dtype=bool)
        sought[33:128] = False
        sought[list(signs)] = True
        codes, found = np.frombuffer(self._text, np.uint8), []
        for first in range(0, len(self.places), _BLOCK):
            begins = self._starts[self.places[first : first + _BLOCK]]
            found.append(first + np.flatnonzero(sought[codes[begins]]))
        return np.concatenate(found) if found else np.empty(0, dtype=np.intp)

    def filled(self) -> Lines:
        """Those that hold more than blanks."""
        kept = np.ones(len(self), dtype=bool)
        unsure = self.opening_with(b"")
        for index, line in zip(unsure, self[unsure], strict=True):
            kept[index] = bool(line.strip())
        return self[kept]

    def longest(self, limit: int) -> tuple[int, int] | None:
        """(index, characters) of the longest line beyond a limit of characters; None where none is beyond it."""
        sizes = np.diff(self._starts)[self.places] - 1  # bytes, no fewer than characters
        lengths = [(len(self[index]), -index) for index in np.flatnonzero(sizes > limit).tolist()]
        length, place = max(lengths, default=(0, 0))
        return (-place, length) if length > limit else None


def read_lines(path: Path) -> Lines:
    """The lines of a text in UTF-8, UTF-16 (with or without a byte-order mark) or a Western one-byte code.

    Raises InputProblem for what is no text.
    """
    with path.open("rb") as file:
        code, skipped = _code(path, file.read(4096))
    try:
        return _lines(_normal(_decoded(path, code, skipped)))
    except UnicodeDecodeError:
        return _lines(_normal(_decoded(path, "cp1252", skipped)))


def written(lines: Iterable[str]) -> Lines:
    """Lines of texts without ends."""
    rest = iter(lines)
    blocks = iter(lambda: list(islice(rest, _AT_ONCE)), [])
    return _lines("\n" * bool(number) + "\n".join(block) for number, block in enumerate(blocks))


def _code(path: Path, head: bytes) -> tuple[str, int]:
    """The code of a text by its first bytes, and how many of them are a mark. Raises InputProblem."""
    if head.startswith((b"\xff\xfe", b"\xfe\xff")):
        return "utf-16", 0
    mark = 3 if head.startswith(b"\xef\xbb\xbf") else 0
    head = head[mark:]
    zeros_even, zeros_odd = head[0::2].count(0), head[1::2].count(0)
    if (
        len(head) >= 4
        and max(zeros_even, zeros_odd) > 0.4 * len(head) / 2
        and min(zeros_even, zeros_odd) < 0.02 * len(head)
    ):
        return ("utf-16-le" if zeros_odd > zeros_even else "utf-16-be"), mark
    if sum(head.count(code) for code in range(1, 9)) > 0.01 * len(head):
        raise _binary(path)
    return "utf-8", mark


def _binary(path: Path) -> InputProblem:
    return InputProblem(
        path,
        "not a text table (it holds binary data)",
        "export as CSV, or give the file its proper ending (.mat, .h5, .wav, .tdms, .uff, .parquet)",
    )


def _decoded(path: Path, code: str, skipped: int) -> Iterator[str]:
    """The text by blocks. Raises UnicodeDecodeError where it is no UTF-8, InputProblem where it holds a NUL that is none."""
    decoder = codecs.getincrementaldecoder(code)(errors="strict" if code == "utf-8" else "replace")
    with path.open("rb") as file:
        file.seek(skipped)
        while block := file.read(_BLOCK):
            if not code.startswith("utf-16") and b"\0" in block:
                raise _binary(path)
            yield decoder.decode(block)
    yield decoder.decode(b"", final=True)


def _normal(blocks: Iterable[str]) -> Iterator[str]:
    """The blocks with one kind of line ends and of minus sign."""
    rest = ""
    for block in blocks:
        block, rest = rest + block, ""
        if block.endswith("\r"):  # its second half may be in the next
            block, rest = block[:-1], "\r"
        if "\r" in block:
            block = block.replace("\r\n", "\n").replace("\r", "\n")
        yield block if block.isascii() else block.replace(_MINUS, "-")
    yield rest and "\n"


def _lines(blocks: Iterable[str]) -> Lines:
    """The lines of a text that comes in blocks."""
    text, starts = bytearray(), [np.zeros(1, dtype=np.int64)]
    for block in blocks:
        before = len(text)
        text += block.encode()
        ends = np.flatnonzero(np.frombuffer(text, np.uint8)[before:] == _END)
        if len(ends):
            starts.append((ends + before + 1).astype(np.uint32 if len(text) < 1 << 32 else np.int64))
    ended = text.endswith(b"\n")
    text += b"\n"
    starts.append(np.array([len(text)]))
    kind = np.uint32 if len(text) < 1 << 32 else np.int64
    return Lines(text, np.concatenate(starts, dtype=kind, casting="unsafe"), None, ended)
