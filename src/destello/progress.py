"""How a render tells how far it is: a bar on a terminal, a line in a notebook, or a function of the caller's."""

from __future__ import annotations

import contextlib
import html
import sys
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, fields
from functools import partial
from importlib import import_module
from typing import Any, Protocol, TextIO

# Short renders show nothing: a bar appears after this many seconds.
_PATIENCE = 2.0


@dataclass(frozen=True, slots=True)
class Status:
    """Where a render is.

    Attributes:
        done: samples a pixel so far, those of a resumed film included.
        total: samples a pixel wanted, or None if it goes on until time or error say stop.
        seconds: since this render began.
        eta: estimated seconds to the end, or None if unknown.
        samples_per_second, rays_per_second: of this render, over its wall time.
        error: relative standard error (`destello.film.relative_error`), where it is being watched, else None.
        finished: True in the last report.
    """

    done: int
    total: int | None
    seconds: float
    eta: float | None
    samples_per_second: float
    rays_per_second: float
    error: float | None = None
    finished: bool = False

    @property
    def fraction(self) -> float:
        """How much is done, in [0, 1]."""
        if self.finished:
            return 1.0
        by_time = (
            self.seconds / (self.seconds + self.eta) if self.eta is not None and self.seconds + self.eta > 0 else 0
        )
        by_samples = self.done / self.total if self.total else 0.0
        return min(1.0, max(by_time, by_samples))

    def text(self) -> str:
        """One line: samples, time left, rates."""
        words = [f"{self.done}/{self.total} spp" if self.total else f"{self.done} spp"]
        if self.error is not None:
            words.append(f"error {self.error:.2%}")
        if self.eta is not None and not self.finished:
            words.append(f"{duration(self.eta)} left")
        words += [f"{self.samples_per_second / 1e6:.3g} Msamples/s", f"{self.rays_per_second / 1e6:.3g} Mrays/s"]
        return ", ".join(words)


@dataclass(frozen=True, slots=True)
class FrameStatus(Status):
    """Where a render of several frames is: `seconds` and `eta` are those of all of them.

    Attributes:
        frame: the number of the frame that is rendered.
        before, frames: how many frames are done, and how many there are.
        part: how much of this frame is done, in [0, 1].
    """

    frame: int = 0
    before: int = 0
    frames: int = 1
    part: float = 0.0

    @property
    def fraction(self) -> float:
        """How much of all frames is done, in [0, 1]."""
        return min(1.0, (self.before + self.part) / self.frames)

    def text(self) -> str:
        """One line: the frame, its samples, the time left for all, rates."""
        return f"frame {self.frame} ({self.before + 1} of {self.frames}), {Status.text(self)}"


class Progress(Protocol):
    """What is told after every pass, and a last time, with `finished`, at the end. Any function of a Status is one."""

    def __call__(self, status: Status, /) -> None:
        """Called from the thread that called `render`."""


def each_frame(shown: Progress, frames: Sequence[int]) -> Iterator[tuple[int, Progress]]:
    """Every frame with the Progress to give to its render; all reports go to `shown`, as `FrameStatus`."""
    began = time.monotonic()

    def report(before: int, status: Status) -> None:
        seconds, done = time.monotonic() - began, (before + status.fraction) / len(frames)
        values: dict[str, Any] = {field.name: getattr(status, field.name) for field in fields(status)}
        values["seconds"], values["eta"] = seconds, seconds / done - seconds if done > 0 else None
        values["finished"] = status.finished and before + 1 == len(frames)
        own = FrameStatus(**values, frame=frames[before], before=before, frames=len(frames), part=status.fraction)
        shown(own)

    for before, frame in enumerate(frames):
        yield frame, partial(report, before)


def duration(seconds: float) -> str:
    """5 s, 2:05, 1:02:05."""
    whole = max(0, round(seconds))
    if whole < 60:
        return f"{whole} s"
    minutes, rest = divmod(whole, 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours}:{minutes:02d}:{rest:02d}" if hours else f"{minutes}:{rest:02d}"


@contextlib.contextmanager
def showing(progress: Progress | bool | str | None = "auto") -> Iterator[Progress]:
    """The Progress to report to, shown while the context lasts.

    `auto` chooses: in a notebook a line that changes, on a terminal a bar on standard error, else nothing; True is the
    same but prints a line now and then where there is no terminal; False and None are quiet; a function is called.
    """
    if callable(progress):
        yield progress
    elif not progress:
        yield _quiet
    elif _in_notebook():
        yield _Notebook()
    elif sys.stderr.isatty():
        with _Bar(sys.stderr) as bar:
            yield bar
    else:
        yield _Lines(sys.stderr) if progress is True else _quiet


def _quiet(status: Status, /) -> None:
    """Shows nothing."""


def _worth_showing(status: Status) -> bool:
    """Not for renders that will be over in two seconds."""
    return status.seconds >= _PATIENCE or (status.seconds > 0.3 and (status.eta or 0.0) > 2 * _PATIENCE)


def interactive() -> bool:
    """Whether a person types at Python: in a notebook, or at its prompt."""
    return hasattr(sys, "ps1") or _in_notebook()


def _in_notebook() -> bool:
    """Whether this is a Jupyter kernel. Asks only an IPython that is already loaded."""
    ipython = sys.modules.get("IPython")
    shell = ipython.get_ipython() if ipython is not None else None
    return type(shell).__name__ == "ZMQInteractiveShell"


class _Bar:
    """A bar with rich on a terminal; it vanishes at the end."""

    def __init__(self, stream: TextIO) -> None:
        self._stream = stream
        self._shown: Any = None
        self._task: Any = None

    def __enter__(self) -> _Bar:
        return self

    def __exit__(self, *_: object) -> None:
        if self._shown is not None:
            self._shown.stop()

    def __call__(self, status: Status, /) -> None:
        if self._shown is None:
            if status.finished or not _worth_showing(status):
                return
            self._start()
        self._shown.update(self._task, completed=status.fraction, text=status.text())

    def _start(self) -> None:
        from rich.console import Console
        from rich.progress import BarColumn, TextColumn, TimeElapsedColumn
        from rich.progress import Progress as RichProgress

        self._shown = RichProgress(
            BarColumn(bar_width=28),
            TextColumn("{task.percentage:>3.0f}%"),
            TextColumn("{task.fields[text]}"),
            TimeElapsedColumn(),
            console=Console(file=self._stream),
            transient=True,
            refresh_per_second=5,
        )
        self._shown.start()
        self._task = self._shown.add_task("render", total=1.0, text="")


class _Notebook:
    """A line below the cell that changes while the render goes on."""

    def __init__(self) -> None:
        self._handle: Any = None
        self._last = 0.0

    def __call__(self, status: Status, /) -> None:
        if self._handle is None and (status.finished or not _worth_showing(status)):
            return
        now = time.monotonic()
        if not status.finished and now - self._last < 0.25:
            return
        self._last = now
        ipython = import_module("IPython.display")
        line = f'<progress value="{status.fraction:.4f}" max="1"></progress> {html.escape(status.text())}'
        if self._handle is None:
            self._handle = ipython.display(ipython.HTML(line), display_id=True)
        else:
            self._handle.update(ipython.HTML(line))


class _Lines:
    """A line every ten seconds, for logs."""

    def __init__(self, stream: TextIO, every: float = 10.0) -> None:
        self._stream = stream
        self._every = every
        self._next = every

    def __call__(self, status: Status, /) -> None:
        if status.seconds >= self._next and not status.finished:
            self._next = status.seconds + self._every
            print(f"{status.fraction:4.0%}  {status.text()}", file=self._stream, flush=True)
