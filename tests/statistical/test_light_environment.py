"""Environments: sampling against density, irradiance against closed forms and quadrature, orientation."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from destello import _core
from stats import assert_mean, chi2_directions, integrate_sphere

testing = _core.testing
Array = NDArray[np.float64]

LUMINANCE = np.array([0.2126, 0.7152, 0.0722])


def noise_image(width: int, height: int, power: int = 8) -> NDArray[np.float32]:
    rng = np.random.default_rng(width * 1000 + height)
    return (rng.random((height, width, 3)) ** power).astype(np.float32)


def sun_image() -> NDArray[np.float32]:
    image = noise_image(64, 32, 1) * np.float32(0.01)
    image[7, 40] = (5e4, 4e4, 3e4)
    image[20:, :] = 0  # no light from below
    return image


def turn(axis: tuple[float, float, float], degrees: float, scale: Any = 1.0) -> NDArray[np.float32]:
    """Rotation (3, 4) about an axis after a scaling, with a translation that must not matter."""
    a = np.asarray(axis) / np.linalg.norm(axis)
    k = np.array([[0, -a[2], a[1]], [a[2], 0, -a[0]], [-a[1], a[0], 0]])
    t = np.radians(degrees)
    r = (np.eye(3) + np.sin(t) * k + (1 - np.cos(t)) * k @ k) @ np.diag(np.broadcast_to(scale, 3))
    return np.concatenate([r, [[3], [4], [5]]], axis=1).astype(np.float32)


TILTED = turn((1, 2, 3), 77)
CASES: dict[str, tuple[str, dict[str, Any], Any, Any]] = {
    # every environment of the list with its defaults, and what shows more of it: type, parameters, image, transform
    **{name: (name, {}, noise_image(16, 8) if name == "image" else None, None) for name in testing.ENVIRONMENTS},
    "colour": ("constant", {"radiance": (3, 0, 0.5)}, None, TILTED),
    "tilted gradient": ("gradient", {"bottom": (0.2, 0.1, 0), "top": (1, 3, 5)}, None, TILTED),
    "dark ground": ("gradient", {"bottom": (0, 0, 0), "top": (1, 1, 1)}, None, None),
    "dark sky": ("gradient", {"bottom": (1, 1, 1), "top": (0, 0, 0)}, None, None),
    "black gradient": ("gradient", {"bottom": (0, 0, 0), "top": (0, 0, 0)}, None, None),
    "tilted image": ("image", {"strength": 2.5}, noise_image(16, 8), TILTED),
    "mirrored image": ("image", {}, noise_image(9, 5), turn((0, 1, 0), 30, (-1, 1, 1))),
    "sun": ("image", {}, sun_image(), None),
    "tilted sun": ("image", {}, sun_image(), TILTED),
    "one texel": ("image", {}, noise_image(1, 1), None),
    "one row": ("image", {}, noise_image(5, 1), None),
    "one column": ("image", {}, noise_image(1, 5), None),
    "black image": ("image", {}, np.zeros((4, 8, 3), np.float32), None),
}
BLACK = ("black gradient", "black image")


def make(case: str) -> Any:
    kind, params, image, transform = CASES[case]
    return testing.Environment(kind, params, image, transform)


def on_grid(u: Array) -> NDArray[np.float32]:
    return np.ascontiguousarray((np.floor(u * 2**24) / 2**24).astype(np.float32))


def rows(*vectors: Any) -> NDArray[np.float32]:
    return np.ascontiguousarray(vectors, dtype=np.float32)


@pytest.mark.parametrize("case", CASES)
def test_sampling_follows_the_density(case: str) -> None:
    e = make(case)
    result = chi2_directions(
        lambda u: e.sample(on_grid(u))["wi"],
        lambda w: e.eval(np.ascontiguousarray(w))[1],
        seed=2,
        samples=100_000,
        cells=(24, 24),
        dimensions=2,
    )
    assert result.mass == pytest.approx(1, abs=1e-3)
    result.check(comparisons=len(CASES))


@pytest.mark.parametrize("case", CASES)
def test_rays_see_what_was_sampled(case: str, rng: np.random.Generator) -> None:
    e = make(case)
    corners = np.array([[0, 0], [1, 1], [0, 1], [1, 0]]) * (1 - 2.0**-24)
    s = e.sample(on_grid(np.concatenate([rng.random((50_000, 2)), corners])))
    good = s["pdf"] > 0
    assert good[:-4].all()  # only the very ends of the numbers may give nothing
    assert np.isfinite(s["pdf"]).all()
    assert np.isfinite(s["radiance"]).all()
    assert not s["radiance"][~good].any()
    assert not s["delta"].any()
    assert np.isinf(s["distance"]).all()
    assert np.allclose(np.linalg.norm(s["wi"], axis=1), 1, atol=1e-6)
    radiance, pdf = e.eval(s["wi"])
    # Where a turned direction comes back rounded, a steep image is a little different.
    difference = np.abs(pdf[good] / s["pdf"][good] - 1)
    assert difference.max() < 2e-2
    assert np.quantile(difference, 0.99) < 2e-4
    assert np.allclose(radiance, s["radiance"], rtol=2e-2, atol=1e-4 * max(float(radiance.max()), 1e-30))


@pytest.mark.parametrize("case", CASES)
def test_what_shines_can_be_sampled(case: str, rng: np.random.Generator) -> None:
    e = make(case)
    w = testing.warp("sphere", on_grid(rng.random((200_000, 2))))
    axes = rows(*np.eye(3), *-np.eye(3), (1e-6, 1, 0), (0, -1, 1e-7))
    radiance, pdf = e.eval(np.concatenate([w, axes]))
    assert np.isfinite(radiance).all()
    assert np.isfinite(pdf).all()
    assert radiance.min() >= 0
    assert np.all(pdf[radiance.any(axis=1)] > 0)


@pytest.mark.parametrize("case", [c for c in CASES if c not in BLACK])
def test_importance_is_luminance(case: str, rng: np.random.Generator) -> None:
    # Luminance over density is nearly constant, so its mean, the power, comes out with little noise.
    e = make(case)
    s = e.sample(on_grid(rng.random((50_000, 2))))
    estimates = s["radiance"].astype(np.float64) @ LUMINANCE / s["pdf"]
    integral = e.power(2.0) / (4 * np.pi)
    assert_mean(estimates, integral, comparisons=len(CASES), slack=2e-4)
    assert estimates.std() / estimates.mean() < 0.2


@pytest.mark.parametrize("case", BLACK)
def test_black_environments_have_no_power(case: str) -> None:
    assert make(case).power(1.0) == 0


# --- irradiance -------------------------------------------------------------------------------------------------------

NORMALS = rows((0, 1, 0), (0, -1, 0), (1, 0, 0), (0.6, 0.0, -0.8), (-0.48, 0.6, 0.64))


def gradient_irradiance(params: dict[str, Any], transform: Any, normal: Array) -> Array:
    bottom, top = np.asarray(params.get("bottom", (1, 1, 1))), np.asarray(params.get("top", (0.5, 0.7, 1)))
    up = np.array([0, 1, 0]) if transform is None else np.asarray(transform)[:, 1]
    # Over the hemisphere, cos integrates to pi and (w . up) cos to 2/3 pi (n . up).
    return np.pi * (bottom + top) / 2 + 2 / 3 * np.pi * float(up @ normal) * (top - bottom) / 2


@pytest.mark.parametrize("case", CASES)
def test_irradiance_is_known(case: str, rng: np.random.Generator) -> None:
    kind, params, _, transform = CASES[case]
    e = make(case)
    s = e.sample(on_grid(rng.random((100_000, 2))))
    estimates = s["radiance"].astype(np.float64) / s["pdf"][:, None]
    for normal in NORMALS.astype(np.float64):
        cosine = np.maximum(s["wi"] @ normal, 0)[:, None]
        if kind == "constant":
            expected = np.pi * np.asarray(params.get("radiance", (1, 1, 1)))
        elif kind == "gradient":
            expected = gradient_irradiance(params, transform, normal)
        elif case in ("image", "mirrored image"):

            def arriving(w: NDArray[np.float32], channel: int, n: Array = normal) -> Array:
                return e.eval(np.ascontiguousarray(w))[0][:, channel].astype(np.float64) * np.maximum(w @ n, 0)

            expected = np.array([integrate_sphere(lambda w, c=c: arriving(w, c)) for c in range(3)])
        else:
            continue
        assert_mean(estimates * cosine, expected, comparisons=len(CASES) * len(NORMALS), slack=1e-3)


def test_one_texel_is_a_constant_environment() -> None:
    e = testing.Environment("image", {"strength": 2}, np.full((1, 1, 3), 1.5, np.float32))
    assert e.power(3.0) == pytest.approx(4 * np.pi**2 * 9 * 3, rel=1e-5)
    assert testing.Environment("constant", {"radiance": (3, 3, 3)}).power(3.0) == pytest.approx(e.power(3.0), rel=1e-5)


def test_a_sun_of_one_texel_is_sampled_almost_without_noise(rng: np.random.Generator) -> None:
    image = np.zeros((64, 128, 3), np.float32)
    image[20, 30] = 1e5
    e = testing.Environment("image", {}, image)
    s = e.sample(on_grid(rng.random((20_000, 2))))
    estimates = s["radiance"][:, 0] / s["pdf"]
    assert estimates.std() / estimates.mean() < 0.02  # sin(theta) is linear within a cell


# --- what is where ----------------------------------------------------------------------------------------------------


def test_gradient_is_the_books_sky() -> None:
    e = testing.Environment("gradient", {})
    w = rows((0, 1, 0), (0, -1, 0), (1, 0, 0), (0.6, 0.8, 0))
    expected = [(0.5, 0.7, 1), (1, 1, 1), (0.75, 0.85, 1), (0.55, 0.73, 1)]
    assert np.allclose(e.eval(w)[0], expected, atol=1e-6)


def image_and_directions() -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    image = np.arange(4 * 8 * 3, dtype=np.float32).reshape(4, 8, 3)
    v, u = np.meshgrid((np.arange(4) + 0.5) / 4, (np.arange(8) + 0.5) / 8, indexing="ij")
    return image, testing.equirect_to_direction(rows(*np.stack([u.ravel(), v.ravel()], -1)))


def test_texels_are_where_they_should_be() -> None:
    image, w = image_and_directions()
    radiance, _ = testing.Environment("image", {}, image).eval(w)
    assert np.allclose(radiance, image.reshape(-1, 3), atol=1e-4)


def test_between_texels_radiance_is_bilinear(rng: np.random.Generator) -> None:
    image = noise_image(8, 4, 1)
    uv = on_grid(rng.random((5000, 2)))
    x, y = uv[:, 0].astype(np.float64) * 8 - 0.5, uv[:, 1].astype(np.float64) * 4 - 0.5
    x0, y0 = np.floor(x).astype(int), np.floor(y).astype(int)
    tx, ty = (x - x0)[:, None], (y - y0)[:, None]

    def texel(row: NDArray[np.int64], column: NDArray[np.int64]) -> Array:
        return image[np.clip(row, 0, 3), column % 8].astype(np.float64)

    top = (1 - tx) * texel(y0, x0) + tx * texel(y0, x0 + 1)
    bottom = (1 - tx) * texel(y0 + 1, x0) + tx * texel(y0 + 1, x0 + 1)
    radiance, _ = testing.Environment("image", {}, image).eval(testing.equirect_to_direction(uv))
    away = (uv[:, 1] > 0.01) & (uv[:, 1] < 0.99)  # at the poles all u are one direction
    assert np.allclose(radiance[away], ((1 - ty) * top + ty * bottom)[away], atol=2e-4)


def test_transforms_turn_and_mirror_the_image() -> None:
    image, w = image_and_directions()
    for matrix in (TILTED, turn((1, 0, 0), -50, 3.0), turn((0, 0, 1), 200, (1, 1, -1))):
        turned = w.astype(np.float64) @ matrix[:, :3].astype(np.float64).T
        turned /= np.linalg.norm(turned, axis=1, keepdims=True)
        radiance, _ = testing.Environment("image", {}, image, matrix).eval(rows(*turned))
        assert np.allclose(radiance, image.reshape(-1, 3), atol=1e-3)


# --- bad images -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_texels_that_are_no_numbers_are_named(value: float) -> None:
    image = np.ones((4, 8, 3), np.float32)
    image[2, 5, 1] = value
    with pytest.raises(ValueError, match=r"column 5, row 2"):
        testing.Environment("image", {}, image)


def test_negative_texels_count_as_black() -> None:
    image = np.ones((4, 8, 3), np.float32)
    image[1, 2] = (-1, -2, 0.5)
    radiance, _ = testing.Environment("image", {}, image).eval(testing.equirect_to_direction(rows((2.5 / 8, 1.5 / 4))))
    assert np.allclose(radiance, (0, 0, 0.5), atol=1e-5)


def test_an_empty_image_is_refused() -> None:
    with pytest.raises(ValueError, match="0 x 4"):
        testing.Environment("image", {}, np.zeros((4, 0, 3), np.float32))
