"""The handles that scale, without a browser."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import destello as dl
from destello.viewer.camera import rotation_matrix
from destello.viewer.handles import ALL, pulled
from destello.viewer.panel_object import ObjectPanel
from destello.viewer.placement import pose_of
from destello.viewer.server import Viewer
from viewer_tests import eventually, first, look
from viser_page import Page

AWAY = np.array((0.0, 0.0, 1.0))


def test_a_pull_in_the_plane_of_the_picture_scales_by_its_ratio() -> None:
    grabbed = np.array((0.5, 0.0, 0.2))
    assert pulled(grabbed, np.array((1.0, 0.3, 0.2)), AWAY, 1.0) == pytest.approx(2.0)  # across does not count
    assert pulled(grabbed, np.array((0.25, 0.0, 0.2)), AWAY, 1.0) == pytest.approx(0.5)
    assert pulled(grabbed, grabbed, AWAY, 1.0) == 1.0
    assert 0 < pulled(grabbed, np.array((-9.0, 0.0, 0.2)), AWAY, 1.0) < 0.1  # never through the middle
    assert pulled(AWAY, np.array((5.0, 0.0, 1.0)), AWAY, 1.0) == 1.0  # nothing says which way is out
    assert pulled(np.array((0.01, 0, 1)), np.array((0.36, 0, 1)), AWAY, 1.0) == pytest.approx(2.0)  # seen from its end


def pull(page: Page, viewer: Viewer, axis: int, factor: float) -> None:
    """Takes the cube of an axis by its middle, and pulls it out by the factor."""
    handles = panel(viewer)._handles
    assert handles is not None
    middle = handles._gizmo.position
    start = rotation_matrix(handles._gizmo.wxyz) @ handles._cubes[axis].position
    view = first(viewer)
    z = np.subtract(view.target, view.origin) / np.linalg.norm(np.subtract(view.target, view.origin))
    flat = start - (start @ z) * z
    cube = handles._cubes[axis]
    message: dict[str, Any] = {
        "type": "SceneNodeDragMessage", "name": cube.name, "instance_index": None, "button": "left", "modifier": None,
        "start_position": (middle + start).tolist(), "start_screen_pos": (0.5, 0.5), "end_screen_pos": (0.5, 0.5),
        "owner": next(m for m in page.messages if m["type"] == "TransformControlsMessage")["owner"],
    }  # fmt: skip
    for phase, part in (("start", 0.0), ("update", 0.5), ("update", 1.0), ("end", 1.0)):
        end = middle + start + (factor - 1) * part * flat
        page.send({**message, "phase": phase, "end_position": end.tolist()})


def panel(viewer: Viewer) -> ObjectPanel:
    return next(iter(viewer._pages.values())).object


def scale_of(viewer: Viewer) -> tuple[float, ...]:
    return pose_of(viewer.scene, viewer.scene.shapes[7]).scale


def selected(viewer: Viewer, page: Page) -> None:
    look(viewer, page)
    page.frame()
    page.click(0.58, 0.75)  # the short box, or what stands in its place
    session = next(iter(viewer._app.sessions.values()))
    assert eventually(lambda: session.selected) == 7
    eventually(lambda: any(m["type"] == "TransformControlsMessage" for m in page.messages) or page.receive(9) is None)


def test_a_cube_that_is_pulled_scales_in_one_step(viewer: Viewer) -> None:
    with Page(viewer.url) as page:
        selected(viewer, page)
        where = pose_of(viewer.scene, viewer.scene.shapes[7]).position
        pull(page, viewer, 1, 1.6)
        eventually(lambda: np.allclose(scale_of(viewer), (1, 1.6, 1), atol=1e-4))
        pull(page, viewer, ALL, 0.5)
        eventually(lambda: np.allclose(scale_of(viewer), (0.5, 0.8, 0.5), atol=1e-4))
        there = pose_of(viewer.scene, viewer.scene.shapes[7]).position
        assert np.allclose(there, where, atol=1e-2)  # m, of 165: about its own middle
        assert viewer._app.call(viewer._app.undo) == "move"
        assert np.allclose(scale_of(viewer), (1, 1.6, 1), atol=1e-4)
        viewer._app.call(viewer._app.undo)
        assert np.allclose(scale_of(viewer), 1, atol=1e-4)


def test_a_sphere_has_the_one_cube_that_scales_all_alike(viewer: Viewer) -> None:
    viewer.scene.shapes[7] = dl.shapes.sphere(center=(186, 82.5, 169), radius=80, material=dl.materials.diffuse())
    with Page(viewer.url) as page:
        eventually(lambda: viewer._app.document.revision)
        selected(viewer, page)
        handles = panel(viewer)._handles
        assert handles is not None
        assert list(handles._cubes) == [ALL]
        pull(page, viewer, ALL, 1.25)
        eventually(lambda: viewer.scene.shapes[7]["radius"] == pytest.approx(100, rel=1e-4))
