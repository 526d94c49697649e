"""OpenPBR over random parameters: energy, samples against densities; films and peers."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.stats import qmc

from bsdf_cases import Case, direction
from destello._core import testing
from mitsuba_scenes import mitsuba
from openpbr_draws import ANISOTROPY, BASE, COAT, COLOURS, DRAWS, MORE, TOP, draws, tilts, views

Floats = NDArray[np.float64]

U = qmc.Sobol(3, rng=7).random(4096).astype(np.float32).clip(0, 1 - 2**-24)
WHITE = dict.fromkeys(("base_color", "subsurface_color"), 1.0)


def case(params: dict[str, Any], *, front: bool = True, outside: float = 1.0, tilt: Any = None) -> Case:
    return Case("openpbr", params, front, outside, tilt=tilt)


def mean_power(c: Case, view: tuple[float, float]) -> tuple[Floats, Floats]:
    """Albedo (3,), and by how much its estimate may be off: four standard errors of as many independent samples."""
    power = c.sample(direction(*view), U).power()
    return power.mean(axis=0), 4 * power.std(axis=0) / np.sqrt(len(power))


@DRAWS
@given(draws(BASE, TOP, COAT, ANISOTROPY), views, st.booleans(), st.sampled_from([1.0, 1.33]), tilts)
def test_white_furnace(
    params: dict[str, Any], view: tuple[float, float], front: bool, outside: float, tilt: Any
) -> None:
    """Whatever the layers: what comes in goes out, within what the tables' interpolation makes."""
    if params["base_metalness"] > 0:
        params = {**params, "specular_weight": 1.0}  # which is metal's reflectance
    albedo, slack = mean_power(case({**params, **WHITE}, front=front, outside=outside, tilt=tilt), view)
    tables = 0.01 if any(params[name] > 0 for name in ANISOTROPY) else 0.006
    np.testing.assert_allclose(albedo, 1, atol=float(slack.max()) + tables)


@DRAWS
@given(draws(BASE, TOP, COAT, COLOURS, MORE), views, st.booleans(), tilts)
def test_never_more_than_came(params: dict[str, Any], view: tuple[float, float], front: bool, tilt: Any) -> None:
    c = case(params, front=front, tilt=tilt)
    s = c.sample(direction(*view), U)
    assert np.isfinite(s.weight).all()
    assert (s.weight[s.ok] >= 0).all()
    albedo, slack = mean_power(c, view)
    assert (albedo <= 1.03 + slack).all()


@DRAWS
@given(draws(BASE, TOP, COAT, COLOURS, MORE), views, st.booleans(), tilts)
def test_weight_is_eval_over_pdf(params: dict[str, Any], view: tuple[float, float], front: bool, tilt: Any) -> None:
    c, wo = case(params, front=front, tilt=tilt), direction(*view)
    s = c.sample(wo, U[:512])
    k = s.spread & (s.pdf < 1e4)  # narrower lobes magnify the rounding of wi
    if not k.any():
        return
    pdf = c.pdf(wo, s.wi[k])
    np.testing.assert_allclose(pdf, s.pdf[k], rtol=0.02)
    np.testing.assert_allclose(c.eval(wo, s.wi[k]) / pdf[:, None], s.weight[k], rtol=0.03, atol=1e-5)


# --- thin film -------------------------------------------------------------------------------------------------------


def film_reflectance(cosine: float, film: float, base: float, nanometres: float, wavelength: Floats) -> Floats:
    """A film of that index and thickness on a base, by the transfer matrices of both polarisations."""
    out = np.zeros(len(wavelength))
    sine = np.sqrt(1 - cosine**2)
    cos = [cosine, np.sqrt(1 - (sine / film) ** 2 + 0j), np.sqrt(1 - (sine / base) ** 2 + 0j)]
    for polarisation in "sp":
        y = [n * c if polarisation == "s" else n / c for n, c in zip((1, film, base), cos, strict=True)]
        beta = 2 * np.pi * film * nanometres * cos[1] / wavelength
        b = np.cos(beta) + 1j * np.sin(beta) * y[2] / y[1]
        c = y[2] * np.cos(beta) + 1j * np.sin(beta) * y[1]
        out += np.abs((y[0] * b - c) / (y[0] * b + c)) ** 2 / 2
    return out


@pytest.mark.parametrize("cosine", [1.0, 0.6, 0.2])
@pytest.mark.parametrize("nanometres", [0.0, 150.0, 420.0, 800.0])
def test_film_on_glass(nanometres: float, cosine: float) -> None:
    params = {
        "transmission_weight": 1.0,
        "specular_roughness": 0.0,
        "thin_film_weight": 1.0,
        "thin_film_ior": 1.9,
        "thin_film_thickness": nanometres / 1000,
    }
    wo = direction(cosine, 0.1)

    def reflected(c: Case) -> Floats:
        s = c.sample(wo, np.stack([(np.arange(4000) + 0.5) / 4000, *np.full((2, 4000), 0.5)], -1))
        return np.asarray(np.where(s.transmitted[:, None], 0, s.power()).mean(axis=0))

    for nm in (430.0, 555.0, 690.0):
        expected = film_reflectance(cosine, 1.9, 1.5, nanometres, np.array([nm]))[0]
        got = reflected(Case("openpbr", params, wavelength=nm))
        np.testing.assert_allclose(got, expected, atol=1e-3)
    lo, hi = testing.WAVELENGTHS
    nm = lo + (hi - lo) * (np.arange(2000) + 0.5) / 2000
    weight = np.asarray(testing.wavelength_weight(nm.astype(np.float32)), np.float64)
    expected = (weight * film_reflectance(cosine, 1.9, 1.5, nanometres, nm)[:, None]).mean(axis=0)
    np.testing.assert_allclose(reflected(case(params)), expected.clip(0, 1), atol=0.012)


def test_no_film_and_film_of_the_base_are_the_same() -> None:
    wi = np.array([direction(c, t) for c in (0.2, 0.5, 0.9) for t in (0.0, 0.4)])
    plain = case({"specular_roughness": 0.4})
    film = case({"specular_roughness": 0.4, "thin_film_weight": 1.0, "thin_film_ior": 1.5})
    np.testing.assert_allclose(film.eval(direction(0.6, 0.1), wi), plain.eval(direction(0.6, 0.1), wi), rtol=0.01)


# --- peers -----------------------------------------------------------------------------------------------------------


def mitsuba_eval(bsdf: dict[str, Any], wo: Floats, wi: Floats) -> Floats:
    """f |cos| (N, 3) of a Mitsuba BSDF in its local frame; radiance flows to wo."""
    mi = mitsuba()
    b, si = mi.load_dict(bsdf), mi.SurfaceInteraction3f()
    si.wi = mi.Vector3f(*(float(x) for x in wo))
    values = [b.eval(mi.BSDFContext(), si, mi.Vector3f(*(float(x) for x in w))) for w in wi]
    return np.array([[v[k] for k in range(3)] for v in values], np.float64)


def grid(down: bool) -> Floats:
    turns = (0.0, 0.3, 0.45, 0.5, 0.55)
    up = np.array([direction(c, t) for c in (0.15, 0.35, 0.6, 0.8, 0.95) for t in turns], np.float64)
    return np.concatenate([up, up * [1, 1, -1]]) if down else up


ROUGHPLASTIC = {"type": "roughplastic", "distribution": "ggx", "int_ior": 1.5, "ext_ior": 1.0}
PEERS = [
    (
        "principled metal",
        {"base_metalness": 1.0, "base_color": (0.9, 0.6, 0.3), "specular_roughness": 0.3},
        {
            "type": "principled",
            "base_color": {"type": "rgb", "value": [0.9, 0.6, 0.3]},
            "metallic": 1.0,
            "roughness": 0.3,
        },
        False,
        0.04,
    ),
    (
        "roughconductor",
        {"base_metalness": 1.0, "base_color": 1.0, "specular_roughness": 0.3},
        {"type": "roughconductor", "material": "none", "distribution": "ggx", "alpha": 0.09},
        False,
        0.04,
    ),
    (
        "roughdielectric",
        {"transmission_weight": 1.0, "specular_roughness": 0.3},
        {"type": "roughdielectric", "distribution": "ggx", "alpha": 0.09, "int_ior": 1.5, "ext_ior": 1.0},
        True,
        0.04,
    ),
    (
        "roughplastic",
        {"base_color": 1.0, "specular_roughness": 0.15},
        {**ROUGHPLASTIC, "alpha": 0.0225, "diffuse_reflectance": {"type": "rgb", "value": 1.0}},
        False,
        0.05,
    ),
    (
        "roughplastic's gloss",
        {"base_color": 0.0, "specular_roughness": 0.4},
        {**ROUGHPLASTIC, "alpha": 0.16, "diffuse_reflectance": {"type": "rgb", "value": 0.0}},
        False,
        0.05,
    ),
]


@pytest.mark.mitsuba
@pytest.mark.usefixtures("needs_mitsuba")
@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("peer", PEERS, ids=[p[0] for p in PEERS])
def test_agrees_with_mitsuba_where_the_models_coincide(peer: Any) -> None:
    """At roughness where one scattering among the facets is nearly all: the even rest is added to the tolerance."""
    _, params, bsdf, down, tolerance = peer
    wi = grid(down)
    for view in ((0.95, 0.0), (0.6, 0.0), (0.3, 0.0)):
        wo = np.asarray(direction(*view), np.float64)
        ours, theirs = case(params).eval(wo, wi), mitsuba_eval(bsdf, wo, wi)
        np.testing.assert_allclose(ours, theirs, rtol=tolerance, atol=0.012)


@pytest.mark.mitsuba
@pytest.mark.usefixtures("needs_mitsuba")
@pytest.mark.filterwarnings("ignore")
def test_white_plastic_keeps_what_roughplastic_loses() -> None:
    """Why the two part at higher roughness: integrals over all directions, of white plastic at roughness 0.4.

    The gloss is the same (above). Mitsuba's diffuse part enters and leaves by single scattering, and loses a sixth.
    """
    theirs = {**ROUGHPLASTIC, "alpha": 0.16, "diffuse_reflectance": {"type": "rgb", "value": 1.0}}
    z, w = np.polynomial.legendre.leggauss(24)
    wi = np.array([direction((a + 1) / 2, (b + 0.5) / 24) for a in z for b in range(24)], np.float64)
    weights = np.repeat(w, 24) * np.pi / 24
    for cosine in (0.95, 0.6):
        wo = np.asarray(direction(cosine, 0.0), np.float64)
        assert case({"base_color": 1.0, "specular_roughness": 0.4}).eval(wo, wi)[:, 0] @ weights == pytest.approx(
            1, abs=0.01
        )
        assert mitsuba_eval(theirs, wo, wi)[:, 0] @ weights == pytest.approx(0.84, abs=0.02)
