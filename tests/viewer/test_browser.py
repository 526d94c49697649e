"""The page in a real browser: what it shows, and what a hand does in the picture."""

from __future__ import annotations

import io
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from PIL import Image

import destello as dl
from destello.viewer.server import Viewer
from viewer_browser import (
    FREE,
    SAME,
    converged,
    drag,
    error,
    on_screen,
    opened,
    press,
    rendered,
    shot,
    tab,
    until,
    yellow,
)  # fmt: skip

pytestmark = pytest.mark.slow


@pytest.fixture
def page(browser: Any, viewer: Viewer) -> Iterator[Any]:
    found = opened(browser, viewer)
    yield found
    found.context.close()


def test_the_page_shows_what_render_makes(page: Any, viewer: Viewer) -> None:
    seen, session = converged(page, viewer)
    assert session.film is not None
    wanted = rendered(session, viewer.scene, session.film.samples)
    assert seen[FREE].std() > 15  # not blank
    assert error(seen, wanted) < SAME
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
    converged(page, viewer, also=lambda seen: error(before, seen) > 8)
    assert np.allclose(session.view.target, view.target, atol=1.0)  # it turned about the same point
    assert np.dot(session.view.up, (0, 1, 0)) > 0.9
    page.reload()
    until(page, lambda: session.closed)
    _, new = converged(page, viewer, also=lambda seen: error(before, seen) < SAME)
    assert new is not session


def test_the_gizmo_moves_what_is_saved(page: Any, viewer: Viewer) -> None:
    before, session = converged(page, viewer)
    page.mouse.click(*on_screen(session, (200, 40, 110)))
    until(page, lambda: session.selected == 7)  # the short box
    placed = viewer.scene.shapes[7]["transform"].matrix
    x, y = on_screen(session, (182.9, 82.5, 168.9))
    drag(page, (x - 70, y - 1), (x - 130, y - 1), yellow)  # the arrow along x, which points to the left here
    until(page, lambda: not np.allclose(viewer.scene.shapes[7]["transform"].matrix, placed))
    page.mouse.click(100, 300)  # nothing is there: it is let go, and no outline covers the picture
    until(page, lambda: session.selected is None)
    converged(page, viewer, also=lambda seen: error(before, seen) > 5)
    tab(page, "Save")
    with page.expect_download() as download:
        press(page, "Scene")
    loaded = dl.load(download.value.path().rename(download.value.path().with_suffix(".yaml")))
    shift = loaded.shapes[7]["transform"].matrix[:3, 3] - placed[:3, 3]
    assert np.linalg.norm(shift) > 20
    assert np.dot(shift / np.linalg.norm(shift), placed[:3, 0]) > 0.999  # along its own x
    press(page, "Undo")
    until(page, lambda: np.allclose(viewer.scene.shapes[7]["transform"].matrix, placed))


def test_a_material_is_edited_in_the_panel(page: Any, viewer: Viewer) -> None:
    before, session = converged(page, viewer)
    page.mouse.click(310, 230)
    until(page, lambda: session.selected == 0)  # the green wall
    tab(page, "Object")
    field = page.locator("input.mantine-ColorInput-input:visible").first  # viser gives it no label of its own
    field.fill("rgb(40, 60, 255)")
    field.press("Enter")
    until(page, lambda: viewer.scene.shapes[0]["material"]["reflectance"][2] == 1)
    wall = (slice(205, 280), slice(290, 335))
    until(page, lambda: shot(page)[wall][..., 2].mean() > before[wall][..., 2].mean() + 50)


def test_a_phone_sees_the_picture_first(browser: Any, viewer: Viewer) -> None:
    phone = browser.new_context(viewport={"width": 390, "height": 844}, device_scale_factor=2, has_touch=True)
    page = phone.new_page()
    page.goto(viewer.url)
    session = until(page, lambda: next(iter(viewer._app.sessions.values()), None))
    until(page, lambda: session.view.width > 390)  # the display's own pixels: it is crisp

    def middle() -> np.ndarray:
        seen = np.asarray(Image.open(io.BytesIO(page.screenshot())).convert("RGB")).astype(float)
        return seen[600:1100, 100:700]

    until(page, lambda: middle().std() > 10)  # the middle of the screen is picture, not panel
    phone.close()
