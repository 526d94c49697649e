"""From linear radiance to what a display shows: exposure, tone curve, clamp, transfer curve, quantisation.

The renderer works in linear Rec.709 RGB (the sRGB primaries, white D65). A picture for a display goes through, in
this order:

1. exposure: multiplied by 2^EV;
2. tone curve: brings radiance without upper bound into [0, 1] (`none` leaves it to the clamp);
3. clamp to [0, 1];
4. transfer curve: the display's code values (`srgb` unless asked otherwise);
5. quantisation: round(value * (2^bits - 1)).

Values that are not finite have no colour: NaN and -inf become 0, +inf becomes the largest float. `count_nonfinite`
counts the pixels that have one.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
import numpy.typing as npt

from destello.errors import InputError, did_you_mean

FloatArray = npt.NDArray[np.float32]

#: Rec.709 luminance of linear RGB (rows of the RGB to XYZ matrix, ITU-R BT.709-6).
LUMINANCE = np.array([0.2126, 0.7152, 0.0722], dtype=np.float32)

_BAND_PIXELS = 1 << 20  # pixels converted at a time: temporaries stay small however large the image is


def luminance(rgb: npt.ArrayLike) -> FloatArray:
    """Rec.709 luminance of linear RGB: (..., 3) to (...), in the input's unit."""
    return np.asarray(rgb, dtype=np.float32) @ LUMINANCE


def count_nonfinite(values: npt.ArrayLike) -> int:
    """How many pixels of an (H, W, C) or (H, W) array have a NaN or infinite channel."""
    array = np.asarray(values)
    bad = ~np.isfinite(array)
    return int(np.count_nonzero(bad.any(axis=-1) if bad.ndim > 2 else bad))


# Transfer curves ----------------------------------------------------------------------------------


def srgb_encode(linear: npt.ArrayLike) -> FloatArray:
    """The sRGB curve of IEC 61966-2-1: linear [0, 1] to code value [0, 1]."""
    x = np.asarray(linear, dtype=np.float32)
    low = x <= np.float32(0.0031308)
    power = np.power(np.where(low, np.float32(1), x), np.float32(1 / 2.4))
    curved = np.float32(1.055) * power - np.float32(0.055)
    return np.where(low, np.float32(12.92) * x, curved).astype(np.float32, copy=False)


def srgb_decode(encoded: npt.ArrayLike) -> FloatArray:
    """The inverse of `srgb_encode`: code value [0, 1] to linear [0, 1]."""
    x = np.asarray(encoded, dtype=np.float32)
    low = x <= np.float32(0.04045)
    power = np.power((np.where(low, np.float32(1), x) + np.float32(0.055)) / np.float32(1.055), np.float32(2.4))
    return np.where(low, x / np.float32(12.92), power).astype(np.float32, copy=False)


def _gamma(exponent: float) -> tuple[Callable[[npt.ArrayLike], FloatArray], Callable[[npt.ArrayLike], FloatArray]]:
    """The pair (encode, decode) of a pure power curve."""

    def encode_power(linear: npt.ArrayLike) -> FloatArray:
        return np.power(np.asarray(linear, dtype=np.float32), np.float32(1 / exponent))

    def decode_power(encoded: npt.ArrayLike) -> FloatArray:
        return np.power(np.asarray(encoded, dtype=np.float32), np.float32(exponent))

    return encode_power, decode_power


def _identity(values: npt.ArrayLike) -> FloatArray:
    return np.asarray(values, dtype=np.float32)


_CURVES: dict[str, tuple[Callable[[npt.ArrayLike], FloatArray], Callable[[npt.ArrayLike], FloatArray]]] = {
    "srgb": (srgb_encode, srgb_decode),
    "gamma2": _gamma(2.0),
    "gamma2.2": _gamma(2.2),
    "linear": (_identity, _identity),
}
CURVES = tuple(_CURVES)


def encode(linear: npt.ArrayLike, curve: str = "srgb") -> FloatArray:
    """Linear [0, 1] to code values [0, 1] by the curve of that name; the input must be clamped already."""
    return _CURVES[check_curve(curve)][0](linear)


def decode(encoded: npt.ArrayLike, curve: str = "srgb") -> FloatArray:
    """Code values [0, 1] to linear [0, 1]: the inverse of `encode`."""
    return _CURVES[check_curve(curve)][1](encoded)


# Tone curves --------------------------------------------------------------------------------------


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
    white = np.array([0.3127, 0.3290])
    primaries = np.array([[0.64, 0.33], [0.30, 0.60], [0.15, 0.06]])

    def to_xyz(xy: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
        columns = np.stack([xy[:, 0], xy[:, 1], 1 - xy.sum(axis=1)])
        white_xyz = np.array([white[0], white[1], 1 - white.sum()]) / white[1]
        return np.asarray(columns * np.linalg.solve(columns, white_xyz))

    outer = white + (primaries - white) / (1 - _AGX_INSET)
    inset = np.linalg.solve(to_xyz(outer), to_xyz(primaries))
    return inset.astype(np.float32), np.linalg.inv(inset).astype(np.float32)


_TONES: dict[str, Callable[[npt.ArrayLike], FloatArray]] = {"none": _identity, "agx": tone_agx, "neutral": tone_neutral}
TONES = tuple(_TONES)


# The whole way ------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Display:
    """How linear radiance is turned into code values.

    Attributes:
        exposure: in stops (EV): the picture is multiplied by 2^exposure; finite.
        tone: `none`, `agx` or `neutral` (Khronos PBR Neutral).
        curve: `srgb`, `gamma2`, `gamma2.2` or `linear`.

    Raises InputError for a value that is none of these.
    """

    exposure: float = 0.0
    tone: str = "none"
    curve: str = "srgb"

    def __post_init__(self) -> None:
        check_exposure(self.exposure)
        if self.tone not in TONES:
            raise InputError("unknown tone curve", value=self.tone, expected=did_you_mean(self.tone, TONES))
        check_curve(self.curve)

    def changed(self, exposure: float | None = None, tone: str | None = None, curve: str | None = None) -> Display:
        """The same with what is not None put in its place."""
        return Display(
            self.exposure if exposure is None else exposure,
            self.tone if tone is None else tone,
            self.curve if curve is None else curve,
        )

    def code_values(self, linear: npt.ArrayLike) -> FloatArray:
        """Linear RGB (..., 3), any value, to code values in [0, 1] (float32), by the steps described above."""
        x = np.nan_to_num(np.asarray(linear, dtype=np.float32), nan=0.0, neginf=0.0)
        with np.errstate(over="ignore"):
            x = x * np.float32(2.0**self.exposure) if self.exposure else x
        x = _TONES[self.tone](np.minimum(x, np.float32(1e30)))
        return encode(np.clip(x, np.float32(0), np.float32(1)), self.curve)

    def quantise(self, linear: npt.ArrayLike, bits: int = 8) -> npt.NDArray[Any]:
        """Linear RGB (H, W, 3) to the display's integers: uint8 for 8 bits, uint16 for 16."""
        source = np.asarray(linear, dtype=np.float32)
        kind, top = {8: (np.uint8, 255), 16: (np.uint16, 65535)}[bits]
        out = np.empty(source.shape, dtype=kind)
        rows = max(1, _BAND_PIXELS // max(1, source.shape[1]))
        for first in range(0, source.shape[0], rows):
            values = self.code_values(source[first : first + rows])
            # Storing into an integer array cuts off the fraction: with the half added, it rounds to the nearest.
            out[first : first + rows] = values * np.float32(top) + np.float32(0.5)
        return out


def check_exposure(exposure: object) -> float:
    """The exposure itself if it is a finite number of at most 100 stops either way; InputError otherwise."""
    if not isinstance(exposure, (int, float)) or not -100 <= exposure <= 100:
        raise InputError("wrong exposure", value=exposure, expected="stops (EV) from -100 to 100")
    return float(exposure)


def check_curve(curve: str) -> str:
    """The curve's name itself if there is one of that name; InputError otherwise."""
    if curve not in _CURVES:
        raise InputError("unknown transfer curve", value=curve, expected=did_you_mean(curve, CURVES))
    return curve
