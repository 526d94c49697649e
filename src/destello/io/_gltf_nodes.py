"""glTF's node hierarchy: world transforms, and what stands at each node (meshes, cameras, lights)."""

from __future__ import annotations

import math
from collections import Counter
from dataclasses import dataclass
from typing import Any

import numpy as np

import destello.cameras as cameras
import destello.lights as lights
import destello.shapes as shapes
from destello.animation import Animation
from destello.errors import Error, SceneError
from destello.io._arrays import check_finite
from destello.io._gltf_accessors import Buffers
from destello.io._gltf_animation import Motions
from destello.io._gltf_json import Document, Item
from destello.io._gltf_meshes import Meshes, Pose, node_weights
from destello.io._gltf_transforms import (
    IDENTITY,
    Matrix,
    Placement,
    compose,
    flattened,
    given,
    local,
    still_words,
    view,
)
from destello.nodes import Node
from destello.scene import Scene
from destello.transform import Word

NODE_EXTENSIONS = frozenset({"KHR_lights_punctual", "KHR_node_visibility", "EXT_mesh_gpu_instancing"})
_LONG_SIDE = 1280
_DEEPEST_MOTION = 256  # nodes above each other in an animation


@dataclass
class _Placed:
    """A mesh at a node, once for each placement."""

    node: Item
    mesh: Item
    placements: list[Placement]


class Placer:
    """Fills a scene with what the nodes of a document hold."""

    def __init__(self, document: Document, scene: Scene, meshes: Meshes, buffers: Buffers, motions: Motions) -> None:
        self.document = document
        self.scene = scene
        self._motions = motions
        self._parents: dict[int, int] = {}
        self._moving: set[int] = set()  # nodes that are animated, and all below them
        self._meshes = meshes
        self._buffers = buffers
        self._worlds: dict[int, Matrix] = {}

    def place(self) -> None:
        """Walks the default scene and adds everything in it."""
        placed: list[_Placed] = []
        for node, world in self._walk():
            mesh = self.document.refer(node, "mesh", "meshes")
            if mesh is not None:
                placed.append(_Placed(node, mesh, self._placements(node, world)))
            camera = self.document.refer(node, "camera", "cameras")
            if camera is not None:
                self._add_camera(node, camera, *self._stand(node, world))
            light = node.extension("KHR_lights_punctual")
            if light is not None:
                self._add_light(node, light, *self._stand(node, world))
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
        pending = [(nodes[i], IDENTITY) for i in reversed(self._roots())]
        visible = []
        while pending:
            node, parent = pending.pop()
            if node.index in self._worlds:
                raise node.error("the node has two parents or is its own ancestor", expected="a tree of nodes")
            with np.errstate(over="ignore", invalid="ignore"):
                world = parent @ local(node)
            if not np.isfinite(world).all():
                raise node.error("its transform leaves the range of numbers", expected="smaller factors")
            self._worlds[node.index] = world
            if node in self._motions or self._parents.get(node.index) in self._moving:
                self._moving.add(node.index)
            if _hidden(node) or (node.index not in self._moving and not world[:3, :3].any()):
                continue
            visible.append((node, world))
            children = node.integers("children", high=len(nodes) - 1)
            self._parents.update((child, node.index) for child in children if child not in self._worlds)
            pending.extend((nodes[child], world) for child in reversed(children))
        return visible

    def _placements(self, node: Item, world: Matrix) -> list[Placement]:
        """Where a node's mesh stands: at one place, or at those of EXT_mesh_gpu_instancing."""
        extension = node.extension("EXT_mesh_gpu_instancing")
        own = [IDENTITY] if extension is None else self._instances(node, extension)
        if node.index in self._moving:
            return [self._motion(node, matrix) for matrix in own]
        with np.errstate(over="ignore", invalid="ignore"):
            return [world @ matrix for matrix in own]

    def _motion(self, node: Item, own: Matrix = IDENTITY) -> Animation:
        """How something at a node moves that has the matrix `own` there."""
        try:
            return Animation(self._words(node, own))
        except SceneError as error:
            raise error.within(node.place, file=node.file) from None

    def _words(self, node: Item, own: Matrix) -> list[Word]:
        """From the node up to the root; what stands still is merged."""
        words: list[Word] = []
        still, index = own, node.index
        for _ in range(_DEEPEST_MOTION):
            if index not in self._moving:
                return [*words, *still_words(self._worlds[index] @ still)]
            above = self.document.table("nodes")[index]
            if above in self._motions:
                words += [*still_words(still), *self._motions.words(above)]
                still = IDENTITY
            else:
                still = local(above) @ still
            if index not in self._parents:
                return [*words, *still_words(still)]
            index = self._parents[index]
        raise node.error("too many animated nodes above it", expected=f"at most {_DEEPEST_MOTION}")

    def _stand(self, node: Item, world: Matrix) -> tuple[Matrix, Animation | None]:
        """Where a camera or a light stands: by a matrix, or at its node's origin with an animation."""
        return (IDENTITY, self._motion(node)) if node.index in self._moving else (world, None)

    def _instances(self, node: Item, extension: Item) -> list[Matrix]:
        """The matrices of EXT_mesh_gpu_instancing in their node."""
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
            return [compose(node, move[i], turn[i], size[i]) for i in range(n)]

    # --- meshes -------------------------------------------------------------------------------------------------------

    def _add_meshes(self, placed: list[_Placed]) -> None:
        uses = Counter[int]()
        for p in placed:
            uses[p.mesh.index] += len(p.placements)
        groups: dict[int, str] = {}
        for p in placed:
            pose = self._pose(p.node, p.mesh)
            label = p.node.text("name", "")
            if pose is not None or uses[p.mesh.index] == 1:
                skinned = pose is not None and pose.joints is not None
                for place in [IDENTITY] if skinned else p.placements:
                    self._add_shapes(self._meshes.shapes(p.mesh, pose), place, label, p.node)
                continue
            if not self._meshes.shapes(p.mesh):
                continue
            if p.mesh.index not in groups:
                groups[p.mesh.index] = self._group(p.mesh)
            for place in p.placements:
                self._add_instance(p, groups[p.mesh.index], place, label)

    def _group(self, mesh: Item) -> str:
        name = _unused(mesh.text("name", "") or f"mesh {mesh.index}", self.scene.groups)
        self.scene.group(name, self._meshes.shapes(mesh))
        return name

    def _add_instance(self, placed: _Placed, group: str, place: Placement, label: str) -> None:
        placed_by = given(place)
        if placed_by is None:
            self._add_shapes(self._meshes.shapes(placed.mesh), place, label, placed.node)
        else:
            self.scene.add(shapes.instance(group=group, name=label or None, **placed_by))

    def _add_shapes(self, made: list[Node], place: Placement, label: str, node: Item) -> None:
        placed_by = given(place)
        for shape in made:
            name = f"{label}: {shape.name}" if label and label != shape.name else shape.name
            if placed_by is None and not isinstance(place, Animation):
                self.scene.add(flattened(shape, place, node).replace(name=name))
            else:
                self.scene.add(shape.replace(name=name, **(placed_by or {})))

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
        inverse = np.tile(IDENTITY, (len(joints), 1, 1))
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
        note = "skins are not animated: skinned meshes keep the pose in the file"
        if self._motions and not self._moving.isdisjoint(joints) and note not in self.scene.notes:
            self.scene.notes.append(note)
        worlds = np.stack([self._worlds[joint] for joint in joints])
        return Pose(node_weights(node, mesh), worlds @ inverse)

    # --- cameras and lights -------------------------------------------------------------------------------------------

    def _add_camera(self, node: Item, camera: Item, world: Matrix, motion: Animation | None) -> None:
        kind = camera.choice("type", ("perspective", "orthographic"))
        values = camera.item(kind)
        if values is None:
            raise camera.error("missing", kind, expected="a JSON object")
        try:
            seen: dict[str, Any] = {**view(node, world), "animation": motion}
            if kind == "perspective":
                vfov = math.degrees(values.number("yfov", low=0, high=math.pi))
                made = cameras.perspective(vfov=vfov, **seen)
                aspect = values.number("aspectRatio", 0.0, low=0)
            else:
                height = 2 * abs(values.number("ymag"))
                made = cameras.orthographic(height=height, **seen)
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

    def _add_light(self, node: Item, reference: Item, world: Matrix, motion: Animation | None) -> None:
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
                seen = view(node, world)
                if kind == "spot":
                    made = lights.spot(
                        position=seen["origin"], target=seen["target"], intensity=color, name=name, **_cone(light)
                    )
                else:
                    direction = np.subtract(seen["target"], seen["origin"])
                    made = lights.directional(direction=direction, irradiance=color, name=name)
        except Error as error:
            raise error if error.file else error.within(light.place, file=node.file) from None
        self.scene.add(made.replace(animation=motion))
        note = "lights: 1 cd is taken for 1 W/sr, 1 lx for 1 W/m^2"
        if note not in self.scene.notes:
            self.scene.notes.append(note)


def _cone(light: Item) -> dict[str, float]:
    spot = light.item("spot") or Item({}, light.file, light.at("spot"))
    outer = spot.number("outerConeAngle", math.pi / 4, low=0, high=math.pi / 2 + 1e-6)
    inner = spot.number("innerConeAngle", 0.0, low=0, high=outer)
    outer_degrees = min(max(math.degrees(outer), 0.01), 90.0)
    return {"cone_angle": outer_degrees, "edge": 1.0 - inner / outer if outer > 0 else 0.0}


def _hidden(node: Item) -> bool:
    """Whether KHR_node_visibility hides the node and all below it."""
    visibility = node.extension("KHR_node_visibility")
    return visibility is not None and "visible" in visibility and not visibility.flag("visible")


def _unused(name: str, taken: object) -> str:
    """`name`, or with a number after it if that is taken."""
    assert hasattr(taken, "__contains__")
    name = name.replace("\0", "")
    candidate, n = name, 1
    while candidate in taken or not candidate:
        n += 1
        candidate = f"{name} {n}"
    return candidate
