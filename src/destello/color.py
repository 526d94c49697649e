"""From linear radiance to what a display shows: exposure, tone curve, clamp, transfer curve, quantisation.

The renderer works in linear Rec.709 RGB (the sRGB primaries, white D65). A picture for a display goes through, in
this order:

1. white balance, if any: the light that is to look white becomes D65;
2. exposure: multiplied by 2^EV;
3. tone curve: brings radiance without upper bound into [0, 1] (`none` leaves it to the clamp);
4. clamp to [0, 1];
5. transfer curve: the display's code values (`srgb` unless asked otherwise);
6. quantisation: round(value * (2^bits - 1)).

A view of an OpenColorIO configuration takes the place of 3 to 5.

Values that are not finite have no colour: NaN and -inf become 0, +inf becomes the largest float. `count_nonfinite`
counts the pixels that have one.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from destello.color_spaces import WhiteBalance, srgb_decode, srgb_encode
from destello.errors import InputError, did_you_mean
from destello.ocio import View
from destello.tones import TONES

if TYPE_CHECKING:
    from pathlib import Path

    from destello.settings import RenderSettings

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


# The whole way ------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Display:
    """How linear radiance is turned into code values.

    Attributes:
        exposure: in stops (EV): the picture is multiplied by 2^exposure; finite. `exposure_of_camera` computes it.
        tone: `none`, `agx`, `neutral` (Khronos PBR Neutral), `filmic`, `aces2`, or `raw`: the numbers as they are.
        curve: `srgb`, `gamma2`, `gamma2.2` or `linear`.
        white_balance: the light that is to look white, or None: D65 does.
        view: a view of an OpenColorIO configuration in place of tone and transfer curve, or None.

    Raises InputError for a value that is none of these, and for a tone or curve beside a view.
    """

    exposure: float = 0.0
    tone: str = "none"
    curve: str = "srgb"
    white_balance: WhiteBalance | None = None
    view: View | None = None

    def __post_init__(self) -> None:
        check_exposure(self.exposure)
        if self.tone not in TONES:
            raise InputError("unknown tone curve", value=self.tone, expected=did_you_mean(self.tone, TONES))
        check_curve(self.curve)
        if self.view is not None and (self.tone, self.curve) != ("none", "srgb"):
            problem = "an OpenColorIO view has its own tone and transfer curve"
            raise InputError(problem, value=(self.tone, self.curve), expected="the view, or tone and curve")

    @classmethod
    def of(cls, settings: RenderSettings, file: Path | None = None) -> Display:
        """The look that a scene asks for: see `destello.python_types.RENDER`. Raises InputError, which names `file`."""
        try:
            return cls._of(settings)
        except InputError as error:
            raise error.within(None, file=file) from None

    @classmethod
    def _of(cls, settings: RenderSettings) -> Display:
        exposure = settings.exposure
        given = {name: getattr(settings, name) for name in ("iso", "exposure_time", "f_number")}
        camera = {name: value for name, value in given.items() if value is not None}
        if camera:
            missing = [name for name in ("exposure_time", "f_number") if name not in camera]
            if missing:
                raise InputError("half a camera's exposure", place="render", value=camera, expected=", ".join(missing))
            exposure += exposure_of_camera(**camera)
        balance = None
        if settings.temperature is not None:
            balance = WhiteBalance(settings.temperature, settings.tint)
        elif "tint" in settings.given:
            raise InputError("a tint without a temperature", place="render.tint", expected="render.temperature, too")
        return cls(exposure, settings.tone, settings.curve, balance)

    def changed(self, **options: Any) -> Display:
        """The same with what is not None put in its place; a view takes tone and curve away, and they the view."""
        given = {name: value for name, value in options.items() if value is not None}
        if "view" in given:
            given = {"tone": "none", "curve": "srgb", **given}
        elif "tone" in given or "curve" in given:
            given["view"] = None
        return replace(self, **given)

    @property
    def transfer(self) -> str:
        """The transfer curve that is used: `raw` has none."""
        return "linear" if self.tone == "raw" else self.curve

    def code_values(self, linear: npt.ArrayLike) -> FloatArray:
        """Linear RGB (..., 3), any value, to code values in [0, 1] (float32), by the steps described above."""
        x = np.nan_to_num(np.asarray(linear, dtype=np.float32), nan=0.0, neginf=0.0)
        with np.errstate(over="ignore"):
            if self.white_balance is not None:
                x = np.minimum(x, np.float32(1e30)) @ self.white_balance.matrix.T.astype(np.float32)
            x = x * np.float32(2.0**self.exposure) if self.exposure else x
        x = np.minimum(x, np.float32(1e30))
        if self.view is not None:
            return self.view.code_values(x)
        return encode(np.clip(TONES[self.tone](x), np.float32(0), np.float32(1)), self.transfer)

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


def exposure_of_camera(*, exposure_time: float, f_number: float, iso: float = 100.0) -> float:
    """The exposure in stops with which a camera of these settings shows radiances (taken for luminances in cd/m^2).

    By the saturation-based speed of ISO 12232:2019: a luminance of 78 / (0.65 S) N^2 / t, that is 1.2 times 2^EV100,
    is the brightest that the sensor holds, and becomes 1 (S. Lagarde, C. de Rousiers, "Moving Frostbite to Physically
    Based Rendering", 2014, section 5.1: lens transmittance and vignetting of 0.65).

    Args:
        exposure_time: t, in seconds, more than 0.
        f_number: N, more than 0.
        iso: S, the sensor's speed, more than 0.

    Raises InputError for anything else.
    """
    for name, value in (("exposure_time", exposure_time), ("f_number", f_number), ("iso", iso)):
        if not 0 < value < math.inf:
            raise InputError("out of range", place=name, value=value, expected="a number above 0")
    ev100 = 2 * math.log2(f_number) - math.log2(exposure_time) - math.log2(iso / 100)
    return -ev100 - math.log2(78 / 65)
