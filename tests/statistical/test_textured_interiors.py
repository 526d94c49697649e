"""Textures that colour the medium inside an OpenPBR surface: a path has the colour of the point where it entered."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import destello as dl
from interiors import CLEAR, LEFT, RIGHT, TOP, both, columns, halves, looking_down, slab
from stats import z_threshold
from transport import assert_agree, estimate


def test_glass_absorbs_by_the_colour_at_the_entry(device: str) -> None:
    material = dl.materials.openpbr(**CLEAR, transmission_depth=0.4, transmission_color=halves())
    got = columns(looking_down(slab(material)), device)
    np.testing.assert_allclose(got, both(LEFT, RIGHT) ** (1 / 0.4), rtol=2e-4)


def test_what_leaves_elsewhere_keeps_its_colour(device: str) -> None:
    """A slanted camera: the pixels that enter on the left leave on the right."""
    material = dl.materials.openpbr(**CLEAR, transmission_depth=0.4, transmission_color=halves())
    s = looking_down(slab(material, half=4.0))
    s.camera = dl.cameras.orthographic(origin=(-5.5, 0, 5), target=(-0.5, 0, 0), height=0.5)
    got = columns(s, device)
    np.testing.assert_allclose(got, np.tile(np.array(LEFT) ** (np.sqrt(2) / 0.4), (8, 1)), rtol=2e-4)


def test_a_texture_may_be_scaled_and_nested(device: str) -> None:
    pattern = dl.textures.checker_uv(even=halves(), odd=TOP, count_u=1, count_v=2)
    material = dl.materials.openpbr(
        **CLEAR, transmission_depth=1.0, transmission_color=dl.textures.scaled(pattern, scale=0.5)
    )
    s = looking_down(slab(material))
    s.film.filter = dl.filters.box()
    got = np.asarray(dl.render(s, spp=4, device=device, progress=False).array, np.float64)
    expected = np.concatenate([np.tile(TOP, (4, 8, 1)), np.tile(both(LEFT, RIGHT), (4, 1, 1))])
    np.testing.assert_allclose(got, 0.5 * expected, rtol=2e-4)


def test_vertex_colours_colour_it_too(device: str) -> None:
    mesh = slab(dl.materials.openpbr(**CLEAR, transmission_depth=1.0, transmission_color=dl.textures.vertex_color()))
    s = looking_down(mesh.replace(colors=np.tile(np.float32(RIGHT), (8, 1))))
    np.testing.assert_allclose(columns(s, device), np.tile(RIGHT, (8, 1)), rtol=2e-4)


def test_shadow_rays_inside_have_the_colour_too(device: str) -> None:
    """A matt floor and a lamp, both in the glass: there and back by the colour at the entry."""
    depth, lamp = 0.8, 0.5
    material = dl.materials.openpbr(**CLEAR, transmission_depth=depth, transmission_color=halves())
    floor = dl.shapes.quad((-0.9, -0.9, -0.9), (1.8, 0, 0), (0, 1.8, 0), material=dl.materials.diffuse(reflectance=0.5))
    s = looking_down(slab(material), floor, sky=0.0, height=0.2)
    s.add(dl.lights.point(position=(0, 0, -0.9 + lamp), intensity=1))
    s.render.max_depth = 4
    s.film.filter = dl.filters.box()
    got = np.asarray(dl.render(s, spp=64, device=device, progress=False).array, np.float64)
    x = (np.arange(8) + 0.5) / 8 * 0.2 - 0.1
    way = np.sqrt(x[None, :] ** 2 + x[:, None] ** 2 + lamp**2)
    clear = 0.5 / np.pi * lamp / way**3
    expected = clear[..., None] * both(LEFT, RIGHT)[None] ** ((0.9 + way[..., None]) / depth)
    np.testing.assert_allclose(got, expected, rtol=3e-3)  # a pixel's mean against its middle


def test_hidden_boundaries_are_entrances(device: str) -> None:
    """Glass that begins inside something of higher priority: its colour is that of the boundary that does not show."""
    absorption = np.array([0.2, 0.5, 0.9])
    first = dl.materials.interface(medium_absorption=tuple(absorption), priority=1)
    glass = dl.materials.openpbr(**CLEAR, transmission_depth=0.5, transmission_color=halves())
    shapes = slab(glass, -1.0, 0.0), slab(first, -0.25, 0.5, half=1.5)
    expected = np.exp(-0.75 * absorption) * both(LEFT, RIGHT) ** (0.75 / 0.5)
    np.testing.assert_allclose(columns(looking_down(*shapes), device), expected, rtol=2e-4)
    # A shadow ray's way: from a floor in the first, through the hidden boundary, to a lamp in the glass.
    floor = dl.shapes.quad((-0.9, -0.9, 0.1), (0, 1.8, 0), (1.8, 0, 0), material=dl.materials.diffuse(reflectance=0.5))
    s = looking_down(*shapes, floor, sky=0.0)
    s.camera = dl.cameras.orthographic(origin=(0, 0, 0.05), target=(0, 0, 1), height=0.02)  # in the first medium
    s.add(dl.lights.point(position=(0, 0, -0.5), intensity=1))
    s.render.max_depth = 2
    got = columns(s, device, spp=64)
    lamp = 0.5 / np.pi / 0.6**2 * np.exp(-0.4 * absorption)  # 0.05 to the floor and 0.35 back; the glass takes 0.25
    np.testing.assert_allclose(got, lamp * both(RIGHT, LEFT) ** (0.25 / 0.5), rtol=1e-3)  # the picture's x is -x


def test_one_colour_is_carried(device: str) -> None:
    """Of nested ones the last entered counts; what is come back to, and what the camera starts in, is the mean."""
    glass = {**CLEAR, "transmission_depth": 0.5}
    outer = dl.materials.openpbr(**glass, transmission_color=halves())
    inner = dl.materials.openpbr(**glass, transmission_color=halves(RIGHT, TOP))
    mean = (np.array(LEFT) + np.array(RIGHT)) / 2
    s = looking_down(slab(outer), slab(inner, -0.75, -0.25, half=0.9), height=1.6)
    expected = both(LEFT, RIGHT) ** (0.25 / 0.5) * both(RIGHT, TOP) * mean ** (0.25 / 0.5)
    np.testing.assert_allclose(columns(s, device), expected, rtol=2e-4)
    # Something without a texture in between changes nothing.
    plain = dl.materials.openpbr(**glass, transmission_color=TOP)
    s = looking_down(slab(outer), slab(plain, -0.75, -0.25, half=0.9), height=1.6)
    expected = both(LEFT, RIGHT) * np.array(TOP)
    np.testing.assert_allclose(columns(s, device), expected, rtol=2e-4)
    s = looking_down(slab(outer), z=-0.4)
    np.testing.assert_allclose(columns(s, device), np.tile(mean ** (0.6 / 0.5), (8, 1)), rtol=2e-4)


LOOKS: dict[str, dict[str, Any]] = {
    "subsurface": {"subsurface_weight": 1.0, "subsurface_radius": 0.02, "subsurface_scatter_anisotropy": 0.3},
    "milk": {"transmission_weight": 1.0, "transmission_depth": 0.3, "transmission_scatter": (0.3, 0.5, 0.7)}
    | {"specular_roughness": 0.2},
    "mixture": {"transmission_weight": 0.4, "subsurface_weight": 0.7, "subsurface_radius": 0.05}
    | {"transmission_depth": 0.5, "transmission_scatter": 0.2},
}


@pytest.mark.parametrize("look", LOOKS)
@pytest.mark.parametrize("lamp", [False, True])
def test_constant_texture_is_a_constant(device: str, look: str, lamp: bool) -> None:
    """With a lamp inside, too, so that shadow rays count. The samples are the same ones but for rounding."""
    name = "transmission_color" if look == "milk" else "subsurface_color"
    pictures = []
    for colour in (LEFT, dl.textures.image(np.full((4, 4, 3), LEFT, np.float32), color_space="linear")):
        s = looking_down(slab(dl.materials.openpbr(**LOOKS[look], **{name: colour})))
        if lamp:
            s.add(dl.lights.point(position=(0.1, 0.2, -0.2), intensity=0.2))
        pictures.append(estimate(s, device, spp=64, size=(8, 8), seed=3))
    assert_agree(*pictures)
    difference = np.abs(pictures[0].mean - pictures[1].mean) / np.sqrt(pictures[0].variance + pictures[1].variance)
    assert np.median(difference) < 0.2


@pytest.mark.parametrize("look", ["subsurface", "milk"])
@pytest.mark.parametrize("side", [0, 1])
def test_far_from_the_seam_each_half_is_as_if_alone(device: str, look: str, side: int) -> None:
    """A slab of many mean free paths, seen from above on either side of a seam. The samples are the same ones."""
    name = "transmission_color" if look == "milk" else "subsurface_color"
    options = LOOKS[look] | ({"transmission_depth": 0.01} if look == "milk" else {})
    pictures = []
    for colour in ((LEFT, RIGHT)[side], halves()):
        material = dl.materials.openpbr(**options, **{name: colour})
        s = looking_down(slab(material, half=2.0), x=(-1.0, 1.0)[side], height=0.5)
        pictures.append(estimate(s, device, spp=128, size=(8, 8)))
    assert_agree(*pictures, comparisons=4)
    one, other = (p.rgb.mean((0, 1)) for p in pictures)
    np.testing.assert_allclose(one, other, rtol=1e-3)
    assert np.argmax(one) == (0, 2)[side]


def test_energy_is_kept(device: str) -> None:
    """White in one half and grey in the other: what enters the white half vanishes in the furnace."""
    color = halves((1, 1, 1), (0.5, 0.5, 0.5))
    material = dl.materials.openpbr(subsurface_weight=1.0, subsurface_radius=0.5, subsurface_color=color)
    got = estimate(looking_down(slab(material, half=2.0), x=-0.5, height=0.9), device, spp=64, size=(8, 8))
    mean, variance = got.total
    assert abs(mean - 1) < 0.01 + z_threshold(1) * np.sqrt(variance)


def test_a_textured_white_is_a_medium(device: str) -> None:
    """Glass whose mean colour absorbs nothing, and a volume in it: there is something to vary."""
    grid = dl.volumes.grid(density=np.full((2, 2, 2), 0.5, np.float32), min=(-2, -2, -2), max=(2, 2, 2))
    white = dl.textures.image(np.ones((1, 1, 3), np.float32), color_space="linear")
    for colour, expected in ((white, 1.0), (halves((0.5,) * 3, (0.5,) * 3), 0.5)):
        material = dl.materials.openpbr(**CLEAR, transmission_depth=0.5, transmission_color=colour, medium_volume=grid)
        got = estimate(looking_down(slab(material)), device, spp=256, size=(8, 8))
        mean, variance = got.total
        assert abs(mean - expected) < 1e-4 + z_threshold(2) * np.sqrt(variance)
