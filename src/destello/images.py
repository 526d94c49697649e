"""Reading image files for textures, in the number type in which they are stored."""

from __future__ import annotations

import math
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from destello import ktx2
from destello.errors import Error, FormatError, ImageTooLarge

if TYPE_CHECKING:
    from numpy.typing import NDArray

LARGEST_SIDE = 65536  # px
LARGEST_BYTES = 8 << 30
_LEAST_TURN = 0.001  # degrees; files hold right angles as rounded radians


def read_texels(path: Path) -> NDArray[Any]:
    """The texels of an image file: (height, width, 1 to 4) uint8, uint16, float16 or float32, top row first.

    Channels are those called R, G, B, A where names tell; in a file of nothing but layers those of the first layer with
    alpha, or else of the first; where none is called so, the first four. Alpha stays as the file has it
    (`alpha_is_associated`). Raises FormatError if the file cannot be read, ImageTooLarge if it is beyond what can be
    held.
    """
    import OpenImageIO as oiio

    with path.open("rb") as stream:
        if stream.read(len(ktx2.MAGIC)) == ktx2.MAGIC:
            return _from_ktx2(path)
    hints = oiio.ImageSpec()
    hints.attribute("oiio:UnassociatedAlpha", 1)
    file = oiio.ImageInput.open(str(path), hints)
    if file is None:
        raise FormatError("not a readable image", file=path, value=_reason(oiio.geterror()), expected=_KNOWN)
    try:
        spec = file.spec()
        kind = _kind(oiio, spec.format)
        channels = _channels(list(spec.channelnames))
        window = _window(spec, file.format_name())
        _check_size(path, spec, window, kind, len(channels))
        texels = file.read_image(0, 0, 0, max(channels) + 1, _type(oiio, kind))
        if texels is None:
            raise FormatError("the image is damaged", file=path, value=_reason(file.geterror()), expected=_KNOWN)
    finally:
        file.close()
    texels = np.asarray(texels).reshape(spec.height, spec.width, -1)
    if channels != list(range(texels.shape[2])):
        texels = texels[:, :, channels]
    texels = _placed(texels, spec, window)
    return np.ascontiguousarray(texels, dtype=kind)


def alpha_is_associated(path: Path) -> bool:
    """Whether the colours of an image file are multiplied by its alpha: those of EXR always, of TIFF if it says so."""
    import OpenImageIO as oiio

    hints = oiio.ImageSpec()
    hints.attribute("oiio:UnassociatedAlpha", 1)
    file = oiio.ImageInput.open(str(path), hints)
    if file is None:
        oiio.geterror()
        return False
    spec = file.spec()
    known = file.format_name() in ("openexr", "tiff")
    file.close()
    return known and spec.alpha_channel >= 0 and not spec.getattribute("oiio:UnassociatedAlpha")


def unassociated(texels: NDArray[Any]) -> NDArray[Any]:
    """Texels (height, width, 2 or 4) whose colours are divided by their alpha; where it is 0, they stay."""
    alpha = texels[..., -1:].astype(np.float32)
    integer = texels.dtype.kind == "u"
    most = float(np.iinfo(texels.dtype).max) if integer else float(np.finfo(texels.dtype).max)
    share = np.where(alpha > 0, alpha / np.float32(most if integer else 1), np.float32(1))
    with np.errstate(over="ignore"):
        colors = np.clip(texels[..., :-1] / share, -most, most)
    made = texels.copy()
    made[..., :-1] = np.rint(colors) if integer else colors
    return made


def _from_ktx2(path: Path) -> NDArray[Any]:
    try:
        png = ktx2.to_png(path.read_bytes())
    except Error as error:
        raise error.within(None, file=path) from None
    with tempfile.TemporaryDirectory(prefix="destello-") as folder:  # OpenImageIO's Python bindings read files only
        decoded = Path(folder, "image.png")
        decoded.write_bytes(png)
        return read_texels(decoded)


def repaired(texels: NDArray[Any]) -> tuple[NDArray[Any], int]:
    """Texels that are all finite, and how many were not: these become 0."""
    if texels.dtype.kind != "f":
        return texels, 0
    finite = np.isfinite(texels)
    bad = texels.size - int(np.count_nonzero(finite))
    return (np.where(finite, texels, texels.dtype.type(0)), bad) if bad else (texels, 0)


_KNOWN = "PNG, JPEG, TIFF, BMP, TGA, HDR, EXR and what else OpenImageIO reads; KTX2"


def _reason(text: str) -> str | None:
    lines = text.strip().splitlines()
    return lines[0] if lines else None


def _kind(oiio: Any, stored: Any) -> str:
    if stored.basetype in (oiio.UINT8, oiio.INT8):
        return "uint8"
    if stored.basetype == oiio.HALF:
        return "float16"
    return "uint16" if stored.basetype in (oiio.UINT16, oiio.INT16) else "float32"


def _type(oiio: Any, kind: str) -> Any:
    return {"uint8": oiio.UINT8, "uint16": oiio.UINT16, "float16": oiio.HALF, "float32": oiio.FLOAT}[kind]


def _channels(names: Sequence[str]) -> list[int]:
    """Which channels to take, in the order red, green, blue, alpha."""
    layers: dict[str, dict[str, int]] = {"": {}}
    for index, name in enumerate(names):
        layer, _, channel = name.lower().rpartition(".")
        layers.setdefault(layer, {}).setdefault(channel, index)
    plain = layers[""]
    colored = [layer for layer in layers.values() if all(c in layer for c in "rgb")]
    if "y" in plain and "x" not in plain and plain not in colored:
        return [plain[c] for c in "ya" if c in plain]
    if colored and ("r" not in plain or plain in colored):
        best = plain if plain in colored else next((layer for layer in colored if "a" in layer), colored[0])
        return [best[c] for c in "rgba" if c in best]
    return list(range(min(len(names), 4)))


def _window(spec: Any, format_name: str) -> tuple[int, int, int, int]:
    """Left, top, width and height of the picture: an EXR may hold a part of it, or more (data and display window)."""
    if format_name == "openexr":
        return spec.full_x, spec.full_y, spec.full_width, spec.full_height
    return spec.x, spec.y, spec.width, spec.height


def _placed(texels: NDArray[Any], spec: Any, window: tuple[int, int, int, int]) -> NDArray[Any]:
    """The part of texels within the window, where it belongs; the rest is 0."""
    if window == (spec.x, spec.y, spec.width, spec.height):
        return texels
    left, top = spec.x - window[0], spec.y - window[1]
    made = np.zeros((window[3], window[2], texels.shape[2]), texels.dtype)
    part = texels[max(-top, 0) : max(window[3] - top, 0), max(-left, 0) : max(window[2] - left, 0)]
    made[max(top, 0) : max(top, 0) + part.shape[0], max(left, 0) : max(left, 0) + part.shape[1]] = part
    return made


def _check_size(path: Path, spec: Any, window: tuple[int, int, int, int], kind: str, channels: int) -> None:
    size = window[2:]
    if spec.depth > 1 or spec.deep:
        raise FormatError("not a flat picture", file=path, expected="one picture without depth")
    if min(size) < 1 or max(size) > LARGEST_SIDE:
        raise ImageTooLarge("image size", file=path, value=size, expected=f"1 to {LARGEST_SIDE} px a side")
    needed = max(spec.width * spec.height, size[0] * size[1]) * channels * np.dtype(kind).itemsize
    if needed > LARGEST_BYTES:
        raise ImageTooLarge(
            f"the image needs {needed >> 20} MiB", file=path, value=size, expected=f"at most {LARGEST_BYTES >> 20} MiB"
        )


def linear_rgb(texels: NDArray[Any], color_space: str, working: str = "rec709") -> NDArray[np.float32]:
    """Texels as linear RGB of the working space: (height, width, 3) float32, at least 0. See `textures.image`."""
    from destello.color_spaces import ENCODINGS, converted

    values = texels.astype(np.float32)
    if texels.dtype.kind == "u":
        values /= np.float32(np.iinfo(texels.dtype).max)
    if values.shape[2] < 3:
        values = np.repeat(values[:, :, :1], 3, axis=2)
    values = values[:, :, :3]
    if color_space == "auto":
        color_space = "srgb" if texels.dtype.kind == "u" else "linear"
    if color_space != "raw":
        primaries, decode = ENCODINGS[color_space]
        values = converted(decode(values), primaries, working)
    return np.ascontiguousarray(np.maximum(values, np.float32(0)))


def turned_directions(texels: NDArray[Any], scale: Sequence[float], degrees: float) -> NDArray[Any]:
    """Texels (height, width, channels) whose first two are a direction along an image's axes, as (x + 1) / 2, along the
    mesh's u and v instead. `scale`, `degrees`: of the texture (`uv_scale`, `uv_rotation`).

    8-bit and 16-bit texels stay so where the axes only change places, else they become half and single precision.
    """
    mirror_x, mirror_y = (s < 0 for s in scale)
    quarters = round(degrees / 90)
    even = abs(degrees - 90 * quarters) < _LEAST_TURN
    if texels.shape[2] < 3 or (even and quarters % 4 == 0 and not (mirror_x or mirror_y)):
        return texels
    if texels.dtype.kind == "u" and not even:
        kind = {"uint8": np.float16, "uint16": np.float32}[texels.dtype.name]
        texels = (texels / np.float32(np.iinfo(texels.dtype).max)).astype(kind)
    one = np.iinfo(texels.dtype).max if texels.dtype.kind == "u" else 1
    made = texels.copy()
    x, y = texels[..., 0], texels[..., 1]
    if even:
        x, y = ((x, y), (y, one - x), (one - x, one - y), (one - y, x))[quarters % 4]
    else:
        c, s = math.cos(math.radians(degrees)), math.sin(math.radians(degrees))
        dx, dy = (channel.astype(np.float32) - np.float32(0.5) for channel in (x, y))
        x, y = 0.5 + c * dx + s * dy, 0.5 - s * dx + c * dy
    made[..., 0], made[..., 1] = one - x if mirror_x else x, one - y if mirror_y else y
    return made


def missing_image() -> NDArray[np.uint8]:
    """The visible stand-in for a missing image: a checker of magenta and black, (8, 8, 3) uint8."""
    rows, columns = np.indices((8, 8))
    return np.where(((rows + columns) % 2 == 0)[:, :, np.newaxis], (255, 0, 255), (0, 0, 0)).astype(np.uint8)
