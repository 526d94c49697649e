"""Scenes of bare geometry, and rays traced through them by each traversal, for tests.

``Geometry`` collects shapes and builds a ``_core.Scene``; ``trace`` finds hits; ``surfaces`` and ``leave`` make the
points where rays have hit and the origins from which they go on.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from destello import _core

METHODS = ("simd", "auto", "packet", "stream", "chunks", "baseline", "groups", "special", "brute")
TREES = METHODS[:8]
Floats = NDArray[np.float32]


def f32(a: ArrayLike) -> Floats:
    return np.ascontiguousarray(a, np.float32)


class Geometry:
    """A SceneBuilder with one grey material."""

    def __init__(self) -> None:
        self.builder = _core.SceneBuilder()
        self.material = self.builder.add_material("diffuse", {"reflectance": (0.5, 0.5, 0.5)})
        self.dropped = 0

    def mesh(self, positions, indices, group=0, transform=None, transform1=None, material=None, **more) -> Geometry:
        more = {name: None if a is None else f32(a) for name, a in more.items()}
        indices = np.ascontiguousarray(indices, np.uint32)
        mesh, dropped = self.builder.add_mesh(f32(positions), indices, **more)
        self.dropped += dropped
        self.builder.place_mesh(group, mesh, self.pick(material), transform, transform1)
        return self

    def pick(self, material: int | None) -> int:
        return self.material if material is None else material

    def soup(self, triangles, group=0, triangles1=None, **more) -> Geometry:
        """Triangles (M, 3, 3) that share no vertices."""
        p = np.reshape(triangles, (-1, 3))
        p1 = None if triangles1 is None else np.reshape(triangles1, (-1, 3))
        return self.mesh(p, np.arange(len(p)).reshape(-1, 3), group, positions1=p1, **more)

    def spheres(self, centers, radii, group=0, centers1=None, material=None) -> Geometry:
        centers1 = None if centers1 is None else f32(centers1)
        self.builder.add_spheres(group, f32(centers), f32(radii), self.pick(material), centers1)
        return self

    def group(self) -> int:
        return int(self.builder.add_group())

    def instance(self, group, transform, transform1=None) -> Geometry:
        self.builder.add_instance(0, group, transform, transform1)
        return self

    def build(self):
        return self.builder.build()


@dataclass
class Hits:
    """One row a ray; t is infinite and the indices are -1 where nothing was hit."""

    t: Floats
    u: Floats
    v: Floats
    leaf: NDArray[np.int32]
    instance: NDArray[np.int32]
    object: NDArray[np.int32]
    primitive: NDArray[np.int32]

    @property
    def found(self) -> NDArray[np.bool_]:
        return self.leaf >= 0


def _rows(value: ArrayLike, n: int, fallback: float) -> Floats:
    return f32(np.broadcast_to(np.float32(fallback) if value is None else value, (n,)))


def trace(scene, origins, directions, *, method="simd", t_max=None, time=None, any_hit=False) -> Hits:
    origins = f32(origins)
    n = len(origins)
    directions = f32(np.broadcast_to(directions, (n, 3)))
    rows = _rows(t_max, n, np.inf), _rows(time, n, 0)
    return Hits(**_core.testing.trace(scene, method, origins, directions, *rows, any_hit))


def surfaces(scene, origins, directions, hits: Hits, *, time=None) -> dict[str, NDArray]:
    """p, error, ng, ns, uv, front, light for rays that have all hit something."""
    n = len(hits.t)
    return _core.testing.surfaces(
        scene,
        f32(origins),
        f32(np.broadcast_to(directions, (n, 3))),
        _rows(time, n, 0),
        *(hits.t, hits.u, hits.v, hits.leaf, hits.instance),
    )


def leave(s: dict[str, NDArray], directions) -> Floats:
    """Origins of rays that leave the surfaces `s` along `directions`."""
    return _core.testing.offset_origins(s["p"], s["error"], s["ng"], f32(directions))


def visits(scene, origins, directions) -> dict[str, NDArray]:
    n = len(origins)
    return _core.testing.count_visits(scene, f32(origins), f32(directions), _rows(None, n, np.inf), _rows(None, n, 0))


# --- shapes and directions --------------------------------------------------------------------------------------------


def unit(v: ArrayLike) -> NDArray[np.float64]:
    a = np.asarray(v, np.float64)
    return a / np.linalg.norm(a, axis=-1, keepdims=True)


def sphere_directions(rng: np.random.Generator, n: int) -> NDArray[np.float64]:
    return unit(rng.normal(size=(n, 3)))


def around(rng: np.random.Generator, normals: ArrayLike, lowest_sine: float = 0.0) -> NDArray[np.float64]:
    """Random unit directions on the normals' side; their angles with the surface reach down to `lowest_sine`."""
    n = unit(normals)
    tangent = unit(np.cross(n, sphere_directions(rng, len(n))))
    # Half of them spread evenly over the logarithm of the angle: the grazing ones are the hard ones.
    low = np.log(max(lowest_sine, 1e-4))
    even = rng.uniform(lowest_sine, 1, len(n))
    sine = np.where(rng.random(len(n)) < 0.5, even, np.exp(rng.uniform(low, 0, len(n))))[:, None]
    return n * sine + tangent * np.sqrt(1 - sine**2)


BOX_CORNERS = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], np.float64)
# Two triangles a face, counter-clockwise from outside.
BOX_INDICES = np.array(
    [
        *([0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5]),
        *([0, 4, 5], [0, 5, 1], [2, 3, 7], [2, 7, 6]),
        *([0, 2, 6], [0, 6, 4], [1, 5, 7], [1, 7, 3]),
    ]
)


def box(lo=(-1, -1, -1), hi=(1, 1, 1)) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    lo, hi = np.asarray(lo, np.float64), np.asarray(hi, np.float64)
    return lo + (hi - lo) * BOX_CORNERS, BOX_INDICES


def icosphere(levels: int) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """A unit sphere of 20 * 4**levels triangles, wound outwards; subdivided edges share their middles."""
    g = (1 + 5**0.5) / 2
    p = unit([[s * a, t * b, 0.0] for a, b in [(1, g)] for s in (-1, 1) for t in (-1, 1)])
    p = np.concatenate([np.roll(p, k, axis=1) for k in range(3)])
    d = np.linalg.norm(p[:, None] - p[None], axis=-1)
    near = np.isclose(d, np.sort(d[0])[1])
    faces = [
        (a, b, c) if np.dot(np.cross(p[b] - p[a], p[c] - p[a]), p[a]) > 0 else (a, c, b)
        for a in range(12)
        for b in range(a + 1, 12)
        for c in range(b + 1, 12)
        if near[a, b] and near[b, c] and near[a, c]
    ]
    t = np.array(faces)
    for _ in range(levels):
        edges, back = np.unique(np.sort(t[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1), axis=0, return_inverse=True)
        m = len(p) + back.reshape(-1, 3)
        p = np.concatenate([p, unit(p[edges].sum(axis=1))])
        (a, b, c), (ab, bc, ca) = t.T, m.T
        t = np.concatenate([np.stack(q, -1) for q in ((a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca))])
    return p, t


def affine(linear: ArrayLike, translation: ArrayLike = (0, 0, 0)) -> list[list[float]]:
    return np.column_stack([np.asarray(linear, np.float64), np.asarray(translation, np.float64)]).tolist()


def rotation(rng: np.random.Generator) -> NDArray[np.float64]:
    q, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    return q * np.sign(np.linalg.det(q))


# --- comparing -------------------------------------------------------------------------------------------------------


def rays_about(rng, n, scale=1.0, center=(0, 0, 0)):
    """Rays of all kinds through the cube [-1, 1]: from within and from afar, along axes, short ones, of any length."""
    origins = rng.uniform(-1.2, 1.2, (n, 3))
    to = rng.uniform(-1, 1, (n, 3))
    far = rng.random(n) < 0.5
    origins[far] = sphere_directions(rng, far.sum()) * 10 ** rng.uniform(0.3, 2, (far.sum(), 1))
    directions = unit(to - origins)
    axis = np.arange(n) % 7 == 0
    k = rng.integers(3, size=n)
    directions[axis] = np.eye(3)[k[axis]] * rng.choice([-1, 1], (axis.sum(), 1))
    origins[axis] = to[axis] - directions[axis] * rng.uniform(0, 3, (axis.sum(), 1))
    plane = np.arange(n) % 7 == 1
    directions[plane, k[plane]] = 0
    directions = unit(directions)
    length = np.where(rng.random(n) < 0.6, np.inf, 10 ** rng.uniform(-2, 1, n))
    return {
        "origins": f32(origins * scale + np.asarray(center)),
        "directions": f32(directions),
        "t_max": f32(length * scale),
        "time": f32(rng.random(n)),
    }


def without_specks(scene, rays):
    """The rays that do not hit a thing so small beside its distance that float32 cannot tell where it is."""
    hits = trace(scene, **rays, method="brute")
    tree = _core.testing.tree(scene)
    size = np.linalg.norm(tree["leaf_hi"] - tree["leaf_lo"], axis=1)[hits.leaf]
    size[hits.instance >= 0] = np.inf
    good = ~hits.found | (size > 1e-4 * np.linalg.norm(rays["origins"], axis=1))
    return {name: a[good] for name, a in rays.items()}


def assert_all_agree(scene, rays, methods=TREES):
    """The same hit as brute force: the same t to the last bit, and the same primitive unless several are that near."""
    brute = trace(scene, **rays, method="brute")
    assert np.all(brute.t[brute.found] < rays["t_max"][brute.found])
    assert np.all(brute.t > 0)
    for method in methods:
        hits = trace(scene, **rays, method=method)
        np.testing.assert_array_equal(hits.found, brute.found, method)
        np.testing.assert_array_equal(hits.t, brute.t, method)
        same = (hits.leaf == brute.leaf) & (hits.instance == brute.instance)
        for name in ("u", "v", "object", "primitive"):
            a, b = getattr(hits, name)[same], getattr(brute, name)[same]
            np.testing.assert_array_equal(a, b, f"{method}: {name}")
        some = trace(scene, **rays, method=method, any_hit=True)
        np.testing.assert_array_equal(some.found, brute.found, method)
        if method == "packet":  # may say only that there is a hit
            continue
        assert np.all(some.t[some.found] >= brute.t[some.found])
        assert np.all(some.t[some.found] < rays["t_max"][some.found])
    return brute
