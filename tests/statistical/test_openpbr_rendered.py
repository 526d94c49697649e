"""OpenPBR in whole pictures: furnaces with an inside, subsurface against a walk by brute force, emission, mistakes."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import destello as dl
from bsdf_cases import direction
from stats import z_threshold

Floats = NDArray[np.float64]


def sphere(
    device: str, material: Any, *, spp: int = 256, radius: float = 1.0, depth: int = 4000
) -> tuple[Floats, Floats]:
    """Mean radiance of a sphere under a sky of radiance 1, seen from the front, and its standard error: (3,), (3,)."""
    s = dl.Scene()
    s.film.width = s.film.height = 12
    s.camera = dl.cameras.orthographic(origin=(0, 0, 5 * radius), target=(0, 0, 0), height=radius)
    s.environment = dl.environments.constant(radiance=1)
    s.add(dl.shapes.sphere(center=(0, 0, 0), radius=radius, material=material))
    s.render.max_depth, s.render.rr_depth = depth, depth
    pixels = np.asarray(dl.render(s, spp=spp, device=device, progress=False).array, np.float64).reshape(-1, 3)
    return pixels.mean(axis=0), pixels.std(axis=0) / np.sqrt(len(pixels))


def assert_radiance(got: tuple[Floats, Floats], expected: Any, slack: float) -> None:
    mean, sigma = got
    assert (np.abs(mean - expected) < slack + z_threshold(60) * sigma).all(), f"{mean} +- {sigma}, expected {expected}"


@pytest.mark.parametrize(
    "look",
    [
        {"subsurface_weight": 1.0, "subsurface_color": 1.0, "subsurface_radius": 0.5},
        {"transmission_weight": 1.0, "specular_roughness": 0.5},
        {"transmission_weight": 1.0, "transmission_depth": 1.0, "transmission_scatter": 1.0},
        {"transmission_weight": 0.4, "subsurface_weight": 0.5, "base_color": 1.0, "subsurface_color": 1.0},
        {"geometry_thin_walled": True, "transmission_weight": 0.5, "subsurface_weight": 0.5}
        | {"base_color": 1.0, "subsurface_color": 1.0},
    ],
    ids=["subsurface", "frosted", "milk", "mixture", "thin"],
)
def test_white_sphere_vanishes_in_the_furnace(device: str, look: dict[str, Any]) -> None:
    if "transmission_depth" in look:
        look = {**look, "transmission_color": float(np.exp(-1))}  # scattering alone, no absorption
    assert_radiance(sphere(device, dl.materials.openpbr(**look)), 1, 0.01)


def walk(albedo: float, g: float, held: float, n: int, rng: np.random.Generator) -> float:
    """Brute force: what a half space behind a diffuse boundary gives back of the light that has passed the boundary."""
    z = np.zeros(n)
    mu = np.sqrt(rng.random(n))  # downwards, cosine-distributed
    out = 0
    for _ in range(100_000):
        z = z + mu * -np.log1p(-rng.random(len(z)))
        up = z < 0
        leaves = up & (rng.random(len(z)) >= held)
        out += int(leaves.sum())
        u = rng.random(len(z))
        deflected = (1 + g * g - ((1 - g * g) / (1 - g + 2 * g * u)) ** 2) / (2 * g) if g else 1 - 2 * u
        sines = np.sqrt((1 - mu**2) * (1 - deflected**2))
        turned = mu * deflected + sines * np.cos(2 * np.pi * rng.random(len(z)))
        mu = np.where(up, np.sqrt(rng.random(len(z))), turned.clip(-1, 1))
        live = ~leaves & (up | (rng.random(len(z)) < albedo))
        z, mu = np.where(up, 0, z)[live], mu[live]
        if len(z) == 0:
            return out / n
    raise AssertionError("the walk did not end")


@pytest.mark.parametrize(("colour", "g"), [(0.2, 0.0), (0.5, 0.0), (0.8, 0.0), (0.8, 0.6)])
def test_subsurface_shows_its_colour(device: str, rng: np.random.Generator, colour: float, g: float) -> None:
    """A sphere of many mean free paths: what is not reflected comes back by subsurface_color; so does the walk."""
    from destello._core import testing

    medium = testing.openpbr_interior({"subsurface_weight": 1.0, "subsurface_color": colour}
                                      | {"subsurface_scatter_anisotropy": g, "specular_roughness": 0.3})  # fmt: skip
    albedo = medium["scattering"][0] / (medium["scattering"][0] + medium["absorption"][0])
    by_walk = walk(albedo, g, medium["held"], 20_000, rng)
    assert by_walk == pytest.approx(colour, abs=0.03)  # van de Hulst's formula is an approximation
    look = {"subsurface_weight": 1.0, "subsurface_color": colour, "subsurface_scatter_anisotropy": g}
    mean, sigma = sphere(
        device, dl.materials.openpbr(**look, subsurface_radius=0.001, subsurface_radius_scale=1.0), spp=128
    )
    reflected = testing.openpbr_albedos(tuple(direction(0.95, 0)), 0.09, 0.09, 1.5)["reflected"]
    assert_radiance((mean, sigma), reflected + (1 - reflected) * by_walk, 0.012)


def walk_in_a_ball(start: Floats, ahead: Floats, path: float, albedo: float, g: float, held: float,
                   rng: np.random.Generator) -> float:  # fmt: skip
    """Brute force: the share of walkers (N, 3) in a unit ball of a medium of that mean free path that leave it.

    From inside, the boundary sends the share `held` back, evenly.
    """
    x, d, out = start.copy(), ahead.copy(), 0
    for _ in range(100_000):
        b = (x * d).sum(1)
        exit_ = -b + np.sqrt(np.maximum(b * b - (x * x).sum(1) + 1, 0))
        fly = path * -np.log1p(-rng.random(len(x)))
        meets = fly >= exit_
        x = x + np.where(meets, exit_, fly)[:, None] * d
        leaves = meets & (rng.random(len(x)) >= held)
        out += int(leaves.sum())
        u = rng.random(len(x))
        cosine = (1 + g * g - ((1 - g * g) / (1 - g + 2 * g * u)) ** 2) / (2 * g) if g else 1 - 2 * u
        d = turned(np.where(meets[:, None], -x, d), np.where(meets, np.sqrt(u), cosine.clip(-1, 1)), rng)
        live = ~leaves & (meets | (rng.random(len(x)) < albedo))
        x, d = x[live], d[live]
        if len(x) == 0:
            return out / len(start)
    raise AssertionError("the walk did not end")


def turned(axis: Floats, cosine: Floats, rng: np.random.Generator) -> Floats:
    """Unit vectors (N, 3) at that cosine from `axis`, on any side."""
    a = axis / np.linalg.norm(axis, axis=1, keepdims=True)
    x = np.cross(a, np.where(np.abs(a[:, :1]) > 0.6, [0.0, 1, 0], [1.0, 0, 0]))
    x /= np.linalg.norm(x, axis=1, keepdims=True)
    phi, sine = 2 * np.pi * rng.random(len(a)), np.sqrt(1 - cosine**2)
    y = np.cross(a, x)
    return np.asarray(cosine[:, None] * a + sine[:, None] * (np.cos(phi)[:, None] * x + np.sin(phi)[:, None] * y))


def seen_points(n: int, rng: np.random.Generator) -> Floats:
    """Where the rays of `sphere`'s picture meet the unit sphere (N, 3)."""
    xy = rng.uniform(-0.5, 0.5, (n, 2))
    return np.concatenate([xy, np.sqrt(1 - (xy**2).sum(1, keepdims=True))], 1)


@pytest.mark.parametrize("weight", [0.0, 1.0])
@pytest.mark.parametrize("g", [0.0, 0.7])
def test_subsurface_in_a_ball_of_few_free_paths(device: str, rng: np.random.Generator, g: float, weight: float) -> None:
    """Each colour by its own radius and albedo, against walks; with and without the gloss of index 1.5."""
    from destello._core import testing

    look = {
        "subsurface_weight": 1.0, "subsurface_color": (0.9, 0.6, 0.8), "subsurface_radius": 0.4,
        "subsurface_radius_scale": (1.0, 0.5, 0.2), "subsurface_scatter_anisotropy": g, "specular_weight": weight,
    }  # fmt: skip
    medium, n = testing.openpbr_interior(look), 30_000
    start = seen_points(n, rng)
    views = [tuple(direction(z, 0)) for z in start[:200, 2]]
    gloss = np.mean([testing.openpbr_albedos(v, 0.09, 0.09, 1.5)["reflected"] for v in views]) * weight
    expected = []
    for k in range(3):
        path = 0.4 * look["subsurface_radius_scale"][k]
        albedo = medium["scattering"][k] * path
        ahead = turned(-start, np.sqrt(rng.random(n)), rng)
        expected.append(gloss + (1 - gloss) * walk_in_a_ball(start, ahead, path, albedo, g, medium["held"], rng))
    assert_radiance(sphere(device, dl.materials.openpbr(**look)), np.array(expected), 0.003 + 4 * 0.5 / np.sqrt(n))


@pytest.mark.parametrize("g", [-0.5, 0.8])
def test_scattering_in_clear_glass(device: str, rng: np.random.Generator, g: float) -> None:
    """Transmission with depth and scatter, without refraction, against walks."""
    colour, scatter, n = np.array([0.4, 0.6, 0.2]), np.array([0.3, 0.2, 1.0]), 30_000
    look = {
        "specular_weight": 0.0, "transmission_weight": 1.0, "transmission_depth": 0.5,
        "transmission_color": tuple(colour), "transmission_scatter": tuple(scatter),
        "transmission_scatter_anisotropy": g,
    }  # fmt: skip
    start = seen_points(n, rng)
    ahead = np.tile([0.0, 0, -1], (n, 1))
    expected = [
        walk_in_a_ball(start, ahead, 0.5 / -np.log(c), s / -np.log(c), g, 0.0, rng)
        for c, s in zip(colour, scatter, strict=True)
    ]
    assert_radiance(sphere(device, dl.materials.openpbr(**look)), np.array(expected), 0.003 + 4 * 0.5 / np.sqrt(n))


def test_emission_in_nits(device: str) -> None:
    material = dl.materials.openpbr(
        base_weight=0, specular_weight=0, emission_luminance=683.0, emission_color=(1, 0.5, 0)
    )
    mean, _ = sphere(device, material, spp=16)
    np.testing.assert_allclose(mean, (1, 0.5, 0), atol=1e-5)


def test_opacity(device: str) -> None:
    material = dl.materials.openpbr(base_weight=0, specular_weight=0, geometry_opacity=0.25)
    assert_radiance(sphere(device, material), 0.75**2, 0.002)  # front and back


@pytest.mark.parametrize(
    ("look", "message"),
    [
        ({"emission_luminance": 1.0, "emission": 1.0}, "emission_luminance"),
        ({"geometry_opacity": 0.5, "opacity": 0.5}, "geometry_opacity"),
        ({"subsurface_weight": 1.0, "medium_density": 1.0}, "medium_density"),
    ],
)
def test_what_goes_not_together_is_said(look: dict[str, Any], message: str) -> None:
    s = dl.Scene()
    s.add(dl.shapes.sphere(center=(0, 0, 0), radius=1, material=dl.materials.openpbr(**look)))
    with pytest.raises(dl.Error, match=message):
        s.compile()


def test_ranges_are_checked() -> None:
    indices = [(name, value) for name in ("specular_ior", "coat_ior") for value in (0.0, 9e-4, -1.5, np.nan, np.inf)]
    for name, value in [*indices, ("coat_weight", 1.5), ("base_color", (1, 2, 0))]:
        with pytest.raises(dl.Error, match=name):
            dl.materials.openpbr(**{name: value})
    for value in (1e-3, 1e30):
        dl.materials.openpbr(specular_ior=value, coat_ior=value)
    with pytest.raises((dl.Error, TypeError), match="specular_rougness"):
        dl.materials.openpbr(specular_rougness=0.5)
