"""What a page says while the render thread is busy: the last of it counts, whenever it comes."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from typing import Any

import numpy as np

from destello.viewer.newest import Newest
from destello.viewer.placement import pose_of
from destello.viewer.server import Viewer
from viewer_tests import SECONDS, eventually, first, look, message_of, select_short_box
from viser_page import Page


class Gate:
    """Whoever calls it waits until it is over."""

    def __init__(self) -> None:
        self.began, self.over = threading.Event(), threading.Event()

    def __call__(self) -> None:
        self.began.set()
        self.over.wait(SECONDS)


@contextmanager
def busy(viewer: Viewer) -> Iterator[None]:
    """Meanwhile the render thread does nothing else."""
    gate = Gate()
    viewer._app.post(gate)
    assert gate.began.wait(SECONDS)
    try:
        yield
    finally:
        gate.over.set()


def test_the_newest_value_is_taken_once() -> None:
    box: Newest[int] = Newest()
    assert box.take() is None
    assert box.put(1)
    assert not box.put(2)
    assert box.take() == 2
    assert box.take() is None
    assert box.put(3)


def test_a_page_that_moves_before_its_panels_are_there_is_seen_from_where_it_stands(viewer: Viewer) -> None:
    view = replace(first(viewer), origin=(300.0, 200.0, -700.0))
    there = viewer._frame.page(view.origin)
    with Page(viewer.url) as page:
        with busy(viewer):
            look(viewer, page)
            eventually(lambda: viewer._pages)
            look(viewer, page, view)
            clients = viewer._server.get_clients
            eventually(lambda: any(np.allclose(c.camera.position, there) for c in clients().values()))
        session = eventually(lambda: next(iter(viewer._app.sessions.values()), None))
        eventually(lambda: np.allclose(session.view.origin, view.origin))


def test_the_end_of_a_drag_counts_though_it_comes_during_an_edit(viewer: Viewer) -> None:
    with Page(viewer.url) as page:
        look(viewer, page)
        session = select_short_box(viewer, page)
        gizmo = eventually(lambda: message_of(page, "TransformControlsMessage"))
        gate = Gate()
        viewer._app.on_change.append(gate)
        where = viewer._frame.page(middle(viewer))
        end = np.add(where, (0.5, 0.0, 0.0))
        named = {"name": gizmo["name"], "owner": gizmo["owner"]}

        def drag(x: float) -> None:
            pose = {"wxyz": [1.0, 0.0, 0.0, 0.0], "position": np.add(where, (x, 0.0, 0.0)).tolist()}
            page.send({"type": "TransformControlsUpdateMessage", **named, **pose})

        page.send({"type": "TransformControlsDragStartMessage", **named})
        drag(0.1)
        assert gate.began.wait(SECONDS)
        drag(0.5)
        page.send({"type": "TransformControlsDragEndMessage", **named})
        handle = viewer._pages[session.client.client_id].object._gizmo
        eventually(lambda: np.allclose(handle.position, end))
        gate.over.set()
        eventually(lambda: np.allclose(viewer._frame.page(middle(viewer)), end, atol=1e-3))
        assert viewer._app.call(viewer._app.undo) == "move"
        assert np.allclose(viewer._frame.page(middle(viewer)), where, atol=1e-3)


def middle(viewer: Viewer) -> Any:
    """Where the short box is: the middle of its bounds."""
    return pose_of(viewer.scene, viewer.scene.shapes[7]).position
