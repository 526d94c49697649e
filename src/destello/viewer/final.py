"""A render of full quality beside the session: the offline renderer in a thread of its own."""

from __future__ import annotations

import threading
from collections.abc import Callable
from dataclasses import dataclass, field

from destello.errors import Error
from destello.image import Image
from destello.progress import Status
from destello.render import render
from destello.scene import Scene


class _Cancelled(Exception):
    """Ends a render from within its report."""


@dataclass
class FinalRender:
    """One render of a copy of the scene.

    Attributes:
        scene: that copy: the session may go on editing its own.
        spp, size, device, denoise: as `destello.render` has them.
        on_progress: called, in the render's thread, with each `Status`.
        on_end: called last, with the picture, or with None and what went wrong (empty: cancelled).
    """

    scene: Scene
    camera: str
    spp: int
    size: tuple[int, int]
    device: str
    denoise: bool
    on_progress: Callable[[Status], object]
    on_end: Callable[[Image | None, str], None]
    _cancelled: threading.Event = field(default_factory=threading.Event)
    _thread: threading.Thread | None = None

    def start(self) -> None:
        """Begins."""
        self._thread = threading.Thread(target=self._run, name="destello-final", daemon=True)
        self._thread.start()

    def cancel(self) -> None:
        """Ends it after the pass that is under way; nothing is kept."""
        self._cancelled.set()

    @property
    def running(self) -> bool:
        """Whether it has not ended yet."""
        return self._thread is not None and self._thread.is_alive()

    def join(self, seconds: float) -> None:
        """Waits for its end, so long at most."""
        if self._thread is not None:
            self._thread.join(seconds)

    def _report(self, status: Status) -> None:
        if self._cancelled.is_set():
            raise _Cancelled
        self.on_progress(status)

    def _run(self) -> None:
        try:
            image = render(
                self.scene, spp=self.spp, size=self.size, device=self.device, camera=self.camera,
                denoise=self.denoise, progress=self._report, messages=lambda _: None,
            )  # fmt: skip
        except _Cancelled:
            self.on_end(None, "")
        except (Error, MemoryError) as error:
            self.on_end(None, str(error) or "out of memory")
        else:
            self.on_end(image, "")
