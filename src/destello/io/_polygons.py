"""Polygons to triangles: fans where the polygon is convex, ear clipping where it is not."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Ints = NDArray[np.int64]
Floats = NDArray[np.float64]

_LARGEST_CLIPPED = 1024  # corners; larger polygons become fans, so that the time stays in proportion to the file


def triangulate(points: Floats, corners: Ints, sizes: Ints) -> tuple[Ints, Ints]:
    """Triangles of polygons.

    Args:
        points: (P, 3) positions, finite.
        corners: (C,) indices into `points`, polygon after polygon.
        sizes: (F,) number of corners of each polygon; they sum to C. Those below 3 give no triangle.

    Returns:
        (T, 3) positions in `corners`, in the order of the polygons and with their winding, and (T,) polygon numbers.
    """
    starts = np.cumsum(sizes) - sizes
    triangles, faces = [np.zeros((0, 3), np.int64)], [np.zeros(0, np.int64)]
    for size in np.unique(sizes):
        if size < 3:
            continue
        which = np.flatnonzero(sizes == size)
        local = _fans(len(which), int(size))
        if size > 3:
            outline = starts[which, None] + np.arange(size)
            _mend_concave(points, corners, outline, local)
        triangles.append((starts[which, None, None] + local).reshape(-1, 3))
        faces.append(np.repeat(which, size - 2))
    face = np.concatenate(faces)
    order = np.argsort(face, kind="stable")
    return np.concatenate(triangles)[order], face[order]


def _fans(count: int, size: int) -> Ints:
    middle = np.arange(1, size - 1)
    fan = np.stack([np.zeros_like(middle), middle, middle + 1], axis=-1)
    return np.broadcast_to(fan, (count, size - 2, 3)).copy()


def _mend_concave(points: Floats, corners: Ints, outline: Ints, local: Ints) -> None:
    """Replaces the fans of concave polygons in `local` (n, size - 2, 3); `outline` is (n, size)."""
    size = outline.shape[1]
    for start in range(0, len(outline), 65536):
        part = slice(start, start + 65536)
        p = points[corners[outline[part]]]
        with np.errstate(over="ignore", invalid="ignore"):
            normal = np.cross(p, np.roll(p, -1, axis=1)).sum(axis=1)
            turns = np.cross(p - np.roll(p, 1, axis=1), np.roll(p, -1, axis=1) - p)
            concave = (np.einsum("nkc,nc->nk", turns, normal) < 0).any(axis=1)
        for i in np.flatnonzero(concave):
            if size == 4:
                reflex = int(np.argmin(turns[i] @ normal[i]))
                local[start + i] = (local[start + i] + reflex) % 4
            elif size <= _LARGEST_CLIPPED:
                local[start + i] = _clip_ears(p[i], normal[i])


def _clip_ears(p: Floats, normal: Floats) -> Ints:
    """(k - 2, 3) triangles of a simple polygon with corners `p` (k, 3), seen along `normal`."""
    drop = int(np.argmax(np.abs(normal)))
    keep = [(1, 2), (2, 0), (0, 1)][drop]
    flat = p[:, keep] * (1.0 if normal[drop] >= 0 else -1.0, 1.0)
    left = list(range(len(p)))
    triangles = []
    at = 0
    misses = 0
    while len(left) > 3:
        n = len(left)
        a, b, c = left[at - 1], left[at % n], left[(at + 1) % n]
        if misses >= n or _is_ear(flat, left, a, b, c):  # no ear at all: crossing edges; cut anyway
            triangles.append((a, b, c))
            del left[at % n]
            at, misses = max(at - 1, 0) % len(left), 0
        else:
            at, misses = (at + 1) % n, misses + 1
    triangles.append((left[0], left[1], left[2]))
    return np.array(triangles, np.int64)


def _is_ear(flat: Floats, left: list[int], a: int, b: int, c: int) -> bool:
    """Whether corner b sticks out and no other corner lies in the triangle (a, b, c)."""
    triangle = flat[[a, b, c]]
    edges = np.roll(triangle, -1, axis=0) - triangle
    if edges[0, 0] * edges[1, 1] - edges[0, 1] * edges[1, 0] <= 0:
        return False
    others = flat[[i for i in left if i not in (a, b, c)]]
    away = others[:, None] - triangle
    return not (edges[:, 0] * away[..., 1] - edges[:, 1] * away[..., 0] >= 0).all(axis=1).any()
