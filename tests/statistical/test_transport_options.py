"""What may not change the mean, and what must change it as it says: roulette, mixing, opacity, clamp, convergence."""

from __future__ import annotations

import numpy as np
import pytest

import destello as dl
import stats
from transport import assert_agree, assert_constant, assert_known, down_on, estimate, floor


def everything():
    """Glass, metal, fog, mixtures, holes and four kinds of light."""
    s = dl.Scene("everything")
    s.camera = dl.cameras.perspective(origin=(0, 2, 6), target=(0, 0.8, 0), vfov=40)
    matt = dl.materials.diffuse(reflectance=dl.textures.checker_uv(count_u=8, count_v=8))
    metal = dl.materials.conductor(roughness=0.4, reflectance=(0.9, 0.7, 0.4))
    s.add(floor(0.7, 5.0))
    s.add(dl.shapes.sphere((-1.2, 0.6, 0), 0.6, material=dl.materials.dielectric(medium_absorption=(0.1, 0.3, 0.2))))
    s.add(dl.shapes.sphere((0, 0.6, -1), 0.6, material=dl.materials.mix(first=matt, second=metal, amount=0.4)))
    s.add(dl.shapes.sphere((1.3, 0.7, 0), 0.7, material=dl.materials.interface(medium_density=4, medium_albedo=0.95)))
    s.add(dl.shapes.sphere((0, 0.5, 1), 0.4, material=dl.materials.diffuse(reflectance=0.9, opacity=0.5)))
    s.add(dl.shapes.sphere((0, 3.5, 0), 0.5, material=dl.materials.emissive(radiance=6)))
    s.add(dl.lights.spot(position=(3, 4, 3), target=(0, 0, 0), intensity=20))
    s.environment = dl.environments.gradient()
    return s


# --- Russian roulette -------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("sampling", ["auto", "bsdf"])
def test_roulette_keeps_the_mean(sampling, device):
    scene = everything()
    without = estimate(scene, device, spp=512, sampling=sampling, rr_depth=1000, max_depth=20, seed=1)
    for i, depth in enumerate((1, 3)):
        with_it = estimate(scene, device, spp=512, sampling=sampling, rr_depth=depth, max_depth=20, seed=2 + i)
        assert_agree(without, with_it, comparisons=4)


def test_roulette_ends_paths(device):
    scene = dl.Scene("dark furnace")
    walls = dl.materials.diffuse(reflectance=0.3, emission=1, emission_two_sided=True)
    scene.add(dl.shapes.box((-1, -1, -1), (1, 1, 1), material=walls))
    scene.camera = dl.cameras.perspective()
    rays = {}
    for depth in (1, 100):
        scene.render.rr_depth, scene.render.light_sampling = depth, "bsdf"
        rays[depth] = dl.render(scene, spp=16, size=(8, 8), max_depth=50, device=device, progress=False).metadata[
            "rays"
        ]
    assert rays[1] < 0.1 * rays[100]
    got = estimate(scene, device, spp=1024, rr_depth=1, max_depth=100, sampling="bsdf")
    assert_known(got, 1 / 0.7)


# --- mixtures, masks --------------------------------------------------------------------------------------------------


def one_ball(material):
    scene = dl.Scene("ball")
    scene.add(dl.shapes.sphere((0, 0, 0), 1, material=material))
    scene.environment = dl.environments.gradient(bottom=(0.1, 0.2, 0.9), top=(2, 1, 0.5))
    scene.add(dl.lights.directional(direction=(-1, -1, -1), irradiance=3))
    scene.camera = dl.cameras.orthographic(origin=(0, 0, 5), target=(0, 0, 0), height=1.3)
    return scene


def test_a_mixture_is_the_blend_of_the_pictures(device):
    first = dl.materials.diffuse(reflectance=(0.8, 0.3, 0.1))
    second = dl.materials.conductor(reflectance=(0.3, 0.6, 0.9), roughness=0.5)
    third = dl.materials.emissive(radiance=(0.2, 0.9, 0.4))
    inner = dl.materials.mix(first=second, second=third, amount=0.25)
    whole = estimate(one_ball(dl.materials.mix(first=first, second=inner, amount=0.4)), device, spp=2048, size=(8, 8))
    parts = [
        estimate(one_ball(m), device, spp=512, size=(8, 8), seed=5 + i) for i, m in enumerate((first, second, third))
    ]
    shares = [0.6, 0.4 * 0.75, 0.4 * 0.25]
    mean = sum(s * p.mean for s, p in zip(shares, parts, strict=True))
    variance = sum(s * s * p.variance for s, p in zip(shares, parts, strict=True))
    stats.assert_means_agree(whole.mean, whole.variance, mean, variance)


def test_opacity_before_a_sky(device):
    scene = dl.Scene("veil")
    veil = dl.materials.emissive(radiance=3, opacity=0.25)
    scene.add(dl.shapes.quad((-9, -9, 0), (18, 0, 0), (0, 18, 0), material=veil))
    scene.environment = dl.environments.constant(radiance=1)
    scene.camera = dl.cameras.orthographic(origin=(0, 0, 5), target=(0, 0, 0), height=1)
    assert_known(estimate(scene, device, spp=256), 0.25 * 3 + 0.75)


@pytest.mark.parametrize("light", ["sun", "lamp"])
def test_opacity_and_shadows(light, device):
    """Two veils let through what each leaves."""
    scene = dl.Scene("veils")
    scene.add(floor(0.5, 50))
    for y, opacity in ((1.0, 0.3), (1.5, 0.6)):
        black = dl.materials.diffuse(reflectance=0, opacity=opacity)
        scene.add(dl.shapes.quad((-60, y, 60), (120, 0, 0), (0, 0, -120), material=black))
    if light == "sun":
        scene.add(dl.lights.directional(direction=(1, -2, 0.5), irradiance=2))
        known = 0.5 / np.pi * 2 * 2 / np.linalg.norm((1, -2, 0.5))
    else:  # as good as endless
        lamp = dl.materials.emissive(radiance=1)
        scene.add(dl.shapes.quad((-1e4, 2, -1e4), (2e4, 0, 0), (0, 0, 2e4), material=lamp))
        known = 0.5
    scene.camera = dl.cameras.orthographic(origin=(0, 0.5, 0), target=(0, 0, 0), up=(0, 0, -1), height=1)
    got = estimate(scene, device, spp=2048, max_depth=2, size=(6, 6), sampling="bsdf" if light == "lamp" else None)
    assert_known(got, known * 0.7 * 0.4, slack=2e-4)


def cut_out_scene(cutoff):
    """A white sheet under a sky; its opacity is 0.6 and 0.2 in turn, on a chessboard of 4 x 4 squares."""
    scene = dl.Scene("cut-out")
    board = dl.textures.checker_uv(even=(0.6,) * 3, odd=(0.2,) * 3, count_u=4, count_v=4)
    sheet = dl.materials.emissive(radiance=5, opacity=board, opacity_cutoff=cutoff)
    scene.add(dl.shapes.quad((-1, 0, 1), (2, 0, 0), (0, 0, -2), material=sheet))
    scene.environment = dl.environments.constant(radiance=1)
    scene.camera = down_on(1.0)
    return scene


def test_cut_out(device):
    """Eight pixels a row, two for every square; row 0 of the picture is at v = 1."""
    squares = (np.add.outer(np.arange(8) // 2, np.arange(8) // 2) + 1) % 2  # the lower left one is even
    even = np.flipud(np.kron(np.indices((4, 4)).sum(0) % 2 == 0, np.ones((2, 2), bool)))
    assert squares.sum() == even.sum() == 32
    for cutoff, there in ((0.5, even), (0.1, np.ones((8, 8), bool)), (0.9, np.zeros((8, 8), bool))):
        got = estimate(cut_out_scene(cutoff), device, spp=4, size=(8, 8))
        assert_constant(got, np.where(there, 5, 1)[..., None])
    soft = estimate(cut_out_scene(0), device, spp=1024, size=(8, 8))
    assert_known(soft, np.where(even, 0.6 * 5 + 0.4, 0.2 * 5 + 0.8))


# --- clamp ------------------------------------------------------------------------------------------------------------


def test_clamp(device):
    """A bound on every sample, in each channel; what stays below it is untouched."""
    scene = dl.Scene("lamp")
    lamp = dl.materials.emissive(radiance=(9, 2, 0.5))
    scene.add(dl.shapes.quad((-9, -9, 0), (18, 0, 0), (0, 18, 0), material=lamp))
    scene.camera = dl.cameras.orthographic(origin=(0, 0, 5), target=(0, 0, 0), height=1)
    assert_constant(estimate(scene, device, spp=4, clamp=3), (3, 2, 0.5))
    assert_constant(estimate(scene, device, spp=4), (9, 2, 0.5))
    busy = everything()
    free, bound = estimate(busy, device, spp=64), estimate(busy, device, spp=64, clamp=0.5)
    assert bound.rgb.max() <= 0.5 + 1e-6
    assert (bound.rgb <= free.rgb + 1e-6).all()
    assert free.rgb.max() > 1


# --- convergence ------------------------------------------------------------------------------------------------------


@pytest.mark.slow
def test_error_falls_with_the_square_root_of_the_samples(device):
    """The slope of log error over log samples, from 4 to 256: about -1/2, or steeper by good sampling."""
    scene, size = dl.scenes.build("cornell"), (16, 16)
    scene.film.filter = dl.filters.box()
    reference = dl.render(scene, spp=4096, size=size, seed=99, device=device, progress=False).array
    counts = np.array([4, 16, 64, 256])
    errors = []
    for spp in counts:
        runs = [
            dl.render(scene, spp=int(spp), size=size, seed=s, device=device, progress=False).array for s in range(3)
        ]
        errors.append(np.sqrt(np.mean([(r - reference) ** 2 for r in runs])))
    slope = np.polyfit(np.log(counts), np.log(errors), 1)[0]
    assert -1.2 < slope < -0.45, (slope, errors)
