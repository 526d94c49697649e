"""Tangents of meshes that have none: MikkTSpace, by its published definition.

M. Mikkelsen 2008, "Simulation of Wrinkled Surfaces Revisited" (thesis), chapter 4: each triangle has the direction in
which u grows. The corners at a vertex fall into groups: neighbours across an edge whose texture runs the same way
round. A corner's tangent is the mean of its group's directions, each in the plane of the vertex normal, weighted by the
angle that its triangle has there. The outcome depends on neither the order of triangles nor on which vertices they
share: equal ones (position, normal, texture coordinates) count as one.

How it departs from the reference implementation: triangles that the texture coordinates make flat take the orientation
of the first neighbour across an edge that has one, up to `_RINGS` away, where the reference goes by the order of its
search; opposite directions within a group are averaged too; and what has no direction at all gets none.
"""

from __future__ import annotations

import weakref
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from destello.mesh_checks import DIRECTIONS, uv_sets

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from destello.nodes import Node

    Array = NDArray[Any]

_RINGS = 16  # of triangles with flat texture coordinates around one whose orientation they take
_BATCH = 1 << 14
_SETS = {"tangents": "uvs", "second_tangents": "second_uvs"}
_STRETCHED = ("anisotropy", "specular_roughness_anisotropy", "coat_roughness_anisotropy")
_made: dict[tuple[int | str, ...], dict[str, Array]] = {}  # by the id() of arrays that live, and what was made


def needed_tangents(material: Node) -> set[str]:
    """Which tangents a material (or one that it mixes) needs.

    "tangents", of the first uvs, for a normal or tangent map or anisotropic highlights; "second_tangents" for maps that
    read the second.
    """
    found = set()
    for node in material.walk():
        if node.kind == "material":
            given = node.params
            for name in DIRECTIONS:
                if name in given:
                    found.add("second_tangents" if "second" in uv_sets(given[name]) else "tangents")
            if any(given.get(name, 0.0) != 0.0 for name in _STRETCHED):
                found.add("tangents")
    return found


def wanted_tangents(arrays: Mapping[str, Array], material: Node | None) -> tuple[str, ...]:
    """Which tangents a mesh with these arrays is to get for the material: it has all that they are made of, none of its
    own, and does not move by itself (the core then goes by the triangles').
    """
    has = arrays.keys()
    if material is None or "normals" not in has or "positions1" in has:
        return ()
    needed = needed_tangents(material)
    return tuple(name for name, uvs in _SETS.items() if name in needed and uvs in has and name not in has)


def kept_tangents(arrays: Mapping[str, Array], names: tuple[str, ...]) -> dict[str, Array]:
    """With the tangents `names`; kept as long as the arrays live, for the next frame or edit. They must not change."""
    key: tuple[int | str, ...] = (*(id(arrays[name]) for name in sorted(arrays)), *names)
    if key not in _made:
        made = dict(arrays)
        for name in names:
            made = with_tangents(made, name)
        _made[key] = {name: array for name, array in made.items() if array is not arrays.get(name)}
        for array in arrays.values():
            weakref.finalize(array, _made.pop, key, None)
    return {**arrays, **_made[key]}


def with_tangents(arrays: Mapping[str, Array], name: str = "tangents") -> dict[str, Array]:
    """A mesh's arrays with tangents, (N, 4): along growing u, and 1 where v grows along normal x tangent, else -1.

    Args:
        arrays: (N, 3) positions and normals, (N, 2) uvs with v upwards, (M, 3) indices; others, a row a vertex, may be
            there too.
        name: "tangents", or "second_tangents" by second_uvs.

    Vertices whose corners belong to several groups are doubled, the doubles after the others. A corner without a
    tangent of its own has one of the others at its vertex; where no corner has one it is 0, and the core takes the
    triangle's.
    """
    triangles = arrays["indices"].astype(np.intp, copy=False)
    vectors, signs, group = _corners(arrays["positions"], arrays["normals"], arrays[_SETS[name]], triangles)
    corners, count = triangles.reshape(-1), len(arrays["positions"])
    sure = np.flatnonzero(vectors.any(axis=1))
    first = np.zeros(count, np.intp)  # group of each vertex's first corner with a tangent
    first[corners[sure[::-1]]] = group[sure[::-1]]
    others = sure[first[corners[sure]] != group[sure]]
    pairs = corners[others].astype(np.int64) * len(corners) + group[others]
    _, index, inverse = np.unique(pairs, return_index=True, return_inverse=True)
    vertex = corners.copy()
    vertex[others] = count + inverse.reshape(-1)
    made = dict(arrays)
    if len(index):
        source = np.concatenate([np.arange(count), corners[others[index]]])
        made = {key: array[source] for key, array in arrays.items() if key != "indices"}
        made["indices"] = vertex.reshape(-1, 3).astype(np.uint32)
    tangents = made[name] = np.zeros((len(made["positions"]), 4), np.float32)
    tangents[:, 3] = 1
    tangents[vertex[sure]] = np.concatenate([vectors, signs[:, None]], axis=1)[sure]
    return made


def _corners(positions: Array, normals: Array, uvs: Array, triangles: Array) -> tuple[Array, Array, Array]:
    """For each corner (3 M): the tangent (3), the sign of the bitangent, the number of its group."""
    count = len(triangles)
    turn, solid, pull = np.zeros(count), np.zeros(count, bool), np.zeros((count, 3, 3))
    for first in range(0, count, _BATCH):  # small enough for the processor's cache
        part = slice(first, first + _BATCH)
        p, n, t = (array[triangles[part]].astype(np.float64) for array in (positions, normals, uvs))
        turn[part], solid[part], pull[part] = _directions(p, n, t)
    across = _across(_welded(positions, normals, uvs)[triangles], solid)
    turn = _spread(turn, across)
    group = _groups(turn, across)
    total = np.stack([np.bincount(group, pull[..., axis].reshape(-1), len(group)) for axis in range(3)], axis=1)
    return _unit(total)[group], np.where(turn < 0, -1, 1).repeat(3), group


def _directions(p: Array, n: Array, t: Array) -> tuple[Array, Array, Array]:
    """Of triangles (m, 3 corners, components), by positions, normals and uvs: orientation, whether they have three
    corners, and what pulls the tangent of each corner (m, 3, 3).

    Orientation 1: the texture is seen as it is; -1: as in a mirror; 0: its coordinates are flat. Products of four
    float32 numbers stay within the range of float64.
    """
    e1, e2 = p[:, 1] - p[:, 0], p[:, 2] - p[:, 0]
    d1, d2 = t[:, 1] - t[:, 0], t[:, 2] - t[:, 0]
    turn = np.sign(d1[:, 0] * d2[:, 1] - d1[:, 1] * d2[:, 0])
    along_u = turn[:, None] * (e1 * d2[:, 1:] - e2 * d1[:, 1:])
    along_v = e2 * d1[:, :1] - e1 * d2[:, :1]
    turn[~(along_u.any(axis=1) & along_v.any(axis=1))] = 0
    sides = [p[:, (k + 1) % 3] - p[:, k] for k in range(3)]
    pull = np.empty_like(p)
    for k in range(3):
        normal = _unit(n[:, k])
        to_next, from_last, pulled = (
            _unit(v - normal * _dot(v, normal)[:, None]) for v in (sides[k], sides[k - 1], along_u)
        )
        pull[:, k] = pulled * np.arccos(np.clip(-_dot(to_next, from_last), -1, 1))[:, None]
    return turn, np.logical_and.reduce([side.any(axis=1) for side in sides]), pull


def _welded(*parts: Array) -> Array:
    """(N,) numbers that are equal for rows that are equal in all parts."""
    rows = np.concatenate([part.astype(np.float32) for part in parts], axis=1) + np.float32(0)  # -0 is 0
    keys = np.ascontiguousarray(rows).view(np.uint64).T
    order = np.lexsort(keys)
    new = np.zeros(len(rows), np.intp)
    new[1:] = (np.diff(keys[:, order].astype(np.int64), axis=1) != 0).any(axis=0)
    made = np.empty(len(rows), np.intp)
    made[order] = np.cumsum(new)
    return made


def _across(vertices: Array, solid: Array) -> Array:
    """For half edge 3 f + k, from corner k of triangle f to the next: the one that runs the other way, or -1.

    The first of several with the same ends meets the first of those against it.
    """
    start, end = vertices.reshape(-1), np.roll(vertices, -1, axis=1).reshape(-1)
    key = np.minimum(start, end).astype(np.int64) * (int(vertices.max()) + 1) + np.maximum(start, end)
    usable = solid.repeat(3) & (start != end)
    up, down = (np.flatnonzero(usable & way) for way in (start < end, start > end))
    up, down = up[np.argsort(key[up], kind="stable")], down[np.argsort(key[down], kind="stable")]
    rank = np.arange(len(up)) - np.searchsorted(key[up], key[up])
    at = np.searchsorted(key[down], key[up]) + rank
    met = at < np.searchsorted(key[down], key[up], side="right")
    made = np.full(len(key), -1)
    made[up[met]], made[down[at[met]]] = down[at[met]], up[met]
    return made


def _spread(turn: Array, across: Array) -> Array:
    """The triangles' orientations, those without one from a neighbour that has."""
    turn = turn.copy()
    for _ in range(_RINGS):
        missing = np.flatnonzero(turn == 0)
        beyond = across[missing[:, None] * 3 + np.arange(3)]
        found = np.where(beyond < 0, 0, turn[beyond // 3])
        if not found.any():
            break
        turn[missing] = found[np.arange(len(missing)), (found != 0).argmax(axis=1)]
    return turn


def _groups(turn: Array, across: Array) -> Array:
    """(3 M,) the least corner of the group that each corner belongs to.

    The corners of a group follow each other around the vertex, in a ring or from one border to another. In each round a
    corner learns of twice as many on both sides, until nobody learns anything.
    """
    corner = np.arange(len(across))
    face, k = np.divmod(corner, 3)
    same = np.where((across >= 0) & (turn[face] == turn[across // 3]), across, -1)
    there, k_there = np.divmod(same, 3)
    onward = np.where(same < 0, corner, 3 * there + (k_there + 1) % 3)
    behind = 3 * face + (k + 2) % 3  # the half edge that ends in the corner
    back = np.where(same[behind] < 0, corner, same[behind])
    label = corner
    while True:
        seen = np.minimum(label, np.minimum(label[onward], label[back]))
        if np.array_equal(seen, label):
            return label
        label, onward, back = seen, onward[onward], back[back]


def _dot(a: Array, b: Array) -> Array:
    return np.asarray(np.einsum("ij,ij->i", a, b))


def _unit(vectors: Array) -> Array:
    """Unit vectors; those of length 0 stay 0."""
    length = np.sqrt(_dot(vectors, vectors))
    return np.asarray(vectors / np.where(length > 0, length, 1)[:, None])
