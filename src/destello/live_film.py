"""The film of a `LiveScene`: sums that stay on the device, of which only what is shown comes back."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from destello.errors import InputError

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from destello.color import Display


class LiveFilm:
    """Samples of one picture; made by `LiveScene.film`, filled by `LiveScene.render`.

    Attributes:
        width, height: px.
        samples: whole passes' samples a pixel; 0 after it has started anew.
        guide_samples: those of them that recorded albedo and normal.
        guides: whether it can hold those.
    """

    def __init__(self, core: Any, width: int, height: int, guides: bool) -> None:
        self.core = core
        self.width, self.height, self.guides = width, height, guides
        self.samples = self.guide_samples = self.next_sample = 0
        self._of: Any = None

    def cancel(self) -> None:
        """Ends the pass that is being rendered into this film, within milliseconds; if none is, the next one at once."""
        self.core.cancel()

    def restart(self) -> None:
        """Forgets all samples. Not while it is being rendered."""
        self._of = None

    def begin(self, what: Any) -> None:
        """Starts anew unless the film shows just that (scene's version, camera, settings)."""
        if self._of == what:
            return
        self.core.clear()
        self.samples = self.guide_samples = self.next_sample = 0
        self._of = what

    def took(self, samples: int, *, cancelled: bool, guides: bool) -> None:
        """After a pass: its sample numbers are spent, also where it was cancelled."""
        self.next_sample += samples
        if not cancelled:
            self.samples += samples
            self.guide_samples += samples if guides and self.guides else 0

    def mean(self) -> NDArray[np.float32]:
        """Linear Rec.709 radiance, (height, width, 3), row 0 at the top."""
        array: NDArray[np.float32] = self.core.mean()
        return array

    def picture(self, display: Display) -> NDArray[np.uint8]:
        """Code values for a display, (height, width, 3): as `Display.quantise` makes them of `mean`, on the device."""
        array: NDArray[np.uint8] = self.core.picture(2.0**display.exposure, display.tone, display.curve)
        return array

    def albedo(self) -> NDArray[np.float32]:
        """Reflectance of what the pixels show, (height, width, 3). Raises InputError if the film has no guides."""
        return self._feature("albedo")

    def normal(self) -> NDArray[np.float32]:
        """Mean shading normals of what the pixels show, (height, width, 3). Raises InputError as `albedo`."""
        return self._feature("normal")

    def _feature(self, name: str) -> NDArray[np.float32]:
        if not self.guides:
            raise InputError("the film has no guides", value=name, expected="one made with guides=True")
        array: NDArray[np.float32] = self.core.feature(name)
        return array
