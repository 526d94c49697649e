"""What the viewer's tests share: a page's first look, and waiting for what must come to pass."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import numpy as np

from destello.viewer.camera import Frame, View
from destello.viewer.server import Viewer
from destello.viewer.session import Session
from viser_page import Page, camera_message, pixels

SIZE = (96, 64)
SECONDS = 60.0  # for what takes far less on a machine that is free


def first(viewer: Viewer) -> View:
    camera = viewer.scene.camera
    assert camera is not None
    return View.of(camera)


def look(viewer: Viewer, page: Page, view: View | None = None, size: tuple[int, int] = SIZE) -> None:
    camera = viewer.scene.camera
    assert camera is not None
    page.send(camera_message(view or first(viewer), Frame.of(camera), *size))


def eventually(what: Callable[[], Any], seconds: float = SECONDS) -> Any:
    """Waits until `what()` is true, and returns it."""
    end = time.monotonic() + seconds
    while not (found := what()):
        assert time.monotonic() < end, "it never came to pass"
        time.sleep(0.02)
    return found


def message_of(page: Page, kind: str) -> dict[str, Any] | None:
    """The first message of that kind, once it is there."""
    for message in page.messages:
        if message["type"] == kind:
            return message
    page.receive(SECONDS)
    return None


def select_short_box(viewer: Viewer, page: Page) -> Session:
    """Clicks on it in the Cornell box's picture, waits until it is selected, and returns the page's session."""
    page.frame()
    page.click(0.58, 0.75)
    session = next(iter(viewer._app.sessions.values()))
    assert eventually(lambda: session.selected) == 7
    return session


def finished(viewer: Viewer, page: Page, samples: int) -> np.ndarray:
    """The picture with that many samples a pixel."""
    page.use("Samples", samples)
    session = next(iter(viewer._app.sessions.values()))
    picture = pixels(page.frame())
    while True:
        film = session.film
        if not session.busy and film is not None and film.samples >= samples:
            try:
                picture = pixels(page.frame(0.5))
            except TimeoutError:
                return picture
        else:
            picture = pixels(page.frame())
