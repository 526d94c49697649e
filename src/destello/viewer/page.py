"""One page's panels and what a hand does in the picture: moving the camera, clicking, dragging the gizmo."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from destello.errors import Error
from destello.viewer.app import App
from destello.viewer.camera import View
from destello.viewer.newest import Newest
from destello.viewer.panel_lights import LightsPanel
from destello.viewer.panel_object import ObjectPanel
from destello.viewer.panel_save import SavePanel
from destello.viewer.panel_view import ViewPanel
from destello.viewer.session import Session
from destello.viewer.widgets import clicked


class Page:
    """What belongs to one page. All but the coroutines runs in the render thread."""

    def __init__(self, app: App, session: Session) -> None:
        self.app = app
        self.session = session
        self._seen: Newest[View] = Newest()
        self._panels: list[Any] = []
        self._steps: Any = None

    def build(self) -> None:
        """Draws the panels and begins to listen."""
        gui = self.session.client.gui
        undo = gui.add_button_group("Edits", ("Undo", "Redo"))
        clicked(undo, self.post, lambda: self._turn(undo.value))
        self._steps = undo
        tabs = gui.add_tab_group()
        self.view = ViewPanel(self, tabs)
        self.object = ObjectPanel(self, tabs)
        self.lights = LightsPanel(self, tabs)
        self.save = SavePanel(self, tabs)
        self._panels = [self.view, self.object, self.lights, self.save]
        self.session.on_status = self.view.say
        self.app.on_change.append(self.refresh)
        self.session.client.scene.on_click()(self._picture_clicked)

    def close(self) -> None:
        """The page has gone: nothing that it held is kept."""
        self.session.closed = True
        if self.refresh in self.app.on_change:
            self.app.on_change.remove(self.refresh)
        if self._panels:
            self.save.close()
        self._panels = []
        self.session.close()

    # --- for the panels -----------------------------------------------------------------------------------------------

    def post(self, task: Callable[[], None]) -> bool:
        """Has something done in the render thread, if it returns True; what is wrong with it is said on the page."""
        return self.app.post(lambda: self.attempt(task))

    def attempt(self, task: Callable[[], None]) -> None:
        """Does something; an error of the user's is said on the page, and the widgets show again what holds."""
        if self.session.closed:
            return
        try:
            task()
        except Error as error:
            self.tell(str(error))
            self.refresh()

    def edit(self, label: str, change: Callable[[Any], None], merge: object = None) -> None:
        """Changes the scene, with undo. Raises SceneError."""
        self.app.edit(label, change, None if merge is None else (id(self), merge))

    def tell(self, text: str, title: str = "destello") -> None:
        """Says something on this page."""
        self.session.client.add_notification(title, text, auto_close_seconds=8.0)

    def refresh(self) -> None:
        """The scene has changed: the panels show it."""
        if self.session.closed:
            return
        if self.session.selected is not None and self.session.selected >= len(self.app.document.scene.shapes):
            self.select(None)
        for panel in self._panels:
            panel.refresh()

    def select(self, shape: int | None) -> None:
        """Selects one of the scene's shapes, or nothing."""
        if shape != self.session.selected:
            self.session.selected = shape
            self.session.redraw()
            self.object.selected()

    def look_from(self, view: View) -> None:
        """The page looks from somewhere else, or another way."""
        self.session.view = view
        self.session.moved()
        self.object.looked()

    # --- what a hand does ---------------------------------------------------------------------------------------------

    async def camera_moved(self, camera: Any) -> None:
        """Heard from the page's first message on, before the panels are there: it may be the last one for long."""
        self._seen.hand(View.from_page(camera, self.session.frame), lambda: self.app.post(self._look))

    def _look(self) -> None:
        view = self._seen.take()
        if view is None or not self._panels:
            return
        old = self.session.view
        if (view.width, view.height) == (old.width, old.height) and view.same_place(old):
            return
        self.look_from(view)
        self.view.looked()

    async def _picture_clicked(self, event: Any) -> None:
        x, y = event.screen_pos
        if 0 <= x <= 1 and 0 <= y <= 1:
            self.post(lambda: self._click(x, y))

    def _click(self, x: float, y: float) -> None:
        session = self.session
        view = session.view
        hit = self.app.engine.live.pick(x * view.width, y * view.height, (view.width, view.height), session.camera)
        if self.view.focus_by_click:
            self.view.focus_at(None if hit is None else hit.point)
        else:
            self.select(None if hit is None else hit.index)

    def _turn(self, what: str) -> None:
        label = self.app.undo() if what == "Undo" else self.app.redo()
        self.tell(f"{what}: {label}" if label else f"Nothing to {what.lower()}")
