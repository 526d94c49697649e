"""A scene compiled so that it can be edited: instances place what stands in it, materials can be replaced."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from destello.compile import WORLD, Context, SceneCompiler, carries_volume, has_volume, label
from destello.compile_errors import core_errors
from destello.compile_materials import MaterialCompiler, rows
from destello.geometry import mesh_arrays
from destello.nodes import Node, equal_values
from destello.tangents import wanted_tangents
from destello.transform import Transform

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from destello.assets import Assets
    from destello.scene import Scene

    Rows = NDArray[np.float32]

PLACEMENT = frozenset({"transform", "transform1", "animation"})
SPHERE_PLACEMENT = frozenset({"center", "radius", "center1", "animation"})
_SMOOTH = dict.fromkeys(("positions", "normals", "uvs", "second_uvs"), np.empty(0))


class NotInPlace(Exception):
    """An edit that takes a new compilation; the reason, in words."""


class LiveCompiler(SceneCompiler):
    """Puts a scene into a `_core.SceneEditor`, and then what differs in later versions of it.

    Shape i of the scene is instance i, of a group of its own in which it stands untransformed: a sphere as the unit
    sphere. An instance's group is the one that it names.
    """

    def __init__(self, editor: Any, assets: Assets, working_space: str) -> None:
        super().__init__(editor, assets, working_space)
        self.materials = LiveMaterials(editor, assets, self._images)
        self._context = Context(self.materials, assets)
        self._own_groups: list[int | None] = []  # of each shape; None: it is an instance of a group with a name
        self._standing: Node | None = None

    # --- compiling ----------------------------------------------------------------------------------------------------

    def _shape(self, group: int, shape: Node, place: str, context: Context) -> None:
        if group != WORLD:
            super()._shape(group, shape, place, context)
            return
        own = None
        if shape.type == "instance":
            super()._shape(WORLD, shape, place, context)
        else:
            own = self._builder.add_group()
            self._standing = shape
            super()._shape(own, shape, place, context)
            self._standing = None
            with core_errors(place):
                first, last = placement(shape)
                self._builder.add_instance(WORLD, own, first, last)
        self._own_groups.append(own)

    def _placement(self, shape: Node, context: Context) -> tuple[Transform | None, Transform | None]:
        return (None, None) if shape is self._standing else super()._placement(shape, context)

    def _sphere(self, group: int, shape: Node, place: str, context: Context) -> None:
        if shape is not self._standing:
            super()._sphere(group, shape, place, context)
            return
        material = self._material(shape, place, context)
        radius = np.array([np.copysign(1, shape["radius"])], np.float32)
        with core_errors(place):
            self._builder.add_spheres(group, np.zeros((1, 3), np.float32), radius, material)

    # --- editing ------------------------------------------------------------------------------------------------------

    def apply(self, old: Scene, new: Scene) -> None:
        """Tells the editor in what `new` differs from `old`, which it holds. Raises NotInPlace, or SceneError."""
        _check_same_geometry(old, new)
        self._apply_materials(old, new)
        for i, (before, after) in enumerate(zip(old.shapes, new.shapes, strict=True)):
            if before is not after and not _same_placement(before, after):
                if (after.type == "instance" and after["group"] in self._volumes) or has_volume(after):
                    raise NotInPlace(f"a volume follows {label(f'shapes[{i}]', after)}")
                with core_errors(label(f"shapes[{i}]", after)):
                    self._builder.set_instance(i, *placement(after))
        if old.lights != new.lights:
            self._builder.clear_lights()
            self._lights(new)
        if old.environment is not new.environment and old.environment != new.environment:
            self._apply_environment(old.environment, new.environment)

    def _apply_environment(self, old: Node | None, new: Node | None) -> None:
        if new is None:
            self._builder.clear_environment()
        elif new.type == "image" and (old is None or old.type != "image" or old["image"] != new["image"]):
            self._environment(new)
            self._builder.environment_is_new()
        else:
            params = self.materials.params(new, "environment", skip=("image", "transform"))
            with core_errors("environment"):
                self._builder.set_environment_values(new.type, params, transform=rows(new["transform"]))

    def _apply_materials(self, old: Scene, new: Scene) -> None:
        changed = [
            (place, before, after, self.materials.known(before))
            for (place, before), (_, after) in zip(old.all_shapes(), new.all_shapes(), strict=True)
            if before is not after and "material" in after.doc.params and _material(before) != _material(after)
        ]
        if not changed:
            return
        self.materials.keep_only(materials_of(new), {_material(a): n for _, _, a, n in changed})
        for place, before, after, number in changed:
            if carries_volume(before) or carries_volume(after):
                raise NotInPlace(f"a volume stands where {label(place, after)} is placed")
            if after.type == "mesh_file" and after["material"] is None:
                raise NotInPlace(f"{place} has its file's materials again")
            _check_same_tangents(before, after, label(place, after))
            self.materials.check_uvs(after, label(place, after))
            now = self.materials.material(after["material"], f"{label(place, after)}.material")
            if now != number or (before.type == "mesh_file" and before["material"] is None):
                self._give_material(place, now)
        self.materials.blank()

    def _give_material(self, place: str, material: int) -> None:
        if not place.startswith("shapes["):
            raise NotInPlace(f"{place} gets a material that others in its group do not have")
        group = self._own_groups[int(place[len("shapes[") : -1])]
        with core_errors(place):
            self._builder.set_group_material(group, material)


class LiveMaterials(MaterialCompiler):
    """As MaterialCompiler; numbers that no node needs any more are given to new ones."""

    _free: list[int]
    _preferred: Mapping[Node | None, int | None]

    def __init__(self, *args: Any) -> None:
        super().__init__(*args)
        self._free = []
        self._preferred = {}

    def known(self, shape: Node) -> int | None:
        """The number of a shape's material; None if it has the materials of its file."""
        node = shape["material"]
        if node is None:
            return None if shape.type == "mesh_file" else self._default
        return self._materials.get(node)

    def keep_only(self, needed: set[Node], preferred: Mapping[Node | None, int | None]) -> None:
        """Frees the numbers of all other nodes. `preferred`: numbers that new nodes should get if they are free."""
        self._free += [number for node, number in self._materials.items() if node not in needed]
        self._materials = {node: number for node, number in self._materials.items() if node in needed}
        self._preferred = preferred

    def material(self, node: Node | None, place: str) -> int:
        """As the base class; the number is one of the free ones if there are any."""
        if node is None or node in self._materials:
            return super().material(node, place)
        super().material(node, place)
        if self._free:
            wanted = self._preferred.get(node)
            number = wanted if wanted in self._free and wanted is not None else self._free[-1]
            self._free.remove(number)
            self._replace(number)
            self._materials[node] = number
        return self._materials[node]

    def blank(self) -> None:
        """Makes the materials of free numbers plain, so that what is no longer in the scene has no influence."""
        for number in self._free:
            self._builder.add_material("diffuse", {})
            self._replace(number)

    def _replace(self, number: int) -> None:
        self._builder.replace_material(number)


def placement(shape: Node) -> tuple[Rows, Rows | None]:
    """The shape's transforms when the shutter opens and closes, (3, 4) float32 each; None where it rests."""
    if shape.type == "sphere":
        radius, end = abs(shape["radius"]), shape["center1"]
        return _ball(shape["center"], radius), None if end is None else _ball(end, radius)
    known = shape.doc.params
    first = (shape["transform"] if "transform" in known else None) or Transform()
    last = shape["transform1"] if "transform1" in known else None
    first_rows, last_rows = rows(first), rows(last)
    assert first_rows is not None
    return first_rows, last_rows


def _ball(center: Iterable[float], radius: float) -> Rows:
    matrix = np.zeros((3, 4), np.float32)
    np.fill_diagonal(matrix, radius)
    matrix[:, 3] = tuple(center)
    return matrix


def materials_of(scene: Scene) -> set[Node]:
    """All materials of shapes, those in mixes included."""
    found: set[Node] = set()

    def add(node: Node) -> None:
        if node in found:
            return
        found.add(node)
        for child in node.children():
            if child.kind == "material":
                add(child)

    for _, shape in scene.all_shapes():
        node = _material(shape)
        if node is not None:
            add(node)
    return found


def _material(shape: Node) -> Node | None:
    node = shape.params.get("material")
    return node if isinstance(node, Node) else None


def _same_placement(before: Node, after: Node) -> bool:
    names = SPHERE_PLACEMENT if before.type == "sphere" else PLACEMENT
    return all(before.params.get(name) == after.params.get(name) for name in names)


def _check_same_geometry(old: Scene, new: Scene) -> None:
    """Raises NotInPlace unless the same shapes stand in both, however placed and of whatever material."""
    if len(old.shapes) != len(new.shapes):
        raise NotInPlace("shapes were added or removed")
    if old.render.working_space != new.render.working_space:
        raise NotInPlace("light is computed in another colour space")
    if list(old.groups) != list(new.groups):
        raise NotInPlace("groups were added or removed")
    for name, group in old.groups.items():
        other = new.groups[name]
        if group is not other and len(group.shapes) != len(other.shapes):
            raise NotInPlace(f"shapes were added to group {name} or removed from it")
    for place, before, after in _pairs(old, new):
        if before is after:
            continue
        free: frozenset[str] = frozenset({"material"})
        if place.startswith("shapes["):
            free |= SPHERE_PLACEMENT if before.type == "sphere" else PLACEMENT
        elif has_volume(before) or has_volume(after):
            raise NotInPlace(f"{place} has a volume, and is in a group")
        if not _same_but(before, after, free):
            raise NotInPlace(f"{place} has another geometry")
        if before.type == "sphere" and before["radius"] * after["radius"] < 0:
            raise NotInPlace(f"{place} is turned inside out")


def _check_same_tangents(before: Node, after: Node, place: str) -> None:
    """Raises NotInPlace if a mesh would have tangents for the one of two materials, but not for the other."""
    if after.type not in ("mesh", "mesh_file"):
        return
    arrays = _SMOOTH if after.type == "mesh_file" else mesh_arrays(after)  # a file's meshes may be of any kind
    if wanted_tangents(arrays, _material(before)) != wanted_tangents(arrays, _material(after)):
        raise NotInPlace(f"{place} gets other tangents")


def _pairs(old: Scene, new: Scene) -> Iterator[tuple[str, Node, Node]]:
    for (place, before), (_, after) in zip(old.all_shapes(), new.all_shapes(), strict=True):
        yield place, before, after


def _same_but(before: Node, after: Node, free: frozenset[str]) -> bool:
    """Whether the shapes differ at most in the parameters `free`."""
    if before.type != after.type:
        return False
    names = (before.params.keys() | after.params.keys()) - free
    return all(equal_values(before.params.get(name), after.params.get(name)) for name in names)
