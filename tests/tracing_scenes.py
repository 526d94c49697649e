"""Scenes on which traversals are compared, from the ordinary to the degenerate: functions of a random generator."""

from __future__ import annotations

import numpy as np

from tracing import Geometry, affine, box, rotation, unit


def small_triangles(rng, n, size=0.1):
    return rng.uniform(-1, 1, (n, 1, 3)) + size * rng.normal(size=(n, 3, 3))


def random_linear(rng):
    """A rotation, stretched, sheared and perhaps mirrored."""
    stretch = 10 ** rng.uniform(-1, 1, 3) * rng.choice([-1, 1], 3)
    shear = np.eye(3) + np.triu(rng.uniform(-1, 1, (3, 3)), 1)
    return rotation(rng) @ shear @ np.diag(stretch) @ rotation(rng)


def cluster(rng, g, group, n=20):
    g.soup(small_triangles(rng, n, 0.3), group)
    return g.spheres(rng.uniform(-1, 1, (n, 3)), rng.uniform(0.02, 0.3, n), group)


def triangles(rng):
    return Geometry().soup(small_triangles(rng, 300))


def spheres(rng):
    radii = rng.uniform(0.01, 0.2, 300) * rng.choice([-1, 1], 300)
    return Geometry().spheres(rng.uniform(-1, 1, (300, 3)), radii)


def spheres_on_a_planet(rng):
    return spheres(rng).spheres([[0, -1001, 0]], [1000])


def moving_spheres(rng):
    c = rng.uniform(-1, 1, (200, 3))
    g = Geometry().spheres(c, rng.uniform(0.01, 0.2, 200), centers1=c + rng.normal(size=c.shape) * 0.5)
    return g.spheres(rng.uniform(-1, 1, (50, 3)), rng.uniform(0.01, 0.2, 50))


def moving_triangles(rng):
    t = small_triangles(rng, 200)
    return Geometry().soup(t, triangles1=t + 0.3 * rng.normal(size=t.shape)).soup(small_triangles(rng, 50))


def mixture(rng):
    g = cluster(rng, Geometry(), 0, 50)
    t = small_triangles(rng, 50)
    c = rng.uniform(-1, 1, (50, 3))
    return g.soup(t, triangles1=t + 0.2).spheres(c, np.full(50, 0.1), centers1=c - 0.3)


def instances(rng, moving=False):
    g = cluster(rng, Geometry(), 0, 5)
    groups = [g.group() for _ in range(3)]
    for group in groups:
        cluster(rng, g, group)
    for i in range(40):
        start, end = (affine(0.1 * random_linear(rng), rng.uniform(-1, 1, 3)) for _ in range(2))
        g.instance(groups[i % 3], start, end if moving and i % 2 else None)
    return g


def moving_instances(rng):
    return instances(rng, moving=True)


def moving_things_in_moving_instances(rng):
    g = Geometry()
    group = g.group()
    t, c = small_triangles(rng, 30, 0.3), rng.uniform(-1, 1, (30, 3))
    g.soup(t, group, triangles1=t + 0.5).spheres(c, np.full(30, 0.1), group, centers1=c + 0.4)
    for _ in range(10):
        start, end = (affine(0.3 * rotation(rng), rng.uniform(-1, 1, 3)) for _ in range(2))
        g.instance(group, start, end)
    return g


def instances_of_one_triangle(rng):
    g = Geometry()
    group = g.group()
    g.soup(small_triangles(rng, 1, 1), group)
    for _ in range(100):
        g.instance(group, affine(0.3 * random_linear(rng), rng.uniform(-1, 1, 3)))
    return g


def flat_boxes(rng):
    """Axis-aligned rectangles: the boxes of the tree have no thickness."""
    g = Geometry()
    square = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]], float)
    for _ in range(60):
        axis = rng.integers(3)
        p = np.insert(square * rng.uniform(0.05, 0.5, 2) + rng.uniform(-0.5, 0.5, 2), axis, rng.uniform(-1, 1), axis=1)
        g.mesh(p, [[0, 1, 2], [0, 2, 3]])
    return g


def coplanar_grid(rng):
    x, z = np.meshgrid(np.linspace(-1, 1, 15), np.linspace(-1, 1, 15), indexing="ij")
    p = np.stack([x, np.full_like(x, 0.25), z], -1).reshape(-1, 3)
    i = (np.arange(14)[:, None] * 15 + np.arange(14)).ravel()
    return Geometry().mesh(p, np.concatenate([np.stack([i, i + 1, i + 16], -1), np.stack([i, i + 16, i + 15], -1)]))


def boxes_in_a_room(rng):
    g = Geometry().mesh(*box((-1, -1, -1), (1, 1, 1)))
    for _ in range(20):
        lo = rng.uniform(-0.9, 0.5, 3)
        g.mesh(*box(lo, lo + rng.uniform(0.05, 0.4, 3)))
    return g


def coincident(rng):
    return (
        Geometry().soup(np.repeat(small_triangles(rng, 3, 1), 100, axis=0)).spheres(np.zeros((50, 3)), np.full(50, 0.5))
    )


def one_triangle(rng):
    return Geometry().soup(small_triangles(rng, 1, 1))


def one_sphere(rng):
    return Geometry().spheres([[0.1, 0.2, 0.3]], [0.7])


def one_instance(rng):
    g = Geometry()
    group = g.group()
    return g.spheres([[0, 0, 0]], [1], group).instance(group, affine(0.5 * random_linear(rng)))


def empty(rng):
    return Geometry()


def empty_group(rng):
    """Instances of nothing, alone and among others."""
    g = one_triangle(rng)
    return g.instance(g.group(), affine(np.eye(3)))


def only_an_empty_group(rng):
    g = Geometry()
    return g.instance(g.group(), affine(np.eye(3)))


SCENES = [
    *(triangles, spheres, spheres_on_a_planet, moving_spheres, moving_triangles, mixture),
    *(instances, moving_instances, moving_things_in_moving_instances, instances_of_one_triangle),
    *(flat_boxes, coplanar_grid, boxes_in_a_room, coincident),
    *(one_triangle, one_sphere, one_instance, empty, empty_group, only_an_empty_group),
]


# --- hard for a builder of trees --------------------------------------------------------------------------------------


def nested_spheres(rng):
    """All centres equal, radii growing."""
    return Geometry().spheres(np.zeros((3000, 3)), np.geomspace(1e-3, 1e3, 3000))


def nested_triangles(rng):
    t = unit(rng.normal(size=(3, 3)))
    t -= t.mean(axis=0)
    return Geometry().soup(t * np.geomspace(1e-3, 1, 3000)[:, None, None])


def exponential_spheres(rng):
    x = 2.0 ** np.arange(-60, 20, 0.25)
    return Geometry().spheres(np.stack([x, 0 * x, 0 * x], -1), 0.1 * x)


def exponential_triangles(rng):
    """Twelve times as far and as large each time, at both ends: a builder that splits off the largest one is deep."""
    s = np.concatenate([12.0 ** np.arange(-14, 6), -(12.0 ** np.arange(-14, 6))])
    t = rng.normal(size=(len(s), 3, 3)) * 0.1 + [1, 0.3, -0.5]
    return Geometry().soup(np.repeat(t * s[:, None, None], 20, axis=0))


def a_staircase_of_slabs(rng):
    """Long thin triangles, each twice the one before."""
    w = 2.0 ** np.arange(-40, 20, 0.5)
    t = np.stack([np.stack([0 * w, 0 * w, w], -1), np.stack([w, 0 * w, w], -1), np.stack([w, 1e-3 * w, w], -1)], 1)
    return Geometry().soup(t)


def deep_in_deep(rng):
    """A deep tree of instances of a deep tree."""
    g = Geometry()
    group = g.group()
    x = 2.0 ** np.arange(-30, 10, 0.5)
    g.spheres(np.stack([x, 0 * x, 0 * x], -1), 0.1 * x, group)
    for s in 2.0 ** np.arange(-30, 10, 0.5):
        g.instance(group, affine(np.eye(3) * s * 0.1, (s, 0, 0)))
    return g


DEGENERATE = [
    *(nested_spheres, nested_triangles, exponential_spheres, exponential_triangles),
    *(a_staircase_of_slabs, deep_in_deep, coincident),
]
