"""Geometry that is refused, in words, and triangles that are dropped and counted."""

from __future__ import annotations

import numpy as np
import pytest

from tracing import Geometry, affine, trace

TRIANGLE = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]], float)


def test_degenerate_triangles_are_dropped_and_counted():
    p = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [2, 0, 0], [0, 0, 0]], float)
    g = Geometry().mesh(p, [[0, 1, 2], [0, 0, 1], [0, 1, 3], [0, 4, 1], [2, 1, 0]])
    assert g.dropped == 3
    stats = g.build().stats()
    assert (stats["triangles"], stats["dropped"]) == (2, 3)


def test_a_mesh_of_nothing_but_degenerate_triangles_is_empty_space():
    scene = Geometry().mesh(TRIANGLE, [[0, 0, 0]]).build()
    assert not trace(scene, [[0.2, 0.2, 1]], [[0, 0, -1]]).found.any()


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
def test_vertices_and_centres_must_be_finite(bad):
    p = TRIANGLE.copy()
    p[1, 2] = bad
    with pytest.raises(ValueError, match=r"positions\[1\].*expected finite"):
        Geometry().mesh(p, [[0, 1, 2]])
    with pytest.raises(ValueError, match=r"positions1\[1\].*expected finite"):
        Geometry().mesh(TRIANGLE, [[0, 1, 2]], positions1=p)
    with pytest.raises(ValueError, match=r"centers\[1\].*expected finite"):
        Geometry().spheres(p, [1, 1, 1])
    with pytest.raises(ValueError, match=r"centers1\[1\].*expected finite"):
        Geometry().spheres(TRIANGLE, [1, 1, 1], centers1=p)
    with pytest.raises(ValueError, match=r"radii\[0\].*expected a finite number other than 0"):
        Geometry().spheres([[0, 0, 0]], [bad])


def test_a_radius_of_zero_is_refused():
    with pytest.raises(ValueError, match=r"radii\[1\]: 0.*other than 0"):
        Geometry().spheres([[0, 0, 0], [1, 1, 1]], [1, 0])


@pytest.mark.parametrize("bad", [3, 4_000_000_000, 2**32 - 1])
def test_indices_must_be_in_range(bad):
    with pytest.raises(ValueError, match=rf"indices\[1\]: {bad}; expected below 3"):
        Geometry().mesh(TRIANGLE, [[0, 1, 2], [0, 1, bad]])


def test_other_indices_must_be_in_range():
    g = Geometry()
    for call in (
        lambda: g.mesh(TRIANGLE, [[0, 1, 2]], group=1),
        lambda: g.mesh(TRIANGLE, [[0, 1, 2]], material=7),
        lambda: g.spheres([[0, 0, 0]], [1], material=7),
        lambda: g.instance(5, affine(np.eye(3))),
        lambda: g.builder.place_mesh(0, 99, 0),
    ):
        with pytest.raises(ValueError, match="expected an index below"):
            call()
    with pytest.raises(ValueError, match="world"):
        g.instance(0, affine(np.eye(3)))


def test_arrays_of_the_wrong_length_are_refused():
    for name, width in (("normals", 3), ("uvs", 2), ("colors", 4), ("positions1", 3)):
        with pytest.raises(ValueError, match=rf"{name}: 2 entries; expected 3"):
            Geometry().mesh(TRIANGLE, [[0, 1, 2]], **{name: np.zeros((2, width))})


@pytest.mark.parametrize(
    "linear",
    [np.zeros((3, 3)), np.diag([1, 0, 1]), [[1, 2, 3], [2, 4, 6], [0, 0, 1]], np.diag([1, np.nan, 1])],
    ids=["zero", "flat", "dependent rows", "not a number"],
)
def test_transforms_must_be_invertible(linear):
    g = Geometry()
    group = g.group()
    g.mesh(TRIANGLE, [[0, 1, 2]], group)
    for call in (
        lambda: g.instance(group, affine(linear)),
        lambda: g.instance(group, affine(np.eye(3)), affine(linear)),
        lambda: g.mesh(TRIANGLE, [[0, 1, 2]], transform=affine(linear)),
        lambda: g.mesh(TRIANGLE, [[0, 1, 2]], transform=affine(np.eye(3)), transform1=affine(linear)),
    ):
        with pytest.raises(ValueError, match="expected an invertible matrix"):
            call()


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_translations_must_be_finite(bad):
    g = Geometry()
    group = g.group()
    g.mesh(TRIANGLE, [[0, 1, 2]], group)
    with pytest.raises(ValueError, match="finite"):
        g.instance(group, affine(np.eye(3), (0, bad, 0)))
    with pytest.raises(ValueError, match="finite"):
        g.mesh(TRIANGLE, [[0, 1, 2]], transform=affine(np.eye(3), (0, bad, 0)))
