"""Spectra as linear Rec.709 colours: black bodies, and what measured metals reflect."""

from __future__ import annotations

import sys
from functools import lru_cache
from numbers import Real
from typing import TYPE_CHECKING, Any

import numpy as np

from destello.errors import InputError

if TYPE_CHECKING:
    import numpy.typing as npt

    Floats = npt.NDArray[np.float64]

# Wavelengths at which spectra are integrated, nm.
WAVELENGTHS = np.arange(360.0, 831.0, 1.0)
# Kelvin that `blackbody` accepts: below, nothing is seen; above, the colour does not change any more.
COLDEST, HOTTEST = 500.0, 1e6
# From CIE XYZ to linear Rec.709, white D65 (IEC 61966-2-1).
XYZ_TO_RGB = np.array(
    [[3.2404542, -1.5371385, -0.4985314], [-0.9692660, 1.8760108, 0.0415560], [0.0556434, -0.2040259, 1.0572252]]
)
_SECOND_RADIATION = 1.438776877e7  # h c / k in nm K (CODATA 2018, exact)


def _bell(nm: Floats, height: float, centre: float, left: float, right: float) -> Floats:
    return np.asarray(height * np.exp(-0.5 * ((nm - centre) / np.where(nm < centre, left, right)) ** 2))


@lru_cache(maxsize=1)
def observer() -> Floats:
    """The CIE 1931 standard observer (3, N) at `WAVELENGTHS`.

    The fits of Wyman, Sloan and Shirley 2013, "Simple Analytic Approximations to the CIE XYZ Color Matching Functions".
    """
    nm = WAVELENGTHS
    x = _bell(nm, 1.056, 599.8, 37.9, 31.0) + _bell(nm, 0.362, 442.0, 16.0, 26.7) + _bell(nm, -0.065, 501.1, 20.4, 26.2)
    y = _bell(nm, 0.821, 568.8, 46.9, 40.5) + _bell(nm, 0.286, 530.9, 16.3, 31.1)
    z = _bell(nm, 1.217, 437.0, 11.8, 36.0) + _bell(nm, 0.681, 459.0, 26.0, 13.8)
    return np.stack([x, y, z])


def planck(nm: npt.ArrayLike, kelvin: npt.ArrayLike) -> Floats:
    """Spectral radiance of a black body by Planck's law, up to a factor: wavelengths in nm, temperatures in K."""
    wavelength, temperature = np.asarray(nm, np.float64), np.asarray(kelvin, np.float64)
    with np.errstate(over="ignore"):
        return np.asarray((wavelength / 560.0) ** -5 / np.expm1(_SECOND_RADIATION / (wavelength * temperature)))


def blackbody_xyz(kelvin: npt.ArrayLike) -> Floats:
    """CIE XYZ (..., 3) of black bodies' light, all in one unit: hotter is brighter."""
    temperature = np.asarray(kelvin, np.float64)
    return np.asarray(planck(WAVELENGTHS, temperature[..., None]) @ observer().T)


def blackbody(kelvin: float, luminance: float = 1.0) -> tuple[float, float, float]:
    """The colour of a black body: of candles (1900), lamps (2700 to 3000), the sun (5800), the blue sky (over 10000).

    Planck's law, integrated with the CIE 1931 observer. Below about 1900 K the colour lies outside Rec.709: what would
    be negative is 0, and the rest keeps the luminance.

    Args:
        kelvin: the temperature in K, from 500 to 1e6.
        luminance: of the result (0.2126 R + 0.7152 G + 0.0722 B), at least 0.

    Returns:
        Linear Rec.709 red, green, blue.

    Raises:
        InputError: if a value is out of range.
    """
    if not _within(kelvin, COLDEST, HOTTEST):
        raise InputError("wrong temperature", place="blackbody", value=kelvin, expected=f"{COLDEST:g} to {HOTTEST:g} K")
    if not _within(luminance, 0.0, sys.float_info.max):
        raise InputError("wrong luminance", place="blackbody", value=luminance, expected="a number of at least 0")
    red, green, blue = (luminance * blackbody_rgb(np.array([kelvin]))[0]).tolist()
    return red, green, blue


def _within(value: object, least: float, most: float) -> bool:
    return isinstance(value, Real) and least <= float(value) <= most


def blackbody_rgb(kelvin: npt.ArrayLike) -> Floats:
    """Linear Rec.709 (..., 3) of luminance 1; temperatures in K, below 500 as at 500."""
    rgb = np.maximum(blackbody_xyz(np.maximum(np.asarray(kelvin, np.float64), COLDEST)) @ XYZ_TO_RGB.T, 0.0)
    return np.asarray(rgb / (rgb @ np.array([0.2126, 0.7152, 0.0722]))[..., None])


def blackbody_glow(kelvin: npt.NDArray[Any]) -> npt.NDArray[np.float32]:
    """Linear Rec.709 (..., 3) of temperatures in K, as bright as they are beside the hottest, whose luminance is 1.

    Below 500 K nothing glows. The values come from a table of 4096 temperatures between 500 K and the hottest.
    """
    hottest = float(kelvin.max(initial=0.0))
    if hottest < COLDEST:
        return np.zeros((*kelvin.shape, 3), np.float32)
    steps = np.linspace(COLDEST, max(hottest, COLDEST + 1), 4096)
    brightness = blackbody_xyz(steps)[:, 1]
    table = blackbody_rgb(steps) * (brightness / brightness[-1])[:, None]
    glow = np.stack([np.interp(kelvin, steps, table[:, i], left=0.0) for i in range(3)], -1)
    return glow.astype(np.float32)
