"""Tone curves: from linear radiance without an upper bound to what a display can show, linear in [0, 1]."""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache

import numpy as np
import numpy.typing as npt

from destello.color_spaces import PRIMARIES, rgb_to_xyz
from destello.ocio import tone_aces2

FloatArray = npt.NDArray[np.float32]


def _identity(values: npt.ArrayLike) -> FloatArray:
    return np.asarray(values, dtype=np.float32)


def tone_neutral(rgb: npt.ArrayLike) -> FloatArray:
    """Khronos PBR Neutral: linear RGB >= 0, (..., 3), to linear RGB in [0, 1].

    Keeps the hue and saturation of base colours below 0.8, and rolls highlights off towards white. Reference: Khronos
    Group, "Khronos PBR Neutral Tone Mapper: Specification" (2024).
    """
    start = np.float32(0.8 - 0.04)  # where compression begins
    desaturation = np.float32(0.15)  # how fast highlights turn white
    color = np.maximum(np.asarray(rgb, dtype=np.float32), np.float32(0))
    least = color.min(axis=-1, keepdims=True)
    fresnel = np.where(least < np.float32(0.08), least - np.float32(6.25) * least * least, np.float32(0.04))
    color = color - fresnel
    peak = color.max(axis=-1, keepdims=True)
    room = np.float32(1) - start
    above = np.maximum(peak, start)  # below the start the result is not used; this keeps its arithmetic tame
    compressed = np.float32(1) - room * room / (above + room - start)
    whiteness = np.float32(1) - np.float32(1) / (desaturation * (above - compressed) + np.float32(1))
    scaled = color * (compressed / above)
    rolled = scaled + (compressed - scaled) * whiteness
    return np.where(peak < start, color, rolled).astype(np.float32, copy=False)


# AgX encodes exposure between these many stops below and above middle grey (0.18), and turns it with this slope about
# the point (middle grey, 0.5), ending in a toe and a shoulder of these powers.
_AGX_STOPS = (-10.0, 6.5)
_AGX_GREY = 0.18
_AGX_SLOPE = 2.0
_AGX_PIVOT_OUT = 0.5
_AGX_POWERS = (3.0, 3.25)
_AGX_INSET = 0.2  # how far the primaries move towards white before the curve
_AGX_DISPLAY_GAMMA = 2.2  # the curve's output is meant for a display of this power


def tone_agx(rgb: npt.ArrayLike) -> FloatArray:
    """AgX: linear RGB >= 0, (..., 3), to linear RGB in [0, 1].

    The filmic curve by Troy Sobotka: the primaries move towards white (so that saturated lights bleach as they get
    brighter), the logarithm of each channel goes through a sigmoid, and the primaries move back. References:
    T. Sobotka, "AgX" and "SB2383 configuration generation" (2022-2023: the inset of the primaries and the sigmoid);
    B. Wrensch, "Minimal AgX implementation" (2023: the way back by the inverse matrix). The sigmoid itself is used,
    not its usual polynomial fit (they differ by 0.003 root mean square), so it rises everywhere and greys stay grey.
    """
    inset, outset = _agx_matrices()
    color: FloatArray = np.maximum(np.asarray(rgb, dtype=np.float32), np.float32(0)) @ inset.T
    low, high = _AGX_STOPS
    with np.errstate(divide="ignore"):
        stops = np.log2(color) - np.float32(np.log2(_AGX_GREY))
    position = (np.clip(stops, np.float32(low), np.float32(high)) - np.float32(low)) / np.float32(high - low)
    display = _agx_sigmoid(position) @ outset.T
    linear = np.power(np.clip(display, np.float32(0), np.float32(1)), np.float32(_AGX_DISPLAY_GAMMA))
    return np.asarray(linear, dtype=np.float32)


def _agx_sigmoid(x: FloatArray) -> FloatArray:
    """From [0, 1] to [0, 1], rising, with the given slope at the pivot and a toe and a shoulder of their own powers."""
    low, high = _AGX_STOPS
    pivot = -low / (high - low)
    out = np.empty_like(x)
    for side, power in ((x < pivot, _AGX_POWERS[0]), (x >= pivot, _AGX_POWERS[1])):
        toe = power == _AGX_POWERS[0]
        run, rise = (pivot, _AGX_PIVOT_OUT) if toe else (1 - pivot, 1 - _AGX_PIVOT_OUT)
        scale = ((_AGX_SLOPE * run) ** -power * ((_AGX_SLOPE * run / rise) ** power - 1)) ** (-1 / power)
        sign = np.float32(-1 if toe else 1)
        term = np.float32(_AGX_SLOPE / scale) * sign * (x[side] - np.float32(pivot))
        bend = np.power(np.float32(1) + np.power(term, np.float32(power)), np.float32(1 / power))
        out[side] = np.float32(_AGX_PIVOT_OUT) + sign * np.float32(scale) * term / bend
    return out


@lru_cache(maxsize=1)
def _agx_matrices() -> tuple[FloatArray, FloatArray]:
    """(inset, outset): Rec.709 RGB to primaries that lie farther out by 1 / (1 - inset), and back; rows sum to 1."""
    primaries, white = PRIMARIES["rec709"]
    outer = np.array(white) + (np.array(primaries) - white) / (1 - _AGX_INSET)
    inset = np.linalg.solve(rgb_to_xyz(outer, white), rgb_to_xyz(primaries, white))
    return inset.astype(np.float32), np.linalg.inv(inset).astype(np.float32)


# The curve of Uncharted 2: shoulder strength, linear strength and angle, toe strength, numerator and denominator.
_FILMIC = (0.22, 0.30, 0.10, 0.20, 0.01, 0.30)
_FILMIC_WHITE = 11.2  # what becomes 1
_FILMIC_EXPOSURE = 2.0


def tone_filmic(rgb: npt.ArrayLike) -> FloatArray:
    """The filmic curve of Uncharted 2, for each channel: linear RGB >= 0, (..., 3), to linear RGB; more than 1 is cut.

    Reference: J. Hable, "Uncharted 2: HDR Lighting" (GDC 2010), with the constants of his text "Filmic Tonemapping
    Operators" (2010): twice the radiance goes through the curve, and 11.2 becomes 1.
    """
    x = np.maximum(np.asarray(rgb, dtype=np.float32), np.float32(0)) * np.float32(_FILMIC_EXPOSURE)
    return np.asarray(_hable(x) / _hable(np.array(_FILMIC_WHITE)), dtype=np.float32)


def _hable(x: npt.NDArray[np.floating]) -> npt.NDArray[np.floating]:
    a, b, c, d, e, f = _FILMIC
    x = np.minimum(x, 1e12)  # its square stays finite
    return np.asarray((x * (a * x + c * b) + d * e) / (x * (a * x + b) + d * f) - e / f)


#: `raw` is not a curve: the numbers are stored as they are, without a transfer curve either.
TONES: dict[str, Callable[[npt.ArrayLike], FloatArray]] = {
    "none": _identity,
    "agx": tone_agx,
    "neutral": tone_neutral,
    "filmic": tone_filmic,
    "aces2": tone_aces2,
    "raw": _identity,
}
