"""Every traversal finds what a search without a tree finds; meshes are watertight; trees are sound and used."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from destello import _core
from tracing import (
    TREES,
    Geometry,
    affine,
    box,
    f32,
    icosphere,
    rotation,
    sphere_directions,
    trace,
    unit,
    visits,
)

STACK = _core.testing.traversal_stack


# --- scenes -----------------------------------------------------------------------------------------------------------


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
        assert np.all(some.t[some.found] >= brute.t[some.found])
        assert np.all(some.t[some.found] < rays["t_max"][some.found])
    return brute


@pytest.mark.parametrize("make", SCENES, ids=lambda f: f.__name__)
def test_trees_find_what_brute_force_finds(make, rng):
    scene = make(rng).build()
    brute = assert_all_agree(scene, rays_about(rng, 6000))
    assert brute.found.any() == (make not in (empty, only_an_empty_group))


def test_ties_are_the_only_difference(rng):
    """Where hits are at different distances, every traversal names the same primitive."""
    scene = mixture(rng).build()
    rays = rays_about(rng, 6000)
    brute = trace(scene, **rays, method="brute")
    for method in TREES:
        np.testing.assert_array_equal(trace(scene, **rays, method=method).leaf, brute.leaf)


def test_twenty_thousand_triangles(rng):
    scene = Geometry().soup(small_triangles(rng, 20_000, 0.02)).build()
    assert scene.stats()["triangles"] == 20_000
    assert assert_all_agree(scene, rays_about(rng, 1000)).found.mean() > 0.3


@settings(max_examples=60, deadline=None, derandomize=True, database=None)
@given(
    seed=st.integers(0, 2**32 - 1),
    counts=st.tuples(*[st.integers(0, 40)] * 6),
    scale=st.sampled_from([1e-3, 0.1, 1.0, 30.0, 1e6]),
    away=st.sampled_from([0.0, 1.0, 100.0]),
)
def test_random_scenes(seed, counts, scale, away):
    """Any numbers of shapes of all kinds, in the world and in instances, at any scale and place."""
    rng = np.random.default_rng(seed)
    center = unit(rng.normal(size=3)) * away * scale
    g = Geometry()
    group = g.group()
    for n, target in zip(counts[:4], (0, 0, group, group), strict=True):
        # The group keeps to its own space; the world lies at the centre.
        factor, shift = (scale, center) if target == 0 else (1.0, 0.0)
        t = small_triangles(rng, n, 10 ** rng.uniform(-2, 0)) * factor + shift
        moving = rng.random() < 0.5
        if n:
            g.soup(t, target, triangles1=t + 0.2 * factor * rng.normal(size=t.shape) if moving else None)
        c, r = rng.uniform(-1, 1, (n, 3)) * factor + shift, 10 ** rng.uniform(-2, -0.3, n) * factor
        g.spheres(c, r * rng.choice([-1, 1], n), target, centers1=c + 0.3 * factor if moving else None)
    for _ in range(counts[4] // 4):
        start, end = (
            affine(0.3 * scale * random_linear(rng), center + scale * rng.uniform(-1, 1, 3)) for _ in range(2)
        )
        g.instance(group, start, end if rng.random() < 0.5 else None)
    scene = g.build()
    assert_all_agree(scene, rays_about(rng, 300, scale, center))


def test_lengths_are_respected_to_the_last_bit(rng):
    """A hit at t counts for t_max just above t, and not for t itself."""
    scene = mixture(rng).build()
    rays = rays_about(rng, 4000)
    rays["t_max"] = np.full(4000, np.inf, np.float32)
    t = trace(scene, **rays).t
    good = np.isfinite(t)
    for method in TREES:
        for any_hit in (False, True):
            rays["t_max"] = np.where(good, t, 1)
            assert not trace(scene, **rays, method=method, any_hit=any_hit).found[good].any()
            rays["t_max"] = np.where(good, np.nextafter(t, np.float32(np.inf)), 1)
            np.testing.assert_array_equal(trace(scene, **rays, method=method, any_hit=any_hit).t[good], t[good])


def test_scales_of_instances(rng):
    """t means the same in every space, however an instance is scaled."""
    rays = rays_about(rng, 2000)
    plain = trace(Geometry().spheres([[0, 0, 0]], [0.8]).build(), **rays)
    for scale in (1e-6, 1e-3, 1e3, 1e6):
        g = Geometry()
        group = g.group()
        scene = g.spheres([[0, 0, 0]], [0.8 / scale], group).instance(group, affine(np.eye(3) * scale)).build()
        for method in TREES:
            hits = trace(scene, **rays, method=method)
            assert (hits.found != plain.found).sum() < 3  # rays that graze it, by rounding
            both = hits.found & plain.found
            np.testing.assert_allclose(hits.t[both], plain.t[both], rtol=1e-4, atol=1e-4)


@pytest.mark.parametrize("scale", [1e-6, 1e-3, 1e3, 1e6])
def test_scales_of_instanced_meshes(scale, rng):
    p, t = icosphere(2)
    rays = rays_about(rng, 2000)
    g = Geometry()
    group = g.group()
    scene = g.mesh(p / scale, t, group).instance(group, affine(np.eye(3) * scale)).build()
    plain = trace(Geometry().mesh(p, t).build(), **rays)
    hits = trace(scene, **rays)
    assert (hits.found != plain.found).sum() < 3
    both = hits.found & plain.found
    np.testing.assert_allclose(hits.t[both], plain.t[both], rtol=1e-4, atol=1e-4)


# --- watertightness ---------------------------------------------------------------------------------------------------


def aims(rng, positions, indices, n):
    """Points that are vertices, middles of edges or other points of edges, as exactly as float32 can tell."""
    p = f32(positions)
    k, e = rng.integers(len(indices), size=n), rng.integers(3, size=n)
    a, b = p[indices[k, e]].astype(np.float64), p[indices[k, (e + 1) % 3]].astype(np.float64)
    weight = np.choose(rng.integers(4, size=n), [0, 0.5, 0.25, rng.random(n)])[:, None]
    return a + (b - a) * weight


@pytest.mark.parametrize(("method", "n"), [("simd", 1_000_000), ("baseline", 200_000), ("groups", 200_000)])
@pytest.mark.parametrize("place", [0.0, 30.0], ids=["at the origin", "away from it"])
def test_closed_meshes_are_watertight(method, n, place, rng):
    """From inside, whatever is aimed at: vertices and edges, exactly or by normalised directions."""
    p, t = icosphere(4)
    p = f32(p + place)
    scene = Geometry().mesh(p, t).build()
    target = aims(rng, p, t, n)
    origins = f32(place + sphere_directions(rng, n) * 0.95 * rng.random((n, 1)) ** (1 / 3))
    half = n // 2
    directions = target - origins
    directions[half:] = unit(directions[half:])
    hits = trace(scene, origins, directions, method=method)
    assert hits.found.all(), f"{(~hits.found).sum()} leaks"
    # Seen from far outside, the silhouette is the only way past: aims well inside of it all hit.
    outside = f32(place + 100 * unit(origins - place))
    front = (target - place) * unit(origins - place)
    inside = front.sum(axis=1) > 0.3
    assert trace(scene, outside[inside], unit(target - outside)[inside], method=method).found.all()


@pytest.mark.parametrize("scale", [1e-3, 1.0, 1e6])
def test_closed_meshes_are_watertight_at_every_scale(scale, rng):
    p, t = icosphere(3)
    p = f32(p * scale)
    target = aims(rng, p, t, 200_000)
    origins = f32(sphere_directions(rng, len(target)) * 0.95 * scale * rng.random((len(target), 1)))
    assert trace(Geometry().mesh(p, t).build(), origins, unit(target - origins)).found.all()


@pytest.mark.parametrize("turned", [False, True])
def test_planes_of_squares_are_watertight(turned, rng):
    """Straight down and aslant onto the inner vertices and edges of a grid."""
    n = 64
    x, z = np.meshgrid(np.linspace(-1, 1, n + 1), np.linspace(-1, 1, n + 1), indexing="ij")
    turn = rotation(rng) if turned else np.eye(3)
    p = f32(np.stack([x, np.zeros_like(x), z], -1).reshape(-1, 3) @ turn.T)
    i = (np.arange(n)[:, None] * (n + 1) + np.arange(n)).ravel()
    t = np.concatenate([np.stack([i, i + 1, i + n + 2], -1), np.stack([i, i + n + 2, i + n + 1], -1)])
    scene = Geometry().mesh(p, t).build()
    inner = t[np.abs(p[t] @ turn).max(axis=(1, 2)) < 1 - 1e-3]
    target = aims(rng, p, inner, 400_000)
    up = np.broadcast_to(turn @ [0, 1, 0], target.shape)
    aslant = sphere_directions(rng, len(target))
    aslant *= np.sign((aslant * up).sum(axis=1, keepdims=True))
    aslant[np.abs((aslant * up).sum(axis=1)) < 0.01] = up[0]
    for way in (up, aslant):
        origins = f32(target + 3 * way)
        for method in TREES:
            some = slice(None, None, 1 if method == "simd" else 8)
            hits = trace(scene, origins[some], unit(target - origins)[some], method=method)
            assert hits.found.all(), f"{(~hits.found).sum()} leaks"


# --- the tree itself --------------------------------------------------------------------------------------------------


def check_tree(scene):
    """Boxes hold what is below them; each leaf is reached once. Returns the depth of each root's tree."""
    tree = _core.testing.tree(scene)
    lo, hi = tree["leaf_lo"].astype(np.float64), tree["leaf_hi"].astype(np.float64)
    index, count = tree["index"].reshape(-1, 8), tree["count"].reshape(-1, 8)
    child_lo, child_hi = (tree[name].reshape(-1, 8, 3) for name in ("lo", "hi"))
    reached = np.zeros(len(lo), int)
    depths = []
    for root in dict.fromkeys(tree["roots"].tolist()):
        # Breadth first, so that going back over the rows meets children before their parents.
        rows = [(root, 1)]
        for node, depth in rows:
            rows += [(int(index[node, s]), depth + 1) for s in range(8) if count[node, s] == 0]
        bounds = {}
        for node, _ in reversed(rows):
            total_lo, total_hi = np.full(3, np.inf), np.full(3, -np.inf)
            for s in range(8):
                if count[node, s] < 0:
                    continue
                if count[node, s] == 0:
                    a, b = bounds[int(index[node, s])]
                else:
                    leaves = slice(index[node, s], index[node, s] + count[node, s])
                    reached[leaves] += 1
                    a, b = lo[leaves].min(axis=0), hi[leaves].max(axis=0)
                assert np.all(child_lo[node, s] <= a)
                assert np.all(child_hi[node, s] >= b)
                total_lo, total_hi = np.minimum(total_lo, a), np.maximum(total_hi, b)
            bounds[node] = total_lo, total_hi
        depths.append(max(depth for _, depth in rows))
    assert np.all(reached == 1)
    assert max(depths) <= STACK // 2 - 2
    return depths


@pytest.mark.parametrize("make", SCENES, ids=lambda f: f.__name__)
def test_boxes_hold_what_is_below_them(make, rng):
    scene = make(rng).build()
    assert check_tree(scene)[0] == max(scene.stats()["bvh_depth"], 1)


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


@pytest.mark.parametrize("make", DEGENERATE, ids=lambda f: f.__name__)
def test_degenerate_trees_stay_shallow_and_right(make, rng):
    scene = make(rng).build()
    check_tree(scene)
    for scale in (1e-6, 1e-3, 1.0, 1e3):
        assert_all_agree(scene, without_specks(scene, rays_about(rng, 300, scale)))
    # From afar, along the line on which they stand, and all at once.
    rays = rays_about(rng, 300)
    rays["origins"], rays["directions"] = (
        f32(rays["origins"] - (2000, 0, 0)),
        f32(unit(rays["directions"] * 1e-4 + (1, 0, 0))),
    )
    rays["t_max"][:] = np.inf
    assert_all_agree(scene, without_specks(scene, rays))


def test_visits_grow_like_the_logarithm(rng):
    """Rays at a sphere of 80 to 81920 triangles: four times as many cost some nodes more, not four times as many."""
    nodes, primitives = [], []
    for levels in range(1, 7):
        scene = Geometry().mesh(*icosphere(levels)).build()
        origins = 3 * sphere_directions(rng, 3000)
        seen = visits(scene, origins, unit(rng.uniform(-1, 1, (3000, 3)) - origins))
        nodes.append(seen["nodes"].mean())
        primitives.append(seen["primitives"].mean())
    assert max(b - a for a, b in pairwise(nodes)) < 3, nodes
    assert nodes[-1] < 16, nodes
    assert max(primitives) < 12, primitives


def test_counted_visits_are_those_of_the_traversal(rng):
    """A ray that misses everything sees the root alone; one into a single triangle, one node and one primitive."""
    scene = Geometry().soup([[[0, 0, 0], [1, 0, 0], [0, 1, 0]]]).build()
    seen = visits(scene, [[0.2, 0.2, 1], [5, 5, 1]], [[0, 0, -1], [0, 0, 1]])
    np.testing.assert_array_equal(seen["nodes"], [1, 1])
    np.testing.assert_array_equal(seen["primitives"], [1, 0])
