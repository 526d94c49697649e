"""What may come in from a page, and what hostile pages can do."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import msgspec
import numpy as np
import pytest
from websockets.exceptions import WebSocketException

from destello.viewer.camera import Frame, View
from destello.viewer.guard import MAX_BYTES, Hostile, admit
from destello.viewer.server import Viewer
from viewer_tests import SECONDS, first, look
from viser_page import Page, camera_message, pixels


def test_known_messages_are_admitted_and_others_dropped(viewer: Viewer) -> None:
    good = camera_message(first(viewer), Frame.of(viewer.scene.camera), 640, 480)  # type: ignore[arg-type]
    assert admit(msgspec.msgpack.encode(good))
    assert admit(msgspec.msgpack.encode(PULL))
    for kind in ("ShareUrlRequest", "FileTransferStartUpload", "RunJavascriptMessage", "no such kind"):
        assert not admit(msgspec.msgpack.encode({"type": kind}))


def widget(**updates: object) -> bytes:
    return msgspec.msgpack.encode({"type": "GuiUpdateMessage", "uuid": "x", "updates": updates})


RECTANGLE = {
    "type": "ScenePointerMessage",
    "event_type": "rect-select",
    "ray_origin": None,
    "ray_direction": None,
    "screen_pos": [(0, 0), (1, 1)],
    "modifier": None,
}
PULL = {
    "type": "SceneNodeDragMessage",
    "phase": "update",
    "name": "/selected/scale0",
    "instance_index": None,
    "start_position": (0.0, 0.0, 0.0),
    "start_screen_pos": (0.5, 0.5),
    "end_position": (0.0, 0.0, 0.0),
    "end_screen_pos": (0.5, 0.5),
    "button": "left",
    "modifier": None,
    "owner": "",
}
BAD: dict[str, Any] = {
    "text": "hello",
    "nothing": b"",
    "no map": msgspec.msgpack.encode([1, 2]),
    "no type": msgspec.msgpack.encode({"a": 1}),
    "camera of nothing": msgspec.msgpack.encode({"type": "ViewerCameraMessage"}),
    "deep": b"\x91" * 5000 + b"\x01",
    "widget's callbacks": widget(update_cb=1),
    "long text": widget(value="x" * 9999),
    "no number": widget(value=float("nan")),
    "huge": widget(value=10**18),
    "rectangle": msgspec.msgpack.encode(RECTANGLE),
    "pull of no phase": msgspec.msgpack.encode({**PULL, "phase": "x"}),
    "pull to nowhere": msgspec.msgpack.encode({**PULL, "end_position": (float("nan"), 0.0, 0.0)}),
}


@pytest.mark.parametrize("name", BAD)
def test_damaged_messages_are_hostile(name: str) -> None:
    with pytest.raises(Hostile):
        admit(BAD[name])


@pytest.mark.parametrize("key", ["wxyz", "position", "fov", "image_width", "image_height", "up_direction", "look_at"])
@pytest.mark.parametrize("value", [float("nan"), float("inf"), 0, -1, 1e30, [], [0.0] * 3, [0.0] * 4, "x", None, [[1]]])
def test_cameras_that_cannot_be(viewer_free_camera: dict[str, Any], key: str, value: object) -> None:
    message = {**viewer_free_camera, key: value}
    legal = key in ("position", "look_at") and value == [0.0] * 3
    try:
        assert admit(msgspec.msgpack.encode(message))
        assert legal
    except Hostile:
        assert not legal


@pytest.fixture
def viewer_free_camera() -> dict[str, Any]:
    view = View((0, 0, 4), (0, 0, 0), (0, 1, 0), 40.0)
    return camera_message(view, Frame((0, 0, 0), 1.0), 640, 480)


@pytest.mark.fuzz
def test_damaged_bytes_never_get_through_as_something_else(
    viewer_free_camera: dict[str, Any], rng: np.random.Generator
) -> None:
    whole = msgspec.msgpack.encode(viewer_free_camera)
    for _ in range(3000):
        damaged = bytearray(whole)
        for _ in range(int(rng.integers(1, 5))):
            damaged[int(rng.integers(len(damaged)))] = int(rng.integers(256))
        cut = bytes(damaged[: int(rng.integers(1, len(damaged) + 1))])
        try:
            if admit(cut):
                found = msgspec.msgpack.decode(cut)
                assert np.isfinite([*found["wxyz"], *found["position"], found["fov"]]).all()
        except Hostile:
            continue


def listen_after(page: Page, message: Any) -> None:
    page.socket.send(message)
    while True:
        page.socket.recv(timeout=SECONDS)


@pytest.mark.fuzz
def test_hostile_pages_end_nothing_but_their_own_connection(viewer: Viewer, rng: np.random.Generator) -> None:
    with Page(viewer.url) as good:
        look(viewer, good)
        good.frame()
        for message in [*BAD.values(), *(rng.bytes(int(n)) for n in rng.integers(1, 300, 30))]:
            with Page(viewer.url) as bad, pytest.raises(WebSocketException):
                listen_after(bad, message)
        with Page(viewer.url) as large, pytest.raises(WebSocketException):
            listen_after(large, b"x" * (MAX_BYTES + 1))
        assert large.socket.close_code == 1009  # too big: it was not even read
        with Page(viewer.url) as odd:  # well-formed, and of no use: the connection stays
            look(viewer, odd)
            odd.frame()
            samples = odd.widget("Samples")["uuid"]
            for value in (True, "many", [1, 2, 3], -5, 1e9, 0, 2.5):
                odd.send({"type": "GuiUpdateMessage", "uuid": samples, "updates": {"value": value}})
                odd.send(
                    {"type": "GuiUpdateMessage", "uuid": odd.widget("Tone curve")["uuid"], "updates": {"value": value}}
                )
            for kind in ("TransformControlsUpdateMessage", "TransformControlsDragStartMessage"):
                pose = {"wxyz": [1, 0, 0, 0], "position": [0, 0, 0]} if "Update" in kind else {}
                odd.send({"type": kind, "name": "/none", "owner": "", **pose})
            odd.send(PULL)
            odd.click(5.0, -3.0)
            odd.send({"type": "ShareUrlRequest"})
            look(viewer, odd, replace(first(viewer), vfov=20.0))
            assert pixels(odd.frame()).size
        assert viewer._server._share_tunnel is None
        look(viewer, good, replace(first(viewer), vfov=50.0))
        assert pixels(good.frame()).size
        assert viewer._app.call(lambda: 7) == 7
