"""The renderer behind the pages: one scene on one device, any camera, a few samples at a time."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from destello import device as devices
from destello.color import Display, FloatArray
from destello.job import Request, plan
from destello.nodes import Node
from destello.scene import Scene
from destello.viewer.picture import Bytes, shown

_CAMERA = "the page's own"


@dataclass
class Film:
    """What has been rendered for one page. `spp`: samples a pixel so far."""

    core: Any
    width: int
    height: int
    spp: int = 0
    rays: int = 0

    def clear(self):
        from destello import _core

        self.core, self.spp = _core.Film(self.width, self.height, aovs=True), 0


class Engine:
    def __init__(self, device: str = "auto", threads: int = 0) -> None:
        self.device = devices.choose(device)
        self._threads = threads
        self._scene: Scene | None = None
        self._renderer: Any = None
        self._camera: Node | None = None
        self._compiled: Any = None
        self._settings: dict[str, Any] = {}
        self.revision = 0

    def show(self, scene: Scene) -> None:
        self._scene, self._camera = scene.copy(), None
        self.revision += 1
        self._settings = plan(self._scene.copy(), Request(device=self.device.name)).settings

    def film(self, width: int, height: int) -> Film:
        from destello import _core

        return Film(_core.Film(width, height, aovs=True), width, height)

    def render(self, film: Film, camera: Node, samples: int) -> float:
        from destello import _core

        self._look_through(camera)
        scratch = _core.Film(film.width, film.height, aovs=True)
        counts = self._renderer.render(scratch, self._index, film.spp, film.spp + samples, self._settings)
        if counts["cancelled"]:
            return 0
        film.core.add(scratch)
        film.spp += samples
        film.rays += int(counts["rays"])
        return float(counts["seconds"])

    def _look_through(self, camera: Node) -> None:
        from destello import _core

        if self._camera is camera or self._camera == camera:
            return
        scene = self._scene.copy()
        scene.cameras = {_CAMERA: camera}
        self._compiled = scene.compile(build="fast", device=self.device.name, threads=self._threads)
        self._index = self._compiled.cameras[_CAMERA]
        self._renderer = _core.Renderer(self._compiled.core, device=self.device.name, threads=self._threads)
        self._camera = camera

    def cancel_refining(self):
        if self.refining:
            self.cancel()

    refining = False

    def cancel(self) -> None:
        if self._renderer is not None:
            self._renderer.cancel()

    def picture(self, film: Film, display: Display) -> Bytes:
        return shown(display, self.linear(film))

    def linear(self, film: Film) -> FloatArray:
        return np.asarray(film.core.mean(), dtype=np.float32)

    def features(self, film: Film) -> tuple[FloatArray, FloatArray]:
        return film.core.aov("albedo"), film.core.aov("normal")

    def ids(self, camera, width, height):
        return np.full((height, width), -1)

    def pick(self, camera, width, height, x, y):
        return None
