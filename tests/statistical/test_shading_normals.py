"""Shading normals lose no light: bent horizons, bumpy furnaces, coarse meshes, bump and tangent maps."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import destello as dl
import stats
from destello import _core
from transport import assert_agree, assert_constant, assert_known, bumps, down_on, estimate, furnace

WHITE = {
    "diffuse": lambda **s: dl.materials.diffuse(reflectance=1, **s),
    "mirror": lambda **s: dl.materials.conductor(reflectance=1, fresnel="none", roughness=0, **s),
    "glass": lambda **s: dl.materials.dielectric(ior=1.5, **s),
}


def directions(rng: np.random.Generator, n: int) -> Any:
    w = rng.normal(size=(n, 3))
    return (w / np.linalg.norm(w, axis=1, keepdims=True)).astype(np.float32)


def normals(tilt: float, rng: np.random.Generator) -> Any:
    """The surface's normal, and one that leans `tilt` degrees away from it."""
    n, other = directions(rng, 2).astype(np.float64)
    t = other - n * (n @ other)
    angle = np.radians(tilt)
    return np.stack([n, np.cos(angle) * n + np.sin(angle) * t / np.linalg.norm(t)]).astype(np.float32)


@pytest.mark.parametrize("tilt", [0.05, 3, 25, 59, 61, 80])
def test_bending_fills_the_sky_over_the_surface_once(tilt: float, rng: np.random.Generator) -> None:
    pair = normals(tilt, rng)
    w = directions(rng, 20000)
    above = w[w @ pair[1] > 1e-3]
    bent = _core.testing.bend(pair, above)
    assert (bent[:, :3] @ pair[0]).min() > -1e-6
    np.testing.assert_allclose(np.linalg.norm(bent[:, :3], axis=1), 1, atol=2e-6)
    back = _core.testing.bend(pair, np.ascontiguousarray(bent[:, :3]), back=True)
    np.testing.assert_allclose(back[:, :3], above, atol=3e-3 if tilt > 75 else 3e-4)
    np.testing.assert_allclose(back[:, 3], bent[:, 3], rtol=2e-2)
    far = above @ pair[1] > np.sin(np.radians(min(2.5 * tilt, 90))) + 1e-3
    np.testing.assert_array_equal(bent[far, :3], above[far])  # most directions stay what they are


@pytest.mark.parametrize("tilt", [3, 25, 70])
def test_bent_directions_have_the_density_they_tell(tilt: float) -> None:
    """Directions drawn by the cosine about the shading normal, then bent; the surface's normal is z."""
    angle = np.radians(tilt)
    pair = np.array([(0, 0, 1), (np.sin(angle) * 0.6, np.sin(angle) * 0.8, np.cos(angle))], np.float32)
    x = np.cross(pair[1], (0, 0, 1))
    x /= np.linalg.norm(x)

    def draw(u: Any) -> Any:
        r, phi = np.sqrt(u[:, 0]), 2 * np.pi * u[:, 1]
        y = np.cross(pair[1], x)
        w = np.outer(r * np.cos(phi), x) + np.outer(r * np.sin(phi), y) + np.outer(np.sqrt(1 - u[:, 0]), pair[1])
        return _core.testing.bend(pair, w.astype(np.float32))[:, :3]

    def density(w: Any) -> Any:
        back = _core.testing.bend(pair, np.ascontiguousarray(w, np.float32), back=True)
        return np.where(w[:, 2] > 0, np.maximum(back[:, :3] @ pair[1], 0) * back[:, 3] / np.pi, 0)

    stats.chi2_directions(draw, density, seed=5).check()


@pytest.mark.parametrize("steep", [0.5, 3])
@pytest.mark.parametrize("kind", WHITE)
def test_a_bumpy_white_sphere_vanishes_in_a_white_furnace(
    kind: str, steep: float, rng: np.random.Generator, device: str
) -> None:
    """No pixel is darker than its surroundings, the rim included: what a path loses, it would lose here."""
    material = WHITE[kind](normal_map=bumps(rng, steep))
    scene = furnace(dl.shapes.sphere(center=(0, 0, 0), radius=1, material=material))
    got = estimate(scene, device, spp=16, size=(40, 40), sampling="bsdf", max_depth=1000, rr_depth=1000)
    assert_constant(got, 1.0, rtol=1e-4)


@pytest.mark.parametrize("kind", ["diffuse", "rough metal"])
def test_a_bumpy_furnace_is_white_to_light_sampling_too(kind: str, rng: np.random.Generator, device: str) -> None:
    map_ = bumps(rng, 2)
    material = (
        dl.materials.diffuse(reflectance=1, normal_map=map_)
        if kind == "diffuse"
        else dl.materials.conductor(reflectance=1, fresnel="none", roughness=0.5, normal_map=map_)
    )
    scene = furnace(dl.shapes.sphere(center=(0, 0, 0), radius=1, material=material))
    by_paths, by_both = (
        estimate(scene, device, spp=256, size=(16, 16), sampling=s, max_depth=100) for s in ("bsdf", "mis")
    )
    assert_agree(by_paths, by_both, comparisons=2)
    if kind == "diffuse":
        assert_known(by_both, 1.0, comparisons=2)


@pytest.mark.parametrize(
    "look",
    [
        {"base_color": 1.0, "specular_roughness": 0.2},
        {"base_color": 1.0, "base_metalness": 1.0, "specular_roughness": 0.6},
        {"base_color": 1.0, "coat_weight": 1.0, "coat_roughness": 0.3, "fuzz_weight": 0.5},
        {"transmission_weight": 1.0, "specular_roughness": 0.3},
    ],
    ids=["glossy", "metal", "coat and fuzz", "frosted"],
)
def test_a_bumpy_openpbr_sphere_vanishes_too(look: dict[str, Any], rng: np.random.Generator, device: str) -> None:
    """Within what its tables leave of all light, the rim included."""
    material = dl.materials.openpbr(**look, normal_map=bumps(rng, 1))
    scene = furnace(dl.shapes.sphere(center=(0, 0, 0), radius=1, material=material))
    got = estimate(scene, device, spp=256, size=(24, 24), sampling="bsdf", max_depth=1000, rr_depth=1000)
    assert_known(got, 1.0, slack=0.03)


def globe(rings: int, inside_out: bool = False) -> Any:
    """A coarse sphere with the smooth one's normals."""
    v, u = np.linspace(0, np.pi, rings + 1), np.linspace(0, 2 * np.pi, 2 * rings + 1)
    vv, uu = np.meshgrid(v, u, indexing="ij")
    p = np.stack([np.sin(vv) * np.cos(uu), np.cos(vv), -np.sin(vv) * np.sin(uu)], -1).reshape(-1, 3)
    i = (np.arange(rings)[:, None] * (2 * rings + 1) + np.arange(2 * rings)).ravel()
    w = 2 * rings + 1
    t = np.concatenate([np.stack([i, i + w, i + 1], 1), np.stack([i + 1, i + w, i + w + 1], 1)])
    if inside_out:
        t = t[:, ::-1]
    return p.astype(np.float32), t.astype(np.uint32), (-p if inside_out else p).astype(np.float32)


@pytest.mark.parametrize("kind", ["diffuse", "mirror"])
@pytest.mark.parametrize("inside_out", [False, True])
def test_a_coarse_white_mesh_with_smooth_normals_vanishes_too(kind: str, inside_out: bool, device: str) -> None:
    p, t, n = globe(6, inside_out)
    scene = furnace(dl.shapes.mesh(p, t, normals=n, material=WHITE[kind]()))
    got = estimate(scene, device, spp=16, size=(40, 40), sampling="bsdf", max_depth=1000, rr_depth=1000)
    assert_constant(got, 1.0, rtol=1e-4)


def lit_globe(shape: Any) -> dl.Scene:
    scene = dl.Scene("terminator")
    scene.add(shape, dl.lights.directional(direction=(-1, -0.3, 0.2), irradiance=np.pi))
    scene.camera = dl.cameras.orthographic(origin=(0, 0, 5), target=(0, 0, 0), up=(0, 1, 0), height=2.4)
    return scene


def test_the_terminator_of_a_coarse_sphere_is_the_round_ones(device: str) -> None:
    """Facets turned from the light would be black, and those before them end in a step: three times the error."""
    white = dl.materials.diffuse(reflectance=1)
    p, t, n = globe(8)
    size = (96, 96)
    pictures = [
        estimate(lit_globe(shape), device, spp=16, size=size, max_depth=2).rgb[..., 0]
        for shape in (
            dl.shapes.mesh(p, t, normals=n, material=white),
            dl.shapes.sphere(center=(0, 0, 0), radius=1, material=white),
        )
    ]
    y, x = (np.indices(size) + 0.5) / 96 * 2.4 - 1.2
    inside = x**2 + y**2 < 0.85**2
    error = np.abs(pictures[0] - pictures[1])[inside]
    assert error.max() < 0.12  # a facet that is cut off shows up to 0.3
    assert error.mean() < 0.015


def test_bump_maps_tilt_the_normal_by_the_slope(device: str) -> None:
    """A ramp of 1 in 2 along u on a floor, lit from above: the cosine of the slope."""
    ramp = np.tile(np.linspace(0, 1, 64, dtype=np.float32)[None, :, None], (4, 1, 1))
    texture = dl.textures.image(ramp, color_space="linear", wrap_u="clamp", wrap_v="clamp")
    for along, light in (((4, 0, 0), 1.0), ((0, 0, 4), 1.0)):
        across = (0, 0, -4) if along[0] else (4, 0, 0)
        height = dl.textures.scaled(texture, scale=2.0 * 63 / 64)  # 2 m over 4 m
        material = dl.materials.diffuse(reflectance=1, bump=height)
        corner = -0.5 * (np.array(along) + np.array(across))
        scene = dl.Scene("ramp")
        scene.camera = down_on(0.5)
        scene.add(dl.shapes.quad(corner, along, across, material=material))
        scene.add(dl.lights.directional(direction=(0, -1, 0), irradiance=np.pi * light))
        got = estimate(scene, device, spp=4, size=(8, 8), max_depth=2)
        np.testing.assert_allclose(got.rgb, 1 / np.sqrt(1.25), rtol=2e-3)
        low = dl.Scene("ramp")
        low.camera = down_on(0.5)
        low.add(dl.shapes.quad(corner, along, across, material=material))
        uphill, up = np.array(along) / 4, np.array((0.0, 1.0, 0.0))
        low.add(dl.lights.directional(direction=-uphill - up, irradiance=np.pi))
        # The surface rises along u and faces away from who comes from there.
        got = estimate(low, device, spp=4, size=(8, 8), max_depth=2)
        normal = (up - 0.5 * uphill) / np.sqrt(1.25)
        np.testing.assert_allclose(got.rgb, normal @ (uphill + up) / np.sqrt(2), rtol=2e-3)


def test_bump_maps_of_procedural_textures(device: str) -> None:
    """Noise by position, on a sphere: the picture is that of the displaced normal, never black, never too bright."""
    noise = dl.textures.scaled(dl.textures.noise(scale=4), scale=0.1)
    shape = dl.shapes.sphere(center=(0, 0, 0), radius=1, material=dl.materials.diffuse(reflectance=1, bump=noise))
    flat = dl.shapes.sphere(center=(0, 0, 0), radius=1, material=dl.materials.diffuse(reflectance=1))
    a, b = (estimate(lit_globe(s), device, spp=64, size=(32, 32), max_depth=2).mean for s in (shape, flat))
    assert 0.02 < np.abs(a - b)[b > 0.3].mean() < 0.4
    assert_constant(estimate(furnace(shape), device, spp=4, size=(16, 16), sampling="bsdf"), 1.0, rtol=1e-4)


def test_tangents_turn(device: str) -> None:
    """A brushed metal turned by 90 degrees, by a number or by a map, is one brushed the other way."""

    def picture(**params: Any) -> Any:
        metal = dl.materials.conductor(reflectance=1, fresnel="none", roughness=0.5, **params)
        scene = dl.Scene("brushed")
        scene.camera = down_on(1.0)
        scene.add(dl.shapes.quad((-2, 0, 2), (4, 0, 0), (0, 0, -4), material=metal))
        scene.add(dl.lights.point(position=(0.8, 0.7, 0.3), intensity=1))
        return estimate(scene, device, spp=4, size=(16, 16), max_depth=2).mean

    other, straight = picture(anisotropy=-0.8), picture(anisotropy=0.8)
    up = dl.textures.image(np.tile(np.float32((0.5, 1, 0)), (2, 2, 1)), color_space="linear")
    assert np.abs(other / straight - 1).mean() > 0.2
    for turned in (
        picture(anisotropy=0.8, tangent_rotation=90),
        picture(anisotropy=0.8, tangent_map=up),
        picture(anisotropy=0.8, tangent_map=up, tangent_rotation=180),
        picture(anisotropy=0.8, tangent_map=(0.5, 0, 0)),
    ):
        np.testing.assert_allclose(turned, other, rtol=2e-3)
    # Against a twin that turns the mesh: 30 degrees one way round.
    c, s = np.cos(np.radians(30)), np.sin(np.radians(30))
    corners = np.array([(-2, 0, 2), (2, 0, 2), (2, 0, -2), (-2, 0, -2)], np.float32)
    uv = np.stack([corners[:, 0], -corners[:, 2]], 1) @ np.array([[c, s], [-s, c]]).T  # u grows along (c, s)

    def mesh(**arrays: Any) -> Any:
        metal = dl.materials.conductor(reflectance=1, fresnel="none", roughness=0.5, anisotropy=0.8)
        scene = dl.Scene("brushed")
        scene.camera = down_on(1.0)
        scene.add(dl.shapes.mesh(corners, [(0, 1, 2), (0, 2, 3)], material=metal, **arrays))
        scene.add(dl.lights.point(position=(0.8, 0.7, 0.3), intensity=1))
        return estimate(scene, device, spp=4, size=(16, 16), max_depth=2).mean

    want = picture(anisotropy=0.8, tangent_rotation=30)
    np.testing.assert_allclose(mesh(uvs=uv.astype(np.float32)), want, rtol=2e-3)
    tangents = np.tile(np.float32((c, 0, -s, 1)), (4, 1))
    np.testing.assert_allclose(mesh(tangents=tangents), want, rtol=2e-3)


@pytest.mark.parametrize("mirrored", [False, True])
@pytest.mark.parametrize("handedness", [1, -1])
def test_vertex_tangents_carry_normal_maps(handedness: int, mirrored: bool, device: str) -> None:
    """A normal that leans along +v leans along handedness * normal x tangent, in a mirror too."""
    corners = np.array([(-1, 0, 1), (1, 0, 1), (1, 0, -1), (-1, 0, -1)], np.float32)
    lean = np.array((0.0, 0.6, 0.8))
    texture = dl.textures.image(np.tile(((lean + 1) / 2).astype(np.float32), (2, 2, 1)), color_space="linear")
    material = dl.materials.diffuse(reflectance=1, normal_map=texture)
    tangents = np.tile(np.float32((1, 0, 0, handedness)), (4, 1))
    mirror = dl.scale((1, 1, -1)) if mirrored else None
    scene = dl.Scene("tangents")
    scene.camera = down_on(0.5)
    scene.add(
        dl.shapes.mesh(
            corners, [(0, 1, 2), (0, 2, 3)], tangents=tangents, normals=np.tile(np.float32((0, 1, 0)), (4, 1)),
            uvs=np.zeros((4, 2), np.float32), material=material, transform=mirror,
        )
    )  # fmt: skip
    up = np.array((0, 0, -1.0)) * handedness * (-1 if mirrored else 1)  # normal x tangent = y x x = -z
    angle = np.radians(20)
    to_light = np.sin(angle) * up + (0, np.cos(angle), 0)
    scene.add(dl.lights.directional(direction=-to_light, irradiance=np.pi))
    got = estimate(scene, device, spp=1, size=(4, 4), max_depth=2)
    np.testing.assert_allclose(got.rgb, 0.6 * np.sin(angle) + 0.8 * np.cos(angle), rtol=2e-3)


TINTS = [((0.9, 0.5, 0.2), 0.3), ((0.2, 0.8, 0.9), 0.0), ((1, 1, 0.4), 0.75)]


@pytest.mark.parametrize("sampling", ["mis", "light", "bsdf"])
def test_tinted_veils_over_a_lit_floor(sampling: str, device: str) -> None:
    """Three black veils between a lamp and a floor, and none before the camera: products of (1 - opacity) tint."""
    scene = dl.Scene("veils")
    left = np.ones(3)
    for i, (tint, opacity) in enumerate(TINTS):
        veil = dl.materials.diffuse(reflectance=0, opacity=opacity, opacity_tint=tint)
        scene.add(dl.shapes.quad((-50, i + 1, 50), (100, 0, 0), (0, 0, -100), material=veil))
        left *= np.array(tint) * (1 - opacity)
    if sampling == "bsdf":
        scene.environment = dl.environments.constant(radiance=1)
    else:
        scene.add(dl.lights.directional(direction=(0, -1, 0), irradiance=np.pi))
    scene.add(dl.shapes.quad((-50, 0, 50), (100, 0, 0), (0, 0, -100), material=dl.materials.diffuse(reflectance=1)))
    scene.camera = dl.cameras.perspective(origin=(0, 0.5, 0), target=(0, 0, 0), up=(0, 0, -1), vfov=5)
    got = estimate(scene, device, spp=512, size=(8, 8), sampling=sampling, max_depth=2, rr_depth=100)
    mean = got.rgb.mean(axis=(0, 1))
    if sampling == "bsdf":
        luminance = float(dl.color.luminance(np.float32(left)[None])[0])
        assert_known(got, luminance)
    else:
        np.testing.assert_allclose(mean, left, rtol=1e-4)


def test_tinted_veils_before_the_sky(device: str) -> None:
    scene = dl.Scene("veils")
    scene.environment = dl.environments.constant(radiance=1)
    tint = np.ones(3)
    for i, (color, _) in enumerate(TINTS):
        veil = dl.materials.diffuse(reflectance=0, opacity=0.0, opacity_tint=color)
        scene.add(dl.shapes.quad((-50, -i - 1, 50), (100, 0, 0), (0, 0, -100), material=veil))
        tint *= color
    scene.camera = down_on(1.0)
    got = estimate(scene, device, spp=4, size=(4, 4))
    np.testing.assert_allclose(got.rgb, np.broadcast_to(tint, got.rgb.shape), rtol=1e-5)
