"""The mistakes of the program that destello comes from, one by one: none of them here."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

import destello as dl
import stats
import tracing
from destello import _core
from transport import assert_agree, assert_constant, assert_known, estimate, floor

ROOT = Path(__file__).resolve().parents[2]


# --- directions from one octant only ----------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["sphere", "cosine_hemisphere"])
def test_directions_fill_every_octant_evenly(name, rng):
    u = rng.random((8000, 2)).astype(np.float32)
    octant = (np.asarray(_core.testing.warp(name, u)) > 0) @ np.array([1, 2, 4])
    counts = np.bincount(octant, minlength=8)
    expected = np.full(8, 1000.0) if name == "sphere" else np.repeat([0.0, 2000.0], 4)
    stats.chi2_counts(counts[expected > 0], expected[expected > 0]).check(comparisons=2)
    assert not counts[expected == 0].any()


@pytest.mark.parametrize("sign", [1, -1])
@pytest.mark.parametrize("axis", [0, 1, 2])
@pytest.mark.parametrize("kind", ["diffuse", "fuzzy_metal"])
def test_scattering_is_symmetric_about_the_normal(kind, axis, sign, device):
    """A surface that faces along any axis, seen head-on, reflects as much of a sky's left half as of its right half."""
    normal = np.zeros(3)
    normal[axis] = sign
    side, up = np.roll(normal, 1), np.roll(normal, 2)
    material = dl.materials.diffuse(reflectance=0.8) if kind == "diffuse" else dl.materials.fuzzy_metal(fuzz=0.9)
    halves = []
    for i, flip in enumerate((1, -1)):
        scene = dl.Scene("half sky")
        # Bright on the side that `side` points to: the gradient's +y turned there.
        turn = dl.matrix(_turn_y_to(flip * side))
        scene.environment = dl.environments.gradient(bottom=0, top=1, transform=turn)
        u, v = 20 * np.roll(normal, 1), 20 * np.roll(normal, 2)
        if np.dot(np.cross(u, v), normal) < 0:
            u, v = v, u
        scene.add(dl.shapes.quad(-(u + v) / 2, u, v, material=material))
        scene.camera = dl.cameras.orthographic(origin=5 * normal, target=(0, 0, 0), up=up, height=0.1)
        halves.append(estimate(scene, device, spp=512, size=(6, 6), seed=i))
    assert_agree(*halves, comparisons=12)
    if kind == "diffuse":  # the mean of (1 + y) / 2 across the axis is one half
        assert_known(halves[0], 0.4, comparisons=12)


def _turn_y_to(direction):
    """A rotation matrix (4, 4) that takes +y to a direction along some axis."""
    matrix = np.eye(4)
    y = np.asarray(direction, float)
    z = np.roll(y, 1)
    matrix[:3, 1], matrix[:3, 2], matrix[:3, 0] = y, z, np.cross(y, z)
    return matrix


# --- a light that is hit returns its emission without the path's attenuation ------------------------------------------


@pytest.mark.parametrize("bounces", [1, 2, 3])
def test_emission_arrives_attenuated(bounces, device):
    """Between two mirrors that face each other at a distance, coloured mirrors take their share at every bounce."""
    tint = np.array([0.9, 0.5, 0.2])
    scene = dl.Scene("mirrors")
    mirror = dl.materials.conductor(reflectance=tint, fresnel="none")
    # A zigzag at 45 degrees between z = 0 and z = 2; behind the last bounce is the lamp.
    scene.add(dl.shapes.quad((-50, -50, 2), (0, 100, 0), (50 + 2 * bounces - 1, 0, 0), material=mirror))
    scene.add(dl.shapes.quad((-50, -50, 0), (50 + 2 * bounces - 1, 0, 0), (0, 100, 0), material=mirror))
    lamp = dl.materials.emissive(radiance=4, two_sided=True)
    scene.add(dl.shapes.quad((2 * bounces - 0.5, -50, -50), (0, 100, 0), (0, 0, 100), material=lamp))
    scene.camera = dl.cameras.orthographic(origin=(-1, 0, 1), target=(0, 0, 0), height=0.1)
    assert_constant(estimate(scene, device, spp=4), 4 * tint**bounces)


# --- the BVH is never used --------------------------------------------------------------------------------------------


def test_rays_visit_few_of_many_spheres(rng):
    """Eight times as many spheres cost a ray only a little more, far from eight times."""
    looked_at = {}
    for n in (1000, 8000):
        g = tracing.Geometry().spheres(rng.uniform(-1, 1, (n, 3)), np.full(n, 0.3 * n ** (-1 / 3)))
        scene = g.build()
        origins = np.tile((0.0, 0.0, 3.0), (500, 1))
        directions = tracing.unit(rng.uniform(-1, 1, (500, 3)) - origins)
        seen = tracing.visits(scene, origins, directions)
        looked_at[n] = float(np.mean(seen["nodes"]) + np.mean(seen["primitives"]))
    assert looked_at[8000] < 0.01 * 8000
    assert looked_at[8000] < 3 * looked_at[1000]
    assert scene.stats()["bvh_depth"] >= 4


# --- the Gaussian offset within the pixel is commented out ------------------------------------------------------------


def test_pixels_are_blurred_by_a_gaussian_by_default(device):
    """An edge through the middle of a pixel column: the columns beside it see it as the normal distribution says."""
    from scipy.stats import norm

    scene = dl.Scene("edge")
    lamp = dl.materials.emissive(radiance=1)
    scene.add(dl.shapes.quad((0, -50, 0), (50, 0, 0), (0, 100, 0), material=lamp))
    scene.camera = dl.cameras.orthographic(origin=(0, 0, 5), target=(0, 0, 0), height=5)
    image = dl.render(scene, spp=4096, size=(5, 5), device=device, progress=False)
    columns = image.array[..., 0].mean(0)
    known = norm.cdf(np.arange(-2, 3) / 0.3)
    np.testing.assert_allclose(columns, known, atol=4 / np.sqrt(5 * 4096))
    assert 0.0002 < columns[1] < 0.001  # one in 2300 samples is as far out as that


# --- image texels without linearisation, nearest only -----------------------------------------------------------------


def textured_sheet(texture, device):
    scene = dl.Scene("sheet")
    scene.add(dl.shapes.quad((-1, -1, 0), (2, 0, 0), (0, 2, 0), material=dl.materials.emissive(radiance=texture)))
    scene.camera = dl.cameras.orthographic(origin=(0, 0, 5), target=(0, 0, 0), height=2)
    return dl.render(
        scene, spp=1, size=(8, 8), filter=dl.filters.gaussian(sigma=0), device=device, progress=False
    ).array


def test_texels_of_eight_bits_are_linearised(device):
    got = textured_sheet(dl.textures.image(np.full((2, 2, 3), 128, np.uint8)), device)
    np.testing.assert_allclose(got, ((128 / 255 + 0.055) / 1.055) ** 2.4, rtol=1e-5)


def test_texels_are_blended(device):
    """Two texels: black and white, blended between their centres, which are a quarter from the edges."""
    two = np.array([[[0, 0, 0], [1, 1, 1]]], np.float32)
    u = (np.arange(8) + 0.5) / 8
    smooth = textured_sheet(dl.textures.image(two, wrap_u="clamp"), device)
    np.testing.assert_allclose(smooth[..., 0], np.tile(np.clip(2 * u - 0.5, 0, 1), (8, 1)), atol=1e-5)
    nearest = textured_sheet(dl.textures.image(two, filter="nearest"), device)
    np.testing.assert_array_equal(nearest[..., 0], np.tile(u > 0.5, (8, 1)))


# --- no clamp before quantisation -------------------------------------------------------------------------------------


def test_values_beyond_white_do_not_wrap_around(tmp_path):
    values = np.array([[-1.0, 0.0, 1.0, 1.004, 2.0, 300.0, np.inf]], np.float32)
    image = dl.Image(np.repeat(values[..., None], 3, -1))
    eight = image.to_uint8(tone="none")[0, :, 0]
    assert eight.tolist() == [0, 0, 255, 255, 255, 255, 255]
    for name in ("a.png", "a.ppm"):
        image.save(tmp_path / name)
        back = dl.Image.load(tmp_path / name).array[0, :, 0]
        np.testing.assert_allclose(back, np.clip(values[0], 0, 1))


# --- the moving sphere leaves (u, v) unset ----------------------------------------------------------------------------


@pytest.mark.parametrize("time", [0.0, 0.5, 1.0])
def test_a_moving_sphere_carries_its_texture(time, device):
    """At every time the picture is that of a sphere that stands there."""
    pixels = np.random.default_rng(2).uniform(0, 1, (6, 12, 3)).astype(np.float32)
    material = dl.materials.emissive(radiance=dl.textures.image(pixels))
    start, end = np.array([-0.5, 0.2, 0.0]), np.array([0.7, -0.4, 0.3])
    pictures = []
    for moving in (True, False):
        scene = dl.Scene("globe")
        where = start if moving else start + time * (end - start)
        scene.add(dl.shapes.sphere(where, 0.8, material=material, center1=end if moving else None))
        scene.camera = dl.cameras.perspective(origin=(0, 0, 4), target=(0, 0, 0), vfov=40)
        pictures.append(estimate(scene, device, spp=4, shutter=(time, time)).rgb)
    assert np.std(pictures[0]) > 0.05
    close = np.isclose(pictures[0], pictures[1], atol=1e-4).all(-1)
    assert close.mean() > 0.97  # the outline's pixels may differ by rounding


# --- the list's bounding box reads element 0 for every element --------------------------------------------------------


def test_bounds_hold_every_element():
    scene = dl.Scene("row")
    rng = np.random.default_rng(6)
    centers, radii = rng.uniform(-5, 5, (20, 3)), rng.uniform(0.1, 0.5, 20)
    scene.add(dl.shapes.spheres(centers, radii))
    scene.add(dl.shapes.sphere((0, 0, 0), 0.2, center1=(0, 9, 0)))
    low = np.minimum((centers - radii[:, None]).min(0), -0.2)
    high = np.maximum((centers + radii[:, None]).max(0), (0.2, 9.2, 0.2))
    got = scene.compile().stats["bounds"]
    np.testing.assert_allclose(got, (low, high), atol=1e-5)
    np.testing.assert_allclose(scene.bounds(), (low, high), atol=1e-5)


def test_every_element_of_a_list_is_hit():
    centers = np.array([(3.0 * i, 0, 0) for i in range(40)])
    scene = tracing.Geometry().spheres(centers, np.full(40, 0.5)).build()
    hits = tracing.trace(scene, centers + np.array([0, 0, 5]), (0, 0, -1))
    assert sorted(hits.primitive.tolist()) == list(range(40))


# --- double-precision constants in float code -------------------------------------------------------------------------


def test_no_double_constants_in_device_code():
    """A literal such as 0.5 without f turns the whole expression into double precision: 1/64 of a GPU's speed."""
    literal = re.compile(r"(?<![\w.])(\d+\.\d*|\.\d+|\d+(?=[eE][+-]?\d))([eE][+-]?\d+)?(?![\w.])")
    allowed = re.compile(r"\bdouble\b|//|constexpr auto params|static_assert")
    found = []
    for path in sorted((ROOT / "core").rglob("*.h")):
        if path.parent.name in ("backend",) or path.name in ("distribution.h", "bvh_build.h", "scene.h"):
            continue  # host code only
        in_text = False
        for number, line in enumerate(path.read_text().splitlines(), 1):
            code = re.sub(r'"[^"]*"', '""', line).split("//")[0]
            if in_text or allowed.search(code):
                continue
            if literal.search(code):
                found.append(f"{path.relative_to(ROOT)}:{number}: {line.strip()}")
    assert not found, "\n".join(found)


# --- the program stops when one texture file is missing ---------------------------------------------------------------


def test_missing_textures_are_an_error_that_lists_them_or_a_stand_in(tmp_path, device):
    scene = dl.Scene("missing")
    for i, name in enumerate(("one.png", "two.jpg")):
        material = dl.materials.emissive(radiance=dl.textures.image(name))
        scene.add(dl.shapes.quad((i - 1, -1, 0), (1, 0, 0), (0, 2, 0), material=material))
    scene.camera = dl.cameras.orthographic(origin=(0, 0, 5), target=(0, 0, 0), height=2)
    scene.base_dir = tmp_path
    with pytest.raises(dl.MissingFileError) as error:
        dl.render(scene, spp=1, size=(4, 4), device=device, progress=False)
    assert "one.png" in str(error.value)
    assert "two.jpg" in str(error.value)
    got = dl.render(scene, spp=1, size=(4, 4), device=device, progress=False, allow_missing=True)
    assert got.array.max() > 0.1
    assert got.nonfinite_pixels == 0


# --- deletion through a wrong pointer ---------------------------------------------------------------------------------


def test_scenes_outlive_what_they_were_made_of_and_go_in_any_order(device):
    """The sanitizer run (make sanitize) sees what this one merely survives."""
    scene = dl.Scene("short-lived")
    scene.environment = dl.environments.constant(radiance=0.5)
    scene.add(floor())
    for _ in range(3):
        compiled = scene.compile()
        renderer = _core.Renderer(compiled.core, device, 1)
        film = _core.Film(4, 4)
        del compiled
        renderer.render(film, 0, 0, 4, {"seed": 1})
        state = film.state()
        del renderer
        mean = film.mean()
        del film
        assert np.array_equal(_core.Film.from_state(state).mean(), mean)


# --- the documented build steps miss a `cd` ---------------------------------------------------------------------------


def test_the_documented_commands_work_from_where_one_stands():
    """Whatever `make` the documents name is there, at the top where they are; a clone is followed by `cd`."""
    targets = set(re.findall(r"^([a-z-]+):", (ROOT / "Makefile").read_text(), re.M))
    named = set()
    for document in ("README.md", "CONTRIBUTING.md"):
        text = (ROOT / document).read_text()
        named |= set(re.findall(r"^(?: {4}|\$ )make ([a-z-]+)", text, re.M)) | set(re.findall(r"`make ([a-z-]+)", text))
        for after in re.findall(r"git clone[^\n]*((?:\n[^\n]*){1,3})", text):
            assert re.search(r"\bcd ", after), f"{document}: no cd after git clone"
    assert {"demo", "test"} <= named <= targets


def test_a_recorded_picture_of_the_original_scene_is_lit_all_around(device):
    """All of the above together: the original's scene shows its globe, ground, mirror and glass, none of them black."""
    image = dl.render("origin", spp=16, size=(64, 36), device=device, progress=False).array
    assert np.isfinite(image).all()
    assert (image.sum(-1) > 0.02).all()
    assert 0.3 < image.mean() < 0.9
