"""Media whose colours collide at different rates, through the whole renderer: closed forms and grey twins."""

from __future__ import annotations

from math import pi, sqrt

import numpy as np
import pytest

import destello as dl
import stats
from transport import down_on, floor, runs, slab

DENSITY = np.array([0.3, 1.2, 4.0])


def fog(**changes):
    return dl.materials.interface(**{"medium_density": tuple(DENSITY), **changes})


def under_sky(*shapes, radiance=1.0):
    scene = dl.Scene("media")
    scene.add(*shapes)
    scene.environment = dl.environments.constant(radiance=radiance)
    scene.camera = dl.cameras.orthographic(origin=(0, 10, 10), target=(0, 0, 0), height=0.5)
    return scene


def test_what_a_black_medium_lets_pass(device):
    absorption = np.array([0.5, 0.0, 0.2])
    scene = under_sky(slab(0, 0.5, fog(medium_albedo=0, medium_absorption=tuple(absorption))))
    got = runs(scene, device, spp=512)
    stats.assert_mean(got.reshape(-1, 3), np.exp(-(DENSITY + absorption) * 0.5 * sqrt(2)), slack=1e-5)


@pytest.mark.parametrize("anisotropy", [0.0, 0.8])
def test_white_furnace(anisotropy, device):
    """A medium that only scatters cannot be seen under a constant sky, in no colour; the colours' sum has no noise."""
    scene = dl.Scene("white smoke")
    smoke = fog(medium_albedo=1, medium_anisotropy=anisotropy)
    scene.add(dl.shapes.sphere((0, 0, 0), 1, material=smoke))
    scene.environment = dl.environments.constant(radiance=0.8)
    scene.camera = dl.cameras.perspective(origin=(0, 0, 4), target=(0, 0, 0), vfov=35)
    got = runs(scene, device, spp=64, sampling="auto", max_depth=1000, rr_depth=1000)
    stats.assert_mean(got.reshape(-1, 3), 0.8, comparisons=2, slack=1e-5)
    np.testing.assert_allclose(got.sum(-1), 3 * 0.8, rtol=1e-4)


def test_once_scattered_sunlight(device):
    """A layer seen from above with the sun behind the camera: the way in is the way out."""
    absorption, height = np.array([0.2, 0.1, 0.0]), 0.7
    scene = dl.Scene("layer")
    scene.add(slab(0, height, fog(medium_albedo=0.9, medium_absorption=tuple(absorption))))
    scene.add(dl.lights.directional(direction=(0, -1, 0), irradiance=pi))
    scene.camera = down_on()
    extinction = DENSITY + absorption
    known = pi / (4 * pi) * 0.9 * DENSITY * -np.expm1(-2 * extinction * height) / (2 * extinction)
    got = runs(scene, device, spp=512, max_volume_depth=1)
    stats.assert_mean(got.reshape(-1, 3), known, slack=1e-5)


@pytest.mark.parametrize("sampling", ["mis", "bsdf"])
def test_every_colour_is_that_of_a_grey_twin(sampling, device):
    """Many scatterings between a floor and a lamp, in the fog and through it."""

    def scene(density):
        s = dl.Scene("twin")
        material = fog(medium_density=density, medium_albedo=0.9, medium_anisotropy=0.4, medium_absorption=0.1)
        s.add(floor(), dl.shapes.box((-1, 0.05, -1), (1, 1, 1), material=material))
        lamp = dl.materials.emissive(radiance=5)
        s.add(dl.shapes.quad((-1, 2, -1), (2, 0, 0), (0, 0, 2), material=lamp))
        s.camera = dl.cameras.perspective(origin=(0, 1.5, 4), target=(0, 0.5, 0), vfov=50)
        return s

    options = {"spp": 256, "size": (8, 8), "sampling": sampling, "count": 6, "max_depth": 8}
    colors = runs(scene(tuple(DENSITY)), device, **options)
    for channel, density in enumerate(DENSITY):
        grey = runs(scene(float(density)), device, seed=50 + channel, **options)[..., 0]
        ours = colors[..., channel]
        (a, va), (b, vb) = ((r.mean(), r.var(0, ddof=1).sum() / len(r) / r[0].size ** 2) for r in (ours, grey))
        stats.assert_means_agree(a, va, b, vb, comparisons=6, slack=1e-5)
        assert sqrt(va + vb) < 0.01 * a


def test_sunlight_through_coloured_fog_onto_a_floor(device):
    """Shadow rays: nothing is random but which samples hit what."""
    scene = dl.Scene("floor")
    scene.add(floor(1.0), slab(0.2, 0.6, fog(medium_albedo=0.5)))
    scene.add(dl.lights.directional(direction=(0, -1, 0), irradiance=pi))
    scene.camera = dl.cameras.orthographic(origin=(0, 0.1, 0), target=(0, 0, 0), up=(0, 0, -1), height=1)
    got = runs(scene, device, spp=4, max_volume_depth=0, count=1, max_depth=2)
    np.testing.assert_allclose(got, np.broadcast_to(np.exp(-DENSITY * 0.4), got.shape), rtol=3e-4)  # skins


def test_camera_inside(device):
    scene = under_sky(dl.shapes.sphere((1, 2, 3), 2, material=fog(medium_albedo=0)))
    scene.camera = dl.cameras.perspective(origin=(1, 2, 3), target=(0, 0, 0), vfov=60)
    got = runs(scene, device, spp=512)
    stats.assert_mean(got.reshape(-1, 3), np.exp(-DENSITY * 2), slack=1e-5)


@pytest.mark.parametrize("time", [0.0, 1.0])
def test_camera_inside_what_moves(time, device):
    """What the camera is in goes by the shutter: a ball of fog that comes over it, or is there at first and goes."""
    far, here = (10, 0, 0), (0, 0, 0)
    ball = {"center": far, "center1": here} if time else {"center": here, "center1": far}
    scene = under_sky(dl.shapes.sphere(radius=2, material=fog(medium_albedo=0), **ball))
    scene.camera = dl.cameras.perspective(origin=(0, 0, 0), target=(0, 0, -1), vfov=40)
    got = runs(scene, device, spp=256, shutter=(time, time))
    stats.assert_mean(got.reshape(-1, 3), np.exp(-DENSITY * 2), slack=1e-5)


def test_no_fireflies(device):
    """A strong lamp in thick fog: no pixel is more than its own lamp's radiance and what the sum rule allows."""
    scene = dl.Scene("thick")
    scene.add(dl.shapes.sphere((0, 0, 0), 1, material=fog(medium_density=(1, 10, 100), medium_albedo=(1, 0.9, 0.8))))
    scene.environment = dl.environments.constant(radiance=1)
    scene.camera = dl.cameras.perspective(origin=(0, 0, 4), target=(0, 0, 0), vfov=35)
    got = runs(scene, device, spp=1, size=(64, 64), sampling="auto", max_volume_depth=200, rr_depth=1000)
    assert got.sum(-1).max() <= 3 * (1 + 1e-4)
