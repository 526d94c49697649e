"""A scene around the one mesh of a format that holds nothing else."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import destello.materials as materials
import destello.shapes as shapes
import destello.textures as textures
from destello.color_spaces import srgb_decode
from destello.errors import Error, FormatError, MissingFileError
from destello.io._arrays import repaired_normals
from destello.io._defaults import LoadOptions, ensure_camera, ensure_light
from destello.nodes import Node
from destello.scene import Scene

GREY = (0.6, 0.6, 0.6)


def read_bytes(path: Path) -> bytes:
    """The file's content. Raises MissingFileError."""
    try:
        return path.read_bytes()
    except OSError as error:
        raise MissingFileError([path], reason=error.strerror or "", expected="a readable file") from None


def grey(name: str | None = None) -> Node:
    """The material of what has none."""
    return materials.diffuse(reflectance=GREY, name=name)


def painted() -> Node:
    """The material of a mesh that has nothing but vertex colours."""
    return materials.diffuse(reflectance=textures.vertex_color())


def linear_colors(colors: NDArray[np.floating]) -> NDArray[np.float32]:
    """(N, 3 or 4) display colours in [0, 1] as linear ones; alpha as it is."""
    made = np.clip(np.nan_to_num(colors.astype(np.float32)), 0, 1)
    made[:, :3] = srgb_decode(made[:, :3])
    return made


def new_scene(path: Path, options: LoadOptions) -> Scene:
    """An empty scene for the file at `path`."""
    scene = Scene(name=path.stem)
    scene.base_dir, scene.allow_external, scene.allow_missing = (
        path.parent,
        options.allow_external,
        options.allow_missing,
    )
    return scene


def complete(scene: Scene, options: LoadOptions) -> Scene:
    """Adds the camera and the light that the format cannot hold, if they are wanted."""
    if options.complete:
        ensure_camera(scene)
        ensure_light(scene)
    return scene


def add_mesh(
    scene: Scene, path: Path, material: Node, arrays: Mapping[str, NDArray[Any]], *, name: str | None = None
) -> None:
    """Adds a mesh. Normals without direction are replaced, with a note. Raises FormatError."""
    made = dict(arrays)
    if "normals" in made:
        made["normals"], bad = repaired_normals(made["normals"], made["positions"], made["indices"])
        if bad:
            scene.notes.append(f"{bad} normals have no direction; computed from the triangles")
    try:
        scene.add(shapes.mesh(material=material, name=name, **made))
    except Error as error:
        raise FormatError(
            error.problem, file=path, place=error.place, value=error.value, expected=error.expected
        ) from None
