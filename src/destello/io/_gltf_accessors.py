"""glTF's buffers, views and accessors as NumPy arrays. Nothing is read or taken beyond what the file really holds."""

from __future__ import annotations

import base64
import binascii
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from destello.io._gltf_compression import MESHOPT, can_decode, decode_meshopt
from destello.io._gltf_json import Document, Item

_COMPONENTS: dict[int, np.dtype[Any]] = {
    5120: np.dtype("<i1"),
    5121: np.dtype("<u1"),
    5122: np.dtype("<i2"),
    5123: np.dtype("<u2"),
    5125: np.dtype("<u4"),
    5126: np.dtype("<f4"),
}
_WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT4": 16}
_NAMES = "5120 (i8), 5121 (u8), 5122 (i16), 5123 (u16), 5125 (u32), 5126 (f32)"
_LARGEST_EMPTY = 1 << 20  # elements of an accessor that no bytes of the file stand behind

Array = NDArray[np.generic]


class Buffers:
    """Access to the binary data of a document.

    Args:
        document: the glTF file.
        binary: the binary chunk of a .glb, which is buffer 0.
        read: reads the file that a buffer names by a relative URI.
    """

    def __init__(self, document: Document, binary: bytes | None, read: Callable[[Item, str], bytes]) -> None:
        self.document = document
        self._binary = binary
        self._read = read
        self._buffers: dict[int, memoryview] = {}
        self._arrays: dict[int, Array] = {}
        self._floats: dict[int, NDArray[np.float32]] = {}
        self._views: dict[int, memoryview] = {}  # decompressed

    # --- bytes --------------------------------------------------------------------------------------------------------

    def buffer(self, item: Item) -> memoryview:
        """The bytes of a buffer."""
        if item.index not in self._buffers:
            length = item.integer("byteLength", low=1)
            data = self._buffer_bytes(item)
            if len(data) < length:
                raise item.error(
                    "larger than its data",
                    "byteLength",
                    value=length,
                    expected=f"at most the {len(data)} bytes there are",
                )
            self._buffers[item.index] = memoryview(data)[:length]
        return self._buffers[item.index]

    def _buffer_bytes(self, item: Item) -> bytes:
        if "uri" in item:
            uri = item.text("uri")
            return data_uri(item, uri) if uri.startswith("data:") else self._read(item, uri)
        if item.index != 0 or self._binary is None:
            raise item.error(
                "missing", "uri", expected="a URI: only the first buffer of a .glb file has its data inside"
            )
        return self._binary

    def total_bytes(self) -> int:
        """How much binary data has been read so far."""
        return sum(len(data) for data in self._buffers.values())

    def view(self, item: Item) -> memoryview:
        """The bytes of a buffer view, decompressed if need be."""
        for name in MESHOPT:
            packed = item.extension(name)
            if packed is None:
                continue
            if can_decode(item, self.document, name, "almeshopt", plain=self._has_data(item)):
                if item.index not in self._views:
                    self._views[item.index] = memoryview(decode_meshopt(packed, bytes(self._slice(packed))))
                return self._views[item.index]
        return self._slice(item)

    def _has_data(self, view: Item) -> bool:
        """Whether the buffer of a view has data; one that stands for decompressed bytes need not."""
        buffer = self.document.refer(view, "buffer", "buffers", required=True)
        assert buffer is not None
        return "uri" in buffer or (buffer.index == 0 and self._binary is not None)

    def _slice(self, item: Item) -> memoryview:
        buffer = self.document.refer(item, "buffer", "buffers", required=True)
        assert buffer is not None
        data = self.buffer(buffer)
        offset = item.integer("byteOffset", 0, high=len(data))
        length = item.integer("byteLength", low=1)
        if length > len(data) - offset:
            raise item.error(
                "reaches beyond its buffer",
                "byteLength",
                value=length,
                expected=f"at most {len(data) - offset} from byte {offset}",
            )
        return data[offset : offset + length]

    def replace(self, item: Item, values: Array) -> None:
        """Puts decompressed values, (count, width), in the place of an accessor's. FormatError if they do not fit."""
        shape = (item.integer("count", low=1), _WIDTHS.get(item.text("type")))
        if values.shape != shape:
            raise item.error("other elements in the compressed data", value=values.shape, expected=f"{shape}")
        array: Array = np.ascontiguousarray(values, _component_type(item))
        array.flags.writeable = False
        self._arrays[item.index] = array
        self._floats.pop(item.index, None)

    # --- arrays -------------------------------------------------------------------------------------------------------

    def floats(self, item: Item, types: tuple[str, ...]) -> NDArray[np.float32]:
        """(count, width) float32: integers as they are, or brought into [0, 1] or [-1, 1] if they are normalized."""
        raw = self._array(item, types)
        if item.index not in self._floats:
            values = raw.astype(np.float32, copy=False)
            if raw.dtype.kind != "f" and item.flag("normalized"):
                largest = {1: 127, 2: 32767, 4: 2**31 - 1}[raw.dtype.itemsize]
                largest = largest * 2 + 1 if raw.dtype.kind == "u" else largest
                values = np.maximum(values / largest, -1).astype(np.float32)
            self._floats[item.index] = values
        return self._floats[item.index]

    def indices(self, item: Item) -> NDArray[np.uint32]:
        """(count,) uint32 of a SCALAR accessor of unsigned integers."""
        return self._unsigned(item, ("SCALAR",))[:, 0]

    def joints(self, item: Item) -> NDArray[np.uint32]:
        """(count, 4) uint32 of a VEC4 accessor of unsigned integers."""
        return self._unsigned(item, ("VEC4",))

    def _unsigned(self, item: Item, types: tuple[str, ...]) -> NDArray[np.uint32]:
        if item.integer("componentType") not in (5121, 5123, 5125):
            raise item.error(
                "wrong value",
                "componentType",
                value=item.data["componentType"],
                expected="5121 (u8), 5123 (u16) or 5125 (u32)",
            )
        return self._array(item, types).astype(np.uint32, copy=False)

    def _array(self, item: Item, types: tuple[str, ...]) -> Array:
        """(count, width) in the accessor's own type; kept, since several primitives may share it."""
        kind = item.choice("type", types)
        if item.index not in self._arrays:
            width = _WIDTHS[kind]
            dtype = _component_type(item)
            count = item.integer("count", low=1)
            sparse = item.item("sparse")
            array = self._dense(item, dtype, count, width)
            if sparse is not None:
                array = self._patched(array, sparse)
            array.flags.writeable = False
            self._arrays[item.index] = array
        return self._arrays[item.index]

    def _dense(self, item: Item, dtype: np.dtype[np.generic], count: int, width: int) -> Array:
        view = self.document.refer(item, "bufferView", "bufferViews")
        if view is None:
            if count > _LARGEST_EMPTY:
                raise item.error(
                    "too many elements without data",
                    "count",
                    value=count,
                    expected=f"at most {_LARGEST_EMPTY} without a bufferView",
                )
            return np.zeros((count, width), dtype)
        stride = view.integer("byteStride", dtype.itemsize * width, low=1, high=252) if "byteStride" in view else None
        return _strided(item, self.view(view), dtype, count, width, stride)

    def _patched(self, array: Array, sparse: Item) -> Array:
        count = sparse.integer("count", low=1, high=len(array))
        parts = []
        for key, width in (("indices", 1), ("values", array.shape[1])):
            part = sparse.item(key)
            if part is None:
                raise sparse.error("missing", key, expected="a JSON object")
            view = self.document.refer(part, "bufferView", "bufferViews", required=True)
            assert view is not None
            dtype = _component_type(part) if key == "indices" else array.dtype
            if key == "indices" and dtype.kind != "u":
                raise part.error(
                    "wrong value", "componentType", value=part.data["componentType"], expected="5121, 5123 or 5125"
                )
            parts.append(_strided(part, self.view(view), dtype, count, width, None))
        where, values = parts[0][:, 0].astype(np.int64), parts[1]
        if where.max() >= len(array):
            raise sparse.error(
                "index out of range", "indices", value=int(where.max()), expected=f"0 to {len(array) - 1}"
            )
        patched = array.copy()
        patched[where] = values
        return patched


def _component_type(item: Item) -> np.dtype[Any]:
    code = item.integer("componentType")
    if code not in _COMPONENTS:
        raise item.error("wrong value", "componentType", value=code, expected=_NAMES)
    return _COMPONENTS[code]


def _strided(
    item: Item, data: memoryview, dtype: np.dtype[np.generic], count: int, width: int, stride: int | None
) -> Array:
    size = dtype.itemsize * width
    step = size if stride is None else stride
    if step < size:
        raise item.error(
            f"its elements overlap: they take {size} bytes each",
            "bufferView",
            value=step,
            expected="a larger byteStride",
        )
    offset = item.integer("byteOffset", 0)
    needed = offset + step * (count - 1) + size
    if needed > len(data):
        raise item.error(
            f"larger than its buffer view of {len(data)} bytes",
            value=needed,
            expected=f"at most {len(data)} bytes from byteOffset on",
        )
    array: Array = np.ndarray((count, width), dtype, data, offset, (step, dtype.itemsize))
    return np.ascontiguousarray(array) if step != size else array.view()


def data_uri(item: Item, uri: str) -> bytes:
    """The bytes of a ``data:...;base64,`` URI."""
    head, comma, body = uri.partition(",")
    if not comma or not head.endswith(";base64"):
        raise item.error("not a base64 data URI", "uri", value=uri[:40], expected="data:<media type>;base64,<data>")
    try:
        return base64.b64decode(body, validate=True)
    except (binascii.Error, ValueError):
        raise item.error("broken base64 data", "uri", value=body[:40], expected="base64 characters") from None
