"""MTL's bump maps (`bump`, `map_bump`): many a program writes normal maps there, which their texels tell.

Blender since 3.2 means normal maps whatever they hold, but its older versions wrote heights: grey images.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from destello.errors import Error
from destello.files import ResolvedFiles
from destello.images import read_texels
from destello.io._obj_mtl import Material

_SIDE = 256  # texels that are looked at along each side, about


def settle(blocks: Sequence[Material], files: ResolvedFiles, mtl: Path) -> list[str]:
    """Makes those that are normal maps `norm`, where there is none, and returns a note of all others.

    Others are heights, of which MTL does not say the unit, or cannot be read.
    """
    seen: dict[tuple[str, bool], bool] = {}
    left = []
    for block in blocks:
        bump = block.maps.pop("bump", None)
        if bump is None or "norm" in block.maps:
            continue
        key = (bump.path, block.blender)
        if key not in seen:
            seen[key] = _is_normal_map(bump.path, files, blender=block.blender)
        if seen[key]:
            block.maps["norm"] = bump
        else:
            left.append((block, bump))
    if not left:
        return []
    block, bump = left[0]
    more = f"; {len(left) - 1} more" if len(left) > 1 else ""
    why = "heights, of which MTL has no unit (accepted: a normal map)"
    return [f"{mtl.name}:{bump.line}: newmtl {block.name}: the bump map is left out: {why}{more}"]


def _is_normal_map(path: str, files: ResolvedFiles, *, blender: bool) -> bool:
    try:
        found = files.find(path)
        texels = None if found is None else read_texels(found)
    except Error:  # out of bounds, or no image
        texels = None
    if texels is None:
        return blender  # which is told of as any other image that is not there
    return (blender and not _is_grey(texels)) or holds_normals(texels)


def _is_grey(texels: NDArray[Any]) -> bool:
    return texels.shape[2] < 3 or bool((texels[..., :1] == texels[..., 1:3]).all())


def holds_normals(texels: NDArray[Any]) -> bool:
    """Are the texels (height, width, channels) unit vectors that point up, x, y and z by 2 c - 1?"""
    if texels.shape[2] < 3:
        return False
    height, width = texels.shape[:2]
    some = texels[:: max(height // _SIDE, 1), :: max(width // _SIDE, 1), :3]
    most = np.iinfo(some.dtype).max if some.dtype.kind == "u" else 1
    vectors = 2 * (some.astype(np.float32) / most) - 1
    units = np.abs(np.linalg.norm(vectors, axis=-1) - 1) < 0.15
    x, y, z = np.abs(vectors.mean(axis=(0, 1)))
    up = (vectors[..., 2] > 0).mean()
    return bool(units.mean() > 0.9 and up > 0.9 and z > 2 * max(x, y))
