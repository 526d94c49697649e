"""Black bodies and metals: against tabulated chromaticities, and against the constants that they were made from."""

from __future__ import annotations

import numpy as np
import pytest

import destello as dl
from destello import metals
from destello.errors import InputError, SceneError
from destello.spectrum import WAVELENGTHS, XYZ_TO_RGB, blackbody_glow, blackbody_rgb, blackbody_xyz, observer, planck

# The Planckian locus, CIE 1931 (x, y): G. Wyszecki and W. S. Stiles 1982, "Color Science", table 1(3.11).
LOCUS = {
    1500: (0.5857, 0.3931),
    2000: (0.5267, 0.4133),
    2856: (0.4476, 0.4074),
    4000: (0.3805, 0.3768),
    5000: (0.3451, 0.3516),
    6500: (0.3135, 0.3237),
    10000: (0.2807, 0.2884),
}


@pytest.mark.parametrize("kelvin", LOCUS)
def test_planckian_locus(kelvin):
    """To what the fits of the observer are good for; better above 2500 K."""
    xyz = blackbody_xyz(kelvin)
    np.testing.assert_allclose(xyz[:2] / xyz.sum(), LOCUS[kelvin], atol=2e-3 if kelvin > 2500 else 6e-3)


def test_daylight_is_nearly_white():
    """D65 lies beside the black body of 6504 K: a little greener."""
    red, green, blue = dl.blackbody(6504)
    assert (red, green, blue) == pytest.approx((1, 1, 1), abs=0.06)
    assert green < min(red, blue)


def test_luminance_is_what_was_asked_for():
    for kelvin in (500, 1000, 1900, 6500, 1e6):
        assert np.dot(dl.blackbody(kelvin, 3.0), (0.2126, 0.7152, 0.0722)) == pytest.approx(3, rel=1e-4)
        assert min(dl.blackbody(kelvin)) >= 0


def test_hotter_is_bluer_and_brighter():
    kelvin = np.linspace(1000, 20000, 200)
    rgb = blackbody_rgb(kelvin)
    assert (np.diff(rgb[:, 0]) < 0).all()
    assert (np.diff(rgb[:, 2]) >= 0).all()
    assert (np.diff(blackbody_xyz(kelvin)[:, 1]) > 0).all()


def test_wiens_displacement_law():
    """The peak in wavelength times temperature is a constant: 2897.77 um K."""
    nm = np.linspace(300, 1500, 120_001)
    for kelvin in (2500, 4000, 6000):
        assert nm[np.argmax(planck(nm, kelvin))] * kelvin == pytest.approx(2.897771955e6, rel=1e-4)


def test_observer_has_the_area_and_the_white_it_should():
    """Equal areas under the three curves, 106.857 nm each; light of equal energy at (1/3, 1/3)."""
    np.testing.assert_allclose(observer().sum(1), 106.857, rtol=4e-3)
    assert WAVELENGTHS[1] - WAVELENGTHS[0] == 1
    np.testing.assert_allclose(XYZ_TO_RGB @ (0.95047, 1, 1.08883), 1, atol=1e-4)


@pytest.mark.parametrize("kelvin", [0, 499, -1, 2e6, float("nan"), float("inf")])
def test_wrong_temperatures(kelvin):
    with pytest.raises(InputError, match="500 to 1e\\+06 K"):
        dl.blackbody(kelvin)
    with pytest.raises(InputError, match="at least 0"):
        dl.blackbody(3000, -1)
    with pytest.raises(InputError, match="temperature: 'hot'"):
        dl.blackbody("hot")  # type: ignore[arg-type]


def test_glow_of_a_fire():
    kelvin = np.array([[0.0, 300.0, 499.0], [800.0, 1200.0, 1500.0]], np.float32)
    glow = blackbody_glow(kelvin)
    assert glow.dtype == np.float32
    assert not glow[0].any()
    assert glow[1, 2] @ (0.2126, 0.7152, 0.0722) == pytest.approx(1, rel=1e-3)
    expected = blackbody_xyz(1200.0)[1] / blackbody_xyz(1500.0)[1]
    assert glow[1, 1] @ (0.2126, 0.7152, 0.0722) == pytest.approx(expected, rel=1e-2)
    assert not blackbody_glow(np.zeros((2, 2), np.float32)).any()


# --- metals -----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", metals.NAMES)
def test_metals_have_their_measured_colour(name):
    """By Fresnel's equations from the renderer's own index, head-on exactly, and elsewhere nearly."""
    eta, k = metals.eta_k(name)
    np.testing.assert_allclose(metals.reflectance(1.0, eta, k), metals.color(name), atol=1e-6)
    for cosine in (0.8, 0.5, 0.3, 1 / 7):
        np.testing.assert_allclose(metals.reflectance(cosine, eta, k), metals.color(name, cosine), atol=0.04)
    nm, n, kappa = metals.index(name)
    assert nm[0] <= 370
    assert nm[-1] >= 780
    assert (np.diff(nm) > 0).all()
    assert n.shape == kappa.shape == nm.shape


def test_metals_look_like_themselves():
    gold, silver, copper, iron = (metals.color(name) for name in ("gold", "silver", "copper", "iron"))
    assert gold[0] > 0.95 > gold[1] > 0.65 > gold[2]
    assert silver.min() > 0.95
    assert copper[0] > 0.9
    assert 0.55 < copper[1] < 0.7 > copper[2]
    assert np.ptp(iron) < 0.05
    assert 0.45 < iron.mean() < 0.6
    assert 0.88 < metals.color("aluminium").min() <= metals.color("aluminium").max() < 0.95


def test_fresnel_against_the_closed_form_head_on():
    eta, k = np.array([0.2, 1.5, 3.0]), np.array([3.0, 0.0, 2.5])
    known = ((eta - 1) ** 2 + k**2) / ((eta + 1) ** 2 + k**2)
    np.testing.assert_allclose(metals.reflectance(1.0, eta, k), known, rtol=1e-12)


def test_metal_materials():
    node = dl.materials.metal("gold", roughness=0.2, name="ring")
    assert (node.type, node.name, node["fresnel"], node["roughness"]) == ("conductor", "ring", "eta_k", 0.2)
    with pytest.raises(SceneError, match="gold"):
        dl.materials.metal("golf")
    with pytest.raises(SceneError, match="roughness"):
        dl.materials.metal("gold", roughness=3)
