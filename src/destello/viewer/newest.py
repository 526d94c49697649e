"""The newest of a stream of values, handed from one thread to another."""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import Generic, TypeVar

Value = TypeVar("Value")


class Newest(Generic[Value]):
    """Holds one value, the last that was put: a slow taker skips what has been overtaken, and never misses the last."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._value: Value | None = None

    def put(self, value: Value) -> bool:
        """Leaves a value; returns whether there was none: then somebody must be told to `take` it."""
        with self._lock:
            was_empty = self._value is None
            self._value = value
            return was_empty

    def hand(self, value: Value, tell: Callable[[], bool]) -> None:
        """Leaves a value, and calls `tell` if there was none; if that returns False nobody comes, and it is dropped."""
        if self.put(value) and not tell():
            self.take()

    def take(self) -> Value | None:
        """The value, which is gone then; None if there is none."""
        with self._lock:
            value, self._value = self._value, None
            return value
