"""Tables for picking lights and texels: probabilities are exact, not only right on average."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from destello import _core

testing = _core.testing
STEPS = 2**24
"""Numbers that the sampler can make: all of them are tried."""

SKEWED = {
    "one": [3.0],
    "equal": [1.0] * 7,
    "plain": [1.0, 2.0, 3.0, 4.0],
    "with zeros": [0.0, 5.0, 0.0, 0.0, 1.0, 0.0],
    "zeros at the end": [1e-9, 1.0, 0.0, 0.0],
    "a sun in the night": [1e-12] * 300 + [1e6] + [1e-12] * 300,
    "all zero": [0.0, 0.0, 0.0],
    "tiny": [1e-30, 3e-30],
}


def weights_of(case: str) -> NDArray[np.float64]:
    if case == "many":
        return np.random.default_rng(5).random(70_001) ** 6
    return np.asarray(SKEWED[case])


@pytest.fixture(scope="module")
def every_number() -> NDArray[np.float32]:
    return (np.arange(STEPS, dtype=np.float64) / STEPS).astype(np.float32)


def check_probabilities(weights: NDArray[np.float64], pdf: NDArray[np.float64], counts: NDArray[np.int64]) -> None:
    assert np.array_equal(counts, pdf * STEPS)  # exactly
    assert pdf.sum() == 1
    wanted = weights / weights.sum() if weights.sum() > 0 else np.full(len(weights), 1 / len(weights))
    assert np.all(pdf[wanted == 0] == 0)
    assert np.all(pdf[wanted > 0] > 0)  # nothing that shines is forgotten
    # Rounding to the grid, and a step for each weight that would get none.
    starved = int(np.sum((wanted > 0) & (wanted * STEPS < 1)))
    assert np.abs(pdf - wanted).max() * STEPS <= 4 + 2 * starved


@pytest.mark.parametrize("case", [*SKEWED, "many"])
def test_alias_table_draws_what_it_says(case: str, every_number: NDArray[np.float32]) -> None:
    weights = weights_of(case)
    counts = np.zeros(len(weights), np.int64)
    totals = np.zeros(len(weights))
    for u in np.split(every_number, 8):
        pdf, index, remapped = testing.alias(weights.astype(np.float32), np.ascontiguousarray(u))
        counts += np.bincount(index, minlength=len(weights))
        totals += np.bincount(index, remapped.astype(np.float64), minlength=len(weights))
        assert remapped.min() >= 0
        assert remapped.max() < 1
    check_probabilities(weights, pdf.astype(np.float64), counts)
    # What is left of the number is still uniform: its mean is one half, up to its resolution.
    often = counts > 1000
    resolution = len(weights) / STEPS * STEPS / np.maximum(counts, 1)
    assert np.all(np.abs(totals[often] / counts[often] - 0.5) <= 1e-3 + resolution[often])


@pytest.mark.parametrize("case", [*SKEWED, "many"])
def test_cumulative_table_draws_what_it_says(case: str, every_number: NDArray[np.float32]) -> None:
    weights = weights_of(case)
    cdf = testing.cdf_build(weights)
    assert cdf[0] == 0
    assert cdf[-1] == 1
    steps = np.diff(cdf.astype(np.float64))
    assert steps.min() >= 0
    counts = np.zeros(len(weights), np.int64)
    totals = np.zeros(len(weights))
    for u in np.split(every_number, 8):
        index, probability, remapped = testing.cdf_sample(cdf, np.ascontiguousarray(u))
        assert np.array_equal(probability, steps[index].astype(np.float32))
        counts += np.bincount(index, minlength=len(weights))
        totals += np.bincount(index, remapped.astype(np.float64), minlength=len(weights))
        assert remapped.min() > 0
        assert remapped.max() < 1
    check_probabilities(weights, steps, counts)
    drawn = counts > 0
    assert np.allclose(totals[drawn] / counts[drawn], 0.5, atol=1e-5)  # cells of one step, too, are hit in the centre


def test_alias_table_is_random_as_well_as_exact(rng: np.random.Generator) -> None:
    # Stratified numbers pick stratified lights: no light is more than a few samples off.
    weights = rng.random(50).astype(np.float32)
    rows = np.stack(np.broadcast_arrays(np.uint32(1), np.uint32(2), np.arange(4096, dtype=np.uint32), np.uint32(3)), -1)
    pdf, index, _ = testing.alias(weights, testing.sampler_1d(np.ascontiguousarray(rows)))
    assert np.abs(np.bincount(index, minlength=50) - 4096 * pdf).max() < 60
