"""How large a picture is rendered next, with how many samples: quick while something moves, fine once it rests."""

from __future__ import annotations

from dataclasses import dataclass

STILL_AFTER = 0.2  # seconds without a change, after which the picture is refined
_MOVING = 0.06  # seconds that a frame may take while something moves: with the rest of the work, over 10 a second
_REFINING = 0.15  # seconds of a pass at rest
_PATIENCE = 0.5  # seconds that the first one may take; else a picture of medium size goes before it
_LEAST_SIDE = 32  # px
_COARSEST = 1 / 10  # of the canvas, each way
_GROWTH = 4  # times the samples of the pass before
_WORTH_IT = 0.6  # a medium picture must have more pixels than those shown over this
_NEW = 0.5  # weight of the newest measurement


@dataclass(frozen=True, slots=True)
class Plan:
    """The next pass: `width` x `height` pixels, `spp` samples each; `full`: as fine as the display."""

    width: int
    height: int
    spp: int
    full: bool


@dataclass
class Pacer:
    """Learns how long samples take, and plans by it."""

    seconds_per_sample: float = 2e-7  # of one pixel; measured from the first frame on
    _measured: bool = False

    def plan(self, width: int, height: int, *, moving: bool, done: int = 0, shown: int = 0) -> Plan:
        """What to render for a canvas of `width` x `height` px.

        While moving, one sample a pixel at a size that takes `_MOVING` seconds; the same in each direction, so that
        pixels stay square. At rest the display's own size, with samples for `_REFINING` seconds, at least one.

        Args:
            width: of the canvas, px.
            height: of the canvas, px.
            moving: whether something has changed a moment ago.
            done: samples a pixel that there are already.
            shown: pixels of the picture that is shown now.
        """
        cost = max(self.seconds_per_sample * width * height, 1e-9)  # of one sample in every pixel
        if moving:
            scale = min(1.0, max((_MOVING / cost) ** 0.5, _COARSEST))
            if scale >= 0.95:
                return Plan(width, height, 1, True)
            return Plan(self._side(width, scale), self._side(height, scale), 1, False)
        medium = min(1.0, (_PATIENCE / 2 / cost) ** 0.5)
        if cost > _PATIENCE and shown < _WORTH_IT * medium**2 * width * height:
            return Plan(self._side(width, medium), self._side(height, medium), 1, False)
        samples = max(1, min(int(_REFINING / cost), _GROWTH * done or 1))
        return Plan(width, height, samples, True)

    def took(self, samples: int, seconds: float) -> None:
        """A pass of `samples` (pixels times samples a pixel) has taken that long, all work on the frame included."""
        if samples <= 0 or seconds <= 0:
            return
        measured = seconds / samples
        if self._measured:
            measured = _NEW * measured + (1 - _NEW) * self.seconds_per_sample
        self.seconds_per_sample, self._measured = measured, True

    @staticmethod
    def _side(length: int, scale: float) -> int:
        return min(length, max(_LEAST_SIDE, round(length * scale)))
