"""OpenPBR's tables of albedos against brute force."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from numpy.typing import NDArray

from bsdf_cases import Case, direction
from destello._core import testing
from stats import assert_mean

Floats = NDArray[np.float64]


@pytest.mark.parametrize("cosine", [0.1, 0.35, 0.6, 0.97])
@pytest.mark.parametrize("roughness", [0.13, 0.45, 0.77, 1.0])
@pytest.mark.parametrize("ior", [1.15, 1.5, 2.7])
def test_tables_are_the_albedos_of_single_scattering(ior: float, roughness: float, cosine: float) -> None:
    """Against brute force: samples of `dielectric` and `conductor`, which scatter once."""
    n = 200_000
    u = np.random.default_rng([int(100 * ior), int(100 * roughness), int(100 * cosine)]).random((n, 3))
    u = u.astype(np.float32).clip(0, 1 - 2**-24)
    wo = direction(cosine, 0.2)
    for front in (True, False):
        s = Case("dielectric", {"ior": ior, "roughness": roughness}, front=front).sample(wo, u)
        t = testing.openpbr_albedos(cosine, roughness, ior if front else 1 / ior)
        assert_mean(1 + s.power()[:, 0], 2 - t["lost"], comparisons=200, slack=0.004)
        if front:
            assert_mean(
                1 + np.where(s.transmitted, 0, s.power()[:, 0]), 1 + t["reflected"], comparisons=200, slack=0.0015
            )
    s = Case("conductor", {"roughness": roughness, "fresnel": "none", "reflectance": 1.0}).sample(wo, u)
    t = testing.openpbr_albedos(cosine, roughness, 1.0)
    assert_mean(1 + s.power()[:, 0], 2 - t["facets_lose"], comparisons=200, slack=0.0015)


def stretched(roughness: float, stretch: float) -> tuple[float, float]:
    """Alpha along x and y whose mean square is that of isotropic facets; ax : ay = 1 + stretch : 1 - stretch."""
    unit = roughness**2 / np.sqrt(1 + stretch**2)
    return unit * (1 + stretch), unit * (1 - stretch)


@pytest.mark.parametrize("anisotropy", [0.3, 0.6, 0.9])
@pytest.mark.parametrize("roughness", [0.25, 0.55, 0.9])
@pytest.mark.parametrize("ior", [1.5, 2.0])
def test_tables_of_anisotropic_facets(ior: float, roughness: float, anisotropy: float) -> None:
    """Against brute force, whichever the azimuth: within 0.03 of all light, and within 0.45 of what anisotropy changes.

    The latter (root mean squares over directions) is 1 for tables that take no notice of anisotropy. The same random
    numbers tell what isotropic facets of the same mean square do, so most of the noise goes out of the change.
    """
    aspect = 1 - anisotropy
    axes, round_axes = stretched(roughness, (1 - aspect) / (1 + aspect)), stretched(roughness, 0.0)
    rng = np.random.default_rng([int(100 * ior), int(100 * roughness), int(10 * anisotropy)])
    u = rng.random((100_000, 2))
    found: dict[str, list[tuple[float, float]]] = {}
    for cosine, turns in itertools.product((0.1, 0.25, 0.4, 0.7), (0.0, 0.14, 0.25)):
        wo = direction(cosine, turns).astype(np.float64)
        for eta in (ior, 1 / ior):
            tables, round_tables = (testing.openpbr_stretched_losses(tuple(wo), *a, eta) for a in (axes, round_axes))
            brute, round_brute = (single_scattering(wo, *a, eta, u) for a in (axes, round_axes))
            for name, value in brute.items():
                if name != "reflected" or eta > 1:
                    assert_mean(1 + value, 1 + tables[name], comparisons=2000, slack=0.03)
                change = (tables[name] - round_tables[name], float((value - round_brute[name]).mean()))
                found.setdefault(name, []).append(change)
    for name in ("lost", "facets_lose"):  # the reflected share has no table of its own
        ours, brute_force = np.array(found[name]).T
        off = np.linalg.norm(ours - brute_force) / np.linalg.norm(brute_force)
        assert off < 0.45, f"{name}: {off:.2f}"


@pytest.mark.parametrize(("anisotropy", "roughness"), [(0.3, 0.9), (0.6, 0.55), (0.6, 0.9), (0.9, 0.55), (0.9, 0.9)])
def test_means_of_anisotropic_facets(roughness: float, anisotropy: float) -> None:
    """The same for means over cosine-distributed directions."""
    aspect = 1 - anisotropy
    axes, round_axes = stretched(roughness, (1 - aspect) / (1 + aspect)), stretched(roughness, 0.0)
    u = np.random.default_rng([int(100 * roughness), int(10 * anisotropy)]).random((400_000, 4))
    r, turns = np.sqrt(u[:, 2]), 2 * np.pi * u[:, 3]
    wo = np.stack([r * np.cos(turns), r * np.sin(turns), np.sqrt(1 - u[:, 2])], -1)
    tables, round_tables = (testing.openpbr_stretched_losses((0, 0, 1), *a, 1.5) for a in (axes, round_axes))
    brute, round_brute = (single_scattering(wo, *a, 1.5, u) for a in (axes, round_axes))
    for name, value in brute.items():
        assert_mean(1 + value, 1 + tables[f"{name}_mean"], comparisons=20, slack=0.005)
    change = tables["facets_lose_mean"] - round_tables["facets_lose_mean"]
    brute_change = (brute["facets_lose"] - round_brute["facets_lose"]).mean()
    assert abs(change - brute_change) < 0.45 * abs(brute_change)


def single_scattering(wo: Floats, ax: float, ay: float, eta: float, u: Floats) -> dict[str, Floats]:
    """Samples (N,) of what single scattering loses and reflects between dielectrics, and where facets reflect all.

    wo: one direction (3,), or one for each sample. Normals are drawn from the slopes' own distribution, not as the core
    draws them, and weighted by Walter et al. 2007.
    """
    r = np.sqrt(u[:, 0] / (1 - u[:, 0]))
    h = np.stack([-ax * r * np.cos(2 * np.pi * u[:, 1]), -ay * r * np.sin(2 * np.pi * u[:, 1]), np.ones_like(r)], -1)
    h /= np.linalg.norm(h, axis=-1, keepdims=True)
    c = (h * wo).sum(axis=-1)
    cos2 = 1 - (1 - c**2) / eta**2
    t = np.sqrt(np.maximum(cos2, 0))
    a = np.abs(c)
    s, p = (a - eta * t) / (a + eta * t), (eta * a - t) / (eta * a + t)
    f = np.where(cos2 > 0, (s**2 + p**2) / 2, 1)

    def root(w: Floats) -> Floats:
        return np.asarray(np.sqrt(1 + ((ax * w[..., 0]) ** 2 + (ay * w[..., 1]) ** 2) / w[..., 2] ** 2))

    def kept(wi: Floats, side: float) -> Floats:
        ok = (side * wi[:, 2] > 0) & (c > 0)
        g = 2 / (root(wo) + root(np.where(ok[:, None], wi, [0, 0, 1])))
        return np.asarray(np.where(ok, g * c / (wo[..., 2] * h[:, 2]), 0))

    up = kept(2 * c[:, None] * h - wo, 1)
    down = kept(h * (c / eta - t)[:, None] - wo / eta, -1)
    return {"lost": 1 - f * up - (1 - f) * down, "facets_lose": 1 - up, "reflected": f * up}


def test_fuzz_albedo_by_quadrature() -> None:
    for roughness in (0.3, 0.6, 1.0):
        c = Case(
            "openpbr",
            {"base_color": 0.0, "specular_weight": 0.0, "fuzz_weight": 1.0, "fuzz_roughness": roughness},
        )
        for cosine in (0.1, 0.5, 0.9):
            wo = direction(cosine, 0.3)
            z, w = np.polynomial.legendre.leggauss(64)
            phi = (np.arange(64) + 0.5) / 64
            wi = np.array([direction((a + 1) / 2, b) for a in z for b in phi])
            got = (c.eval(wo, wi)[:, 0].reshape(64, 64).mean(axis=1) * w / 2).sum() * 2 * np.pi
            assert got == pytest.approx(testing.openpbr_albedos(cosine, roughness, 1.0)["fuzz"], abs=0.01)
