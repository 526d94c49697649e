"""Checks a mesh's arrays before the core sees them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from destello.errors import SceneError
from destello.nodes import Node

if TYPE_CHECKING:
    from numpy.typing import NDArray

_PER_VERTEX = ("normals", "uvs", "colors", "positions1", "normals1", "tangents", "second_uvs", "second_tangents")
DIRECTIONS = ("normal_map", "tangent_map", "geometry_coat_normal", "geometry_coat_tangent")  # by a uv set's tangents


def check_mesh(arrays: Mapping[str, NDArray[Any]], place: str) -> dict[str, NDArray[Any] | None]:
    """The arguments of the core's add_mesh. Raises SceneError, which names the mesh and the first bad element."""
    positions, indices = arrays["positions"], arrays["indices"]
    count = len(positions)
    if count == 0 or len(indices) == 0:
        value = f"{count} vertices, {len(indices)} triangles"
        raise SceneError("the mesh is empty", place=place, value=value, expected="at least one triangle")
    for name in _PER_VERTEX:
        if name in arrays and len(arrays[name]) != count:
            raise SceneError(
                f"{len(arrays[name])} {name} for {count} vertices", place=f"{place}.{name}", expected=f"{count} of them"
            )
    if "normals1" in arrays and "normals" not in arrays:
        raise SceneError("normals1 without normals", place=f"{place}.normals1", expected="both or none")
    for name in ("positions", *_PER_VERTEX):
        if name in arrays:
            check_finite(arrays[name], f"{place}.{name}")
    largest = int(indices.max())
    if largest >= count:
        row = int(np.argmax((indices >= count).any(axis=1)))
        raise SceneError(
            "a triangle with a vertex that does not exist",
            place=f"{place}.indices[{row}]",
            value=indices[row].tolist(),
            expected=f"vertex numbers from 0 to {count - 1}",
        )
    made: dict[str, NDArray[Any] | None] = {"positions": positions, "indices": indices}
    made.update((name, arrays.get(name)) for name in _PER_VERTEX)
    colors = made["colors"]
    if colors is not None and colors.shape[1] == 3:
        made["colors"] = np.concatenate([colors, np.ones((count, 1), np.float32)], axis=1)
    return made


def uv_reads(material: Node) -> frozenset[str]:
    """Holds "second" if a texture of a material reads the second uv set, and each of DIRECTIONS that reads two sets."""
    found = {"second"} if "second" in uv_sets(material) else set()
    for node in material.walk():
        if node.kind == "material":
            maps = {name: uv_sets(node.params.get(name)) for name in DIRECTIONS}
            found |= {name for name, sets in maps.items() if len(sets) > 1}
            if len(maps["geometry_coat_normal"] | maps["geometry_coat_tangent"]) > 1:
                found.add("geometry_coat_normal")
    return frozenset(found)


def uv_sets(value: object) -> set[str]:
    """The uv sets that the images in a parameter's value read."""
    return {str(n["uv_set"]) for n in value.walk() if n.type == "image"} if isinstance(value, Node) else set()


def check_uv_sets(shape: Node, read: frozenset[str], place: str) -> None:
    """Whether a shape has what its material reads (see `uv_reads`). Raises SceneError."""
    if "second" in read and (shape.type != "mesh" or shape["second_uvs"] is None):
        expected = "a mesh that has them, or uv_set: first"
        raise SceneError("an image of the second uv set on a shape without second_uvs", place=place, expected=expected)
    for name in DIRECTIONS:
        if name in read:
            expected = "one uv_set for all of it, and one for the coat's normals and tangents"
            raise SceneError("directions by two uv sets", place=f"{place}.{name}", expected=expected)


def check_finite(array: NDArray[Any], place: str) -> None:
    """Raises SceneError, which names the first element that is not a finite number."""
    finite = np.isfinite(array)
    if finite.all():
        return
    row = int(np.argmin(finite.all(axis=1) if array.ndim == 2 else finite))
    raise SceneError(
        "not a finite number", place=f"{place}[{row}]", value=array[row].tolist(), expected="finite numbers"
    )


def check_spheres(arrays: Mapping[str, Any], place: str) -> None:
    """Checks the arrays of a `spheres` shape. Raises SceneError."""
    count = len(arrays["centers"])
    if count == 0:
        raise SceneError("no spheres", place=place, value=0, expected="at least one")
    for name in ("radii", "centers1"):
        if arrays.get(name) is not None and len(arrays[name]) != count:
            raise SceneError(f"{len(arrays[name])} {name} for {count} centers", place=f"{place}.{name}")
    for name in ("centers", "radii", "centers1"):
        if arrays.get(name) is not None:
            check_finite(arrays[name], f"{place}.{name}")
    zero = np.flatnonzero(arrays["radii"] == 0)
    if len(zero):
        raise SceneError(
            "the sphere has no size", place=f"{place}.radii[{zero[0]}]", value=0.0, expected="other than 0"
        )
