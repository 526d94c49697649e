"""RGB colour spaces: their primaries, the matrices between them, chromatic adaptation, white balance.

A space is a set of primaries and a white; an encoding is a space and a curve, as image files have them. Between whites,
colours are adapted by Bradford's matrix (K. M. Lam 1985; as in ICC.1:2022, annex E), which ACES uses, too.
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
Matrix = npt.NDArray[np.float64]

D65 = (0.3127, 0.3290)
_ACES_WHITE = (0.32168, 0.33767)

#: The primaries' xy (red, green, blue) and the white's.
PRIMARIES: dict[str, tuple[tuple[tuple[float, float], ...], tuple[float, float]]] = {
    "rec709": (((0.64, 0.33), (0.30, 0.60), (0.15, 0.06)), D65),  # ITU-R BT.709-6; sRGB has the same
    "rec2020": (((0.708, 0.292), (0.170, 0.797), (0.131, 0.046)), D65),  # ITU-R BT.2020-2
    "p3": (((0.680, 0.320), (0.265, 0.690), (0.150, 0.060)), D65),  # SMPTE EG 432-1, with white D65
    "acescg": (((0.713, 0.293), (0.165, 0.830), (0.128, 0.044)), _ACES_WHITE),  # AP1, Academy S-2014-004
    "aces2065-1": (((0.7347, 0.2653), (0.0, 1.0), (0.0001, -0.0770)), _ACES_WHITE),  # AP0, SMPTE ST 2065-1
}
#: The spaces in which a scene may be rendered.
WORKING_SPACES = ("rec709", "acescg")

_BRADFORD = np.array([[0.8951, 0.2664, -0.1614], [-0.7502, 1.7135, 0.0367], [0.0389, -0.0685, 1.0296]])


# Curves -----------------------------------------------------------------------------------------------------------


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


def camera_decode(encoded: npt.ArrayLike) -> FloatArray:
    """The inverse of the camera's curve of ITU-R BT.709-6 and BT.2020-2: code value [0, 1] to linear [0, 1]."""
    x = np.asarray(encoded, dtype=np.float32)
    low = x < np.float32(4.5 * 0.018053968510807)
    a = np.float32(1.09929682680944)
    power = np.power((np.where(low, np.float32(1), x) + a - np.float32(1)) / a, np.float32(1 / 0.45))
    return np.where(low, x / np.float32(4.5), power).astype(np.float32, copy=False)


def _linear(values: npt.ArrayLike) -> FloatArray:
    return np.asarray(values, dtype=np.float32)


#: What the numbers of an image may mean: primaries, and from code values to linear ones. `raw` is data and no colour.
ENCODINGS: dict[str, tuple[str, Callable[[npt.ArrayLike], FloatArray]]] = {
    "srgb": ("rec709", srgb_decode),
    "linear": ("rec709", _linear),
    "rec709": ("rec709", camera_decode),
    "rec2020": ("rec2020", camera_decode),
    "linear_rec2020": ("rec2020", _linear),
    "display_p3": ("p3", srgb_decode),
    "linear_p3": ("p3", _linear),
    "acescg": ("acescg", _linear),
    "aces2065-1": ("aces2065-1", _linear),
}


# Matrices ---------------------------------------------------------------------------------------------------------


def white_xyz(xy: tuple[float, float]) -> Matrix:
    """XYZ of a chromaticity, Y = 1."""
    x, y = xy
    return np.array([x / y, 1.0, (1 - x - y) / y])


def rgb_to_xyz(primaries: npt.ArrayLike, white: tuple[float, float]) -> Matrix:
    """The matrix from linear RGB to XYZ: its columns are the primaries, RGB (1, 1, 1) is the white with Y = 1."""
    xy = np.asarray(primaries, dtype=np.float64)
    columns = np.stack([xy[:, 0], xy[:, 1], 1 - xy.sum(axis=1)])
    return np.asarray(columns * np.linalg.solve(columns, white_xyz(white)))


def adaptation(source: tuple[float, float], target: tuple[float, float]) -> Matrix:
    """Bradford's matrix for XYZ, which brings the white `source` to the white `target` (xy chromaticities)."""
    cones = (_BRADFORD @ white_xyz(target)) / (_BRADFORD @ white_xyz(source))
    return np.asarray(np.linalg.solve(_BRADFORD, cones[:, np.newaxis] * _BRADFORD))


@lru_cache(maxsize=32)
def conversion(source: str, target: str) -> Matrix:
    """The (3, 3) matrix from one linear RGB space to another, by the names of `PRIMARIES`. White stays white."""
    first, second = PRIMARIES[check_space(source)], PRIMARIES[check_space(target)]
    if source == target:
        return np.eye(3)
    return np.asarray(np.linalg.solve(rgb_to_xyz(*second), adaptation(first[1], second[1]) @ rgb_to_xyz(*first)))


def converted(rgb: npt.ArrayLike, source: str, target: str) -> FloatArray:
    """Linear RGB (..., 3) of one space in another, float32. What the target cannot hold has negative components."""
    colors = np.asarray(rgb, dtype=np.float32)
    return colors if source == target else colors @ conversion(source, target).T.astype(np.float32)


def check_space(name: str) -> str:
    """The name of a linear RGB space itself; InputError if there is none of that name."""
    if name not in PRIMARIES:
        raise InputError("unknown colour space", value=name, expected=did_you_mean(name, PRIMARIES))
    return name


# Images -----------------------------------------------------------------------------------------------------------


def texels_in(texels: npt.NDArray[Any], encoding: str, working: str) -> tuple[npt.NDArray[Any], bool]:
    """Texels whose colours have the encoding `encoding`, in the working space; and whether they are sRGB encoded.

    Only where primaries or curve differ from what the renderer reads are new texels made: uint16 with the sRGB curve
    for integers (a step is then finer than the eighth of one of 8 bits), float32 for floats. Colours outside the
    working space are cut off at 0, and integers at 1. Alpha is left as it is. Greys (1 or 2 channels) have no
    primaries: for them only the curve counts.
    """
    primaries, decode = ENCODINGS[encoding]
    grey = texels.shape[2] < 3
    if (grey or primaries == working) and decode in (_linear, srgb_decode):
        return texels, decode is srgb_decode
    integer = texels.dtype.kind == "u"
    values = texels.astype(np.float32)
    if integer:
        values /= np.float32(np.iinfo(texels.dtype).max)
    count = 1 if grey else 3
    colors = decode(values[..., :count])
    values[..., :count] = np.maximum(colors if grey else converted(colors, primaries, working), np.float32(0))
    if not integer:
        return values, False
    values[..., :count] = srgb_encode(np.minimum(values[..., :count], np.float32(1)))
    return (values * np.float32(65535) + np.float32(0.5)).astype(np.uint16), True


# White balance ----------------------------------------------------------------------------------------------------

TINT_PER_DUV = 3000.0  # as in Adobe's DNG specification


@dataclass(frozen=True, slots=True)
class WhiteBalance:
    """The light under which a picture is to look white.

    Attributes:
        temperature: of the light's colour, in K, 1000 to 15000.
        tint: how far off the black body's colours it lies, -150 to 150: 3000 times the distance in CIE 1960 (u, v);
            positive is greener than a black body. D65 is 6504 K with a tint of 10.

    Raises InputError for anything else.
    """

    temperature: float
    tint: float = 0.0

    def __post_init__(self) -> None:
        for name, value, low, high in (("temperature", self.temperature, 1000, 15000), ("tint", self.tint, -150, 150)):
            if not low <= value <= high:
                raise InputError(f"wrong {name} of the white balance", value=value, expected=f"from {low} to {high}")

    @property
    def white(self) -> tuple[float, float]:
        """The light's chromaticity (x, y)."""
        u, v = _planckian_uv(self.temperature)
        (u0, v0), (u1, v1) = _planckian_uv(self.temperature - 0.5), _planckian_uv(self.temperature + 0.5)
        shift = self.tint / TINT_PER_DUV / float(np.hypot(u1 - u0, v1 - v0))  # across the locus, towards green
        u, v = u + shift * (v1 - v0), v - shift * (u1 - u0)
        return 3 * u / (2 * u - 8 * v + 4), 2 * v / (2 * u - 8 * v + 4)

    @property
    def matrix(self) -> Matrix:
        """For linear Rec.709, (3, 3): what this light lit looks as if lit by D65; its white keeps its luminance."""
        xyz = rgb_to_xyz(*PRIMARIES["rec709"])
        return np.asarray(np.linalg.solve(xyz, adaptation(self.white, D65) @ xyz))


def _planckian_uv(kelvin: float) -> tuple[float, float]:
    """CIE 1960 (u, v) of a black body of 1000 to 15000 K, error below 9e-5 (M. Krystek 1985, Color Res. Appl. 10)."""
    t = kelvin
    u = (0.860117757 + 1.54118254e-4 * t + 1.28641212e-7 * t * t) / (1 + 8.42420235e-4 * t + 7.08145163e-7 * t * t)
    v = (0.317398726 + 4.22806245e-5 * t + 4.20481691e-8 * t * t) / (1 - 2.89741816e-5 * t + 1.61456053e-7 * t * t)
    return u, v
