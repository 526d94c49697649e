"""OpenPBR's samples against its density, by chi-square over a thousand random materials.

`test_bsdf.py` has the same for some materials, of any sharpness, by adaptive integration. Here densities are summed
over a fixed grid, which takes a hundredth of the time: lobes are mirrors or wide enough for it to resolve.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from bsdf_cases import Case, direction
from destello._core import testing
from stats import chi2_counts

Floats = NDArray[np.float64]

DRAWS = 1000
CELLS, NODES = (8, 8), (16, 32)
"""Polar angle by azimuth: cells of the sphere, and nodes of the midpoint rule in each."""


def grid() -> tuple[NDArray[np.float32], Floats]:
    """Directions of the nodes, cell by cell, and the solid angle of each."""
    m, n = CELLS[0] * NODES[0], CELLS[1] * NODES[1]
    theta, phi = np.meshgrid((np.arange(m) + 0.5) * np.pi / m, (np.arange(n) + 0.5) * 2 * np.pi / n, indexing="ij")
    d = np.stack([np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)], -1)
    angle = 2 * np.sin(np.pi / (2 * m)) * np.sin(theta) * 2 * np.pi / n

    def by_cell(a: Any) -> Any:
        return a.reshape(CELLS[0], NODES[0], CELLS[1], NODES[1], -1).swapaxes(1, 2).reshape(m * n, -1)

    return by_cell(d).astype(np.float32), by_cell(angle)[:, 0]


GRID, SOLID_ANGLE = grid()
U = np.random.default_rng(29).random((10_000, 3)).astype(np.float32).clip(0, 1 - 2**-24)


def steps(lo: float, hi: float) -> st.SearchStrategy[float]:
    """Even over the range: Hypothesis' integers come out small more often than not."""
    return st.randoms(use_true_random=True).map(lambda r: lo + (hi - lo) * r.randint(0, 1000) / 1000)


LIMITS = {
    "specular_ior": (1.8, 8.0), "specular_weight": (0.6, 2.0), "coat_ior": (1.0, 8.0),
    "specular_roughness_anisotropy": (0.0, 0.4), "coat_roughness_anisotropy": (0.0, 0.4),
    "geometry_coat_normal_scale": (0.0, 1.0),
}  # fmt: skip
MAPPED = {
    "geometry_coat_normal": st.tuples(steps(0, 1), steps(0, 1), steps(0.5, 1)),
    "geometry_coat_tangent": st.tuples(steps(0, 1), steps(0, 1), st.just(0.5)),
}
"""What maps say: normals on the outside, tangents along the surface."""


def parameters() -> st.SearchStrategy[dict[str, Any]]:
    """Every parameter of the material, over its range or over what keeps lobes wide; shares are nothing or all, too."""
    drawn: dict[str, st.SearchStrategy[Any]] = {}
    for p in testing.bsdf_params("openpbr"):
        name = p["name"]
        if name in MAPPED:
            drawn[name] = MAPPED[name]
            continue
        lo, hi = LIMITS.get(name, (max(p["min"], -4.0), min(p["max"], 4.0)))
        if name in ("specular_ior", "coat_ior"):
            drawn[name] = st.one_of(steps(lo, hi), st.sampled_from([30.0, 100.0, 1e9]))
        elif p["kind"] == "bool":
            drawn[name] = st.booleans()
        elif p["kind"] != "scalar":
            drawn[name] = st.tuples(*[steps(lo, hi)] * 3)
        elif name.endswith("roughness") and name.split("_")[0] in ("specular", "coat"):
            drawn[name] = st.one_of(st.just(0.0), steps(0.5, 1))
        elif name.endswith(("weight", "metalness")):
            drawn[name] = st.one_of(st.sampled_from([lo, min(hi, 1.0)]), steps(lo, hi))
        else:
            drawn[name] = steps(lo, hi)
    return st.fixed_dictionaries(drawn).map(smooth_below_smooth)


def smooth_below_smooth(words: dict[str, Any]) -> dict[str, Any]:
    """A rough coat makes what is smooth below it a little rough: too sharp for the grid."""
    return {**words, "coat_roughness": 0.0} if words["specular_roughness"] == 0 else words


@settings(max_examples=DRAWS, derandomize=True, deadline=None, suppress_health_check=list(HealthCheck))
@given(parameters(), steps(0.25, 1), steps(0, 1), st.booleans(), st.sampled_from([1.0, 1.33]))
def test_samples_follow_the_density(
    words: dict[str, Any], cosine: float, turns: float, front: bool, outside: float
) -> None:
    case, wo = Case("openpbr", words, front, outside), direction(cosine, turns)
    s = case.sample(wo, U)
    w = s.wi[s.spread]
    expected = (case.pdf(wo, GRID) * SOLID_ANGLE).reshape(CELLS[0] * CELLS[1], -1).sum(axis=1)
    assert expected.sum() < 1.01  # refraction next to the critical angle is sharp
    theta, phi = np.arccos(w[:, 2].clip(-1, 1)) / np.pi, np.arctan2(w[:, 1], w[:, 0]) / (2 * np.pi) % 1
    cell = np.minimum((theta * CELLS[0]).astype(int), CELLS[0] - 1) * CELLS[1] + (phi * CELLS[1]).astype(int) % CELLS[1]
    counts = np.bincount(cell, minlength=CELLS[0] * CELLS[1])
    rest = max(1 - expected.sum(), 0)  # mirrors, and samples that gave nothing
    chances = np.append(expected, rest)
    chi2_counts([*counts, len(U) - len(w)], len(U) * chances / chances.sum()).check(comparisons=DRAWS)
