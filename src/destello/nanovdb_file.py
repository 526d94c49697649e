"""The container of NanoVDB's .nvdb files: segments of grids, each grid's bytes perhaps compressed; or a bare grid.

The layout is that of NanoVDB's public headers (IO.h, PNanoVDB.h), major version 32. Numbers are little-endian. Files
are untrusted: every size is checked against what there is before it is used.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterator
from dataclasses import dataclass

from destello.errors import FormatError, InputError, did_you_mean

VERSION = 32
MOST_BYTES = 1 << 32  # of a grid when it is unpacked
GRID_HEADER = 672
_FILE_MAGICS = (b"NanoVDB0", b"NanoVDB2")
_GRID_MAGICS = (b"NanoVDB0", b"NanoVDB1")
_SEGMENT = struct.Struct("<8sIHH")  # magic, version, grids, codec
_ENTRY = struct.Struct("<4Q2I6d6i3dI4I3I2HI")  # sizes in memory and in the file, ..., length of the name, ..., codec
_BLOSC = struct.Struct("<4B3I")  # versions, flags, size of a value; bytes unpacked, of a block, packed
_CODECS = ("none", "ZIP", "BLOSC")


@dataclass(frozen=True)
class _Entry:
    """Where a grid is: `packed` bytes from `offset` on, which are `size` bytes in memory."""

    name: str
    offset: int
    packed: int
    size: int
    codec: int


def grid_bytes(data: bytes, name: str) -> bytes | memoryview:
    """The bytes of the grid called `name`, unpacked.

    Raises:
        FormatError: no NanoVDB file, a damaged one, or no such grid. InputError: it is packed by Blosc, and the package
            that unpacks this is not installed.
    """
    names = []
    for entry in _entries(data):
        if entry.name == name:
            return _unpacked(data, entry)
        names.append(entry.name)
    raise FormatError("no such grid in the file", value=name, expected=did_you_mean(name, names))


def _entries(data: bytes) -> Iterator[_Entry]:
    if data[:8] not in (*_FILE_MAGICS, *_GRID_MAGICS):
        raise FormatError(
            "not a NanoVDB file", place="byte 0", value=data[:8], expected="NanoVDB0, NanoVDB1 or NanoVDB2"
        )
    # Version 32.6 and older begin both kinds of file by the same word: what stands at a file's version decides.
    bare = data[:8] == b"NanoVDB1" or (data[:8] == b"NanoVDB0" and _major(data, 8) != VERSION)
    yield from _bare_grids(data) if bare else _segments(data)


def _major(data: bytes, at: int) -> int:
    return int.from_bytes(data[at : at + 4], "little") >> 21


def _need(data: bytes, at: int, size: int, what: str) -> None:
    if size > len(data) - at:
        expected = f"at most the {len(data) - at} that the file has left"
        raise FormatError(f"{what} ends too early", place=f"byte {at}", value=f"{size} bytes", expected=expected)


def _segments(data: bytes) -> Iterator[_Entry]:
    at = 0
    while at < len(data):
        _need(data, at, _SEGMENT.size, "a segment")
        magic, version, count, codec = _SEGMENT.unpack_from(data, at)
        if magic not in _FILE_MAGICS or version >> 21 != VERSION:
            found = f"{magic!r}, major version {version >> 21}"
            raise FormatError("not a segment that is known", place=f"byte {at}", value=found, expected="version 32")
        at += _SEGMENT.size
        found_entries = []
        for _ in range(count):
            _need(data, at, _ENTRY.size, "a grid's entry")
            fields = _ENTRY.unpack_from(data, at)
            at += _ENTRY.size
            length = fields[21]
            _need(data, at, length, "a grid's name")
            name = data[at : at + length].split(b"\0")[0].decode("utf-8", "replace")
            at += length
            found_entries.append((name, fields[0], fields[1], fields[29]))
        for name, size, packed, own_codec in found_entries:
            _need(data, at, packed, f"grid {name}")
            if own_codec != codec or codec >= len(_CODECS):
                found = f"{codec} for the segment, {own_codec} for grid {name}"
                raise FormatError("a codec that is not known", value=found, expected=", ".join(_CODECS) + " (0, 1, 2)")
            yield _Entry(name, at, packed, size, codec)
            at += packed


def _bare_grids(data: bytes) -> Iterator[_Entry]:
    at = 0
    while at < len(data):
        _need(data, at, GRID_HEADER, "a grid's header")
        size = int.from_bytes(data[at + 32 : at + 40], "little")
        if size < GRID_HEADER:
            raise FormatError("a grid's size", place=f"byte {at + 32}", value=size, expected=f"at least {GRID_HEADER}")
        _need(data, at, size, "a grid")
        name = data[at + 40 : at + 296].split(b"\0")[0].decode("utf-8", "replace")
        yield _Entry(name, at, size, size, 0)
        at += size


def _unpacked(data: bytes, entry: _Entry) -> bytes | memoryview:
    if not GRID_HEADER <= entry.size <= MOST_BYTES:
        expected = f"{GRID_HEADER} to {MOST_BYTES} bytes"
        raise FormatError("a grid's size", place=f"grid {entry.name}", value=entry.size, expected=expected)
    packed = memoryview(data)[entry.offset : entry.offset + entry.packed]
    if entry.codec == 0:
        grid: bytes | memoryview = packed
    else:
        unpack = _unzip if entry.codec == 1 else _unblosc
        made = bytearray()
        for chunk in _chunks(packed, entry):
            made += unpack(chunk, entry.size - len(made))
        grid = bytes(made)
    if len(grid) < entry.size:
        raise FormatError("a grid's bytes", place=f"grid {entry.name}", value=len(grid), expected=f"{entry.size}")
    magic, major = bytes(grid[:8]), _major(bytes(grid[16:20]), 0)
    if magic not in _GRID_MAGICS or major != VERSION:
        found = f"{magic!r}, major version {major}"
        raise FormatError("not a grid that is known", place=f"grid {entry.name}", value=found, expected="version 32")
    return grid


def _chunks(packed: memoryview, entry: _Entry) -> Iterator[memoryview]:
    at = 0
    while at < len(packed):
        size = int.from_bytes(packed[at : at + 8], "little")
        at += 8
        if not 0 < size <= len(packed) - at:
            expected = f"1 to {max(len(packed) - at, 0)} bytes"
            raise FormatError("a packed chunk's size", place=f"grid {entry.name}", value=size, expected=expected)
        yield packed[at : at + size]
        at += size


def _unzip(chunk: memoryview, most: int) -> bytes:
    stream = zlib.decompressobj()
    try:
        made = stream.decompress(chunk, most) if most else b""
    except zlib.error as error:
        raise FormatError(f"broken ZIP data ({error})", expected="a zlib stream") from error
    if not stream.eof and (stream.unconsumed_tail or not most):
        raise FormatError("more data than the grid's size", value=f"over {most} bytes", expected="as many as it says")
    return made


def _unblosc(chunk: memoryview, most: int) -> bytes:
    try:
        import blosc
    except ImportError:
        expected = "pip install 'destello[volumes]'"
        raise InputError("blosc, which unpacks this file, is not installed", expected=expected) from None
    if len(chunk) < _BLOSC.size:
        raise FormatError("a Blosc chunk's header", value=len(chunk), expected=f"{_BLOSC.size} bytes")
    *_, unpacked, _, packed = _BLOSC.unpack_from(chunk)
    if unpacked > most or packed != len(chunk):
        expected = f"at most {most} from {len(chunk)}"
        raise FormatError("a Blosc chunk's sizes", value=f"{unpacked} bytes from {packed}", expected=expected)
    try:
        made = bytes(blosc.decompress(bytes(chunk)))
    except Exception as error:  # the package's own error is no class of its own
        raise FormatError(f"broken Blosc data ({error})", expected="a Blosc 1 chunk") from error
    if len(made) != unpacked:
        raise FormatError("a Blosc chunk's size", value=len(made), expected=str(unpacked))
    return made
