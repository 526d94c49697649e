"""Glass and water against closed forms: Fresnel, absorption, nesting."""

from __future__ import annotations

from math import cos, exp, radians, sqrt, tan

import numpy as np
import pytest

import destello as dl
import stats
from transport import assert_agree, assert_constant, assert_known, estimate, floor, furnace, runs, slab


def fresnel(cos_i, eta):
    """Reflectance and refracted cosine, from index 1 to eta."""
    cos_t = sqrt(1 - (1 - cos_i**2) / eta**2)
    s = (cos_i - eta * cos_t) / (cos_i + eta * cos_t)
    p = (eta * cos_i - cos_t) / (eta * cos_i + cos_t)
    return (s * s + p * p) / 2, cos_t


def stack(angle, layers):
    """Reflectance and transmittance, without interference, of layers (index, absorption, thickness) in air.

    Each boundary and each absorbing layer in turn is put under what is there already (reflections seen from above and
    from below, transmittance the same both ways).
    """
    front, back, through = 0.0, 0.0, 1.0
    index, cosine = 1.0, cos(angle)
    for n, absorption, thickness in [*layers, (1.0, 0.0, 0.0)]:
        r, next_cosine = fresnel(cosine, n / index)
        front, back, through = (
            front + through**2 * r / (1 - back * r),
            r + (1 - r) ** 2 * back / (1 - back * r),
            through * (1 - r) / (1 - back * r),
        )
        index, cosine = n, next_cosine
        left = exp(-absorption * thickness / cosine)
        through, back = through * left, back * left**2
    return front, through


def check_stack(shapes, layers, device, degrees=50.0, spp=1024, **options):
    """Looks down on the slabs under a sky that shines from above only, and under one that shines from below only."""
    angle = radians(degrees)
    reflected, passed = stack(angle, layers)
    for above in (True, False):
        scene = dl.Scene("slab")
        scene.add(*shapes)
        scene.camera = dl.cameras.orthographic(
            origin=(0, 10, 10 * tan(angle)), target=(0, 0, 0), up=(0, 1, 0), height=0.5
        )
        ends = {"top": 1, "bottom": 0} if above else {"top": 0, "bottom": 1}
        scene.environment = dl.environments.gradient(**ends)
        # The gradient towards the reflected and towards the straight direction.
        towards, away = (1 + cos(angle)) / 2, (1 - cos(angle)) / 2
        known = reflected * (towards if above else away) + passed * (away if above else towards)
        got = estimate(scene, device, spp=spp, size=(6, 6), **options)
        assert_known(got, known, comparisons=2, slack=1e-4)


@pytest.mark.parametrize("degrees", [0.01, 50, 80])
def test_window(degrees, device):
    check_stack([slab(0, 0.2, dl.materials.dielectric(ior=1.5))], [(1.5, 0, 0.2)], device, degrees)


def test_matched_absorbing_slab(device):
    """Beer-Lambert alone: no boundary is seen, and nothing is random."""
    scene = dl.Scene("filter")
    material = dl.materials.dielectric(ior=1, medium_absorption=(0.5, 1.0, 2.0))
    scene.add(slab(0, 0.8, material))
    scene.environment = dl.environments.constant(radiance=1)
    scene.camera = dl.cameras.orthographic(origin=(0, 10, 10), target=(0, 0, 0), height=0.5)
    got = estimate(scene, device, spp=2)
    assert_constant(got, np.exp(-np.array([0.5, 1.0, 2.0]) * 0.8 * sqrt(2)), rtol=1e-4)


def test_absorbing_window(device):
    glass = dl.materials.dielectric(ior=1.6, medium_absorption=0.7)
    check_stack([slab(0, 0.9, glass)], [(1.6, 0.7, 0.9)], device)


def clear(kind, ior, absorption=0.0, **more):
    """A smooth dielectric of that index, 1/m of absorption inside."""
    if kind == "dielectric":
        return dl.materials.dielectric(ior=ior, medium_absorption=absorption, **more)
    depth = {"transmission_depth": 1.0, "transmission_color": exp(-absorption)} if absorption else {}
    return dl.materials.openpbr(transmission_weight=1, specular_roughness=0, specular_ior=ior, **depth, **more)


@pytest.mark.parametrize("kind", ["dielectric", "openpbr"])
@pytest.mark.parametrize("overlap", [0.001, 0.3])
def test_liquid_in_glass(overlap, kind, device):
    """Glass goes before liquid: where they overlap there is glass, and the liquid's own boundary is not there."""
    glass, liquid = clear(kind, 1.5, 0.2, priority=2), clear(kind, 1.33, 0.9, priority=1)
    shapes = [slab(1, 1.5, glass), slab(0, 1 + overlap, liquid)]
    check_stack(shapes, [(1.5, 0.2, 0.5), (1.33, 0.9, 1.0)], device)


def test_bubble_of_air_in_glass(device):
    """Air with a boundary of its own inside glass: four boundaries, two layers of glass."""
    glass = dl.materials.dielectric(ior=1.5, medium_absorption=0.4)
    shapes = [slab(0, 3, glass), slab(1, 1.5, dl.materials.dielectric(ior=1))]
    check_stack(shapes, [(1.5, 0.4, 1.5), (1.0, 0.0, 0.5), (1.5, 0.4, 1.0)], device)


def test_metal_under_water(device):
    """The water's index counts at the metal's surface."""
    water = dl.materials.dielectric(ior=1.33)
    metal = dl.materials.conductor(fresnel="eta_k", eta=0.2, k=2.0)
    scene = dl.Scene("metal under water")
    scene.add(slab(0, 1, water), dl.shapes.quad((-50, 0.5, 50), (100, 0, 0), (0, 0, -100), material=metal))
    scene.camera = dl.cameras.orthographic(origin=(0, 10, 0), target=(0, 0, 0), up=(0, 0, 1), height=0.5)
    scene.environment = dl.environments.constant(radiance=1)
    r, _ = fresnel(1, 1.33)
    m = ((0.2 - 1.33) ** 2 + 4) / ((0.2 + 1.33) ** 2 + 4)
    assert_known(estimate(scene, device, spp=1024), r + (1 - r) ** 2 * m / (1 - r * m), slack=1e-4)


@pytest.mark.parametrize("inner", [0.5, 0.99])
def test_hollow_glass_ball_in_a_furnace(inner, device):
    scene = dl.Scene("hollow")
    glass = dl.materials.dielectric(ior=1.5)
    scene.add(dl.shapes.sphere((0, 0, 0), 1, material=glass), dl.shapes.sphere((0, 0, 0), -inner, material=glass))
    scene.environment = dl.environments.constant(radiance=0.7)
    scene.camera = dl.cameras.perspective(origin=(0, 0, 4), target=(0, 0, 0), vfov=35)
    assert_constant(estimate(scene, device, spp=16, max_depth=1000), 0.7, rtol=1e-4)


def test_hollow_glass_ball_is_air_inside(device):
    """Straight through the middle: four boundaries and no bend; absorption only in the walls."""
    glass = dl.materials.dielectric(ior=1.5, medium_absorption=0.8)
    scene = dl.Scene("hollow")
    scene.add(dl.shapes.sphere((0, 0, 0), 1, material=glass), dl.shapes.sphere((0, 0, 0), -0.6, material=glass))
    scene.environment = dl.environments.gradient(bottom=1, top=0)
    scene.camera = dl.cameras.perspective(origin=(0, 4, 0), target=(0, 0, 0), up=(0, 0, 1), vfov=0.01)
    _, passed = stack(0, [(1.5, 0.8, 0.4), (1.0, 0, 1.2), (1.5, 0.8, 0.4)])
    assert_known(estimate(scene, device, spp=2048, size=(6, 6)), passed, slack=1e-4)


@pytest.mark.parametrize("kind", ["dielectric", "openpbr"])
def test_camera_in_glass(kind, device):
    """In glass radiance is n^2 times what it is outside, whatever is reflected on the way."""
    scene = dl.Scene("in glass")
    scene.add(dl.shapes.sphere((0, 0, 0), 1, material=clear(kind, 1.5)))
    scene.environment = dl.environments.constant(radiance=0.4)
    scene.camera = dl.cameras.perspective(origin=(0, 0, 0), target=(0, 0, -1), vfov=60)
    assert_constant(estimate(scene, device, spp=16, max_depth=100), 0.4 * 2.25, rtol=1e-4)


def prism_scene(abbe, kind):
    """A camera looks through a prism at a sun, near the angle of least deviation: apex 40 degrees, index 1.5."""
    half, tall, wide = radians(20), 4.0, 3.0
    foot, turn = tall * tan(half), np.arcsin(1.5 * np.sin(half)) - half
    corners = [(-foot, 0), (foot, 0), (0, tall)]
    positions = np.array([(x, y, z) for z in (-wide, wide) for x, y in corners], np.float32)
    faces = [(0, 2, 1), (3, 4, 5), (0, 1, 4), (0, 4, 3), (1, 2, 5), (1, 5, 4), (2, 0, 3), (2, 3, 5)]
    scene = dl.Scene("prism")
    spread = {"abbe": abbe}
    if kind == "openpbr":
        spread = {"transmission_dispersion_scale": float(abbe > 0), "transmission_dispersion_abbe_number": abbe or 20.0}
    scene.add(dl.shapes.mesh(positions, faces, material=clear(kind, 1.5, **spread)))
    sun = np.array([cos(turn), -np.sin(turn), 0])
    scene.add(dl.lights.directional(direction=-sun, irradiance=1, angular_diameter=1))
    middle = np.array([0, tall / 2, 0])
    eye = middle - 8 * np.array([cos(turn), np.sin(turn), 0])
    scene.camera = dl.cameras.perspective(origin=eye, target=middle, vfov=10)
    return scene


@pytest.mark.parametrize("kind", ["dielectric", "openpbr"])
def test_a_prism_spreads_white_light_and_keeps_its_white(kind, device):
    """All colours are there, in their order, and together they are as white and as bright as without dispersion."""
    options = {"spp": 512, "size": (8, 48), "count": 8, "max_depth": 6}
    spread = runs(prism_scene(12.0, kind), device, **options)
    plain = runs(prism_scene(0.0, kind), device, seed=100, **options)
    (a, va), (b, vb) = ((t.mean(0), t.var(0, ddof=1) / len(t)) for t in (r.mean((1, 2)) for r in (spread, plain)))
    # Reflection, and the size of what is seen, depend a little on the index: 2% are allowed.
    stats.assert_means_agree(a, va, b, vb, slack=0.02)
    assert np.sqrt(va + vb).max() < 0.03 * b.min()
    profile = spread.mean((0, 2))  # from the top of the picture down: (48, 3)
    centre = (np.arange(48)[:, None] * profile).sum(0) / profile.sum(0)
    assert centre[0] + 3 < centre[1] < centre[2] - 3 or centre[0] - 3 > centre[1] > centre[2] + 3
    bright = profile[profile.max(1) > 0.15 * profile.max()]
    shares = bright / np.abs(bright).sum(1, keepdims=True)
    assert shares.max(0).min() > 0.6  # rows that are nearly all red, all green, all blue
    grey = plain.mean((0, 2))
    np.testing.assert_allclose(grey, np.repeat(grey[:, :1], 3, 1), rtol=1e-4)


@pytest.mark.parametrize("priorities", [(0, 0), (0, 1), (1, 0)])
@pytest.mark.parametrize("indices", [(1.2, 1.8), (1.8, 1.2)])
def test_glass_that_overlaps_keeps_all_light(indices, priorities, device):
    """Also among equals, where the newest counts: the other one's boundary is not seen on the way out."""
    glass = [dl.materials.dielectric(ior=n, priority=p) for n, p in zip(indices, priorities, strict=True)]
    scene = furnace(dl.shapes.sphere((0, 0, 0), 1, material=glass[0]))
    scene.add(dl.shapes.sphere((0.7, 0, 0), 0.9, material=glass[1]))
    scene.camera = dl.cameras.perspective(origin=(0, 1, 5), target=(0.3, 0, 0))
    scene.render.max_depth = scene.render.rr_depth = 1000
    mean, _ = estimate(scene, device, spp=512).total
    assert mean == pytest.approx(1, abs=1e-3)  # (A few paths are caught by total reflection.)


def test_fog_that_overlaps_glass_keeps_all_light(device):
    """Fog changes no index: whoever leaves the glass within newer fog is refracted."""
    scene = furnace(dl.shapes.sphere((0, 0, 0), 1, material=dl.materials.dielectric(ior=1.5)))
    fog = dl.materials.interface(medium_density=1.0)
    scene.add(dl.shapes.sphere((0.7, 0, 0), 0.9, material=fog))
    scene.render.max_depth = scene.render.rr_depth = 1000
    image = estimate(scene, device, spp=256)
    mean, variance = image.total
    assert mean == pytest.approx(1, abs=1e-3 + 4 * sqrt(variance))


HOLES = {
    "glass": {"ior": 1.5},
    "rough": {"ior": 1.5, "roughness": 0.02},
    "milk": {"ior": 1.5, "medium_density": 1.0},
}


@pytest.mark.parametrize("opacity", [0.8, 0.3])
@pytest.mark.parametrize("kind", list(HOLES))
def test_glass_with_holes_keeps_all_light(kind, opacity, device):
    """Who leaves by a hole leaves what is inside; who has come in by one is in nothing."""
    scene = furnace(dl.shapes.sphere((0, 0, 0), 1, material=dl.materials.dielectric(opacity=opacity, **HOLES[kind])))
    scene.render.max_depth = scene.render.rr_depth = 1000
    for i, sampling in enumerate(("bsdf", "mis")):
        got = runs(scene, device, count=8, seed=100 * i, spp=64, sampling=sampling).mean(axis=(1, 2, 3))
        error = got.std(ddof=1) / sqrt(8)
        assert got.mean() == pytest.approx(1, abs=2e-3 + 4 * error)


@pytest.mark.parametrize("weight", [0.0, 0.5, 1.0])
def test_openpbr_inside_has_the_index_that_refracts(weight, device):
    """The one that `specular_weight` leaves: light that leaves by a hole shows it."""
    words = {"specular_weight": weight, "specular_roughness": 0.0, "transmission_weight": 1.0, "opacity": 0.5}
    scene = furnace(dl.shapes.sphere((0, 0, 0), 1, material=dl.materials.openpbr(**words)))
    scene.render.max_depth = scene.render.rr_depth = 1000
    mean, variance = estimate(scene, device, spp=256).total
    assert mean == pytest.approx(1, abs=1e-3 + 4 * sqrt(variance))


@pytest.mark.parametrize("kind", ["interface", "hidden"])
def test_holes_in_what_does_not_show_are_none(kind, device):
    """For paths and for shadow rays alike: light sampling and none make the same picture."""
    holes = {"opacity": 0.4, "opacity_tint": (1, 0.3, 0.1), "medium_density": 1.0, "medium_albedo": 0.8}
    if kind == "interface":
        material = dl.materials.interface(**holes)
    else:
        material = dl.materials.dielectric(ior=1.0, priority=-1, **holes)
    scene = dl.Scene("holes")
    scene.add(floor(), dl.shapes.sphere((0, 1, 0), 0.9, material=material))
    if kind == "hidden":
        scene.add(dl.shapes.sphere((0, 1, 0), 1.2, material=dl.materials.interface(medium_density=0.3)))
    lamp = dl.materials.emissive(radiance=3, two_sided=True)
    scene.add(dl.shapes.quad((-2, 3, -2), (4, 0, 0), (0, 0, 4), material=lamp))
    scene.camera = dl.cameras.perspective(origin=(0, 2, 5), target=(0, 1, 0), vfov=30)
    lit, by_chance = (
        estimate(scene, device, spp=1024, seed=i, sampling=sampling) for i, sampling in enumerate(("light", "bsdf"))
    )
    assert_agree(lit, by_chance, comparisons=2)
