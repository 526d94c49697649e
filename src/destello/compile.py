"""From a scene to the core's scene: arrays checked, files read, equal things shared, trees built."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from destello.assets import Assets
from destello.compile_errors import core_errors
from destello.compile_materials import MaterialCompiler, rows
from destello.defaults import ensure_camera, ensure_light
from destello.errors import Error, InputError, SceneError, did_you_mean
from destello.fingerprint import HashingBuilder
from destello.geometry import mesh_arrays
from destello.image_table import ImageTable
from destello.mesh_checks import check_mesh, check_spheres
from destello.nodes import Node
from destello.tangents import kept_tangents, wanted_tangents
from destello.texture_memory import fit, largest, read_size, shrunk, stored_images
from destello.transform import Transform

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from destello import _core
    from destello.scene import Scene

QUALITIES = ("fast", "balanced", "high")
WORLD = 0  # the core's group that rays see


@dataclass
class CompiledScene:
    """What the renderer takes.

    Attributes:
        core: the core's scene, with its trees.
        cameras: the core's number of each camera, by name, in the scene's order.
        width, height: of the film, px.
        filter: the reconstruction filter as the renderer's settings want it: {"type": ..., parameters}.
        stats: the core's counts (triangles, spheres, instances, bytes...).
        notes: the scene's notes and what compiling found: one line each.
        largest_textures: which images need most memory, in words.
        fingerprint: hash of everything that the core was told: scenes that have the same are the same to it.
    """

    core: _core.Scene
    cameras: dict[str, int]
    width: int
    height: int
    filter: dict[str, Any]
    stats: dict[str, Any] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)
    fingerprint: str = ""
    largest_textures: str = ""


@dataclass(frozen=True)
class TreeOptions:
    """How trees are built.

    Attributes:
        quality: `fast` (geometry that changes all the time), `balanced` or `high` (long renders).
        device: the device that will render: on a CUDA device, it also builds the trees of large scenes.
        threads: of the CPU; 0: one a core.
    """

    quality: str = "balanced"
    device: str = "cpu"
    threads: int = 0

    def for_core(self) -> dict[str, Any]:
        """The arguments of `_core.SceneBuilder.build`. Raises InputError for an unknown quality."""
        kind, _, index = self.device.partition(":")
        return {
            "quality": check_quality(self.quality),
            "threads": self.threads,
            "cuda_device": int(index or 0) if kind == "cuda" else -1,
        }


def check_quality(name: object) -> str:
    """The name of a build quality. Raises InputError."""
    if name not in QUALITIES:
        expected = did_you_mean(name, QUALITIES) if isinstance(name, str) else ", ".join(QUALITIES)
        raise InputError("no such quality of trees", place="build", value=name, expected=expected)
    return str(name)


def compile_scene(
    scene: Scene,
    *,
    allow_missing: bool | None = None,
    base_dir: Path | None = None,
    tree: TreeOptions | None = None,
    texture_budget: str | int | None = None,
) -> CompiledScene:
    """Builds the core's scene. See `Scene.compile`."""
    options = (tree or TreeOptions()).for_core()
    try:
        return _compile(scene, allow_missing, base_dir, options, read_size(texture_budget))
    except Error as error:
        raise error.within(None, file=scene.source) from error.__cause__


def _compile(
    scene: Scene, allow_missing: bool | None, base_dir: Path | None, options: dict[str, Any], budget: int | None
) -> CompiledScene:
    from destello import _core

    scene.validate()
    scene = scene.at_frame(0)
    assets = Assets(scene, allow_missing=allow_missing, base_dir=base_dir)
    ensure_camera(scene, assets.mesh_scene)
    ensure_light(scene, assets.mesh_scene)
    builder = HashingBuilder(_core.SceneBuilder())
    compiler = SceneCompiler(builder, assets, scene.render.working_space)
    if budget is not None:
        compiler.fit_textures(scene, budget)
    compiler.scene(scene)
    assets.files.finish()
    with core_errors(scene.name or "scene"):
        core = builder.build(**options)
    return CompiledScene(
        core=core,
        cameras=compiler.cameras,
        width=scene.film.width,
        height=scene.film.height,
        filter=filter_settings(scene.film.filter),
        stats=dict(core.stats()),
        notes=[*scene.notes, *assets.notes, *compiler.notes(), *_working_space_notes(scene)],
        fingerprint=builder.fingerprint(),
        largest_textures=compiler.largest_textures(),
    )


def _working_space_notes(scene: Scene) -> list[str]:
    """What the core knows in Rec.709 alone."""
    space = scene.render.working_space
    fixed = {node.type for node in scene.nodes() if node.type == "planet" or node.params.get("abbe")}
    return [f"{name}: its own colours are Rec.709's, not {space}'s" for name in sorted(fixed) if space != "rec709"]


def filter_settings(node: Node | None) -> dict[str, Any]:
    """A filter node as the renderer's settings want it; None is the default filter."""
    return {"type": "gaussian"} if node is None else {"type": node.type, **node.params}


@dataclass(frozen=True)
class Context:
    """Where a shape comes from: its materials, its files, and what encloses it.

    Attributes:
        materials, assets: of the scene that the shape belongs to.
        outer, outer1: the placement of the enclosing mesh_file when the shutter opens and closes.
        material, material_node: the enclosing mesh_file's material, which goes before the shape's own.
    """

    materials: MaterialCompiler
    assets: Assets
    outer: Transform | None = None
    outer1: Transform | None = None
    material: int | None = None
    material_node: Node | None = None


@dataclass
class SphereBatch:
    """Spheres of one group and one material, so that the core gets them in one call."""

    centers: list[Any] = field(default_factory=list)
    radii: list[Any] = field(default_factory=list)
    ends: list[Any] = field(default_factory=list)


class SceneCompiler:
    """Puts one scene, and those in its mesh files, into a core builder."""

    def __init__(self, builder: Any, assets: Assets, working_space: str = "rec709") -> None:
        self.cameras: dict[str, int] = {}
        self._builder = builder
        self._images = ImageTable(builder, working_space)
        self._context = Context(MaterialCompiler(builder, assets, self._images), assets)
        self._inner: dict[int, Context] = {}  # by id of the mesh file's assets
        self._meshes: dict[tuple[int | str, ...], int] = {}
        self._kept: list[Any] = []  # arrays whose id() is in a key
        self._spheres: dict[tuple[int, int, bool], SphereBatch] = {}
        self._dropped: dict[str, int] = {}
        self._groups: dict[str, int] = {}
        self.volume_owners: list[int] = []  # the shapes of instances that come after those of the shapes
        self._volumes: dict[str, list[tuple[Node, str]]] = {}  # shapes with volumes and their places, by group

    def fit_textures(self, scene: Scene, budget: int) -> None:
        """Images will be made smaller, the largest first, until all need at most `budget` bytes."""
        images = stored_images(scene, self._context.assets)
        halvings = fit(images, budget)
        if halvings:
            self._images.halvings = halvings
            self._context.assets.notes.append(shrunk(images, halvings, budget))

    def largest_textures(self) -> str:
        """Which images need most memory, in words; empty without any."""
        return largest(self._images.stored)

    def scene(self, scene: Scene) -> None:
        """Adds everything."""
        for name, group in scene.groups.items():
            self._groups[name] = self._builder.add_group()
            for i, shape in enumerate(group.shapes):
                if has_volume(shape):
                    self._volumes.setdefault(name, []).append((shape, label(f"groups.{name}[{i}]", shape)))
                else:
                    self._shape(self._groups[name], shape, label(f"groups.{name}[{i}]", shape), self._context)
        for i, shape in enumerate(scene.shapes):
            self._shape(WORLD, shape, label(f"shapes[{i}]", shape), self._context)
        for i, shape in enumerate(scene.shapes):  # last: live scenes count on the instances of shapes being the first
            if shape.type == "instance" and shape["group"] in self._volumes:
                self._place_volumes(shape, label(f"shapes[{i}]", shape))
                self.volume_owners.append(i)
        self._flush_spheres()
        self._lights(scene)
        if scene.environment is not None:
            self._environment(scene.environment)
        for name, camera in scene.cameras.items():
            with core_errors(f"cameras.{name}"):
                params = self._context.materials.params(camera, f"cameras.{name}")
                self.cameras[name] = self._builder.add_camera(camera.type, params)

    def notes(self) -> list[str]:
        """What was left out."""
        if not self._dropped:
            return []
        total, first = sum(self._dropped.values()), next(iter(self._dropped))
        where = first if len(self._dropped) == 1 else f"{len(self._dropped)} meshes, the first is {first}"
        return [f"{total} triangle{'s' if total > 1 else ''} without area left out ({where})"]

    # --- parts --------------------------------------------------------------------------------------------------------

    def _lights(self, scene: Scene) -> None:
        for i, light in enumerate(scene.lights):
            place = label(f"lights[{i}]", light)
            params = self._context.materials.params(light, place, skip=("transform",))
            with core_errors(place):
                self._builder.add_light(light.type, params, transform=rows(light["transform"]))

    def _environment(self, node: Node) -> None:
        params = self._context.materials.params(node, "environment", skip=("image", "transform"))
        image = None
        if node.params.get("image") is not None:
            image = self._context.materials.environment_texels(node["image"], "environment.image")
        with core_errors("environment"):
            self._builder.set_environment(node.type, params, transform=rows(node["transform"]), image=image)

    def _shape(self, group: int, shape: Node, place: str, context: Context) -> None:
        if shape.type == "sphere":
            self._sphere(group, shape, place, context)
        elif shape.type == "spheres":
            self._many_spheres(group, shape, place, context)
        elif shape.type == "mesh_file":
            self._mesh_file(group, shape, place, context)
        elif shape.type == "instance":
            with core_errors(place):
                first, last = self._placement(shape, context)
                self._builder.add_instance(group, self._groups[shape["group"]], rows(first or Transform()), rows(last))
        else:
            self._mesh(group, shape, place, context)

    def _place_volumes(self, instance: Node, place: str) -> None:
        """A group for this instance alone, of what has a volume in the one that it names: grids stand in the world."""
        name, outer = instance["group"], instance["transform"] or Transform()
        if instance["transform1"] is not None:
            expected = "instances that rest while the shutter is open, or groups without medium_volume"
            raise SceneError("a volume in a group that moves", place=place, value=name, expected=expected)
        assets = self._context.assets
        context = Context(MaterialCompiler(self._builder, assets, self._images, outer), assets)
        group = self._builder.add_group()
        for shape, where in self._volumes[name]:
            self._shape(group, shape, where, context)
        with core_errors(place):
            self._builder.add_instance(WORLD, group, rows(outer), None)

    def _material(self, shape: Node, place: str, context: Context) -> int:
        if context.material is not None:
            return context.material
        materials = context.materials
        if has_volume(shape) and shape.params.get("transform1") is not None:
            expected = "a shape that rests while the shutter is open, or a material without medium_volume"
            raise SceneError("a volume in a shape that moves", place=place, expected=expected)
        if carries_volume(shape):
            materials = materials.placed(shape["transform"])
        materials.check_uvs(shape, place)
        return materials.material(shape["material"], f"{place}.material")

    def _placement(self, shape: Node, context: Context) -> tuple[Transform | None, Transform | None]:
        """The shape's transforms when the shutter opens and closes, in its group."""
        first, last = shape["transform"], shape["transform1"]
        outer, outer1 = context.outer, context.outer1
        if outer is None:
            return first, last
        moving = last is not None or outer1 is not None
        end = (outer1 or outer) @ (last or first or Transform())
        return outer @ (first or Transform()), end if moving else None

    def _mesh(self, group: int, shape: Node, place: str, context: Context) -> None:
        arrays = mesh_arrays(shape)
        material = self._material(shape, place, context)
        first, last = self._placement(shape, context)
        node = shape["material"] if context.material is None else context.material_node
        with core_errors(place):
            mesh = self._mesh_number(arrays, place, wanted_tangents(arrays, node) if last is None else ())
            self._builder.place_mesh(group, mesh, material, transform=rows(first), transform1=rows(last))

    def _mesh_number(self, arrays: Mapping[str, NDArray[Any]], place: str, tangents: tuple[str, ...]) -> int:
        """Meshes that share their arrays are one. `tangents`: those that are to be made."""
        key: tuple[int | str, ...] = (*(id(arrays[name]) for name in sorted(arrays)), *tangents)
        if key not in self._meshes:
            checked = check_mesh(arrays, place)
            if tangents:
                checked = check_mesh(kept_tangents(arrays, tangents), place)
            mesh, dropped = self._builder.add_mesh(**self._images.vertex_colors(checked))
            if dropped:
                self._dropped[place] = dropped
            self._meshes[key] = mesh
            self._kept.append(arrays)
        return self._meshes[key]

    def _sphere(self, group: int, shape: Node, place: str, context: Context) -> None:
        center, end = shape["center"], shape["center1"]
        batch = self._batch(group, self._material(shape, place, context), end is not None)
        batch.centers.append(np.array([center], np.float32))
        batch.radii.append(np.array([shape["radius"]], np.float32))
        batch.ends.append(np.array([center if end is None else end], np.float32))

    def _many_spheres(self, group: int, shape: Node, place: str, context: Context) -> None:
        check_spheres({name: shape[name] for name in ("centers", "radii", "centers1")}, place)
        end = shape["centers1"]
        batch = self._batch(group, self._material(shape, place, context), end is not None)
        batch.centers.append(shape["centers"])
        batch.radii.append(shape["radii"])
        batch.ends.append(shape["centers"] if end is None else end)

    def _batch(self, group: int, material: int, moving: bool) -> SphereBatch:
        return self._spheres.setdefault((group, material, moving), SphereBatch())

    def _flush_spheres(self) -> None:
        for (group, material, moving), batch in self._spheres.items():
            centers, radii, ends = (np.concatenate(part) for part in (batch.centers, batch.radii, batch.ends))
            with core_errors("spheres"):
                self._builder.add_spheres(group, centers, radii, material, centers1=ends if moving else None)

    def _mesh_file(self, group: int, shape: Node, place: str, context: Context) -> None:
        """Every shape in the file, under the mesh_file's transform; groups in it are spread out."""
        found = context.assets.mesh_file(shape, place)
        if found is None:
            if context.assets.files.allow_missing:
                context.assets.notes.append(f"missing mesh file {shape['path']}: left out")
            return
        key = id(found.assets)
        if key not in self._inner:
            self._inner[key] = Context(MaterialCompiler(self._builder, found.assets, self._images), found.assets)
        inner = self._inner[key]
        first, last = self._placement(shape, context)
        material = context.material
        if material is None and shape["material"] is not None:
            material = self._material(shape, place, context)
        node = shape["material"] if context.material is None else context.material_node
        inside = Context(inner.materials, inner.assets, first or Transform(), last, material, node)
        for i, part in enumerate(found.scene.shapes):
            self._inner_shape(group, found.scene, part, label(f"{place}.shapes[{i}]", part), inside)

    def _inner_shape(self, group: int, scene: Scene, part: Node, place: str, context: Context) -> None:
        if part.type in ("sphere", "spheres"):
            raise SceneError("spheres cannot stand in a mesh file", place=place, expected="meshes")
        if part.type != "instance":
            self._shape(group, part, place, context)
            return
        first, last = self._placement(part, context)
        inside = replace(context, outer=first, outer1=last)
        for i, shape in enumerate(scene.groups[part["group"]].shapes):
            self._inner_shape(group, scene, shape, label(f"{place}[{i}]", shape), inside)


def has_volume(shape: Node) -> bool:
    """Whether the shape's material has a volume."""
    return any(node.kind == "volume" for node in shape.walk())


def carries_volume(shape: Node) -> bool:
    """Whether a volume stands where the shape's transform takes it."""
    return bool(has_volume(shape) and shape.params.get("transform"))


def label(place: str, node: Node) -> str:
    """A place with the node's name, if it has one."""
    return f"{place} ({node.name})" if node.name else place
