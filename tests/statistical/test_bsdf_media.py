"""Phase functions and homogeneous media."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats as scipy_stats

from bsdf_cases import direction, rows
from destello._core import testing
from stats import ALPHA, assert_mean, chi2_directions, integrate_sphere, sidak

ASYMMETRY = [0.0, 0.01, 0.5, 0.9, -0.3, -0.8]
by_asymmetry = pytest.mark.parametrize("g", ASYMMETRY)


@by_asymmetry
def test_phase_samples_follow_density(g: float) -> None:
    for k, wo in enumerate((direction(0.3, 0.7), direction(1.0, 0), -direction(0.8, 0.1))):
        chi2_directions(
            lambda u, wo=wo: testing.phase_sample(g, rows(wo), rows(u.clip(0, 1 - 2**-24))),
            lambda d, wo=wo: testing.phase_pdf(g, rows(wo), rows(d)),
            seed=k + round(100 * g) + 200,
        ).check(comparisons=3 * len(ASYMMETRY))


@by_asymmetry
def test_phase_is_normalised_reciprocal_and_has_its_mean_cosine(g: float) -> None:
    wo = direction(0.3, 0.7)
    assert integrate_sphere(lambda d: testing.phase_pdf(g, rows(wo), rows(d))) == pytest.approx(1, abs=5e-4)
    u = np.random.default_rng(5).random((100_000, 3)).clip(0, 1 - 2**-24)
    wi = testing.phase_sample(g, rows(wo), rows(u)).astype(np.float64)
    assert_mean(-(wi @ wo.astype(np.float64)), g, comparisons=len(ASYMMETRY), slack=1e-5)
    assert np.allclose(np.linalg.norm(wi, axis=1), 1, atol=1e-6)
    np.testing.assert_allclose(
        testing.phase_pdf(g, rows(wo), rows(wi[:1000])), testing.phase_pdf(g, rows(wi[:1000]), rows(wo)), rtol=1e-4
    )


def test_isotropic_phase_is_uniform() -> None:
    d = np.random.default_rng(3).normal(size=(50, 3))
    np.testing.assert_allclose(testing.phase_pdf(0.0, rows((0, 0, 1)), rows(d)), 1 / (4 * np.pi), rtol=1e-6)


@pytest.mark.parametrize("density", [0.05, 1.0, 300.0])
def test_distances_are_exponential(density: float) -> None:
    medium = testing.Medium(density, 0.0)
    u = np.random.default_rng(11).random(50_000).astype(np.float32).clip(0, 1 - 2**-24)
    d = medium.sample_distance(u)
    assert scipy_stats.kstest(d, "expon", args=(0, 1 / density)).pvalue > sidak(3, ALPHA)
    assert np.isfinite(medium.sample_distance(np.array([0, 1 - 2**-24], np.float32))).all()
    for x in (0.1 / density, 2 / density):
        assert_mean(d > x, medium.free_flight(x), comparisons=6)


def test_beer_lambert() -> None:
    medium = testing.Medium(0.5, 2.0)
    assert medium.absorbed(0.7) == pytest.approx(np.exp(-1.4), rel=1e-6)
    assert medium.free_flight(0.7) == pytest.approx(np.exp(-0.35), rel=1e-6)
    assert medium.transmittance(0.7) == pytest.approx(np.exp(-1.75), rel=1e-6)
    assert medium.transmittance(0.3) * medium.transmittance(0.4) == pytest.approx(medium.transmittance(0.7), rel=1e-6)


def test_vacuum() -> None:
    vacuum = testing.Medium(0.0, 0.0)
    assert np.isposinf(vacuum.sample_distance(np.array([0.3], np.float32))).all()
    assert vacuum.transmittance(float("inf")) == 1
