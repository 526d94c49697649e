"""The panel of the view: how far the picture is, the camera, the look, the time."""

from __future__ import annotations

import dataclasses
from typing import TYPE_CHECKING, Any

import numpy as np

from destello.color import CURVES
from destello.denoise import available
from destello.tones import TONES
from destello.viewer.camera import View, field_of_view, focal_length
from destello.viewer.widgets import listen

if TYPE_CHECKING:
    from destello.scene import Scene
    from destello.viewer.page import Page

_FREE = "(free)"
_SHORTEST, _LONGEST = 2.0, 2000.0  # mm


class ViewPanel:
    """Its widgets belong to one page; its camera and look do, too."""

    def __init__(self, page: Page, tabs: Any) -> None:
        self._page = page
        self._session = page.session
        gui = page.session.client.gui
        with tabs.add_tab("View"):
            self._status = gui.add_markdown("...")
            self._picture(gui)
            with gui.add_folder("Camera"):
                self._camera(gui)
            with gui.add_folder("Look"):
                self._look(gui)
            self._time(gui)

    def say(self, text: str) -> None:
        """How far the picture is."""
        if not self._session.closed:
            self._status.content = text

    def refresh(self) -> None:
        """The scene has changed."""
        self._names.options = self._cameras()

    @property
    def focus_by_click(self) -> bool:
        """Whether the next click sets the focus."""
        return bool(self._by_click.value)

    def looked(self) -> None:
        """The page's camera has moved by hand."""
        if not self._is_named(self._names.value):
            self._names.value = self._first()
        length = round(focal_length(self._session.view.vfov), 2)
        if abs(self._length.value - length) > 0.02:
            self._length.value = length

    def focus_at(self, point: tuple[float, float, float] | None) -> None:
        """Puts the plane of focus through a point of the scene (metres)."""
        if point is None:
            self._page.tell("There is nothing to focus on")
            return
        view = self._session.view
        origin = np.array(view.origin)
        forward = np.array(view.target) - origin
        distance = float(np.dot(np.array(point) - origin, forward / np.linalg.norm(forward)))
        self._by_click.value = False
        self._focus.value = float(f"{distance:.6g}")
        self._lens_changed()

    # --- parts --------------------------------------------------------------------------------------------------------

    def _picture(self, gui: Any) -> None:
        session, post = self._session, self._page.post
        has = available()
        hint = "Open Image Denoise, at rest" if has else "needs pip install 'destello[denoise]'"
        noise = gui.add_checkbox("Denoise", False, disabled=not has, hint=hint)
        limit = gui.add_number("Samples", session.limit, min=1, max=1 << 20, step=1, hint="a pixel, at rest")

        def denoise() -> None:
            if has:
                session.denoised = bool(noise.value)
                session.redraw()

        def samples() -> None:
            session.limit = max(1, min(int(limit.value), 1 << 20))

        listen(noise, post, denoise)
        listen(limit, post, samples)

    def _camera(self, gui: Any) -> None:
        session, post = self._session, self._page.post
        self._names = gui.add_dropdown("Camera", self._cameras(), initial_value=self._first(), hint="named cameras")
        self._length = gui.add_number(
            "Focal length", round(focal_length(session.view.vfov), 2), min=_SHORTEST, max=_LONGEST, step=0.1,
            hint="mm, on a sensor 24 mm high",
        )  # fmt: skip
        self._aperture = gui.add_number(
            "Aperture radius", session.lens.aperture_radius, min=0.0, hint="m; 0: everything is sharp"
        )
        self._focus = gui.add_number(
            "Focus distance", session.lens.focus_distance, min=0.0, hint="m; 0: on what the camera turns about"
        )
        self._by_click = gui.add_checkbox("Focus by click", False, hint="the next click into the picture")
        listen(self._names, post, self._camera_chosen)
        listen(self._length, post, self._length_changed)
        for handle in (self._aperture, self._focus):
            listen(handle, post, self._lens_changed)

    def _look(self, gui: Any) -> None:
        look = self._session.look
        exposure = gui.add_slider("Exposure", -8.0, 8.0, 0.05, min(8.0, max(-8.0, look.exposure)), hint="stops")
        tone = gui.add_dropdown("Tone curve", tuple(TONES), initial_value=look.tone)
        curve = gui.add_dropdown("Transfer", CURVES, initial_value=look.curve)

        def changed() -> None:
            look = self._session.look.changed(exposure=exposure.value, tone=tone.value, curve=curve.value)
            self._session.look = look
            self._session.redraw()

        for handle in (exposure, tone, curve):
            listen(handle, self._page.post, changed)

    def _time(self, gui: Any) -> None:
        frames = self._scene.frames
        if frames < 2:
            return
        app = self._page.app
        frame = gui.add_slider("Frame", 0, frames - 1, 1, min(app.frame, frames - 1), hint="for all pages")
        listen(frame, self._page.post, lambda: app.show_frame(max(0, min(int(frame.value), frames - 1))))

    # --- what a person sets -------------------------------------------------------------------------------------------

    @property
    def _scene(self) -> Scene:
        return self._page.app.document.scene

    def _cameras(self) -> tuple[str, ...]:
        return (_FREE, *self._scene.cameras)

    def _first(self) -> str:
        return next((name for name in self._scene.cameras if self._is_named(name)), _FREE)

    def _is_named(self, name: str) -> bool:
        camera = self._scene.cameras.get(name)
        return camera is not None and View.of(camera).same_place(self._session.view)

    def _camera_chosen(self) -> None:
        camera = self._scene.at_frame(self._page.app.frame).cameras.get(self._names.value)
        if camera is None:
            return
        view = View.of(camera, self._session.view.width, self._session.view.height)
        if camera.type == "perspective":
            self._aperture.value, self._focus.value = camera["aperture_radius"], camera["focus_distance"]
            self._lens_changed()
        else:
            self._page.tell(
                f"{camera.type} cameras are shown in perspective here; destello render has them as they are"
            )
        self._show(view)

    def _length_changed(self) -> None:
        length = min(_LONGEST, max(_SHORTEST, float(self._length.value)))
        self._show(dataclasses.replace(self._session.view, vfov=field_of_view(length)))

    def _lens_changed(self) -> None:
        self._session.camera.replace(aperture_radius=self._aperture.value, focus_distance=self._focus.value)  # checks
        self._session.lens.aperture_radius = float(self._aperture.value)
        self._session.lens.focus_distance = float(self._focus.value)
        self._session.moved()

    def _show(self, view: View) -> None:
        self._page.look_from(view)
        view.to_page(self._session.client.camera, self._session.frame)
