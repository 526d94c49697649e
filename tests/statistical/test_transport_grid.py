"""Media that vary over a grid, through the whole renderer: closed forms, numerical integrals and homogeneous twins."""

from __future__ import annotations

from math import pi

import numpy as np
import pytest
from scipy import ndimage

import destello as dl
import stats
from transport import Estimate, assert_agree, assert_known, down_on, estimate, floor, runs

DENSITY = np.array([0.3, 1.2, 4.0])


def noise(shape=(9, 13, 20), seed=1):
    """Densities with holes, of a size that is no multiple of the majorants' cells."""
    values = np.random.default_rng(seed).random(shape, np.float32)
    return np.where(values < 0.3, 0, values).astype(np.float32)


def smoke(density=None, place=None, low=(-1, -1, -1), high=(1, 1, 1), arrays=None, **medium):
    volume = dl.volumes.grid(
        density=noise() if density is None else density, min=low, max=high, transform=place, **(arrays or {})
    )
    return dl.volumes.box(volume, **{"medium_density": 1.0, **medium})


def density_at(values, points):
    """Trilinear interpolation at points (..., 3) of the unit cube; 0 outside."""
    cells = points[..., ::-1] * np.array(values.shape) - 0.5
    found = ndimage.map_coordinates(values.astype(np.float64), np.moveaxis(cells, -1, 0), order=1, mode="nearest")
    return np.where(((points >= 0) & (points <= 1)).all(-1), found, 0.0)


def depth_along_y(values, to_cube, size, half, steps=4000, span=4.0, oversample=5):
    """Optical depth at density 1 along vertical lines through `down_on`'s pixels: (H, W, oversample^2)."""
    from transport import pixel_points

    y = (np.arange(steps) + 0.5) / steps * 2 * span - span
    points = pixel_points(size, half, oversample)
    total = np.zeros(points.shape[:-1])
    for part in np.array_split(y, 40):
        p = points[..., None, :] + np.stack([0 * part, part, 0 * part], -1)
        total += density_at(values, p @ to_cube[:3, :3].T + to_cube[:3, 3]).sum(-1)
    return total * 2 * span / steps


def under_sky(*shapes, half=1.0, radiance=1.0):
    scene = dl.Scene("grid")
    scene.add(*shapes)
    scene.environment = dl.environments.constant(radiance=radiance)
    scene.camera = down_on(half=half)
    return scene


PLACES = {
    "as it is": dl.Transform(),
    "turned": dl.translate(0.1, 0.2, -0.1) @ dl.rotate((1, 2, 3), 40),
    "stretched and sheared": dl.rotate("z", 30) @ dl.shear(xy=0.4) @ dl.scale((0.5, 1.5, 0.8)),
}


@pytest.mark.parametrize("place", PLACES)
@pytest.mark.parametrize("boundary", ["its box", "a larger sphere"])
def test_what_a_black_cloud_lets_pass(place, boundary, device):
    """Per pixel, against the numerical integral through the interpolated voxels."""
    at = PLACES[place]
    volume = dl.volumes.grid(density=noise(), min=(-1, -1, -1), max=(1, 1, 1), transform=at)
    if boundary == "its box":
        shape = dl.volumes.box(volume, medium_density=0.8, medium_absorption=0.4, medium_albedo=0)
    else:
        inside = dl.materials.interface(
            medium_density=0.8, medium_absorption=0.4, medium_albedo=0, medium_volume=volume
        )
        shape = dl.shapes.sphere((0, 0, 0), 3, material=inside)
    to_cube = np.linalg.inv((at @ dl.translate(-1, -1, -1) @ dl.scale(2)).matrix)
    known = np.exp(-1.2 * depth_along_y(noise(), to_cube, 6, 1.0)).mean(-1)
    got = estimate(under_sky(shape), device, spp=1024, size=(6, 6))
    assert_known(got, known, comparisons=6, slack=2e-3)


@pytest.mark.parametrize("boundary", ["its box", "a larger sphere"])
def test_clouds_in_a_group_follow_its_instances(boundary, device):
    """Two instances, one beside the other, each against the integral in its own place."""
    places = {side: dl.translate(4 * side, 0, 0) @ PLACES["stretched and sheared"] for side in (0, 1)}
    inner = dl.rotate("y", 25)
    volume = dl.volumes.grid(density=noise(), min=(-1, -1, -1), max=(1, 1, 1), transform=inner)
    medium = {"medium_density": 0.8, "medium_absorption": 0.4, "medium_albedo": 0}
    shape = dl.volumes.box(volume, **medium)
    if boundary == "a larger sphere":
        shape = dl.shapes.sphere((0, 0, 0), 2, material=dl.materials.interface(**medium, medium_volume=volume))
    scene = under_sky()
    group = scene.group("cloud", [shape, dl.shapes.sphere((0, 0, -9), 0.1)])
    scene.add(*(dl.shapes.instance(group, transform=place) for place in places.values()))
    cube = dl.translate(-1, -1, -1) @ dl.scale(2)
    for side, place in places.items():
        at = dl.translate(-4 * side, 0, 0) @ place @ inner
        known = np.exp(-1.2 * depth_along_y(noise(), np.linalg.inv((at @ cube).matrix), 6, 1.0)).mean(-1)
        scene.camera = dl.cameras.orthographic(
            origin=(4 * side, 5, 0), target=(4 * side, 0, 0), up=(0, 0, -1), height=2
        )
        assert_known(estimate(scene, device, spp=1024, size=(6, 6)), known, comparisons=4, slack=2e-3)


@pytest.mark.parametrize("grouped", [False, True])
def test_clouds_follow_their_shapes(grouped, device):
    """Two shapes of one material, placed apart: each holds the cloud, turned within the shape, where it stands."""
    places = {side: dl.translate(4 * side, 0, 0) @ PLACES["stretched and sheared"] for side in (0, 1)}
    inner, lifted = dl.rotate("y", 25), dl.translate(0, 0.5, 0)
    volume = dl.volumes.grid(density=noise(), min=(-1, -1, -1), max=(1, 1, 1), transform=inner)
    medium = {"medium_density": 0.8, "medium_absorption": 0.4, "medium_albedo": 0}
    inside = dl.materials.interface(**medium, medium_volume=volume)
    shapes = [dl.shapes.box((-2, -2, -2), (2, 2, 2), material=inside, transform=place) for place in places.values()]
    scene = under_sky()
    if grouped:
        scene.add(dl.shapes.instance(scene.group("clouds", shapes), transform=lifted))
    else:
        scene.add(*shapes)
    cube = dl.translate(-1, -1, -1) @ dl.scale(2)
    for side, place in places.items():
        at = dl.translate(-4 * side, 0.5 if grouped else 0, 0) @ place @ inner
        known = np.exp(-1.2 * depth_along_y(noise(), np.linalg.inv((at @ cube).matrix), 6, 1.0)).mean(-1)
        scene.camera = dl.cameras.orthographic(
            origin=(4 * side, 5, 0), target=(4 * side, 0, 0), up=(0, 0, -1), height=2
        )
        assert_known(estimate(scene, device, spp=1024, size=(6, 6)), known, comparisons=4, slack=2e-3)


def test_density_that_falls_off_exponentially(device):
    """An atmosphere: density exp(-y / h) times the colours' own; known in closed form but for the interpolation."""
    n, height, scale = 256, 2.0, 0.5
    y = (np.arange(n) + 0.5) / n * height
    profile = np.exp(-y / scale).astype(np.float32)
    layers = np.broadcast_to(profile[None, :, None], (1, n, 1))
    air = smoke(layers, low=(-9, 0, -9), high=(9, height, 9), medium_density=tuple(DENSITY), medium_albedo=0)
    scene = under_sky(air)
    got = runs(scene, device, spp=512)
    depth = scale * -np.expm1(-height / scale)
    stats.assert_mean(got.reshape(-1, 3), np.exp(-DENSITY * depth), slack=1e-4)


def test_shadows_on_a_floor(device):
    """Shadow rays: chromatic ratio tracking, per pixel and colour."""
    at = dl.translate(0, 2, 0) @ dl.rotate("x", 20)
    scene = dl.Scene("shadow")
    scene.add(floor(1.0), smoke(place=at, medium_density=tuple(DENSITY), medium_albedo=0.5))
    scene.add(dl.lights.directional(direction=(0, -1, 0), irradiance=pi))
    scene.camera = dl.cameras.orthographic(origin=(0, 0.1, 0), target=(0, 0, 0), up=(0, 0, -1), height=2)
    got = runs(scene, device, spp=512, size=(6, 6), max_depth=2, max_volume_depth=0, count=16)
    to_cube = np.linalg.inv((at @ dl.translate(-1, -1, -1) @ dl.scale(2)).matrix)
    depth = depth_along_y(noise(), to_cube, 6, 1.0, span=5.0)
    known = np.exp(-DENSITY * depth[..., None]).mean(-2)
    stats.assert_mean(got.mean((1, 2)), known.mean((0, 1)), slack=2e-3)
    variance = got.var(0, ddof=1) / len(got)
    difference = np.abs(got.mean(0) - known)
    assert (difference < 7 * np.sqrt(variance) + 2e-3 * known).all()


@pytest.mark.parametrize("sampling", ["mis", "bsdf", "light"])
@pytest.mark.parametrize("density", [1.3, (0.4, 1.3, 3.0)])
def test_a_constant_grid_is_a_homogeneous_medium(sampling, density, device):
    """Many scatterings, a lamp, a floor, absorption and anisotropy."""
    medium = {"medium_density": density, "medium_albedo": (0.9, 0.8, 0.95), "medium_anisotropy": 0.4}
    medium["medium_absorption"] = (0.1, 0.0, 0.3)

    def scene(filled):
        s = dl.Scene("twin")
        s.add(floor(), filled)
        lamp = dl.materials.emissive(radiance=5)
        s.add(dl.shapes.quad((-1, 2, -1), (2, 0, 0), (0, 0, 2), material=lamp))
        s.camera = dl.cameras.perspective(origin=(0, 1.5, 4), target=(0, 0.5, 0), vfov=50)
        return s

    low, high = (-1, 0.05, -1), (1, 1, 1)
    twin = scene(dl.shapes.box(low, high, material=dl.materials.interface(**medium)))
    grid = scene(smoke(np.ones((11, 9, 17), np.float32), low=low, high=high, **medium))
    spp = 2048 if sampling == "bsdf" else 512
    options = {"spp": spp, "size": (8, 8), "sampling": sampling, "max_depth": 8}
    assert_agree(estimate(twin, device, seed=1, **options), estimate(grid, device, seed=2, **options), comparisons=6)
    ours, theirs = (runs(s, device, count=4, seed=9 + i, **{**options, "spp": 64}) for i, s in enumerate((twin, grid)))
    (a, va), (b, vb) = ((r.mean((0, 1, 2)), (r.var(0, ddof=1) / len(r)).sum((0, 1)) / 64**2) for r in (ours, theirs))
    stats.assert_means_agree(a, va, b, vb, comparisons=6)


@pytest.mark.parametrize("density", [2.0, tuple(DENSITY)])
def test_white_furnace(density, device):
    """A cloud that only scatters cannot be seen under a constant sky; the colours' sum has no noise."""
    cloud = smoke(medium_density=density, medium_albedo=1, medium_anisotropy=0.5)
    scene = under_sky(cloud, half=1.2, radiance=0.8)
    got = runs(scene, device, spp=64, sampling="auto", max_depth=1000, rr_depth=1000)
    stats.assert_mean(got.reshape(-1, 3), 0.8, comparisons=2, slack=1e-5)
    np.testing.assert_allclose(got.sum(-1), 3 * 0.8, rtol=1e-4)


def test_lamps_in_a_cloud_found_both_ways(device):
    """Light sampling through the cloud against scattering that happens to hit the lamp."""
    scene = dl.Scene("lamp")
    scene.add(floor(), smoke(low=(-1, 0.1, -1), high=(1, 1.6, 1), medium_density=(1, 2, 3), medium_albedo=0.9))
    lamp = dl.materials.emissive(radiance=6, two_sided=True)
    scene.add(dl.shapes.quad((-0.8, 0.9, -0.8), (1.6, 0, 0), (0, 0.1, 1.6), material=lamp))
    scene.camera = dl.cameras.perspective(origin=(0, 1.5, 4), target=(0, 0.7, 0), vfov=18)
    both = estimate(scene, device, spp=512, size=(8, 8), sampling="mis", seed=1, max_depth=6)
    for i, sampling in enumerate(("bsdf", "light")):
        spp = 2048 if sampling == "bsdf" else 512
        other = estimate(scene, device, spp=spp, size=(8, 8), sampling=sampling, seed=2 + i, max_depth=6)
        assert_agree(both, other, comparisons=2)


def test_glowing_gas(device):
    """Radiance L (1 - exp(-depth)): what absorbs, emits. Half of the extinction scatters into nothing."""
    shape = (4, 4, 4, 3)
    glow = np.broadcast_to(np.array([3.0, 2.0, 0.5], np.float32), shape)
    scene = dl.Scene("gas")
    scene.add(
        smoke(
            np.ones(shape[:3], np.float32),
            arrays={"emission": glow, "emission_scale": 2.0},
            medium_density=(0.4, 0.8, 1.0),
            medium_albedo=0.5,
            medium_absorption=(0.3, 0.0, 0.5),
        )
    )
    scene.camera = down_on(half=0.5)
    extinction = np.array([0.7, 0.8, 1.5])
    absorbed = extinction - 0.5 * np.array([0.4, 0.8, 1.0])
    known = 2 * np.array([3.0, 2.0, 0.5]) * absorbed / extinction * -np.expm1(-extinction * 2)
    got = runs(scene, device, spp=1024, max_volume_depth=0)
    stats.assert_mean(got.reshape(-1, 3), known, slack=1e-4)


def test_albedo_grid(device):
    """A grid of albedos times the medium's is that medium with the product: once scattered sunlight."""
    tint = np.broadcast_to(np.array([0.9, 0.6, 0.3], np.float32), (3, 3, 3, 3))
    extinction, height = np.array([1.0, 2.0, 1.5]), 2.0
    scene = dl.Scene("tinted")
    cloud = smoke(
        np.ones((3, 3, 3), np.float32),
        low=(-9, -1, -9),
        high=(9, 1, 9),
        arrays={"albedo": tint},
        medium_density=tuple(extinction),
        medium_albedo=0.8,
    )
    scene.add(cloud, dl.lights.directional(direction=(0, -1, 0), irradiance=pi))
    scene.camera = down_on()
    known = pi / (4 * pi) * 0.8 * np.array([0.9, 0.6, 0.3]) * -np.expm1(-2 * extinction * height) / 2
    got = runs(scene, device, spp=512, max_volume_depth=1)
    stats.assert_mean(got.reshape(-1, 3), known, slack=1e-4)


def test_camera_in_a_cloud(device):
    values = noise()
    scene = dl.Scene("inside")
    scene.add(smoke(values, medium_density=tuple(DENSITY), medium_albedo=0))
    scene.environment = dl.environments.constant(radiance=1)
    scene.camera = dl.cameras.orthographic(origin=(0, 0.1, 0), target=(0, 0, 0), up=(0, 0, -1), height=1e-4)
    y = (np.arange(20_000) + 0.5) / 20_000 * 1.1 - 1
    depth = density_at(values, (np.stack([0 * y, y, 0 * y], -1) + 1) / 2).mean() * 1.1
    got = runs(scene, device, spp=512)
    stats.assert_mean(got.reshape(-1, 3), np.exp(-DENSITY * depth), slack=2e-3)


@pytest.mark.parametrize("inner_first", [True, False])
def test_nested_priorities(inner_first, device):
    """A hole in a cloud, or a fog that the cloud goes before: layers seen from above."""
    ones = np.ones((8, 8, 8), np.float32)
    cloud = smoke(ones, low=(-9, -1, -9), high=(9, 1, 9), medium_density=tuple(DENSITY), medium_albedo=0, priority=1)
    other = dl.materials.interface(medium_density=0.5, medium_albedo=0, priority=2 if inner_first else 0)
    scene = under_sky(cloud, dl.shapes.box((-8, -0.3, -8), (8, 0.4, 8), material=other))
    depth = DENSITY * 1.3 + 0.5 * 0.7 if inner_first else DENSITY * 2
    got = runs(scene, device, spp=512)
    stats.assert_mean(got.reshape(-1, 3), np.exp(-depth), comparisons=2, slack=1e-4)


def fresnel(eta):
    return ((eta - 1) / (eta + 1)) ** 2


def test_a_cloudy_liquid_in_glass(device):
    """Straight down through glass, a liquid that is denser below, and glass: reflections between all four."""
    n = 64
    profile = np.linspace(2, 0, n, dtype=np.float32)[None, :, None]  # mean 1 over the liquid's height of 1
    depth = np.array([0.2, 0.5, 1.0])
    volume = dl.volumes.grid(density=profile, min=(-20, 0, -20), max=(20, 1, 20))
    liquid = dl.materials.dielectric(ior=1.33, medium_absorption=tuple(depth), medium_volume=volume, priority=0)
    glass = dl.materials.dielectric(ior=1.5, priority=1)
    scene = dl.Scene("cup")
    for low, high, material in ((0.99, 1.5, glass), (-0.5, 0.01, glass), (0, 1, liquid)):
        scene.add(dl.shapes.box((-20, low, -20), (20, high, 20), material=material))
    scene.environment = dl.environments.gradient(top=0, bottom=1)
    scene.camera = dl.cameras.orthographic(origin=(0, 5, 0), target=(0, 0, 0), up=(0, 0, -1), height=0.1)
    y = (np.arange(1000) + 0.5) / 1000 * 0.98 + 0.01  # what the glass leaves of the liquid's box
    through_liquid = np.exp(-depth * density_at(profile, np.stack([y, y, y], -1)).mean() * 0.98)
    # Boundaries in turn, each put under what is there (incoherent sums of all reflections).
    front, back, passed = np.zeros(3), np.zeros(3), np.ones(3)
    outer, inner = fresnel(1.5), fresnel(1.5 / 1.33)
    for r, left in ((outer, 1.0), (inner, through_liquid), (inner, 1.0), (outer, 1.0)):
        front, back, passed = (
            front + passed**2 * r / (1 - back * r),
            r + (1 - r) ** 2 * back / (1 - back * r),
            passed * (1 - r) / (1 - back * r),
        )
        passed, back = passed * left, back * left**2
    got = runs(scene, device, spp=1024)
    stats.assert_mean(got.reshape(-1, 3), passed, slack=2e-3)


def test_compact_voxels_are_what_they_stand_for(device):
    """8 bits, halves and floats of the same values: the same bits in the picture."""
    bits = (np.random.default_rng(4).random((9, 10, 11)) < 0.5).astype(np.float32)
    pictures: list[Estimate] = []
    for kind, factor in ((np.float32, 1), (np.float16, 1), (np.uint8, 255)):
        cloud = smoke((bits * factor).astype(kind), medium_density=(1, 2, 3), medium_albedo=0.9)
        pictures.append(estimate(under_sky(cloud), device, spp=8))
    for other in pictures[1:]:
        np.testing.assert_array_equal(pictures[0].rgb, other.rgb)


def test_smallest_grids_and_tiny_densities(device):
    """One voxel; halves that are no normal numbers."""
    for density, factor in ((np.ones((1, 1, 1), np.float32), 1.0), (np.full((2, 1, 3), 2.0**-20, np.float16), 2.0**20)):
        cloud = smoke(density, medium_density=0.7 * factor, medium_albedo=0)
        assert_known(estimate(under_sky(cloud), device, spp=1024), np.exp(-1.4), comparisons=2)
