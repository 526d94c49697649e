"""The page's camera and the renderer's: the same point of view in two conventions.

The page (viser) has a rotation and a position in its own unit of length: `Frame` puts the scene's middle of attention
at its origin, four units away from the first camera, so that speeds of keys, clipping planes and the gizmo's limits
suit a ring as well as a town. Its rotation is OpenCV's: x to the right of the picture, y down, z into it. The
renderer's camera stands at `origin`, looks at `target`, and takes `up` as a hint (docs/conventions.md).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt

from destello.nodes import Node

Vector: TypeAlias = npt.NDArray[np.float64]

SENSOR = 24.0  # mm: the height of the 35 mm film frame, to which focal lengths are related
_DISTANCE = 4.0  # from the first camera to its target, in the page's unit
_VFOV = 40.0  # where the scene's camera has no field of view


def focal_length(vfov: float) -> float:
    """The focal length in mm, on a sensor 24 mm high, for a vertical field of view in degrees."""
    return SENSOR / 2 / math.tan(math.radians(vfov) / 2)


def field_of_view(length: float) -> float:
    """The vertical field of view in degrees of a focal length in mm: the inverse of `focal_length`."""
    return math.degrees(2 * math.atan(SENSOR / 2 / length))


@dataclass(frozen=True)
class Frame:
    """The page's coordinates: `centre` (metres) is at its origin, `unit` metres are 1."""

    centre: tuple[float, float, float]
    unit: float

    @classmethod
    def of(cls, camera: Node) -> Frame:
        """The frame for a scene that is first seen by `camera`."""
        origin, target = np.array(camera["origin"], float), np.array(camera["target"], float)
        distance = float(np.linalg.norm(target - origin))
        return cls(tuple(target.tolist()), distance / _DISTANCE if distance > 0 else 1.0)

    def page(self, point: Sequence[float] | Vector) -> Vector:
        """A point of the scene in the page's coordinates."""
        return (np.asarray(point, float) - self.centre) / self.unit

    def scene(self, point: Sequence[float] | Vector) -> Vector:
        """The inverse of `page`."""
        return np.asarray(point, float) * self.unit + self.centre


@dataclass(frozen=True)
class View:
    """Where a page looks from.

    Attributes:
        origin, target: in metres; the page turns about `target`.
        up: what is up in the picture; perpendicular to the view or not.
        vfov: vertical field of view, degrees.
        width, height: of the page's canvas, in the display's own pixels.
    """

    origin: tuple[float, float, float]
    target: tuple[float, float, float]
    up: tuple[float, float, float]
    vfov: float
    width: int = 1280
    height: int = 720

    @classmethod
    def of(cls, camera: Node, width: int = 1280, height: int = 720) -> View:
        """The view of one of the scene's cameras; one without a field of view gets the usual one."""
        known = camera.type == "perspective"
        origin, target = camera["origin"], camera["target"]
        if origin == target:
            target = (origin[0], origin[1], origin[2] - 1.0)
        return cls(origin, target, camera["up"], camera["vfov"] if known else _VFOV, width, height)

    @classmethod
    def from_page(cls, camera: Any, frame: Frame) -> View:
        """The view of viser's `CameraHandle`."""
        rotation = rotation_matrix(camera.wxyz)
        position = frame.scene(camera.position)
        distance = float(np.linalg.norm(np.asarray(camera.look_at) - camera.position)) * frame.unit
        target = position + rotation[:, 2] * (distance or frame.unit)
        return cls(
            _triple(position), _triple(target), _triple(-rotation[:, 1]), math.degrees(camera.fov),
            int(camera.image_width), int(camera.image_height),
        )  # fmt: skip

    def to_page(self, camera: Any, frame: Frame) -> None:
        """Moves a page's camera here: `camera` is viser's `CameraHandle`."""
        camera.position = frame.page(self.origin)
        camera.look_at = frame.page(self.target)
        camera.up_direction = np.array(self.up)
        camera.fov = math.radians(self.vfov)

    def node(self, aperture_radius: float = 0.0, focus_distance: float = 0.0) -> Node:
        """The renderer's camera with this view. Lengths in metres; focus distance 0: on the target."""
        return Node(
            "camera",
            "perspective",
            {
                "origin": self.origin,
                "target": self.target,
                "up": self.up,
                "vfov": self.vfov,
                "aperture_radius": aperture_radius,
                "focus_distance": focus_distance,
            },
        )

    def sized(self, width: int, height: int) -> View:
        """The same view on another canvas."""
        return replace(self, width=width, height=height)

    def same_place(self, other: View) -> bool:
        """Whether nothing but the canvas differs, beyond the page's rounding."""
        mine, its = self._numbers(), other._numbers()
        return bool(np.allclose(mine, its, rtol=1e-5, atol=1e-6 * float(np.abs(mine[:6]).max())))

    def _numbers(self) -> Vector:
        up = np.array(self.up) / np.linalg.norm(self.up)
        return np.array([*self.origin, *self.target, *up, self.vfov])


def rotation_matrix(wxyz: Sequence[float] | Vector) -> Vector:
    """The (3, 3) matrix of a quaternion that need not be of length 1."""
    w, x, y, z = np.asarray(wxyz, float) / np.linalg.norm(wxyz)
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )


def quaternion(rotation: Vector) -> tuple[float, float, float, float]:
    """The unit quaternion (w, x, y, z), w >= 0, of a rotation (3, 3): the largest component decides (Shepperd 1978)."""
    m = np.asarray(rotation, float)
    squares = np.array([m.trace(), m[0, 0], m[1, 1], m[2, 2]])
    k = int(squares.argmax())
    q = np.empty(4)
    if k == 0:
        q[:] = 1 + m.trace(), m[2, 1] - m[1, 2], m[0, 2] - m[2, 0], m[1, 0] - m[0, 1]
    else:
        a, b, c = k - 1, k % 3, (k + 1) % 3
        q[0] = m[c, b] - m[b, c]
        q[1 + a] = 1 + m[a, a] - m[b, b] - m[c, c]
        q[1 + b] = m[b, a] + m[a, b]
        q[1 + c] = m[c, a] + m[a, c]
    q /= np.linalg.norm(q)
    q = -q if q[0] < 0 else q
    return float(q[0]), float(q[1]), float(q[2]), float(q[3])


def _triple(values: Vector) -> tuple[float, float, float]:
    x, y, z = (float(value) for value in values)
    return x, y, z
