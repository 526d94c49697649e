"""The sampler: stratification of every prefix, independence of everything else, and what that buys."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from destello import _core
from stats import chi2_counts, z_threshold

testing = _core.testing

STREAMS = [(0, 0, 0), (0, 1, 0), (7, 12345, 3), (2**32 - 1, 2**31, 900), (1, 4095, 65535)]
"""(seed, pixel, dimension)"""


def addresses(seed: Any, pixel: Any, sample: Any, dimension: Any) -> NDArray[np.uint32]:
    """Rows that the sampler takes, from numbers and arrays that broadcast against each other."""
    columns = np.broadcast_arrays(seed, pixel, sample, dimension)
    return np.ascontiguousarray(np.stack([c.ravel() for c in columns], -1).astype(np.uint32))


def points(seed: Any, pixel: Any, sample: Any, dimension: Any) -> NDArray[np.float64]:
    return testing.sampler_2d(addresses(seed, pixel, sample, dimension)).astype(np.float64)


def numbers(seed: Any, pixel: Any, sample: Any, dimension: Any) -> NDArray[np.float64]:
    return testing.sampler_1d(addresses(seed, pixel, sample, dimension)).astype(np.float64)


@pytest.mark.parametrize("k", [*range(13), 16])
def test_every_elementary_interval_holds_one_point(k: int) -> None:
    n = 1 << k
    for seed, pixel, dimension in STREAMS:
        for block in (0, 1, 5):  # any aligned block of 2^k samples is a net, not only the first
            p = points(seed, pixel, np.arange(n) + block * n, dimension)
            for a in range(k + 1):
                cell = (p[:, 0] * 2**a).astype(int) << (k - a) | (p[:, 1] * 2 ** (k - a)).astype(int)
                assert np.array_equal(np.sort(cell), np.arange(n)), (seed, pixel, dimension, block, a)


@pytest.mark.parametrize("k", [0, 1, 5, 10, 16])
def test_single_dimensions_are_stratified(k: int) -> None:
    n = 1 << k
    for seed, pixel, dimension in STREAMS:
        for block in (0, 3):
            x = numbers(seed, pixel, np.arange(n) + block * n, dimension)
            assert np.array_equal(np.sort((x * n).astype(int)), np.arange(n))


def test_numbers_are_multiples_of_a_24th_power_below_one() -> None:
    x = np.concatenate([numbers(3, 5, np.arange(50_000), 1), points(3, 5, np.arange(50_000), 2).ravel()])
    assert x.min() >= 0
    assert x.max() < 1
    assert np.array_equal(x * 2**24, np.floor(x * 2**24))


def test_a_number_depends_on_its_address_alone(rng: np.random.Generator) -> None:
    rows = rng.integers(0, 2**32, (2000, 4), dtype=np.uint64).astype(np.uint32)
    whole = testing.sampler_2d(rows)
    order = rng.permutation(len(rows))
    assert np.array_equal(testing.sampler_2d(np.ascontiguousarray(rows[order])), whole[order])
    one_by_one = np.concatenate([testing.sampler_2d(rows[i : i + 1]) for i in range(200)])
    assert np.array_equal(one_by_one, whole[:200])
    assert len(np.unique(whole[:, 0])) > 1990  # and addresses matter


# --- what looks random ------------------------------------------------------------------------------------------------

GRID = 16
PAIRS: dict[str, tuple[dict[str, Any], dict[str, Any]]] = {
    "neighbouring pixels": ({}, {"pixel": 1}),
    "pixels a row apart": ({}, {"pixel": 1280}),
    "neighbouring dimensions": ({}, {"dimension": 1}),
    "dimensions a bounce apart": ({}, {"dimension": 8}),
    "neighbouring seeds": ({}, {"seed": 1}),
    "seeds a bit apart": ({}, {"seed": 2**31}),
    "samples a block apart": ({}, {"sample": 64}),
}


def stream(shift: dict[str, Any], pixel: Any, sample: Any) -> NDArray[np.float64]:
    at = {"seed": 11, "pixel": pixel, "sample": sample, "dimension": 2}
    at = {name: value + shift.get(name, 0) for name, value in at.items()}
    return points(**at)


@pytest.mark.parametrize("name", PAIRS)
def test_streams_are_uniform_and_unrelated_over_pixels(name: str) -> None:
    pixels = np.arange(0, 3 * 40_000, 3)  # no pixel meets its own neighbour again
    for sample in (0, 1, 37):
        a, b = (stream(shift, pixels, sample) for shift in PAIRS[name])
        for x, y in ((a[:, 0], b[:, 0]), (a[:, 0], b[:, 1]), (a[:, 1], b[:, 1]), (b[:, 0], b[:, 1])):
            counts = np.histogram2d(x, y, bins=GRID, range=[[0, 1], [0, 1]])[0]
            chi2_counts(counts, np.full((GRID, GRID), len(pixels) / GRID**2)).check(comparisons=len(PAIRS) * 12)


@pytest.mark.parametrize("name", [n for n in PAIRS if "samples" not in n])
def test_streams_are_unrelated_over_samples(name: str) -> None:
    # Within a pixel both sequences are stratified, and a random nested shuffle pairs them. It pairs in blocks, so the
    # correlation varies more than that of independent numbers: 1.58 times, also if every flip is truly random
    # (simulated with one hash per node of the tree).
    n, streams = 1024, 400
    correlations = []
    for pixel in range(0, 3 * streams, 3):
        a, b = (stream(shift, pixel, np.arange(n)) for shift in PAIRS[name])
        correlations.append([np.corrcoef(a[:, i], b[:, j])[0, 1] for i in (0, 1) for j in (0, 1)])
    z = np.asarray(correlations) * np.sqrt(n / 1.58)
    limit = z_threshold(5 * (len(PAIRS) - 1))
    assert np.all(np.abs(z.mean(axis=0) * np.sqrt(streams)) < limit)
    squares = (z**2).mean(axis=1)
    assert abs(squares.mean() - 1) < limit * squares.std() / np.sqrt(streams)


# --- what stratification buys -----------------------------------------------------------------------------------------


def slope(errors: list[float], sizes: list[int]) -> float:
    """Exponent of the power law that fits errors against numbers of samples."""
    return float(np.polyfit(np.log(sizes), np.log(errors), 1)[0])


def test_smooth_integrands_converge_faster_than_by_chance() -> None:
    sizes = [2**k for k in range(4, 13)]
    exact_1d, exact_2d = np.sin(1.0), (np.e - 1) * np.sin(1.0)
    errors_1d, errors_2d = [], []
    for n in sizes:
        samples = np.arange(n)[None, :]
        pixels = np.arange(64)[:, None]
        x = numbers(5, pixels, samples, 4).reshape(64, n)
        p = points(5, pixels, samples, 4).reshape(64, n, 2)
        errors_1d.append(float(np.sqrt(np.mean((np.cos(x).mean(axis=1) - exact_1d) ** 2))))
        estimates = (np.exp(p[..., 0]) * np.cos(p[..., 1])).mean(axis=1)
        errors_2d.append(float(np.sqrt(np.mean((estimates - exact_2d) ** 2))))
    assert slope(errors_1d, sizes) < -1.3  # scrambled nets reach -1.5
    assert slope(errors_2d, sizes) < -1.2


def test_padded_dimensions_still_converge_as_by_chance_or_faster() -> None:
    # Two points make four dimensions; their pairing is random, so only part of the variance falls fast.
    sizes = [2**k for k in range(4, 13)]
    errors = []
    for n in sizes:
        pixels, samples = np.arange(64)[:, None], np.arange(n)[None, :]
        a, b = (points(5, pixels, samples, d).reshape(64, n, 2) for d in (0, 1))
        estimates = ((a[..., 0] + a[..., 1]) * (b[..., 0] + 2 * b[..., 1])).mean(axis=1)
        errors.append(float(np.sqrt(np.mean((estimates - 1.5) ** 2))))
    assert slope(errors, sizes) < -0.45
    # Of the variance of the product, 0.4167 (5/12), what the two factors explain for themselves is gone.
    random = np.sqrt((1 / 6 + 1) * (5 / 12 + 2.25) - 1.5**2) / np.sqrt(sizes[-1])
    assert errors[-1] < 0.4 * random
