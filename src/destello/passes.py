"""The loop of a render: short passes into a film of their own, each added to the picture's film when it is whole.

Between passes the loop reports, rewrites the preview, saves the film and looks whether to stop. The film adds exactly,
so the bits of the picture depend neither on how long the passes are nor on where a render was interrupted.
"""

from __future__ import annotations

import signal
import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from concurrent.futures import TimeoutError as FutureTimeout
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from typing import Any

from destello.errors import RenderError
from destello.film import Film, Span, add_spans, count_samples, relative_error, subtract_spans
from destello.job import Job
from destello.progress import Progress, Status

# Seconds a pass should take, how many times what it costs besides rendering (a film of 72 bytes a pixel is cleared and
# added), but no longer than this; and by how much the next pass may be longer than the last.
_PASS_SECONDS = {"cpu": 0.2, "cuda": 0.5}
_OVERHEADS = 20.0
_LONGEST = 2.0
_GROWTH = {"cpu": 4, "cuda": 16}


def error_checks(first: int = 16) -> Iterator[int]:
    """The numbers of samples at which the error is looked at: fixed, so that where a render stops is reproducible."""
    count = first
    while True:
        yield count
        count += max(4, count // 4)


@dataclass
class Pacer:
    """Chooses how many samples the next pass takes."""

    kind: str
    seconds_per_sample: float = 0.0
    last: int = 0
    _target: float = 0.0

    def next(self) -> int:
        """Samples a pixel, at least 1."""
        if self.last == 0:
            return 1 if self.kind == "cpu" else 4
        wanted = self._target / self.seconds_per_sample if self.seconds_per_sample > 0 else float("inf")
        return max(1, int(min(wanted, self.last * _GROWTH[self.kind])))

    def took(self, samples: int, seconds: float, rendering: float) -> None:
        """Learns from a pass: how long it was, and how much of that was rendering."""
        self.last = samples
        self.seconds_per_sample = seconds / samples
        overhead = max(0.0, seconds - rendering)
        self._target = min(_LONGEST, max(_PASS_SECONDS[self.kind], _OVERHEADS * overhead))


class Interrupt:
    """Ctrl-C as a wish: while active, the first one sets `wanted` and calls `cancel`; the second one works as ever.

    Does nothing outside the main thread, and leaves a program's own signal handler in place.
    """

    def __init__(self, cancel: Callable[[], None]) -> None:
        self.wanted = False
        self._cancel = cancel

    def ask(self, *_: object) -> None:
        """Asks the render to stop."""
        if self.wanted:
            raise KeyboardInterrupt
        self.wanted = True
        self._cancel()

    @contextmanager
    def active(self) -> Iterator[None]:
        """Catches SIGINT while the context lasts."""
        ours = (
            threading.current_thread() is threading.main_thread()
            and signal.getsignal(signal.SIGINT) is signal.default_int_handler
        )
        if ours:
            signal.signal(signal.SIGINT, self.ask)
        try:
            yield
        finally:
            if ours:
                signal.signal(signal.SIGINT, signal.default_int_handler)


@dataclass
class Loop:
    """One render.

    Attributes:
        job: what to render.
        core: `destello._core`, which makes films.
        renderer: `destello._core.Renderer`.
        camera: the camera's index in the core's scene.
        film: where finished passes are added; it may hold samples already.
        progress: told after every pass.
        after_pass: called after every pass with the film and the seconds since the start (preview, checkpoint).
        stopped_by: afterwards: `samples` (all rendered), `time`, `error` or `interrupt`.
    """

    job: Job
    core: Any
    renderer: Any
    camera: int
    film: Film
    progress: Progress
    after_pass: Callable[[Film, float], None]
    stopped_by: str = ""
    error: float | None = None
    seconds: float = 0.0
    _new_samples: int = 0
    _new_rays: int = 0
    _start: float = 0.0
    _pacer: Pacer = field(init=False)

    def __post_init__(self) -> None:
        self._pacer = Pacer(self.job.device.kind)
        self._checks = error_checks()
        self._next_check = next(self._checks)
        self._interrupt = Interrupt(self.renderer.cancel)

    def run(self) -> None:
        """Renders until samples, time, error or the user say stop.

        Raises RenderError, and what `after_pass` raises; the film then holds the passes that were whole.
        """
        self._start = time.monotonic()
        with self._interrupt.active(), ThreadPoolExecutor(1, thread_name_prefix="destello-render") as worker:
            self._pass_check()
            while (span := self._next_span()) is not None:
                began = time.monotonic()
                scratch, counts = self._render(worker, span)
                if counts is None or counts.get("cancelled") or self._interrupt.wanted:
                    self.stopped_by = "interrupt"
                    break
                self._absorb(scratch, span, counts)
                self._pacer.took(span[1] - span[0], time.monotonic() - began, float(counts["seconds"]))
                self._pass_check()
                self.seconds = time.monotonic() - self._start
                self.after_pass(self.film, self.seconds)
                self._report()
            self.seconds = time.monotonic() - self._start
            self._report(finished=True)

    def _next_span(self) -> Span | None:
        """The samples of the next pass, or None, with `stopped_by` set."""
        job = self.job
        todo = subtract_spans(job.span, self.film.spans)
        if not todo or self._interrupt.wanted:
            self.stopped_by = "interrupt" if todo else "samples"
            return None
        if job.target_error is not None and self.error is not None and self.error <= job.target_error:
            self.stopped_by = "error"
            return None
        first, last = todo[0]
        count = min(last - first, self._pacer.next())
        if job.target_error is not None:
            count = min(count, self._next_check - self.film.spp)
        if job.time is not None and self._pacer.last:
            left = job.time - (time.monotonic() - self._start)
            count = min(count, int(left / max(self._pacer.seconds_per_sample, 1e-9)))
        if count < 1:
            self.stopped_by = "time"
            return None
        return first, first + count

    def _render(self, worker: ThreadPoolExecutor, span: Span) -> tuple[Any, dict[str, Any] | None]:
        """Renders a span into a new film, off this thread so that this one hears Ctrl-C."""
        job = self.job
        try:
            scratch = self.core.Film(job.width, job.height, aovs=job.features)
            future: Future[dict[str, Any]] = worker.submit(
                self.renderer.render, scratch, self.camera, span[0], span[1], job.settings, crop=job.crop
            )
            return scratch, self._wait(future)
        except MemoryError as error:
            raise RenderError(f"out of memory: {error}".rstrip(": ")) from error
        except (RuntimeError, ValueError, TypeError) as error:
            raise RenderError(f"rendering failed: {error}") from error

    def _wait(self, future: Future[dict[str, Any]]) -> dict[str, Any] | None:
        """The result, or None if Ctrl-C came through a program's own signal handler."""
        try:
            while True:
                with suppress(FutureTimeout):
                    return future.result(timeout=0.02 if self._interrupt.wanted else 0.5)
                if self._interrupt.wanted:
                    self.renderer.cancel()  # again: the first call is lost if the pass had not quite begun
        except KeyboardInterrupt:
            if self._interrupt.wanted:
                raise  # the second one
            self._interrupt.ask()
            future.result()
            return None

    def _absorb(self, scratch: Any, span: Span, counts: dict[str, Any]) -> None:
        film = self.film
        spans = add_spans([*film.spans, span])
        if film.spans:
            film.core.add(scratch)
        else:
            film.core = scratch
        film.spans = spans
        film.rays += int(counts["rays"])
        film.nonfinite += int(counts["nonfinite"])
        film.devices = sorted({*film.devices, self.job.device.kind})
        self._new_samples += span[1] - span[0]
        self._new_rays += int(counts["rays"])

    def _pass_check(self) -> None:
        """Looks at the error when its turn has come."""
        if self.job.target_error is None or self.film.spp < self._next_check:
            return
        while self._next_check <= self.film.spp:
            self._next_check = next(self._checks)
        x0, y0, x1, y1 = self.job.crop
        core = self.film.core
        self.error = relative_error(core.mean()[y0:y1, x0:x1], core.variance()[y0:y1, x0:x1])

    def _report(self, *, finished: bool = False) -> None:
        elapsed = max(self.seconds, 1e-9)
        job = self.job
        self.progress(
            Status(
                done=self.film.spp,
                total=None if job.open_ended else self.film.spp + self._left(),
                seconds=self.seconds,
                eta=0.0 if finished else self._eta(),
                samples_per_second=self._new_samples * job.pixels / elapsed,
                rays_per_second=self._new_rays / elapsed,
                error=self.error,
                finished=finished,
            )
        )

    def _left(self) -> int:
        return count_samples(subtract_spans(self.job.span, self.film.spans))

    def _eta(self) -> float | None:
        """Seconds to the end that comes first."""
        job = self.job
        ends = []
        per_sample = self.seconds / self._new_samples if self._new_samples else None
        if not job.open_ended and per_sample is not None:
            ends.append(self._left() * per_sample)
        if job.time is not None:
            ends.append(max(0.0, job.time - self.seconds))
        if job.target_error is not None and self.error is not None and per_sample is not None:
            wanted = self.film.spp * (self.error / job.target_error) ** 2
            ends.append(max(0.0, wanted - self.film.spp) * per_sample)
        return min(ends) if ends else None

    @property
    def new_samples(self) -> int:
        """Samples a pixel that this render added."""
        return self._new_samples

    @property
    def new_rays(self) -> int:
        """Rays that this render traced."""
        return self._new_rays
