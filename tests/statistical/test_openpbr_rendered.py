"""OpenPBR in whole pictures: furnaces with an inside, subsurface against a walk by brute force, emission, mistakes."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import destello as dl
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
    reflected = testing.openpbr_albedos(0.95, 0.3, 1.5)["reflected"]
    assert_radiance((mean, sigma), reflected + (1 - reflected) * by_walk, 0.012)


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
        ({"subsurface_weight": 1.0, "subsurface_color": dl.textures.checker()}, "subsurface_color"),
    ],
)
def test_what_goes_not_together_is_said(look: dict[str, Any], message: str) -> None:
    s = dl.Scene()
    s.add(dl.shapes.sphere(center=(0, 0, 0), radius=1, material=dl.materials.openpbr(**look)))
    with pytest.raises(dl.Error, match=message):
        s.compile()


def test_ranges_are_checked() -> None:
    for name, value in (("specular_ior", 0.3), ("coat_ior", 3.1), ("coat_weight", 1.5), ("base_color", (1, 2, 0))):
        with pytest.raises(dl.Error, match=name):
            dl.materials.openpbr(**{name: value})
    with pytest.raises((dl.Error, TypeError), match="specular_rougness"):
        dl.materials.openpbr(specular_rougness=0.5)
