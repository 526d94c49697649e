"""Statistical tests for Monte Carlo code, with fixed seeds and corrected for the number of comparisons.

How to use them:

- A sampler of directions against its density: ``chi2_directions(draw, pdf, seed=...)``. ``draw`` gets uniform numbers
  and returns directions (NaN rows where it gave none), ``pdf`` the solid-angle density. The test also sees missing
  mass: the share of failed samples is compared with one minus the integral of the density.
- A sampler of points in a rectangle (a disk in polar coordinates, a filter, an image): ``chi2_grid``.
- Random means against known values: ``assert_mean``; against each other: ``assert_means_agree`` (pictures: give means
  and the variances of these means, per pixel; the threshold is corrected for the number of pixels).
- When a test is parametrised over n cases, pass ``comparisons=n``: the family then errs with probability ``ALPHA`` as a
  whole (Sidak's correction). Seeds are fixed, so a test passes always or never.

All p-values are two-sided. Nothing here knows destello.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import stats as scipy_stats  # type: ignore[import-untyped,unused-ignore]

Floats = NDArray[np.float64]

ALPHA = 0.01
"""Probability with which one family of comparisons fails although all is well (before the seed is fixed)."""

MIN_EXPECTED = 10.0
"""Cells that expect fewer samples than this are pooled: the chi-square distribution is an approximation for many."""


def sidak(comparisons: int, alpha: float = ALPHA) -> float:
    """Return the significance level of one comparison out of ``comparisons`` for ``alpha`` over them all."""
    return float(-np.expm1(np.log1p(-alpha) / comparisons))


def z_threshold(comparisons: int, alpha: float = ALPHA) -> float:
    """Return the |z| that one of ``comparisons`` standard normal numbers may reach."""
    return float(scipy_stats.norm.isf(sidak(comparisons, alpha) / 2))


# --- chi-square ------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Chi2:
    """The outcome of a chi-square test."""

    statistic: float
    degrees: int
    p_value: float
    samples: int
    mass: float
    """Integral of the density over the domain."""
    failed: int
    """Samples that gave nothing."""
    worst: str
    """The cell that deviates most, in words."""

    def check(self, comparisons: int = 1, alpha: float = ALPHA) -> None:
        """Fail the test if the samples do not follow the density."""
        assert self.mass <= 1 + 2e-3, f"the density integrates to {self.mass:.5f}"
        limit = sidak(comparisons, alpha)
        assert self.p_value >= limit, (
            f"chi-square {self.statistic:.1f}, {self.degrees} degrees of freedom, p {self.p_value:.2e} < {limit:.2e}; "
            f"mass {self.mass:.5f}, {self.failed} of {self.samples} samples failed; worst: {self.worst}"
        )


def chi2_counts(observed: ArrayLike, expected: ArrayLike, names: Callable[[int], str] = str) -> Chi2:
    """Compare counts with expected counts, cell by cell. Both sum to the number of samples.

    Cells that expect less than ``MIN_EXPECTED`` are pooled in the order of their expectation until each pool expects
    that much; what remains joins the last pool. Where next to nothing is expected, few samples are enough to fail.
    """
    seen, hoped = np.asarray(observed, np.float64).ravel(), np.asarray(expected, np.float64).ravel()
    order = np.argsort(hoped, kind="stable")
    pools: list[list[int]] = [[]]
    held = 0.0
    for i in order:
        if held >= MIN_EXPECTED:
            pools.append([])
            held = 0.0
        pools[-1].append(int(i))
        held += hoped[i]
    if held < MIN_EXPECTED and len(pools) > 1:
        pools[-2] += pools.pop()
    seen_cells, hoped_cells = (np.array([a[pool].sum() for pool in pools]) for a in (seen, hoped))
    deviation = (seen_cells - hoped_cells) ** 2 / np.maximum(hoped_cells, 1e-300)
    statistic, degrees = float(deviation.sum()), len(seen_cells) - 1
    if degrees == 0:  # one cell holds everything: only its total can be wrong
        degrees, p_value = 1, float(abs(seen.sum() - hoped.sum()) <= 1e-6 * hoped.sum())
    else:
        p_value = float(scipy_stats.chi2.sf(statistic, degrees))
    k = int(np.argmax(deviation))
    place = names(pools[k][0]) if len(pools[k]) == 1 else f"{len(pools[k])} pooled cells"
    worst = f"{place}: {seen_cells[k]:.0f} samples, {hoped_cells[k]:.1f} expected"
    return Chi2(statistic, degrees, p_value, round(float(seen.sum())), 1.0, 0, worst)


def chi2_grid(
    points: ArrayLike,
    density: Callable[[Floats], ArrayLike],
    edges: tuple[ArrayLike, ArrayLike],
    *,
    precision: float = 0.05,
    hints: Floats | None = None,
) -> Chi2:
    """Compare points (N, 2) with a density (per unit area of the rectangle that ``edges`` divide into cells).

    Rows with NaN are samples that gave nothing, and rows outside the rectangle count with them: they are compared with
    one minus the integral of the density. ``density`` takes (M, 2) points. Cells are integrated adaptively until the
    error is expected to stay below ``precision`` standard deviations of the cell's count; ``hints`` as for
    ``integrate_cells``.
    """
    p = np.asarray(points, np.float64)
    ex, ey = (np.asarray(e, np.float64) for e in edges)
    good = np.isfinite(p).all(axis=1)
    counts = np.histogram2d(p[good, 0], p[good, 1], bins=(ex, ey))[0]
    n = len(p)
    masses = integrate_cells(density, ex, ey, samples=n, precision=precision, hints=hints)
    total = float(masses.sum())
    failed = n - round(float(counts.sum()))

    def name(i: int) -> str:
        if i == counts.size:
            return "samples that gave nothing"
        a, b = divmod(i, len(ey) - 1)
        return f"cell [{ex[a]:.6g}, {ex[a + 1]:.6g}] x [{ey[b]:.6g}, {ey[b + 1]:.6g}]"

    observed = np.append(counts.ravel(), failed)
    expected = n * np.append(masses.ravel(), max(1 - total, 0.0))
    expected *= n / expected.sum()
    r = chi2_counts(observed, expected, name)
    return Chi2(r.statistic, r.degrees, r.p_value, n, total, failed, r.worst)


def chi2_directions(
    draw: Callable[[Floats], ArrayLike],
    pdf: Callable[[NDArray[np.float32]], ArrayLike],
    *,
    seed: int,
    samples: int = 40_000,
    cells: tuple[int, int] = (20, 20),
    dimensions: int = 3,
) -> Chi2:
    """Compare sampled directions with their density on the sphere.

    ``draw`` takes uniform numbers (N, dimensions) and returns unit vectors (N, 3), with NaN in rows that gave none;
    ``pdf`` takes directions (M, 3) and returns their density in 1/sr (M,). The grid is one of (cos theta, phi) whose
    lines lie partly at even distances and partly at quantiles of an independent pilot sample, so that narrow lobes are
    resolved as well; one line is the horizon cos theta = 0.
    """
    rng = np.random.default_rng(seed)
    pilot = _to_grid(draw(rng.random((20_000, dimensions))))
    points = _to_grid(draw(rng.random((samples, dimensions))))
    pilot = pilot[np.isfinite(pilot).all(axis=1)]
    z_lines = _grid_lines(pilot[:, 0], -1, 1, cells[0], [0.0])
    phi_lines = _grid_lines(pilot[:, 1], -np.pi, np.pi, cells[1], [])

    def density(grid_points: Floats) -> Floats:
        z, phi = grid_points[:, 0], grid_points[:, 1]
        r = np.sqrt(np.maximum(1 - z * z, 0))
        directions = np.stack([r * np.cos(phi), r * np.sin(phi), z], -1)
        return np.asarray(pdf(directions.astype(np.float32)), np.float64)

    return chi2_grid(points, density, (z_lines, phi_lines), hints=pilot)


def _to_grid(directions: ArrayLike) -> Floats:
    d = np.asarray(directions, np.float64)
    d = d / np.linalg.norm(d, axis=1, keepdims=True)
    return np.stack([d[:, 2], np.arctan2(d[:, 1], d[:, 0])], -1)


def _grid_lines(pilot: Floats, lo: float, hi: float, count: int, more: list[float]) -> Floats:
    """Half of the lines at quantiles of the pilot sample, half evenly spaced; none too close for float32."""
    lines = [np.linspace(lo, hi, count // 2 + 1), np.asarray(more)]
    if len(pilot) >= 100:
        lines.append(np.quantile(pilot, np.linspace(0, 1, count - count // 2 + 2)[1:-1]))
    candidates = np.unique(np.concatenate(lines))
    fixed = {lo, hi, *more}
    kept: list[float] = []
    for x in candidates:
        if kept and x - kept[-1] < 2e-6:
            if float(x) in fixed:
                kept[-1] = float(x)
            continue
        kept.append(float(x))
    return np.asarray(kept)


# --- quadrature ------------------------------------------------------------------------------------------------------


def _gauss_square(order: int) -> tuple[Floats, Floats]:
    x, w = np.polynomial.legendre.leggauss(order)
    px, py = np.meshgrid(x, x, indexing="ij")
    return np.stack([px.ravel(), py.ravel()], -1) * 0.5 + 0.5, np.outer(w, w).ravel() * 0.25


def integrate_cells(
    density: Callable[[Floats], ArrayLike],
    x_lines: ArrayLike,
    y_lines: ArrayLike,
    *,
    samples: int,
    precision: float = 0.05,
    max_depth: int = 14,
    hints: Floats | None = None,
) -> Floats:
    """Integrate a density over every cell of a grid: (len(x_lines) - 1, len(y_lines) - 1).

    Two Gauss-Legendre rules are compared; a cell where they differ by more than ``precision`` standard deviations of
    the mass that ``samples`` samples would measure there is cut in two or four, up to ``max_depth`` times. ``hints``
    (H, 2) are points drawn from about that density: a cell that holds many of them, but where the rules find no mass,
    or the other way round, is cut as well. So lobes that fall between the nodes are found; hints never decide the
    result.
    """
    ex, ey = np.asarray(x_lines, np.float64), np.asarray(y_lines, np.float64)
    shape = (len(ex) - 1, len(ey) - 1)
    x0, y0 = (a.ravel() for a in np.meshgrid(ex[:-1], ey[:-1], indexing="ij"))
    x1, y1 = (a.ravel() for a in np.meshgrid(ex[1:], ey[1:], indexing="ij"))
    boxes, owner = np.stack([x0, y0, x1, y1], -1), np.arange(x0.size)
    coarse, fine = _gauss_square(4), _gauss_square(7)
    points = np.zeros((0, 2)) if hints is None else np.asarray(hints, np.float64)
    home = _cell_of(points, ex, ey)
    result = np.zeros(x0.size)
    for depth in range(max_depth + 1):
        low, high = _integrate_boxes(density, boxes, coarse), _integrate_boxes(density, boxes, fine)
        # One sample's worth of mass is the floor: smaller cells are pooled.
        noise = np.sqrt(np.maximum(np.abs(high), 1.0 / samples) / samples)
        rough = np.abs(high - low) > precision * noise * 0.6**depth
        if len(points):
            found = np.bincount(home[home >= 0], minlength=len(boxes))
            hoped = len(points) * high
            rough |= np.abs(found - hoped) > 4 * np.sqrt(np.maximum(hoped, 0)) + 0.5
        if depth == max_depth:
            rough[:] = False
        np.add.at(result, owner[~rough], high[~rough])
        if not rough.any():
            break
        rank = np.where(rough, np.cumsum(rough) - 1, -1)
        points = points[home >= 0]
        home = rank[home[home >= 0]]
        points, home = points[home >= 0], home[home >= 0]
        parents, parent_owner = boxes[rough], owner[rough]
        a, b, c, d = parents.T
        m, k = _cuts(parents, points, home)
        boxes = np.concatenate([np.stack(q, -1) for q in ((a, b, m, k), (m, b, c, k), (a, k, m, d), (m, k, c, d))])
        home = home + len(a) * ((points[:, 0] > m[home]) + 2 * (points[:, 1] > k[home]))
        owner = np.tile(parent_owner, 4)
        whole = (boxes[:, 2] > boxes[:, 0]) & (boxes[:, 3] > boxes[:, 1])
        boxes, owner = boxes[whole], owner[whole]
        home = (np.cumsum(whole) - 1)[home]
    return result.reshape(shape)


def _cuts(boxes: Floats, points: Floats, home: NDArray[np.int64]) -> tuple[Floats, Floats]:
    """Where to cut boxes: in the middle of both axes, or only across the one along which their points lie closer."""
    a, b, c, d = boxes.T
    count = np.maximum(np.bincount(home, minlength=len(boxes)), 1)
    spread = []
    for axis, size in ((0, c - a), (1, d - b)):
        x = points[:, axis]
        mean = np.bincount(home, x, minlength=len(boxes)) / count
        variance = np.bincount(home, (x - mean[home]) ** 2, minlength=len(boxes)) / count
        spread.append(np.sqrt(variance) / size)
    many = count >= 3
    m = np.where(many & (spread[1] < 0.5 * spread[0]), c, (a + c) / 2)
    k = np.where(many & (spread[0] < 0.5 * spread[1]), d, (b + d) / 2)
    return m, k


def _cell_of(points: Floats, ex: Floats, ey: Floats) -> NDArray[np.int64]:
    """The row-major number of each point's cell; -1 outside the grid."""
    i, j = np.searchsorted(ex, points[:, 0], "right") - 1, np.searchsorted(ey, points[:, 1], "right") - 1
    good = (i >= 0) & (i < len(ex) - 1) & (j >= 0) & (j < len(ey) - 1)
    return np.where(good, i * (len(ey) - 1) + j, -1).astype(np.int64)


def _integrate_boxes(density: Callable[[Floats], ArrayLike], boxes: Floats, rule: tuple[Floats, Floats]) -> Floats:
    nodes, weights = rule
    corner, size = boxes[:, None, :2], boxes[:, None, 2:] - boxes[:, None, :2]
    values = np.asarray(density((corner + size * nodes).reshape(-1, 2)), np.float64).reshape(len(boxes), -1)
    return np.asarray(values @ weights * size[:, 0, 0] * size[:, 0, 1])


def integrate_sphere(
    function: Callable[[NDArray[np.float32]], ArrayLike], *, hemisphere: bool = False, cells: tuple[int, int] = (32, 32)
) -> float:
    """Integrate a function of directions (M, 3) -> (M,), over the sphere or the upper hemisphere, to about 1e-4."""

    def on_grid(p: Floats) -> Floats:
        r = np.sqrt(np.maximum(1 - p[:, 0] ** 2, 0))
        directions = np.stack([r * np.cos(p[:, 1]), r * np.sin(p[:, 1]), p[:, 0]], -1)
        return np.asarray(function(directions.astype(np.float32)), np.float64)

    z = np.linspace(0 if hemisphere else -1, 1, cells[0] + 1)
    phi = np.linspace(-np.pi, np.pi, cells[1] + 1)
    return float(integrate_cells(on_grid, z, phi, samples=1_000_000, precision=0.02).sum())


# --- means -----------------------------------------------------------------------------------------------------------


def assert_mean(
    values: ArrayLike, expected: ArrayLike, *, comparisons: int = 1, alpha: float = ALPHA, slack: float = 1e-6
) -> None:
    """Fail if the mean over axis 0 of independent values (N, ...) differs from ``expected`` by more than chance.

    ``slack`` is the relative error that ``expected``, or float32 arithmetic, may have besides. The threshold is
    corrected for the number of components and for ``comparisons`` calls.
    """
    v = np.asarray(values, np.float64)
    mean, sigma = v.mean(axis=0), v.std(axis=0, ddof=1) / np.sqrt(len(v))
    hoped = np.broadcast_to(np.asarray(expected, np.float64), mean.shape)
    limit = z_threshold(comparisons * max(mean.size, 1), alpha) * sigma + slack * np.maximum(np.abs(hoped), 1e-30)
    excess = np.abs(mean - hoped) - limit
    assert np.all(excess <= 0), f"mean {mean} +- {sigma}, expected {hoped}"


def assert_means_agree(
    mean_a: ArrayLike,
    variance_a: ArrayLike,
    mean_b: ArrayLike,
    variance_b: ArrayLike,
    *,
    comparisons: int = 1,
    alpha: float = ALPHA,
    slack: float = 1e-6,
) -> None:
    """Fail if two estimates, component by component, differ by more than chance (two-sample z-test).

    The variances are those of the means (sample variance over the number of samples) and must come from enough samples
    for the means to be near normal. The threshold is corrected for the number of components. ``slack``: relative
    difference that is tolerated besides.
    """
    a, b = np.asarray(mean_a, np.float64), np.asarray(mean_b, np.float64)
    sigma = np.sqrt(np.asarray(variance_a, np.float64) + np.asarray(variance_b, np.float64))
    limit = z_threshold(comparisons * max(a.size, 1), alpha)
    allowed = limit * sigma + slack * np.maximum(np.maximum(np.abs(a), np.abs(b)), 1e-30)
    difference = np.abs(a - b)
    bad = difference > allowed
    if bad.any():
        k = np.unravel_index(int(np.argmax(difference - allowed)), a.shape)
        raise AssertionError(
            f"{int(bad.sum())} of {a.size} means differ; worst at {tuple(map(int, k))}: {a[k]:.6g} and {b[k]:.6g}, "
            f"sigma {sigma[k]:.2g}, allowed {limit:.2f} sigma"
        )
