"""From a Scene to a scene file's plain data; large arrays go into files beside it."""

from __future__ import annotations

import math
import os
from collections import Counter
from pathlib import Path
from typing import TYPE_CHECKING, Any

from destello.animation import Animation
from destello.io._arrays_file import write_arrays
from destello.io._native_read import VERSION
from destello.nodes import Node
from destello.scene import DEFAULT_CAMERA, Scene
from destello.schema import KINDS
from destello.settings import Settings
from destello.transform import Transform

if TYPE_CHECKING:
    from numpy.typing import NDArray

MOST_INLINE = 64  # numbers in a node's arrays that are written into the scene file itself


def scene_document(scene: Scene, path: Path) -> dict[str, Any]:
    """The document for a scene that is saved as `path`; writes the array files. Raises OutputError."""
    return _Writer(scene, path).document()


class _Writer:
    """Writes one scene."""

    def __init__(self, scene: Scene, path: Path) -> None:
        self._scene = scene
        self._path = path
        self._names: dict[int, str] = _names(scene)
        self._sections: dict[str, dict[str, Any]] = {"textures": {}, "materials": {}}

    def document(self) -> dict[str, Any]:
        scene = self._scene
        document: dict[str, Any] = {"destello": VERSION}
        if scene.name:
            document["name"] = scene.name
        if list(scene.cameras) == [DEFAULT_CAMERA]:
            document["camera"] = self._node(scene.cameras[DEFAULT_CAMERA])
        elif scene.cameras:
            document["cameras"] = {name: self._node(camera) for name, camera in scene.cameras.items()}
        rest: dict[str, Any] = {
            "film": self._settings(scene.film),
            "render": self._settings(scene.render),
            "environment": None if scene.environment is None else self._node(scene.environment),
            "groups": {name: [self._node(s) for s in group.shapes] for name, group in scene.groups.items()},
            "shapes": [self._node(shape) for shape in scene.shapes],
            "lights": [self._node(light) for light in scene.lights],
        }
        for key in ("film", "render", "environment"):
            document[key] = rest.pop(key)
        document.update(self._sections)
        document.update(rest)
        return {key: value for key, value in document.items() if value not in (None, {}, [])}

    def _settings(self, settings: Settings) -> dict[str, Any]:
        return {name: self._value(value) for name, value in settings.given.items()}

    def _node(self, node: Node) -> Any:
        """The node's data, or its name in a section."""
        name = self._names.get(id(node))
        if name is None:
            return self._data(node, node.name)
        section = self._sections[KINDS[node.kind]]
        if name not in section:
            data = self._data(node, None)  # first, so that what it refers to stands before it
            section[name] = data
        return name

    def _data(self, node: Node, label: str | None) -> dict[str, Any]:
        data: dict[str, Any] = {"type": node.type}
        if label:
            data["name"] = label
        arrays = {name: value for name, value in node.params.items() if hasattr(value, "shape")}
        if arrays and not _inline(node, arrays):
            folder = self._path.parent / f"{self._path.stem}.data"
            data["data"] = f"{folder.name}/{write_arrays(folder, arrays)}"
            arrays = {}
        for name, doc in node.doc.params.items():
            if name not in node.params or (hasattr(node.params[name], "shape") and name not in arrays):
                continue
            value = node.params[name]
            data[name] = self._relative(value) if doc.kind == "path" else self._value(value)
        return data

    def _value(self, value: Any) -> Any:
        if isinstance(value, Node):
            return self._node(value)
        if isinstance(value, (Transform, Animation)):
            return value.to_list()
        if isinstance(value, tuple):
            return list(value)
        return _numbers(value) if hasattr(value, "shape") else value

    def _relative(self, path: str) -> str:
        """A path as it must be written to mean the same file: changed if the scene moves to another directory."""
        if Path(path).is_absolute():
            return path
        base = (self._scene.base_dir or Path()).resolve()
        target = self._path.parent.resolve()
        return path if base == target else Path(os.path.relpath(base / path, target)).as_posix()


def _names(scene: Scene) -> dict[int, str]:
    """Names, by id, for materials and textures that are used more than once or have one already."""
    roots = [*scene.cameras.values(), *scene.lights, *(shape for _, shape in scene.all_shapes())]
    roots += [node for node in (scene.environment, scene.film.filter) if node is not None]
    nodes = list(scene.nodes())
    written = Counter(id(node) for node in roots)  # a shape that stands in two places is written twice
    uses: Counter[int] = Counter()
    for node in nodes:
        for child in node.children():
            uses[id(child)] += max(1, written[id(node)])
    names: dict[int, str] = {}
    taken: set[tuple[str, str]] = set()
    for node in nodes:
        if node.kind in ("material", "texture") and (node.name or uses[id(node)] > 1):
            wanted = node.name or node.type
            name, number = wanted if node.name else f"{wanted}-1", 1
            while (node.kind, name) in taken:
                number += 1
                name = f"{wanted}-{number}"
            taken.add((node.kind, name))
            names[id(node)] = name
    return names


def _inline(node: Node, arrays: dict[str, NDArray[Any]]) -> bool:
    """Whether the arrays go into the scene file itself: few numbers, and such that text tells everything about them."""
    few = sum(array.size for array in arrays.values()) <= MOST_INLINE
    plain = all(node.doc.params[name].kind == "array" for name in arrays)
    return few and plain and all(math.isfinite(v) for array in arrays.values() for v in array.ravel().tolist())


def _numbers(array: NDArray[Any]) -> Any:
    """Nested lists; float32 as the shortest numbers that round to the same ones."""
    if array.ndim > 1:
        return [_numbers(row) for row in array]
    if array.dtype.kind == "f":
        return [float(str(value)) for value in array]
    return [int(value) for value in array]
