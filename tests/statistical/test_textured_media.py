"""Textures on all that makes the medium inside an OpenPBR surface: a path has the medium of the point where it entered.

Where more than one colour is textured the medium travels in 48 bits, rounded at random (core/medium/packed_medium.h).
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import destello as dl
from destello import _core
from interiors import CLEAR, LEFT, RIGHT, both, columns, halves, looking_down, slab
from scene_files import write_image
from stats import z_threshold
from transport import Estimate, assert_agree, estimate

EXTINCTIONS = np.float32([1e-4, 0.003, 0.1, 0.77, 1, 12.3, 700, 2e4, 9e5])


def packed(extinction: Any, albedo: Any, g: float = 0.0, count: int = 4000) -> Any:
    """Media after the path's 48 bits, `count` times: extinction, albedo, anisotropy of each."""
    scattering, absorption = (
        np.float32(np.tile(m, (count, 1))) for m in (extinction * albedo, extinction * (1 - albedo))
    )
    out = np.asarray(_core.testing.packed_medium(scattering, absorption, g, 5), np.float64)
    total = out[:, :3] + out[:, 3:6]
    return total, out[:, :3] / np.maximum(total, 1e-30), out[:, 6]


@pytest.mark.parametrize("extinction", EXTINCTIONS)
@pytest.mark.parametrize("albedo", [0.0, 0.3, 0.95, 0.9999, 1.0])
def test_what_is_packed_is_near_and_right_in_the_mean(extinction: float, albedo: float) -> None:
    e = np.float64(extinction) * np.array([1, 0.61, 1])
    total, share, g = packed(e, albedo, 0.37)
    step = np.maximum(e / 8, 2.0**-14)  # between neighbours
    assert (np.abs(total - e) <= step * 1.001).all()
    np.testing.assert_allclose(total.mean(0), e, atol=(4 * step / np.sqrt(4000)).max(), rtol=1e-3)
    lost = np.sqrt(1 - share[(total > 0).all(1)])
    assert (np.abs(lost - np.sqrt(1 - albedo)) <= 1 / 63 + 1e-6).all()
    np.testing.assert_allclose(lost.mean(0), np.sqrt(1 - albedo), atol=1e-3)
    assert abs(g.mean() - 0.37) < 2e-3
    assert np.abs(g - 0.37).max() <= 1 / 31 + 1e-6
    assert (total[:, 0] == total[:, 2]).all()  # equal colours stay equal
    assert (share[:, 0] == share[:, 2]).all()


def test_what_is_packed_exactly() -> None:
    """No medium, none that scatters or absorbs, even scattering; what is beyond all ranges is the greatest."""
    total, _, g = packed(np.zeros(3), 0.5)
    assert (total == 0).all()
    assert (g == 0).all()
    for albedo in (0.0, 1.0):
        assert (packed(np.ones(3), albedo)[1] == albedo).all()
    total, _, g = packed(np.full(3, 1e9), 1.0, 1.0)
    assert (total == 983040).all()
    assert (g == np.float32(0.99)).all()


def even(value: Any) -> Any:
    """A texture of one value."""
    texels = np.full((4, 4, 3), value, np.float32)
    return dl.textures.image(texels, color_space="linear")


SKIN = {"subsurface_weight": 1.0, "subsurface_radius": 0.03, "specular_roughness": 0.3}
MILK = {"transmission_weight": 1.0, "transmission_depth": 0.3, "specular_roughness": 0.2}
MIXTURE = {"transmission_weight": 0.4, "subsurface_weight": 0.7, "transmission_depth": 0.5, "specular_roughness": 0.2}
SUBSURFACE = {"subsurface_color": LEFT, "subsurface_radius_scale": (1.0, 0.4, 0.2)}
CASES: dict[str, tuple[dict[str, Any], dict[str, Any]]] = {
    "radius": (SKIN | SUBSURFACE, {"subsurface_radius": 0.03}),
    "radii": (SKIN | SUBSURFACE, {"subsurface_radius_scale": (1.0, 0.4, 0.2)}),
    "skin": (SKIN, {"subsurface_radius": 0.03, "subsurface_scatter_anisotropy": 0.4, **SUBSURFACE}),
    "scatter": (MILK | {"transmission_color": RIGHT}, {"transmission_scatter": (0.3, 0.5, 0.7)}),
    "depth": (MILK | {"transmission_color": RIGHT, "transmission_scatter": 0.2}, {"transmission_depth": 0.3}),
    "milk": (
        MILK,
        {"transmission_color": RIGHT, "transmission_scatter": (0.3, 0.2, 0.5), "transmission_scatter_anisotropy": 0.5},
    ),
    "mixture": (
        MIXTURE | {"transmission_scatter": 0.2, "subsurface_radius": 0.05},
        {"transmission_color": RIGHT, **SUBSURFACE},
    ),
    "everything": (
        MIXTURE,
        {"transmission_weight": 0.4, "subsurface_weight": 0.7, "transmission_depth": 0.5, "transmission_color": RIGHT}
        | {"transmission_scatter": (0.2, 0.3, 0.1), "transmission_scatter_anisotropy": 0.3, "subsurface_radius": 0.05}
        | {"subsurface_scatter_anisotropy": 0.2, **SUBSURFACE},
    ),
}


def spread(e: Estimate) -> float:
    return float(np.sqrt(e.total[1]))


@pytest.mark.parametrize("case", CASES)
@pytest.mark.parametrize("lamp", [False, True])
def test_constant_texture_is_a_constant(device: str, case: str, lamp: bool) -> None:
    """Within one per cent of all light, and of each colour's; with a lamp inside, too, so that shadow rays count."""
    fixed, textured = CASES[case]
    pictures = []
    for values in (textured, {name: even(value) for name, value in textured.items()}):
        s = looking_down(slab(dl.materials.openpbr(**fixed | values)))
        if lamp:
            s.add(dl.lights.point(position=(0.1, 0.2, -0.2), intensity=0.2))
        pictures.append(estimate(s, device, spp=256, size=(8, 8), seed=3))
    one, other = pictures
    assert_agree(one, other, slack=0.01)
    mean = np.array([p.rgb.mean((0, 1)) for p in pictures])
    noise = z_threshold(3) * np.hypot(spread(one), spread(other)) * 3  # of a colour: three times that of luminance
    assert (np.abs(mean[0] - mean[1]) < 0.01 * mean[0] + noise).all()


@pytest.mark.parametrize("side", [0, 1])
def test_far_from_the_seam_each_half_is_as_if_alone(device: str, side: int) -> None:
    """Skin whose colours and mean free paths both differ; a colour image with alpha for nothing else."""
    radii = (0.04, 0.01)
    options: dict[str, Any] = {"subsurface_weight": 1.0}
    pictures = []
    alone = {"subsurface_color": (LEFT, RIGHT)[side], "subsurface_radius": radii[side]}
    textures = {
        "subsurface_color": halves(),
        "subsurface_radius": dl.textures.scaled(halves(*([r] * 3 for r in radii))),
    }
    for words in (alone, textures):
        material = dl.materials.openpbr(**options, **words)
        s = looking_down(slab(material, half=2.0), x=(-1.0, 1.0)[side], height=0.5)
        pictures.append(estimate(s, device, spp=256, size=(8, 8)))
    assert_agree(*pictures, slack=0.005)
    np.testing.assert_allclose(*(p.rgb.mean((0, 1)) for p in pictures), rtol=0.01)


def test_glass_absorbs_by_depth_and_colour_at_the_entry(device: str) -> None:
    """Beer's law by both: one channel of one image for the depth, another for the colour."""
    depth = dl.textures.scaled(halves((0.1, 0.4, 0), (0.1, 0.8, 0)), channel="g")
    material = dl.materials.openpbr(**CLEAR, transmission_depth=depth, transmission_color=halves())
    got = columns(looking_down(slab(material)), device, spp=4096)
    expected = np.repeat(np.array([np.array(LEFT) ** (1 / 0.4), np.array(RIGHT) ** (1 / 0.8)]), 4, axis=0)
    np.testing.assert_allclose(got, expected, rtol=0.012, atol=2e-4)


def test_vertex_colours_and_solid_textures_make_it_too(device: str) -> None:
    mesh = slab(
        dl.materials.openpbr(
            **CLEAR,
            transmission_depth=dl.textures.scaled(dl.textures.checker(even=(0.5,) * 3, odd=(0.5,) * 3)),
            transmission_color=dl.textures.vertex_color(),
        )
    )
    s = looking_down(mesh.replace(colors=np.tile(np.float32(RIGHT), (8, 1))))
    np.testing.assert_allclose(columns(s, device, 2048), np.tile(np.array(RIGHT) ** 2, (8, 1)), rtol=0.012)


def test_weights_share_out_the_medium_where_paths_enter(device: str) -> None:
    """A mask of clear glass, and of glass half full of something dark: as each of them alone."""
    dark = {"subsurface_weight": 1.0, "subsurface_color": 0.0, "subsurface_radius": 0.5, "subsurface_radius_scale": 1.0}
    found = []
    for weight in (halves((1,) * 3, (0.5,) * 3), 0.5):
        material = dl.materials.openpbr(specular_weight=0.0, transmission_weight=weight, **dark)
        found.append(columns(looking_down(slab(material)), device, spp=2048))
    np.testing.assert_allclose(found[0][:4], 1, rtol=1e-3)
    np.testing.assert_allclose(found[0][4:], found[1][4:], rtol=0.02)
    assert found[1].max() < 0.6


def test_textured_weights_and_metalness_are_as_constant_ones(device: str) -> None:
    """What the boundary holds back, and that there is an inside at all, goes by what the textures are."""
    fixed: dict[str, Any] = {"subsurface_color": 0.5, "subsurface_radius": 0.1, "subsurface_radius_scale": 1.0}
    words: dict[str, Any] = {"transmission_weight": 0.3, "subsurface_weight": 0.7, "base_metalness": 0.1}
    found = []
    for values in (words, {name: even(value) for name, value in words.items()}):
        s = looking_down(slab(dl.materials.openpbr(**fixed | values)))
        found.append(estimate(s, device, spp=2048, size=(8, 8)))
    one, other = (e.total for e in found)
    assert abs(one[0] - other[0]) < 0.002 * one[0] + z_threshold(1) * np.sqrt(one[1] + other[1])
    clear = {**CLEAR, "transmission_color": LEFT, "transmission_depth": 0.5}
    s = looking_down(slab(dl.materials.openpbr(**clear, base_metalness=even(0.0))))
    np.testing.assert_allclose(columns(s, device), np.tile(np.array(LEFT) ** 2, (8, 1)), rtol=2e-4)


def test_shadow_rays_inside_have_the_medium_too(device: str) -> None:
    """A matt floor and a lamp, both in the glass; only light sampling finds the lamp."""
    depth, lamp = 0.8, 0.5
    both_textured = {"transmission_depth": even(depth), "transmission_color": halves()}
    floor = dl.shapes.quad((-0.9, -0.9, -0.9), (1.8, 0, 0), (0, 1.8, 0), material=dl.materials.diffuse(reflectance=0.5))
    s = looking_down(slab(dl.materials.openpbr(**CLEAR, **both_textured)), floor, sky=0.0, height=0.02)
    s.add(dl.lights.point(position=(0, 0, -0.9 + lamp), intensity=1))
    s.render.max_depth = 4
    got = columns(s, device, spp=4096)
    expected = 0.5 / np.pi / lamp**2 * both(LEFT, RIGHT) ** ((0.9 + lamp) / depth)
    np.testing.assert_allclose(got, expected, rtol=0.015)


def test_energy_is_kept(device: str) -> None:
    """White in a furnace, whatever the mean free paths."""
    noise = np.random.default_rng(4).random((16, 16, 3), np.float32)
    radii = dl.textures.image(0.05 + 0.95 * noise, color_space="linear")
    white = {"subsurface_color": even(1.0), "subsurface_radius_scale": radii, "subsurface_radius": 0.3}
    material = dl.materials.openpbr(subsurface_weight=1.0, **white)
    got = estimate(looking_down(slab(material, half=2.0)), device, spp=64, size=(8, 8))
    mean, variance = got.total
    assert abs(mean - 1) < 0.01 + z_threshold(1) * np.sqrt(variance)


def test_who_did_not_come_in_has_the_mean(device: str) -> None:
    """A camera inside: the medium of the means of all textures."""
    depths = halves((0.4,) * 3, (0.8,) * 3)
    material = dl.materials.openpbr(**CLEAR, transmission_depth=depths, transmission_color=halves())
    mean = (np.array(LEFT) + np.array(RIGHT)) / 2
    s = looking_down(slab(material), z=-0.4)
    np.testing.assert_allclose(columns(s, device), np.tile(mean ** (0.6 / 0.6), (8, 1)), rtol=2e-4)


def test_means_are_those_of_all_tiles(device: str, tmp_path: Path) -> None:
    """A tile that is missing does not count; images of other resolutions, and moved ones, do."""
    for number, texels in ((1001, np.full((2, 2, 3), 0.9)), (1003, np.full((4, 4, 3), 0.5)), (1011, [[[0.1] * 3]])):
        write_image(tmp_path / f"t.{number}.exr", np.asarray(texels, np.float32))
    for options in ({}, {"uv_scale": (3.0, 2.0), "uv_offset": (0.5, 0.25)}):
        tiles = dl.textures.image("t.<UDIM>.exr", color_space="linear", filter="nearest", **options)
        material = dl.materials.openpbr(**CLEAR, transmission_depth=0.6, transmission_color=tiles)
        s = looking_down(slab(material), z=-0.4)
        s.base_dir = tmp_path
        np.testing.assert_allclose(columns(s, device), 0.5, rtol=2e-4)
