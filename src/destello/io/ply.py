"""Reads PLY, text and binary: one mesh. Vertex colours, as display colours, paint it; else it is grey.

Polygons become triangles; triangle strips (element tristrips, -1 between them) are read, too. Coordinates are kept:
metres, y up; v = 0 is the bottom of an image.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from destello.errors import FormatError
from destello.io._arrays import check_finite, check_indices
from destello.io._defaults import LoadOptions
from destello.io._mesh_scene import add_mesh, complete, grey, linear_colors, new_scene, painted, read_bytes
from destello.io._ply_parse import Element, parse
from destello.io._polygons import triangulate
from destello.scene import Scene

_UV_NAMES = (("u", "v"), ("s", "t"), ("texture_u", "texture_v"), ("texture_s", "texture_t"))
_COLOR_NAMES = (("red", "green", "blue"), ("r", "g", "b"), ("diffuse_red", "diffuse_green", "diffuse_blue"))
_INDEX_NAMES = ("vertex_indices", "vertex_index")


def load(path: Path, options: LoadOptions) -> Scene:
    """The scene in a .ply file. Raises FormatError, with the line or the row of what is wrong."""
    elements = parse(read_bytes(path), path)
    scene = new_scene(path, options)
    arrays = _vertices(elements, path)
    positions = arrays["positions"]
    indices = np.concatenate([_faces(elements, positions, path), _strips(elements, len(positions), path)])
    if len(indices) == 0:
        raise FormatError(
            "no faces",
            file=path,
            value=", ".join(f"{e.name} ({e.count})" for e in elements.values()),
            expected="element face",
        )
    if "face" in elements and "texcoord" in elements["face"].lists:
        scene.notes.append("texture coordinates of faces are ignored")
    material = painted() if "colors" in arrays else grey()
    add_mesh(scene, path, material, {"indices": indices.astype(np.uint32), **arrays})
    return complete(scene, options)


def _vertices(elements: dict[str, Element], path: Path) -> dict[str, NDArray[np.float32]]:
    """The arrays of the mesh shape that come from element vertex."""
    vertex = elements.get("vertex")
    positions = None if vertex is None else vertex.stack(("x", "y", "z"))
    if vertex is None or positions is None:
        raise FormatError(
            "no vertices", file=path, value=", ".join(elements) or None, expected="element vertex with x, y and z"
        )
    check_finite(positions, "vertex", file=path)  # type: ignore[arg-type]
    with np.errstate(over="ignore", invalid="ignore"):
        arrays = {"positions": positions.astype(np.float32)}
        normals = vertex.stack(("nx", "ny", "nz"))
        if normals is not None:
            arrays["normals"] = normals.astype(np.float32)
        uvs = next((found for names in _UV_NAMES if (found := vertex.stack(names)) is not None), None)
        if uvs is not None:
            check_finite(uvs, "texture coordinate", file=path)  # type: ignore[arg-type]
            arrays["uvs"] = uvs.astype(np.float32)
    colors = _colors(vertex)
    if colors is not None:
        arrays["colors"] = colors
    return arrays


def _colors(vertex: Element) -> NDArray[np.float32] | None:
    for names in _COLOR_NAMES:
        if all(name in vertex.scalars for name in names):
            used = (*names, "alpha") if "alpha" in vertex.scalars else names
            kinds = {p.name: p.type for p in vertex.properties}
            full = [float(np.iinfo(kinds[name]).max) if kinds[name][0] != "f" else 1.0 for name in used]
            columns = [vertex.scalars[name].astype(np.float64) / top for name, top in zip(used, full, strict=True)]
            return linear_colors(np.stack(columns, axis=1))
    return None


def _faces(elements: dict[str, Element], positions: NDArray[np.float32], path: Path) -> NDArray[np.int64]:
    """(T, 3) vertex numbers of element face."""
    face = elements.get("face")
    if face is None or face.count == 0:
        return np.zeros((0, 3), np.int64)
    name = next((name for name in _INDEX_NAMES if name in face.lists), None)
    if name is None:
        names = ", ".join(p.name for p in face.properties)
        raise FormatError(
            "no vertex numbers in element face",
            file=path,
            line=face.line,
            value=names or None,
            expected="a list vertex_indices",
        )
    sizes, flat = face.lists[name]
    corners = _whole(flat, len(positions), f"{name} of element face", path)
    triangles, _ = triangulate(positions.astype(np.float64), corners, sizes)
    return corners[triangles]


def _strips(elements: dict[str, Element], vertices: int, path: Path) -> NDArray[np.int64]:
    """(T, 3) vertex numbers of element tristrips: lists of strips that end with -1."""
    strips = elements.get("tristrips")
    name = None if strips is None else next((name for name in _INDEX_NAMES if name in strips.lists), None)
    if strips is None or name is None:
        return np.zeros((0, 3), np.int64)
    sizes, flat = strips.lists[name]
    values = np.asarray(flat).astype(np.float64)
    keep = values != -1
    _whole(values[keep], vertices, f"{name} of element tristrips", path)
    numbers = np.where(keep, values, -1).astype(np.int64)
    strip = np.repeat(np.arange(strips.count), sizes)
    begins = np.r_[True, (numbers[:-1] == -1) | (strip[1:] != strip[:-1])] if len(numbers) else np.zeros(0, bool)
    place = np.arange(len(numbers)) - np.maximum.accumulate(np.where(begins, np.arange(len(numbers)), 0))
    i = np.flatnonzero(place[2:] >= 2) if len(numbers) > 2 else np.zeros(0, np.int64)
    odd = place[i] & 1
    triangles = np.stack([numbers[i], numbers[i + 1 + odd], numbers[i + 2 - odd]], axis=1)
    return triangles[(triangles >= 0).all(axis=1)]


def _whole(values: NDArray[np.generic], vertices: int, place: str, path: Path) -> NDArray[np.int64]:
    """Vertex numbers as integers, in range."""
    numbers = np.asarray(values).astype(np.float64)
    bad = numbers != np.floor(numbers)
    if bad.any():
        first = int(np.argmax(bad))
        raise FormatError(
            f"index {first} is not whole", file=path, place=place, value=float(numbers[first]), expected="whole numbers"
        )
    whole = numbers.clip(-1, 2**53).astype(np.int64)
    check_indices(whole, vertices, "a vertex", file=path, place=place)
    return whole
