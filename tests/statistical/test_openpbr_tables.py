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
@pytest.mark.parametrize("ior", [1.15, 1.5, 2.7, 7.0])
def test_tables_are_the_albedos_of_single_scattering(ior: float, roughness: float, cosine: float) -> None:
    """Against brute force: samples of `dielectric` and `conductor`, which scatter once."""
    n = 200_000
    u = np.random.default_rng([int(100 * ior), int(100 * roughness), int(100 * cosine)]).random((n, 3))
    u = u.astype(np.float32).clip(0, 1 - 2**-24)
    wo, alpha = direction(cosine, 0.2), roughness**2
    for front in (True, False):
        s = Case("dielectric", {"ior": ior, "roughness": roughness}, front=front).sample(wo, u)
        t = testing.openpbr_albedos(tuple(wo), alpha, alpha, ior if front else 1 / ior)
        assert_mean(1 + s.power()[:, 0], 2 - t["lost"], comparisons=200, slack=0.003)
        if front:
            assert_mean(
                1 + np.where(s.transmitted, 0, s.power()[:, 0]), 1 + t["reflected"], comparisons=200, slack=0.0015
            )
    s = Case("conductor", {"roughness": roughness, "fresnel": "none", "reflectance": 1.0}).sample(wo, u)
    t = testing.openpbr_albedos(tuple(wo), alpha, alpha, 1.0)
    assert_mean(1 + s.power()[:, 0], 2 - t["facets_lose"], comparisons=200, slack=0.0015)


def stretched(roughness: float, stretch: float) -> tuple[float, float]:
    """Alpha along x and y whose mean square is that of isotropic facets; ax : ay = 1 + stretch : 1 - stretch."""
    unit = roughness**2 / np.sqrt(1 + stretch**2)
    return unit * (1 + stretch), unit * (1 - stretch)


@pytest.mark.parametrize("anisotropy", [0.3, 0.6, 0.9])
@pytest.mark.parametrize("roughness", [0.25, 0.55, 0.9])
@pytest.mark.parametrize("ior", [1.5, 2.0, 5.0])
def test_tables_of_anisotropic_facets(ior: float, roughness: float, anisotropy: float) -> None:
    """Against brute force, whichever the azimuth: within 0.004 of all light, losses from within glass within 0.01."""
    aspect = 1 - anisotropy
    axes = stretched(roughness, (1 - aspect) / (1 + aspect))
    rng = np.random.default_rng([int(100 * ior), int(100 * roughness), int(10 * anisotropy)])
    u = rng.random((100_000, 2))
    for cosine, turns in itertools.product((0.04, 0.1, 0.25, 0.4, 0.7), (0.0, 0.14, 0.25)):
        wo = direction(cosine, turns).astype(np.float64)
        for eta in (ior, 1 / ior):
            tables, brute = testing.openpbr_albedos(tuple(wo), *axes, eta), single_scattering(wo, *axes, eta, u)
            for name, value in brute.items():
                if name != "reflected" or eta > 1:
                    slack = 0.01 if name == "lost" and eta < 1 else 0.004
                    assert_mean(1 + value, 1 + tables[name], comparisons=2000, slack=slack)


@pytest.mark.parametrize(("anisotropy", "roughness"), [(0.3, 0.9), (0.6, 0.55), (0.6, 0.9), (0.9, 0.55), (0.9, 0.9)])
def test_means_of_anisotropic_facets(roughness: float, anisotropy: float) -> None:
    """The same for means over cosine-distributed directions."""
    aspect = 1 - anisotropy
    axes = stretched(roughness, (1 - aspect) / (1 + aspect))
    u = np.random.default_rng([int(100 * roughness), int(10 * anisotropy)]).random((400_000, 4))
    r, turns = np.sqrt(u[:, 2]), 2 * np.pi * u[:, 3]
    wo = np.stack([r * np.cos(turns), r * np.sin(turns), np.sqrt(1 - u[:, 2])], -1)
    tables, brute = testing.openpbr_albedos((0, 0, 1), *axes, 1.5), single_scattering(wo, *axes, 1.5, u)
    for name, value in brute.items():
        assert_mean(1 + value, 1 + tables[f"{name}_mean"], comparisons=20, slack=0.002)


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
    for roughness in (0.12, 0.3, 0.6, 1.0):
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
            assert got == pytest.approx(testing.openpbr_fuzz_albedo(cosine, roughness), abs=0.003)
