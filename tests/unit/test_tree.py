"""Trees: boxes hold what is below them, degenerate scenes do not make deep ones, and few nodes are visited."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

from destello import _core
from tracing import (
    Geometry,
    affine,
    assert_all_agree,
    f32,
    icosphere,
    rays_about,
    sphere_directions,
    unit,
    visits,
    without_specks,
)
from tracing_scenes import DEGENERATE, SCENES, random_linear

STACK = _core.testing.traversal_stack


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


@pytest.mark.parametrize("moving", [False, True])
def test_each_instance_has_a_box_of_its_own(moving, rng):
    """It holds the instance over the shutter and hardly more, whatever shares its leaf."""
    p, t = icosphere(4)
    g = Geometry()
    group = g.group()
    g.mesh(p, t, group)
    placed = []
    for _ in range(7):
        keys = [(0.1 * random_linear(rng), rng.uniform(-10, 10, 3)) for _ in range(1 + moving)]
        g.instance(group, affine(*keys[0]), affine(*keys[1]) if moving else None)
        placed.append(np.concatenate([p @ linear.T + at for linear, at in keys]))
    tree = _core.testing.tree(g.build())
    leaves = np.flatnonzero(tree["leaf_instance"] >= 0)
    assert len(leaves) == 7
    for leaf in leaves:
        points = placed[tree["leaf_instance"][leaf]]
        lo, hi = tree["instance_lo"][leaf], tree["instance_hi"][leaf]
        assert np.all(lo < points.min(axis=0))
        assert np.all(hi > points.max(axis=0))
        # The boxes of a tree three levels deep stand out a little.
        np.testing.assert_allclose(hi - lo, np.ptp(points, axis=0), rtol=0.2)


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
