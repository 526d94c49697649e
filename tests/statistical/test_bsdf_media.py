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


def medium(density: float | tuple[float, ...], absorption: float | tuple[float, ...] = 0.0, albedo: float = 1.0):
    return testing.Medium(*(rows(np.broadcast_to(np.float32(v), 3)) for v in (density, absorption, albedo)))


@pytest.mark.parametrize("density", [0.05, 1.0, 300.0])
def test_distances_are_exponential(density: float) -> None:
    grey = medium(density)
    u = np.random.default_rng(11).random(50_000).astype(np.float32).clip(0, 1 - 2**-24)
    d = testing.Medium.sample_distance(density, u)
    assert scipy_stats.kstest(d, "expon", args=(0, 1 / density)).pvalue > sidak(3, ALPHA)
    assert np.isfinite(testing.Medium.sample_distance(density, np.array([0, 1 - 2**-24], np.float32))).all()
    for x in (0.1 / density, 2 / density):
        assert_mean(d > x, grey.free_flight(x)[0], comparisons=6)


def test_beer_lambert() -> None:
    m = medium((0.5, 1.0, 0.0), (2.0, 0.0, 3.0))
    assert m.absorbed(0.7) == pytest.approx(np.exp([-1.4, 0, -2.1]), rel=1e-6)
    assert m.free_flight(0.7) == pytest.approx(np.exp([-0.35, -0.7, 0]), rel=1e-6)
    assert m.transmittance(0.7) == pytest.approx(np.exp([-1.75, -0.7, -2.1]), rel=1e-6)
    parts = np.multiply(m.transmittance(0.3), m.transmittance(0.4))
    assert parts == pytest.approx(np.asarray(m.transmittance(0.7)), rel=1e-6)


def test_vacuum() -> None:
    vacuum = medium(0.0)
    assert np.isposinf(testing.Medium.sample_distance(0.0, np.array([0.3], np.float32))).all()
    assert vacuum.transmittance(float("inf")) == (1, 1, 1)
    distance, weight, collides = vacuum.fly(rows((1, 1, 1)), rows((0.3, 0.999, 0)), float("inf"))
    assert np.isposinf(distance).all()
    assert (weight == 1).all()
    assert not collides.any()


DENSITY, ABSORPTION, ALBEDO = np.array([0.4, 2.0, 9.0]), np.array([0.3, 0.0, 0.1]), 0.7
CARRIED = [(1.0, 1.0, 1.0), (0.0, 0.2, 3.0), (5.0, 1e-4, 0.1)]


@pytest.mark.parametrize("carried", CARRIED)
def test_chromatic_flight(carried: tuple[float, ...]) -> None:
    """Each colour gets what a medium of its own density alone would give, and all together never more than before."""
    m, end = medium(tuple(DENSITY), tuple(ABSORPTION), ALBEDO), 0.8
    u = np.random.default_rng(17).random((200_000, 3)).clip(0, 1 - 2**-24)
    distance, weight, collides = m.fly(rows(carried), rows(u), end)
    hit, held = collides > 0, np.array(carried) > 0
    comparisons = 4 * len(CARRIED)
    left = np.exp(-(DENSITY + ABSORPTION) * end)
    assert_mean((weight * ~hit[:, None])[:, held], left[held], comparisons=comparisons, slack=1e-5)
    scattered = ALBEDO * DENSITY / (DENSITY + ABSORPTION) * (1 - left)
    assert_mean((weight * hit[:, None])[:, held], scattered[held], comparisons=comparisons, slack=1e-5)
    near = hit & (distance < 0.2)
    before = ALBEDO * DENSITY / (DENSITY + ABSORPTION) * (1 - np.exp(-(DENSITY + ABSORPTION) * 0.2))
    assert_mean((weight * near[:, None])[:, held], before[held], comparisons=comparisons, slack=1e-5)
    assert distance[~hit] == pytest.approx(end)
    after = (weight * np.array(carried, np.float32)).sum(1)
    assert after.max() <= np.sum(carried) * (1 + 1e-5)


def test_grey_media_are_a_special_case_of_chromatic_ones() -> None:
    m = medium(1.7, (0.3, 0.0, 0.1), 0.6)
    u = rows(np.random.default_rng(19).random((1000, 3)).clip(0, 1 - 2**-24))
    for one, other in zip(m.fly(rows((1, 2, 3)), u, 0.5), m.fly(rows((1, 2, 3)), u, 0.5, grey=True), strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-5)
