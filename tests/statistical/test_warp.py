"""Maps from the unit square, against the densities they declare."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray

from destello import _core
from stats import chi2_directions, chi2_grid

testing = _core.testing
Array = NDArray[np.float64]
SAMPLES = 200_000


def on_grid(u: NDArray[np.float64]) -> NDArray[np.float32]:
    """Uniform numbers as the sampler makes them: multiples of 2^-24 below 1."""
    return np.ascontiguousarray((np.floor(u * 2**24) / 2**24).astype(np.float32))


def constant(value: float) -> Callable[[Array], Array]:
    return lambda p: np.full(len(p), value)


PLANE: dict[str, tuple[Callable[[Array], Array], Callable[[Array], Array], tuple[Array, Array]]] = {
    # name: (to the rectangle, density there, edges)
    "disk": (
        lambda p: np.stack([(p**2).sum(axis=1), np.arctan2(p[:, 1], p[:, 0])], -1),
        constant(1 / (2 * np.pi)),
        (np.linspace(0, 1, 21), np.linspace(-np.pi, np.pi, 25)),
    ),
    "normal": (
        lambda p: p,
        lambda p: np.exp(-0.5 * (p**2).sum(axis=1)) / (2 * np.pi),
        (np.linspace(-5, 5, 41), np.linspace(-5, 5, 41)),
    ),
    "triangle": (  # b1 and b2, where (b1, b2 / (1 - b1)) has density 2 (1 - b1) on the square
        lambda p: np.stack([p[:, 0], p[:, 1] / np.maximum(1 - p[:, 0], 1e-12)], -1),
        lambda p: 2 * (1 - p[:, 0]),
        (np.linspace(0, 1, 21), np.linspace(0, 1, 21)),
    ),
}


@pytest.mark.parametrize("name", PLANE)
def test_plane_warps_follow_their_density(name: str, rng: np.random.Generator) -> None:
    to_rectangle, density, edges = PLANE[name]
    p = testing.warp(name, on_grid(rng.random((SAMPLES, 2)))).astype(np.float64)
    chi2_grid(to_rectangle(p), density, edges).check(comparisons=len(PLANE))


CONES = [2.0, 1.0, 0.5, 1e-3, 1e-6]
SPHERE: dict[str, tuple[float, Callable[[NDArray[np.float32]], Array]]] = {
    "sphere": (0, lambda w: np.full(len(w), 1 / (4 * np.pi))),
    "cosine_hemisphere": (0, lambda w: np.maximum(w[:, 2].astype(np.float64), 0) / np.pi),
}


@pytest.mark.parametrize("name", SPHERE)
def test_sphere_warps_follow_their_density(name: str) -> None:
    _, density = SPHERE[name]
    result = chi2_directions(lambda u: testing.warp(name, on_grid(u)), density, seed=1, samples=SAMPLES, dimensions=2)
    assert result.mass == pytest.approx(1, abs=1e-4)
    result.check(comparisons=len(SPHERE))


@pytest.mark.parametrize("one_minus_cos", CONES)
def test_cone_is_uniform_at_any_width(one_minus_cos: float, rng: np.random.Generator) -> None:
    w = testing.warp("cone", on_grid(rng.random((SAMPLES, 2))), one_minus_cos).astype(np.float64)
    # The height below the pole, from the distance to the axis: 1 - z itself would cancel in a narrow cone.
    r2 = w[:, 0] ** 2 + w[:, 1] ** 2
    h = np.where(w[:, 2] > 0, r2 / (1 + np.sqrt(np.maximum(1 - r2, 0))), 1 - w[:, 2]) / one_minus_cos
    assert h.max() < 1 + 1e-5
    p = np.stack([np.minimum(h, 1 - 1e-12), np.arctan2(w[:, 1], w[:, 0])], -1)
    edges = (np.linspace(0, 1, 21), np.linspace(-np.pi, np.pi, 25))
    chi2_grid(p, constant(1 / (2 * np.pi)), edges).check(comparisons=len(CONES))


def test_ball_is_uniform(rng: np.random.Generator) -> None:
    p = testing.warp("ball", on_grid(rng.random((SAMPLES, 3)))).astype(np.float64)
    r = np.linalg.norm(p, axis=1)
    assert r.max() <= 1 + 1e-6
    volume = np.minimum(r**3, 1 - 1e-12)  # of the ball inside, uniform
    height = p[:, 2] / np.maximum(r, 1e-12)
    angle = np.arctan2(p[:, 1], p[:, 0])
    unit, z, phi = np.linspace(0, 1, 17), np.linspace(-1, 1, 17), np.linspace(-np.pi, np.pi, 17)
    for x, y, edges in ((volume, height, (unit, z)), (volume, angle, (unit, phi)), (height, angle, (z, phi))):
        area = (edges[0][-1] - edges[0][0]) * (edges[1][-1] - edges[1][0])
        chi2_grid(np.stack([np.clip(x, edges[0][0], edges[0][-1]), y], -1), constant(1 / area), edges).check(
            comparisons=3
        )


@pytest.mark.parametrize("name", ["disk", "normal", "triangle", "cosine_hemisphere", "sphere", "cone", "ball"])
def test_corners_of_the_square_are_in_the_domain(name: str) -> None:
    ends = np.array([0, 2.0**-24, 0.25, 0.5, 0.75, 1 - 2.0**-24], np.float32)
    u = np.stack(np.meshgrid(*[ends] * (3 if name == "ball" else 2)), -1)
    p = testing.warp(name, np.ascontiguousarray(u.reshape(-1, u.shape[-1]))).astype(np.float64)
    assert np.isfinite(p).all()
    if name == "triangle":
        assert p.min() >= 0
        assert p.sum(axis=1).max() <= 1
    if name in ("cosine_hemisphere", "sphere", "cone"):
        assert np.allclose(np.linalg.norm(p, axis=1), 1, atol=2e-7)
    if name == "cosine_hemisphere":
        assert p[:, 2].min() >= 0


def test_disk_keeps_neighbours_together(rng: np.random.Generator) -> None:
    # Continuous, also over the diagonals of the square and the line where the angle wraps.
    u = rng.random((20_000, 2))
    v = np.clip(u + rng.normal(0, 1e-3, u.shape), 0, 1)
    a, b = (testing.warp("disk", x.astype(np.float32)).astype(np.float64) for x in (u, v))
    assert np.all(np.linalg.norm(a - b, axis=1) <= 4 * np.linalg.norm(u - v, axis=1) + 1e-6)


def test_sincos_turns_is_accurate() -> None:
    u = np.concatenate([np.linspace(-1, 1, 2_000_001), [0, 0.125, 0.25, 0.5, 0.75, 1]]).astype(np.float32)
    exact = 2 * np.pi * u.astype(np.float64)
    got = testing.sincos_turns(u).astype(np.float64)
    assert np.abs(got[:, 0] - np.sin(exact)).max() < 1e-7
    assert np.abs(got[:, 1] - np.cos(exact)).max() < 1e-7
    quarters = testing.sincos_turns(np.array([0, 0.25, 0.5, 0.75, 1], np.float32))
    assert np.array_equal(np.abs(quarters), [[0, 1], [1, 0], [0, 1], [1, 0], [0, 1]])


def test_log_of_unit_is_accurate() -> None:
    # Every number that the sampler can ask for, and smaller ones.
    for first in range(0, 2**24, 2**20):
        x = (np.arange(first + 1, first + 2**20 + 1) / 2**24).astype(np.float32)
        if first == 0:
            x = np.concatenate([x, np.geomspace(2.0**-126, 1, 100_001).astype(np.float32)])
        x = x[x < 1]
        exact = np.log(x.astype(np.float64))
        assert np.abs(testing.log_of_unit(x) / exact - 1).max() < 1.2e-7
    assert testing.log_of_unit(np.ones(1, np.float32))[0] == 0


def test_forms_for_loops_give_the_same_bits(rng: np.random.Generator) -> None:
    special = np.array([0, 0.125, 0.25, 0.375, 0.5, 0.625, 0.75, 0.875, 1 - 2**-24])
    u = on_grid(np.concatenate([np.stack(np.meshgrid(special, special), -1).reshape(-1, 2), rng.random((SAMPLES, 2))]))
    one, many = (testing.warp(name, u) for name in ("disk", "disk_side_by_side"))
    assert np.array_equal(one.view(np.uint32), many.view(np.uint32))
    turns = np.concatenate([u[:, 0], np.linspace(0, 1, 100_001, dtype=np.float32)])
    one, many = testing.sincos_turns(turns), testing.sincos_turns_side_by_side(turns)
    assert np.array_equal(one.view(np.uint32), many.view(np.uint32))


LINEAR = [(0.0, 1.0), (1.0, 0.0), (1.0, 1.0), (0.2, 3.0), (1e-20, 2e-20), (1e20, 3e20), (0.0, 0.0)]


@pytest.mark.parametrize(("a", "b"), LINEAR)
def test_linear_density(a: float, b: float, rng: np.random.Generator) -> None:
    out = testing.linear(on_grid(rng.random(SAMPLES)), a, b).astype(np.float64)
    x, pdf = out[:, 0], out[:, 1]
    assert x.min() >= 0
    assert x.max() < 1

    def density(p: Array) -> Array:
        if a + b == 0:
            return np.ones(len(p))
        return 2 * (a + p[:, 0] * (b - a)) / (a + b)

    assert np.allclose(pdf, density(x[:, None]), rtol=1e-5, atol=1e-6)
    p = np.stack([x, rng.random(SAMPLES)], -1)
    chi2_grid(p, density, (np.linspace(0, 1, 51), np.linspace(0, 1, 2))).check(comparisons=len(LINEAR))


@pytest.mark.parametrize("seed", range(3))
def test_equirectangular_map_and_its_inverse(seed: int) -> None:
    rng = np.random.default_rng(seed)
    uv = on_grid(rng.random((10_000, 2)) * [1, 0.98] + [0, 0.01])
    w = testing.equirect_to_direction(uv)
    assert np.allclose(np.linalg.norm(w, axis=1), 1, atol=1e-6)
    back = testing.direction_to_equirect(w)
    du = np.abs(back[:, 0] - uv[:, 0])
    assert np.minimum(du, 1 - du).max() < 1e-5
    assert np.abs(back[:, 1] - uv[:, 1]).max() < 1e-6


def test_equirectangular_convention() -> None:
    uv = np.array([[0.5, 0.5], [0.75, 0.5], [0.25, 0.5], [0, 0.5], [1, 0.5], [0.3, 0], [0.3, 1]], np.float32)
    axes = [[0, 0, -1], [1, 0, 0], [-1, 0, 0], [0, 0, 1], [0, 0, 1], [0, 1, 0], [0, -1, 0]]
    assert np.allclose(testing.equirect_to_direction(uv), axes, atol=1e-6)
