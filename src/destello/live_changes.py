"""Changed copies of scenes: an object elsewhere, a material with other values, another light."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from destello.errors import InputError, did_you_mean
from destello.nodes import Node
from destello.transform import Transform, scale, translate

if TYPE_CHECKING:
    from destello.scene import Scene

NodeRef = int | str | Node
MaterialRef = int | str | Node


def find(nodes: Sequence[Node], which: NodeRef, kind: str) -> tuple[int, Node]:
    """Position and node of a shape or light given by its number, its name or itself. Raises InputError."""
    place = f"{kind}s"
    if isinstance(which, str):
        for i, node in enumerate(nodes):
            if node.name == which:
                return i, node
        known = did_you_mean(which, [node.name for node in nodes if node.name])
        raise InputError(f"no {kind} of that name", place=place, value=which, expected=known)
    if isinstance(which, Node):
        found = next((i for i, node in enumerate(nodes) if node is which), None)
        if found is None:
            found = next((i for i, node in enumerate(nodes) if node == which), None)
        if found is None:
            raise InputError(f"not a {kind} of this scene", place=place, value=which)
        return found, nodes[found]
    if isinstance(which, bool) or not hasattr(which, "__index__") or not 0 <= int(which) < len(nodes):
        raise InputError(f"no such {kind}", place=place, value=which, expected=f"a number from 0 to {len(nodes) - 1}")
    return int(which), nodes[int(which)]


def transform_of(shape: Node) -> Transform:
    """From the shape's own space to the world when the shutter opens; a sphere's from the unit sphere."""
    if shape.type == "sphere":
        return translate(*shape["center"]) @ scale(abs(shape["radius"]))
    if "transform" not in shape.doc.params:
        raise InputError(f"{shape.type} has no transform", value=shape.type, expected="a shape that has one")
    return shape["transform"] or Transform()


def with_transform(scene: Scene, which: NodeRef, transform: Transform, transform1: Transform | None) -> Scene:
    """A copy of the scene in which a shape stands elsewhere."""
    index, shape = find(scene.shapes, which, "shape")
    if shape.type == "sphere":
        center, size = _ball(transform)
        end = None if transform1 is None else _ball(transform1)[0]
        changes = {"center": center, "radius": float(np.copysign(size, shape["radius"])), "center1": end}
    else:
        transform_of(shape)
        changes = {"transform": transform, "transform1": transform1}
    return _with_shape(scene, index, shape.replace(**changes))


def _ball(transform: Transform) -> tuple[tuple[float, ...], float]:
    """Centre and radius of the unit sphere's image."""
    matrix = transform.matrix
    lengths = np.linalg.norm(matrix[:3, :3], axis=0)
    products = matrix[:3, :3].T @ matrix[:3, :3]
    if np.abs(products - np.eye(3) * lengths[0] ** 2).max() > 1e-5 * lengths[0] ** 2:
        raise InputError(
            "a sphere cannot be stretched", place="transform", value=transform, expected="the same scale along all axes"
        )
    return tuple(float(x) for x in matrix[:3, 3]), float(lengths[0])


def _with_shape(scene: Scene, index: int, shape: Node) -> Scene:
    changed = scene.copy()
    changed.shapes[index] = shape
    return changed


def changed_node(kind: str, old: Node | None, values: Mapping[str, Any] | Node) -> Node:
    """A node with other values, or of another type with nothing but these. Raises InputError."""
    if isinstance(values, Node):
        if values.kind != kind:
            raise InputError(f"not a {kind}", value=values, expected=f"a {kind} or some of its parameters")
        return values
    given = dict(values)
    type_name = given.pop("type", None)
    if old is not None and type_name in (None, old.type):
        return old.replace(**given)
    if type_name is None:
        raise InputError(f"there is no {kind} to change", expected=f"its type, too, or a {kind}")
    return Node(kind, type_name, given, name=None if old is None else old.name)


def with_material(scene: Scene, which: MaterialRef, values: Mapping[str, Any] | Node) -> Scene:
    """A copy of the scene in which a shape has another material, or a material other values wherever it is."""
    if isinstance(which, Node) and which.kind == "material":
        return _with_material_everywhere(scene, which, changed_node("material", which, values))
    index, shape = find(scene.shapes, which, "shape")
    if "material" not in shape.doc.params:
        raise InputError(f"{shape.type} has no material", value=shape.type, expected="a shape that has one")
    old = shape["material"]
    if old is None and shape.type != "mesh_file":
        old = Node("material", "diffuse")
    return _with_shape(scene, index, shape.replace(material=changed_node("material", old, values)))


def _with_material_everywhere(scene: Scene, old: Node, new: Node) -> Scene:
    done: dict[Node, Node] = {}

    def changed(material: Node) -> Node:
        if material not in done:
            inner = {name: child for name, child in material.params.items() if _is_material(child)}
            now = {name: changed(child) for name, child in inner.items()}
            differs = any(now[name] is not child for name, child in inner.items())
            done[material] = new if material == old else material.replace(**now) if differs else material
        return done[material]

    def repainted(shape: Node) -> Node:
        material = shape.params.get("material")
        if material is None or (now := changed(material)) is material:
            return shape
        return shape.replace(material=now)

    other = scene.copy()
    other.shapes = [repainted(shape) for shape in scene.shapes]
    for name, group in scene.groups.items():
        shapes = tuple(repainted(shape) for shape in group.shapes)
        if any(a is not b for a, b in zip(shapes, group.shapes, strict=True)):
            other.groups[name] = replace(group, shapes=shapes)
    if new not in done.values():
        raise InputError("not a material of this scene", place="materials", value=old, expected="one of its shapes'")
    return other


def _is_material(value: object) -> bool:
    return isinstance(value, Node) and value.kind == "material"


def with_light(scene: Scene, which: NodeRef, values: Mapping[str, Any] | Node) -> Scene:
    """A copy of the scene with another light in the place of one."""
    index, light = find(scene.lights, which, "light")
    changed = scene.copy()
    changed.lights[index] = changed_node("light", light, values)
    return changed


def with_environment(scene: Scene, values: Mapping[str, Any] | Node | None) -> Scene:
    """A copy of the scene with another environment."""
    changed = scene.copy()
    changed.environment = None if values is None else changed_node("environment", scene.environment, values)
    return changed


def with_camera(scene: Scene, name: str, values: Mapping[str, Any] | Node) -> Scene:
    """A copy of the scene with another camera of that name."""
    changed = scene.copy()
    changed.cameras[name] = changed_node("camera", scene.cameras.get(name), values)
    return changed
