"""Lamps that touch, or all but touch, what light passes straight: fog, veils, glass that does not show.

Shadow rays then meet such a surface within rounding of their end; one that had gone past its end came back for ever.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import destello as dl

VEILS = {
    "veil": dl.materials.diffuse(reflectance=0, opacity=0.5),
    "fog": dl.materials.interface(medium_absorption=1e-6),
    "mix": dl.materials.mix(first=dl.materials.interface(), second=dl.materials.diffuse(opacity=0), amount=0.5),
}


HEIGHT = 1000.0
ULP = float(np.spacing(np.float32(HEIGHT)))


def lit(device: str, *shapes: Any) -> np.ndarray:
    """A floor far up, below a lamp of radiance 1 that hangs 1.25 above it, by shadow rays alone."""
    scene = dl.Scene()
    lamp = dl.materials.emissive(radiance=1)
    floor = dl.materials.diffuse(reflectance=1)
    scene.add(dl.shapes.quad((-1, HEIGHT + 1.25, -1), (2, 0, 0), (0, 0, 2), material=lamp))
    scene.add(dl.shapes.quad((-1, HEIGHT, 1), (2, 0, 0), (0, 0, -2), material=floor), *shapes)
    scene.camera = dl.cameras.perspective(origin=(0, HEIGHT + 0.6, 0), target=(0.02, HEIGHT, 0), vfov=80)
    scene.render.light_sampling = "light"
    picture = dl.render(scene, spp=64, size=(32, 32), device=device, progress=False, max_depth=2)
    return np.asarray(picture.array.mean((0, 1)), np.float64)


@pytest.mark.timeout(60)
@pytest.mark.parametrize("steps", range(-1, 24))
@pytest.mark.parametrize("name", list(VEILS))
def test_shadow_rays_end_at_a_lamp_with_a_veil_upon_it(name: str, steps: int, device: str) -> None:
    """Where the veil is in the same place as the lamp it may count or not; nothing else happens."""
    height = HEIGHT + 1.25 - steps * ULP
    veil = dl.shapes.quad((-2, height, -2), (4, 0, 0), (0, 0, 4), material=VEILS[name])
    share = lit(device, veil) / lit(device)
    least = 0.5 if name == "veil" else 1.0
    assert np.all(share > least - 0.02)
    assert np.all(share < 1.02)


@pytest.mark.timeout(60)
@pytest.mark.parametrize("size", [3, 5, 8])
@pytest.mark.parametrize("name", list(VEILS))
def test_a_veil_that_cuts_a_small_lamp(name: str, size: float, device: str) -> None:
    """Some of the points of light lie on the veil within rounding: the render comes to an end."""
    place, near = np.array([0.3, 0.2, 0.1]), 0.01
    scene = dl.Scene()
    scene.add(dl.shapes.sphere(place, 1e-4, material=dl.materials.emissive(radiance=5)))
    slope = dl.translate(*place) @ dl.rotate((1, 0.3, 0.2), 100)
    veil = {"material": VEILS[name], "transform": slope}
    scene.add(dl.shapes.quad((-size, 0, -size), (2 * size, 0, 0), (0, 0, 2 * size), **veil))
    corner = place + np.array([-near, -near, near])
    scene.add(dl.shapes.quad(corner, (2 * near, 0, 0), (0, 0, -2 * near), material=dl.materials.diffuse()))
    eye, target = place + np.array([0, near, 5 * near]), place - np.array([0, near, 0])
    scene.camera = dl.cameras.perspective(origin=eye, target=target, vfov=30)
    scene.render.light_sampling = "light"
    picture = dl.render(scene, spp=256, size=(64, 64), device=device, progress=False, max_depth=2)
    assert np.isfinite(picture.array).all()
    assert picture.array.mean() > 1e-4
