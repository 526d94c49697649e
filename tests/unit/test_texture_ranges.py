"""Textures and vertex colours whose values no constant could have: they count as the nearest in the range."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import destello as dl

m = dl.materials


def flat(value: float) -> Any:
    return dl.textures.image(np.full((2, 2, 3), value, np.float32))


def furnace(material: Any, device: str, **mesh: Any) -> np.ndarray:
    """What a square gives back of a sky of 1, seen at an angle."""
    corners = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]], np.float32)
    scene = dl.Scene()
    triangles = np.array([[0, 1, 2], [0, 2, 3]], np.uint32)
    scene.add(dl.shapes.mesh(corners, triangles, uvs=corners[:, :2], material=material, **mesh))
    scene.environment = dl.environments.constant(radiance=1)
    scene.camera = dl.cameras.perspective(origin=(2, 0, 2), target=(0, 0, 0), vfov=10)
    picture = dl.render(scene, spp=16, size=(8, 8), device=device, progress=False)
    return np.asarray(picture.array.mean((0, 1)))


MATERIALS = {
    "reflectance": lambda x: m.diffuse(reflectance=x),
    "roughness": lambda x: m.diffuse(reflectance=1, roughness=x),
    "conductor": lambda x: m.conductor(reflectance=x),
    "tint": lambda x: m.dielectric(tint=x, reflection_tint=x),
    "glTF colour": lambda x: m.metallic_roughness(base_color=x, metallic=0.5),
    "glTF metal": lambda x: m.metallic_roughness(base_color=0.7, metallic=x),
    "base_color": lambda x: m.openpbr(base_color=x, base_weight=x),
    "coat": lambda x: m.openpbr(coat_weight=x, coat_color=x, coat_roughness=x),
    "subsurface": lambda x: m.openpbr(subsurface_weight=0.5, subsurface_color=x, geometry_thin_walled=True),
}


@pytest.mark.parametrize(("wild", "tame"), [(3.0, 1.0), (-2.0, 0.0)])
@pytest.mark.parametrize("name", list(MATERIALS))
def test_values_count_as_the_nearest_in_range(name: str, wild: float, tame: float, device: str) -> None:
    make = MATERIALS[name]
    expected = furnace(make(flat(tame)), device)
    np.testing.assert_allclose(furnace(make(flat(wild)), device), expected, rtol=1e-6)
    if wild > 0:
        bright = dl.textures.scaled(flat(0.5), scale=2 * wild)
        np.testing.assert_allclose(furnace(make(bright), device), expected, rtol=1e-6)
    assert np.all(expected <= 1.05)


def test_vertex_colours(device: str) -> None:
    colors = np.full((4, 4), 2.5, np.float32)
    painted = furnace(m.metallic_roughness(base_color=dl.textures.vertex_color(), metallic=0), device, colors=colors)
    np.testing.assert_allclose(painted, furnace(m.metallic_roughness(base_color=1, metallic=0), device), rtol=1e-5)


def test_emission_takes_no_light_away(device: str) -> None:
    assert furnace(m.diffuse(reflectance=0, emission=flat(-1)), device).min() == 0
    assert furnace(m.diffuse(reflectance=0, emission=flat(7)), device) == pytest.approx(7, rel=1e-5)


def test_a_medium_of_textures(device: str) -> None:
    """What follows inside from a subsurface colour."""

    def inside(color: float, radius: float) -> np.ndarray:
        scene = dl.Scene()
        soft = m.openpbr(subsurface_weight=1, subsurface_color=flat(color), subsurface_radius=flat(radius))
        scene.add(dl.shapes.sphere((0, 0, 0), 1, material=soft))
        scene.environment = dl.environments.constant(radiance=1)
        scene.camera = dl.cameras.perspective(origin=(0, 0, 4), target=(0, 0, 0), vfov=10)
        return np.asarray(dl.render(scene, spp=8, size=(8, 8), device=device, progress=False).array)

    np.testing.assert_allclose(inside(-3, 0.1), inside(0, 0.1), rtol=1e-5)


def test_images_within_other_textures_are_read_as_the_parameter_asks(device: str) -> None:
    """A checker of 8-bit images: data where the parameter is a number, also within."""
    half = dl.textures.image(np.full((2, 2, 3), 128, np.uint8))
    mixed = [
        furnace(m.mix(first=m.diffuse(reflectance=0), second=m.diffuse(reflectance=1), amount=amount), device)
        for amount in (half, dl.textures.checker(even=half, odd=half))
    ]
    np.testing.assert_allclose(mixed[1], mixed[0], rtol=1e-6)
