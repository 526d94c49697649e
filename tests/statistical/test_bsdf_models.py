"""Each material against what its model says in closed form, by independent quadrature or by brute force."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from bsdf_cases import OUTGOING, Case, direction
from destello._core import testing
from stats import ALPHA, assert_mean, chi2_counts, integrate_sphere

Floats = NDArray[np.float64]
VIEWS = pytest.mark.parametrize("view", OUTGOING, ids=[f"cos={c}" for c, _ in OUTGOING])


def uniform(n: int, seed: int) -> NDArray[np.float32]:
    return np.random.default_rng(seed).random((n, 3)).astype(np.float32).clip(0, 1 - 2**-24)


def albedo(case: Case, wo: Any) -> float:
    """Reflected share of light, by quadrature of eval over the hemisphere."""
    return integrate_sphere(lambda d: case.eval(wo, d)[:, 1], hemisphere=True)


# --- diffuse ---------------------------------------------------------------------------------------------------------


def test_lambert_is_constant() -> None:
    case = Case("diffuse", {"reflectance": (0.2, 0.5, 0.9)})
    wi = np.array([direction(c, t) for c in (0.1, 0.5, 1.0) for t in (0, 0.3)])
    expected = np.array([0.2, 0.5, 0.9]) / np.pi * wi[:, 2:]
    np.testing.assert_allclose(case.eval(direction(0.4, 0.6), wi), expected, rtol=2e-6)
    s = case.sample(direction(0.4, 0.6), uniform(100, 1))
    np.testing.assert_allclose(s.weight, np.broadcast_to([0.2, 0.5, 0.9], (100, 3)), rtol=1e-6)
    assert not case.eval(direction(0.4, 0.6), -wi).any()


@VIEWS
@pytest.mark.parametrize("roughness", [0.0, 0.25, 1.0])
def test_diffuse_white_furnace(roughness: float, view: tuple[float, float]) -> None:
    """White reflects everything at any roughness."""
    case = Case("diffuse", {"reflectance": 1.0, "roughness": roughness})
    assert albedo(case, direction(*view)) == pytest.approx(1, abs=3e-4)


def test_rough_diffuse_is_flatter_and_retroreflects() -> None:
    case, wo = Case("diffuse", {"reflectance": 0.5, "roughness": 1.0}), direction(0.4, 0.0)
    back, forward = case.eval(wo, direction(0.4, 0.0))[0, 0], case.eval(wo, direction(0.4, 0.5))[0, 0]
    assert back > 1.3 * forward


# --- fuzzy metal -----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("fuzz", [0.05, 0.3, 1.0])
@pytest.mark.parametrize("cosine", [1.0, 0.5, 0.1])
def test_fuzz_density_against_the_books_rejection(fuzz: float, cosine: float) -> None:
    """The book's own procedure (a point in the ball by rejection) fills a histogram as the closed form says."""
    rng = np.random.default_rng(int(1000 * fuzz + 10 * cosine))
    wo = direction(cosine, 0.2).astype(np.float64)
    mirror = np.array([-wo[0], -wo[1], wo[2]])
    cube = rng.uniform(-1, 1, (400_000, 3))
    ball = cube[(cube**2).sum(axis=1) < 1]
    scattered = mirror + fuzz * ball
    scattered /= np.linalg.norm(scattered, axis=1, keepdims=True)
    kept = scattered[:, 2] > 0
    # Rings about the mirror direction, split by azimuth about it: cells that are exact where all is above the horizon.
    angle = np.arccos(np.clip(scattered @ mirror, -1, 1))
    lines = np.arcsin(fuzz) * np.linspace(0, 1, 21)
    counts = np.histogram(angle[kept], lines)[0]
    case = Case("fuzzy_metal", {"fuzz": fuzz})
    nodes, weights = np.polynomial.legendre.leggauss(8)
    azimuth = (np.arange(256) + 0.5) / 256 * 2 * np.pi
    x = np.cross(mirror, [0.3, 0.9, 0.1])
    x /= np.linalg.norm(x)
    y = np.cross(mirror, x)
    expected = []
    for lo, hi in itertools.pairwise(lines):
        t = (lo + hi) / 2 + (hi - lo) / 2 * nodes
        tt, aa = np.meshgrid(t, azimuth, indexing="ij")
        d = np.cos(tt)[..., None] * mirror + np.sin(tt)[..., None] * (
            np.cos(aa)[..., None] * x + np.sin(aa)[..., None] * y
        )
        p = case.pdf(wo, d.reshape(-1, 3)).reshape(tt.shape).mean(axis=1) * 2 * np.pi * np.sin(t)
        expected.append(len(ball) * float(p @ weights) * (hi - lo) / 2)
    absorbed = len(ball) - kept.sum()
    r = chi2_counts([*counts, absorbed], [*expected, len(ball) - sum(expected)])
    r.check(comparisons=9, alpha=ALPHA)


def test_fuzz_zero_is_a_mirror_and_tiny_fuzz_nearly_one() -> None:
    wo = direction(0.6, 0.1)
    s = Case("fuzzy_metal", {"fuzz": 0.0, "albedo": (0.7, 0.6, 0.5)}).sample(wo, uniform(50, 1))
    assert s.delta.all()
    np.testing.assert_allclose(s.wi, np.broadcast_to([-wo[0], -wo[1], wo[2]], (50, 3)))
    np.testing.assert_allclose(s.weight, np.broadcast_to([0.7, 0.6, 0.5], (50, 3)))
    near = Case("fuzzy_metal", {"fuzz": 2e-4}).sample(wo, uniform(20_000, 2))
    assert near.ok.mean() > 0.999
    assert np.abs(near.wi[near.ok] - [-wo[0], -wo[1], wo[2]]).max() < 2.1e-4


# --- GGX -------------------------------------------------------------------------------------------------------------


def smith_g2(a: Floats, b: Floats, ax: float, ay: float) -> Floats:
    def lam(w: Floats) -> Floats:
        tan2 = ((ax * w[..., 0]) ** 2 + (ay * w[..., 1]) ** 2) / w[..., 2] ** 2
        return (np.sqrt(1 + tan2) - 1) / 2

    return 1 / (1 + lam(a) + lam(b))


def microfacets(ax: float, ay: float, n: int = 300) -> tuple[Floats, Floats]:
    """Normals h, and D(h) cos(h) dh for each, which sum to 1: a midpoint rule in polar coordinates of the slopes.

    GGX slopes have density 1 / (pi ax ay (1 + r^2)^2) in (r, phi), so 1 / (1 + r^2) is uniform; its fourth root spreads
    the nodes far into the tail, on which grazing views depend.
    """
    u = (np.arange(n) + 0.5) / n
    uu, vv = np.meshgrid(u, u, indexing="ij")
    r = np.sqrt(1 / uu**4 - 1)
    sx, sy = ax * r * np.cos(2 * np.pi * vv), ay * r * np.sin(2 * np.pi * vv)
    h = np.stack([-sx, -sy, np.ones_like(sx)], -1).reshape(-1, 3)
    return h / np.linalg.norm(h, axis=1, keepdims=True), (4 * uu**3 / n**2).ravel()


def reflected_albedo(wo: Floats, ax: float, ay: float, fresnel: Callable[[Floats], Floats]) -> float:
    """Integral over normals of F G2 (wo.h) / (wo.n h.n) D cos(h): single scattering as Walter et al. 2007 write it."""
    h, weight = microfacets(ax, ay)
    cosine = h @ wo
    wi = 2 * cosine[:, None] * h - wo
    ok = (cosine > 0) & (wi[:, 2] > 0)
    h, weight, cosine, wi = h[ok], weight[ok], cosine[ok], wi[ok]
    return float(np.sum(weight * fresnel(cosine) * smith_g2(wo, wi, ax, ay) * cosine / (wo[2] * h[:, 2])))


@VIEWS
@pytest.mark.parametrize(("roughness", "anisotropy"), [(0.2, 0.0), (0.6, 0.0), (1.0, 0.0), (0.5, 0.7), (0.5, -0.7)])
def test_conductor_furnace(roughness: float, anisotropy: float, view: tuple[float, float]) -> None:
    """A white metal loses exactly what single scattering between microfacets loses."""
    case = Case("conductor", {"roughness": roughness, "anisotropy": anisotropy, "fresnel": "none", "reflectance": 1.0})
    wo = direction(*view)
    aspect = np.sqrt(1 - 0.9 * abs(anisotropy))
    wide, narrow = min(roughness**2 / aspect, 1.0), roughness**2 * aspect
    ax, ay = (wide, narrow) if anisotropy >= 0 else (narrow, wide)
    expected = reflected_albedo(wo.astype(np.float64), ax, ay, np.ones_like)
    assert_mean(case.sample(wo, uniform(100_000, 3)).power(), expected, comparisons=20, slack=2e-3)
    assert albedo(case, wo) == pytest.approx(expected, abs=2e-3)


def test_distribution_of_normals() -> None:
    """D as the textbooks have it: at normal incidence the core's density is D / 4; D cos integrates to 1."""
    for roughness in (0.3, 0.8):
        case = Case("conductor", {"roughness": roughness, "fresnel": "none", "reflectance": 1.0})
        h, weight = microfacets(roughness**2, roughness**2, 200)
        wi = 2 * h[:, 2:] * h - [0, 0, 1]
        ok = wi[:, 2] > 0.01
        alpha2 = roughness**4
        d = alpha2 / (np.pi * (h[:, 2] ** 2 * (alpha2 - 1) + 1) ** 2)  # textbook form of isotropic GGX
        np.testing.assert_allclose(case.pdf((0, 0, 1), wi[ok]), d[ok] / 4, rtol=2e-4)
        assert weight.sum() == pytest.approx(1, abs=1e-4)


def test_smooth_conductor_follows_fresnel() -> None:
    eta, k = np.array([0.2, 0.92, 1.1]), np.array([3.9, 2.45, 2.2])
    case = Case("conductor", {"fresnel": "eta_k", "eta": tuple(eta), "k": tuple(k)})
    for cosine in (1.0, 0.7, 0.2, 0.05):
        s = case.sample(direction(cosine, 0.3), uniform(1, 1))
        assert s.delta.all()
        np.testing.assert_allclose(s.weight[0], conductor_fresnel(cosine, eta + 1j * k), rtol=2e-5)
    # Under water the relative index counts.
    wet = Case("conductor", case.params, outside_ior=1.33).sample(direction(0.7, 0.3), uniform(1, 1))
    np.testing.assert_allclose(wet.weight[0], conductor_fresnel(0.7, (eta + 1j * k) / 1.33), rtol=2e-5)
    white = Case("conductor", {"reflectance": (1.0, 0.5, 0.2)}).sample(direction(0.3, 0), uniform(1, 1))
    np.testing.assert_allclose(white.weight[0], 1 - (1 - np.array([1.0, 0.5, 0.2])) * (1 - 0.7**5), rtol=1e-5)


def conductor_fresnel(cosine: float, n: NDArray[np.complex128]) -> Floats:
    """Fresnel's equations in complex numbers."""
    cos_t = np.sqrt(1 - (1 - cosine**2) / n**2 + 0j)
    rs, rp = (cosine - n * cos_t) / (cosine + n * cos_t), (n * cosine - cos_t) / (n * cosine + cos_t)
    return np.asarray((abs(rs) ** 2 + abs(rp) ** 2) / 2, np.float64)


# --- dielectric ------------------------------------------------------------------------------------------------------


def dielectric_fresnel(cosine: float, eta: float) -> float:
    """Fresnel's equations by angles: the sine and tangent laws."""
    i = np.arccos(cosine)
    if np.sin(i) >= eta:
        return 1.0
    t = np.arcsin(np.sin(i) / eta)
    if i < 1e-6:
        return float(((1 - eta) / (1 + eta)) ** 2)
    return float((np.sin(i - t) ** 2 / np.sin(i + t) ** 2 + np.tan(i - t) ** 2 / np.tan(i + t) ** 2) / 2)


@pytest.mark.parametrize("inside", [False, True])
@pytest.mark.parametrize("ior", [1.1, 1.5, 2.42])
@pytest.mark.parametrize("cosine", [1.0, 0.8, 0.55, 0.3, 0.05])
def test_smooth_dielectric_fresnel_and_snell(inside: bool, ior: float, cosine: float) -> None:
    case = Case("dielectric", {"ior": ior}, front=not inside)
    eta = 1 / ior if inside else ior
    wo = direction(cosine, 0.35).astype(np.float64)
    n = 4000
    u = np.stack([(np.arange(n) + 0.5) / n, np.full(n, 0.5), np.full(n, 0.5)], -1)
    s = case.sample(wo, u)
    reflectance = dielectric_fresnel(cosine, eta)
    assert s.delta.all()
    assert (~s.transmitted).mean() == pytest.approx(reflectance, abs=1 / n)
    np.testing.assert_allclose(s.wi[~s.transmitted], np.broadcast_to([-wo[0], -wo[1], wo[2]], (n, 3))[~s.transmitted])
    np.testing.assert_allclose(s.power(), 1, rtol=1e-4)  # each lobe is picked by its share
    if reflectance == 1:  # total internal reflection
        assert not s.transmitted.any()
        return
    t = s.wi[s.transmitted]
    np.testing.assert_allclose(eta * t[:, :2], np.broadcast_to(-wo[:2], (len(t), 2)), atol=1e-6)  # Snell, in the plane
    np.testing.assert_allclose(s.eta[s.transmitted], eta, rtol=1e-6)
    np.testing.assert_allclose(s.weight[s.transmitted], 1 / eta**2, rtol=1e-4)


def test_dielectric_fresnel_by_known_values() -> None:
    assert testing.fresnel_dielectric(1.0, 1.5)[0] == pytest.approx(0.04, rel=1e-5)
    brewster = np.cos(np.arctan(1.5))
    rs = ((1.5**2 - 1) / (1.5**2 + 1)) ** 2  # at Brewster's angle only s-polarised light is reflected
    assert testing.fresnel_dielectric(brewster, 1.5)[0] == pytest.approx(rs / 2, rel=1e-5)
    assert testing.fresnel_dielectric(0.0, 1.5)[0] == pytest.approx(1)
    critical = np.sqrt(1 - 1 / 1.5**2)
    assert testing.fresnel_dielectric(critical - 1e-3, 1 / 1.5)[0] == 1
    assert testing.fresnel_dielectric(critical + 1e-3, 1 / 1.5)[0] < 1


def test_schlick_is_the_books_formula_outside_and_reciprocal_inside() -> None:
    for cosine in (1.0, 0.6, 0.1):
        got, cos_t = testing.fresnel_dielectric(cosine, 1.5, True)
        assert got == pytest.approx(0.04 + 0.96 * (1 - cosine) ** 5, rel=1e-5)
        assert testing.fresnel_dielectric(cos_t, 1 / 1.5, True)[0] == pytest.approx(got, rel=1e-4)
    assert testing.fresnel_dielectric(0.5, 1 / 1.5, True)[0] == 1


def test_dielectric_tints() -> None:
    case = Case("dielectric", {"tint": (0.9, 0.5, 0.1), "reflection_tint": (0.1, 0.2, 1.0)})
    wo = direction(0.3, 0)
    s = case.sample(wo, uniform(200_000, 4))
    r = dielectric_fresnel(float(wo[2]), 1.5)
    up = np.where(s.transmitted[:, None], 0, s.power())
    down = np.where(s.transmitted[:, None], s.power(), 0)
    assert_mean(up, r * np.array([0.1, 0.2, 1.0]), comparisons=2, slack=1e-4)
    assert_mean(down, (1 - r) * np.array([0.9, 0.5, 0.1]), comparisons=2, slack=1e-4)


def test_matched_dielectric_vanishes() -> None:
    for roughness in (0.0, 0.5):
        for front in (True, False):
            case = Case("dielectric", {"ior": 1.33, "roughness": roughness}, front=front, outside_ior=1.33)
            s = case.sample(direction(0.4, 0.2), uniform(20, 1))
            assert (s.flags == testing.TRANSMISSION | testing.DELTA | testing.STRAIGHT).all()
            np.testing.assert_allclose(s.wi, np.broadcast_to(-direction(0.4, 0.2), (20, 3)))
            np.testing.assert_allclose(s.weight, 1)


@VIEWS
@pytest.mark.parametrize("eta", [1.5, 1 / 1.5])
@pytest.mark.parametrize("roughness", [0.3, 0.9])
def test_rough_dielectric_furnace(roughness: float, eta: float, view: tuple[float, float]) -> None:
    """Reflected and transmitted power against quadrature over the microfacets."""
    case = Case("dielectric", {"roughness": roughness}, front=eta > 1)
    wo = direction(*view)
    alpha = roughness**2
    w = wo.astype(np.float64)

    def fresnel(c: Floats) -> Floats:
        t = np.sqrt(np.maximum(1 - (1 - c**2) / eta**2, 0))
        return (((c - eta * t) / (c + eta * t)) ** 2 + ((t - eta * c) / (t + eta * c)) ** 2) / 2

    reflected = reflected_albedo(w, alpha, alpha, fresnel)
    h, weight = microfacets(alpha, alpha)
    cosine = h @ w
    h, weight, cosine = h[cosine > 0], weight[cosine > 0], cosine[cosine > 0]
    cos2_t = 1 - (1 - cosine**2) / eta**2
    wi = h * (cosine / eta - np.sqrt(np.maximum(cos2_t, 0)))[:, None] - w / eta
    ok = (cos2_t > 0) & (wi[:, 2] < 0)
    h, weight, cosine, wi = h[ok], weight[ok], cosine[ok], wi[ok]
    terms = weight * (1 - fresnel(cosine)) * smith_g2(w, wi, alpha, alpha) * cosine / (w[2] * h[:, 2])
    s = case.sample(wo, uniform(150_000, 5))
    up, down = (np.where(s.transmitted == t, s.power()[:, 0], 0) for t in (False, True))
    assert_mean(up, reflected, comparisons=32, slack=3e-3)
    assert_mean(down, float(terms.sum()), comparisons=32, slack=3e-3)
    # eval and pdf themselves, by quadrature over the sphere, with radiance's factor taken out below
    got = integrate_sphere(lambda d: case.eval(wo, d)[:, 0] * np.where(d[:, 2] < 0, eta**2, 1))
    assert got == pytest.approx(reflected + float(terms.sum()), abs=4e-3)


# --- metallic-roughness ----------------------------------------------------------------------------------------------


@VIEWS
@pytest.mark.parametrize("roughness", [0.05, 0.3, 0.6, 1.0])
@pytest.mark.parametrize("ior", [1.3, 1.5, 2.5])
def test_dielectric_layer_over_white_base_loses_nothing(
    roughness: float, ior: float, view: tuple[float, float]
) -> None:
    case = Case("metallic_roughness", {"metallic": 0.0, "roughness": roughness, "ior": ior})
    s = case.sample(direction(*view), uniform(60_000, 6))
    assert_mean(s.power()[:, 0], 1, comparisons=48, slack=4e-3)


@pytest.mark.parametrize("cosine", [0.01, 0.03, 0.1, 0.3, 0.6, 1.0])
@pytest.mark.parametrize("roughness", [0.05, 0.1, 0.15, 0.3, 0.5, 0.7, 1.0])
def test_metallic_roughness_white_furnace(roughness: float, cosine: float) -> None:
    """White loses nothing, be it metal, dielectric, a thin wall or any mixture of them."""
    for metallic, more in itertools.product(
        (0.0, 0.5, 1.0), ({}, {"transmission": 0.5}, {"transmission": 1.0}, {"ior": 1000.0, "base_color": 0.0})
    ):
        words: dict[str, Any] = {"metallic": metallic, "roughness": roughness, **more}
        if metallic > 0 and "base_color" in words:
            continue  # a black metal
        s = Case("metallic_roughness", words).sample(direction(cosine, 0.1), uniform(40_000, 8))
        assert_mean(s.power()[:, 0], 1, comparisons=12 * 42, slack=0.012 if roughness < 0.1 else 6e-3)
        if roughness >= 0.1:
            assert s.weight.max() < 15


@VIEWS
@pytest.mark.parametrize("roughness", [0.2, 0.4, 0.7, 1.0])
def test_metal_is_the_conductor_and_what_that_loses(roughness: float, view: tuple[float, float]) -> None:
    """Kulla and Conty's sum over the bounces among the facets, each in the metal's mean colour, comes back evenly."""
    colour = np.array([0.9, 0.5, 0.2])
    wo, wi = direction(*view), np.array([direction(c, t) for c in (0.1, 0.5, 0.9) for t in (0, 0.3, 0.5)])
    metal = Case("metallic_roughness", {"metallic": 1.0, "base_color": tuple(colour), "roughness": roughness})
    conductor = Case("conductor", {"reflectance": tuple(colour), "roughness": roughness})

    def lost(w: Any) -> float:
        return 1 - reflected_albedo(np.asarray(w, np.float64), roughness**2, roughness**2, np.ones_like)

    nodes, weights = np.polynomial.legendre.leggauss(8)
    x = 0.5 + 0.5 * nodes  # square roots of cosines
    mean = float(np.sum(2 * weights * x**3 * [lost(direction(c * c, 0)) for c in x]))
    f = colour + (1 - colour) / 21
    back = sum(f ** (k + 1) * mean ** (k - 1) * (1 - mean) for k in range(1, 200))
    expected = back * lost(wo) * np.array([lost(w) for w in wi])[:, None] / mean / np.pi * wi[:, 2:]
    got = metal.eval(wo, wi) - conductor.eval(wo, wi)
    np.testing.assert_allclose(got, expected, rtol=0.05, atol=5e-4)


def test_thin_transmission_goes_straight_and_is_tinted() -> None:
    words = {"metallic": 0.0, "transmission": 1.0, "base_color": (0.9, 0.5, 0.1), "roughness": 0.0}
    wo = direction(0.7, 0.2)
    s = Case("metallic_roughness", words).sample(wo, uniform(100_000, 7))
    assert s.delta.all()
    down = s.transmitted
    np.testing.assert_allclose(s.wi[down], np.broadcast_to(-wo, s.wi.shape)[down])
    assert (s.eta == 1).all()
    schlick = 0.04 + 0.96 * 0.3**5
    expected = (1 - schlick) * np.array([0.9, 0.5, 0.1])
    assert_mean(np.where(down[:, None], s.weight, 0), expected, comparisons=2, slack=1e-4)
    assert_mean(np.where(down[:, None], 0, s.weight), [schlick] * 3, comparisons=2, slack=1e-4)
    # Rough: symmetric about the straight direction's plane, the reflection's mirror image.
    rough = Case("metallic_roughness", {**words, "base_color": 1.0, "roughness": 0.4})
    wi = np.array([direction(c, t) for c in (0.3, 0.7, 0.9) for t in (0.6, 0.7, 0.8)])
    both = rough.eval(wo, wi) + rough.eval(wo, wi * [1, 1, -1])
    white = Case("conductor", {"fresnel": "none", "reflectance": 1.0, "roughness": 0.4})
    spread = both - white.eval(wo, wi)  # what facets lose, evenly
    even = spread / wi[:, 2:]
    assert (spread > 0).all()
    np.testing.assert_allclose(even, np.repeat(even[::3], 3, axis=0), rtol=1e-3)


# --- markers ---------------------------------------------------------------------------------------------------------


def test_interface_is_invisible() -> None:
    s = Case("interface").sample(direction(0.4, 0.2), uniform(20, 1))
    assert (s.flags == testing.TRANSMISSION | testing.DELTA | testing.STRAIGHT).all()
    np.testing.assert_array_equal(s.wi, np.broadcast_to(-direction(0.4, 0.2).astype(np.float64), (20, 3)))
    assert (s.weight == 1).all()


@pytest.mark.parametrize("kind", ["emissive", "mix"])
def test_no_lobes(kind: str) -> None:
    assert not Case(kind).sample(direction(0.4, 0.2), uniform(20, 1)).ok.any()
    assert Case(kind).traits()["delta_only"]
