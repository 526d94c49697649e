"""Shapes as the core takes them: quads and boxes as triangles, and bounds."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterable, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from destello.frames import looked_at
from destello.nodes import Node
from destello.transform import Transform

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from destello.scene import Scene

    Array = NDArray[Any]
    Points = NDArray[np.float64]

Box = tuple[Any, Any] | None
MeshLoader = Callable[[Node, str], "Scene"]

# A unit cube's faces: four corners each, counter-clockwise seen from outside.
_BOX_FACES = (
    ((0, 0, 1), (1, 0, 1), (1, 1, 1), (0, 1, 1)),
    ((1, 0, 0), (0, 0, 0), (0, 1, 0), (1, 1, 0)),
    ((1, 0, 1), (1, 0, 0), (1, 1, 0), (1, 1, 1)),
    ((0, 0, 0), (0, 0, 1), (0, 1, 1), (0, 1, 0)),
    ((0, 1, 1), (1, 1, 1), (1, 1, 0), (0, 1, 0)),
    ((0, 0, 0), (1, 0, 0), (1, 0, 1), (0, 0, 1)),
)
_QUAD_UVS = ((0, 0), (1, 0), (1, 1), (0, 1))
_QUAD_INDICES = np.array([[0, 1, 2], [0, 2, 3]], np.uint32)


def mesh_arrays(shape: Node) -> Mapping[str, Array]:
    """The arrays of a mesh, quad or box: "positions" (N, 3), "indices" (M, 3), and what else it has."""
    if shape.type == "quad":
        return _quad(shape)
    if shape.type == "box":
        return _box(shape)
    return {name: value for name, value in shape.params.items() if isinstance(value, np.ndarray)}


def _quad(shape: Node) -> Mapping[str, Array]:
    corner, u, v = (np.array(shape[name]) for name in ("corner", "u", "v"))
    positions = np.array([corner, corner + u, corner + u + v, corner + v], np.float32)
    return {"positions": positions, "indices": _QUAD_INDICES, "uvs": np.array(_QUAD_UVS, np.float32)}


def _box(shape: Node) -> Mapping[str, Array]:
    low, high = np.array(shape["min"]), np.array(shape["max"])
    corners = np.array(_BOX_FACES, np.float64).reshape(24, 3)
    indices = np.concatenate([_QUAD_INDICES + np.uint32(4 * face) for face in range(6)])
    positions = np.where(corners == 1, high, low).astype(np.float32)
    return {"positions": positions, "indices": indices, "uvs": np.tile(np.array(_QUAD_UVS, np.float32), (6, 1))}


# --- bounds -----------------------------------------------------------------------------------------------------------


def scene_bounds(scene: Scene, load_file: MeshLoader | None = None) -> tuple[Points, Points] | None:
    """Least and greatest corner (3,) of all shapes in metres, as `Scene.bounds` says; None without any.

    `load_file(shape, place)` gives the scene in a mesh_file's file; without it such shapes are left out.
    """
    return _merge(_still_bounds(still, load_file) for still in looked_at(scene))


def _still_bounds(scene: Scene, load_file: MeshLoader | None) -> Box:
    """Over the whole shutter, of a scene without animation."""
    boxes: dict[str, Box] = {}
    for name, group in scene.groups.items():
        members = enumerate(group.shapes)
        boxes[name] = _merge(_shape_box(shape, f"groups.{name}[{i}]", {}, load_file) for i, shape in members)
    return _merge(_shape_box(shape, f"shapes[{i}]", boxes, load_file) for i, shape in enumerate(scene.shapes))


def _shape_box(shape: Node, place: str, groups: Mapping[str, Box], load_file: MeshLoader | None) -> Box:
    """A shape's bounds where it stands; an instance's are its group's, moved."""
    if shape.type == "sphere":
        centers = np.array([shape["center"], shape["center1"] or shape["center"]], np.float64)
        radius = abs(shape["radius"])
        return centers.min(0) - radius, centers.max(0) + radius
    if shape.type == "spheres":
        return _spheres_box(shape)
    own: Box
    if shape.type == "instance":
        own = groups.get(shape["group"])
    elif shape.type == "mesh_file":
        own = scene_bounds(load_file(shape, place)) if load_file else None
    else:
        arrays = mesh_arrays(shape)
        return _merge(
            _points_box(_moved(arrays[name], shape[placed] or shape["transform"]))
            for name, placed in (("positions", "transform"), (_end(arrays), "transform1"))
        )
    if own is None:
        return None
    corners = np.array([[own[pick][axis] for axis, pick in enumerate(p)] for p in itertools.product((0, 1), repeat=3)])
    ends = (shape["transform"], shape["transform1"] or shape["transform"])
    return _merge(_points_box(_moved(corners, transform)) for transform in ends)


def _end(arrays: Mapping[str, Array]) -> str:
    return "positions1" if "positions1" in arrays else "positions"


def _spheres_box(shape: Node) -> Box:
    centers, radii = shape["centers"], np.abs(shape["radii"].astype(np.float64))[:, np.newaxis]
    ends = [centers] if shape["centers1"] is None else [centers, shape["centers1"]]
    if len(centers) == 0 or any(len(end) != len(radii) for end in ends):
        return None
    return _merge((*_points_box_pair(end.astype(np.float64) - radii, end.astype(np.float64) + radii),) for end in ends)


def _points_box_pair(low: Points, high: Points) -> tuple[Points, Points]:
    return low.min(0), high.max(0)


def _moved(points: Array, transform: Transform | None) -> Points:
    points = points.astype(np.float64)
    if transform is None:
        return points
    rows = transform.matrix[:3]
    moved: Points = points @ rows[:, :3].T + rows[:, 3]
    return moved


def _points_box(points: Points) -> Box:
    return (points.min(0), points.max(0)) if len(points) else None


def _merge(boxes: Iterable[Box]) -> Box:
    found = [box for box in boxes if box is not None]
    if not found:
        return None
    return np.min([low for low, _ in found], axis=0), np.max([high for _, high in found], axis=0)
