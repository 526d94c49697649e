"""Reads Wavefront OBJ with its MTL materials: one mesh for each material; groups and objects are merged.

Faces without normals are flat, or smooth within their smoothing group. Vertex colours (after x y z) are display colours
and are made linear; they count where a face has no material. Coordinates are kept: metres, y up.
"""

from __future__ import annotations

import codecs
from collections import Counter
from pathlib import Path, PurePosixPath
from typing import Any

import numpy as np
from numpy.typing import NDArray

from destello.errors import FormatError
from destello.io._defaults import LoadOptions, ResolvedFiles
from destello.io._mesh_scene import add_mesh, complete, grey, linear_colors, new_scene, painted, read_bytes
from destello.io._obj_bump import settle
from destello.io._obj_materials import convert
from destello.io._obj_mtl import parse as parse_mtl
from destello.io._obj_parse import ObjData, parse
from destello.io._polygons import triangulate
from destello.io._text import unquoted
from destello.nodes import Node
from destello.scene import Scene

Ints = NDArray[np.int64]


def load(path: Path, options: LoadOptions) -> Scene:
    """The scene in an .obj file.

    Raises:
        FormatError: with the line of what is wrong.
        MissingFileError: with all textures that do not exist. A missing .mtl file is only noted: grey materials.
    """
    data = parse(read_bytes(path).removeprefix(codecs.BOM_UTF8), path)
    if len(data.sizes) == 0:
        raise FormatError("no faces", file=path, expected="at least one line that begins with f")
    scene = new_scene(path, options)
    materials = _materials(data, path, options, scene.notes)
    _add_meshes(data, materials, scene, path)
    _note_ignored(data.ignored, scene.notes, path.name)
    if options.complete:
        files = ResolvedFiles(
            path.parent, allow_external=options.allow_external, allow_missing=options.allow_missing, scene_file=path
        )
        for texture in scene.textures():
            if texture.type == "image":
                files.find_any(texture["path"])
        files.finish()
    return complete(scene, options)


# --- materials --------------------------------------------------------------------------------------------------------


def _materials(data: ObjData, path: Path, options: LoadOptions, notes: list[str]) -> list[Node]:
    """A node for each of the names that faces use."""
    found: dict[str, Node] = {}
    files = ResolvedFiles(path.parent, allow_external=options.allow_external, scene_file=path)
    for library in data.libraries:
        for name in _library_files(library, files, notes):
            folder = "" if (parent := PurePosixPath(name).parent) == PurePosixPath(".") else str(parent)
            real = path.parent / name
            blocks, ignored, said = parse_mtl(read_bytes(real), real, folder)
            notes += said + settle(blocks, files, real)
            _note_ignored(ignored, notes, name)
            for block in blocks:
                found.setdefault(block.name, convert(block, real))
    unnamed = painted() if data.colors is not None else grey()
    used = [data.material_names[i] for i in np.unique(data.materials)]
    unknown = [name for name in used if name and name not in found]
    if unknown:
        more = f" and {len(unknown) - 1} more" if len(unknown) > 1 else ""
        notes.append(f"no material {unknown[0]!r}{more} in the .mtl files: grey instead")
    return [found.get(name, unnamed) for name in data.material_names]


def _library_files(library: str, files: ResolvedFiles, notes: list[str]) -> list[str]:
    """The files that a mtllib line means: one name with spaces, or several names."""
    whole = unquoted(library).replace("\\", "/")
    if not whole or files.find(whole, "mtllib") is not None:
        return [whole] if whole else []
    names = []
    for name in whole.split():
        if files.find(name, "mtllib") is not None:
            names.append(name)
        elif (
            len(note := f"missing material file {name if ' ' in whole else whole}: grey instead") and note not in notes
        ):
            notes.append(note)
    return names


def _note_ignored(ignored: Counter[str], notes: list[str], name: str) -> None:
    if ignored:
        words = ", ".join(f"{word} ({count})" for word, count in ignored.most_common(8))
        notes.append(f"{name}: statements not understood: {words}")


# --- meshes -----------------------------------------------------------------------------------------------------------


def _add_meshes(data: ObjData, materials: list[Node], scene: Scene, path: Path) -> None:
    corners, normals = _smoothed(data)
    triangles, faces = triangulate(data.positions, corners[:, 0], data.sizes)
    with_normals = (corners[triangles, 2] >= 0).all(axis=1)
    kind = data.materials[faces] * 2 + with_normals
    for key in np.unique(kind):
        part = corners[triangles[kind == key]].reshape(-1, 3)
        if not key & 1:
            part = part * (1, 1, 0) - (0, 0, 1)
        vertices, indices = _merged(part, len(data.uvs), len(normals))
        arrays: dict[str, NDArray[Any]] = {
            "positions": data.positions[vertices[:, 0]].astype(np.float32),
            "indices": indices.reshape(-1, 3),
        }
        if key & 1:
            arrays["normals"] = normals[vertices[:, 2]].astype(np.float32)
        if (vertices[:, 1] >= 0).any():
            uvs = data.uvs[np.maximum(vertices[:, 1], 0)].astype(np.float32)
            arrays["uvs"] = np.where(vertices[:, 1:2] >= 0, uvs, np.float32(0))
        if data.colors is not None:
            arrays["colors"] = linear_colors(data.colors[vertices[:, 0]])
        name = data.material_names[int(key) >> 1]
        add_mesh(scene, path, materials[int(key) >> 1], arrays, name=name or None)


def _merged(corners: Ints, uvs: int, normals: int) -> tuple[Ints, NDArray[np.uint32]]:
    """The different ones (V, 3) among corners (C, 3), in order of their numbers, and which of them each corner is."""
    if (int(corners[:, 0].max()) + 1) * (uvs + 1) * (normals + 1) < 2**62:
        key = (corners[:, 0] * (uvs + 1) + corners[:, 1] + 1) * (normals + 1) + corners[:, 2] + 1
        _, first, inverse = np.unique(key, return_index=True, return_inverse=True)
    else:
        _, first, inverse = np.unique(corners, axis=0, return_index=True, return_inverse=True)
    return corners[first], inverse.reshape(-1).astype(np.uint32)


def _smoothed(data: ObjData) -> tuple[Ints, NDArray[np.float64]]:
    """Corners and normals; faces of a smoothing group that have no normals get the group's own, weighted by angle."""
    smooth = np.repeat(data.smoothing, data.sizes)
    starts = np.cumsum(data.sizes) - data.sizes
    has_all = np.minimum.reduceat(data.corners[:, 2], starts) >= 0
    wanted = (smooth > 0) & ~np.repeat(has_all, data.sizes)
    if not wanted.any():
        return data.corners, data.normals
    which = np.flatnonzero(wanted)
    pairs = data.corners[which, 0] * (int(smooth.max()) + 1) + smooth[which]
    _, vertex = np.unique(pairs, return_inverse=True)
    vertex = vertex.reshape(-1)
    turn = _corner_normals(data, starts)[which]
    total = np.stack([np.bincount(vertex, turn[:, axis]) for axis in range(3)], axis=1)
    corners = data.corners.copy()
    corners[which, 2] = len(data.normals) + vertex
    return corners, np.concatenate([data.normals, total])


def _corner_normals(data: ObjData, starts: Ints) -> NDArray[np.float64]:
    """(C, 3) of every corner: its face's unit normal times the angle in the corner."""
    position = data.positions[data.corners[:, 0]]
    index = np.arange(len(position))
    first, size = np.repeat(starts, data.sizes), np.repeat(data.sizes, data.sizes)
    to_next = position[first + (index - first + 1) % size] - position
    to_last = position[first + (index - first - 1) % size] - position
    with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
        cross = np.cross(to_next, to_last)
        angle = np.arctan2(np.linalg.norm(cross, axis=1), np.einsum("ni,ni->n", to_next, to_last))
        face = np.add.reduceat(np.cross(position, position + to_next), starts)
        face = np.nan_to_num(face / np.linalg.norm(face, axis=1, keepdims=True))
    return np.asarray(np.repeat(face, data.sizes, axis=0) * angle[:, None])
