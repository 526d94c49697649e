"""The panel that saves: downloads of the picture, the scene and the camera, and the final render."""

from __future__ import annotations

import io
import re
import tempfile
import zipfile
from pathlib import Path
from typing import TYPE_CHECKING, Any

from destello.denoise import available
from destello.errors import InputError
from destello.image import Image
from destello.io.native import text_of
from destello.nodes import Node
from destello.progress import Status
from destello.scene import Scene
from destello.viewer.final import FinalRender
from destello.viewer.widgets import clicked

if TYPE_CHECKING:
    from destello.viewer.page import Page

_VIEW = "view"


class SavePanel:
    """Everything is saved by the browser, where its user wants it: a page names no file here."""

    def __init__(self, page: Page, tabs: Any) -> None:
        self._page = page
        self._session = page.session
        self._gui = page.session.client.gui
        self._final: FinalRender | None = None
        self._image: Image | None = None
        with tabs.add_tab("Save"):
            with self._gui.add_folder("This view"):
                self._button("Picture (PNG)", lambda: self._save_picture("png"))
                self._button("Picture (EXR)", lambda: self._save_picture("exr"))
                self._button("Scene", self._save_scene)
                self._button("Camera", self._save_camera)
                self._name = self._gui.add_text("Name", _VIEW, hint="of a camera")
                self._button("Keep as a camera", self._keep_camera, "adds this view to the scene's cameras")
            with self._gui.add_folder("Final render"):
                self._draw_final()

    def refresh(self) -> None:
        """The scene has changed: nothing of it is shown here."""

    def close(self) -> None:
        """The page has gone: its render is not wanted any more."""
        if self._final is not None:
            self._final.cancel()
        self._final = self._image = None

    def _button(self, label: str, action: Any, hint: str | None = None) -> Any:
        button = self._gui.add_button(label, hint=hint)
        clicked(button, self._page.post, action)
        return button

    # --- this view ----------------------------------------------------------------------------------------------------

    @property
    def _stem(self) -> str:
        name = self._page.app.document.scene.name or "scene"
        return re.sub(r"[^\w.-]+", "-", name, flags=re.ASCII).strip(".-")[:60] or "scene"

    def _send(self, name: str, content: bytes) -> None:
        self._session.client.send_file_download(name, content, save_immediately=True)

    def _save_picture(self, kind: str) -> None:
        session = self._session
        film = session.film
        if film is None or film.samples == 0:
            raise InputError("there is no picture yet", expected="a moment's patience")
        metadata = {"scene": self._stem, "spp": film.samples, "device": session.engine.live.device.name}
        layers = {"albedo": film.albedo(), "normal": film.normal()}
        image = Image(session.linear(film), metadata, layers, display=session.look)
        self._send_image(image, self._stem, kind)

    def _send_image(self, image: Image, stem: str, kind: str) -> None:
        buffer = io.BytesIO()
        image.save(buffer, file_format=kind)
        self._send(f"{stem}.{kind}", buffer.getvalue())

    def _save_scene(self) -> None:
        name, content = scene_file(self._page.app.document.scene, self._stem)
        self._send(name, content)

    def _camera(self) -> Node:
        return self._session.camera

    def _save_camera(self) -> None:
        alone = Scene()
        alone.cameras = {_VIEW: self._camera()}
        self._send(f"{self._stem}-camera.yaml", text_of(alone).encode())

    def _keep_camera(self) -> None:
        name, camera = str(self._name.value).strip(), self._camera()
        if not re.fullmatch(r"[\w .-]{1,64}", name):
            raise InputError("not a name", place="camera", value=name, expected="letters, digits, spaces, - . and _")
        self._page.edit(f"camera {name}", lambda scene: scene.cameras.__setitem__(name, camera))
        self._page.tell(f"Camera {name!r} is in the scene now: save the scene to keep it")

    # --- the final render ---------------------------------------------------------------------------------------------

    def _draw_final(self) -> None:
        scene, gui = self._page.app.document.scene, self._gui
        self._spp = gui.add_number("Samples a pixel", scene.render.spp, min=1, max=1 << 20, step=1)
        self._width = gui.add_number("Width", scene.film.width, min=1, max=16384, step=1)
        self._height = gui.add_number("Height", scene.film.height, min=1, max=16384, step=1)
        self._denoise = gui.add_checkbox("Without noise", False, disabled=not available())
        self._start = self._button("Render final", self._render)
        self._cancel = self._button("Cancel", self._cancel_final)
        self._cancel.visible = False
        self._bar = gui.add_progress_bar(0.0, visible=False)
        self._text = gui.add_markdown("")
        self._png = self._button("Final picture (PNG)", lambda: self._save_final("png"))
        self._exr = self._button("Final picture (EXR)", lambda: self._save_final("exr"))
        self._png.visible = self._exr.visible = False

    def _render(self) -> None:
        if self._final is not None and self._final.running:
            return
        app, session = self._page.app, self._session
        if app.final_running:
            raise InputError("another page's final render is running", expected="to wait for its end")
        scene = app.document.scene.copy().at_frame(app.frame)
        scene.cameras[_VIEW] = self._camera()
        look, settings = session.look, scene.render
        settings.iso = settings.exposure_time = settings.f_number = None  # the exposure has them in it
        settings.exposure, settings.tone, settings.curve = look.exposure, look.tone, look.curve
        denoise = bool(self._denoise.value) and available()
        size = (int(self._width.value), int(self._height.value))
        self._final = FinalRender(
            scene, _VIEW, int(self._spp.value), size, session.engine.live.device.name, denoise,
            lambda status: self._page.post(lambda: self._show(status)), self._ended,
        )  # fmt: skip
        app.finals.append(self._final)
        self._running(True)
        self._final.start()

    def _cancel_final(self) -> None:
        if self._final is not None:
            self._final.cancel()
            self._text.content = "Stopping..."

    def _running(self, running: bool) -> None:
        self._start.visible, self._cancel.visible = not running, running
        self._bar.visible = running

    def _show(self, status: Status) -> None:
        self._bar.value = 100.0 * status.fraction
        self._text.content = status.text()

    def _ended(self, image: Image | None, problem: str) -> None:
        self._page.post(lambda: self._finished(image, problem))

    def _finished(self, image: Image | None, problem: str) -> None:
        self._running(False)
        self._image = image or self._image
        if image is None:
            self._text.content = f"It failed: {problem}" if problem else "Cancelled."
            return
        self._text.content = f"Done: {image.metadata['spp']} samples in {image.metadata['seconds']:.1f} s."
        self._png.visible = self._exr.visible = True

    def _save_final(self, kind: str) -> None:
        if self._image is not None:
            self._send_image(self._image, f"{self._stem}-final", kind)


def scene_file(scene: Scene, stem: str) -> tuple[str, bytes]:
    """The scene's file, ready to be downloaded: YAML, or a ZIP of it and the folder with its large arrays.

    Paths in it stay as they are: it belongs beside the file that the scene came from.
    """
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / f"{stem}.yaml"
        copy = scene.copy()
        copy.base_dir = path.parent
        copy.save(path)
        files = sorted(p for p in Path(folder).rglob("*") if p.is_file())
        if len(files) == 1:
            return path.name, path.read_bytes()
        buffer = io.BytesIO()
        with zipfile.ZipFile(buffer, "w", zipfile.ZIP_STORED) as archive:
            for file in files:
                archive.write(file, file.relative_to(folder))
        return f"{stem}.zip", buffer.getvalue()
