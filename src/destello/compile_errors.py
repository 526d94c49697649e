"""What the core refuses, as errors for people."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from destello.errors import RenderError, SceneError


@contextmanager
def core_errors(place: str) -> Iterator[None]:
    """Turns what the core refuses into a SceneError at `place`."""
    try:
        yield
    except (ValueError, IndexError, OverflowError, TypeError) as error:
        raise SceneError(str(error) or type(error).__name__, place=place) from error
    except RuntimeError as error:  # a device that the trees were to be built on
        raise RenderError(str(error), place=place) from error
    except MemoryError as error:
        raise RenderError("not enough memory for the scene", place=place, expected="a smaller scene") from error
