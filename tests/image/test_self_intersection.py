"""Rays never meet the surface that they start on: a flat thing under a white sky has exactly its own colour."""

import numpy as np
import pytest

import destello as dl

ALBEDO = 0.5


def shape_at(kind, material, place):
    if kind == "quad":
        return dl.shapes.quad((-1, 0, -1), (0, 0, 2), (2, 0, 0), material=material, transform=place)
    if kind == "sliver":  # a thousand times as long as wide
        return dl.shapes.quad((-20, 0, -0.02), (0, 0, 0.04), (40, 0, 0), material=material, transform=place)
    x = np.linspace(-1, 1, 41)
    px, pz = np.meshgrid(x, x)
    positions = np.stack([px.ravel(), np.zeros(px.size), pz.ravel()], 1)
    i = np.arange(40)[:, None] * 41 + np.arange(40)
    lower, upper = np.stack([i, i + 41, i + 1], -1), np.stack([i + 1, i + 41, i + 42], -1)
    indices = np.concatenate([lower.reshape(-1, 3), upper.reshape(-1, 3)])
    return dl.shapes.mesh(positions, indices, material=material, transform=place)


def picture(kind, albedo, place, device, instanced):
    scene = dl.Scene("furnace")
    scene.environment = dl.environments.constant(radiance=1)
    material = dl.materials.diffuse(reflectance=albedo)
    if instanced:
        group = scene.group("flat", [shape_at(kind, material, None)])
        scene.add(dl.shapes.instance(group.name, transform=place))
    else:
        scene.add(shape_at(kind, material, place))
    eye, target = (place.matrix @ np.array([*p, 1.0]) for p in ((0.3, 0.6, 0.1), (0, 0, 0)))
    scene.camera = dl.cameras.perspective(origin=eye[:3], target=target[:3], up=(0.1, 0.2, 1), vfov=60)
    return dl.render(scene, spp=4, size=(48, 48), device=device, progress=False, max_depth=8).array


@pytest.mark.parametrize("instanced", [False, True], ids=["world", "instance"])
@pytest.mark.parametrize("kind", ["quad", "sliver", "grid"])
@pytest.mark.parametrize("scale", [1e-3, 1, 1e3, 1e6])
@pytest.mark.parametrize("tilt", [0, 33], ids=["level", "tilted"])
@pytest.mark.parametrize("shift", [(0, 0, 0), (7, 0, 0), (3, -7, 11)], ids=["origin", "aside", "off"])
def test_a_flat_surface_keeps_its_colour(kind, scale, tilt, shift, instanced, device):
    place = dl.scale(scale) @ dl.translate(*shift) @ dl.rotate("x", tilt) @ dl.rotate("z", 0.7 * tilt)
    covered = (picture(kind, 0.0, place, device, instanced) == 0).all(axis=2)
    assert covered.sum() > 40
    got = picture(kind, ALBEDO, place, device, instanced)[covered]
    np.testing.assert_allclose(got, ALBEDO, rtol=1e-5)


def test_small_triangles_far_away_are_seen(device):
    """The bound on the error of t must not swallow hits whose t is good."""
    scene = dl.Scene("far")
    scene.environment = dl.environments.constant(radiance=0.25)
    lamp = dl.materials.emissive(radiance=1)
    scene.add(dl.shapes.quad((-0.5, -0.5, -1e4), (1, 0, 0), (0, 1, 0), material=lamp))
    scene.camera = dl.cameras.perspective(origin=(0, 0, 0), target=(0, 0, -1), vfov=0.004)
    got = dl.render(scene, spp=16, size=(16, 16), device=device, progress=False).array
    np.testing.assert_allclose(got, 1.0, rtol=1e-5)
