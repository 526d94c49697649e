"""Trees by themselves (``_core.testing.Tree``), taken apart and checked; and boxes and meshes to build them over."""

from __future__ import annotations

import numpy as np

from destello import _core
from tracing import f32, icosphere

NODE = np.dtype(
    [
        ("origin", "<f4", 3),
        ("exponent", "u1", 3),
        ("inner_mask", "u1"),
        ("first_child", "<u4"),
        ("first_leaf", "<u4"),
        ("children", "<u4"),
        ("used", "<u4"),
        ("lo", "u1", (3, 8)),
        ("hi", "u1", (3, 8)),
    ]
)
MAX_DEPTH = _core.testing.traversal_stack // 2 - 2


def over_boxes(lo, hi, device="cpu", **options):
    return _core.testing.Tree.over_boxes(f32(lo), f32(hi), cuda_device=number(device), **options)


def over_mesh(positions, triangles, device="cpu", **options):
    triangles = np.ascontiguousarray(triangles, np.uint32)
    return _core.testing.Tree.over_mesh(f32(positions), triangles, cuda_device=number(device), **options)


def number(device):
    return {"cpu": -1, "cuda": 0}[device]


def parts(tree):
    """The nodes as a record array, and the primitives in leaf order."""
    a = tree.arrays()
    return a["nodes"].view(NODE).reshape(-1), a["order"]


def check_tree(tree, lo, hi):
    """Each primitive is in one leaf, each node has one parent, and boxes hold what is below them. Returns the depth."""
    nodes, order = parts(tree)
    lo, hi = f32(lo).astype(np.float64).reshape(-1, 3), f32(hi).astype(np.float64).reshape(-1, 3)
    np.testing.assert_array_equal(np.sort(order), np.arange(len(lo)))
    step = np.ldexp(1.0, nodes["exponent"].astype(int) - 127)[:, :, None]
    child_lo = nodes["origin"].astype(np.float64)[:, :, None] + step * nodes["lo"]
    child_hi = nodes["origin"].astype(np.float64)[:, :, None] + step * nodes["hi"]
    parents, leaves = np.zeros(len(nodes), int), np.zeros(len(lo), int)
    depth = np.ones(len(nodes), int)
    box_lo, box_hi = np.full((len(nodes), 3), np.inf), np.full((len(nodes), 3), -np.inf)
    for i, node in enumerate(nodes):
        for rank, s in enumerate(np.flatnonzero([node["inner_mask"] >> s & 1 for s in range(8)])):
            assert node["children"] >> (24 + s) & 1
            child = int(node["first_child"]) + rank
            assert child > i
            parents[child] += 1
            depth[child] = depth[i] + 1
    for i in reversed(range(len(nodes))):  # children come after their parents
        node, rank, first = nodes[i], 0, int(nodes[i]["first_leaf"])
        assert node["children"] >> 24 == node["inner_mask"]
        for s in range(8):
            bits = int(node["children"]) >> 3 * s & 7
            assert not (bits and node["inner_mask"] >> s & 1)
            if not node["used"] >> s & 1:
                assert bits == 0
                continue
            if node["inner_mask"] >> s & 1:
                child = int(node["first_child"]) + rank
                rank += 1
                a, b = box_lo[child], box_hi[child]
            else:
                count = {1: 1, 3: 2, 7: 3}[bits]
                leaves[first : first + count] += 1
                which = order[first : first + count]
                first += count
                a, b = lo[which].min(axis=0), hi[which].max(axis=0)
            assert np.all(child_lo[i, :, s] <= a)
            assert np.all(child_hi[i, :, s] >= b)
            box_lo[i], box_hi[i] = np.minimum(box_lo[i], a), np.maximum(box_hi[i], b)
    assert parents[0] == 0
    assert np.all(parents[1:] == 1)
    assert np.all(leaves == 1)
    assert tree.stats()["nodes"] == len(nodes)
    assert depth.max() <= MAX_DEPTH
    return int(depth.max())


def cost(tree, lo, hi):
    """The SAH cost of a tree, from the primitives' boxes: what its statistics should say."""
    nodes, order = parts(tree)
    lo, hi = f32(lo).astype(np.float64)[order], f32(hi).astype(np.float64)[order]
    box_lo, box_hi = np.full((len(nodes), 3), np.inf), np.full((len(nodes), 3), -np.inf)
    total = 0.0
    for i in reversed(range(len(nodes))):
        node, child, first = nodes[i], int(nodes[i]["first_child"]), int(nodes[i]["first_leaf"])
        for s in range(8):
            count = (int(node["children"]) >> 3 * s & 7).bit_count()
            if node["inner_mask"] >> s & 1:
                a, b = box_lo[child], box_hi[child]
                child += 1
            elif count != 0:
                a, b = lo[first : first + count].min(axis=0), hi[first : first + count].max(axis=0)
                total += count * half_area(a, b)
                first += count
            else:
                continue
            box_lo[i], box_hi[i] = np.minimum(box_lo[i], a), np.maximum(box_hi[i], b)
        total += half_area(box_lo[i], box_hi[i])
    return total / half_area(box_lo[0], box_hi[0])


def half_area(lo, hi):
    e = hi - lo
    return e[0] * e[1] + e[1] * e[2] + e[2] * e[0]


def boxes_of(positions, triangles):
    corners = f32(positions)[np.asarray(triangles)]
    return corners.min(axis=1), corners.max(axis=1)


# --- boxes ------------------------------------------------------------------------------------------------------------


def some(n):
    def boxes(rng):
        center, size = rng.uniform(-1, 1, (n, 3)), 0.02 * np.exp(rng.normal(size=(n, 3)))
        return center - size, center + size

    boxes.__name__ = f"{n}_boxes"
    return boxes


def all_the_same(rng):
    return np.full((500, 3), -1.0), np.full((500, 3), 2.0)


def points_on_a_line(rng):
    p = np.zeros((400, 3))
    p[:, 1] = np.arange(400)
    return p, p


def boxes_on_a_line(rng):
    p = np.zeros((1000, 3))
    p[:, 0] = rng.uniform(0, 1, 1000)
    return p, p + 0.001


def one_huge_many_tiny(rng):
    p = rng.uniform(-1e-3, 1e-3, (700, 3))
    lo, hi = p - 1e-6, p + 1e-6
    return np.concatenate([lo, [[-1e6] * 3]]), np.concatenate([hi, [[1e6] * 3]])


def ever_larger(rng):
    """Each box holds all before it, over 60 octaves."""
    size = 2.0 ** np.linspace(-30, 30, 300)[:, None]
    return -size * np.ones(3), size * np.ones(3)


def far_away(rng):
    p = 1e7 + rng.uniform(0, 100, (300, 3))
    return p, p + 1


def flat(rng):
    p = rng.uniform(-1, 1, (600, 3))
    p[:, 2] = 0.25
    return p, p + np.array([0.1, 0.1, 0])


BOXES = [
    *(some(n) for n in (1, 2, 3, 4, 5, 9, 16, 17, 33, 64, 65, 3000)),
    *(all_the_same, points_on_a_line, boxes_on_a_line, one_huge_many_tiny, ever_larger, far_away, flat),
]


# --- meshes -----------------------------------------------------------------------------------------------------------


def bumpy_sphere(rng, levels=5):
    p, t = icosphere(levels)
    return p * (1 + 0.05 * np.sin(9 * p[:, :1]) * np.sin(11 * p[:, 1:2])), t


def soup(rng, n=2000):
    p = (rng.uniform(-1, 1, (n, 1, 3)) + 0.03 * rng.normal(size=(n, 3, 3))).reshape(-1, 3)
    return p, np.arange(3 * n).reshape(-1, 3)


def hills(rng, n=60):
    x, z = np.meshgrid(np.linspace(-1, 1, n + 1), np.linspace(-1, 1, n + 1), indexing="ij")
    p = np.stack([x, 0.1 * np.sin(5 * x) * np.cos(7 * z), z], -1).reshape(-1, 3)
    i = (np.arange(n)[:, None] * (n + 1) + np.arange(n)).ravel()
    return p, np.concatenate([np.stack([i, i + 1, i + n + 2], -1), np.stack([i, i + n + 2, i + n + 1], -1)])


MESHES = [bumpy_sphere, soup, hills]
