"""The two packages that glTF comes in: JSON text (.gltf) and binary (.glb)."""

from __future__ import annotations

import struct
from pathlib import Path

from destello.errors import FormatError, MissingFileError
from destello.io._gltf_json import Item, parse

_MAGIC = b"glTF"
_JSON, _BIN = 0x4E4F534A, 0x004E4942


def read(path: Path) -> tuple[Item, bytes | None]:
    """The JSON's root and the binary chunk, if any. What a file is, its first bytes tell, not its name."""
    try:
        data = path.read_bytes()
    except OSError as error:
        raise MissingFileError([path], reason=error.strerror or "", expected="a readable file") from None
    if data.startswith(_MAGIC):
        return _binary(data, path)
    if path.suffix.lower() == ".glb":
        raise FormatError("not a .glb file", file=path, value=data[:4], expected="a file that begins with glTF")
    return parse(data, path), None


def _binary(data: bytes, path: Path) -> tuple[Item, bytes | None]:
    def broken(problem: str, value: object, expected: str) -> FormatError:
        return FormatError(problem, file=path, value=value, expected=expected)

    if len(data) < 20:
        raise broken("truncated: no room for the header", len(data), "at least 20 bytes")
    version, length = struct.unpack_from("<II", data, 4)
    if version != 2:
        raise broken("unknown version of .glb", version, "2")
    if length > len(data):
        raise broken(
            "truncated: the header announces more bytes than the file has", length, f"{len(data)} bytes or fewer"
        )
    chunks: dict[int, bytes] = {}
    at = 12
    while at + 8 <= length:
        size, kind = struct.unpack_from("<II", data, at)
        at += 8
        if size > length - at:
            raise broken(
                f"truncated: the chunk at byte {at - 8} reaches beyond the end", size, f"at most {length - at} bytes"
            )
        chunks.setdefault(kind, data[at : at + size])
        at += size + (-size) % 4
    if _JSON not in chunks:
        raise broken("no JSON chunk", [f"{kind:#010x}" for kind in chunks], f"a chunk of type {_JSON:#010x}")
    return parse(chunks[_JSON], path, "JSON chunk"), chunks.get(_BIN)
