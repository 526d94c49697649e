"""What may come in from a page: kinds of messages, their shape, their size.

viser's own server takes any message that it knows, and sets whatever attribute a page names. Here, a message is looked
at before viser sees it. One of a kind that this viewer's page has no use for (such as a wish to publish the server
through a tunnel) is dropped; one that is damaged, or out of bounds, ends the connection that it came by, and no other.
"""

from __future__ import annotations

import math
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any, Literal, get_args

import msgspec
import websockets.asyncio.server as ws
from websockets.datastructures import Headers
from websockets.exceptions import ConnectionClosed
from websockets.http11 import Request, Response

from destello.viewer.access import Access, Refusal

MAX_BYTES = 64 * 1024  # of one message: the longest that the page sends has a few hundred
MAX_CLIENTS = 32
_LARGEST = 1e9  # any number: positions are in units of the view's distance
_MAX_SIDE = 16384  # px of a canvas

Quaternion = tuple[float, float, float, float]
Vector = tuple[float, float, float]


class Camera(msgspec.Struct, tag_field="type", tag="ViewerCameraMessage", forbid_unknown_fields=True):
    """The page's camera has moved, or its canvas has another size."""

    wxyz: Quaternion
    position: Vector
    fov: float
    near: float
    far: float
    image_height: int
    image_width: int
    look_at: Vector
    up_direction: Vector


class Widget(msgspec.Struct, tag_field="type", tag="GuiUpdateMessage", forbid_unknown_fields=True):
    """A widget has been used. `updates`: nothing but its value."""

    uuid: str
    updates: dict[str, bool | int | float | str | list[float]]


class Pointer(msgspec.Struct, tag_field="type", tag="ScenePointerMessage", forbid_unknown_fields=True):
    """A click into the picture."""

    event_type: str
    ray_origin: Vector | None
    ray_direction: Vector | None
    screen_pos: list[tuple[float, float]]
    modifier: str | None = None


class Drag(msgspec.Struct, tag_field="type", tag="TransformControlsUpdateMessage", forbid_unknown_fields=True):
    """The gizmo has been dragged."""

    name: str
    wxyz: Quaternion
    position: Vector
    owner: str = ""


class DragStart(msgspec.Struct, tag_field="type", tag="TransformControlsDragStartMessage", forbid_unknown_fields=True):
    """The gizmo has been grasped."""

    name: str
    owner: str = ""


class DragEnd(msgspec.Struct, tag_field="type", tag="TransformControlsDragEndMessage", forbid_unknown_fields=True):
    """The gizmo has been let go."""

    name: str
    owner: str = ""


class Pull(msgspec.Struct, tag_field="type", tag="SceneNodeDragMessage", forbid_unknown_fields=True):
    """A handle that scales has been dragged."""

    phase: Literal["start", "update", "end"]
    name: str
    instance_index: None
    start_position: Vector
    start_screen_pos: tuple[float, float]
    end_position: Vector
    end_screen_pos: tuple[float, float]
    button: Literal["left"]
    modifier: None
    owner: str = ""


class _Kind(msgspec.Struct):
    type: str


_known = Camera | Widget | Pointer | Drag | DragStart | DragEnd | Pull
_KINDS = {kind.__struct_config__.tag for kind in get_args(_known)}
_kind = msgspec.msgpack.Decoder(_Kind)
_whole = msgspec.msgpack.Decoder(_known)


class Hostile(ValueError):
    """A message that no page of ours sends."""


def admit(raw: object) -> bool:
    """Whether a message is for us; False: of a kind without use here. Raises Hostile for one that is damaged."""
    if not isinstance(raw, bytes):
        raise Hostile("text where bytes are wanted")
    try:
        if _kind.decode(raw).type not in _KINDS:
            return False
        message = _whole.decode(raw)
        _check(message)
    except (msgspec.MsgspecError, ValueError, RecursionError) as error:
        raise Hostile(str(error)) from None
    return True


def _check(message: Any) -> None:
    _check_values(msgspec.structs.astuple(message))
    if isinstance(message, Camera):
        sides = (message.image_width, message.image_height)
        if not all(1 <= side <= _MAX_SIDE for side in sides):
            raise Hostile("a canvas of no size, or too large")
        if not 1e-4 < message.fov < math.pi - 1e-4:
            raise Hostile("an impossible field of view")
        if not 0.5 < math.hypot(*message.wxyz) < 2 or not any(message.up_direction):
            raise Hostile("not a rotation")
    if isinstance(message, Drag) and not 0.5 < math.hypot(*message.wxyz) < 2:
        raise Hostile("not a rotation")
    if isinstance(message, Widget) and set(message.updates) != {"value"}:
        raise Hostile("a widget's page may change its value only")
    if isinstance(message, Pointer) and (message.event_type != "click" or len(message.screen_pos) != 1):
        raise Hostile("not a click")


def _check_values(value: Any) -> None:
    if isinstance(value, (int, float)) and not abs(value) <= _LARGEST:
        raise Hostile("a number out of range")
    if isinstance(value, str) and len(value) > 256:
        raise Hostile("a text that is too long")
    if isinstance(value, dict):
        _check_values(tuple(value))
        value = tuple(value.values())
    if isinstance(value, (tuple, list)):
        if len(value) > 16:
            raise Hostile("too many values")
        for inner in value:
            _check_values(inner)


class GuardedConnection(ws.ServerConnection):
    """A connection that hands on only messages that `admit` lets pass."""

    async def recv(self, decode: bool | None = None) -> Any:
        """The next message that is for us; a hostile one closes the connection, like an oversized one."""
        while True:
            raw = await super().recv(decode)
            try:
                if admit(raw):
                    return raw
            except Hostile as error:
                await self.close(1008, str(error)[:100])


Process = Callable[[Any, Request], Response | None]


def gatekeeper(access: Access, inner: Process, clients: Callable[[], int]) -> Process:
    """What answers a handshake, HTTP or websocket: a refusal, or what `inner` says to the path without the token."""

    def process(connection: Any, request: Request) -> Response | None:
        headers = request.headers
        found = access.check(request.path, headers.get_all("Host"), headers.get_all("Origin"))
        wants_socket = any("websocket" in value.lower() for value in headers.get_all("Upgrade"))
        if isinstance(found, str) and wants_socket and clients() >= MAX_CLIENTS:
            found = Refusal(503, f"{MAX_CLIENTS} pages are open already")
        if isinstance(found, Refusal):
            return _refuse(found)
        if wants_socket:
            return None
        request.path = found
        answer = inner(connection, request)
        if answer is not None:
            answer.headers["Referrer-Policy"] = "no-referrer"  # the address has the token
            answer.headers["X-Content-Type-Options"] = "nosniff"
            answer.headers["Cache-Control"] = "no-store"
        return answer

    return process


def _refuse(refusal: Refusal) -> Response:
    body = (refusal.reason + "\n").encode()
    headers = Headers({"Content-Type": "text/plain; charset=utf-8", "Content-Length": str(len(body))})
    headers["Connection"] = "close"
    return Response(refusal.status, "Refused", headers, body)


_lock = threading.Lock()


@contextmanager
def guarded(access: Access, clients: Callable[[], int]) -> Iterator[None]:
    """While it lasts, a viser server that starts gets the gatekeeper, guarded connections and the limit of size.

    viser starts `websockets.asyncio.server.serve` itself and passes no options on, so that function is replaced for
    that moment. Raises RuntimeError if viser did not use it: better no server than one that is open.
    """
    used = False
    plain = ws.serve

    def serve(handler: Any, *args: Any, **options: Any) -> Any:
        nonlocal used
        if not handler.__module__.startswith("viser."):
            return plain(handler, *args, **options)
        used = True
        options["process_request"] = gatekeeper(access, options["process_request"], clients)
        options |= {"max_size": MAX_BYTES, "create_connection": GuardedConnection, "max_queue": 64}
        return plain(handler, *args, **options)

    with _lock:
        ws.serve = serve  # type: ignore[assignment,misc]
        try:
            yield
        finally:
            ws.serve = plain  # type: ignore[misc]
    if not used:
        raise RuntimeError("this release of viser starts its server in another way: the viewer cannot guard it")


__all__ = ["MAX_BYTES", "MAX_CLIENTS", "ConnectionClosed", "Hostile", "admit", "gatekeeper", "guarded"]
