"""Every error that destello reports to its user.

An `Error` is one line: the file, the place in it, what is wrong, the offending value, and what would be accepted. The
same pieces are attributes, for programs. Errors that were found together travel together in `problems`.
"""

from __future__ import annotations

import difflib
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Self

_LONGEST_VALUE = 80
_MOST_LINES = 20


class Error(Exception):
    """Something that the user can put right.

    Attributes:
        problem: what is wrong, in words.
        file: the file it was found in, or None.
        line: the line of that file (first: 1), or None.
        place: where in the scene, such as ``shapes[3].material.reflectance``, or None.
        value: the offending value, or None.
        expected: what would be accepted, in words, or None.
        problems: all errors found together; just this one if there is one only.
    """

    exit_code = 2

    def __init__(
        self,
        problem: str,
        *,
        file: str | Path | None = None,
        line: int | None = None,
        place: str | None = None,
        value: object = None,
        expected: str | None = None,
    ) -> None:
        super().__init__(problem)
        self.problem = problem
        self.file = None if file is None else str(file)
        self.line = line
        self.place = place
        self.value = value
        self.expected = expected
        self.problems: list[Error] = [self]

    def __str__(self) -> str:
        """The one-line message."""
        more = len(self.problems) - 1
        text = self._line()
        return f"{text} [and {more} more {'problem' if more == 1 else 'problems'}]" if more > 0 else text

    def lines(self) -> list[str]:
        """A line for each of the errors found together, of very many for the first ones."""
        told = [problem._line() for problem in self.problems[:_MOST_LINES]]
        more = len(self.problems) - len(told)
        return [*told, f"and {more} more problems"] if more else told

    def _line(self) -> str:
        where = self.file or ""
        if where and self.line is not None:
            where += f":{self.line}"
        text = ": ".join(part for part in (where, self.place, self.problem) if part)
        if self.value is not None:
            text += f": {describe(self.value)}"
        if self.expected:
            text += f" (accepted: {self.expected})"
        return "".join(c if c.isprintable() else ascii(c)[1:-1] for c in " ".join(text.split()))

    def within(self, place: str | None, *, file: str | Path | None = None) -> Self:
        """Puts the error (and those found with it) inside `place` and, if none is known yet, `file`; returns itself."""
        for problem in self.problems:
            if place:
                problem.place = join_place(place, problem.place)
            if file is not None and problem.file is None:
                problem.file = str(file)
        return self


class InputError(Error):
    """The command line, a call's arguments or an input file are wrong."""


class SceneError(InputError):
    """A scene's content is wrong: an unknown name, a value out of range, a broken mesh."""


class FormatError(InputError):
    """A file cannot be read as what it says it is."""


class MissingFileError(InputError):
    """Files that do not exist or cannot be read: `paths` has all of them."""

    def __init__(
        self,
        paths: Sequence[str | Path],
        *,
        file: str | Path | None = None,
        place: str | None = None,
        expected: str | None = "existing files; --allow-missing renders with a visible stand-in",
        reason: str = "",
    ) -> None:
        self.paths = [str(path) for path in paths]
        problem = "missing file" if len(self.paths) == 1 else f"{len(self.paths)} missing files"
        if reason:
            problem += f" ({reason})"
        super().__init__(f"{problem}: {', '.join(self.paths)}", file=file, place=place, expected=expected)


class DeviceError(Error):
    """The device is unknown, cannot be used, or has too little memory."""


class RenderError(Error):
    """Rendering itself failed."""

    exit_code = 1


class OutputError(Error):
    """An output file cannot be written."""


class ImageTooLarge(Error, MemoryError):
    """An image needs more memory than there is."""


def gather(problems: Iterable[Error]) -> Error | None:
    """The first of several errors, carrying all of them in `problems`; None if there are none."""
    flat = [single for problem in problems for single in problem.problems]
    if not flat:
        return None
    first = flat[0]
    for single in flat[1:]:
        single.problems = [single]
    first.problems = flat
    return first


def did_you_mean(name: object, known: Iterable[str]) -> str:
    """The names that are accepted, the nearest one first if `name` looks like a slip: text for `expected`."""
    names = sorted(known)
    lower = {word.lower(): word for word in names}
    near = [lower[word] for word in difflib.get_close_matches(str(name).lower(), lower, n=1, cutoff=0.6)]
    listed = ", ".join(names[:24]) + (", ..." if len(names) > 24 else "")
    if near:
        return f"did you mean {near[0]!r}? known: {listed}"
    return listed or "nothing"


def describe(value: object) -> str:
    """A value in at most one short line."""
    shape = getattr(value, "shape", None)
    if shape:
        return f"array of shape {tuple(shape)}"
    text = " ".join((value if isinstance(value, Path) else repr(value)).__str__().split())
    return text if len(text) <= _LONGEST_VALUE else text[: _LONGEST_VALUE - 3] + "..."


def join_place(outer: str | None, inner: str | None) -> str:
    """``a`` and ``b`` to ``a.b``, ``a`` and ``[2]`` to ``a[2]``."""
    if not outer or not inner:
        return outer or inner or ""
    return outer + inner if inner.startswith("[") else f"{outer}.{inner}"
