"""Pictures as estimates: mean luminance and the variance of that mean for every pixel, and z-tests on them.

The variances are the film's own. Owen-scrambled samples do better than independent ones, so the estimate is an upper
bound in the mean and the tests are on the safe side; the mean over the whole picture is tested as well, where a bias
too small to be seen in one pixel adds up.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

import destello as dl
import stats

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Estimate:
    """Luminance (H, W), the variance of its mean (H, W), and linear RGB (H, W, 3)."""

    mean: Floats
    variance: Floats
    rgb: Floats
    nonfinite: int = 0

    @property
    def total(self) -> tuple[float, float]:
        """Mean over all pixels and its variance; pixels are independent."""
        return float(self.mean.mean()), float(self.variance.sum()) / self.variance.size**2

    def __getitem__(self, where: Any) -> Estimate:
        return Estimate(self.mean[where], self.variance[where], self.rgb[where], self.nonfinite)


def estimate(
    scene: dl.Scene,
    device: str,
    *,
    spp: int = 256,
    size: tuple[int, int] = (12, 12),
    sampling: str | None = None,
    seed: int = 0,
    max_depth: int | None = None,
    max_volume_depth: int | None = None,
    rr_depth: int | None = None,
    clamp: float | None = None,
    shutter: tuple[float, float] | None = None,
) -> Estimate:
    """Renders with the box filter, so that pixels share nothing, and the settings given."""
    scene = scene.copy()
    changes = {"light_sampling": sampling, "rr_depth": rr_depth, "clamp": clamp, "shutter": shutter}
    for name, value in changes.items():
        if value is not None:
            setattr(scene.render, name, value)
    image = dl.render(
        scene,
        spp=spp,
        size=size,
        device=device,
        seed=seed,
        max_depth=max_depth,
        max_volume_depth=max_volume_depth,
        filter=dl.filters.box(),
        progress=False,
    )
    assert image.film is not None
    rgb = image.array.astype(np.float64)
    variance = np.asarray(image.film.core.variance(), np.float64)
    return Estimate(np.asarray(dl.color.luminance(rgb), np.float64), variance, rgb, image.film.nonfinite)


def runs(scene: dl.Scene, device: str, *, count: int = 4, seed: int = 0, **options: Any) -> Floats:
    """Linear RGB (count, H, W, 3) of pictures with different seeds: pixels and pictures are independent."""
    return np.stack([estimate(scene, device, seed=seed + i, **options).rgb for i in range(count)])


def assert_agree(a: Estimate, b: Estimate, *, comparisons: int = 1, slack: float = 1e-5) -> None:
    """Fail if two estimates of one picture differ by more than chance, in a pixel or in the whole."""
    assert a.nonfinite == b.nonfinite == 0
    assert max(a.mean.mean(), b.mean.mean()) > 0, "both pictures are black"
    stats.assert_means_agree(a.mean, a.variance, b.mean, b.variance, comparisons=2 * comparisons, slack=slack)
    (mean_a, var_a), (mean_b, var_b) = a.total, b.total
    stats.assert_means_agree(mean_a, var_a, mean_b, var_b, comparisons=2 * comparisons, slack=slack)


def assert_known(a: Estimate, expected: ArrayLike, *, comparisons: int = 1, slack: float = 1e-5) -> None:
    """Fail if an estimate differs from a known luminance (a number or one per pixel) by more than chance."""
    known = np.broadcast_to(np.asarray(expected, np.float64), a.mean.shape)
    zero = np.zeros_like(known)
    assert_agree(a, Estimate(known, zero, np.repeat(known[..., None], 3, -1)), comparisons=comparisons, slack=slack)


def assert_constant(a: Estimate, value: ArrayLike, rtol: float = 2e-5) -> None:
    """Fail unless every pixel has this RGB without noise, but for the rounding of floats."""
    assert a.nonfinite == 0
    np.testing.assert_allclose(a.rgb, np.broadcast_to(value, a.rgb.shape), rtol=rtol)


def down_on(half: float = 1.0, height: float = 5.0) -> dl.nodes.Node:
    """An orthographic camera that sees the square [-half, half]^2 of the plane y = 0; row 0 is z = -half."""
    return dl.cameras.orthographic(origin=(0, height, 0), target=(0, 0, 0), up=(0, 0, -1), height=2 * half)


def pixel_points(size: int, half: float, oversample: int = 8) -> Floats:
    """Points (size, size, oversample^2, 3) of the plane y = 0, spread evenly over the pixels of `down_on`'s picture."""
    n = size * oversample
    line = (np.arange(n) + 0.5) / n * 2 * half - half
    x, z = np.meshgrid(line, line)
    points = np.stack([x, np.zeros_like(x), z], -1).reshape(size, oversample, size, oversample, 3)
    return points.transpose(0, 2, 1, 3, 4).reshape(size, size, oversample**2, 3)


def floor(reflectance: float = 0.5, half: float = 10.0, y: float = 0.0) -> dl.nodes.Node:
    """A diffuse square whose normal is +y."""
    material = dl.materials.diffuse(reflectance=reflectance)
    return dl.shapes.quad((-half, y, half), (2 * half, 0, 0), (0, 0, -2 * half), material=material)


def slab(bottom, top, material):
    return dl.shapes.box((-30, bottom, -30), (30, top, 30), material=material)


def bumps(rng: np.random.Generator, steep: float) -> Any:
    """A normal map whose normals lean by up to `steep` (tangent) in all directions."""
    xy = rng.uniform(-steep, steep, (16, 16, 2))
    n = np.concatenate([xy, np.ones((16, 16, 1))], -1)
    n /= np.linalg.norm(n, axis=-1, keepdims=True)
    return dl.textures.image(((n + 1) / 2).astype(np.float32), color_space="linear", uv_scale=(2, 2))


def furnace(shape: Any) -> dl.Scene:
    scene = dl.Scene("furnace")
    scene.environment = dl.environments.constant(radiance=1)
    scene.add(shape)
    scene.camera = dl.cameras.orthographic(origin=(0.3, 0.4, 5), target=(0, 0, 0), up=(0, 1, 0), height=2.2)
    return scene
