"""Meshes by formula for the benchmark scenes: vectorised, always the same, of any size.

Each function returns (positions (N, 3) float64 in metres, triangles (M, 3) int64), counter-clockwise seen from outside.
Noise takes its tables from NumPy's generators, so that the meshes are those of the common benchmark scenes, with which
other renderers are measured; should a NumPy ever change those streams, the meshes change too (a test notices).
"""

from __future__ import annotations

from itertools import combinations
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Floats = NDArray[np.float64]
    Mesh = tuple[Floats, NDArray[np.int64]]

_CHUNK = 1 << 15  # points whose noise is computed at once: what fits into a processor's cache


def icosphere(frequency: int) -> Mesh:
    """The unit sphere: an icosahedron, each face cut into frequency² triangles, pushed outwards.

    20 frequency² triangles, 10 frequency² + 2 vertices. Each vertex exists once.
    """
    corners, faces = _icosahedron()
    column, row = np.array([(i, j) for i in range(frequency + 1) for j in range(frequency + 1 - i)]).T
    weights = np.stack([frequency - column - row, column, row], axis=1)
    points = np.einsum("nk,fkd->fnd", weights / frequency, corners[faces]).reshape(-1, 3)
    # A point on an edge or corner belongs to several faces: what identifies it is how much it takes of which corner.
    marks = np.random.PCG64(0).random_raw(len(corners)).astype(np.uint64)
    keys = (weights.astype(np.uint64) @ marks[faces].T).T.ravel()
    _, first, number = np.unique(keys, return_index=True, return_inverse=True)
    triangles = _cut_triangle(frequency, column, row)
    all_triangles = (triangles[None] + (np.arange(len(faces)) * len(weights))[:, None, None]).reshape(-1, 3)
    points = points[first]
    return points / np.linalg.norm(points, axis=1, keepdims=True), number.reshape(-1)[all_triangles]


def _icosahedron() -> Mesh:
    """Twelve corners at distance 1, twenty faces."""
    golden = (1 + 5**0.5) / 2
    rectangle = np.array([(a, b * golden, 0) for a in (-1, 1) for b in (-1, 1)])
    corners = np.concatenate([np.roll(rectangle, shift, axis=1) for shift in range(3)])
    faces = []
    for a, b, c in combinations(range(12), 3):
        p, q, r = corners[[a, b, c]]
        if max(np.linalg.norm(p - q), np.linalg.norm(q - r), np.linalg.norm(r - p)) < 2.1:  # an edge is 2 long
            outwards = np.dot(np.cross(q - p, r - p), p) > 0
            faces.append((a, b, c) if outwards else (a, c, b))
    return corners / np.linalg.norm(corners[0]), np.array(faces)


def _cut_triangle(frequency: int, column: NDArray[Any], row: NDArray[Any]) -> NDArray[np.int64]:
    """The small triangles of one face, by the numbers of its points."""
    number = np.zeros((frequency + 2, frequency + 2), np.int64)
    number[column, row] = np.arange(len(column))
    up, down = column + row < frequency, column + row < frequency - 1
    i, j = column[up], row[up]
    upright = np.stack([number[i, j], number[i + 1, j], number[i, j + 1]], axis=1)
    i, j = column[down], row[down]
    inverted = np.stack([number[i + 1, j], number[i + 1, j + 1], number[i, j + 1]], axis=1)
    return np.concatenate([upright, inverted])


def noise(points: Floats, seed: int, octaves: int, frequency: float, *, ridged: bool = False) -> Floats:
    """Fractal gradient noise (Perlin 2002) at points (N, 3): (N,) values, about -1 to 1.

    Args:
        points: where, in metres.
        seed: of the tables.
        octaves: how many layers, each with half the amplitude and 2.03 times the frequency of the one before.
        frequency: of the first layer, in 1/m.
        ridged: each layer n counts as 0.35 - |n|.
    """
    random = np.random.default_rng(seed)
    shuffled = random.permutation(256)
    slopes = random.normal(size=(256, 3))
    slopes /= np.linalg.norm(slopes, axis=1, keepdims=True)
    total = np.zeros(len(points))
    for start in range(0, len(points), _CHUNK):
        part = points[start : start + _CHUNK]
        for octave in range(octaves):
            layer = _gradient_noise(part * (frequency * 2.03**octave) + 100.5, shuffled, slopes)
            total[start : start + _CHUNK] += 0.5**octave * (0.35 - np.abs(layer) if ridged else layer)
    return total


def _gradient_noise(points: Floats, shuffled: NDArray[Any], slopes: Floats) -> Floats:
    """One layer: the slopes at the eight corners of a point's cell, blended."""
    cell = np.floor(points)
    inside = points - cell
    low = cell.astype(np.int64) & 255
    high = (low + 1) & 255
    x, y, z = (inside**3 * (inside * (inside * 6 - 15) + 10)).T

    def at_corner(hashed: NDArray[Any], corner: tuple[int, int, int]) -> Floats:
        along: Floats = np.einsum("ij,ij->i", slopes[hashed], inside - np.array(corner))
        return along

    planes = []
    for dx, ix in enumerate((low[:, 0], high[:, 0])):
        lines = []
        for dy, iy in enumerate((low[:, 1], high[:, 1])):
            line = shuffled[(shuffled[ix] + iy) & 255]
            near = at_corner(shuffled[(line + low[:, 2]) & 255], (dx, dy, 0))
            far = at_corner(shuffled[(line + high[:, 2]) & 255], (dx, dy, 1))
            lines.append(near + z * (far - near))
        planes.append(lines[0] + y * (lines[1] - lines[0]))
    blended: Floats = planes[0] + x * (planes[1] - planes[0])
    return blended


def rock(frequency: int, seed: int, *, height: float, scale: float, octaves: int = 7, ridged: bool = False) -> Mesh:
    """A unit `icosphere` displaced along its radius by `height` times `noise` of frequency `scale`."""
    points, triangles = icosphere(frequency)
    return points * (1 + height * noise(points, seed, octaves, scale, ridged=ridged))[:, None], triangles


def torus(radius: float, tube: float, around: int, across: int) -> Mesh:
    """A ring in the xz plane: `around` times `across` quads, twice as many triangles."""
    a = np.arange(around)[:, None] * (2 * np.pi / around)
    b = np.arange(across)[None] * (2 * np.pi / across)
    reach = radius + tube * np.cos(b)
    parts = np.broadcast_arrays(reach * np.cos(a), tube * np.sin(b), reach * np.sin(a))
    i, j = (grid.ravel() for grid in np.meshgrid(np.arange(around), np.arange(across), indexing="ij"))
    i1, j1 = (i + 1) % around, (j + 1) % across
    p, q, r, s = i * across + j, i1 * across + j, i1 * across + j1, i * across + j1
    triangles = np.concatenate([np.stack([p, s, r], axis=1), np.stack([p, r, q], axis=1)])
    return np.stack(parts, axis=-1).reshape(-1, 3), triangles


def terrain(cells: int, extent: float, height: float, *, seed: int = 4, octaves: int = 10) -> Mesh:
    """A square of mountains around the origin: 2 cells² triangles, y upwards from about 0 to about `height`.

    Layers of smooth random values (uniform cubic B-splines over random lattices), folded into ridges; each layer is
    rougher where the land so far is high. The shape does not depend on `cells`, which only samples it.
    """
    steps = np.linspace(0, 1, cells + 1)
    land = np.zeros((cells + 1, cells + 1))
    weight: Floats | float = 1.0
    for octave in range(octaves):
        layer = (1 - np.abs(_smooth_values(steps, 4 * 2**octave, seed + octave))) * weight
        weight = np.clip(0.3 + layer, 0, 1)
        land += 0.5**octave * layer**2
    x = (steps - 0.5) * extent
    points = np.empty((cells + 1, cells + 1, 3))
    points[..., 0], points[..., 1], points[..., 2] = x[None], land * (height / 1.7), x[:, None]
    row, column = (grid.ravel() for grid in np.meshgrid(np.arange(cells), np.arange(cells), indexing="ij"))
    p = row * (cells + 1) + column
    q, r, s = p + 1, p + cells + 1, p + cells + 2
    triangles = np.empty((cells * cells, 2, 3), np.int64)
    triangles[:, 0], triangles[:, 1] = np.stack([p, r, s], axis=1), np.stack([p, s, q], axis=1)
    return points.reshape(-1, 3), triangles.reshape(-1, 3)


def _smooth_values(steps: Floats, cells: int, seed: int) -> Floats:
    """Random values on a lattice of `cells` by `cells`, smoothed, at all pairs of `steps` in [0, 1]: about -1 to 1."""
    size = cells + 3
    bits = np.random.PCG64(seed).random_raw(size * size).reshape(size, size)  # bits that NumPy guarantees
    values = (bits >> np.uint64(11)) * 2.0**-52 - 1
    place = steps * cells
    first = np.minimum(place.astype(np.int64), cells - 1)
    t = place - first
    taps = np.stack([(1 - t) ** 3, 3 * t**3 - 6 * t**2 + 4, -3 * t**3 + 3 * t**2 + 3 * t + 1, t**3]) / 6
    across = sum(taps[k][:, None] * values[first + k] for k in range(4))
    assert isinstance(across, np.ndarray)
    turned = np.ascontiguousarray(across.T)
    both = sum(taps[k][:, None] * turned[first + k] for k in range(4))
    return np.ascontiguousarray(1.7 * np.asarray(both).T)


def vertex_normals(mesh: Mesh) -> Floats:
    """Unit normals (N, 3) of the vertices: of the triangles around each, weighted by their areas."""
    points, triangles = mesh
    a, b, c = (points[triangles[:, k]] for k in range(3))
    faces = np.cross(b - a, c - a)
    total = np.stack(
        [np.bincount(triangles.ravel(), np.repeat(faces[:, axis], 3), len(points)) for axis in range(3)], axis=1
    )
    normals: Floats = total / np.maximum(np.linalg.norm(total, axis=1, keepdims=True), 1e-20)
    return normals
