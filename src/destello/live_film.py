"""The film of a `LiveScene`: sums that stay on the device, of which only what is shown comes back."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from destello.color_spaces import conversion, converted
from destello.errors import InputError

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from destello.color import Display, FloatArray
    from destello.denoise import LiveDenoiser

_FAST_TONES = {"none": "none", "agx": "agx", "neutral": "neutral", "filmic": "filmic", "raw": "none"}


class LiveFilm:
    """Samples of one picture; made by `LiveScene.film`, filled by `LiveScene.render`.

    It belongs to one thread, but for `cancel`.

    Attributes:
        width, height: px.
        samples: whole passes' samples a pixel; 0 after it has started anew.
        guide_samples: those of them that recorded albedo and normal.
        guides: whether it can hold those.
    """

    def __init__(self, core: Any, width: int, height: int, *, guides: bool) -> None:
        self.core = core
        self.width, self.height, self.guides = width, height, guides
        self.samples = self.guide_samples = self.next_sample = 0
        self._space = "rec709"
        self._of: Any = None
        self._denoisers: dict[bool, LiveDenoiser] = {}  # with guides and without
        self._guides_of: Any = None  # what the denoiser's guides show

    def cancel(self) -> None:
        """Ends the pass that is being rendered into this film, in milliseconds; if none is, the next one at once."""
        self.core.cancel()

    def restart(self) -> None:
        """Forgets all samples. Not while it is being rendered."""
        self._of = None

    def begin(self, what: Any, space: str) -> None:
        """Starts anew unless it shows just that (scene's version, camera, settings). `space`: of the sums' colours."""
        if self._of == what:
            return
        self.core.clear()
        self.samples = self.guide_samples = self.next_sample = 0
        self._of, self._space = what, space

    def took(self, samples: int, *, cancelled: bool, guides: bool) -> None:
        """After a pass: its sample numbers are spent, also where it was cancelled."""
        self.next_sample += samples
        if not cancelled:
            self.samples += samples
            self.guide_samples += samples if guides and self.guides else 0

    def mean(self) -> FloatArray:
        """Linear Rec.709 radiance, (height, width, 3), row 0 at the top."""
        return converted(self.core.mean(), self._space, "rec709")

    def picture(self, display: Display) -> NDArray[np.uint8]:
        """Code values for a display, (height, width, 3): as `Display.quantise` makes them of `mean`.

        On the device, but for the tone curve `aces2` and views of OpenColorIO, which take the host much longer.
        """
        if not is_fast(display):
            return display.quantise(self.mean())
        array: NDArray[np.uint8] = self.core.picture(*look(display, self._space))
        return array

    def denoised(self) -> FloatArray:
        """As `mean`, without its noise. Albedo and normal guide it if there are samples with guides.

        Needs the extra `destello[denoise]`: raises InputError without it. `show` makes a picture of the result.
        """
        from destello.denoise import LiveDenoiser

        guided = self.guide_samples > 0
        if guided not in self._denoisers:
            self._denoisers[guided] = LiveDenoiser(self.width, self.height, guides=guided)
            self._guides_of = None
        guides, now = None, (self._of, self.guide_samples)
        if guided and self._guides_of != now:
            guides = (self.albedo(), self.normal())
        self._guides_of = now if guided else None
        return self._denoisers[guided](self.mean(), guides)

    def close(self) -> None:
        """Gives the denoiser's memory back; the film's own goes with the film."""
        for denoiser in self._denoisers.values():
            denoiser.close()
        self._denoisers.clear()

    def albedo(self) -> FloatArray:
        """Reflectance of what the pixels show, (height, width, 3). Raises InputError if the film has no guides."""
        return self._feature("albedo")

    def normal(self) -> FloatArray:
        """Mean shading normals of what the pixels show, (height, width, 3). Raises InputError as `albedo`."""
        return self._feature("normal")

    def _feature(self, name: str) -> FloatArray:
        if not self.guides:
            raise InputError("the film has no guides", value=name, expected="one made with guides=True")
        array: FloatArray = self.core.feature(name)
        return array


def is_fast(display: Display) -> bool:
    """Whether the core makes this display's pictures."""
    return display.view is None and display.tone in _FAST_TONES


def look(display: Display, space: str = "rec709") -> tuple[list[list[float]], str, str]:
    """What the core's pictures are told: the matrix from colours of `space`, tone curve, transfer curve."""
    matrix = np.eye(3) if space == "rec709" else conversion(space, "rec709")
    if display.white_balance is not None:
        matrix = display.white_balance.matrix @ matrix
    return (matrix * 2.0**display.exposure).tolist(), _FAST_TONES[display.tone], display.transfer


def show(radiance: FloatArray, display: Display) -> NDArray[np.uint8]:
    """As `Display.quantise`, for pictures that must come quickly: linear Rec.709 (height, width, 3) to code values."""
    if not is_fast(display):
        return display.quantise(radiance)
    from destello import _core

    shown: Any = _core.show_radiance(np.ascontiguousarray(radiance, np.float32), *look(display))
    array: NDArray[np.uint8] = shown
    return array
