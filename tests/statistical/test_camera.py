"""Cameras: where their rays start and go."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from destello import _core
from stats import chi2_grid

testing = _core.testing
Array = NDArray[np.float64]

PLACED = {"origin": (1, 2, 3), "target": (4, 6, 3), "up": (0, 0, 1)}
FORWARD, RIGHT, UP = np.array([0.6, 0.8, 0]), np.array([0.8, -0.6, 0]), np.array([0, 0, 1])
SIZE = (320, 180)


def rows(*vectors: Any) -> NDArray[np.float32]:
    return np.ascontiguousarray(vectors, dtype=np.float32)


def rays(
    kind: str, film: Any, params: dict[str, Any] | None = None, size: Any = SIZE, lens: Any = None
) -> tuple[Array, Array]:
    film = rows(*film)
    lens = np.full((len(film), 2), 0.3, np.float32) if lens is None else rows(*lens)
    origin, direction = testing.camera(kind, PLACED | (params or {}), *size, film, lens)
    return origin.astype(np.float64), direction.astype(np.float64)


@pytest.mark.parametrize("kind", testing.CAMERAS)
def test_every_camera_looks_at_its_target(kind: str) -> None:
    width, height = SIZE
    center, right, up = (width / 2, height / 2), (width / 2 + 20, height / 2), (width / 2, height / 2 - 20)
    origin, direction = rays(kind, [center, right, up])
    assert np.allclose(np.linalg.norm(direction, axis=1), 1, atol=1e-6)
    assert np.allclose(direction[0], FORWARD, atol=1e-6)
    assert np.allclose(origin[0], PLACED["origin"], atol=1e-6)
    ahead = origin + 5 * direction - origin[0] - 5 * direction[0]  # where the points 5 m ahead lie from the centre's
    assert ahead[1] @ RIGHT > 0.01
    assert abs(ahead[1] @ UP) < 1e-5
    assert ahead[2] @ UP > 0.01
    assert abs(ahead[2] @ RIGHT) < 1e-5


@pytest.mark.parametrize("kind", testing.CAMERAS)
@pytest.mark.parametrize(
    ("params", "message"),
    [
        ({"target": (1, 2, 3)}, "target must differ from origin"),
        ({"up": (3, 4, 0)}, "up must not be 0 or parallel"),
        ({"up": (0, 0, 0)}, "up must not be 0 or parallel"),
    ],
)
def test_impossible_placements_are_told(kind: str, params: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        rays(kind, [(0, 0)], params)


# --- perspective ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("size", [(320, 180), (180, 320), (100, 100), (1, 1)])
@pytest.mark.parametrize("vfov", [1.0, 40, 90, 150])
def test_field_of_view_is_vertical_and_pixels_are_square(size: tuple[int, int], vfov: float) -> None:
    width, height = size
    edges = [(width / 2, 0), (width / 2, height), (0, height / 2), (width, height / 2)]
    _, d = rays("perspective", edges, {"vfov": vfov}, size)
    half = np.tan(np.radians(vfov / 2))
    slope = np.stack([d @ RIGHT, d @ UP], -1) / (d @ FORWARD)[:, None]
    aspect = width / height
    assert np.allclose(slope, [(0, half), (0, -half), (-half * aspect, 0), (half * aspect, 0)], rtol=1e-5, atol=1e-6)


def test_pinhole_rays_start_at_the_origin(rng: np.random.Generator) -> None:
    origin, _ = rays("perspective", rng.random((100, 2)) * SIZE, lens=rng.random((100, 2)))
    assert np.array_equal(origin, np.broadcast_to(PLACED["origin"], origin.shape))


@pytest.mark.parametrize("focus", [0.5, 5.0, 30.0])
def test_lens_rays_of_a_film_point_meet_on_the_plane_of_focus(focus: float, rng: np.random.Generator) -> None:
    for film in rng.random((10, 2)) * SIZE:
        lens = rng.random((500, 2))
        params = {"aperture_radius": 0.2, "focus_distance": focus}
        origin, d = rays("perspective", np.broadcast_to(film, (500, 2)), params, lens=lens)
        meeting = (
            origin + d * (focus / (d @ FORWARD) - ((origin - PLACED["origin"]) @ FORWARD) / (d @ FORWARD))[:, None]
        )
        _, pinhole = rays("perspective", [film])
        expected = PLACED["origin"] + pinhole[0] * focus / (pinhole[0] @ FORWARD)
        assert np.allclose(meeting, expected, atol=2e-6 * (focus + 4))


def test_the_lens_is_a_uniform_disk(rng: np.random.Generator) -> None:
    film = np.broadcast_to((20, 30), (100_000, 2))
    lens = np.floor(rng.random((100_000, 2)) * 2**24) / 2**24
    origin, _ = rays("perspective", film, {"aperture_radius": 0.5}, lens=lens)
    offset = origin - PLACED["origin"]
    assert np.abs(offset @ FORWARD).max() < 1e-6
    x, y = offset @ RIGHT, offset @ UP
    r2 = (x * x + y * y) / 0.25
    assert r2.max() < 1 + 1e-5
    p = np.stack([np.minimum(r2, 1), np.arctan2(y, x)], -1)
    edges = (np.linspace(0, 1, 17), np.linspace(-np.pi, np.pi, 17))
    chi2_grid(p, lambda q: np.full(len(q), 1 / (2 * np.pi)), edges).check()


def test_focus_distance_zero_means_the_target(rng: np.random.Generator) -> None:
    film, lens = rng.random((200, 2)) * SIZE, rng.random((200, 2))
    a = rays("perspective", film, {"aperture_radius": 0.1}, lens=lens)
    b = rays("perspective", film, {"aperture_radius": 0.1, "focus_distance": 5}, lens=lens)
    assert np.allclose(a, b, atol=1e-6)


# --- orthographic -----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("size", [(320, 180), (180, 320)])
def test_orthographic_rays_are_parallel_and_cover_the_height(size: tuple[int, int]) -> None:
    width, height = size
    film = [(0, 0), (width, 0), (0, height), (width, height), (width / 2, height / 2)]
    origin, d = rays("orthographic", film, {"height": 3}, size)
    assert np.allclose(d, FORWARD, atol=1e-6)
    offset = origin - PLACED["origin"]
    x, y = 1.5 * width / height, 1.5
    expected = np.array([(-x, y), (x, y), (-x, -y), (x, -y), (0, 0)])
    assert np.allclose(np.stack([offset @ RIGHT, offset @ UP], -1), expected, atol=1e-5)
    assert np.abs(offset @ FORWARD).max() < 1e-6


# --- panorama ---------------------------------------------------------------------------------------------------------


def test_panorama_covers_the_sphere(rng: np.random.Generator) -> None:
    # Film points spread by the sine of the polar angle are uniform directions.
    z = 1 - 2 * rng.random(100_000)
    film = np.stack([rng.random(100_000) * 320, np.arccos(z) / np.pi * 160], -1)
    _, d = rays("panorama", film, size=(320, 160))
    p = np.stack([np.clip(d[:, 2], -1, 1), np.arctan2(d[:, 1], d[:, 0])], -1)
    edges = (np.linspace(-1, 1, 21), np.linspace(-np.pi, np.pi, 21))
    chi2_grid(p, lambda q: np.full(len(q), 1 / (4 * np.pi)), edges).check()


def test_panorama_shows_an_environment_image_as_it_is() -> None:
    width, height = 24, 12
    image = np.random.default_rng(1).random((height, width, 3)).astype(np.float32)
    y, x = np.mgrid[:height, :width] + 0.5
    straight = {"origin": (7, 8, 9), "target": (7, 8, 8), "up": (0, 1, 0)}
    _, d = rays("panorama", np.stack([x.ravel(), y.ravel()], -1), straight, size=(width, height))
    seen, _ = testing.Environment("image", {}, image).eval(rows(*d))
    assert np.allclose(seen.reshape(image.shape), image, atol=1e-4)


def test_panorama_goes_on_around_its_edges() -> None:
    _, d = rays("panorama", [(-5, 40), (315, 40), (325, 40), (5, 40)], size=(320, 160))
    assert np.allclose(d[0], d[1], atol=1e-5)
    assert np.allclose(d[2], d[3], atol=1e-5)
    _, d = rays("panorama", [(100, -3), (260, 3), (100, 163), (260, 157)], size=(320, 160))  # over the poles
    assert np.allclose(d[0], d[1], atol=1e-5)
    assert np.allclose(d[2], d[3], atol=1e-5)
