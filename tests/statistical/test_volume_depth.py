"""Two limits of a path: what scatters in media counts against `max_volume_depth`, and nothing but that."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import destello as dl
import stats
from transport import runs, slab

SKIN = {"subsurface_weight": 1.0, "subsurface_radius_scale": 1.0, "subsurface_color": (0.95, 0.8, 0.4)}


def ball(material: Any) -> dl.Scene:
    """A sphere of a metre's radius under a sky of radiance 1, seen from the front."""
    scene = dl.Scene("ball")
    scene.add(dl.shapes.sphere((0, 0, 0), 1, material=material))
    scene.environment = dl.environments.constant(radiance=1)
    scene.camera = dl.cameras.orthographic(origin=(0, 0, 5), target=(0, 0, 0), height=1)
    return scene


def fog(**medium: Any) -> dl.Node:
    return dl.materials.interface(**{"medium_density": 1.5, "medium_albedo": 1, **medium})


def test_dense_subsurface_is_whole_at_the_defaults(device: str) -> None:
    """Mean free paths of a thousandth of the radius; the ball shows the colour it was given."""
    scene = ball(dl.materials.openpbr(subsurface_radius=1e-3, specular_weight=0.0, **SKIN))
    got = [
        runs(scene, device, spp=12, seed=10 * i, **limits).reshape(-1, 3)
        for i, limits in enumerate([{}, {"max_volume_depth": 50_000, "max_depth": 1000, "rr_depth": 60_000}])
    ]
    a, b = (x.mean(axis=0) for x in got)
    noise = np.sqrt(sum(x.var(axis=0) / len(x) for x in got))
    assert (noise < 0.006).all()
    assert (np.abs(a - b) < 4 * noise).all(), f"{a}, without limits {b}"
    few = runs(scene, device, spp=16, max_volume_depth=30).reshape(-1, 3).mean(axis=0)
    assert (few[:2] < 0.95 * b[:2]).all()  # what absorbs most scatters least


@pytest.mark.parametrize("limit", [0, 1, 50_000])
def test_nothing_changes_where_no_media_are(limit: int, device: str) -> None:
    scene = dl.scenes.build("cornell")
    options = {"spp": 2, "size": (24, 24), "device": device, "progress": False}
    plain, other = (dl.render(scene, **options, **more) for more in ({}, {"max_volume_depth": limit}))
    np.testing.assert_array_equal(plain.array, other.array)


def test_without_scattering_a_medium_only_dims(device: str) -> None:
    scene = dl.Scene("dimmed")
    scene.add(slab(0, 0.5, fog()))
    scene.environment = dl.environments.constant(radiance=1)
    scene.camera = dl.cameras.orthographic(origin=(0, 10, 0), target=(0, 0, 0), up=(0, 0, -1), height=0.5)
    got = runs(scene, device, spp=512, max_volume_depth=0)
    stats.assert_mean(got.reshape(-1, 3), np.exp(-1.5 * 0.5), slack=1e-5)


def test_media_do_not_count_as_segments(device: str) -> None:
    """One segment shows what shines, however often fog has scattered it; a surface beyond that is as good as black."""
    shining = ball(fog())
    shining.add(dl.shapes.sphere((0, 0, 0), 0.6, material=dl.materials.emissive(radiance=1)))
    got = runs(shining, device, spp=64, sampling="auto", max_depth=1, rr_depth=1000)
    stats.assert_mean(got.reshape(-1, 3), 1, slack=1e-4)
    pictures = []
    for reflectance, depth in ((0.5, 1), (0.0, 2)):
        lit = ball(fog())
        lit.add(dl.shapes.sphere((0, 0, 0), 0.6, material=dl.materials.diffuse(reflectance=reflectance)))
        pictures.append(runs(lit, device, spp=16, sampling="auto", max_depth=depth, count=1))
    np.testing.assert_array_equal(*pictures)
    assert 0.1 < pictures[0].mean() < 0.9
