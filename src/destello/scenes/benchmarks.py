"""The scenes that only benchmarks need: one big mesh, many instances, a landscape. The interior has its own module.

Geometry, cameras, light and depth (8 segments, no Russian roulette, box filter) of `mesh1m`, `instances` and `interior`
are those with which other renderers are measured. `detail` scales the number of triangles (and of instances), for tests
and for curves of speed against size.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from destello.scenes.registry import benchmark, blank

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from destello.nodes import Node
    from destello.scene import Scene
    from destello.scenes.meshes import Mesh

SIZE = (1280, 720)
SPP = 64
SEGMENTS = 8
NO_ROULETTE = 10_000


def bench_scene(name: str, camera: Node) -> Scene:
    """An empty scene with what all of these share."""
    import destello as dl

    made = blank(name, size=SIZE, spp=SPP, max_depth=SEGMENTS, camera=camera, background=(0, 0, 0))
    made.render.rr_depth = NO_ROULETTE
    made.film.filter = dl.filters.box()
    return made


def mesh(made: Mesh, material: Node, name: str, *, smooth: bool = False) -> Node:
    """A mesh of `destello.scenes.meshes` as a shape; `smooth`: with `vertex_normals`."""
    import destello as dl
    from destello.scenes.meshes import vertex_normals

    points, triangles = made
    normals = vertex_normals(made).astype(np.float32) if smooth else None
    return dl.shapes.mesh(
        points.astype(np.float32), triangles.astype(np.uint32), normals=normals, material=material, name=name
    )


def scaled(number: int, detail: float) -> int:
    """How often to cut an edge, so that the triangles become `detail` times as many: at least once."""
    return max(1, round(number * float(np.sqrt(detail))))


@benchmark("mesh1m", "A displaced sphere of a million triangles, diffuse, under a white sky.")
def mesh1m(detail: float = 1.0) -> Scene:
    """1,003,520 triangles; with detail, 20 f² for f = 224 sqrt(detail)."""
    import destello as dl
    from destello.scenes.meshes import rock

    made = bench_scene("mesh1m", dl.cameras.perspective(origin=(0, 0.5, 3.4), target=(0, 0, 0), vfov=40))
    made.environment = dl.environments.constant(radiance=1)
    clay = dl.materials.diffuse(reflectance=0.7, name="clay")
    shape = rock(scaled(224, detail), 7, height=0.6, scale=2.1, ridged=True)
    made.add(mesh(shape, clay, "rock"))
    return made


@benchmark("instances", "Ten thousand instances of a rock of 20,480 triangles on a plane, under a gradient sky.")
def instances(detail: float = 1.0) -> Scene:
    """100 by 100 instances. With detail, both the rock's triangles and the number of instances become fewer."""
    return _instances("instances", scaled(100, detail), detail)


@benchmark("instances-100", "A hundred of the same instances, for renderers that cannot do more.")
def instances_100(detail: float = 1.0) -> Scene:
    """10 by 10 instances, in the middle of the picture. With detail, the rock's triangles become fewer."""
    return _instances("instances-100", 10, detail)


@benchmark("instances-100-large", "A hundred instances ten times as large: they cover as much as ten thousand.")
def instances_100_large(detail: float = 1.0) -> Scene:
    """10 by 10 instances, ten times as large and as far apart. With detail, the rock's triangles become fewer."""
    return _instances("instances-100-large", 10, detail, size=10)


def _instances(name: str, side: int, detail: float, size: float = 1) -> Scene:
    import destello as dl
    from destello.scenes.meshes import rock

    camera = dl.cameras.perspective(origin=(0, 14, 62), target=(0, -4, 0), vfov=45)
    made = bench_scene(name, camera)
    made.environment = dl.environments.gradient(bottom=(1, 1, 1), top=(0.5, 0.7, 1.0))
    clay = dl.materials.diffuse(reflectance=(0.75, 0.55, 0.35), name="clay")
    ground = dl.materials.diffuse(reflectance=0.5, name="ground")
    made.add(dl.shapes.quad((-300, 0, 300), (600, 0, 0), (0, 0, -600), material=ground, name="ground"))
    shape = rock(scaled(32, detail), 11, height=0.5, scale=1.6, octaves=6)
    made.group("rock", [mesh(shape, clay, "rock")])
    for place in _places(side, size):
        made.add(dl.shapes.instance("rock", transform=dl.matrix(place)))
    return made


def _places(side: int, size: float) -> NDArray[np.float64]:
    """Matrices (side², 4, 4): a jittered grid in the xz plane, turned at random, a quarter to half of `size`."""
    random = np.random.default_rng(3)
    grid = (np.arange(side) - (side - 1) / 2) * 1.05
    count = side * side
    turns = random.normal(size=(count, 4))
    scale = random.uniform(0.25, 0.5, count)
    x = np.tile(grid, side) + random.uniform(-0.25, 0.25, count)
    z = np.repeat(grid, side) + random.uniform(-0.25, 0.25, count)
    places = np.zeros((count, 4, 4))
    places[:, :3, :3] = _rotations(turns) * scale[:, None, None]
    places[:, :3, 3] = np.stack([x, 0.85 * scale, z], axis=1)
    places[:, :3] *= size
    places[:, 3, 3] = 1
    return places


def _rotations(quaternions: NDArray[np.float64]) -> NDArray[np.float64]:
    """Rotation matrices (N, 3, 3) of quaternions (N, 4), the real part first, of any length."""
    unit = quaternions / np.linalg.norm(quaternions, axis=1, keepdims=True)
    real, axis = unit[:, 0, None, None], unit[:, 1:]
    zero = np.zeros(len(unit))
    x, y, z = axis.T
    cross = np.stack([zero, -z, y, z, zero, -x, -y, x, zero], axis=1).reshape(-1, 3, 3)
    turned: NDArray[np.float64] = np.eye(3) + 2 * real * cross + 2 * cross @ cross
    return turned


@benchmark("terrain", "Mountains of ten million triangles in the sun.")
def terrain(detail: float = 1.0) -> Scene:
    """9,999,392 triangles; with detail, 2 n² for n = 2236 sqrt(detail). 8 km wide, one sun, a gradient sky."""
    import destello as dl
    from destello.scenes import meshes

    camera = dl.cameras.perspective(origin=(300, 2700, 4700), target=(0, 600, 600), vfov=42)
    made = bench_scene("terrain", camera)
    made.environment = dl.environments.gradient(bottom=(0.6, 0.6, 0.6), top=(0.15, 0.3, 0.7))
    made.add(dl.lights.directional(direction=(0.8, -0.55, 0.1), irradiance=(2.6, 2.3, 1.9)))
    stone = dl.materials.diffuse(reflectance=(0.52, 0.47, 0.40), name="stone")
    made.add(mesh(meshes.terrain(scaled(2236, detail), 8000, 1500), stone, "terrain"))
    return made
