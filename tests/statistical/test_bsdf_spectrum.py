"""Wavelengths: their colours, dispersion by Abbe number, and what a dispersive path adds up to."""

from __future__ import annotations

import numpy as np
import pytest

from bsdf_cases import Case, direction
from destello._core import testing

LO, HI = testing.WAVELENGTHS
D, F, C = 587.56, 486.13, 656.27  # Fraunhofer lines, nm


def wavelengths(n: int) -> np.ndarray:
    return np.array([testing.sample_wavelength((i + 0.5) / n) for i in range(n)], np.float32)


def test_weights_average_to_white() -> None:
    """The mean over uniformly drawn wavelengths is (1, 1, 1), so that a path without dispersion keeps its colour."""
    nm = wavelengths(20_000)
    assert nm.min() >= LO
    assert nm.max() < HI
    np.testing.assert_allclose(testing.wavelength_weight(nm).astype(np.float64).mean(axis=0), 1, atol=1e-4)


def test_weights_have_the_right_colours() -> None:
    red, green, blue = testing.wavelength_weight(np.array([640, 530, 450], np.float32))
    assert np.argmax(red) == 0
    assert np.argmax(green) == 1
    assert np.argmax(blue) == 2
    assert red[0] > 1
    assert green[1] > 1
    assert blue[2] > 1


@pytest.mark.parametrize(("ior", "abbe"), [(1.5168, 64.2), (1.785, 25.7), (2.417, 55.3)])
def test_abbe_number_by_its_definition(ior: float, abbe: float) -> None:
    n = {line: testing.cauchy_ior(ior, abbe, line) for line in (D, F, C)}
    assert n[D] == pytest.approx(ior, rel=1e-6)
    assert (n[D] - 1) / (n[F] - n[C]) == pytest.approx(abbe, rel=1e-3)
    assert testing.cauchy_ior(ior, abbe, 0.0) == pytest.approx(ior)
    assert testing.cauchy_ior(ior, 0.0, 400.0) == pytest.approx(ior)


def test_blue_bends_more_than_red() -> None:
    wo, u = direction(0.6, 0.25), np.array([[0.999, 0.5, 0.5]])

    def sine(nm: float, *, front: bool) -> float:
        s = Case("dielectric", {"ior": 1.6, "abbe": 20.0}, front=front, wavelength=nm).sample(
            wo if front else direction(0.9, 0.25), u
        )
        assert s.transmitted.all()
        return float(np.hypot(s.wi[0, 0], s.wi[0, 1]))

    assert sine(450, front=True) < sine(650, front=True)  # nearer to the normal inside
    assert sine(450, front=False) > sine(650, front=False)  # farther from it outside
    for nm in (450.0, 650.0):
        expected = 0.8 / testing.cauchy_ior(1.6, 20.0, nm)
        assert sine(nm, front=True) == pytest.approx(expected, rel=1e-5)


def test_only_dispersive_materials_ask_for_a_wavelength() -> None:
    assert Case("dielectric", {"abbe": 40.0}).traits()["needs_wavelength"]
    assert not Case("dielectric").traits()["needs_wavelength"]
    for kind in testing.bsdf_types():
        assert not Case(kind).traits()["needs_wavelength"]


def test_prism_spectrum_adds_up_to_white() -> None:
    """All wavelengths together carry white light, but for the little by which reflection depends on them."""
    nm = wavelengths(400)
    u = np.array([[0.999, 0.5, 0.5]])
    total = np.zeros(3)
    for x, w in zip(nm, testing.wavelength_weight(nm), strict=True):
        s = Case("dielectric", {"ior": 1.5, "abbe": 60.0}, wavelength=float(x)).sample(direction(1.0, 0), u)
        total += w * s.power()[0]
    np.testing.assert_allclose(total / len(nm), 1, atol=2e-3)
