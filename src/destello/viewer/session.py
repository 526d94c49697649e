"""One page: its camera, its picture while it grows, what it has selected. Only the render thread uses it."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

from viser._messages import BackgroundImageMessage

from destello.color import Display, FloatArray
from destello.live_film import LiveFilm, show
from destello.nodes import Node
from destello.viewer.camera import Frame, View
from destello.viewer.engine import Engine
from destello.viewer.picture import jpeg, outline
from destello.viewer.resolution import STILL_AFTER, Pacer, Plan

STATUS_EVERY = 0.4  # seconds
_GUIDES = 16  # samples with albedo and normal
_DENOISE_GROWTH = 2  # denoised anew when there are so many times the samples


@dataclass
class Lens:
    """What a page's camera has besides its place. Lengths in metres; focus distance 0: on the target."""

    aperture_radius: float = 0.0
    focus_distance: float = 0.0


@dataclass
class Session:
    """A page.

    Attributes:
        client: viser's handle. engine: renders.
        frame: the page's coordinates.
        view, lens, look: what is to be seen, and how.
        denoised: whether noise is removed from the picture at rest.
        limit: samples a pixel at which it is finished.
        selected: the number of a shape in the scene, or None.
        revision: of the scene that the film shows.
        closed: the page has gone.
    """

    client: Any
    engine: Engine
    frame: Frame
    view: View
    lens: Lens = field(default_factory=Lens)
    look: Display = field(default_factory=Display)
    denoised: bool = False
    limit: int = 1024
    selected: int | None = None
    revision: int = -1
    closed: bool = False
    on_status: Callable[[str], None] = lambda _: None
    pacer: Pacer = field(default_factory=Pacer)
    film: LiveFilm | None = None
    frames: int = 0
    rate: float = 0.0
    _camera: Node | None = None
    _moved: float = field(default_factory=time.monotonic)  # a new page gets a quick picture first
    _stale: bool = True
    _sent: float = 0.0
    _said: float = 0.0
    _denoised_at: int = 0
    _mask: Any = None

    # --- what others ask for ------------------------------------------------------------------------------------------

    def moved(self) -> None:
        """The camera has moved, or the scene was touched: until it rests, frames are small and come quickly."""
        self._moved = time.monotonic()

    def redraw(self) -> None:
        """The picture is the same, but looks another way."""
        self._stale = True

    @property
    def camera(self) -> Node:
        """The renderer's camera."""
        return self.view.node(self.lens.aperture_radius, self.lens.focus_distance)

    @property
    def moving(self) -> bool:
        """Whether something has changed a moment ago."""
        return time.monotonic() - self._moved < STILL_AFTER

    @property
    def busy(self) -> bool:
        """Whether there is something to render or to send."""
        if self.closed:
            return False
        film = self.film
        if film is None or self._stale or self._outdated(self.engine.revision):
            return True
        return film.samples < self.limit or (film.width, film.height) != (self.view.width, self.view.height)

    @property
    def urgent(self) -> bool:
        """Whether something new is to be seen, beyond less noise."""
        return not self.closed and (self.moving or self._stale or self._outdated(self.engine.revision))

    def close(self) -> None:
        """Gives back what the film holds."""
        if self.film is not None:
            self.film.close()
            self.film = None

    # --- the render thread's turn -------------------------------------------------------------------------------------

    def step(self) -> None:
        """Renders one pass and sends the picture."""
        began = time.monotonic()
        moving = self.moving
        changed = self._outdated(self.engine.revision)
        done = 0 if changed or self.film is None else self.film.samples
        shown = 0 if changed or self.film is None else self.film.width * self.film.height
        plan = self.pacer.plan(self.view.width, self.view.height, moving=moving, done=done, shown=shown)
        film, done = self._film(plan, changed)
        if done < self.limit:
            samples = min(plan.spp, self.limit - done)
            guides = not moving and film.guide_samples < _GUIDES
            if not self.engine.render(film, self._camera or self.camera, samples, guides=guides, refining=not moving):
                return  # something newer goes first
            self._send(film, fine=not moving)
            self.pacer.took(samples * film.width * film.height, time.monotonic() - began)
        elif self._stale:
            self._send(film, fine=not moving)
        else:
            time.sleep(0.01)  # a small picture is finished: it will soon have rested long enough for a large one
        self._count(film)

    def _outdated(self, revision: int) -> bool:
        return self._camera is None or self.revision != revision or self.camera != self._camera

    def _film(self, plan: Plan, changed: bool) -> tuple[LiveFilm, int]:
        """The film to go on with, and its samples a pixel: an empty one if the old one does not fit any more."""
        film = self.film
        fits = film is not None and (film.width, film.height) == (plan.width, plan.height)
        if film is not None and fits and not changed:
            return film, film.samples
        if film is None or not fits:
            self.close()
            film = self.engine.live.film(plan.width, plan.height, guides=True)
        else:
            film.restart()
        self.film, self._camera, self.revision = film, self.camera, self.engine.revision
        self._denoised_at, self._mask = 0, None
        return film, 0

    def _send(self, film: LiveFilm, *, fine: bool) -> None:
        if self.denoised and fine and not self._worth_denoising(film):
            return
        picture = show(film.denoised(), self.look) if self.denoised and fine else film.picture(self.look)
        if self.selected is not None:
            picture = outline(picture, self._inside(film), 1 + film.height // 600)
        self.send(BackgroundImageMessage("jpeg", jpeg(picture, fine=fine), None))
        self._stale = False
        self.frames += 1

    def _worth_denoising(self, film: LiveFilm) -> bool:
        if not self._stale and film.samples < min(self.limit, _DENOISE_GROWTH * self._denoised_at):
            return False
        self._denoised_at = film.samples
        return True

    def _inside(self, film: LiveFilm) -> Any:
        """Which pixels show the selected shape."""
        if self._mask is None or self._mask[0] != self.selected:
            ids = self.engine.live.ids((film.width, film.height), self._camera or self.camera)
            self._mask = (self.selected, ids == self.selected)
        return self._mask[1]

    def linear(self, film: LiveFilm) -> FloatArray:
        """The film's radiance, without noise if that is wanted."""
        return film.denoised() if self.denoised else film.mean()

    def send(self, message: Any) -> None:
        """Puts a message on its way at once, unless the page has gone."""
        if not self.closed:
            self.client._websock_connection.queue_message(message)
            self.client.flush()

    def _count(self, film: LiveFilm) -> None:
        now = time.monotonic()
        if self._sent:
            interval = max(now - self._sent, 1e-6)
            self.rate = 0.8 * self.rate + 0.2 / interval if self.rate else 1 / interval
        self._sent = now
        if now - self._said >= STATUS_EVERY or film.samples >= self.limit:
            self._said = now
            rates = f"{self.rate:.1f} frames/s, {1e-6 / self.pacer.seconds_per_sample:.3g} Msamples/s"
            self.on_status(f"{film.samples} of {self.limit} samples at {film.width}x{film.height}; {rates}")
