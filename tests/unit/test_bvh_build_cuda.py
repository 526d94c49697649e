"""The GPU's trees against the host's, and against themselves."""

from __future__ import annotations

import numpy as np
import pytest

from tracing import Geometry, assert_all_agree, rays_about
from trees import BOXES, MESHES, boxes_of, bumpy_sphere, hills, over_boxes, over_mesh, some, soup

pytestmark = pytest.mark.cuda


@pytest.mark.parametrize("quality", ["fast", "balanced"])
@pytest.mark.parametrize("make", [*BOXES, some(100_000)], ids=lambda f: f.__name__)
def test_the_same_boxes_give_the_same_bytes(make, quality, rng):
    lo, hi = make(rng)
    first = over_boxes(lo, hi, "cuda", quality=quality).arrays()
    for _ in range(3):
        again = over_boxes(lo, hi, "cuda", quality=quality).arrays()
        for name, values in first.items():
            np.testing.assert_array_equal(again[name], values)


@pytest.mark.parametrize("make", MESHES, ids=lambda f: f.__name__)
def test_a_mesh_is_its_triangles_boxes(make, rng):
    positions, triangles = make(rng)
    mesh = over_mesh(positions, triangles, "cuda").arrays()
    boxes = over_boxes(*boxes_of(positions, triangles), "cuda").arrays()
    for name, values in mesh.items():
        np.testing.assert_array_equal(boxes[name], values)


@pytest.mark.parametrize(("quality", "most"), [("fast", 1.1), ("balanced", 1.03)])
@pytest.mark.parametrize(
    "mesh", [lambda r: bumpy_sphere(r, 6), lambda r: soup(r, 100_000), lambda r: hills(r, 200)], ids=range(3)
)
def test_trees_cost_little_more_than_the_hosts(mesh, quality, most, rng):
    lo, hi = boxes_of(*mesh(rng))
    gpu, host = over_boxes(lo, hi, "cuda", quality=quality).stats(), over_boxes(lo, hi).stats()
    assert gpu["sah_cost"] < most * host["sah_cost"]
    assert gpu["nodes"] < 0.2 * len(lo)


@pytest.mark.parametrize("mesh", [lambda r: bumpy_sphere(r, 6), lambda r: hills(r, 200)], ids=["sphere", "hills"])
def test_reinsertion_pays(mesh, rng):
    """Fast trees, made by the same clustering, lack it: their shorter codes cost them next to nothing here."""
    lo, hi = boxes_of(*mesh(rng))
    fast, balanced = (over_boxes(lo, hi, "cuda", quality=q).stats()["sah_cost"] for q in ("fast", "balanced"))
    assert balanced < 0.99 * fast


def test_memory_is_bounded_and_reported(rng):
    n = 100_000
    stats = over_boxes(*some(n)(rng), "cuda").stats()
    assert 40 < stats["temporary_bytes"] / n < 100
    assert stats["device_seconds"] > 0


def test_scenes_are_built_there(rng):
    """In a group and in the world; the host finds the same hits with either tree."""
    p, t = bumpy_sphere(rng, 5)

    def build(**options):
        g = Geometry().mesh(2 * p, t)
        group = g.group()
        g.mesh(0.3 * p, t, group)
        for x in (-3, 3):
            g.instance(group, np.array([[1, 0, 0, x], [0, 1, 0, 0], [0, 0, 1, 0]], np.float32))
        return g.builder.build(**options)

    gpu, host = build(cuda_device=0), build()
    assert gpu.stats()["bvh_nodes"] != host.stats()["bvh_nodes"]
    rays = rays_about(rng, 1000)
    np.testing.assert_array_equal(assert_all_agree(gpu, rays).t, assert_all_agree(host, rays).t)
