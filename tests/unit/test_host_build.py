"""The host's tree builder: threads change nothing, qualities cost what they should, and hits are right in each."""

from __future__ import annotations

import numpy as np
import pytest

from destello import scenes
from destello.geometry import mesh_arrays
from tracing import TREES, trace
from trees import BOXES, boxes_of, bumpy_sphere, check_tree, cost, over_boxes, over_mesh, parts, soup

QUALITIES = ["fast", "balanced", "high"]


def bench_mesh(name: str, detail: float):
    """The meshes of a benchmark's world as one."""
    points, triangles, count = [], [], 0
    for shape in scenes.build(name, detail).shapes:
        arrays = mesh_arrays(shape)
        points.append(arrays["positions"])
        triangles.append(arrays["indices"].astype(np.int64) + count)
        count += len(points[-1])
    return np.concatenate(points), np.concatenate(triangles)


@pytest.mark.parametrize("quality", QUALITIES)
@pytest.mark.parametrize(
    "make", [lambda rng: bumpy_sphere(rng, 6), lambda rng: soup(rng, 50_000)], ids=["mesh", "soup"]
)
def test_the_tree_is_the_same_for_any_number_of_threads(make, quality, rng):
    """Large enough for ranges that threads split together, and for several tasks."""
    mesh = make(rng)
    first = over_mesh(*mesh, quality=quality, threads=1)
    for threads in (2, 7):
        other = over_mesh(*mesh, quality=quality, threads=threads)
        for name in ("nodes", "order"):
            np.testing.assert_array_equal(first.arrays()[name], other.arrays()[name])
        assert first.stats()["sah_cost"] == other.stats()["sah_cost"]


@pytest.mark.parametrize("make", BOXES, ids=lambda f: f.__name__)
def test_optimising_spares_no_primitive(make, rng):
    lo, hi = make(rng)
    for threads in (1, 3):
        check_tree(over_boxes(lo, hi, quality="high", threads=threads), lo, hi)


@pytest.mark.parametrize(("name", "detail"), [("mesh1m", 0.02), ("interior", 0.1), ("terrain", 0.002)])
def test_more_effort_costs_rays_less(name, detail):
    points, triangles = bench_mesh(name, detail)
    lo, hi = boxes_of(points, triangles)
    fast, balanced, high = (cost(over_mesh(points, triangles, quality=quality), lo, hi) for quality in QUALITIES)
    assert high < 0.995 * balanced
    assert balanced < 1.01 * fast
    assert fast < 1.15 * balanced


def test_optimising_helps_most_where_sizes_differ(rng):
    points, triangles = bench_mesh("interior", 0.1)
    lo, hi = boxes_of(points, triangles)
    costs = [cost(over_mesh(points, triangles, quality=quality), lo, hi) for quality in ("balanced", "high")]
    assert costs[1] < 0.93 * costs[0]


@pytest.mark.parametrize("quality", QUALITIES)
def test_every_traversal_finds_what_brute_force_finds(quality, rng):
    core = scenes.build("interior", 0.01).compile(build=quality, device="cpu").core
    low, high = np.array(core.stats()["bounds"])
    origins = rng.uniform(low, high, (1000, 3))
    directions = rng.normal(size=(1000, 3))
    rays = origins, directions / np.linalg.norm(directions, axis=1, keepdims=True)
    brute = trace(core, *rays, method="brute")
    assert brute.found.mean() > 0.9
    for method in TREES:
        np.testing.assert_array_equal(trace(core, *rays, method=method).t, brute.t)


@pytest.mark.parametrize("quality", ["fast", "balanced"])
@pytest.mark.parametrize("make", [lambda rng: bumpy_sphere(rng, 5), lambda rng: soup(rng, 5000)], ids=["mesh", "soup"])
def test_a_node_with_free_slots_has_nothing_left_to_open(make, quality, rng):
    """Its leaves hold one primitive each: larger ones were opened as long as there was room."""
    nodes, _ = parts(over_mesh(*make(rng), quality=quality))
    leaves = nodes["children"][:, None] >> 3 * np.arange(8, dtype=np.uint32) & 7
    is_free = nodes["used"] != 255
    assert is_free.mean() > 0.1
    assert leaves[is_free].max() == 1
    assert leaves[~is_free].max() > 1
