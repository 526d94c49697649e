"""The page in a real browser: what is edited in it, one page for all. Each test puts back what it has changed."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest

import destello as dl
from destello.viewer.camera import View, rotation_matrix
from destello.viewer.handles import ALL
from destello.viewer.placement import pose_of
from destello.viewer.server import Viewer
from destello.viewer.session import Session
from viewer_browser import (
    SAME,
    choose,
    converged,
    drag,
    error,
    on_screen,
    opened,
    press,
    ready,
    set_number,
    tab,
    until,
)  # fmt: skip

pytestmark = pytest.mark.slow

BOX = 7  # the short one, among the scene's shapes


@dataclass
class Desk:
    """A page, and what is behind it."""

    page: Any
    viewer: Viewer
    session: Session

    @property
    def scene(self) -> dl.Scene:
        return self.viewer.scene

    @property
    def scale(self) -> tuple[float, float, float]:
        """Of the short box."""
        return pose_of(self.scene, self.scene.shapes[BOX]).scale


@pytest.fixture(scope="module")
def desk(browser: Any) -> Iterator[Desk]:
    """The Cornell box with a lamp, another camera, and a ball that rolls for a second."""
    scene = dl.scenes.build("cornell")
    scene.lights.append(dl.lights.point(name="lamp", position=(120, 300, 150), intensity=(2e4, 2e4, 2e4)))
    scene.cameras["side"] = dl.cameras.perspective(origin=(400, 300, -700), target=(278, 200, 200), vfov=40)
    blue = dl.materials.diffuse(reflectance=(0.1, 0.2, 0.9))
    roll = dl.keyframes("translate", {0: (0, 0, 0), 1: (-250, 0, 0)})
    scene.shapes.append(dl.shapes.sphere(center=(400, 60, 60), radius=50, material=blue, animation=roll))
    with dl.view(scene, port=0, device="cpu") as viewer:
        page = opened(browser, viewer)
        yield Desk(page, viewer, ready(page, viewer))
        page.context.close()


def cube(desk: Desk, axis: int) -> tuple[tuple[float, float], tuple[float, float]]:
    """Where in the page a cube of the gizmo is, and the gizmo's middle."""
    handles = until(desk.page, lambda: desk.viewer._pages[desk.session.client.client_id].object._handles)
    middle = handles._gizmo.position
    there = middle + rotation_matrix(handles._gizmo.wxyz) @ handles._cubes[axis].position
    points = (tuple(map(float, desk.viewer._frame.scene(point))) for point in (there, middle))
    place, centre = (on_screen(desk.session, point) for point in points)  # type: ignore[arg-type]
    return place, centre


def white(pixels: np.ndarray) -> bool:
    return bool((pixels.min(axis=-1) > 190).any())


def test_the_white_cube_scales_what_is_saved(desk: Desk) -> None:
    page, session = desk.page, desk.session
    before, _ = converged(page, desk.viewer)
    page.mouse.click(*on_screen(session, (200, 40, 110)))
    until(page, lambda: session.selected == BOX)
    place, middle = cube(desk, ALL)
    out = (place[0] + 0.5 * (place[0] - middle[0]), place[1] + 0.5 * (place[1] - middle[1]))
    drag(page, place, out, white)
    until(page, lambda: desk.viewer._app.document.steps[0] == "move" and desk.scale[0] > 1.3)
    until(page, lambda: not session.moving)
    assert np.allclose(desk.scale, desk.scale[0], rtol=1e-5)  # all alike
    assert 1.3 < desk.scale[0] < 1.8
    tab(page, "Save")
    with page.expect_download() as download:
        press(page, "Scene")
    loaded = dl.load(download.value.path().rename(download.value.path().with_suffix(".yaml")))
    assert np.allclose(pose_of(loaded, loaded.shapes[BOX]).scale, desk.scale)
    page.mouse.click(100, 300)  # nothing is there: the box is let go
    until(page, lambda: session.selected is None)
    converged(page, desk.viewer, also=lambda seen: error(seen, before) > SAME)
    press(page, "Undo")  # the drag is one step
    until(page, lambda: np.allclose(desk.scale, 1, atol=1e-6))


def test_undo_and_redo_change_the_picture_and_the_light(desk: Desk) -> None:
    page = desk.page
    before, _ = converged(page, desk.viewer)
    tab(page, "Lights")
    choose(page, "Light", "light 0: lamp")
    page.get_by_label("strength", exact=True).wait_for()
    set_number(page, "strength", 3e5)
    until(page, lambda: max(desk.scene.lights[0]["intensity"]) == 3e5)
    bright, _ = converged(page, desk.viewer)
    assert bright.mean() > before.mean() + 15
    press(page, "Undo")
    until(page, lambda: max(desk.scene.lights[0]["intensity"]) == 2e4)
    converged(page, desk.viewer, also=lambda seen: error(seen, before) < SAME)
    tab(page, "Lights")
    assert page.get_by_label("strength", exact=True).input_value() == "20000"  # the panel follows
    press(page, "Redo")
    converged(page, desk.viewer, also=lambda seen: error(seen, bright) < SAME)
    press(page, "Undo")
    until(page, lambda: max(desk.scene.lights[0]["intensity"]) == 2e4)


def test_cameras_are_chosen_by_name(desk: Desk) -> None:
    page, session = desk.page, desk.session
    before, _ = converged(page, desk.viewer)
    tab(page, "View")
    choose(page, "Camera", "side")
    until(page, lambda: np.allclose(session.view.origin, desk.scene.cameras["side"]["origin"], atol=0.1))
    converged(page, desk.viewer, also=lambda seen: error(seen, before) > 8)
    assert np.allclose(session.view.vfov, 40, atol=0.01)
    choose(page, "Camera", "default")
    first = View.of(desk.scene.cameras["default"])
    until(page, lambda: np.allclose(session.view.origin, first.origin, atol=0.1))


def test_the_focus_is_where_a_click_was(desk: Desk) -> None:
    page, session = desk.page, desk.session
    sharp, _ = converged(page, desk.viewer)
    tab(page, "View")
    page.get_by_label("Focus by click", exact=True).check()
    set_number(page, "Aperture radius", 100)
    until(page, lambda: session.lens.aperture_radius == 100)
    corner = (185.0, 60.0, 65.5)  # on the front of the short box
    page.mouse.click(*on_screen(session, corner))
    until(page, lambda: session.lens.focus_distance > 0)
    assert session.lens.focus_distance == pytest.approx(865, abs=30)  # m, from z = -800
    assert session.selected is None
    until(page, lambda: not page.get_by_label("Focus by click", exact=True).is_checked())
    converged(page, desk.viewer, also=lambda seen: error(seen, sharp) > 2)
    set_number(page, "Aperture radius", 0)
    set_number(page, "Focus distance", 0)
    until(page, lambda: session.lens.aperture_radius == session.lens.focus_distance == 0)


def test_the_slider_of_time_moves_what_is_animated(desk: Desk) -> None:
    page = desk.page
    before, _ = converged(page, desk.viewer)
    tab(page, "View")
    slider = page.get_by_role("slider").last
    slider.press("End")
    until(page, lambda: desk.viewer._app.frame == desk.scene.frames - 1)
    after, _ = converged(page, desk.viewer)

    def blue(seen: np.ndarray, x: float) -> float:
        column, row = (round(v) for v in on_screen(desk.session, (x, 95, 30)))
        r, g, b = seen[row - 3 : row + 4, column - 3 : column + 4].mean(axis=(0, 1))
        return float(b - max(r, g))

    assert blue(before, 400) > 20 > blue(after, 400)
    assert blue(after, 400 - 250 * 23 / 24) > 20 > blue(before, 400 - 250 * 23 / 24)
    slider.press("Home")
    until(page, lambda: desk.viewer._app.frame == 0)
