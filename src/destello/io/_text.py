"""Numbers out of text files: lists of lines to arrays, with the line at fault when a word is no number."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from itertools import chain

import numpy as np
from numpy.typing import NDArray

_CHUNK = 65536  # lines taken apart at a time: bounds the memory that the words take


def number_rows(
    lines: Sequence[bytes], fail: Callable[[int, bytes], Exception]
) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """All numbers of `lines`, one after the other, and how many there are on each line.

    `fail(i, word)` makes the exception for a `word` on ``lines[i]`` that is no number. "nan" and "inf" are numbers.
    """
    numbers, counts = [np.zeros(0)], [np.zeros(0, np.int64)]
    for start in range(0, len(lines), _CHUNK):
        rows = [line.split() for line in lines[start : start + _CHUNK]]
        try:
            numbers.append(np.fromiter(map(float, chain.from_iterable(rows)), np.float64))
        except ValueError:
            raise _first_failure(rows, start, fail) from None
        counts.append(np.fromiter(map(len, rows), np.int64, len(rows)))
    return np.concatenate(numbers), np.concatenate(counts)


def _first_failure(rows: Sequence[Sequence[bytes]], start: int, fail: Callable[[int, bytes], Exception]) -> Exception:
    for i, row in enumerate(rows):
        for word in row:
            try:
                float(word)
            except ValueError:
                return fail(start + i, word)
    raise AssertionError("every word is a number")


def numbered_lines(data: bytes) -> Iterator[tuple[int, bytes]]:
    """(line number from 1, line) of a text; a backslash at the end of a line joins it with the next one."""
    lines = data.split(b"\n")
    if b"\\\n" not in data and b"\\\r\n" not in data:
        yield from enumerate(lines, 1)
        return
    joined, first = b"", 0
    for number, line in enumerate(lines, 1):
        if not joined:
            first = number
        line = joined + line.rstrip()
        joined = line[:-1] + b" " if line.endswith(b"\\") and number < len(lines) else b""
        if not joined:
            yield first, line


def printable(word: bytes) -> str:
    """A word of a file as text: UTF-8, what is not is shown as U+FFFD."""
    return word.decode("utf-8", "replace")


def unquoted(name: str) -> str:
    """A file's name without the quotation marks that some programs put around it."""
    return name[1:-1] if len(name) > 2 and name[0] == name[-1] == '"' else name
