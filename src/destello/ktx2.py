"""KTX2 files with Basis Universal textures (KHR_texture_basisu), decoded by the package `alktx2`."""

from __future__ import annotations

import importlib.util
import struct

from destello.errors import FormatError, ImageTooLarge

MAGIC = b"\xabKTX 20\xbb\r\n\x1a\n"
_HEADER = struct.Struct("<9I")  # vkFormat, typeSize, width, height, depth, layers, faces, levels, supercompression
_LARGEST_SIDE = 16384
_RATIO = 4096  # texels for each byte: one colour all over compresses like that
_ALWAYS = 1 << 24  # texels that are believed whatever the size


def to_png(data: bytes) -> bytes:
    """The picture in a KTX2 file, as a PNG of 8 bits a channel.

    Sizes are checked before anything is decoded. Raises FormatError, ImageTooLarge, without a file's name; also if
    `alktx2` (the extra `destello[gltf]`) is not installed.
    """
    if len(data) < len(MAGIC) + _HEADER.size or not data.startswith(MAGIC):
        raise FormatError("not a KTX2 file", value=data[:12], expected="a whole KTX2 header")
    kind, _, width, height, depth, layers, faces, _, scheme = _HEADER.unpack_from(data, len(MAGIC))
    if kind != 0:
        raise FormatError("not a Basis Universal texture", value=f"vkFormat {kind}", expected="vkFormat 0")
    if scheme > 2:
        raise FormatError("unknown supercompression", value=scheme, expected="0 (none), 1 (BasisLZ) or 2 (Zstandard)")
    if depth > 0 or layers > 1 or faces != 1:
        raise FormatError("not one flat picture", value=f"depth {depth}, {layers} layers, {faces} faces")
    if not (1 <= width <= _LARGEST_SIDE and 1 <= height <= _LARGEST_SIDE):
        raise ImageTooLarge("image size", value=(width, height), expected=f"1 to {_LARGEST_SIDE} px a side")
    if width * height > max(_RATIO * len(data), _ALWAYS):
        raise FormatError(f"{width} x {height} texels cannot be in {len(data)} bytes")
    if importlib.util.find_spec("alktx2") is None:
        raise FormatError("KTX2 needs the package alktx2", expected="pip install 'destello[gltf]'")
    import alktx2

    try:
        png, _ = alktx2.decode_ktx2_to_bytes(data, format="png")
    except (RuntimeError, ValueError) as error:
        raise FormatError("the KTX2 image is damaged", value=str(error)) from None
    return bytes(png)
