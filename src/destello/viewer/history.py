"""Undo and redo."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Generic, TypeVar

State = TypeVar("State")

_LONGEST = 200  # steps


@dataclass
class History(Generic[State]):
    """Steps that can be taken back. A state is whatever is put back: here, a scene, whose nodes never change.

    Steps with the same `merge` key that follow each other are one: a slider that is dragged is one step, not a hundred.
    """

    _past: list[tuple[str, State]] = field(default_factory=list)
    _future: list[tuple[str, State]] = field(default_factory=list)
    _merge: object = None

    def record(self, label: str, before: State, merge: object = None) -> None:
        """Something is about to change what was `before`. What was undone cannot be redone any more."""
        self._future.clear()
        if merge is None or merge != self._merge:
            self._past.append((label, before))
            del self._past[:-_LONGEST]
        self._merge = merge

    def seal(self) -> None:
        """The next step is one of its own, whatever its key: the slider was let go."""
        self._merge = None

    def undo(self, now: State) -> State | None:
        """What to put back in the place of `now`, or None if nothing was done."""
        return self._turn(self._past, self._future, now)

    def redo(self, now: State) -> State | None:
        """What to put back in the place of `now`, or None if nothing was undone."""
        return self._turn(self._future, self._past, now)

    def _turn(self, source: list[tuple[str, State]], other: list[tuple[str, State]], now: State) -> State | None:
        self._merge = None
        if not source:
            return None
        label, state = source.pop()
        other.append((label, now))
        return state

    @property
    def can_undo(self) -> str | None:
        """What would be undone, in words; None: nothing."""
        return self._past[-1][0] if self._past else None

    @property
    def can_redo(self) -> str | None:
        """What would be redone, in words; None: nothing."""
        return self._future[-1][0] if self._future else None
