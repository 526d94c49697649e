"""OpenPBR's coat has normals of its own: lobes that turn with them, mirrors that move, furnaces that stay white."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import destello as dl
from bsdf_cases import Case, direction
from transport import assert_agree, assert_known, bumps, estimate, furnace

COAT = {"coat_weight": 1.0, "coat_ior": 1.7}
BLACK = {"base_color": 0.0, "specular_weight": 0.0}


def texel(normal: Any) -> tuple[float, ...]:
    """A normal as a normal map stores it."""
    return tuple(float(x) for x in (np.asarray(normal) + 1) / 2)


def lean(degrees: float, turns: float) -> Any:
    return np.asarray(direction(np.cos(np.radians(degrees)), turns), np.float64)


def local(normal: Any, w: Any) -> Any:
    """Directions in a frame about the normal, whose x axis follows x."""
    x = np.array((1.0, 0, 0)) - normal * normal[0]
    x /= np.linalg.norm(x)
    return w @ np.stack([x, np.cross(normal, x), normal]).T


def around(rng: np.random.Generator, degrees: float, n: int = 400) -> Any:
    """Directions within that angle of z."""
    return np.stack([lean(d, t) for d, t in zip(rng.uniform(0, degrees, n), rng.random(n), strict=True)])


@pytest.mark.parametrize("turns", [0.0, 0.3, 0.6])
def test_a_tilted_coat_is_the_level_one_turned(turns: float, rng: np.random.Generator) -> None:
    """Away from the horizons, where nothing is bent; anisotropic, so that the tangents count."""
    rough = COAT | BLACK | {"coat_roughness": 0.5, "coat_roughness_anisotropy": 0.6}
    normal = lean(20, turns)
    level, tilted = Case("openpbr", rough), Case("openpbr", {**rough, "geometry_coat_normal": texel(normal)})
    wo, wi = lean(30, 0.9), around(rng, 55)
    expected = level.eval(local(normal, wo), local(normal, wi))
    np.testing.assert_allclose(tilted.eval(wo, wi), expected, rtol=2e-3, atol=1e-6)
    assert np.abs(level.eval(wo, wi) / expected - 1).max() > 0.5  # a coat that stays would be seen


def test_layers_that_lean_alike_are_one_surface_turned(rng: np.random.Generator) -> None:
    params = COAT | {"coat_roughness": 0.4, "coat_color": (0.8, 0.5, 0.3), "fuzz_weight": 0.3, "base_metalness": 0.3}
    normal = lean(20, 0.2)
    turned = Case("openpbr", params, tilt=(20, 0.2, 20, 0.2))
    wo, wi = lean(30, 0.9), around(rng, 55)
    expected = Case("openpbr", params).eval(local(normal, wo), local(normal, wi))
    np.testing.assert_allclose(turned.eval(wo, wi), expected, rtol=2e-3, atol=1e-6)


def floor(material: Any, turned: Any = None, mirrored: bool = False) -> Any:
    """A square, u along x, v along -z (mirrored: along z), turned about its middle."""
    p = np.array([(-3, 0, 3), (3, 0, 3), (3, 0, -3), (-3, 0, -3)], np.float32)
    uv = np.array([(0, 0), (1, 0), (1, 1), (0, 1)], np.float32)
    if mirrored:
        uv[:, 1] = 1 - uv[:, 1]
    return dl.shapes.mesh(p, [(0, 1, 2), (0, 2, 3)], uvs=uv, material=material, transform=turned)


def mirror_image(shape: Any, side: float, device: str) -> Any:
    """What a camera straight above (side 1) or below (-1) sees in it of a sky without symmetry."""
    sky = np.linspace(0.1, 1, 16 * 32, dtype=np.float32).reshape(16, 32)[..., None] ** [1.0, 2.0, 3.0]
    scene = dl.Scene("mirror")
    scene.environment = dl.environments.image(sky.astype(np.float32))
    scene.camera = dl.cameras.orthographic(origin=(0, 5 * side, 0), target=(0, 0, 0), up=(0, 0, -1), height=0.2)
    scene.add(shape)
    return estimate(scene, device, spp=256, size=(4, 4), sampling="bsdf", max_depth=2).rgb


@pytest.mark.parametrize("mirrored", [False, True])
@pytest.mark.parametrize("side", [1, -1])
@pytest.mark.parametrize("axis", ["u", "v"])
def test_the_mirror_image_moves_with_the_coats_normals_alone(
    axis: str, side: float, mirrored: bool, device: str
) -> None:
    """By a constant map, by a texture with half the lean and twice the scale: as if the whole floor were turned."""
    smooth = COAT | BLACK
    across = 0.3
    map_ = texel(np.array((across, 0, 1) if axis == "u" else (0, across, 1)) / np.hypot(1, across))
    # The normal leans towards growing u, x, or growing v, -z (mirrored: z).
    turn = ((0, 0, 1), -1.0) if axis == "u" else ((1, 0, 0), 1.0 if mirrored else -1.0)
    turned = dl.rotate(turn[0], turn[1] * np.degrees(np.arctan(across)))
    want = mirror_image(floor(dl.materials.openpbr(**smooth), turned), side, device)
    flat = mirror_image(floor(dl.materials.openpbr(**smooth), mirrored=mirrored), side, device)
    assert np.abs(want / flat - 1).max() > 0.1

    def image(**params: Any) -> Any:
        return mirror_image(floor(dl.materials.openpbr(**smooth, **params), mirrored=mirrored), side, device)

    np.testing.assert_allclose(image(geometry_coat_normal=map_), want, rtol=2e-3)
    half = np.array((across, 0, 2) if axis == "u" else (0, across, 2))
    picture = np.tile(np.float32(texel(half / np.linalg.norm(half))), (2, 2, 1))
    texture = dl.textures.image(picture, color_space="linear")
    np.testing.assert_allclose(image(geometry_coat_normal=texture, geometry_coat_normal_scale=2.0), want, rtol=2e-3)
    np.testing.assert_allclose(image(normal_map=texture, normal_scale=2.0), flat, rtol=2e-3)


LOOKS = {
    "rippled base": lambda rng: {"normal_map": bumps(rng, 1.5)},
    "rippled coat": lambda rng: {"geometry_coat_normal": bumps(rng, 1.5)},
    "both": lambda rng: {"geometry_coat_normal": bumps(rng, 1.5), "normal_map": bumps(rng, 1.5)},
}


@pytest.mark.parametrize("look", LOOKS)
def test_a_white_sphere_with_two_normals_vanishes_in_a_white_furnace(
    look: str, rng: np.random.Generator, device: str
) -> None:
    """A smooth coat over smooth metal needs no tables: no pixel is darker than the sky, the rim included."""
    metal = COAT | {"base_metalness": 1.0, "base_color": 1.0, "specular_roughness": 0.0}
    material = dl.materials.openpbr(**metal, **LOOKS[look](rng))
    scene = furnace(dl.shapes.sphere(center=(0, 0, 0), radius=1, material=material))
    got = estimate(scene, device, spp=64, size=(40, 40), sampling="bsdf", max_depth=1000, rr_depth=1000)
    assert_known(got, 1.0, comparisons=len(LOOKS), slack=1e-4)
    assert np.abs(got.mean - 1).max() < 0.05


def test_light_sampling_and_paths_agree_on_two_normals(rng: np.random.Generator, device: str) -> None:
    """On glass too, where light passes below both horizons."""
    for base in ({"base_color": 1.0}, {"transmission_weight": 1.0, "specular_roughness": 0.4}):
        material = dl.materials.openpbr(
            **COAT, **base, coat_roughness=0.5, normal_map=bumps(rng, 1), geometry_coat_normal=bumps(rng, 1)
        )
        scene = furnace(dl.shapes.sphere(center=(0, 0, 0), radius=1, material=material))
        by_paths, by_both = (
            estimate(scene, device, spp=256, size=(16, 16), sampling=s, max_depth=100) for s in ("bsdf", "mis")
        )
        assert_agree(by_paths, by_both, comparisons=4)
        assert abs(by_both.total[0] - 1) < 0.01
