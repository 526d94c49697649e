"""What the viewer's tests in a real browser share: waiting for the page, and looking at it.

Nothing here sleeps for a while and hopes: what is waited for is looked at again and again, until it holds.
"""

from __future__ import annotations

import io
import shutil
import time
from collections.abc import Callable
from typing import Any

import numpy as np
from PIL import Image

import destello as dl
from destello.viewer.server import Viewer
from destello.viewer.session import Session

CHROMIUM = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
# A software renderer, no sandbox (tests run as root in containers).
ARGUMENTS = ["--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--hide-scrollbars"]

SECONDS = 150.0  # for what takes far less on a machine that is free
WIDTH, HEIGHT = 900, 360
SPP = 4
FREE = (slice(205, HEIGHT - 5), slice(5, 550))  # what neither the panel nor a note covers
SAME = 4.0  # `error` of two pictures of the same: what JPEG and the page's own resolution make of it


def opened(browser: Any, viewer: Viewer) -> Any:
    """A page with the viewer in it, ready to be used."""
    page = browser.new_context(viewport={"width": WIDTH, "height": HEIGHT}).new_page()
    page.set_default_timeout(1000 * SECONDS)
    page.goto(viewer.url)
    ready(page, viewer)
    return page


def ready(page: Any, viewer: Viewer) -> Session:
    """Waits for the panel and the page's session."""
    page.get_by_text("Focal length").wait_for(state="attached")
    return until(page, lambda: next(iter(reversed(viewer._app.sessions.values())), None))


def until(page: Any, what: Callable[[], Any], told: Callable[[], str] = lambda: "it never came to pass") -> Any:
    """Waits, with the page alive, until `what()` is true, and returns it."""
    end = time.monotonic() + SECONDS
    while not (found := what()):
        assert time.monotonic() < end, told()
        page.wait_for_timeout(50)
    return found


def tab(page: Any, name: str) -> None:
    """Opens one of the panel's tabs."""
    page.get_by_role("tab", name=name).click()


def set_number(page: Any, label: str, value: float) -> None:
    """Types a number into a field of the open tab."""
    field = page.get_by_label(label, exact=True)
    field.fill(str(value))
    field.press("Enter")


def choose(page: Any, label: str, name: str) -> None:
    """Takes something from a list of the open tab."""
    page.get_by_label(label, exact=True).click()
    page.get_by_role("option", name=name, exact=True).click()


def press(page: Any, label: str) -> None:
    """Presses a button of the open tab."""
    page.get_by_role("button", name=label, exact=True).click()


def converged(
    page: Any, viewer: Viewer, samples: int = SPP, *, also: Callable[[np.ndarray], bool] = lambda _: True
) -> tuple[np.ndarray, Session]:
    """A screenshot, (height, width, 3) float, once the page shows what `destello render` makes of its camera.

    Args:
        page: the browser's. viewer: whose page it is.
        samples: a pixel, at least: the picture may have had more before it was told.
        also: what the picture must be, besides.
    """
    session = ready(page, viewer)
    if session.limit != samples:
        tab(page, "View")
        set_number(page, "Samples", samples)
    off = [np.inf]
    wanted: list[Any] = [None, None]

    def there() -> Any:
        film = session.film
        if session.limit != samples or session.moving or session.busy or film is None:
            return None
        state = (session.camera, viewer._app.document.revision, viewer._app.frame, film.samples)
        if state != wanted[0]:
            wanted[:] = state, rendered(session, viewer.scene.copy().at_frame(viewer._app.frame), film.samples)
        seen = shot(page)
        off[0] = error(seen, wanted[1])
        return (seen,) if off[0] < SAME and also(seen) else None

    (seen,) = until(page, there, lambda: f"the page is {off[0]:.1f} from what it should show")
    return seen, session


def shot(page: Any) -> np.ndarray:
    """A screenshot, (height, width, 3) float, 0 to 255."""
    return np.asarray(Image.open(io.BytesIO(page.screenshot())).convert("RGB")).astype(float)


def error(a: np.ndarray, b: np.ndarray) -> float:
    """Root mean square, in code values of 255, over what is not covered, of means of 5x5 pixels.

    The page may draw at less than the display's pixels when it is slow, and noise is not the same then.
    """
    difference = (a - b)[FREE]
    rows, columns = (n // 5 for n in difference.shape[:2])
    blocks = difference[: 5 * rows, : 5 * columns].reshape(rows, 5, columns, 5, 3).mean(axis=(1, 3))
    return float(np.sqrt(np.mean(blocks**2)))


def rendered(session: Session, scene: dl.Scene, samples: int) -> np.ndarray:
    """What `destello render` makes of the page's camera, at the page's size."""
    copy = scene.copy()
    copy.cameras = {"page": session.camera}
    size = (session.view.width, session.view.height)
    bytes_ = dl.render(copy, spp=samples, size=size, device="cpu", progress=False).to_uint8()
    return np.asarray(Image.fromarray(bytes_).resize((WIDTH, HEIGHT), Image.Resampling.BILINEAR)).astype(float)


def on_screen(session: Session, point: tuple[float, float, float]) -> tuple[float, float]:
    """Where a point of the scene is in the page, px."""
    view = session.view
    z = np.subtract(view.target, view.origin) / np.linalg.norm(np.subtract(view.target, view.origin))
    x = np.cross(z, view.up) / np.linalg.norm(np.cross(z, view.up))
    d = np.subtract(point, view.origin)
    scale = HEIGHT / 2 / np.tan(np.radians(view.vfov) / 2) / np.dot(d, z)
    return WIDTH / 2 + scale * np.dot(d, x), HEIGHT / 2 + scale * np.dot(d, np.cross(z, x))


def drag(page: Any, begin: tuple[float, float], end: tuple[float, float], lit: Callable[[np.ndarray], bool]) -> None:
    """Drags what lights up under the pointer: `lit` says of the pixels about it, (13, 13, 3), whether it does."""
    x, y = round(begin[0]), round(begin[1])
    jitter = iter(range(1 << 30))

    def grasped() -> bool:
        page.mouse.move(begin[0] + next(jitter) % 2, begin[1])  # what appears under a pointer at rest stays dark
        return lit(shot(page)[y - 6 : y + 7, x - 6 : x + 7])

    until(page, grasped, lambda: "nothing lights up under the pointer")
    page.mouse.down()
    page.mouse.move(*end, steps=8)
    page.mouse.up()


def yellow(pixels: np.ndarray) -> bool:
    """Whether a part of the gizmo is under the pointer."""
    r, g, b = np.moveaxis(pixels, -1, 0)
    return bool(((np.minimum(r, g) > 150) & (b < 0.75 * np.minimum(r, g))).any())
