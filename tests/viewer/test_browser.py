"""The page in a real browser: a headless Chromium, driven by Playwright.

Skipped where either is missing. The browser is Debian's package `chromium` (apt-get install chromium), not one that
Playwright downloads.
"""

from __future__ import annotations

import io
import shutil
import time
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pytest
from PIL import Image

import destello as dl
from destello.viewer.server import Viewer
from destello.viewer.session import Session

playwright = pytest.importorskip("playwright.sync_api", reason="playwright is not installed")
CHROMIUM = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(CHROMIUM is None, reason="there is no Chromium: apt-get install chromium"),
]

SECONDS = 150.0  # for what takes far less on a machine that is free
WIDTH, HEIGHT = 900, 360
SPP = 12
FREE = (slice(205, HEIGHT - 5), slice(5, 550))  # what neither the panel nor a note covers
# A software renderer, no sandbox (tests run as root in containers).
ARGUMENTS = ["--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--hide-scrollbars"]


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    with playwright.sync_playwright() as started:
        chromium = started.chromium.launch(executable_path=CHROMIUM, args=ARGUMENTS)
        yield chromium
        chromium.close()


@pytest.fixture
def page(browser: Any, viewer: Viewer) -> Iterator[Any]:
    context = browser.new_context(viewport={"width": WIDTH, "height": HEIGHT})
    opened = context.new_page()
    opened.set_default_timeout(1000 * SECONDS)
    opened.goto(viewer.url)
    ready(opened, viewer)
    yield opened
    context.close()


def ready(page: Any, viewer: Viewer) -> Session:
    """Waits for the panel and the page's session."""
    page.get_by_text("Focal length").wait_for(state="attached")
    return until(page, lambda: next(iter(reversed(viewer._app.sessions.values())), None))


def until(page: Any, what: Callable[[], Any]) -> Any:
    """Waits, with the page alive, until `what()` is true, and returns it."""
    end = time.monotonic() + SECONDS
    while not (found := what()):
        assert time.monotonic() < end, "it never came to pass"
        page.wait_for_timeout(50)
    return found


def set_number(page: Any, label: str, value: float) -> None:
    field = page.get_by_label(label, exact=True)
    field.fill(str(value))
    field.press("Enter")


def converged(page: Any, viewer: Viewer, samples: int = SPP) -> tuple[np.ndarray, Session]:
    """A screenshot once the picture has that many samples, (height, width, 3) float."""
    session = ready(page, viewer)
    if session.limit != samples:
        page.get_by_role("tab", name="View").click()
        set_number(page, "Samples", samples)
    until(page, lambda: session.limit == samples)
    until(page, lambda: not session.moving and not session.busy)
    page.wait_for_timeout(2500)  # the page decodes and draws it
    return shot(page), session


def shot(page: Any) -> np.ndarray:
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


def test_the_page_shows_what_render_makes(page: Any, viewer: Viewer) -> None:
    seen, session = converged(page, viewer)
    wanted = rendered(session, viewer.scene, SPP)
    assert seen[FREE].std() > 15  # not blank
    assert error(seen, wanted) < 4
    assert abs(seen[FREE].mean() - wanted[FREE].mean()) < 1  # not washed out
    for turned in (wanted[:, ::-1], wanted[::-1]):
        assert error(seen, turned) > 15


def test_dragging_orbits_and_reloading_begins_again(page: Any, viewer: Viewer) -> None:
    before, session = converged(page, viewer)
    view = session.view
    page.mouse.move(110, 300)
    page.mouse.down()
    page.mouse.move(180, 308, steps=8)
    page.mouse.up()
    until(page, lambda: not session.view.same_place(view))
    after, _ = converged(page, viewer)
    assert error(before, after) > 8
    assert np.allclose(session.view.target, view.target, atol=1.0)  # it turned about the same point
    assert np.dot(session.view.up, (0, 1, 0)) > 0.9
    assert error(after, rendered(session, viewer.scene, SPP)) < 4
    page.reload()
    until(page, lambda: session.closed)
    again, new = converged(page, viewer)
    assert new is not session
    assert error(again, before) < 4


def test_the_gizmo_moves_what_is_saved(page: Any, viewer: Viewer) -> None:
    before, session = converged(page, viewer)
    page.mouse.click(*on_screen(session, (200, 40, 110)))
    until(page, lambda: session.selected == 7)  # the short box
    page.wait_for_timeout(1500)
    placed = viewer.scene.shapes[7]["transform"].matrix
    x, y = on_screen(session, (182.9, 82.5, 168.9))
    page.mouse.move(x - 70, y - 1)  # the arrow along x, which points to the left here
    page.wait_for_timeout(300)
    page.mouse.down()
    page.mouse.move(x - 130, y - 1, steps=6)
    page.mouse.up()
    until(page, lambda: not np.allclose(viewer.scene.shapes[7]["transform"].matrix, placed))
    after, _ = converged(page, viewer)
    assert error(before, after) > 5
    page.get_by_role("tab", name="Save").click()
    with page.expect_download() as download:
        page.get_by_role("button", name="Scene", exact=True).click()
    loaded = dl.load(download.value.path().rename(download.value.path().with_suffix(".yaml")))
    shift = loaded.shapes[7]["transform"].matrix[:3, 3] - placed[:3, 3]
    assert np.linalg.norm(shift) > 20
    assert np.dot(shift / np.linalg.norm(shift), placed[:3, 0]) > 0.999  # along its own x
    page.get_by_role("button", name="Undo").click()
    until(page, lambda: np.allclose(viewer.scene.shapes[7]["transform"].matrix, placed))


def on_screen(session: Session, point: tuple[float, float, float]) -> tuple[float, float]:
    view = session.view
    z = np.subtract(view.target, view.origin) / np.linalg.norm(np.subtract(view.target, view.origin))
    x = np.cross(z, view.up) / np.linalg.norm(np.cross(z, view.up))
    d = np.subtract(point, view.origin)
    scale = HEIGHT / 2 / np.tan(np.radians(view.vfov) / 2) / np.dot(d, z)
    return WIDTH / 2 + scale * np.dot(d, x), HEIGHT / 2 + scale * np.dot(d, np.cross(z, x))


def test_a_material_is_edited_in_the_panel(page: Any, viewer: Viewer) -> None:
    before, session = converged(page, viewer)
    page.mouse.click(310, 230)
    until(page, lambda: session.selected == 0)  # the green wall
    page.get_by_role("tab", name="Object").click()
    field = page.locator("input.mantine-ColorInput-input:visible").first  # viser gives it no label of its own
    field.fill("rgb(40, 60, 255)")
    field.press("Enter")
    until(page, lambda: viewer.scene.shapes[0]["material"]["reflectance"][2] == 1)
    after, _ = converged(page, viewer)
    wall = (slice(205, 280), slice(290, 335))
    assert after[wall][..., 2].mean() > before[wall][..., 2].mean() + 50


def test_a_phone_sees_the_picture_first(browser: Any, viewer: Viewer) -> None:
    phone = browser.new_context(viewport={"width": 390, "height": 844}, device_scale_factor=2, has_touch=True)
    opened = phone.new_page()
    opened.goto(viewer.url)
    session = until(opened, lambda: next(iter(viewer._app.sessions.values()), None))
    until(opened, lambda: session.frames >= 2)
    opened.wait_for_timeout(2000)
    assert session.view.width > 390  # the display's own pixels: it is crisp
    seen = np.asarray(Image.open(io.BytesIO(opened.screenshot())).convert("RGB")).astype(float)
    assert seen[600:1100, 100:700].std() > 10  # the middle of the screen is picture, not panel
    phone.close()
