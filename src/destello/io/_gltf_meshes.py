"""glTF's meshes as destello's: every primitive that is made of triangles becomes one mesh shape."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

import destello.shapes as make
from destello.errors import Error
from destello.io._arrays import check_finite, check_indices, compacted, repaired_normals
from destello.io._gltf_accessors import Buffers
from destello.io._gltf_compression import DRACO, can_decode, decode_draco
from destello.io._gltf_json import Document, Item
from destello.io._gltf_materials import Materials
from destello.nodes import Node

_TRIANGLES, _STRIP, _FAN = 4, 5, 6
_REUSE = 64  # vertices and corners for each byte of the file's data: beyond, a small file could fill the memory
_FREE_WORK = 1_000_000

_FLIP, _ONE = np.array((1, -1), np.float32), np.array((0, 1), np.float32)  # v to 1 - v

Matrices = NDArray[np.float64]


@dataclass
class Pose:
    """How a node bends its mesh: weights of the morph targets, and the joints' matrices (J, 4, 4) if it has a skin."""

    weights: tuple[float, ...] = ()
    joints: Matrices | None = None


@dataclass
class _Primitive:
    """A primitive while its arrays are read.

    Attributes:
        item, attributes: its JSON.
        triangles: (M, 3) over the used vertices.
        count: how many vertices its accessors have.
        used: which of them the triangles use; None: all.
        data: (N, k) arrays of the used vertices by the names of the mesh shape.
    """

    item: Item
    attributes: Item
    triangles: NDArray[np.uint32]
    count: int
    used: NDArray[np.intp] | None
    data: dict[str, NDArray[np.float32]] = field(default_factory=dict)


class Meshes:
    """Makes the shapes of each mesh once, or again for each node that bends it."""

    def __init__(self, document: Document, buffers: Buffers, materials: Materials, notes: list[str]) -> None:
        self.document = document
        self._buffers = buffers
        self._materials = materials
        self._notes = notes
        self._made: dict[int, list[Node]] = {}
        self._finite: set[int] = set()  # accessors found to be so
        self._work = 0  # vertices read and corners made so far

    def shapes(self, mesh: Item, pose: Pose | None = None) -> list[Node]:
        """The mesh's shapes, without transforms."""
        if pose is not None:
            return self._shapes(mesh, pose)
        if mesh.index not in self._made:
            self._made[mesh.index] = self._shapes(mesh, Pose(_weights(mesh)))
        return self._made[mesh.index]

    def _shapes(self, mesh: Item, pose: Pose) -> list[Node]:
        primitives = mesh.items("primitives")
        if not primitives:
            raise mesh.error("missing", "primitives", expected="at least one")
        name = mesh.text("name", "") or f"mesh {mesh.index}"
        shapes = []
        for item in primitives:
            primitive = self._read(item, pose)
            if primitive is not None:
                shapes.append(self._shape(primitive, name if len(primitives) == 1 else f"{name} {item.index}"))
        return shapes

    def _shape(self, primitive: _Primitive, name: str) -> Node:
        material = self._materials.of(primitive.item)
        arrays = {**primitive.data, "indices": primitive.triangles}
        try:
            node = self._materials.node(material, colored="colors" in arrays, second="second_uvs" in arrays)
            return make.mesh(material=node, name=name, **arrays)
        except Error as error:
            raise error if error.file else error.within(primitive.item.place, file=primitive.item.file) from None

    def _note(self, text: str) -> None:
        if text not in self._notes:
            self._notes.append(text)

    # --- arrays -------------------------------------------------------------------------------------------------------

    def _read(self, item: Item, pose: Pose) -> _Primitive | None:
        """A primitive with all its arrays; None, with a note, if there is nothing to render."""
        attributes = item.item("attributes")
        if attributes is None:
            raise item.error("missing", "attributes", expected="a JSON object")
        mode = item.integer("mode", _TRIANGLES, high=_FAN)
        if mode < _TRIANGLES or "POSITION" not in attributes:
            what = "points and lines are" if mode < _TRIANGLES else "a primitive without positions is"
            self._note(f"{item.place}: {what} not rendered")
            return None
        self._decompress(item, attributes)
        positions = self._values(attributes, "POSITION", ("VEC3",))
        triangles = self._triangles(item, mode, len(positions))
        if len(triangles) == 0:
            self._note(f"{item.place}: it has no triangles")
            return None
        triangles, used = compacted(triangles, len(positions))
        primitive = _Primitive(item, attributes, triangles, len(positions), used)
        primitive.data["positions"] = self._vectors(primitive, "POSITION", ("VEC3",))
        self._add_attributes(primitive)
        self._bend(primitive, pose)
        self._mend_normals(primitive)
        return primitive

    def _decompress(self, item: Item, attributes: Item) -> None:
        """Puts what is in a primitive's Draco data into its accessors."""
        packed = item.extension(DRACO)
        if packed is None:
            return
        points = self.document.refer(attributes, "POSITION", "accessors")
        if not can_decode(item, self.document, DRACO, "DracoPy", plain=points is None or "bufferView" in points):
            return
        view = self.document.refer(packed, "bufferView", "bufferViews", required=True)
        indices = self.document.refer(item, "indices", "accessors", required=True)
        numbers = packed.item("attributes")
        if numbers is None:
            raise packed.error("missing", "attributes", expected="a JSON object")
        assert view is not None
        assert indices is not None
        faces, attribute = decode_draco(packed, bytes(self._buffers.view(view)), indices.integer("count") // 3)
        self._buffers.replace(indices, faces.reshape(-1, 1))
        for key in numbers.data:
            accessor = self.document.refer(attributes, key, "accessors")
            values = attribute(numbers.integer(key))
            if values is None:
                raise numbers.error("no such attribute in the compressed data", key, value=numbers.data[key])
            if accessor is not None:
                self._buffers.replace(accessor, values.reshape(len(values), -1))
                self._finite.discard(accessor.index)

    def _triangles(self, primitive: Item, mode: int, vertices: int) -> NDArray[np.uint32]:
        """(M, 3) vertex numbers, whatever the mode."""
        accessor = self.document.refer(primitive, "indices", "accessors")
        indices = np.arange(vertices, dtype=np.uint32) if accessor is None else self._buffers.indices(accessor)
        check_indices(indices, vertices, "a vertex", file=primitive.file, place=primitive.at("indices"))
        self._work += vertices + len(indices) * (1 if mode == _TRIANGLES else 3)
        limit = _REUSE * self._buffers.total_bytes() + _FREE_WORK
        if self._work > limit:
            raise primitive.error(
                "the primitives use the same data too often", value=self._work, expected=f"{limit} vertices at most"
            )
        if mode == _TRIANGLES:
            if len(indices) % 3:
                self._note(f"{primitive.place}: the last triangle is incomplete and left out")
            return indices[: len(indices) // 3 * 3].reshape(-1, 3)
        i = np.arange(max(len(indices) - 2, 0))
        odd = i & 1
        corners = (i + 1, i + 2, i * 0) if mode == _FAN else (i, i + 1 + odd, i + 2 - odd)
        triangles: NDArray[np.uint32] = indices[np.stack(corners, axis=1)]
        return triangles

    def _values(
        self, attributes: Item, key: str, types: tuple[str, ...], *, finite: bool = True
    ) -> NDArray[np.float32]:
        """All of an attribute's accessor; `finite`: it must be."""
        accessor = self.document.refer(attributes, key, "accessors", required=True)
        assert accessor is not None
        values = self._buffers.floats(accessor, types)
        if finite and accessor.index not in self._finite:
            what = "vertex" if key == "POSITION" else f"{key} of vertex"
            check_finite(values, what, file=attributes.file, place=attributes.at(key))
            self._finite.add(accessor.index)
        return values

    def _vectors(
        self,
        primitive: _Primitive,
        key: str,
        types: tuple[str, ...],
        *,
        source: Item | None = None,
        finite: bool = True,
    ) -> NDArray[np.float32]:
        """(N, k) of an attribute (of `source`, else of the primitive) for the used vertices."""
        attributes = source or primitive.attributes
        values = self._values(attributes, key, types, finite=finite)
        _check_count(attributes, key, len(values), primitive.count)
        return values if primitive.used is None else values[primitive.used]

    def _add_attributes(self, primitive: _Primitive) -> None:
        data, attributes = primitive.data, primitive.attributes
        if "NORMAL" in attributes:
            data["normals"] = self._vectors(primitive, "NORMAL", ("VEC3",), finite=False)
        if "TANGENT" in attributes and "NORMAL" in attributes:  # the specification ignores them on flat triangles
            data["tangents"] = self._vectors(primitive, "TANGENT", ("VEC4",))
        first, second = self._materials.uv_sets(self._materials.of(primitive.item))
        self._add_uvs(primitive, "uvs", first or 0, wanted=first is not None)
        if second is not None:
            self._add_uvs(primitive, "second_uvs", second)
        if "COLOR_0" in attributes:
            data["colors"] = np.clip(self._vectors(primitive, "COLOR_0", ("VEC3", "VEC4")), 0, 1)

    def _add_uvs(self, primitive: _Primitive, name: str, number: int, *, wanted: bool = True) -> None:
        key = f"TEXCOORD_{number}"
        if key in primitive.attributes:
            primitive.data[name] = self._vectors(primitive, key, ("VEC2",)) * _FLIP + _ONE
        elif wanted:
            self._note(f"{primitive.attributes.place}: no {key}, which the material's textures need")

    def _mend_normals(self, primitive: _Primitive) -> None:
        data = primitive.data
        if "normals" not in data:
            return
        data["normals"], bad = repaired_normals(data["normals"], data["positions"], primitive.triangles)
        if bad:
            self._note(f"{primitive.item.place}: {bad} of its normals have no direction; computed from the triangles")

    # --- poses --------------------------------------------------------------------------------------------------------

    @np.errstate(over="ignore", invalid="ignore")  # what overflows is found at the end
    def _bend(self, primitive: _Primitive, pose: Pose) -> None:
        """Applies morph targets and skin to positions, normals and tangents."""
        data = primitive.data
        for target, weight in zip(primitive.item.items("targets"), pose.weights, strict=False):
            for key, name in (("POSITION", "positions"), ("NORMAL", "normals"), ("TANGENT", "tangents")):
                if weight != 0 and key in target and name in data:
                    step = self._vectors(primitive, key, ("VEC3",), source=target)
                    data[name] = data[name] + np.pad(step, ((0, 0), (0, data[name].shape[1] - 3))) * np.float32(weight)
        if pose.joints is not None and "JOINTS_0" in primitive.attributes:
            matrices = self._joints(primitive, pose.joints)
            points = (
                np.einsum("nij,nj->ni", matrices[:, :, :3], data["positions"].astype(np.float64)) + matrices[:, :, 3]
            )
            data["positions"] = points.astype(np.float32)
            for name in {"normals", "tangents"} & data.keys():
                turned = np.einsum("nij,nj->ni", matrices[:, :, :3], data[name][:, :3].astype(np.float64))
                data[name] = np.concatenate([turned, data[name][:, 3:]], axis=1).astype(np.float32)
        check_finite(data["positions"], "posed vertex", file=primitive.item.file, place=primitive.item.place)

    def _joints(self, primitive: _Primitive, joints: Matrices) -> Matrices:
        """(N, 3, 4) matrices that move each used vertex: the weighted mean of its joints' (J, 4, 4)."""
        attributes = primitive.attributes
        total, weight = np.zeros(()), np.zeros(())
        for i in range(16):
            key = f"JOINTS_{i}"
            accessor = self.document.refer(attributes, key, "accessors")
            if accessor is None:
                break
            numbers = self._buffers.joints(accessor)
            _check_count(attributes, key, len(numbers), primitive.count)
            check_indices(numbers, len(joints), "a joint", file=attributes.file, place=attributes.at(key))
            numbers = numbers if primitive.used is None else numbers[primitive.used]
            weights = self._vectors(primitive, f"WEIGHTS_{i}", ("VEC4",)).astype(np.float64)
            for slot in range(4):
                total = total + joints[numbers[:, slot], :3] * weights[:, slot, None, None]
            weight = weight + weights.sum(axis=1)
        weight = weight[:, None, None]
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.where(weight > 0, total / weight, np.eye(3, 4))


def _check_count(attributes: Item, key: str, found: int, count: int) -> None:
    if found != count:
        raise attributes.error(
            "wrong number of elements", key, value=found, expected=f"{count}, as many as POSITION has"
        )


def _weights(item: Item) -> tuple[float, ...]:
    if "weights" not in item:
        return ()
    given = item.data["weights"]
    return item.numbers("weights", len(given) if isinstance(given, list) else 0)


def node_weights(node: Item, mesh: Item) -> tuple[float, ...]:
    """The morph weights that hold for a mesh at a node."""
    return _weights(node) if "weights" in node else _weights(mesh)
