"""The scene that is shown, as pages and Python edit it, with undo.

Pages edit the very `Scene` that was given to `view`, so that a script sees what they did; and a script edits it as
ever (`scene.shapes[2] = ...`), which `Document.poll` notices. Nodes never change, so two states of a scene are compared
by the identity of their nodes, and a copy of the lists is all that undo needs.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterable
from operator import is_

from destello.nodes import Node
from destello.scene import Scene
from destello.viewer.history import History

Change = Callable[[Scene], None]


class Document:
    """A scene, its history, and a number that grows with each change.

    Attributes:
        scene: the scene; what it holds changes in place.
        revision: grows with each change, whoever made it.
        lock: held while the scene changes.
    """

    def __init__(self, scene: Scene) -> None:
        self.scene = scene
        self.revision = 0
        self.lock = threading.RLock()
        self._history: History[Scene] = History()
        self._known = scene.copy()

    def edit(self, label: str, change: Change, accept: Change, merge: object = None) -> None:
        """Changes the scene and remembers how it was. If `change` or `accept` raises, nothing has happened.

        Args:
            label: what it is, in a few words, for undo.
            change: does it, to the scene itself.
            accept: called with the changed scene: shows it, or raises.
            merge: edits with the same key that follow each other are undone as one.
        """
        with self.lock:
            self.poll()
            before = self._known
            try:
                change(self.scene)
                if same(before, self.scene):
                    return
                accept(self.scene)
            except BaseException:
                put_back(self.scene, before)
                raise
            self._history.record(label, before, merge)
            self._noted()

    def poll(self) -> bool:
        """Whether the scene was changed from Python since the last look; if so, that can be undone, too."""
        with self.lock:
            if same(self._known, self.scene):
                return False
            self._history.record("change from Python", self._known)
            self._noted()
            return True

    def seal(self) -> None:
        """The next edit is a step of its own."""
        self._history.seal()

    def undo(self) -> str | None:
        """Takes the last step back; returns what it was, or None if there was none."""
        return self._turn(self._history.can_undo, self._history.undo)

    def redo(self) -> str | None:
        """Does what was undone again; returns what it was, or None if there was nothing."""
        return self._turn(self._history.can_redo, self._history.redo)

    @property
    def steps(self) -> tuple[str | None, str | None]:
        """What would be undone and redone."""
        return self._history.can_undo, self._history.can_redo

    def _turn(self, label: str | None, turn: Callable[[Scene], Scene | None]) -> str | None:
        with self.lock:
            self.poll()
            state = turn(self._known)
            if state is None:
                return None
            put_back(self.scene, state)
            self._noted()
            return label

    def _noted(self) -> None:
        self._known = self.scene.copy()
        self.revision += 1


def same(a: Scene, b: Scene) -> bool:
    """Whether two states of a scene consist of the very same nodes and settings."""
    return (
        _identical(a.shapes, b.shapes)
        and _identical(a.lights, b.lights)
        and a.environment is b.environment
        and a.cameras.keys() == b.cameras.keys()
        and _identical(a.cameras.values(), b.cameras.values())
        and a.groups.keys() == b.groups.keys()
        and _identical(a.groups.values(), b.groups.values())
        and a.film == b.film
        and a.render == b.render
    )


def _identical(a: Iterable[object], b: Iterable[object]) -> bool:
    mine, its = list(a), list(b)
    return len(mine) == len(its) and all(map(is_, mine, its))


def put_back(scene: Scene, state: Scene) -> None:
    """Makes `scene`, in place, what `state` is."""
    kept = state.copy()
    scene.cameras, scene.groups = kept.cameras, kept.groups
    scene.film, scene.render = kept.film, kept.render
    scene.environment, scene.shapes, scene.lights = kept.environment, kept.shapes, kept.lights


def replace_material(scene: Scene, old: Node, new: Node) -> int:
    """Puts a material in the place of another wherever shapes have it, also inside of mixes; returns in how many."""
    count = 0
    swapped: dict[int, Node] = {id(old): new}

    def swap(material: Node) -> Node:
        if id(material) in swapped:
            return swapped[id(material)]
        inner = {name: swap(child) for name, child in material.params.items() if _is_material(child)}
        changed = any(inner[name] is not material.params[name] for name in inner)
        swapped[id(material)] = material.replace(**inner) if changed else material
        return swapped[id(material)]

    def swap_shape(shape: Node) -> Node:
        nonlocal count
        material = shape.params.get("material")
        if not isinstance(material, Node) or (new_material := swap(material)) is material:
            return shape
        count += 1
        return shape.replace(material=new_material)

    scene.shapes[:] = [swap_shape(shape) for shape in scene.shapes]
    for name, group in scene.groups.items():
        shapes = tuple(swap_shape(shape) for shape in group.shapes)
        if not _identical(shapes, group.shapes):
            scene.groups[name] = type(group)(group.name, shapes)
    return count


def _is_material(value: object) -> bool:
    return isinstance(value, Node) and value.kind == "material"
