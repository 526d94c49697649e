"""The server, and what happens when a page comes and goes."""

from __future__ import annotations

import atexit
import contextlib
import io
import math
import threading
from html import escape
from typing import Any

import viser

from destello.color import Display
from destello.defaults import ensure_camera, ensure_light
from destello.device import Device
from destello.errors import InputError
from destello.scene import Scene
from destello.viewer.access import Access, address
from destello.viewer.app import App
from destello.viewer.camera import Frame, View
from destello.viewer.guard import guarded
from destello.viewer.page import Page
from destello.viewer.session import Lens, Session

_PORT = 8080
_STOP = 1.0  # seconds for the render thread to end


def _quiet() -> contextlib.AbstractContextManager[Any]:
    """Viser prints addresses, without the token, and farewells."""
    return contextlib.redirect_stdout(io.StringIO())


class Viewer:
    """A scene in the browser, until `stop`.

    Attributes:
        scene: what is shown. Edit it as ever (`scene.shapes[0] = ...`): the pages follow, and pages edit it, too.
        url: where the page is, with the token if there is one.
        port: the one it got.
        idle: once it is stopped, whether nothing is at work any more; False: a pass of a render is, for a moment.
    """

    def __init__(
        self, scene: Scene, *, host: str, port: int | None, device: str, token: str | None, threads: int = 0
    ) -> None:
        """See `destello.viewer.view`."""
        self._access = Access.for_host(host, token)
        if not scene.cameras:
            ensure_camera(scene)
        ensure_light(scene)
        self.scene = scene
        self.idle = False
        self._app = App(scene, device, threads)
        camera = scene.camera
        assert camera is not None
        self._frame = Frame.of(camera)
        self._first = View.of(camera, scene.film.width, scene.film.height)
        self._pages: dict[int, Page] = {}
        self._stopped = threading.Event()
        self._server = self._serve(host, port)
        self.port = int(self._server.get_port())
        self.url = address(host, self.port, self._access)
        self._app.start()
        atexit.register(self.stop)  # a program that ends shall not leave the render thread in the core

    @property
    def device(self) -> Device:
        """What renders, and why that."""
        return self._app.engine.live.device

    def stop(self) -> None:
        """Ends the server and frees everything; pages lose their connection. Safe to call again."""
        if self._stopped.is_set():
            return
        self._stopped.set()
        atexit.unregister(self.stop)
        for session in list(self._app.sessions.values()):
            session.closed = True
        self.idle = self._app.stop(_STOP)
        if not self._app.running:  # else their films are in use, and go with the program
            for page in list(self._pages.values()):
                page.close()
        with _quiet():
            self._server.stop()
        self._pages.clear()
        self._app.sessions.clear()

    def wait(self) -> None:
        """Returns when the viewer is stopped, by `stop` or by Ctrl-C (KeyboardInterrupt goes on to the caller)."""
        try:
            while not self._stopped.wait(0.2):
                pass
        finally:
            self.stop()

    def __enter__(self) -> Viewer:
        return self

    def __exit__(self, *_: object) -> None:
        self.stop()

    def __repr__(self) -> str:
        state = "stopped" if self._stopped.is_set() else self.url
        return f"<destello.Viewer {state}>"

    def _repr_html_(self) -> str:
        """The page itself, in a notebook."""
        if self._stopped.is_set():
            return escape(repr(self))
        return f'<iframe src="{escape(self.url)}" width="100%" height="600" style="border: 0"></iframe>'

    # --- pages --------------------------------------------------------------------------------------------------------

    def _serve(self, host: str, port: int | None) -> Any:
        with guarded(self._access, lambda: len(self._pages)), _quiet():
            server = viser.ViserServer(host=host, port=_PORT if port is None else port, verbose=False)
        if port not in (None, 0, server.get_port()):
            server.stop()
            raise InputError("the port is taken, or not allowed", place="port", value=port, expected="a free one")
        server.gui.configure_theme(dark_mode=True, show_logo=False, show_share_button=False)
        server.gui.set_panel_label(self.scene.name or "destello")
        server.scene.set_up_direction(self._first.up)
        start = server.initial_camera
        start.far, start.near = 1e4, 0.01
        start.position = self._frame.page(self._first.origin)
        start.look_at = self._frame.page(self._first.target)
        start.up = self._first.up
        start.fov = math.radians(self._first.vfov)
        server.on_client_connect(self._connect)
        server.on_client_disconnect(self._disconnect)
        return server

    async def _connect(self, client: Any) -> None:
        view = View.from_page(client.camera, self._frame)
        camera, wanted = self.scene.camera, self.scene.render
        lens = Lens()
        if camera is not None and camera.type == "perspective":
            lens = Lens(camera["aperture_radius"], camera["focus_distance"])
        look = Display.of(wanted)
        session = Session(client, self._app.engine, self._frame, view, lens, look, limit=max(256, wanted.spp))
        page = Page(self._app, session)
        self._pages[client.client_id] = page
        self._app.post(lambda: self._open(client.client_id, page))
        client.camera.on_update(page.camera_moved)

    def _open(self, number: int, page: Page) -> None:
        if not page.session.closed:
            self._app.sessions[number] = page.session
            page.build()

    async def _disconnect(self, client: Any) -> None:
        page = self._pages.pop(client.client_id, None)
        if page is not None:
            page.session.closed = True
            self._app.post(lambda: self._close(client.client_id, page))

    def _close(self, number: int, page: Page) -> None:
        self._app.sessions.pop(number, None)
        page.close()
