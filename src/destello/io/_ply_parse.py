"""PLY files as arrays: header, and elements in text or binary of either byte order.

plyfile, the field's library, reads list by list in Python (2 s for a binary mesh of 320,000 triangles and 7 s for a
text one, against 0.1 s and 1.3 s here) and takes memory for whatever count a header names. Tests compare with it.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from destello.errors import FormatError
from destello.io._text import number_rows, printable

_TYPES = {
    **dict.fromkeys(("char", "int8"), "i1"),
    **dict.fromkeys(("uchar", "uint8"), "u1"),
    **dict.fromkeys(("short", "int16"), "i2"),
    **dict.fromkeys(("ushort", "uint16"), "u2"),
    **dict.fromkeys(("int", "int32"), "i4"),
    **dict.fromkeys(("uint", "uint32"), "u4"),
    **dict.fromkeys(("float", "float32"), "f4"),
    **dict.fromkeys(("double", "float64"), "f8"),
}
_FORMATS = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}
_LONGEST_HEADER = 1 << 20

Array = NDArray[np.generic]


@dataclass(frozen=True)
class Property:
    """One property: `count_type` is "" unless it is a list. Types are NumPy's names without byte order."""

    name: str
    type: str
    count_type: str = ""


@dataclass
class Element:
    """One element's declaration (`line`: its own) and, once read, its data.

    Attributes:
        scalars: (count,) by property name, in the file's type (float64 if text).
        lists: (lengths (count,), all values one after the other) by property name.
    """

    name: str
    count: int
    line: int
    properties: list[Property] = field(default_factory=list)
    scalars: dict[str, Array] = field(default_factory=dict)
    lists: dict[str, tuple[NDArray[np.int64], Array]] = field(default_factory=dict)

    def stack(self, names: tuple[str, ...]) -> Array | None:
        """(count, k) of some scalars, None if one is not there."""
        if not all(name in self.scalars for name in names):
            return None
        return np.stack([self.scalars[name] for name in names], axis=1)


def parse(data: bytes, file: Path) -> dict[str, Element]:
    """All elements by name. Raises FormatError."""
    order, elements, body = _header(data, file)
    reader = _Text(data[body:], file, data.count(b"\n", 0, body)) if not order else _Binary(data, file, order, body)
    for element in elements:
        reader.read(element)
    return {element.name: element for element in elements}


def _header(data: bytes, file: Path) -> tuple[str, list[Element], int]:
    """Byte order ("" for text), elements, and where the data begin."""
    if not data.startswith(b"ply"):
        raise FormatError("not a PLY file", file=file, line=1, value=data[:4], expected="a file that begins with ply")
    end = data.find(b"end_header", 0, _LONGEST_HEADER)
    after = data[end + 10 : end + 12]
    if end < 0 or not after[:1].isspace():
        raise FormatError("the header does not end", file=file, expected="a line end_header")
    order: str | None = None
    elements: list[Element] = []
    for number, line in enumerate(data[:end].splitlines()[1:], 2):
        words = [printable(word) for word in line.split()]
        if not words or words[0] in ("comment", "obj_info"):
            continue
        if words[0] == "format" and len(words) == 3 and words[1] in _FORMATS:
            order = _FORMATS[words[1]]
        elif words[0] == "element" and len(words) == 3 and words[2].isdecimal() and len(words[2]) < 16:
            elements.append(Element(words[1], int(words[2]), number))
        elif words[0] == "property" and elements and (made := _property(words)) is not None:
            elements[-1].properties.append(made)
        else:
            raise FormatError(
                "not understood",
                file=file,
                line=number,
                value=" ".join(words)[:60],
                expected="format, element, property or comment",
            )
    if order is None:
        raise FormatError("no format line", file=file, line=2, expected=", ".join(_FORMATS))
    return order, elements, end + (12 if after == b"\r\n" else 11)


def _property(words: list[str]) -> Property | None:
    if len(words) == 3 and words[1] in _TYPES:
        return Property(words[2], _TYPES[words[1]])
    if (
        len(words) == 5
        and words[1] == "list"
        and words[2] in _TYPES
        and words[3] in _TYPES
        and _TYPES[words[2]][0] != "f"
    ):
        return Property(words[4], _TYPES[words[3]], _TYPES[words[2]])
    return None


class _Text:
    """Elements as lines of text, one row a line."""

    def __init__(self, body: bytes, file: Path, first: int) -> None:
        self.file = file
        self._rows = [(number, line) for number, line in enumerate(body.splitlines(), first + 1) if line.strip()]
        self._at = 0

    def read(self, element: Element) -> None:
        """Reads the element's rows."""
        rows = self._rows[self._at : self._at + element.count]
        if len(rows) < element.count:
            raise FormatError(
                f"truncated: {len(rows)} of the rows of element {element.name} are there",
                file=self.file, line=element.line, value=element.count, expected="a complete file",
            )  # fmt: skip
        self._at += element.count

        def fail(i: int, word: bytes) -> FormatError:
            return self._error("not a number", rows[i][0], printable(word), "a number")

        flat, counts = number_rows([line for _, line in rows], fail)
        ends = np.cumsum(counts)
        cursor = ends - counts

        def check(short: NDArray[np.bool_]) -> None:
            if short.any():
                i = int(np.argmax(short))
                raise self._error(
                    "wrong number of values", rows[i][0], int(counts[i]), f"what element {element.name} declares"
                )

        for p in element.properties:
            check(cursor >= ends)
            values = flat[cursor]
            cursor = cursor + 1
            if not p.count_type:
                element.scalars[p.name] = values
                continue
            bad = ~((values >= 0) & (values == np.floor(values)) & (values <= len(flat)))
            check(bad)
            lengths = values.astype(np.int64)
            check(cursor + lengths > ends)
            inside = np.arange(int(lengths.sum())) - np.repeat(np.cumsum(lengths) - lengths, lengths)
            element.lists[p.name] = (lengths, flat[np.repeat(cursor, lengths) + inside])
            cursor = cursor + lengths
        check(cursor != ends)

    def _error(self, problem: str, line: int, value: object, expected: str) -> FormatError:
        return FormatError(problem, file=self.file, line=line, value=value, expected=expected)


class _Binary:
    """Elements in binary, one after the other."""

    def __init__(self, data: bytes, file: Path, order: str, start: int) -> None:
        self.data = data
        self.file = file
        self.order = order
        self._at = start

    def read(self, element: Element) -> None:
        """Reads the element's rows: in one go if all lists of a property are equally long, else row by row."""
        lengths = self._first_lengths(element)
        if lengths is None or not self._read_uniform(element, lengths):
            self._read_rows(element)

    def _room(self, element: Element, needed: int) -> bool:
        if not element.count:
            return True
        if needed > len(self.data) - self._at:
            least = sum(np.dtype(p.count_type or p.type).itemsize for p in element.properties) * element.count
            if least > len(self.data) - self._at:
                raise self._truncated(element)
            return False
        return True

    def _truncated(self, element: Element, row: int | None = None) -> FormatError:
        where = f"row {row} of " if row is not None else ""
        return FormatError(
            f"truncated: {where}element {element.name} reaches beyond the end of the file",
            file=self.file,
            line=element.line,
            value=element.count,
            expected=f"what fits into {len(self.data) - self._at} bytes",
        )  # fmt: skip

    def _first_lengths(self, element: Element) -> list[int] | None:
        """The lengths of the lists in the first row, 0 for scalars; None if there are no rows."""
        lengths = []
        at = self._at
        for p in element.properties:
            if element.count and p.count_type:
                lengths.append(self._length(element, p, at, 0))
                at += np.dtype(p.count_type).itemsize + lengths[-1] * np.dtype(p.type).itemsize
            else:
                lengths.append(0)
                at += np.dtype(p.type).itemsize
        return lengths

    def _length(self, element: Element, p: Property, at: int, row: int) -> int:
        kind = np.dtype(self.order + p.count_type)
        if at + kind.itemsize > len(self.data):
            raise self._truncated(element, row)
        length = int(np.frombuffer(self.data, kind, 1, at)[0])
        if length < 0:
            raise FormatError(
                f"row {row} of element {element.name}: a list of negative length",
                file=self.file,
                value=length,
                expected="0 or more",
            )
        return length

    def _read_uniform(self, element: Element, lengths: list[int]) -> bool:
        fields: list[tuple[str, str] | tuple[str, str, tuple[int, ...]]] = []
        for i, (p, length) in enumerate(zip(element.properties, lengths, strict=True)):
            if p.count_type:
                fields.append((f"n{i}", self.order + p.count_type))
                fields.append((f"v{i}", self.order + p.type, (length,)))
            else:
                fields.append((f"v{i}", self.order + p.type))
        size = sum(np.dtype(f[1]).itemsize * (f[2][0] if len(f) == 3 else 1) for f in fields)
        if not self._room(element, size * element.count):
            return False
        rows = (
            np.frombuffer(self.data, np.dtype(fields), element.count, self._at)
            if size
            else np.zeros(element.count, fields)
        )
        for i, (p, length) in enumerate(zip(element.properties, lengths, strict=True)):
            if p.count_type and (rows[f"n{i}"] != length).any():
                return False
        for i, (p, length) in enumerate(zip(element.properties, lengths, strict=True)):
            values = rows[f"v{i}"].astype(p.type)
            if p.count_type:
                element.lists[p.name] = (np.full(element.count, length, np.int64), values.reshape(-1))
            else:
                element.scalars[p.name] = values
        self._at += size * element.count
        return True

    def _read_rows(self, element: Element) -> None:
        at = self._at
        starts: list[list[int]] = [[] for _ in element.properties]
        lengths: list[list[int]] = [[] for _ in element.properties]
        sizes = [np.dtype(p.type).itemsize for p in element.properties]
        heads = [np.dtype(p.count_type).itemsize if p.count_type else 0 for p in element.properties]
        signed = [p.count_type.startswith("i") for p in element.properties]
        order = "little" if self.order == "<" else "big"
        data, end = self.data, len(self.data)
        for row in range(element.count):
            for i, head in enumerate(heads):
                n = 1
                if head:
                    n = int.from_bytes(data[at : at + head], order, signed=signed[i])  # type: ignore[arg-type]
                    at += head
                starts[i].append(at)
                lengths[i].append(n)
                at += n * sizes[i]
                if n < 0 or at > end:
                    raise self._truncated(element, row)
        for i, p in enumerate(element.properties):
            counts = np.array(lengths[i], np.int64)
            values = self._gather(np.array(starts[i], np.int64), counts, p.type)
            if p.count_type:
                element.lists[p.name] = (counts, values)
            else:
                element.scalars[p.name] = values
        self._at = at

    def _gather(self, starts: NDArray[np.int64], counts: NDArray[np.int64], kind: str) -> Array:
        """The values of `kind` at byte `starts`, `counts` of them each."""
        size = np.dtype(kind).itemsize
        inside = np.arange(int(counts.sum())) - np.repeat(np.cumsum(counts) - counts, counts)
        where = np.repeat(starts, counts) + inside * size
        raw = np.frombuffer(self.data, np.uint8)
        columns = (
            np.stack([raw[where + b] for b in range(size)], axis=1) if len(where) else np.zeros((0, size), np.uint8)
        )
        return np.ascontiguousarray(columns).view(self.order + kind).reshape(-1).astype(kind)
