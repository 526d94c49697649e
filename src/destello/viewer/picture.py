"""What a page is sent: JPEGs, and in them the outline of what is selected."""

from __future__ import annotations

import io

import numpy as np
import numpy.typing as npt
from PIL import Image as Pillow

Bytes = npt.NDArray[np.uint8]

OUTLINE = (255, 140, 26)  # orange, as editors have it


def outline(picture: Bytes, inside: npt.NDArray[np.bool_], thickness: int = 1) -> Bytes:
    """The picture with a line around the pixels `inside` (height, width), half of it on each side of the border."""
    grown, shrunk = inside, inside
    for _ in range(thickness):
        grown, shrunk = _spread(grown), ~_spread(~shrunk)
    line = grown & ~shrunk
    if not line.any():
        return picture
    drawn = picture.copy()
    drawn[line] = OUTLINE
    return drawn


def _spread(mask: npt.NDArray[np.bool_]) -> npt.NDArray[np.bool_]:
    """The mask and the pixels next to it; nothing lies beyond the border, so what is cut off there has no line."""
    out = mask.copy()
    out[1:] |= mask[:-1]
    out[:-1] |= mask[1:]
    out[:, 1:] |= mask[:, :-1]
    out[:, :-1] |= mask[:, 1:]
    return out


def jpeg(picture: Bytes, *, fine: bool) -> bytes:
    """A JPEG: while things move small (quality 80), at rest `fine` (quality 95, chroma in full).

    Pillow comes with viser, and has libjpeg-turbo in it: 1280x720 takes 3 ms (benches/LOG.md).
    """
    buffer = io.BytesIO()
    quality, subsampling = (95, 0) if fine else (80, 2)
    Pillow.fromarray(picture).save(buffer, "jpeg", quality=quality, subsampling=subsampling)
    return buffer.getvalue()
