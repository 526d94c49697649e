"""The render thread: the one place where the scene is edited, rendered and sent, for all pages in turn."""

from __future__ import annotations

import queue
import threading
import time
import traceback
from collections.abc import Callable
from concurrent.futures import Future
from typing import Any

from destello.errors import Error
from destello.scene import Scene
from destello.viewer.document import Change, Document
from destello.viewer.engine import Engine
from destello.viewer.final import FinalRender
from destello.viewer.session import Session

Task = Callable[[], None]

_POLL = 0.1  # seconds between looks at whether Python has edited the scene
_MOST_WAITING = 10_000  # tasks: pages that send more are not listened to until some are done


class App:
    """What all pages share.

    Attributes:
        document: the scene. engine: renders it.
        frame: of an animated scene, the one that is shown.
        sessions: the pages, by viser's number of the client.
        finals: renders of full quality that are under way.
        on_change: called in the render thread after each change of the scene.
    """

    def __init__(self, scene: Scene, device: str, threads: int = 0) -> None:
        """Compiles the scene. Raises what `Scene.compile` raises, and DeviceError."""
        self.document = Document(scene)
        self.engine = Engine.of(scene, device, threads)
        self.frame = 0
        self.sessions: dict[int, Session] = {}
        self.on_change: list[Task] = []
        self.finals: list[FinalRender] = []
        self._tasks: queue.Queue[Task] = queue.Queue(_MOST_WAITING)
        self._wake = threading.Event()
        self._stopping = False
        self._shown = 0
        self._thread = threading.Thread(target=self._run, name="destello-view", daemon=True)

    def start(self) -> None:
        """Begins to render."""
        self._thread.start()

    def stop(self, seconds: float) -> bool:
        """Ends the thread, within that time; returns whether it has ended, and no final render goes on."""
        self._stopping = True
        for final in self.finals:
            final.cancel()
        self.engine.give_way()
        self._wake.set()
        self._thread.join(seconds)
        return not self.running and not self.final_running

    @property
    def running(self) -> bool:
        """Whether the thread is at work."""
        return self._thread.is_alive()

    def post(self, task: Task) -> bool:
        """Has something done in the render thread, soon: a pass that refines a picture is broken off for it.

        Returns whether it will be done: tasks of a page that floods are dropped.
        """
        try:
            self._tasks.put_nowait(task)
        except queue.Full:
            return False
        self.engine.give_way()
        self._wake.set()
        return True

    @property
    def final_running(self) -> bool:
        """Whether a final render is under way: pages do not refine their pictures then."""
        self.finals = [final for final in self.finals if final.running]
        return bool(self.finals)

    def call(self, task: Callable[[], Any], seconds: float = 30.0) -> Any:
        """Does something in the render thread and waits for what it returns. Raises what it raises, or TimeoutError."""
        future: Future[Any] = Future()

        def run() -> None:
            try:
                future.set_result(task())
            except BaseException as error:
                future.set_exception(error)

        self.post(run)
        return future.result(seconds)

    def edit(self, label: str, change: Change, merge: object = None) -> None:
        """Changes the scene, with undo, and shows it. If it cannot be shown, nothing has changed: raises SceneError."""
        self.document.edit(label, change, self._update, merge)
        self._noted()

    def undo(self) -> str | None:
        """Takes the last change back; returns what it was."""
        label = self.document.undo()
        self._show()
        return label

    def redo(self) -> str | None:
        """Does it again."""
        label = self.document.redo()
        self._show()
        return label

    def show_frame(self, frame: int) -> None:
        """Shows another frame of the animation."""
        if frame != self.frame:
            self.engine.live.set_frame(frame)
            self.frame = frame
            self._noted()

    # --- the thread ---------------------------------------------------------------------------------------------------

    def _run(self) -> None:
        looked = 0.0
        turn = 0
        while not self._stopping:
            self._wake.clear()
            self._do_tasks()
            if time.monotonic() - looked > _POLL:
                looked = time.monotonic()
                self._guard(self._poll)
            paused = self.final_running
            waiting = [s for s in self.sessions.values() if (s.urgent if paused else s.busy)]
            if not waiting:
                self._wake.wait(_POLL)
                continue
            turn += 1
            self._guard(waiting[turn % len(waiting)].step)

    def _do_tasks(self) -> None:
        while not self._stopping:
            try:
                task = self._tasks.get_nowait()
            except queue.Empty:
                return
            self._guard(task)

    def _guard(self, task: Task) -> None:
        """Whatever goes wrong for one page, the others go on."""
        try:
            task()
        except Exception:
            traceback.print_exc()
            time.sleep(0.05)  # what fails in each turn shall not keep a core busy

    def _poll(self) -> None:
        if self.document.poll():
            try:
                self._show()
            except Error as error:
                self.tell(str(error))

    def _show(self) -> None:
        """Brings the device up to date with the scene, whoever changed it."""
        if self._shown != self.document.revision:
            self._shown = self.document.revision
            with self.document.lock:
                self._update(self.document.scene)
            self._noted()

    def _update(self, scene: Scene) -> None:
        self.engine.live.update(scene, frame=self.frame)

    def _noted(self) -> None:
        self._shown = self.document.revision
        for session in self.sessions.values():
            session.moved()
        for heard in list(self.on_change):
            heard()

    def tell(self, text: str) -> None:
        """Says something on all pages."""
        for session in self.sessions.values():
            if not session.closed:
                session.client.add_notification("destello", text, auto_close_seconds=8.0)
