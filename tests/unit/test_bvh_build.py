"""Trees by themselves, on either builder: what they hold, what they cost, and what rays find in them; refitting."""

from __future__ import annotations

import numpy as np
import pytest

from destello import _core
from tracing import f32, sphere_directions, unit
from trees import BOXES, MESHES, boxes_of, bumpy_sphere, check_tree, cost, number, over_boxes, over_mesh, parts, some

QUALITIES = ["fast", "balanced", "high"]


def rays_at(rng, n):
    origins = 3 * sphere_directions(rng, n)
    return f32(origins), f32(unit(rng.uniform(-1, 1, (n, 3)) - origins))


def assert_hits_are_right(tree, rng, n=400):
    rays = rays_at(rng, n)
    found, brute = tree.trace(*rays), tree.trace(*rays, brute=True)
    np.testing.assert_array_equal(found["t"], brute["t"])  # of several at that distance, either
    assert np.isfinite(brute["t"]).mean() > 0.05


@pytest.mark.parametrize("quality", QUALITIES)
@pytest.mark.parametrize("make", BOXES, ids=lambda f: f.__name__)
def test_every_primitive_is_in_one_leaf_and_boxes_hold_what_is_below(make, quality, device, rng):
    lo, hi = make(rng)
    tree = over_boxes(lo, hi, device, quality=quality)
    assert check_tree(tree, lo, hi) == tree.stats()["depth"]


def test_no_boxes_make_a_root_without_children(device):
    tree = over_boxes(np.zeros((0, 3)), np.zeros((0, 3)), device)
    nodes, order = parts(tree)
    assert len(nodes) == 1
    assert len(order) == 0
    assert not nodes["used"].any()


@pytest.mark.parametrize("make", MESHES, ids=lambda f: f.__name__)
def test_rays_hit_what_they_hit_without_a_tree(make, device, rng):
    assert_hits_are_right(over_mesh(*make(rng), device), rng)


def test_the_reported_cost_is_the_cost(device, rng):
    lo, hi = some(3000)(rng)
    tree = over_boxes(lo, hi, device)
    np.testing.assert_allclose(tree.stats()["sah_cost"], cost(tree, lo, hi), rtol=1e-4)


def greedy_slots(lo, hi):
    """The pair of child and free slot that gains most goes first; of equals the first child, then the first slot."""
    half = np.float32(0.5)
    center = (lo.min(axis=0) + hi.max(axis=0)) * half
    d = (lo + hi) * half - center
    signs = np.where(np.arange(8)[:, None] >> np.arange(3) & 1, np.float32(1), np.float32(-1))
    gain = signs[:, 0] * d[:, :1] + signs[:, 1] * d[:, 1:2] + signs[:, 2] * d[:, 2:]
    slots = [-1] * len(lo)
    for _ in lo:
        child, slot = np.unravel_index(np.argmax(gain), gain.shape)
        slots[child] = int(slot)
        gain[child], gain[:, slot] = -np.inf, -np.inf
    return slots


@pytest.mark.parametrize("grid", [0, 1, 4], ids=["continuous", "many ties", "some ties"])
def test_children_take_slots_by_their_octants_greedily(grid, rng):
    for _ in range(300):
        n = int(rng.integers(1, 9))
        lo = rng.uniform(-1, 1, (n, 3)) if grid == 0 else rng.integers(-grid, grid + 1, (n, 3))
        hi = lo + (rng.uniform(0, 1, (n, 3)) if grid == 0 else 1)
        assert _core.testing.slots(f32(lo), f32(hi)) == greedy_slots(f32(lo), f32(hi))


def test_boxes_without_end_get_a_slot_each():
    lo, hi = f32(np.full((8, 3), -np.inf)), f32(np.full((8, 3), np.inf))
    assert sorted(_core.testing.slots(lo, hi)) == list(range(8))


# --- refitting --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("make", BOXES, ids=lambda f: f.__name__)
def test_refitting_unmoved_boxes_changes_nothing(make, device, rng):
    lo, hi = make(rng)
    tree = over_boxes(lo, hi, device)
    before = tree.arrays()["nodes"].copy()
    tree.refit_boxes(f32(lo), f32(hi), cuda_device=number(device))
    np.testing.assert_array_equal(tree.arrays()["nodes"], before)


@pytest.mark.parametrize("make", BOXES, ids=lambda f: f.__name__)
def test_refitted_boxes_hold_what_has_moved(make, device, rng):
    lo, hi = make(rng)
    tree = over_boxes(lo, hi, device)
    order = tree.arrays()["order"].copy()
    by = rng.normal(size=lo.shape) * (hi - lo).max()
    tree.refit_boxes(f32(lo + by), f32(hi + by), cuda_device=number(device))
    check_tree(tree, lo + by, hi + by)
    np.testing.assert_array_equal(tree.arrays()["order"], order)


@pytest.mark.parametrize("make", MESHES, ids=lambda f: f.__name__)
def test_rays_hit_what_has_moved(make, device, rng):
    positions, triangles = make(rng)
    tree = over_mesh(positions, triangles, device)
    moved = positions * (1, 1.3, 0.8) + 0.2 * np.sin(3 * positions[:, [1, 2, 0]])
    tree.refit_mesh(f32(moved), cuda_device=number(device))
    check_tree(tree, *boxes_of(moved, triangles))
    assert_hits_are_right(tree, rng)


def test_refitting_wants_as_many_boxes(device, rng):
    lo, hi = some(9)(rng)
    tree = over_boxes(lo, hi, device)
    with pytest.raises(ValueError, match="as many boxes"):
        tree.refit_boxes(f32(lo[:5]), f32(hi[:5]), cuda_device=number(device))


@pytest.mark.skipif(_core.has_cuda, reason="this build has a CUDA backend")
def test_a_build_without_cuda_says_so(rng):
    with pytest.raises(ValueError, match="no CUDA backend"):
        over_mesh(*bumpy_sphere(rng, 1), "cuda")
    with pytest.raises(ValueError, match="no CUDA backend"):
        _core.SceneBuilder().build(cuda_device=0)
