"""Smooth and rough BSDFs against Mitsuba 3's, direction by direction, where the models coincide."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from bsdf_cases import Case, direction
from mitsuba_scenes import COPPER, mitsuba, rgb

pytestmark = [
    pytest.mark.mitsuba,
    pytest.mark.filterwarnings("ignore"),
    pytest.mark.usefixtures("needs_mitsuba"),
]

Floats = NDArray[np.float64]
GLASS, INDICES = {"transmission_weight": 1.0, "specular_roughness": 0.0}, {"int_ior": 1.5, "ext_ior": 1.0}
CONDUCTOR = {"fresnel": "eta_k", "eta": COPPER[0], "k": COPPER[1]}
METAL = {"eta": rgb(*COPPER[0]), "k": rgb(*COPPER[1])}


def surface(wo: Floats, front: bool) -> Any:
    """An interaction in Mitsuba's local frame, whose z stays on the outward side."""
    mi = mitsuba()
    si = mi.SurfaceInteraction3f()
    si.wi = mi.Vector3f(float(wo[0]), float(wo[1]), float(wo[2]) * (1 if front else -1))
    return si


def smooth_theirs(plugin: dict[str, Any], wo: Floats, front: bool) -> tuple[Floats, Floats, Floats]:
    """Of delta lobes, by steps of the first number: radiance reflected and passed (3,), and where what passes goes."""
    mi = mitsuba()
    bsdf, steps = mi.load_dict(plugin), 1000
    sums, through = np.zeros((2, 3)), np.zeros(3)
    for i in range(steps):
        sample, weight = bsdf.sample(mi.BSDFContext(), surface(wo, front), (i + 0.5) / steps, mi.Point2f(0.5, 0.5))
        wi = np.array([sample.wo[k] for k in range(3)]) * [1, 1, 1 if front else -1]
        sums[int(wi[2] < 0)] += np.array([weight[k] for k in range(3)]) / steps
        through = wi if wi[2] < 0 else through
    return sums[0], sums[1], through


def smooth_ours(case: Case, wo: Floats) -> tuple[Floats, Floats, Floats]:
    n = 1000
    s = case.sample(wo, np.stack([(np.arange(n) + 0.5) / n, *np.full((2, n), 0.5)], -1))
    assert s.delta.all()
    up, down = (np.where(s.transmitted[:, None] == t, s.weight, 0).mean(axis=0) for t in (False, True))
    return up, down, s.wi[s.transmitted][-1] if s.transmitted.any() else np.zeros(3)


SMOOTH = [
    ("dielectric", "dielectric", {"ior": 1.5}, {"type": "dielectric", **INDICES}, True),
    ("dielectric inside", "dielectric", {"ior": 1.5}, {"type": "dielectric", **INDICES}, False),
    ("openpbr glass", "openpbr", GLASS, {"type": "dielectric", **INDICES}, True),
    ("openpbr glass inside", "openpbr", GLASS, {"type": "dielectric", **INDICES}, False),
    ("openpbr sheet", "openpbr", {**GLASS, "geometry_thin_walled": True}, {"type": "thindielectric", **INDICES}, True),
    ("conductor", "conductor", CONDUCTOR, {"type": "conductor", **METAL}, True),
]


@pytest.mark.parametrize("cosine", [1.0, 0.8, 0.5, 0.1])
@pytest.mark.parametrize(("kind", "ours", "theirs", "front"), [p[1:] for p in SMOOTH], ids=[p[0] for p in SMOOTH])
def test_smooth(kind: str, ours: dict[str, Any], theirs: dict[str, Any], front: bool, cosine: float) -> None:
    """What is reflected, what passes with radiance's 1/eta^2, and where to."""
    wo = direction(cosine, 0.15).astype(np.float64)
    for a, b in zip(smooth_ours(Case(kind, ours, front), wo), smooth_theirs(theirs, wo, front), strict=True):
        np.testing.assert_allclose(a, b, rtol=3e-3, atol=2e-3)


ROUGH = [
    (
        "conductor",
        {**CONDUCTOR, "roughness": 0.6},
        {"type": "roughconductor", "distribution": "ggx", "alpha": 0.36, **METAL},
    ),
    (
        "dielectric",
        {"ior": 1.5, "roughness": 0.5},
        {"type": "roughdielectric", "distribution": "ggx", "alpha": 0.25, **INDICES},
    ),
]


@pytest.mark.parametrize("front", [True, False])
@pytest.mark.parametrize(("kind", "ours", "theirs"), ROUGH, ids=[p[0] for p in ROUGH])
def test_rough(kind: str, ours: dict[str, Any], theirs: dict[str, Any], front: bool) -> None:
    """Mitsuba masks and shadows facets by G1 G1, which takes more than the height-correlated G2: by that ratio."""
    if kind == "conductor" and not front:
        return
    mi = mitsuba()
    bsdf, alpha = mi.load_dict(theirs), theirs["alpha"]
    wo = direction(0.6, 0.15).astype(np.float64)
    wi = np.array([direction(c, t) for c in (0.2, 0.5, 0.85) for t in (0.1, 0.35, 0.65)], np.float64)
    if kind == "dielectric":
        wi = np.concatenate([wi, wi * [1, 1, -1]])

    def root(w: Floats) -> Any:
        return np.sqrt(1 + alpha**2 * (1 - w[..., 2] ** 2) / w[..., 2] ** 2)

    uncorrelated = 4 / ((1 + root(wo)) * (1 + root(wi)))
    correlated = 2 / (root(wo) + root(wi))
    flip = np.array([1, 1, 1 if front else -1])
    values = [bsdf.eval(mi.BSDFContext(), surface(wo, front), mi.Vector3f(*map(float, w * flip))) for w in wi]
    expected = np.array([[v[k] for k in range(3)] for v in values]) * (correlated / uncorrelated)[:, None]
    assert (expected > 0).mean() > 0.4
    np.testing.assert_allclose(Case(kind, ours, front).eval(wo, wi), expected, rtol=2e-3, atol=1e-6)
