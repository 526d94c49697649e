"""`Film`: the exact sums of a render together with what was summed, its checkpoint file, and how noisy it still is.

The core's film adds exactly (order-free), so films of different samples of one picture may be added in any order and
grouping: resuming, sharding and merging are the same operation and give the same bits as one uninterrupted render.
"""

from __future__ import annotations

import json
import zipfile
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from destello.color import luminance
from destello.errors import FormatError, InputError, MissingFileError

Span = tuple[int, int]  # sample indices first <= i < last

_FORMAT = 1
_META = "destello"
# Below this part of the picture's mean luminance, a pixel's noise is related to the mean instead of the pixel.
_DARK = 0.1


def add_spans(spans: Iterable[Span]) -> tuple[Span, ...]:
    """The union of spans that do not overlap, sorted, neighbours joined. Raises InputError where two overlap."""
    joined: list[Span] = []
    for first, last in sorted(span for span in spans if span[0] < span[1]):
        if joined and first < joined[-1][1]:
            raise InputError("the same samples twice", value=f"{first}:{min(last, joined[-1][1])}")
        if joined and first == joined[-1][1]:
            joined[-1] = (joined[-1][0], last)
        else:
            joined.append((first, last))
    return tuple(joined)


def subtract_spans(whole: Span, done: Iterable[Span]) -> list[Span]:
    """What of `whole` is not in `done` (sorted, not overlapping), sorted."""
    first, last = whole
    left = []
    for start, end in done:
        if first < start:
            left.append((first, min(start, last)))
        first = max(first, end)
    if first < last:
        left.append((first, last))
    return [span for span in left if span[0] < span[1]]


def count_samples(spans: Iterable[Span]) -> int:
    """How many samples a pixel there are in spans."""
    return sum(last - first for first, last in spans)


def show_spans(spans: Iterable[Span]) -> str:
    """Spans as the command line writes them: `0:64,128:256`."""
    return ",".join(f"{first}:{last}" for first, last in spans)


@dataclass(eq=False)
class Film:
    """Exact sums and what was summed.

    Attributes:
        core: the sums (`destello._core.Film`); None while there are none.
        identity: everything the samples depend on, as plain data: scene, size, crop, camera, seed, depths, filter.
            Films can be added only if these are equal.
        spans: the sample indices that it holds, sorted, not overlapping.
        seconds: render time that went into it.
        rays: rays traced for it.
        nonfinite: samples left out because they were not finite.
        devices: what rendered them (`cpu`, `cuda`): the last bits depend on the kind of device.
    """

    core: Any
    identity: dict[str, Any]
    spans: tuple[Span, ...] = ()
    seconds: float = 0.0
    rays: int = 0
    nonfinite: int = 0
    devices: list[str] = field(default_factory=list)

    @property
    def spp(self) -> int:
        """Samples a pixel."""
        return count_samples(self.spans)

    def add(self, other: Film) -> None:
        """Adds the samples of another film of the same picture. Raises InputError if it is of another, or overlaps."""
        check_identity(other.identity, self.identity)
        spans = add_spans([*self.spans, *other.spans])
        self.core.add(other.core)
        self.spans = spans
        self.seconds += other.seconds
        self.rays += other.rays
        self.nonfinite += other.nonfinite
        self.devices = sorted({*self.devices, *other.devices})

    def relative_error(self) -> float:
        """How noisy the picture still is: see `relative_error`."""
        return relative_error(self.core.mean(), self.core.variance())

    def save(self, path: Path) -> None:
        """Writes a checkpoint, aside and then renamed. Raises OutputError."""
        from destello.image_file import replacing

        meta = {
            "format": _FORMAT,
            "identity": self.identity,
            "spans": [list(span) for span in self.spans],
            "seconds": self.seconds,
            "rays": self.rays,
            "nonfinite": self.nonfinite,
            "devices": self.devices,
        }
        state = {f"state.{name}": np.asarray(value) for name, value in self.core.state().items()}
        with replacing(path) as aside, aside.open("wb") as file:
            arrays: dict[str, Any] = {_META: np.array(json.dumps(meta)), **state}
            np.savez(file, **arrays)

    @classmethod
    def load(cls, path: Path, identity: Mapping[str, Any] | None = None) -> Film:
        """Reads a checkpoint.

        With `identity`, that of the render it is to go on with, the two are compared before any large array is read.
        Raises MissingFileError, FormatError (no checkpoint, or damaged), InputError (of another render).
        """
        from destello import _core

        if not path.is_file():
            raise MissingFileError([path], expected="a film (.film) that destello wrote")
        try:
            with path.open("rb") as file, np.load(file, allow_pickle=False) as arrays:
                meta = json.loads(str(arrays[_META]))
                if meta["format"] != _FORMAT:
                    raise FormatError("film of another version", file=path, value=meta["format"], expected=str(_FORMAT))
                if identity is not None:
                    check_identity(meta["identity"], identity, path)
                state = {n.removeprefix("state."): arrays[n] for n in arrays.files if n.startswith("state.")}
            spans = add_spans((int(first), int(last)) for first, last in meta["spans"])
            return cls(
                _core.Film.from_state(state),
                meta["identity"],
                spans,
                float(meta["seconds"]),
                int(meta["rays"]),
                int(meta["nonfinite"]),
                [str(name) for name in meta["devices"]],
            )
        except (OSError, ValueError, KeyError, TypeError, EOFError, RuntimeError, zipfile.BadZipFile) as error:
            raise FormatError(
                "not a film, or damaged", file=path, expected="a film (.film) that destello wrote"
            ) from error


def check_identity(found: Mapping[str, Any], wanted: Mapping[str, Any], path: Path | None = None) -> None:
    """Raises InputError that names the first thing in which two films' identities differ."""
    wanted = json.loads(json.dumps(wanted))
    found = json.loads(json.dumps(found))
    for name in [*wanted, *(key for key in found if key not in wanted)]:
        if wanted.get(name) != found.get(name):
            raise InputError(
                f"the film belongs to another render: its {name} differs",
                file=path,
                value=found.get(name),
                expected=f"{wanted.get(name)!r}; or another output name, or no --resume",
            )


def relative_error(mean: Any, variance: Any) -> float:
    """The picture's relative standard error, one number for all pixels.

    The root mean square over the pixels of s / max(L, 0.1 M): s is the estimated standard deviation of the pixel's mean
    luminance, L that mean, M the mean luminance of the whole picture (so that nearly black pixels do not decide). It
    falls with the square root of the number of samples. Samples are taken as independent; well-distributed samples are
    better than that, so the true error is at most about this, and usually lower.

    Args:
        mean: (height, width, 3) linear RGB.
        variance: (height, width), of the mean's luminance: already divided by the number of samples.

    Returns: 0 or more; 0.01 is one per cent. Infinite while nothing can be said (a black picture counts as 0).
    """
    level = np.abs(luminance(mean)).astype(np.float64)
    spread = np.asarray(variance, dtype=np.float64)
    good = np.isfinite(level) & np.isfinite(spread)
    if not good.any():
        return float("inf")
    level, spread = level[good], np.maximum(spread[good], 0.0)
    floor = _DARK * float(level.mean())
    if floor == 0.0:
        return 0.0
    return float(np.sqrt(np.mean(spread / np.maximum(level, floor) ** 2)))
