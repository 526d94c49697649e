"""glTF's node hierarchy: world transforms, and what stands at each node (meshes, cameras, lights)."""

from __future__ import annotations

import math
from collections import Counter
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

import destello.cameras as cameras
import destello.lights as lights
import destello.shapes as shapes
from destello.errors import Error
from destello.io._arrays import check_finite
from destello.io._gltf_accessors import Buffers
from destello.io._gltf_json import Document, Item
from destello.io._gltf_meshes import Meshes, Pose, node_weights
from destello.nodes import Node
from destello.scene import Scene
from destello.transform import Transform, matrix

NODE_EXTENSIONS = frozenset({"KHR_lights_punctual", "KHR_node_visibility", "EXT_mesh_gpu_instancing"})
_IDENTITY = np.eye(4)
_LONG_SIDE = 1280

Matrix = NDArray[np.float64]


@dataclass
class _Placed:
    """A mesh at a node, once for each matrix."""

    node: Item
    mesh: Item
    matrices: list[Matrix]


class Placer:
    """Fills a scene with what the nodes of a document hold."""

    def __init__(self, document: Document, scene: Scene, meshes: Meshes, buffers: Buffers) -> None:
        self.document = document
        self.scene = scene
        self._meshes = meshes
        self._buffers = buffers
        self._worlds: dict[int, Matrix] = {}

    def place(self) -> None:
        """Walks the default scene and adds everything in it."""
        placed: list[_Placed] = []
        for node, world in self._walk():
            mesh = self.document.refer(node, "mesh", "meshes")
            if mesh is not None:
                placed.append(_Placed(node, mesh, self._instances(node, world)))
            camera = self.document.refer(node, "camera", "cameras")
            if camera is not None:
                self._add_camera(node, camera, world)
            light = node.extension("KHR_lights_punctual")
            if light is not None:
                self._add_light(node, light, world)
        self._add_meshes(placed)

    # --- the hierarchy ------------------------------------------------------------------------------------------------

    def _roots(self) -> list[int]:
        nodes = self.document.table("nodes")
        scenes = self.document.table("scenes")
        if not scenes:
            children = {c for node in nodes for c in node.integers("children", high=len(nodes) - 1)}
            self.scene.notes.append("the file names no scene: all its nodes are shown")
            return [node.index for node in nodes if node.index not in children]
        index = self.document.root.integer("scene", 0)
        if index >= len(scenes):
            raise self.document.root.error(
                "index out of range", "scene", value=index, expected=f"0 to {len(scenes) - 1}"
            )
        if len(scenes) > 1:
            self.scene.notes.append(f"the file has {len(scenes)} scenes: number {index} is shown")
        return scenes[index].integers("nodes", high=len(nodes) - 1)

    def _walk(self) -> list[tuple[Item, Matrix]]:
        """All visible nodes below the roots with their world matrices."""
        nodes = self.document.table("nodes")
        pending = [(nodes[i], _IDENTITY) for i in reversed(self._roots())]
        visible = []
        while pending:
            node, parent = pending.pop()
            if node.index in self._worlds:
                raise node.error("the node has two parents or is its own ancestor", expected="a tree of nodes")
            with np.errstate(over="ignore", invalid="ignore"):
                world = parent @ _local(node)
            if not np.isfinite(world).all():
                raise node.error("its transform leaves the range of numbers", expected="smaller factors")
            self._worlds[node.index] = world
            if _hidden(node, world):
                continue
            visible.append((node, world))
            children = node.integers("children", high=len(nodes) - 1)
            pending.extend((nodes[child], world) for child in reversed(children))
        return visible

    def _instances(self, node: Item, world: Matrix) -> list[Matrix]:
        """The world matrices of a node's mesh: one, or those of EXT_mesh_gpu_instancing."""
        extension = node.extension("EXT_mesh_gpu_instancing")
        if extension is None:
            return [world]
        attributes = extension.item("attributes")
        if attributes is None:
            raise extension.error("missing", "attributes", expected="a JSON object")
        parts = {}
        for key, kind in (("TRANSLATION", "VEC3"), ("ROTATION", "VEC4"), ("SCALE", "VEC3")):
            accessor = self.document.refer(attributes, key, "accessors")
            if accessor is not None:
                parts[key] = self._buffers.floats(accessor, (kind,)).astype(np.float64)
                check_finite(parts[key], f"{key} of instance", file=node.file, place=attributes.at(key))
        counts = {len(values) for values in parts.values()}
        if len(counts) != 1:
            raise attributes.error(
                "wrong numbers of elements", value=sorted(counts), expected="as many of each attribute"
            )
        n = counts.pop()
        move, turn, size = (
            parts.get(key, np.tile(default, (n, 1)))
            for key, default in (("TRANSLATION", (0.0,) * 3), ("ROTATION", (0.0, 0.0, 0.0, 1.0)), ("SCALE", (1.0,) * 3))
        )
        with np.errstate(over="ignore", invalid="ignore"):
            return [world @ _compose(node, move[i], turn[i], size[i]) for i in range(n)]

    # --- meshes -------------------------------------------------------------------------------------------------------

    def _add_meshes(self, placed: list[_Placed]) -> None:
        uses = Counter[int]()
        for p in placed:
            uses[p.mesh.index] += len(p.matrices)
        groups: dict[int, str] = {}
        for p in placed:
            pose = self._pose(p.node, p.mesh)
            label = p.node.text("name", "")
            if pose is not None or uses[p.mesh.index] == 1:
                matrices = [_IDENTITY] if pose is not None and pose.joints is not None else p.matrices
                for world in matrices:
                    self._add_shapes(self._meshes.shapes(p.mesh, pose), world, label, p.node)
                continue
            if not self._meshes.shapes(p.mesh):
                continue
            if p.mesh.index not in groups:
                groups[p.mesh.index] = self._group(p.mesh)
            for world in p.matrices:
                self._add_instance(p, groups[p.mesh.index], world, label)

    def _group(self, mesh: Item) -> str:
        name = _unused(mesh.text("name", "") or f"mesh {mesh.index}", self.scene.groups)
        self.scene.group(name, self._meshes.shapes(mesh))
        return name

    def _add_instance(self, placed: _Placed, group: str, world: Matrix, label: str) -> None:
        transform = _transform(world)
        if transform is None:
            self._add_shapes(self._meshes.shapes(placed.mesh), world, label, placed.node)
        else:
            self.scene.add(shapes.instance(group=group, transform=transform, name=label or None))

    def _add_shapes(self, made: list[Node], world: Matrix, label: str, node: Item) -> None:
        transform = _transform(world)
        for shape in made:
            name = f"{label}: {shape.name}" if label and label != shape.name else shape.name
            if transform is None:
                self.scene.add(_flattened(shape, world, node).replace(name=name))
            elif transform.words:
                self.scene.add(shape.replace(transform=transform, name=name))
            else:
                self.scene.add(shape.replace(name=name))

    @np.errstate(over="ignore", invalid="ignore")  # what overflows is found in the posed vertices
    def _pose(self, node: Item, mesh: Item) -> Pose | None:
        """How the node bends its mesh; None if it does not, so that the mesh may be shared."""
        skin = self.document.refer(node, "skin", "skins")
        if skin is None:
            return Pose(node_weights(node, mesh)) if "weights" in node else None
        nodes = self.document.table("nodes")
        joints = skin.integers("joints", high=len(nodes) - 1)
        if not joints:
            raise skin.error("missing", "joints", expected="at least one")
        inverse = np.tile(_IDENTITY, (len(joints), 1, 1))
        accessor = self.document.refer(skin, "inverseBindMatrices", "accessors")
        if accessor is not None:
            flat = self._buffers.floats(accessor, ("MAT4",))
            if len(flat) < len(joints):
                raise skin.error(
                    "too few matrices", "inverseBindMatrices", value=len(flat), expected=f"{len(joints)}, one a joint"
                )
            check_finite(flat, "matrix", file=skin.file, place=skin.at("inverseBindMatrices"))
            inverse = flat[: len(joints)].astype(np.float64).reshape(-1, 4, 4).transpose(0, 2, 1)
        for i, joint in enumerate(joints):
            if joint not in self._worlds:
                raise skin.error(
                    "the joint is not in the scene", f"joints[{i}]", value=joint, expected="a node of the scene"
                )
        worlds = np.stack([self._worlds[joint] for joint in joints])
        return Pose(node_weights(node, mesh), worlds @ inverse)

    # --- cameras and lights -------------------------------------------------------------------------------------------

    def _add_camera(self, node: Item, camera: Item, world: Matrix) -> None:
        kind = camera.choice("type", ("perspective", "orthographic"))
        values = camera.item(kind)
        if values is None:
            raise camera.error("missing", kind, expected="a JSON object")
        try:
            view = _view(node, world)
            if kind == "perspective":
                vfov = math.degrees(values.number("yfov", low=0, high=math.pi))
                made = cameras.perspective(vfov=vfov, **view)
                aspect = values.number("aspectRatio", 0.0, low=0)
            else:
                height = 2 * abs(values.number("ymag"))
                made = cameras.orthographic(height=height, **view)
                aspect = 2 * abs(values.number("xmag")) / height
        except Error as error:
            raise error if error.file else error.within(values.place, file=node.file) from None
        first = not self.scene.cameras
        label = node.text("name", "") or camera.text("name", "") or f"camera {camera.index}"
        self.scene.cameras[_unused(label, self.scene.cameras)] = made
        if first and aspect > 0:
            self._set_aspect(aspect)

    def _set_aspect(self, aspect: float) -> None:
        """The picture gets the first camera's proportions."""
        film = self.scene.film
        film.width = min(max(round(_LONG_SIDE * min(aspect, 1.0)), 1), _LONG_SIDE)
        film.height = min(max(round(_LONG_SIDE / max(aspect, 1.0)), 1), _LONG_SIDE)

    def _add_light(self, node: Item, reference: Item, world: Matrix) -> None:
        table = self.document.extension_table("KHR_lights_punctual", "lights")
        index = reference.integer("light")
        if index >= len(table):
            raise reference.error(
                "index out of range", "light", value=index, expected=f"0 to {len(table) - 1}" if table else "none"
            )
        light = table[index]
        kind = light.choice("type", ("point", "spot", "directional"))
        strength = light.number("intensity", 1.0, low=0)
        color = tuple(c * strength for c in light.numbers("color", 3, (1.0, 1.0, 1.0), low=0))
        name = node.text("name", "") or light.text("name", "") or None
        try:
            if kind == "point":
                made = lights.point(position=world[:3, 3], intensity=color, name=name)
            else:
                view = _view(node, world)
                if kind == "spot":
                    made = lights.spot(
                        position=view["origin"], target=view["target"], intensity=color, name=name, **_cone(light)
                    )
                else:
                    direction = np.subtract(view["target"], view["origin"])
                    made = lights.directional(direction=direction, irradiance=color, name=name)
        except Error as error:
            raise error if error.file else error.within(light.place, file=node.file) from None
        self.scene.add(made)
        note = "lights: 1 cd is taken for 1 W/sr, 1 lx for 1 W/m^2"
        if note not in self.scene.notes:
            self.scene.notes.append(note)


def _cone(light: Item) -> dict[str, float]:
    spot = light.item("spot") or Item({}, light.file, light.at("spot"))
    outer = spot.number("outerConeAngle", math.pi / 4, low=0, high=math.pi / 2 + 1e-6)
    inner = spot.number("innerConeAngle", 0.0, low=0, high=outer)
    outer_degrees = min(max(math.degrees(outer), 0.01), 90.0)
    return {"cone_angle": outer_degrees, "edge": 1.0 - inner / outer if outer > 0 else 0.0}


def _view(node: Item, world: Matrix) -> dict[str, Matrix]:
    """Origin, target and up of something at a node that looks along its -z axis with its y axis up."""
    forward, up = -world[:3, 2], world[:3, 1]
    length = float(np.linalg.norm(forward))
    if not length > 0 or not np.linalg.norm(np.cross(forward / length, up)) > 1e-12 * np.linalg.norm(up):
        raise node.error("its transform is flat, so that nothing can look along it", expected="scales other than 0")
    return {"origin": world[:3, 3], "target": world[:3, 3] + forward / length, "up": up / np.linalg.norm(up)}


def _local(node: Item) -> Matrix:
    """A node's own matrix."""
    if "matrix" in node:
        rows = np.array(node.numbers("matrix", 16)).reshape(4, 4).T
        if np.abs(rows[3] - _IDENTITY[3]).max() > 1e-5:
            raise node.error("not an affine matrix", "matrix", value=rows[3].tolist(), expected="last row 0, 0, 0, 1")
        rows[3] = _IDENTITY[3]
        return rows
    move = node.numbers("translation", 3, (0.0, 0.0, 0.0))
    turn = node.numbers("rotation", 4, (0.0, 0.0, 0.0, 1.0))
    size = node.numbers("scale", 3, (1.0, 1.0, 1.0))
    return _compose(node, np.array(move), np.array(turn), np.array(size))


def _compose(node: Item, move: Matrix, turn: Matrix, size: Matrix) -> Matrix:
    """Scale, then rotate by a quaternion (x, y, z, w), then translate."""
    length = float(np.linalg.norm(turn))
    if not length > 1e-12:
        raise node.error("a rotation without direction", "rotation", value=turn.tolist(), expected="a unit quaternion")
    x, y, z, w = turn / length
    rotation = np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )
    result = np.eye(4)
    result[:3, :3] = rotation * size
    result[:3, 3] = move
    return result


def _hidden(node: Item, world: Matrix) -> bool:
    """Whether the node and all below it are not shown: by KHR_node_visibility, or by a scale of 0 along all axes."""
    visibility = node.extension("KHR_node_visibility")
    if visibility is not None and "visible" in visibility and not visibility.flag("visible"):
        return True
    return not world[:3, :3].any()


def _transform(world: Matrix) -> Transform | None:
    """The transform, or None if it is flat: it cannot be inverted."""
    if np.array_equal(world, _IDENTITY):
        return Transform()
    try:
        return matrix(world[:3])
    except Error:
        return None


def _flattened(shape: Node, world: Matrix, node: Item) -> Node:
    """A mesh with a flat transform applied to its vertices; its normals go."""
    points = shape["positions"].astype(np.float64) @ world[:3, :3].T + world[:3, 3]
    check_finite(points, "vertex", file=node.file, place=node.place)
    return shape.replace(positions=points.astype(np.float32), normals=None)


def _unused(name: str, taken: object) -> str:
    """`name`, or with a number after it if that is taken."""
    assert hasattr(taken, "__contains__")
    name = name.replace("\0", "")
    candidate, n = name, 1
    while candidate in taken or not candidate:
        n += 1
        candidate = f"{name} {n}"
    return candidate
