"""Checks and repairs that all mesh readers share."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from destello.errors import FormatError

Vectors = NDArray[np.float32]
Triangles = NDArray[np.uint32]


def check_finite(
    values: NDArray[np.floating], what: str, *, file: Path, place: str | None = None, line: int | None = None
) -> None:
    """Raises FormatError that names the first row of `values` (N, k) with a value that no float32 can hold."""
    with np.errstate(invalid="ignore", over="ignore"):
        good = np.isfinite(values.astype(np.float32, copy=False)).all(axis=1)
    if not good.all():
        first = int(np.argmin(good))
        raise FormatError(
            f"{what} {first} is not finite",
            file=file,
            line=line,
            place=place,
            value=values[first].tolist(),
            expected="finite numbers",
        )


def check_indices(indices: NDArray[np.integer], count: int, what: str, *, file: Path, place: str | None = None) -> None:
    """Raises FormatError that names the first of `indices` that is none of the `count` things there are."""
    if indices.size and (int(indices.max()) >= count or int(indices.min()) < 0):
        flat = indices.reshape(-1)
        first = int(np.argmax((flat >= count) | (flat < 0)))
        raise FormatError(
            f"index {first} refers to {what} that is not there",
            file=file,
            place=place,
            value=int(flat[first]),
            expected=f"0 to {count - 1}" if count else "none: there are none",
        )


def vertex_normals(positions: Vectors, triangles: Triangles) -> Vectors:
    """(N, 3) unit normals: means of the triangles around each vertex, weighted by area; (0, 0, 1) if there is none."""
    p = positions.astype(np.float64)
    a, b, c = (p[triangles[:, i]] for i in range(3))
    face = np.cross(b - a, c - a)
    total = np.zeros_like(p)
    for axis in range(3):
        for corner in range(3):
            total[:, axis] += np.bincount(triangles[:, corner], face[:, axis], len(p))
    return _unit(total)


def repaired_normals(normals: Vectors, positions: Vectors, triangles: Triangles) -> tuple[Vectors, int]:
    """The normals, those without direction replaced by the mesh's own, and how many these were."""
    with np.errstate(invalid="ignore", over="ignore"):
        lengths = np.abs(normals).max(axis=1) if len(normals) else np.zeros(0)
        bad = ~(np.isfinite(lengths) & (lengths > 1e-12))
    if not bad.any():
        return normals, 0
    return np.where(bad[:, None], vertex_normals(positions, triangles), normals), int(bad.sum())


def compacted(triangles: Triangles, vertices: int) -> tuple[Triangles, NDArray[np.intp] | None]:
    """The triangles over the vertices that they use, and which these are; (triangles, None) if that is most of them."""
    if vertices <= 3 * triangles.shape[0] * 2:
        used = np.zeros(vertices, bool)
        used[triangles] = True
        if 2 * int(used.sum()) >= vertices:
            return triangles, None
        which = np.flatnonzero(used)
        new = np.zeros(vertices, np.uint32)
        new[which] = np.arange(len(which), dtype=np.uint32)
        return new[triangles], which
    which, inverse = np.unique(triangles, return_inverse=True)
    return inverse.reshape(triangles.shape).astype(np.uint32), which


def _unit(vectors: NDArray[np.float64]) -> Vectors:
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        scaled = vectors / np.abs(vectors).max(axis=1, keepdims=True)
        unit = scaled / np.linalg.norm(scaled, axis=1, keepdims=True)
    return np.where(np.isfinite(unit), unit, (0.0, 0.0, 1.0)).astype(np.float32)
