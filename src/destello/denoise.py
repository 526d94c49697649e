"""Noise removed by Open Image Denoise (Áfra and others, Intel), through the package `pyoidn`."""

from __future__ import annotations

import importlib.util
import weakref
from typing import Any

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

    clean = _clean(color)
    guides: dict[str, FloatArray] = {}
    if albedo is not None:
        guides["albedo"] = _bounded(albedo, 0)
        if normal is not None:
            guides["normal"] = _bounded(normal, -1)
    try:
        result = pyoidn.denoise(np.ascontiguousarray(clean, dtype=np.float32), **guides, hdr=True)
    except RuntimeError as error:
        raise RenderError(f"the denoiser failed: {error}") from error
    return np.asarray(result, dtype=np.float32)


def _clean(color: FloatArray) -> FloatArray:
    return np.maximum(np.nan_to_num(color, nan=0.0, posinf=0.0, neginf=0.0), np.float32(0))


def _bounded(feature: FloatArray, low: float) -> FloatArray:
    return np.clip(np.nan_to_num(feature), np.float32(low), np.float32(1))


class LiveDenoiser:
    """Denoises frames of one size one after another: the network and its buffers are made once, and it hurries."""

    def __init__(self, width: int, height: int, *, guides: bool) -> None:
        """`guides`: frames come with albedo and normal. Raises InputError if the package is missing, RenderError."""
        check_available()
        import pyoidn

        self._device = pyoidn.Device()
        self._device.commit()
        self._check()
        names = ("color", "albedo", "normal") if guides else ("color",)
        self._images = {name: np.zeros((height, width, 3), np.float32) for name in (*names, "output")}
        self._filter = pyoidn.Filter(self._device, pyoidn.OIDN_FILTER_TYPE_RT)
        for name, image in self._images.items():
            self._filter.set_image(name, image, pyoidn.OIDN_FORMAT_FLOAT3)
        self._filter.set_bool("hdr", True)
        self._filter.set_quality(pyoidn.OIDN_QUALITY_FAST)
        self._filter.commit()
        self._check()
        self._release = weakref.finalize(self, _release, self._filter, self._device)

    def __call__(self, color: FloatArray, guides: tuple[FloatArray, FloatArray] | None = None) -> FloatArray:
        """As `denoise`. `guides`: (albedo, normal); None: those of the last frame."""
        self._images["color"][:] = _clean(color)
        if guides is not None:
            self._images["albedo"][:] = _bounded(guides[0], 0)
            self._images["normal"][:] = _bounded(guides[1], -1)
        self._filter.execute()
        self._check()
        return self._images["output"].copy()

    def close(self) -> None:
        """Gives memory back now and not when the object goes."""
        self._release()

    def _check(self) -> None:
        problem = self._device.get_error()
        if problem is not None:
            raise RenderError(f"the denoiser failed: {problem}")


def _release(*handles: Any) -> None:
    for handle in handles:
        handle.release()
