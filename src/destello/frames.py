"""Frames of an animated scene: `Scene.at_frame` makes a plain scene of each.

Frame f lasts from f / fps to (f + 1) / fps seconds; the shutter is open for a part of it. Shapes get the transforms of
both ends of the frame and move linearly between, so that they blur; what steps, steps between frames. Cameras and
lights stand still in a frame, where they are when it begins. A shape or light that is scaled to 0 then is not there.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from destello.errors import InputError, SceneError
from destello.nodes import Node
from destello.transform import NotInvertible, Transform

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from destello.animation import Animation
    from destello.scene import Group, Scene

LAST_FRAME = 2**31 - 1
MOST_LOOKED_AT = 16  # frames that are looked at for an animation's bounds


def animations(scene: Scene) -> Iterator[Animation]:
    """Those of cameras, lights and shapes."""
    nodes = [*scene.cameras.values(), *scene.lights, *(shape for _, shape in scene.all_shapes())]
    return (node.params["animation"] for node in nodes if "animation" in node.params)


def frame_count(scene: Scene) -> int:
    """How many frames there are until the last keyframe, at least 1; 0 if nothing is animated."""
    ends = [animation.seconds for animation in animations(scene)]
    return max(1, math.ceil(max(ends) * scene.render.fps - 1e-4)) if ends else 0


def at_frame(scene: Scene, frame: int) -> Scene:
    """A scene without animation: see `Scene.at_frame`."""
    if not hasattr(frame, "__index__") or isinstance(frame, bool) or not 0 <= int(frame) <= LAST_FRAME:
        raise InputError("no such frame", place="frame", value=frame, expected=f"a whole number from 0 to {LAST_FRAME}")
    if next(animations(scene), None) is None:
        return scene.copy()
    if not scene.cameras:
        from destello.defaults import ensure_camera

        scene = scene.copy()
        ensure_camera(scene)  # the same one in all frames
    fps = scene.render.fps
    return _Still(scene, int(frame) / fps, (int(frame) + 1) / fps, f"frame {int(frame)}").scene()


def at_time(scene: Scene, time: float) -> Scene:
    """A scene without animation and without its motion, as it is at `time` seconds."""
    return scene if next(animations(scene), None) is None else _Still(scene, time, time, f"{time:g} s").scene()


def looked_at(scene: Scene) -> Iterator[Scene]:
    """The scene itself, or some frames from the first to the last if it is animated."""
    count = frame_count(scene)
    if count == 0:
        yield scene
        return
    for frame in sorted({round(f) for f in np.linspace(0, count - 1, min(count, MOST_LOOKED_AT))}):
        start, end = frame / scene.render.fps, (frame + 1) / scene.render.fps
        yield _Still(scene, start, end, f"frame {frame}").scene()


@dataclass
class _Still:
    """Makes the scene of one frame from `start` to `end` seconds; `when` names it in notes and errors."""

    animated: Scene
    start: float
    end: float
    when: str
    _notes: list[str] = field(default_factory=list)

    def scene(self) -> Scene:
        """The scene; raises SceneError where a transform leaves the range of numbers or a camera is flat."""
        made = self.animated.copy()
        made.cameras = {name: self._camera(node, f"cameras.{name}") for name, node in made.cameras.items()}
        made.lights = self._all(made.lights, "lights")
        made.shapes = self._all(made.shapes, "shapes")
        made.groups = {name: self._group(group) for name, group in made.groups.items()}
        made.notes += self._notes
        return made

    def _group(self, group: Group) -> Group:
        if not any("animation" in shape.params for shape in group.shapes):
            return group
        return type(group)(group.name, tuple(self._all(group.shapes, f"groups.{group.name}")))

    def _all(self, nodes: Any, section: str) -> list[Node]:
        """Those of the nodes that are there in this frame."""
        placed = (self._placed(node, f"{section}[{i}]") for i, node in enumerate(nodes))
        return [node for node in placed if node is not None]

    def _placed(self, node: Node, place: str) -> Node | None:
        if "animation" not in node.params:
            return node
        own = node.params.get("transform", Transform())
        place = f"{place} ({node.name})" if node.name else place
        first = self._transform(node, own, self.start, place)
        if first is None:
            return None
        if node.kind == "light":
            return node.replace(animation=None, transform=first)
        last = self._transform(node, own, self.end, place)
        if last is None or first.collapse(last) is not None:
            self._notes.append(f"{place} is not blurred in {self.when}: on the way it would be flat")
            last = first
        moves = not np.array_equal(first.matrix, last.matrix)
        if node.type == "sphere":
            center, end = (_point(t.matrix, node["center"]) for t in (first, last))
            return node.replace(animation=None, center=center, center1=end if moves else None)
        return node.replace(animation=None, transform=first, transform1=last if moves else None)

    def _transform(self, node: Node, own: Transform, time: float, place: str) -> Transform | None:
        """The object's transform at a time of the frame; None if it is flat or nothing is left of it."""
        words = node.params["animation"].words_at(time, opened=self.start)
        try:
            return Transform((*own.words, *words))
        except NotInvertible:
            if time == self.start and not any(name == "scale" and not np.any(value) for name, value in words):
                self._notes.append(f"{place} is not shown in {self.when}: its transform is flat")
            return None
        except SceneError as error:
            raise error.within(f"{place}.animation at {self.when}") from None

    def _camera(self, node: Node, place: str) -> Node:
        if "animation" not in node.params:
            return node
        try:
            matrix = node.params["animation"].at(self.start).matrix
            up = matrix[:3, :3] @ np.array(node["up"])
            view = {name: _point(matrix, node[name]) for name in ("origin", "target")}
            return node.replace(animation=None, **view, up=up)
        except SceneError as error:
            raise error.within(f"{place}.animation at {self.when}") from None


def _point(matrix: NDArray[np.float64], point: tuple[float, ...]) -> NDArray[np.float64]:
    moved: NDArray[np.float64] = matrix[:3, :3] @ np.array(point) + matrix[:3, 3]
    return moved
