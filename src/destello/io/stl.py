"""Reads STL, binary and text: one mesh of one grey material, flat triangles, equal vertices merged.

STL knows neither unit nor axis: the coordinates are kept as they are, as metres with y up. Normals in the file are left
out: the order of the vertices gives them. (trimesh, the field's library, does not say where a text file is broken, and
needs most of a second to be imported; tests compare with it.)
"""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from destello.errors import FormatError
from destello.io._arrays import check_finite
from destello.io._defaults import LoadOptions
from destello.io._mesh_scene import add_mesh, complete, grey, new_scene, read_bytes
from destello.io._text import number_rows, printable
from destello.scene import Scene

_HEADER = 84
_CHUNK = 1 << 20
_REGULAR = tuple(  # the words of a facet that are no numbers
    (i, word)
    for i, word in enumerate(
        b"facet normal . . . outer loop vertex . . . vertex . . . vertex . . . endloop endfacet".split()
    )
    if word != b"."
)
_RECORD = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])


def load(path: Path, options: LoadOptions) -> Scene:
    """The scene in an .stl file. Raises FormatError for a damaged one, with the line if it is text."""
    data = read_bytes(path)
    scene = new_scene(path, options)
    if _is_text(data):
        corners: NDArray[np.floating] = _text_corners(data, path)
        if b"endsolid" not in data[-1000:].lower():
            scene.notes.append("no endsolid: the file may be truncated")
    else:
        corners = _binary_corners(data, path, scene.notes)
    if len(corners) == 0:
        raise FormatError("no triangles", file=path, value=0, expected="at least one")
    check_finite(corners, "corner", file=path)
    positions, indices = merged(corners)
    add_mesh(scene, path, grey(), {"positions": positions, "indices": indices.reshape(-1, 3)})
    if options.complete:
        scene.notes.append("STL has no material and no up axis: grey, y is up")
    return complete(scene, options)


def merged(points: NDArray[np.floating]) -> tuple[NDArray[np.float32], NDArray[np.uint32]]:
    """The different ones (V, 3) among points (N, 3), and which of them each is (N,)."""
    points = points.astype(np.float32) + np.float32(0)  # -0 becomes 0
    key = np.zeros(len(points), np.int64)
    for axis in range(3):
        values, number = np.unique(points[:, axis], return_inverse=True)
        _, first, key = np.unique(key * len(values) + number, return_index=True, return_inverse=True)
    return np.asarray(points[first], np.float32), key.astype(np.uint32)


def _is_text(data: bytes) -> bool:
    """Binary files may begin with "solid", too; but then their size tells."""
    if data.lstrip()[:5].lower() != b"solid":
        return False
    if len(data) >= _HEADER and len(data) == _HEADER + _RECORD.itemsize * struct.unpack_from("<I", data, 80)[0]:
        return False
    return b"\0" not in data[:1024]


def _binary_corners(data: bytes, path: Path, notes: list[str]) -> NDArray[np.float32]:
    if len(data) < _HEADER:
        raise FormatError(
            "truncated: no room for the header", file=path, value=len(data), expected=f"{_HEADER} bytes or more"
        )
    (count,) = struct.unpack_from("<I", data, 80)
    room = (len(data) - _HEADER) // _RECORD.itemsize
    if count > room:
        raise FormatError(
            "truncated, or not STL: the header announces more triangles than the file has",
            file=path,
            value=count,
            expected=f"at most {room} in {len(data)} bytes",
        )
    if len(data) > _HEADER + count * _RECORD.itemsize:
        notes.append(f"{len(data) - _HEADER - count * _RECORD.itemsize} bytes after the last triangle left out")
    records = np.frombuffer(data, _RECORD, count, _HEADER)
    return np.ascontiguousarray(records["corners"]).reshape(-1, 3)


def _text_corners(data: bytes, path: Path) -> NDArray[np.float64]:
    """(3 T, 3) corners of a text file."""
    quick = _regular_corners(data)
    return _any_corners(data, path) if quick is None else quick


def _regular_corners(data: bytes) -> NDArray[np.float64] | None:
    """The corners of one solid written as usual, in half the time that `_any_corners` takes; None for anything else."""
    at, end = data.find(b"\n") + 1, data.rfind(b"endsolid")
    if end < 0 or data[end:].strip().count(b"\n"):
        return None
    parts = [np.zeros(0)]
    while at < end:
        stop = data.find(b"endfacet", at + _CHUNK, end) + 8
        stop = end if stop == 7 else stop
        words = data[at:stop].split()
        if len(words) % 21 or any(set(words[i::21]) - {word} for i, word in _REGULAR):
            return None
        numbers = [words[i::21] for i in (8, 9, 10, 12, 13, 14, 16, 17, 18)]
        try:
            columns = [np.fromiter(map(float, column), np.float64, len(column)) for column in numbers]
        except ValueError:
            return None
        parts.append(np.stack(columns, axis=1).reshape(-1))
        at = stop
    return np.concatenate(parts).reshape(-1, 3)


def _any_corners(data: bytes, path: Path) -> NDArray[np.float64]:
    """(3 T, 3): the words after "vertex"; every outer loop must have three of them."""
    vertices: list[bytes] = []
    lines: list[int] = []
    start, inside = 0, False
    for number, line in enumerate(data.splitlines(), 1):
        keyword, _, rest = line.strip().partition(b" ")
        keyword = keyword.lower()
        if keyword == b"vertex" and inside:
            vertices.append(rest)
            lines.append(number)
        elif keyword in (b"outer", b"endloop"):
            opens = keyword == b"outer"
            if opens == inside or (not opens and len(vertices) - start != 3):
                problem = "a loop inside a loop" if opens else f"a loop of {len(vertices) - start} vertices"
                raise FormatError(problem, file=path, line=number, expected="outer loop, 3 vertices, endloop")
            inside, start = opens, len(vertices)
        elif keyword not in (b"facet", b"endfacet", b"solid", b"endsolid", b"", b"color"):
            raise FormatError(
                "unknown word",
                file=path,
                line=number,
                value=printable(line.strip()[:40]),
                expected="facet, outer loop, vertex...",
            )
    if inside:
        raise FormatError(
            "truncated: the last loop does not end", file=path, line=len(data.splitlines()), expected="endloop"
        )

    def fail(i: int, word: bytes) -> FormatError:
        return FormatError(
            "not a number", file=path, line=lines[i], place="vertex", value=printable(word), expected="a number"
        )

    flat, counts = number_rows(vertices, fail)
    if (counts != 3).any():
        i = int(np.argmax(counts != 3))
        raise FormatError(
            "wrong number of values", file=path, line=lines[i], place="vertex", value=int(counts[i]), expected="3"
        )
    return flat.reshape(-1, 3)
