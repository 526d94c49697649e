"""How built-in scenes make themselves known, and what they share."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from destello.nodes import Node
    from destello.scene import Scene

Color = tuple[float, float, float]
Point = tuple[float, float, float]


@dataclass(frozen=True)
class Entry:
    """A built-in scene: one line about it, and the function that makes it."""

    doc: str
    build: Callable[[], Scene]


@dataclass(frozen=True)
class Benchmark:
    """A scene that is there to be measured: one line about it, and the function that makes it with some `detail`."""

    doc: str
    build: Callable[[float], Scene]


REGISTRY: dict[str, Entry] = {}
BENCHMARKS: dict[str, Benchmark] = {}


def scene(name: str, doc: str) -> Callable[[Callable[[], Scene]], Callable[[], Scene]]:
    """Registers the decorated function, which takes nothing and returns a new Scene, under `name`."""

    def register(function: Callable[[], Scene]) -> Callable[[], Scene]:
        REGISTRY[name] = Entry(doc, function)
        return function

    return register


def benchmark(name: str, doc: str) -> Callable[[Callable[[float], Scene]], Callable[[float], Scene]]:
    """Registers the decorated function under `name`. It takes `detail`: the triangles wanted, as a factor (1: all)."""

    def register(function: Callable[[float], Scene]) -> Callable[[float], Scene]:
        BENCHMARKS[name] = Benchmark(doc, function)
        return function

    return register


def blank(name: str, *, size: tuple[int, int], spp: int, max_depth: int, camera: Node, background: Color) -> Scene:
    """A scene without shapes. `size`: width and height in pixels; `background`: the same radiance from everywhere."""
    import destello as dl

    made = dl.Scene(name)
    made.film.width, made.film.height = size
    made.render.spp, made.render.max_depth = spp, max_depth
    made.camera = camera
    if any(background):
        made.environment = dl.environments.constant(radiance=background)
    return made


class Random:
    """Uniform numbers that are the same everywhere and for ever: the bits of PCG-64, which NumPy guarantees."""

    def __init__(self, seed: int) -> None:
        """`seed`: any whole number."""
        from numpy.random import PCG64

        self._bits = PCG64(seed)

    def __call__(self, low: float = 0.0, high: float = 1.0) -> float:
        """A number in [low, high)."""
        bits = int(self._bits.random_raw()) >> 11
        return low + (high - low) * bits * 2.0**-53

    def triple(self, low: float = 0.0, high: float = 1.0) -> tuple[float, float, float]:
        """Three numbers in [low, high)."""
        return self(low, high), self(low, high), self(low, high)
