"""Light transport against closed forms: scenes whose radiance is known."""

from __future__ import annotations

from math import cos, exp, pi, radians, sin, sqrt

import numpy as np
import pytest

import destello as dl
from transport import assert_constant, assert_known, down_on, estimate, floor, pixel_points, slab

HALF, SIZE = 1.5, 8  # of the part of the floor that `down_on` shows, metres and pixels
ALBEDO = 0.6


def lit_floor(*lights):
    scene = dl.Scene("lit floor")
    scene.camera = down_on(HALF)
    scene.add(floor(ALBEDO), *lights)
    return scene


def radiance_of_floor(irradiance):
    """Mean radiance of every pixel from the irradiance as a function of points (..., 3)."""
    return ALBEDO / pi * irradiance(pixel_points(SIZE, HALF)).mean(-1)


def check_floor(scene, irradiance, device, *, spp=64, slack=2e-4, **options):
    """`slack` covers the quadrature of `pixel_points`."""
    got = estimate(scene, device, spp=spp, size=(SIZE, SIZE), max_depth=2, **options)
    assert_known(got, radiance_of_floor(irradiance), slack=slack)


# --- lights over a plane ----------------------------------------------------------------------------------------------


def test_point_light(device):
    place = np.array([0.4, 1.2, -0.3])

    def irradiance(p):
        d = place - p
        d2 = (d**2).sum(-1)
        return 5.0 * d[..., 1] / d2**1.5

    check_floor(lit_floor(dl.lights.point(position=place, intensity=5)), irradiance, device)


@pytest.mark.parametrize("edge", [0.0, 0.5, 1.0])
def test_spot_light(edge, device):
    place, target = np.array([0.8, 1.5, 0.2]), np.array([-0.1, 0.0, 0.1])
    axis = (target - place) / np.linalg.norm(target - place)
    outer, inner = cos(radians(32)), cos(radians(32 * (1 - edge)))

    def irradiance(p):
        d = p - place
        r = np.linalg.norm(d, axis=-1)
        c = (d @ axis) / r
        x = np.clip((c - outer) / max(inner - outer, 1e-12), 0, 1)
        return 7.0 * x * x * (3 - 2 * x) * -d[..., 1] / r**3

    light = dl.lights.spot(position=place, target=target, intensity=7, cone_angle=32, edge=edge)
    # A hard rim within a pixel is more than the quadrature's grid can do.
    check_floor(lit_floor(light), irradiance, device, spp=256, slack=2e-2 if edge == 0 else 5e-4)


def test_directional_light(device):
    direction = np.array([0.3, -0.8, 0.4])
    light = dl.lights.directional(direction=direction, irradiance=2)
    got = estimate(lit_floor(light), device, spp=4, size=(SIZE, SIZE), max_depth=2)
    cosine = 0.8 / np.linalg.norm(direction)
    assert_constant(got, ALBEDO / pi * 2 * cosine)


@pytest.mark.parametrize("sampling", ["mis", "bsdf", "light"])
def test_wide_sun(sampling, device):
    """A disk of 40 degrees that lies wholly above the horizon lights as its centre would."""
    light = dl.lights.directional(direction=(sin(radians(35)), -cos(radians(35)), 0), irradiance=2, angular_diameter=40)
    got = estimate(lit_floor(light), device, spp=1024, size=(SIZE, SIZE), max_depth=2, sampling=sampling)
    assert_known(got, ALBEDO / pi * 2 * cos(radians(35)), comparisons=3)


@pytest.mark.parametrize("sampling", ["mis", "bsdf", "light"])
def test_sphere_light(sampling, device):
    center, radius = np.array([0.3, 1.4, -0.2]), 0.8

    def irradiance(p):
        d = center - p
        d2 = (d**2).sum(-1)
        return pi * 3 * radius**2 / d2 * d[..., 1] / np.sqrt(d2)

    lamp = dl.shapes.sphere(center, radius, material=dl.materials.emissive(radiance=3))
    scene = lit_floor(lamp)
    scene.camera = dl.cameras.orthographic(origin=(0, 0.3, 0), target=(0, 0, 0), up=(0, 0, -1), height=2 * HALF)
    check_floor(scene, irradiance, device, spp=1024, sampling=sampling)


def polygon_irradiance(corners, points):
    """Of a polygon of radiance 1 on the plane with normal +y (Lambert 1760): half the sum of angle times cosine."""
    v = np.asarray(corners)[:, None, None, None] - points
    v = v / np.linalg.norm(v, axis=-1, keepdims=True)
    total = 0.0
    for a, b in zip(v, np.roll(v, -1, axis=0), strict=True):
        angle = np.arccos(np.clip((a * b).sum(-1), -1, 1))
        n = np.cross(a, b)
        total = total + angle * n[..., 1] / np.linalg.norm(n, axis=-1)
    return np.abs(total) / 2


@pytest.mark.parametrize("sampling", ["mis", "bsdf", "light"])
@pytest.mark.parametrize("kind", ["triangle", "quad"])
def test_polygon_light(kind, sampling, device):
    corners = np.array([[-0.8, 0.7, -0.9], [0.9, 1.1, -0.6], [0.7, 1.5, 0.9], [-1.0, 1.1, 0.6]])
    lamp = dl.materials.emissive(radiance=2, two_sided=True)
    if kind == "triangle":
        corners = corners[:3]
        shape = dl.shapes.mesh(corners, [[0, 1, 2]], material=lamp)
    else:
        shape = dl.shapes.quad(corners[0], corners[1] - corners[0], corners[3] - corners[0], material=lamp)
    scene = lit_floor(shape)
    scene.camera = dl.cameras.orthographic(origin=(0, 0.3, 0), target=(0, 0, 0), up=(0, 0, -1), height=2 * HALF)
    check_floor(
        scene, lambda p: 2 * polygon_irradiance(corners, p), device, spp=1024, sampling=sampling, slack=1e-3
    )  # fmt: skip


def test_power_of_an_emitter_is_what_it_radiates(device):
    """Radiance is the power over pi times the area."""
    for shape in ("ball", "quad"):
        scene = dl.Scene("power")
        scene.camera = dl.cameras.perspective(origin=(0, 0, 5), target=(0, 0, 0), vfov=1)
        glow = dl.materials.emissive(power=8)
        if shape == "ball":
            scene.add(dl.shapes.sphere((0, 0, 0), 0.5, material=glow))
            radiance = 8 / (pi * 4 * pi * 0.25)
        else:
            scene.add(dl.shapes.quad((-1, -1, 0), (2, 0, 0), (0, 2, 0), material=glow))
            radiance = 8 / (pi * 4)
        assert_constant(estimate(scene, device, spp=2, size=(4, 4)), radiance)


def test_power_of_an_ellipsoid(device):
    """A spheroid of half-axes (1, 1, 3) has the area 2 pi (1 + 3 asin(e) / e), e^2 = 8/9."""
    scene = dl.Scene("ellipsoid")
    scene.camera = dl.cameras.perspective(origin=(0, 0, 9), target=(0, 0, 0), vfov=1)
    scene.group("ball", [dl.shapes.sphere((0, 0, 0), 1, material=dl.materials.emissive(power=8))])
    scene.add(dl.shapes.instance("ball", transform=dl.scale(1, 1, 3)))
    e = sqrt(8 / 9)
    area = 2 * pi * (1 + 3 * np.arcsin(e) / e)
    assert_constant(estimate(scene, device, spp=2, size=(4, 4)), 8 / (pi * area), rtol=2e-3)


# --- convex and closed things -----------------------------------------------------------------------------------------


def test_convex_lambert_under_a_constant_sky(device):
    scene = dl.Scene("ball")
    scene.environment = dl.environments.constant(radiance=(1.5, 1.0, 0.5))
    scene.camera = dl.cameras.orthographic(origin=(0, 0, 5), target=(0, 0, 0), height=1.2)
    scene.add(dl.shapes.sphere((0, 0, 0), 1, material=dl.materials.diffuse(reflectance=(0.2, 0.5, 0.9))))
    assert_constant(estimate(scene, device, spp=8), (0.3, 0.5, 0.45))
    for sampling in ("mis", "light"):
        got = estimate(scene, device, spp=256, sampling=sampling)
        assert_known(got, dl.color.luminance(np.array([0.3, 0.5, 0.45])), comparisons=2)


def furnace(rho, glow):
    scene = dl.Scene("furnace box")
    walls = dl.materials.diffuse(reflectance=rho, emission=glow, emission_two_sided=True)
    scene.add(dl.shapes.box((-1, -2, -1.5), (1, 1, 2), material=walls))
    scene.camera = dl.cameras.perspective(origin=(0.3, -0.2, 0.1), target=(1, 0.5, 1), vfov=80)
    return scene


@pytest.mark.parametrize("depth", [1, 2, 3, 9])
def test_furnace_box_by_depth(depth, device):
    """Segments up to the limit: glow, then what is reflected once, ... Without light sampling there is no noise."""
    rho, glow = 0.7, 0.5
    got = estimate(furnace(rho, glow), device, spp=4, max_depth=depth, sampling="bsdf", rr_depth=100)
    assert_constant(got, glow * (1 - rho**depth) / (1 - rho))


def test_furnace_box(device):
    rho, glow = np.array([0.2, 0.5, 0.8]), np.array([1.0, 0.5, 0.2])
    known = dl.color.luminance(glow / (1 - rho))
    for sampling in ("bsdf", "mis"):  # light sampling alone has no finite variance near the edges
        got = estimate(furnace(rho, glow), device, spp=256, max_depth=200, sampling=sampling)
        assert_known(got, known, comparisons=2)


def test_depth_limit(device):
    """1: only what shines by itself. 2: direct light."""
    scene = lit_floor(dl.lights.directional(direction=(0, -1, 0), irradiance=pi))
    lamp = dl.materials.emissive(radiance=3)
    scene.add(dl.shapes.quad((-9, 0.01, 0), (18, 0, 0), (0, 0, -9), material=lamp))
    for depth, lit in ((1, 0.0), (2, ALBEDO), (3, ALBEDO)):
        got = estimate(scene, device, spp=64, size=(4, 8), max_depth=depth)
        assert_constant(got[:4], 3)  # the lamp's half
        if lit:
            assert_known(got[4:], lit, comparisons=2)
        else:
            assert_constant(got[4:], 0)


# --- media ------------------------------------------------------------------------------------------------------------


def test_camera_in_a_medium(device):
    scene = dl.Scene("in a medium")
    fog = dl.materials.interface(medium_absorption=(0.1, 0.5, 1.0))
    scene.add(dl.shapes.sphere((1, 2, 3), 2, material=fog))
    scene.environment = dl.environments.constant(radiance=1)
    scene.camera = dl.cameras.perspective(origin=(1, 2, 3), target=(0, 0, 0), vfov=60)
    assert_constant(estimate(scene, device, spp=2), np.exp(-2 * np.array([0.1, 0.5, 1.0])))


@pytest.mark.parametrize("anisotropy", [0.0, 0.8, -0.5])
@pytest.mark.parametrize("sampling", ["auto", "mis", "light"])
def test_white_furnace_of_a_medium(anisotropy, sampling, device):
    """A medium that only scatters cannot be seen under a constant sky."""
    scene = dl.Scene("white smoke")
    smoke = dl.materials.interface(medium_density=3, medium_albedo=1, medium_anisotropy=anisotropy)
    scene.add(dl.shapes.sphere((0, 0, 0), 1, material=smoke))
    scene.environment = dl.environments.constant(radiance=0.8)
    scene.camera = dl.cameras.perspective(origin=(0, 0, 4), target=(0, 0, 0), vfov=35)
    got = estimate(scene, device, spp=16 if sampling == "auto" else 256, sampling=sampling, max_depth=1000)
    if sampling == "auto":
        assert_constant(got, 0.8)
    else:
        assert_known(got, 0.8, comparisons=9)


def test_fog_in_front_of_a_sky(device):
    """What a black medium of density s lets pass: exp(-s d)."""
    scene = dl.Scene("black smoke")
    scene.add(slab(0, 0.5, dl.materials.interface(medium_density=1.2, medium_albedo=0)))
    scene.environment = dl.environments.constant(radiance=1)
    scene.camera = dl.cameras.orthographic(origin=(0, 10, 10), target=(0, 0, 0), height=0.5)
    assert_known(estimate(scene, device, spp=1024), exp(-1.2 * 0.5 * sqrt(2)))


@pytest.mark.parametrize("light", ["sun", "wide sun", "point", "lamp"])
def test_fog_over_a_floor(light, device):
    """Shadow rays through two layers of fog, one on the other, that absorb in part and scatter nothing."""
    layers = [
        slab(0.2, 0.5, dl.materials.interface(medium_density=1, medium_albedo=0, medium_absorption=0.4)),
        slab(0.51, 0.9, dl.materials.interface(medium_absorption=0.3)),
    ]
    depth = 1.4 * 0.3 + 0.3 * 0.39
    height = np.array([0, 2.0, 0])

    def from_above(p):
        return np.full(p.shape[:-1], exp(-depth))

    def from_point(p):
        d = height - p
        r = np.linalg.norm(d, axis=-1)
        return 2.0**2 * np.exp(-depth * r / 2.0) * 2.0 / r**3

    if light in ("sun", "wide sun"):
        known = from_above
        lamp = dl.lights.directional(direction=(0, -1, 0), irradiance=1, angular_diameter=1 if light != "sun" else 0)
    elif light == "point":
        known, lamp = from_point, dl.lights.point(position=height, intensity=4)
    else:  # small enough to be a point
        known, r = from_point, 0.02
        lamp = dl.shapes.sphere(height, r, material=dl.materials.emissive(radiance=4 / (pi * r * r)))
    scene = lit_floor(*layers, lamp)
    scene.camera = dl.cameras.orthographic(origin=(0, 0.1, 0), target=(0, 0, 0), up=(0, 0, -1), height=2 * HALF)
    check_floor(scene, known, device, spp=256, slack=1e-3)
