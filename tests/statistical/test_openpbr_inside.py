"""What an OpenPBR surface encloses: its medium in closed form, and dispersion."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from bsdf_cases import Case, direction
from destello._core import testing

Floats = NDArray[np.float64]

MILK = {
    "transmission_weight": 1.0, "transmission_depth": 2.0, "transmission_color": (0.5, 0.7, 0.9),
    "transmission_scatter": (0.1, 0.2, 0.05), "transmission_scatter_anisotropy": 0.4,
}  # fmt: skip
SKIN = {
    "subsurface_weight": 1.0, "subsurface_radius": 0.2, "subsurface_radius_scale": (1.0, 0.5, 0.25),
    "subsurface_color": (0.9, 0.6, 0.3), "subsurface_scatter_anisotropy": -0.2,
}  # fmt: skip


def inside(words: dict[str, Any]) -> tuple[Floats, Floats, float]:
    """Scattering and absorption (3,), 1/m, and the mean cosine."""
    medium = testing.openpbr_interior(words)
    return np.array(medium["scattering"]), np.array(medium["absorption"]), float(medium["anisotropy"])


def test_glass_is_left_with_its_colour_at_its_depth() -> None:
    scattering, absorption, g = inside(MILK)
    np.testing.assert_allclose(np.exp(-2 * (scattering + absorption)), MILK["transmission_color"], rtol=1e-5)
    np.testing.assert_allclose(scattering, np.array(MILK["transmission_scatter"]) / 2, rtol=1e-6)
    assert g == pytest.approx(0.4)


def test_more_scattering_than_extinction_makes_all_of_it_grow() -> None:
    """Where a colour lacks absorption, that of all is raised by what is missing (specification)."""
    scattering, absorption, _ = inside({**MILK, "transmission_scatter": (0.1, 0.2, 1.0)})
    np.testing.assert_allclose(scattering, [0.05, 0.1, 0.5], rtol=1e-6)
    bare = -np.log(MILK["transmission_color"]) / 2 - scattering
    assert bare.min() < 0
    np.testing.assert_allclose(absorption, bare - bare.min(), rtol=1e-5, atol=1e-7)


def test_no_depth_no_medium() -> None:
    scattering, absorption, _ = inside({**MILK, "transmission_depth": 0.0})
    assert not scattering.any()
    assert not absorption.any()


def test_subsurface_radius_is_the_mean_free_path_of_each_colour() -> None:
    scattering, absorption, g = inside(SKIN)
    np.testing.assert_allclose(scattering + absorption, [1 / 0.2, 1 / 0.1, 1 / 0.05], rtol=1e-5)
    assert g == pytest.approx(-0.2)
    albedo = scattering / (scattering + absorption)
    for k, colour in enumerate(SKIN["subsurface_color"]):
        one, other, _ = inside({**SKIN, "subsurface_color": colour})
        np.testing.assert_allclose(one[k] / (one[k] + other[k]), albedo[k], rtol=1e-5)
    assert albedo[0] > albedo[1] > albedo[2]


def test_glass_with_subsurface_is_a_mixture_by_what_passes() -> None:
    """Transmission 0.4; of the opaque 0.6 half is subsurface: 4 parts and 3. The mean cosine is that of both."""
    both = {**MILK, **SKIN, "transmission_weight": 0.4, "subsurface_weight": 0.5}
    (a, b, g), (c, d, h) = inside(MILK), inside({**both, "transmission_weight": 0.0})
    scattering, absorption, mean = inside(both)
    np.testing.assert_allclose(scattering, (4 * a + 3 * c) / 7, rtol=0.01)
    np.testing.assert_allclose(absorption, (4 * b + 3 * d) / 7, rtol=0.01)
    expected = (4 * g * a.mean() + 3 * h * c.mean()) / (4 * a.mean() + 3 * c.mean())
    assert mean == pytest.approx(expected, rel=0.01)


# --- dispersion ------------------------------------------------------------------------------------------------------

PRISM = {"transmission_weight": 1.0, "specular_roughness": 0.0, "specular_ior": 1.7}


@pytest.mark.parametrize(("scale", "abbe"), [(1.0, 25.0), (0.4, 25.0), (0.5, 60.0)])
def test_dispersion_is_by_the_abbe_number_over_the_scale(scale: float, abbe: float) -> None:
    words = {**PRISM, "transmission_dispersion_scale": scale, "transmission_dispersion_abbe_number": abbe}
    u = np.array([[0.999, 0.5, 0.5]])

    def index(nm: float) -> float:
        s = Case("openpbr", words, wavelength=nm).sample(direction(0.6, 0.25), u)
        assert s.transmitted.all()
        return 0.8 / float(np.hypot(s.wi[0, 0], s.wi[0, 1]))

    assert index(587.56) == pytest.approx(1.7, rel=1e-5)
    assert (1.7 - 1) / (index(486.13) - index(656.27)) == pytest.approx(abbe / scale, rel=5e-3)


def test_who_asks_for_a_wavelength() -> None:
    """Glass that disperses; neither sheets, in which nothing is refracted, nor what lets nothing pass."""
    spread = {**PRISM, "transmission_dispersion_scale": 0.5}
    for words, expected in (
        (spread, True),
        ({**spread, "transmission_weight": 0.01}, True),
        (PRISM, False),
        ({**spread, "transmission_weight": 0.0}, False),
        ({**spread, "geometry_thin_walled": True}, False),
    ):
        assert Case("openpbr", words).traits()["needs_wavelength"] == expected
