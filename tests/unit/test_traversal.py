"""Every traversal finds what a search without a tree finds, and meshes are watertight."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from destello import _core
from tracing import (
    METHODS,
    TREES,
    Geometry,
    affine,
    assert_all_agree,
    f32,
    icosphere,
    rays_about,
    rotation,
    sphere_directions,
    trace,
    unit,
)
from tracing_scenes import SCENES, empty, mixture, only_an_empty_group, random_linear, small_triangles


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


@pytest.mark.parametrize("octant", range(8))
@pytest.mark.parametrize("moving", [False, True])
def test_packets_find_the_same_hits(rng, octant, moving):
    """Rays of one octant go through scenes of spheres eight at a time, and find the same bits as one by one."""
    centers, radii = rng.uniform(-10, 10, (400, 3)), rng.uniform(0.1, 1, 400) * rng.choice([-1, 1], 400)
    ends = centers + rng.normal(size=(400, 3)) * 0.3 if moving else None
    g = Geometry().spheres(centers, radii, centers1=ends)
    scene = g.spheres([(0, -1010, 0)], [1000]).build()
    sign = np.array([1 if octant >> k & 1 else -1 for k in range(3)])
    n = 1003  # the last packet is not full
    middles = np.repeat(rng.uniform(0.05, 1, (n // 8 + 1, 3)), 8, axis=0)[:n]
    directions = unit((middles + rng.uniform(-0.04, 0.04, (n, 3))) * sign)
    origins = np.repeat(rng.uniform(-12, 12, (n // 8 + 1, 3)), 8, axis=0)[:n] + rng.normal(size=(n, 3)) * 0.01
    rays = {"origins": origins, "directions": directions, "time": rng.uniform(0, 1, n), "t_max": rng.uniform(5, 40, n)}
    one, packet = trace(scene, **rays), trace(scene, **rays, method="packet")
    assert 0.1 < one.found.mean() < 1
    np.testing.assert_array_equal(packet.t, one.t)
    np.testing.assert_array_equal(packet.leaf, one.leaf)


@pytest.mark.parametrize("n", [1, 2, 36, 64, 65])
def test_a_few_triangles_without_a_tree(rng, n):
    """Up to 64 resting triangles are all tested with many rays at once: the same bits as one ray in the tree."""
    scene = Geometry().soup(rng.uniform(-3, 3, (n, 3, 3))).build()
    rays = rays_about(rng, 4003)  # the last packet is not full
    rays["t_max"] = rng.uniform(1, 12, 4003)
    one, packet = trace(scene, **rays), trace(scene, **rays, method="packet")
    assert 0 < one.found.mean() < 1
    for name in ("t", "u", "v", "leaf"):
        np.testing.assert_array_equal(getattr(packet, name), getattr(one, name), name)
    some = trace(scene, **rays, method="packet", any_hit=True)
    np.testing.assert_array_equal(some.found, one.found)


def test_scattered_rays_go_in_turns_and_find_the_same_bits(rng):
    """The choice between one by one and in turns, chunk by chunk: it changes no bit, and is what the rule says."""
    p, t = icosphere(6)
    scene = Geometry().mesh(p, t).build()
    n, chunk = 3 * 4096 + 777, 4096  # the last chunk is not full
    line = np.linspace(0, 1, n)[:, None]
    on_a_line = (line * 2 - 1) * (0.5, 0.4, 0.3)
    anywhere = rng.uniform(-1, 1, (n, 3))
    directions = sphere_directions(rng, n)
    lists = {
        "scattered": (anywhere, [True] * 4),
        "close to each other": (on_a_line, [False] * 4),
        "in a corner": (0.2 * anywhere + 0.7, [False] * 4),
        "from one place": (np.zeros((n, 3)), [False] * 4),
        "some of them": (np.where(np.arange(n)[:, None] // chunk % 2, anywhere, on_a_line), [False, True, False, True]),
        "all over, in order": (anywhere[np.lexsort(np.floor(anywhere * 6).T)], [False] * 4),
    }
    for name, (origins, expected) in lists.items():
        rays = {"origins": f32(origins), "directions": directions, "t_max": rng.uniform(0.2, 3, n)}
        assert _core.testing.scattered_chunks(scene, rays["origins"]) == expected, name
        one = trace(scene, **rays)
        assert 0.05 < one.found.mean() < 1, name
        for method in ("chunks", "auto"):
            chosen = trace(scene, **rays, method=method)
            for field in ("t", "u", "v", "leaf", "instance"):
                np.testing.assert_array_equal(getattr(chosen, field), getattr(one, field), f"{name}: {method}, {field}")
            some = trace(scene, **rays, method=method, any_hit=True)
            np.testing.assert_array_equal(some.found, one.found, f"{name}: {method}")


@pytest.mark.cuda
@pytest.mark.parametrize("make", SCENES, ids=lambda f: f.__name__)
def test_devices_find_what_brute_force_finds(make, rng):
    """Up to rounding: rays that graze an edge may go either way."""
    scene, rays = make(rng).build(), rays_about(rng, 20_000)
    brute, hits = trace(scene, **rays, method="brute"), trace(scene, **rays, method="cuda:0")
    assert (hits.found != brute.found).mean() < 1e-3
    both = hits.found & brute.found
    assert (~np.isclose(hits.t[both], brute.t[both], rtol=1e-4, atol=1e-4)).sum() <= 1e-3 * len(both)
    some = trace(scene, **rays, method="cuda:0", any_hit=True)
    assert (some.found != hits.found).mean() < 1e-3


def test_spheres_of_groups_that_nobody_placed_are_not_there():
    g = Geometry().spheres([(0, 0, 0)], [1])
    g.spheres([(5, 0, 0)], [1], group=g.group())
    scene = g.build()
    for method in METHODS:
        found = trace(scene, [(5, 0, 10), (0, 0, 10)], [(0, 0, -1)] * 2, method=method).found
        assert list(found) == [False, True], method


@pytest.mark.parametrize("n", [1, 7, 8, 9, 64, 500, 5000])
@pytest.mark.parametrize("moving", [False, True])
def test_blocks_of_spheres_find_the_same_hits(rng, n, moving):
    """The tree that devices follow through spheres alone: any number, one of them huge."""
    centers, radii = rng.uniform(-10, 10, (n, 3)), rng.uniform(0.1, 2, n) * rng.choice([-1, 1], n)
    ends = centers + rng.normal(size=(n, 3)) * 0.3 if moving else None
    scene = Geometry().spheres(centers, radii, centers1=ends).spheres([(0, -1010, 0)], [1000]).build()
    rays = rays_about(rng, 4000)
    one = assert_all_agree(scene, rays, methods=("groups", "special"))
    assert one.found.any()


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


def test_the_box_of_a_turned_instance_is_tight(rng):
    p, t = icosphere(4)
    p = p * (3, 1, 1) + (10, 20, 30)  # the group's box is no cube, and not at its origin
    linear, end, offset = 0.5 * rotation(rng), 0.5 * rotation(rng), rng.normal(size=3)
    for moving in (False, True):
        g = Geometry()
        group = g.group()
        g.mesh(p, t, group).instance(group, affine(linear, offset), affine(end, offset) if moving else None)
        lo, hi = np.array(g.build().stats()["bounds"])
        placed = np.concatenate([p @ matrix.T + offset for matrix in ([linear, end] if moving else [linear])])
        assert (lo <= placed.min(axis=0)).all()
        assert (hi >= placed.max(axis=0)).all()
        if not moving:
            # The transformed box of the group's is 1.3 to 2.1 times as long.
            np.testing.assert_allclose(hi - lo, np.ptp(placed, axis=0), rtol=0.15)


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
