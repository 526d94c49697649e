"""Images that are embedded in a scene file: bytes to texels."""

from __future__ import annotations

import tempfile
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from destello import ktx2
from destello.errors import Error, FormatError
from destello.images import read_texels

_SUFFIXES = {b"\x89PNG\r\n\x1a\n": ".png", b"\xff\xd8\xff": ".jpg", b"RIFF": ".webp"}
_RATIO = 2000  # bytes of texels for each byte of an image; beyond, only small ones are believed
_ALWAYS = 1 << 28  # bytes of texels


def decode(data: bytes, *, file: Path, place: str) -> NDArray[np.generic]:
    """(height, width, 1 to 4) uint8 or uint16 texels, top row first, of a PNG, JPEG, WebP or KTX2 image.

    Raises FormatError, which names `file` and `place`.
    """
    if data.startswith(ktx2.MAGIC):
        try:
            data = ktx2.to_png(data)
        except Error as error:
            raise error.within(place, file=file) from None
    suffix = next((suffix for magic, suffix in _SUFFIXES.items() if data.startswith(magic)), None)
    if suffix is None:
        raise FormatError(
            "unknown kind of image", file=file, place=place, value=data[:12], expected="PNG, JPEG, WebP or KTX2"
        )
    with tempfile.TemporaryDirectory(prefix="destello-") as folder:  # OpenImageIO's Python bindings read files only
        path = Path(folder, f"image{suffix}")
        path.write_bytes(data)
        try:
            _check_size(path, len(data))
            texels: NDArray[np.generic] = read_texels(path)
        except Error as error:
            why = f"{error.problem}: {error.value}" if error.value else error.problem
            why = why.replace(str(path), "it")
            raise FormatError(f"embedded image: {why}", file=file, place=place, expected=error.expected) from None
    return texels


def _check_size(path: Path, size: int) -> None:
    import OpenImageIO as oiio

    source = oiio.ImageInput.open(str(path))
    if source is None:
        oiio.geterror()
        return  # read_texels says why
    spec = source.spec()
    source.close()
    texels = spec.width * spec.height * spec.nchannels
    if texels > max(_RATIO * size, _ALWAYS):
        raise FormatError(f"{spec.width} x {spec.height} texels cannot be in {size} bytes", file=path)
