"""Compressed glTF data: KHR_draco_mesh_compression (by DracoPy), EXT_meshopt_compression (by almeshopt).

Both packages come with the extra `destello[gltf]`. Sizes are checked before anything is decoded.
"""

from __future__ import annotations

import importlib.util
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from destello.io._gltf_json import Document, Item

DRACO = "KHR_draco_mesh_compression"
MESHOPT = ("EXT_meshopt_compression", "KHR_meshopt_compression")
COMPRESSIONS = frozenset({DRACO, *MESHOPT})

_RATIO = 1024  # bytes, or triangles, for each byte of compressed data; beyond, only small ones are believed
_ALWAYS = 1 << 20

Array = NDArray[Any]


def can_decode(item: Item, document: Document, extension: str, package: str, *, plain: bool = True) -> bool:
    """Whether `package` is there. If it is not, and the file cannot do without `extension`, FormatError names it.

    `plain`: the file has the same data without the extension, too.
    """
    if importlib.util.find_spec(package) is not None:
        return True
    if not plain or extension in document.root.texts("extensionsRequired"):
        raise item.error(f"{extension} needs the package {package}", expected="pip install 'destello[gltf]'")
    return False


# --- Draco ------------------------------------------------------------------------------------------------------------
def decode_draco(item: Item, data: bytes, triangles: int) -> tuple[NDArray[np.uint32], Callable[[int], Array | None]]:
    """The (M, 3) vertices of the triangles, of which there must be `triangles`; and (N, k) attributes by their id."""
    found = _draco_triangles(data)
    if found is None:
        raise item.error("not a Draco mesh", value=data[:12], expected="a mesh in Draco's bitstream 2.2")
    if found != triangles:
        raise item.error("other triangles in the compressed data", value=found, expected=f"{triangles}, as in indices")
    if triangles > max(_RATIO * len(data), _ALWAYS):
        raise item.error(f"{triangles} triangles cannot be in {len(data)} bytes")
    import DracoPy

    try:
        mesh = DracoPy.decode(data)
    except (RuntimeError, ValueError, TypeError, AttributeError, DracoPy.FileTypeException) as error:
        raise item.error("broken Draco data", value=str(error) or type(error).__name__) from None
    faces = np.asarray(getattr(mesh, "faces", ()), np.uint32).reshape(-1, 3)
    attributes = {a["unique_id"]: np.asarray(a["data"]) for a in mesh.attributes}
    return faces, lambda number: attributes.get(number)


def _draco_triangles(data: bytes) -> int | None:
    """How many triangles a Draco bitstream of version 2.2 says that it has; None if it is no mesh."""
    if data[:5] != b"DRACO" or len(data) < 16 or (data[5], data[6]) != (2, 2) or data[7] != 1:
        return None
    if int.from_bytes(data[9:11], "little") & 0x8000:  # metadata comes first
        return None
    if data[8] == 0:  # sequential: faces, points
        return _varint(data, 11)[0]
    return _varint(data, _varint(data, 12)[1])[0]  # edgebreaker: kind of traversal, vertices, faces


def _varint(data: bytes, at: int) -> tuple[int, int]:
    value, shift = 0, 0
    for i in range(at, min(at + 5, len(data))):
        value |= (data[i] & 0x7F) << shift
        shift += 7
        if data[i] < 0x80:
            return value, i + 1
    return value, at + 5


# --- meshopt ----------------------------------------------------------------------------------------------------------
def decode_meshopt(item: Item, data: bytes) -> bytes:
    """The bytes of a buffer view that the extension object `item` describes, from its compressed `data`."""
    count, stride = item.integer("count", low=1), item.integer("byteStride", low=1, high=256)
    mode = item.choice("mode", ("ATTRIBUTES", "TRIANGLES", "INDICES"))
    kind = item.choice("filter", ("NONE", "OCTAHEDRAL", "QUATERNION", "EXPONENTIAL"), "NONE")
    if count * stride > max(_RATIO * len(data), _ALWAYS):
        raise item.error(f"{count} elements of {stride} bytes cannot be in {len(data)} bytes", "count", value=count)
    if mode == "INDICES":
        raise item.error("no package decodes this", "mode", value=mode, expected="ATTRIBUTES or TRIANGLES")
    if mode == "TRIANGLES":
        return _triangles(item, data, count, stride)
    if stride % 4:
        raise item.error("wrong value", "byteStride", value=stride, expected="a multiple of 4")
    import almeshopt

    try:
        raw = np.asarray(almeshopt.decode_vertex_buffer(data, count, stride, np.uint8))
    except (RuntimeError, ValueError) as error:
        raise item.error("broken meshopt data", value=str(error)) from None
    return _filtered(item, raw.reshape(count, stride), kind).tobytes()


def _triangles(item: Item, data: bytes, count: int, stride: int) -> bytes:
    if stride not in (2, 4):
        raise item.error("wrong value", "byteStride", value=stride, expected="2 or 4")
    if count % 3:
        raise item.error("wrong value", "count", value=count, expected="a multiple of 3")
    import almeshopt

    try:
        indices = np.asarray(almeshopt.decode_index_buffer(data, count))
    except (RuntimeError, ValueError) as error:
        raise item.error("broken meshopt data", value=str(error)) from None
    return indices.astype(np.dtype(f"<u{stride}")).tobytes()


def _filtered(item: Item, raw: NDArray[np.uint8], kind: str) -> Array:
    """(count, stride) bytes after the extension's filter."""
    if kind == "NONE":
        return raw
    if kind == "EXPONENTIAL":
        bits = np.ascontiguousarray(raw).view("<i4")
        with np.errstate(over="ignore"):
            values: Array = np.ldexp(((bits << 8) >> 8).astype(np.float64), bits >> 24).astype("<f4")
            return values
    stride = raw.shape[1]
    if stride not in ((4, 8) if kind == "OCTAHEDRAL" else (8,)):
        raise item.error("wrong value", "byteStride", value=stride, expected="8, or 4 for OCTAHEDRAL")
    values = np.ascontiguousarray(raw).view(f"<i{stride // 4}")
    return _octahedral(values) if kind == "OCTAHEDRAL" else _quaternions(values)


def _octahedral(values: Array) -> Array:
    largest = np.iinfo(values.dtype).max
    v = values.astype(np.float64)
    x, y = v[:, 0] / np.maximum(v[:, 2], 1), v[:, 1] / np.maximum(v[:, 2], 1)
    z = 1 - np.abs(x) - np.abs(y)
    fold = np.minimum(z, 0)
    x, y = x - np.copysign(fold, x), y - np.copysign(fold, y)
    n = np.stack([x, y, z], 1)
    n = np.round(n / np.maximum(np.linalg.norm(n, axis=1, keepdims=True), 1e-30) * largest)
    return np.concatenate([n, v[:, 3:]], 1).astype(values.dtype)


def _quaternions(values: Array) -> Array:
    v = values.astype(np.float64)
    parts = v[:, :3] / (values[:, 3:] | 3) / np.sqrt(2)
    w = np.sqrt(np.maximum(1 - (parts**2).sum(axis=1), 0))
    largest = (values[:, 3] & 3).astype(np.intp)
    rows = np.arange(len(values))
    out = np.zeros_like(v)
    for k, part in enumerate([w, *parts.T]):
        out[rows, (largest + k) % 4] = part
    return np.round(np.clip(out, -1, 1) * 32767).astype(values.dtype)
