"""Moving, turning and scaling shapes: between a gizmo's pose, three rows of numbers, and a shape's own parameters."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TypeAlias

import numpy as np
import numpy.typing as npt

from destello.nodes import Node
from destello.scene import Scene
from destello.transform import Transform
from destello.viewer.camera import Vector, rotation_matrix

Matrix: TypeAlias = npt.NDArray[np.float64]

_DIGITS = 7  # kept of what a gizmo says
_SHEARED = 1e-5  # how far from perpendicular the axes may be
_FIXED = ("spheres",)  # many shapes in one: nothing says which is meant


@dataclass(frozen=True)
class Pose:
    """Where a shape is: `position` (m) of the middle of its bounds, `rotation` (3, 3), `scale` along its own axes."""

    position: tuple[float, float, float]
    rotation: Matrix
    scale: tuple[float, float, float]

    @property
    def degrees(self) -> tuple[float, float, float]:
        """The rotation as turns about x, then y, then z (degrees, about fixed axes)."""
        m = self.rotation
        y = math.asin(max(-1.0, min(1.0, -float(m[2, 0]))))
        if abs(m[2, 0]) > 1 - 1e-9:  # straight up or down: x and z turn about the same axis
            x, z = math.atan2(-float(m[1, 2]), float(m[1, 1])), 0.0
        else:
            x, z = math.atan2(float(m[2, 1]), float(m[2, 2])), math.atan2(float(m[1, 0]), float(m[0, 0]))
        dx, dy, dz = (round(math.degrees(angle), _DIGITS) + 0.0 for angle in (x, y, z))
        return dx, dy, dz

    def turned(self, degrees: Sequence[float]) -> Pose:
        """The same with another rotation, as `degrees` gives it."""
        words = [("rotate", {"axis": axis, "angle": angle}) for axis, angle in zip("xyz", degrees, strict=True)]
        return replace(self, rotation=Transform(words).matrix[:3, :3])

    def posed(self, wxyz: Sequence[float] | Vector, position: Vector) -> Pose:
        """The same where a gizmo is now."""
        x, y, z = (float(f"{value:.{_DIGITS}g}") for value in position)
        return replace(self, position=(x, y, z), rotation=rotation_matrix(wxyz))


def can_move(shape: Node) -> str | None:
    """Why a shape cannot be moved here, or None if it can."""
    if shape.type in _FIXED:
        return "many spheres in one shape: they are edited in Python or in the file"
    if "animation" in shape.params or "transform1" in shape.params or "center1" in shape.params:
        return "it is animated: its keyframes are edited in Python or in the file"
    return None


def pose_of(scene: Scene, shape: Node) -> Pose:
    """Where the shape is."""
    middle = _middle(scene, shape)
    if shape.type == "sphere":
        return Pose(middle, np.eye(3), (1.0, 1.0, 1.0))
    rotation, factors = _turn_and_scale(_matrix(shape))
    return Pose(middle, rotation, factors)


def moved(shape: Node, now: Pose, wanted: Pose) -> Node:
    """The shape, which is at `now`, put where it is `wanted`. Raises SceneError, for instance for a scale of 0.

    Its centre of bounds goes along, so what turns or grows does so about its own middle.
    """
    if shape.type == "sphere":
        ratio = wanted.scale[0] / now.scale[0]
        return shape.replace(center=wanted.position, radius=float(f"{shape['radius'] * ratio:.{_DIGITS}g}"))
    frame_now, frame_then = _frame(now), _frame(wanted)
    matrix = frame_then @ np.linalg.inv(frame_now) @ _matrix(shape)
    return shape.replace(transform=words_of_matrix(matrix))


def words_of_matrix(matrix: Matrix) -> Transform:
    """A transform that reads well: scale, rotate, translate, where that is all there is to it; else the matrix."""
    linear, shift = matrix[:3, :3], _rounded(matrix[:3, 3], float(np.abs(matrix[:3, 3]).max()))
    rotation, factors = _turn_and_scale(matrix)
    if np.abs(rotation * np.array(factors) - linear).max() > _SHEARED * np.abs(linear).max():
        return Transform([("matrix", [[*row] for row in matrix[:3].tolist()])])
    words: list[tuple[str, object]] = []
    scale = _rounded(np.array(factors), max(abs(f) for f in factors))
    if len(set(scale)) == 1 and scale[0] != 1:
        words.append(("scale", scale[0]))
    elif any(factor != 1 for factor in scale):
        words.append(("scale", tuple(scale)))
    axis, angle = _axis_and_angle(rotation)
    if angle:
        words.append(("rotate", {"axis": axis, "angle": angle}))
    if any(shift):
        words.append(("translate", tuple(shift)))
    return Transform(words)


def _middle(scene: Scene, shape: Node) -> tuple[float, float, float]:
    """Of the shape's bounds; of its own space where it has none."""
    alone = scene.copy()
    alone.shapes = [shape]
    alone.groups = {k: g for k, g in scene.groups.items() if shape.type == "instance" and k == shape["group"]}
    bounds = alone.bounds()
    middle = _matrix(shape)[:3, 3] if bounds is None else (bounds[0] + bounds[1]) / 2
    x, y, z = (float(f"{value:.{_DIGITS}g}") for value in middle)
    return x, y, z


def _matrix(shape: Node) -> Matrix:
    transform = shape.params.get("transform")
    return np.eye(4) if transform is None else np.array(transform.matrix)


def _frame(pose: Pose) -> Matrix:
    frame = np.eye(4)
    frame[:3, :3] = pose.rotation * np.array(pose.scale)
    frame[:3, 3] = pose.position
    return frame


def _turn_and_scale(matrix: Matrix) -> tuple[Matrix, tuple[float, float, float]]:
    """The nearest rotation (3, 3) to the axes' directions, and their lengths; the first negative if it mirrors."""
    linear = matrix[:3, :3]
    factors = np.linalg.norm(linear, axis=0)
    if np.linalg.det(linear) < 0:
        factors[0] = -factors[0]
    u, _, vt = np.linalg.svd(linear / factors)
    sx, sy, sz = (float(f"{factor:.{_DIGITS}g}") for factor in factors)
    return u @ vt, (sx, sy, sz)


def _axis_and_angle(rotation: Matrix) -> tuple[tuple[float, float, float], float]:
    """Axis and degrees of a rotation; the axes' own directions exactly."""
    cosine = max(-1.0, min(1.0, (float(np.trace(rotation)) - 1) / 2))
    angle = round(math.degrees(math.acos(cosine)), 5)
    if angle < 1e-4:
        return (0.0, 1.0, 0.0), 0.0
    skew = np.array([rotation[2, 1] - rotation[1, 2], rotation[0, 2] - rotation[2, 0], rotation[1, 0] - rotation[0, 1]])
    if angle > 179.99:  # the skew part vanishes: the axis is the eigenvector of 1
        values, vectors = np.linalg.eigh((rotation + rotation.T) / 2)
        skew = vectors[:, int(values.argmax())]
    x, y, z = _rounded(skew / np.linalg.norm(skew), 1.0)
    return (x, y, z), angle


def _rounded(values: Vector, size: float) -> list[float]:
    """To `_DIGITS` digits of `size`, so that what should be 0 or 1 is."""
    digits = _DIGITS - 1 - (math.floor(math.log10(size)) if size > 0 else 0)
    return [round(float(value), digits) + 0.0 for value in values]


def rotation_of(transform: Transform | None) -> float:
    """By how many degrees about y an environment is turned at last: its final word, if that is such a turn."""
    words = transform.words if transform is not None else ()
    return float(words[-1][1]["angle"]) if words and _turns_about_y(words[-1]) else 0.0


def with_rotation(transform: Transform | None, degrees: float) -> Transform | None:
    """The same with another final turn about y."""
    words = list(transform.words) if transform is not None else []
    if words and _turns_about_y(words[-1]):
        words.pop()
    if degrees:
        words.append(("rotate", {"axis": (0.0, 1.0, 0.0), "angle": degrees}))
    return Transform(words) if words else None


def _turns_about_y(word: tuple[str, object]) -> bool:
    name, value = word
    return name == "rotate" and isinstance(value, dict) and value["axis"] == (0.0, 1.0, 0.0)
