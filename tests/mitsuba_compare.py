"""How pictures are compared with Mitsuba's: pixels by luminance, blocks of pixels and the whole by channel."""

from __future__ import annotations

import numpy as np

import destello as dl
import mitsuba_scenes as theirs
import stats

SIZE, SEEDS, BLOCK = theirs.SIZE, 4, 16


def blocks(image):
    """Means of blocks (..., H / BLOCK, W / BLOCK, 3)."""
    shape = (*image.shape[:-3], SIZE // BLOCK, BLOCK, SIZE // BLOCK, BLOCK, 3)
    return image.reshape(shape).mean((-4, -2))


def block_means(runs):
    """Means of the blocks over runs (N, H, W, 3) of different seeds, and the variance of these means."""
    runs = np.asarray(runs, np.float64)
    pixels = runs.var(0, ddof=1) / len(runs)  # of few runs, but a block has many pixels
    return blocks(runs.mean(0)), blocks(pixels) / BLOCK**2


def whole(means, variances):
    """The mean of all blocks and its variance."""
    return means.mean((0, 1)), variances.sum((0, 1)) / means[..., 0].size ** 2


def compare(scene, description, device, *, spp, max_depth, integrator="path", slack=2e-4):
    """`spp` in each of SEEDS runs. `slack`: what float32 and the renderers' weights of luminance may differ by."""
    options = {"spp": spp, "size": (SIZE, SIZE), "max_depth": max_depth, "filter": dl.filters.box()}
    ours = [dl.render(scene, seed=s, device=device, progress=False, **options) for s in range(SEEDS)]
    how = {"spp": spp, "max_depth": max_depth, "integrator": integrator}
    others = [theirs.render(description, seed=100 + s, **how) for s in range(SEEDS)]
    mean_a = np.mean([dl.color.luminance(i.array.astype(np.float64)) for i in ours], 0)
    mean_b = np.mean([dl.color.luminance(p.rgb) for p in others], 0)
    variance_a = np.mean([i.film.core.variance() for i in ours], 0) / SEEDS
    variance_b = np.mean([p.variance for p in others], 0) / SEEDS
    stats.assert_means_agree(mean_a, variance_a, mean_b, variance_b, comparisons=9, slack=slack)
    blocks_a, blocks_b = block_means([i.array for i in ours]), block_means([p.rgb for p in others])
    stats.assert_means_agree(*blocks_a, *blocks_b, comparisons=9, slack=slack)
    whole_a, whole_b = (
        (mean.mean((0, 1)), variance.sum((0, 1)) / mean.shape[0] ** 4) for mean, variance in (blocks_a, blocks_b)
    )
    stats.assert_means_agree(*whole_a, *whole_b, comparisons=9, slack=slack)
    assert mean_a.mean() > 0.05
    # The test has eyes: a pixel's noise, and that of the whole picture.
    assert np.median(np.sqrt(variance_a + variance_b) / np.maximum(mean_a, 0.05)) < 0.08
    assert np.all(np.sqrt(whole_a[1] + whole_b[1]) < 2e-3 * whole_a[0])
