"""Who may do what with a live scene at a time: one pass or one edit, and questions beside passes."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from destello.live_film import LiveFilm


class Turns:
    """Lets threads in. Edits cancel the pass that runs and go before passes and questions that wait.

    Attributes:
        running: the film that is being rendered, or None.
    """

    def __init__(self) -> None:
        self.running: LiveFilm | None = None
        self._gate = threading.Condition()
        self._edits_waiting = 0
        self._readers = 0
        self._occupied = False

    @contextmanager
    def editing(self) -> Iterator[None]:
        """The scene alone."""
        with self._gate:
            self._edits_waiting += 1
            if self.running is not None:
                self.running.cancel()
            while self._occupied or self._readers:
                self._gate.wait()
            self._occupied = True
        try:
            yield
        finally:
            with self._gate:
                self._occupied = False
                self._edits_waiting -= 1
                self._gate.notify_all()

    @contextmanager
    def rendering(self, film: LiveFilm) -> Iterator[None]:
        """The device alone; the scene does not change."""
        with self._gate:
            while self._occupied or self._edits_waiting:
                self._gate.wait()
            self._occupied, self.running = True, film
        try:
            yield
        finally:
            with self._gate:
                self._occupied, self.running = False, None
                self._gate.notify_all()

    @contextmanager
    def reading(self) -> Iterator[None]:
        """The scene does not change."""
        with self._gate:
            while self._edits_waiting:
                self._gate.wait()
            self._readers += 1
        try:
            yield
        finally:
            with self._gate:
                self._readers -= 1
                self._gate.notify_all()
