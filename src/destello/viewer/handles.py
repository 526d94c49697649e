"""The handles that scale the selected shape: cubes behind the arrows of its gizmo, which can only move and turn.

The cube of an axis's colour stands on that axis, on the far side of the arrow, and scales along it; the white one
stands between them and scales all alike. How far from the shape's middle a hand pulls a cube, over how
far from it the cube was grasped, is the factor.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from destello.viewer.camera import Frame, Vector, View, rotation_matrix

_COLORS = ((255, 74, 74), (90, 220, 90), (80, 140, 255), (245, 245, 245))
_PLACES = -np.vstack([np.eye(3), np.full((1, 3), 3**-0.5)])
ALL = 3  # the handle that scales along every axis
_REACH = 0.14  # of the picture's height, from the middle to a cube
_SIDE = 0.028  # of the picture's height
_LEAST = 0.02  # factor of one drag
_STEEPEST = 0.35  # of the reach: cubes that are seen nearer to the middle scale no faster than one there


@dataclass(frozen=True)
class Pull:
    """How far a cube is pulled.

    Attributes:
        gesture: a number of its own for each drag. axis: 0 to 2, or `ALL`.
        factor: of the scale, since the drag began. over: it has been let go.
    """

    gesture: int
    axis: int
    factor: float
    over: bool


class ScaleHandles:
    """The cubes of one page. They are children of the gizmo: they go where it goes, and with it."""

    def __init__(self, client: Any, gizmo: Any, frame: Frame, *, uniform: bool, heard: Callable[[Pull], None]) -> None:
        """`uniform`: the white one only. `heard`: called with each pull, in the event loop."""
        self._client, self._gizmo, self._frame, self._heard = client, gizmo, frame, heard
        self._reach = 1.0
        self._grabbed: Vector = np.zeros(3)
        self._gesture = 0
        self._cubes = {axis: self._cube(axis) for axis in ((ALL,) if uniform else range(4))}

    def fit(self, view: View) -> None:
        """Gives them the size that suits where the page looks from."""
        z = np.subtract(view.target, view.origin)
        z /= np.linalg.norm(z)
        depth = float((self._gizmo.position - self._frame.page(view.origin)) @ z)
        height = 2 * np.tan(np.radians(view.vfov) / 2) * max(depth, 1e-3)
        self._reach = _REACH * height
        for axis, cube in self._cubes.items():
            cube.scale = _SIDE * height
            self._put(axis, 1.0)

    def follow(self, pull: Pull) -> None:
        """The cube goes along with the hand, and back to its place when it is let go."""
        self._put(pull.axis, 1.0 if pull.over else pull.factor)

    def _put(self, axis: int, factor: float) -> None:
        self._cubes[axis].position = _PLACES[axis] * self._reach * factor

    def _cube(self, axis: int) -> Any:
        cube = self._client.scene.add_box(
            f"{self._gizmo.name}/scale{axis}", _COLORS[axis], cast_shadow=False, receive_shadow=False
        )

        async def dragged(event: Any) -> None:
            if event.phase == "start":
                self._grabbed = np.array(event.start_position)
                self._gesture += 1
            forward = rotation_matrix(self._client.camera.wxyz)[:, 2]
            middle = self._gizmo.position
            factor = pulled(self._grabbed - middle, np.array(event.end_position) - middle, forward, self._reach)
            self._heard(Pull(self._gesture, axis, factor, event.phase == "end"))

        cube.on_drag(dragged)
        return cube


def pulled(grabbed: Vector, now: Vector, forward: Vector, reach: float) -> float:
    """The factor of a pull from `grabbed` to `now`, both seen from the shape's middle, in the plane of the picture."""
    direction = grabbed - (grabbed @ forward) * forward
    distance = float(np.linalg.norm(direction))
    if distance < 1e-6 * reach:
        return 1.0
    further = float(now @ direction) / distance - distance
    return max(_LEAST, 1 + further / max(distance, _STEEPEST * reach))
