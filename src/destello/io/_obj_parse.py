"""The text of OBJ files: vertices and faces as arrays, with the line number of what is wrong.

tinyobjloader, the field's own reader, turns "nan", "inf" and any other word into 0 without a word of warning, cuts
material names at spaces, and keeps neither the options of texture maps nor smoothing groups; tests compare with it.
"""

from __future__ import annotations

import re
from bisect import bisect_right
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from destello.errors import FormatError
from destello.io._text import printable

Ints = NDArray[np.int64]
_ABSENT = -(2**62)
_BATCH = 1 << 22  # bytes of text whose words are taken apart at a time
_BLOCK = re.compile(rb"^(?:(v|vt|vn|f)[ \t][^\n]*+\n(?:\1[ \t][^\n]*+\n)*+|[^\n]++\n)", re.MULTILINE)
_CONTINUED = re.compile(rb"^(?:[^\n]*\\\r?\n)++[^\n]*+", re.MULTILINE)
_WHAT = {b"v": "vertex", b"vt": "texture coordinate", b"vn": "normal"}


@dataclass
class ObjData:
    """What an OBJ file holds. Numbers of vertices count from 0; -1 is none.

    Attributes:
        positions: (V, 3). colors: (V, 3) as in the file, or None. uvs: (T, 2). normals: (N, 3).
        corners: (C, 3) numbers of position, texture coordinate and normal, face after face.
        sizes: (F,) corners of each face.
        materials: (F,) positions in `material_names`. smoothing: (F,) smoothing group, 0: none.
        libraries: names of the .mtl files. ignored: how often unknown statements stand in the file.
    """

    positions: NDArray[np.float64] = field(default_factory=lambda: np.zeros((0, 3)))
    colors: NDArray[np.float64] | None = None
    uvs: NDArray[np.float64] = field(default_factory=lambda: np.zeros((0, 2)))
    normals: NDArray[np.float64] = field(default_factory=lambda: np.zeros((0, 3)))
    corners: Ints = field(default_factory=lambda: np.zeros((0, 3), np.int64))
    sizes: Ints = field(default_factory=lambda: np.zeros(0, np.int64))
    materials: Ints = field(default_factory=lambda: np.zeros(0, np.int64))
    smoothing: Ints = field(default_factory=lambda: np.zeros(0, np.int64))
    material_names: list[str] = field(default_factory=lambda: [""])
    libraries: list[str] = field(default_factory=list)
    ignored: Counter[str] = field(default_factory=Counter)


class _Rows:
    """The lines of one kind, in blocks of neighbours: their text with keyword, and the number of the first one."""

    def __init__(self, key: bytes) -> None:
        self.key = key
        self.count = 0
        self._blocks: list[tuple[bytes, int, int]] = []  # text, first line, rows before it

    def add(self, text: bytes, line: int) -> None:
        """Appends lines; each ends with a newline."""
        self._blocks.append((text, line, self.count))
        self.count += text.count(b"\n")

    def line_of(self, row: int) -> int:
        """The line number of a row."""
        _, line, before = self._blocks[bisect_right(self._blocks, row, key=lambda block: block[2]) - 1]
        return line + row - before

    def chunks(self) -> Iterator[tuple[int, list[bytes], Ints]]:
        """(first row, the words of many rows without their keywords, how many words each row has)."""
        for start, texts in self._batches():
            text = b"".join(texts)
            words = text.split()
            count, size = text.count(b"\n"), len(text[: text.index(b"\n")].split())
            if len(words) == count * size and set(words[::size]) == {self.key} and b"#" not in text:
                del words[::size]
                yield start, words, np.full(count, size - 1, np.int64)
                continue
            rows = [line.partition(b"#")[0].split() for line in text.split(b"\n")[:-1]]
            sizes = np.fromiter((len(row) - 1 for row in rows), np.int64, len(rows))
            yield start, [word for row in rows for word in row[1:]], sizes

    def _batches(self) -> Iterator[tuple[int, list[bytes]]]:
        texts: list[bytes] = []
        size = start = 0
        for text, _, before in self._blocks:
            start = before if not texts else start
            texts.append(text)
            size += len(text)
            if size > _BATCH:
                yield start, texts
                texts, size = [], 0
        if texts:
            yield start, texts


def parse(data: bytes, file: Path) -> ObjData:
    """Everything in an OBJ file that describes triangles. Raises FormatError."""
    scanner = _Scanner(file)
    scanner.scan(data)
    return scanner.finish()


class _Scanner:
    """Sorts the lines of a file by kind; the numbers in them are read afterwards, many at a time."""

    def __init__(self, file: Path) -> None:
        self.file = file
        self.data = ObjData()
        self._rows = {key: _Rows(key) for key in _WHAT}
        self._faces = _Rows(b"f")
        self._materials = {"": 0}
        self._states: list[tuple[int, int, int]] = [(0, 0, 0)]  # first face, material, smoothing group
        self._before: list[tuple[int, ...]] = []  # first face, and how many v, vt, vn stand before it

    def scan(self, data: bytes) -> None:
        """Reads all lines."""
        if b"\n" not in data:
            data = data.replace(b"\r", b"\n")
        if b"\\" in data:
            data = _CONTINUED.sub(
                lambda m: m[0].replace(b"\\\r\n", b" ").replace(b"\\\n", b" ") + b"\n" * m[0].count(b"\n"), data
            )
        data += b"\n"
        line, at = 1, 0
        for match in _BLOCK.finditer(data):
            line += data.count(b"\n", at, match.start())
            at = match.start()
            text = match[0]
            keyword = match[1] or b""
            if not keyword:
                keyword, text = _keyword(text)
            if keyword == b"f":
                self._before.append((self._faces.count, *(rows.count for rows in self._rows.values())))
                self._faces.add(text, line)
            elif keyword in self._rows:
                self._rows[keyword].add(text, line)
            elif keyword:
                self._statement(keyword, text.strip().partition(keyword)[2].strip(), line)

    def _statement(self, keyword: bytes, rest: bytes, line: int) -> None:
        _, material, smoothing = self._states[-1]
        if keyword == b"usemtl":
            material = self._materials.setdefault(printable(rest), len(self._materials))
            self._states.append((self._faces.count, material, smoothing))
        elif keyword == b"s":
            smoothing = self._smoothing_group((rest.split() or [b"off"])[0], line)
            self._states.append((self._faces.count, material, smoothing))
        elif keyword == b"mtllib":
            self.data.libraries.append(printable(rest))
        elif keyword not in (b"o", b"g"):
            self.data.ignored[printable(keyword[:20])] += 1

    def _smoothing_group(self, word: bytes, line: int) -> int:
        if word in (b"off", b"on"):
            return int(word == b"on")
        if not word.isdigit() or len(word) > 9:
            raise self._error("wrong smoothing group", line, value=printable(word), expected="a number or off")
        return int(word)

    def _error(self, problem: str, line: int, *, value: object = None, expected: str | None = None) -> FormatError:
        return FormatError(problem, file=self.file, line=line, value=value, expected=expected)

    # --- numbers ------------------------------------------------------------------------------------------------------

    def finish(self) -> ObjData:
        """The arrays."""
        data = self.data
        data.positions, data.colors = self._vertices()
        data.uvs = self._vectors(b"vt", (1, 2, 3), 2)
        data.normals = self._vectors(b"vn", (3,), 3, finite=False)
        data.corners, data.sizes = self._corners()
        data.material_names = list(self._materials)
        states = np.array(self._states, np.int64)
        of_face = np.searchsorted(states[:, 0], np.arange(len(data.sizes)), side="right") - 1
        data.materials, data.smoothing = states[of_face, 1], states[of_face, 2]
        return data

    def _numbers(
        self, key: bytes, accepted: tuple[int, ...], *, finite: bool = True
    ) -> tuple[NDArray[np.float64], Ints]:
        """All numbers on the lines of one kind, and how many each line has: one of `accepted`."""
        rows, name = self._rows[key], printable(key)
        parts, sizes = [np.zeros(0)], [np.zeros(0, np.int64)]
        for start, words, counts in rows.chunks():
            try:
                parts.append(np.fromiter(map(float, words), np.float64, len(words)))
            except ValueError:
                at = next(i for i, word in enumerate(words) if not _is_float(word))
                line = rows.line_of(start + _row_of(at, counts))
                raise self._error(
                    f"{name}: not a number", line, value=printable(words[at]), expected="a number"
                ) from None
            sizes.append(counts)
        flat, counts = np.concatenate(parts), np.concatenate(sizes)
        bad = ~np.isin(counts, accepted)
        if bad.any():
            i = int(np.argmax(bad))
            wanted = " or ".join(str(n) for n in accepted)
            raise self._error(f"{name}: wrong number of values", rows.line_of(i), value=int(counts[i]), expected=wanted)
        with np.errstate(over="ignore"):
            good = np.isfinite(flat.astype(np.float32))
        if finite and not good.all():
            at = int(np.argmin(good))
            i = _row_of(at, counts)
            problem = f"{_WHAT[key]} {i + 1} is not finite"
            raise self._error(problem, rows.line_of(i), value=float(flat[at]), expected="finite numbers")
        return flat, counts

    def _vertices(self) -> tuple[NDArray[np.float64], NDArray[np.float64] | None]:
        """Positions, and colours if every vertex has one: x y z [w] or x y z r g b [a]."""
        flat, counts = self._numbers(b"v", (3, 4, 6, 7))
        starts = np.cumsum(counts) - counts
        positions = flat[starts[:, None] + np.arange(3)]
        if len(counts) == 0 or counts.min() < 6:
            return positions, None
        return positions, flat[starts[:, None] + np.arange(3, 6)]

    def _vectors(
        self, key: bytes, accepted: tuple[int, ...], width: int, *, finite: bool = True
    ) -> NDArray[np.float64]:
        """(N, width) numbers; missing ones are 0, further ones are left out."""
        flat, counts = self._numbers(key, accepted, finite=finite)
        if len(counts) == 0:
            return np.zeros((0, width))
        starts = np.cumsum(counts) - counts
        columns = np.arange(width)
        where = starts[:, None] + np.minimum(columns, counts[:, None] - 1)
        return np.where(columns < counts[:, None], flat[where], 0.0)

    # --- faces --------------------------------------------------------------------------------------------------------

    def _corners(self) -> tuple[Ints, Ints]:
        """(C, 3) numbers from 0 of the faces' corners, -1 where there is none, and (F,) corners of each face."""
        parts, all_sizes = [np.zeros((0, 3), np.int64)], [np.zeros(0, np.int64)]
        for start, words, sizes in self._faces.chunks():
            try:
                parts.append(_read_corners(words))
            except (ValueError, OverflowError):
                at = next(i for i, word in enumerate(words) if not _is_corner(word))
                raise self._error(
                    "f: not a corner",
                    self._faces.line_of(start + _row_of(at, sizes)),
                    value=printable(words[at]),
                    expected="v, v/vt, v//vn or v/vt/vn",
                ) from None
            all_sizes.append(sizes)
        written, sizes = np.concatenate(parts), np.concatenate(all_sizes)
        if len(sizes) and sizes.min() < 3:
            i = int(np.argmax(sizes < 3))
            line = self._faces.line_of(i)
            raise self._error("f: too few corners", line, value=int(sizes[i]), expected="3 or more")
        return self._resolve(written, sizes), sizes

    def _resolve(self, written: Ints, sizes: Ints) -> Ints:
        """Relative (negative) numbers resolved. Raises FormatError if any is out of range."""
        counts = np.array([rows.count for rows in self._rows.values()], np.int64)
        absent = written == _ABSENT
        corners = written - 1
        if (written < 0).any() and len(self._before):
            before = np.array(self._before, np.int64)
            faces = np.diff(before[:, 0], append=len(sizes))
            of_corner = np.repeat(np.repeat(np.arange(len(before)), faces), sizes)
            corners = np.where(written < 0, written + before[of_corner, 1:], corners)
        bad = ~absent & ((written == 0) | (corners < 0) | (corners >= counts))
        if bad.any():
            at = int(np.argmax(bad.any(axis=1)))
            column = int(np.argmax(bad[at]))
            what, have = list(_WHAT.values())[column], int(counts[column])
            raise self._error(
                f"f: index of a {what} that is not there",
                self._faces.line_of(_row_of(at, sizes)),
                value=int(written[at, column]),
                expected=f"1 to {have} or -{have} to -1" if have else f"none: the file has no {what}",
            )
        return np.where(absent, -1, corners)


def _row_of(word: int, counts: Ints) -> int:
    """The row in which a word stands."""
    return int(np.searchsorted(np.cumsum(counts), word, side="right"))


def _is_float(word: bytes) -> bool:
    try:
        float(word)
    except ValueError:
        return False
    return True


def _keyword(line: bytes) -> tuple[bytes, bytes]:
    """The first word of a line, and the line without leading blanks; b"" for empty lines and comments."""
    line = line.lstrip()
    words = line.split(maxsplit=1)
    return (b"" if not words or words[0].startswith(b"#") else words[0]), line


def _read_corners(words: list[bytes]) -> Ints:
    """(C, 3) numbers as written, ``_ABSENT`` where there is none. Raises ValueError or OverflowError."""
    slashes = {word.count(b"/") for word in words}
    same = _same_form(words, slashes.pop()) if len(slashes) == 1 and slashes <= {0, 1, 2} else None
    if same is not None:
        return same
    return np.array([_corner(word) for word in words], np.int64).reshape(-1, 3)


def _same_form(words: list[bytes], slashes: int) -> Ints | None:
    """Corners that all have that many slashes; None if not all have the same numbers."""
    text = b" ".join(words)
    columns = [0, 2] if b"//" in text else [0, 1, 2][: slashes + 1]
    if b"//" in text and text.count(b"//") != len(words):
        return None
    numbers = np.fromiter(map(int, text.replace(b"/", b" ").split()), np.int64)
    if len(numbers) != len(words) * len(columns):
        return None
    corners = np.full((len(words), 3), _ABSENT, np.int64)
    corners[:, columns] = numbers.reshape(len(words), len(columns))
    return corners


def _corner(word: bytes) -> list[int]:
    parts = word.split(b"/")
    if len(parts) > 3:
        raise ValueError(word)
    numbers = [int(parts[0]), *(int(part) if part else _ABSENT for part in parts[1:])]
    return numbers + [_ABSENT] * (3 - len(numbers))


def _is_corner(word: bytes) -> bool:
    try:
        return all(abs(n) < 2**62 for n in _corner(word) if n != _ABSENT)
    except ValueError:
        return False
