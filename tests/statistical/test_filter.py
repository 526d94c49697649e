"""Reconstruction filters: offsets follow |f|, signs follow the sign of f, pixels come out as f says."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy import stats as scipy_stats

from destello import _core
from stats import assert_mean, chi2_grid, integrate_cells

testing = _core.testing
Array = NDArray[np.float64]

CASES: dict[str, tuple[str, dict[str, Any]]] = {
    # every filter of the list with its defaults, and what shows more of it
    **{name: (name, {}) for name in testing.FILTERS},
    "wide gaussian": ("gaussian", {"sigma": 2}),
    "wide box": ("box", {"radius": 1.5}),
    "narrow tent": ("tent", {"radius": 0.4}),
    "catmull-rom": ("mitchell", {"b": 0, "c": 0.5}),
    "b-spline": ("mitchell", {"b": 1, "c": 0}),
    "ringing": ("mitchell", {"b": 0, "c": 1}),
    "wide blackman-harris": ("blackman_harris", {"radius": 4}),
}


def half_width(case: str) -> float:
    kind, params = CASES[case]
    if kind == "gaussian":
        return 6 * float(params.get("sigma", 0.3))
    defaults = {"box": 0.5, "tent": 1.0, "mitchell": 2.0, "blackman_harris": 1.5}
    return float(params.get("radius", defaults.get(kind, 8.0)))


def on_grid(u: Array) -> NDArray[np.float32]:
    return np.ascontiguousarray((np.floor(u * 2**24) / 2**24).astype(np.float32))


def sobol(n: int) -> NDArray[np.float32]:
    """The first n points of one pixel's sampler."""
    columns = np.broadcast_arrays(np.uint32(1), np.uint32(2), np.arange(n, dtype=np.uint32), np.uint32(3))
    return testing.sampler_2d(np.ascontiguousarray(np.stack(columns, -1)))


def evaluate(case: str, offsets: Array) -> Array:
    return testing.filter_eval(*CASES[case], np.ascontiguousarray(offsets.astype(np.float32))).astype(np.float64)


def draw(case: str, u: NDArray[np.float32]) -> tuple[Array, Array]:
    offset, sign = testing.filter_sample(*CASES[case], u)
    return offset.astype(np.float64), sign.astype(np.float64)


def integrals(case: str) -> tuple[float, float]:
    """Integrals of f and |f| over the plane."""
    lines = np.linspace(-half_width(case), half_width(case), 97)
    f, size = (
        integrate_cells(lambda p, g=g: g(evaluate(case, p)), lines, lines, samples=10**8, max_depth=4).sum()
        for g in (lambda v: v, np.abs)
    )
    return float(f), float(size)


@pytest.mark.parametrize("case", CASES)
def test_offsets_follow_the_filter(case: str, rng: np.random.Generator) -> None:
    offset, sign = draw(case, on_grid(rng.random((200_000, 2))))
    assert np.all(np.abs(sign) == 1)
    reach = half_width(case)
    assert np.abs(offset).max() <= reach * (1 + 1e-6)
    _, size = integrals(case)
    lines = np.linspace(-reach, reach, 31)
    offset = np.clip(offset, -reach, reach)
    chi2_grid(offset, lambda p: np.abs(evaluate(case, p)) / size, (lines, lines)).check(comparisons=len(CASES))


@pytest.mark.parametrize("case", CASES)
def test_signs_are_those_of_the_filter(case: str, rng: np.random.Generator) -> None:
    offset, sign = draw(case, on_grid(rng.random((200_000, 2))))
    f = evaluate(case, offset)
    clear = np.abs(f) > 2e-3 * np.abs(f).max()  # away from the roots, which the table moves a little
    assert clear.mean() > 0.5
    assert np.array_equal(np.sign(f[clear]), sign[clear])
    signed, size = integrals(case)
    assert_mean(sign, signed / size, comparisons=len(CASES), slack=1e-3)


def test_mitchell_has_the_share_of_negative_lobes_that_its_formula_gives() -> None:
    x = np.linspace(0, 2, 200_001)
    b = c = 1 / 3
    near = ((12 - 9 * b - 6 * c) * x**3 + (-18 + 12 * b + 6 * c) * x**2 + (6 - 2 * b)) / 6
    far = ((-b - 6 * c) * x**3 + (6 * b + 30 * c) * x**2 + (-12 * b - 48 * c) * x + (8 * b + 24 * c)) / 6
    f = np.where(x < 1, near, far)
    share = (np.trapezoid(f, x) / np.trapezoid(np.abs(f), x)) ** 2  # of f in |f|, for both axes
    _, sign = draw("mitchell", sobol(2**18))
    assert share < 0.9
    assert sign.mean() == pytest.approx(share, abs=5e-4)


@pytest.mark.parametrize("case", CASES)
def test_a_ramp_keeps_its_value_at_the_centre(case: str) -> None:
    # A filter that sums to 1 and is even reproduces linear pictures.
    offset, sign = draw(case, sobol(2**16))
    ramp = 2 + offset @ [0.7, -0.4]
    assert np.sum(sign * ramp) / np.sum(sign) == pytest.approx(2, abs=2e-3 * half_width(case))


@pytest.mark.parametrize("case", CASES)
def test_a_wave_is_damped_as_the_filter_says(case: str) -> None:
    # The estimator sum(sign * picture) / sum(sign), against the integral of f times the picture.
    def wave(p: Array) -> Array:
        return np.cos(1.3 * p[:, 0] + 0.4) * np.cos(0.9 * p[:, 1] - 0.3)

    offset, sign = draw(case, sobol(2**18))
    lines = np.linspace(-half_width(case), half_width(case), 97)
    damped = integrate_cells(lambda p: evaluate(case, p) * wave(p), lines, lines, samples=10**8, max_depth=4).sum()
    expected = float(damped) / integrals(case)[0]
    assert np.sum(sign * wave(offset)) / np.sum(sign) == pytest.approx(expected, abs=1e-3)


def test_default_filter_is_the_gaussian_of_three_tenths() -> None:
    assert testing.FILTERS[0] == "gaussian"
    offset, _ = draw("gaussian", sobol(2**20))
    assert np.abs(offset.mean(axis=0)).max() < 1e-4
    assert np.abs(offset.std(axis=0) - 0.3).max() < 5e-5
    assert abs(np.corrcoef(offset.T)[0, 1]) < 1e-3
    # A vertical edge at distance d from the centre: its closed form is the normal distribution function.
    for d in (-0.9, -0.3, -0.1, 0, 0.15, 0.5):
        for axis in (0, 1):
            assert np.mean(offset[:, axis] < d) == pytest.approx(scipy_stats.norm.cdf(d / 0.3), abs=2e-4)


def test_ends_of_the_numbers_stay_inside() -> None:
    ends = np.array([0, 2.0**-24, 0.5 - 2.0**-24, 0.5, 1 - 2.0**-24])
    u = on_grid(np.stack(np.meshgrid(ends, ends), -1).reshape(-1, 2))
    for case in CASES:
        offset, sign = draw(case, u)
        assert np.isfinite(offset).all()
        assert np.abs(offset).max() <= half_width(case) * (1 + 1e-6)
        assert np.all(np.abs(sign) == 1)


def test_a_box_of_radius_zero_is_the_centre() -> None:
    offset, _ = testing.filter_sample("box", {"radius": 0}, sobol(16))
    assert not offset.any()
