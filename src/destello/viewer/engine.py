"""The renderer behind the pages: one `LiveScene`, and when a pass may be broken off."""

from __future__ import annotations

from dataclasses import dataclass

from destello.live import LiveScene
from destello.live_film import LiveFilm
from destello.nodes import Node
from destello.scene import Scene


@dataclass
class Engine:
    """What the render thread renders with.

    Attributes:
        live: the scene on its device.
    """

    live: LiveScene
    _refining: LiveFilm | None = None

    @classmethod
    def of(cls, scene: Scene, device: str = "auto", threads: int = 0) -> Engine:
        """Compiles the scene. Raises as `LiveScene` does."""
        return cls(LiveScene(scene, device, threads=threads))

    @property
    def revision(self) -> int:
        """Of the scene on the device."""
        return self.live.version

    def render(self, film: LiveFilm, camera: Node, samples: int, *, guides: bool, refining: bool) -> bool:
        """Adds samples; False if the pass was broken off. `refining`: it may be, for something newer."""
        self._refining = film if refining else None
        try:
            return not self.live.render(film, samples, camera=camera, guides=guides).cancelled
        finally:
            self._refining = None

    def give_way(self) -> None:
        """Breaks off a pass that only refines; from any thread. Frames while something moves are short, and go on."""
        film = self._refining
        if film is not None:
            film.cancel()
