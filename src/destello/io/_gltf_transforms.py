"""Transforms of glTF's nodes: their own matrices, and how things are placed by them."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from destello.animation import Animation
from destello.errors import Error
from destello.io._arrays import check_finite
from destello.io._gltf_animation import quaternion_rows
from destello.io._gltf_json import Item
from destello.nodes import Node
from destello.transform import Transform, Word, matrix

IDENTITY = np.eye(4)

Matrix = NDArray[np.float64]
Placement = Matrix | Animation


def view(node: Item, world: Matrix) -> dict[str, Matrix]:
    """Origin, target and up of something at a node that looks along its -z axis with its y axis up."""
    forward, up = -world[:3, 2], world[:3, 1]
    length = float(np.linalg.norm(forward))
    if not length > 0 or not np.linalg.norm(np.cross(forward / length, up)) > 1e-12 * np.linalg.norm(up):
        raise node.error("its transform is flat, so that nothing can look along it", expected="scales other than 0")
    return {"origin": world[:3, 3], "target": world[:3, 3] + forward / length, "up": up / np.linalg.norm(up)}


def local(node: Item) -> Matrix:
    """A node's own matrix."""
    if "matrix" in node:
        rows = np.array(node.numbers("matrix", 16)).reshape(4, 4).T
        if np.abs(rows[3] - IDENTITY[3]).max() > 1e-5:
            raise node.error("not an affine matrix", "matrix", value=rows[3].tolist(), expected="last row 0, 0, 0, 1")
        rows[3] = IDENTITY[3]
        return rows
    move = node.numbers("translation", 3, (0.0, 0.0, 0.0))
    turn = node.numbers("rotation", 4, (0.0, 0.0, 0.0, 1.0))
    size = node.numbers("scale", 3, (1.0, 1.0, 1.0))
    return compose(node, np.array(move), np.array(turn), np.array(size))


def compose(node: Item, move: Matrix, turn: Matrix, size: Matrix) -> Matrix:
    """Scale, then rotate by a quaternion (x, y, z, w), then translate."""
    result = np.eye(4)
    result[:3, :3] = np.array(quaternion_rows(node, turn.tolist()))[:, :3] * size
    result[:3, 3] = move
    return result


def still_words(world: Matrix) -> list[Word]:
    """A matrix as a transform word; none for the identity."""
    return [] if np.array_equal(world, IDENTITY) else [("matrix", world[:3])]


def given(place: Placement) -> dict[str, Any] | None:
    """The parameters that place a shape; None for a flat matrix: it cannot be inverted."""
    if isinstance(place, Animation):
        return {"animation": place}
    transform = as_transform(place)
    return None if transform is None else {"transform": transform if transform.words else None}


def as_transform(world: Matrix) -> Transform | None:
    """The transform, or None if it is flat: it cannot be inverted."""
    if np.array_equal(world, IDENTITY):
        return Transform()
    try:
        return matrix(world[:3])
    except Error:
        return None


def flattened(shape: Node, world: Matrix, node: Item) -> Node:
    """A mesh with a flat transform applied to its vertices; its normals and tangents go."""
    points = shape["positions"].astype(np.float64) @ world[:3, :3].T + world[:3, 3]
    check_finite(points, "vertex", file=node.file, place=node.place)
    return shape.replace(positions=points.astype(np.float32), normals=None, tangents=None)
