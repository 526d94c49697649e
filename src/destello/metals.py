"""Metals by name, from measured optical constants."""

from __future__ import annotations

from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

from destello.errors import SceneError, did_you_mean
from destello.spectrum import WAVELENGTHS, XYZ_TO_RGB, observer, planck

if TYPE_CHECKING:
    import numpy.typing as npt

    Floats = npt.NDArray[np.float64]

# Photon energies of Johnson and Christy's measurements as wavelengths in nm, over the visible range.
_JC = (368, 381, 397, 413, 431, 451, 471, 496, 521, 549, 582, 617, 659, 704, 756, 821)

# Wavelengths in nm, and the real and imaginary part of the index of refraction there.
# Silver, gold, copper: P. B. Johnson and R. W. Christy 1972, "Optical Constants of the Noble Metals", Phys. Rev. B 6,
# 4370. Iron, chrome, nickel, titanium: the same 1974, "Optical constants of transition metals", Phys. Rev. B 9, 5056.
# Aluminium: A. D. Rakic 1995, "Algorithm for the determination of intrinsic optical constants of metal films", Appl.
# Opt. 34, 4755. Brass (70% Cu, 30% Zn): M. R. Querry 1985, "Optical Constants", contractor report CRDC-CR-85034.
_MEASURED: dict[str, tuple[tuple[float, ...], tuple[float, ...], tuple[float, ...]]] = {
    "silver": (
        _JC,
        (0.07, 0.05, 0.05, 0.05, 0.04, 0.04, 0.05, 0.05, 0.05, 0.06, 0.05, 0.06, 0.05, 0.04, 0.03, 0.04),
        (
            *(1.657, 1.864, 2.070, 2.275, 2.462, 2.657, 2.869, 3.093),
            *(3.324, 3.586, 3.858, 4.152, 4.483, 4.838, 5.242, 5.727),
        ),
    ),
    "gold": (
        _JC,
        (1.48, 1.46, 1.47, 1.46, 1.45, 1.38, 1.31, 1.04, 0.62, 0.43, 0.29, 0.21, 0.14, 0.13, 0.14, 0.16),
        (
            *(1.895, 1.933, 1.952, 1.958, 1.948, 1.914, 1.849, 1.833),
            *(2.081, 2.455, 2.863, 3.272, 3.697, 4.103, 4.542, 5.083),
        ),
    ),
    "copper": (
        _JC,
        (1.36, 1.33, 1.32, 1.28, 1.25, 1.24, 1.25, 1.22, 1.18, 1.02, 0.70, 0.30, 0.22, 0.21, 0.24, 0.26),
        (
            *(1.975, 2.045, 2.116, 2.207, 2.305, 2.397, 2.483, 2.564),
            *(2.608, 2.577, 2.704, 3.205, 3.747, 4.205, 4.665, 5.180),
        ),
    ),
    "iron": (
        _JC,
        (2.02, 2.12, 2.24, 2.35, 2.48, 2.59, 2.67, 2.74, 2.86, 2.95, 2.94, 2.88, 2.92, 2.86, 2.87, 2.94),
        (2.43, 2.50, 2.58, 2.65, 2.71, 2.77, 2.82, 2.88, 2.91, 2.93, 2.99, 3.05, 3.10, 3.19, 3.28, 3.39),
    ),
    "chrome": (
        _JC,
        (1.87, 1.92, 2.00, 2.08, 2.19, 2.33, 2.51, 2.75, 2.94, 3.18, 3.22, 3.17, 3.09, 3.05, 3.08, 3.20),
        (2.69, 2.74, 2.83, 2.93, 3.04, 3.14, 3.24, 3.30, 3.33, 3.33, 3.30, 3.30, 3.34, 3.39, 3.42, 3.48),
    ),
    "nickel": (
        _JC,
        (1.70, 1.72, 1.72, 1.70, 1.71, 1.73, 1.78, 1.82, 1.85, 1.92, 1.96, 1.99, 1.99, 2.06, 2.13, 2.26),
        (2.40, 2.48, 2.57, 2.69, 2.82, 2.95, 3.09, 3.25, 3.42, 3.61, 3.80, 4.02, 4.26, 4.50, 4.73, 4.97),
    ),
    "titanium": (
        _JC,
        (1.90, 1.99, 2.08, 2.14, 2.21, 2.27, 2.32, 2.36, 2.44, 2.54, 2.60, 2.67, 2.76, 2.86, 3.00, 3.21),
        (2.90, 2.93, 2.95, 2.98, 3.01, 3.04, 3.10, 3.19, 3.30, 3.43, 3.58, 3.72, 3.84, 3.96, 4.01, 4.01),
    ),
    "aluminium": (
        (364.66, 413.28, 442.80, 476.87, 516.60, 563.57, 619.93, 652.25, 688.81, 729.32, 774.91, 815.69),
        (0.39877, 0.52135, 0.60790, 0.72780, 0.87340, 1.0728, 1.3660, 1.5724, 1.8301, 2.1606, 2.6154, 2.7668),
        (4.3957, 5.0008, 5.3676, 5.7781, 6.2418, 6.7839, 7.4052, 7.7354, 8.0601, 8.3565, 8.4914, 8.2573),
    ),
    "brass": (
        (360, 380, 400, 420, 440, 460, 480, 500, 520, 540, 560, 580, 600, 620, 640, 660, 700, 740, 780, 820),
        (
            *(1.503, 1.487, 1.445, 1.350, 1.191, 0.994, 0.816, 0.686, 0.602, 0.549),
            *(0.505, 0.468, 0.450, 0.449, 0.444, 0.445, 0.446, 0.455, 0.464, 0.481),
        ),
        (
            *(1.815, 1.818, 1.805, 1.786, 1.797, 1.883, 2.046, 2.250, 2.464, 2.668),
            *(2.860, 3.059, 3.253, 3.434, 3.609, 3.778, 4.106, 4.424, 4.737, 5.039),
        ),
    ),
}
NAMES = tuple(sorted(_MEASURED))
_BRIGHTEST = 0.995  # of a channel: a saturated colour may lie outside Rec.709


def index(name: str) -> tuple[Floats, Floats, Floats]:
    """Wavelengths in nm and the real and imaginary part of a metal's index of refraction. Raises SceneError."""
    if name not in _MEASURED:
        raise SceneError("unknown metal", value=name, expected=did_you_mean(name, NAMES))
    nm, eta, k = _MEASURED[name]
    return np.array(nm, np.float64), np.array(eta), np.array(k)


def reflectance(cosine: float, eta: npt.ArrayLike, k: npt.ArrayLike) -> Floats:
    """What a smooth metal reflects of unpolarised light, by Fresnel's equations; in [0, 1]."""
    n = np.asarray(eta, np.float64) - 1j * np.asarray(k, np.float64)
    inside = np.sqrt(n * n - (1 - cosine * cosine))
    s = (cosine - inside) / (cosine + inside)
    p = (n * n * cosine - inside) / (n * n * cosine + inside)
    return np.asarray((np.abs(s) ** 2 + np.abs(p) ** 2) / 2)


def color(name: str, cosine: float = 1.0) -> Floats:
    """Linear Rec.709 (3,) that a smooth metal turns white light (daylight, D65) into; between 0 and 1.

    Daylight is put in by a black body of 6504 K, scaled so that what reflects everything is white.
    """
    nm, eta, k = index(name)
    spectrum = reflectance(cosine, np.interp(WAVELENGTHS, nm, eta), np.interp(WAVELENGTHS, nm, k))
    light = observer() * planck(WAVELENGTHS, 6504.0)
    rgb = (XYZ_TO_RGB @ (light @ spectrum)) / (XYZ_TO_RGB @ light.sum(1))
    return np.asarray(np.clip(rgb, 0.0, _BRIGHTEST))


@lru_cache(maxsize=32)
def eta_k(name: str) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """An index of refraction per channel that gives a metal's colour head-on exactly.

    The real part is the measured one's mean over the channel; the imaginary part follows from the colour (Gulbrandsen
    2014, "Artist Friendly Metallic Fresnel"). Towards grazing angles the colour stays within 0.04 of `color`'s.

    Raises SceneError for a name that is not in `NAMES`.
    """
    nm, eta, _ = index(name)
    weights = np.maximum(XYZ_TO_RGB @ (observer() * planck(WAVELENGTHS, 6504.0)), 0.0)
    mean = weights @ np.interp(WAVELENGTHS, nm, eta) / weights.sum(1)
    head_on = color(name)
    return _index_of_color(mean, head_on)


def in_space(eta: npt.ArrayLike, k: npt.ArrayLike, working: str) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """An index per channel of Rec.709 as one per channel of another RGB space, of the same colour head-on."""
    from destello.color_spaces import converted

    head_on = converted(reflectance(1.0, eta, k), "rec709", working).astype(np.float64)
    return _index_of_color(np.asarray(eta, np.float64), np.clip(head_on, 0.0, _BRIGHTEST))


def _index_of_color(real: Floats, head_on: Floats) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Real and imaginary parts that reflect `head_on`, the real ones as near to `real` as they can be."""
    n = np.clip(real, (1 - head_on) / (1 + head_on), (1 + np.sqrt(head_on)) / (1 - np.sqrt(head_on)))
    k = np.sqrt(np.maximum((head_on * (n + 1) ** 2 - (n - 1) ** 2) / (1 - head_on), 0.0))
    return tuple(n.tolist()), tuple(k.tolist())
