"""Noise removed by Open Image Denoise (Áfra and others, Intel), through the package `pyoidn`."""

from __future__ import annotations

import importlib.util

import numpy as np

from destello.color import FloatArray
from destello.errors import InputError, RenderError

_HOW_TO_INSTALL = "pip install 'destello[denoise]'"


def available() -> bool:
    """Whether Open Image Denoise is installed."""
    return importlib.util.find_spec("pyoidn") is not None


def check_available() -> None:
    """Raises InputError, naming the command that installs it, where Open Image Denoise is not installed."""
    if not available():
        raise InputError("the denoiser is not installed", expected=_HOW_TO_INSTALL)


def denoise(color: FloatArray, albedo: FloatArray | None = None, normal: FloatArray | None = None) -> FloatArray:
    """Returns the picture without its noise: the expected radiance that a neural network reads out of it.

    Args:
        color: linear radiance >= 0, (height, width, 3) float32; what is negative or not finite counts as 0.
        albedo: reflectance of what each pixel shows, in [0, 1], same shape, or None.
        normal: its normal, components in [-1, 1], same shape, or None; used only together with `albedo`.

    Raises InputError if the package is missing, RenderError if the denoiser fails.
    """
    check_available()
    import pyoidn

    clean = np.maximum(np.nan_to_num(color, nan=0.0, posinf=0.0, neginf=0.0), np.float32(0))
    guides: dict[str, FloatArray] = {}
    if albedo is not None:
        guides["albedo"] = np.clip(np.nan_to_num(albedo), np.float32(0), np.float32(1))
        if normal is not None:
            guides["normal"] = np.clip(np.nan_to_num(normal), np.float32(-1), np.float32(1))
    try:
        result = pyoidn.denoise(np.ascontiguousarray(clean, dtype=np.float32), **guides, hdr=True)
    except RuntimeError as error:
        raise RenderError(f"the denoiser failed: {error}") from error
    return np.asarray(result, dtype=np.float32)
