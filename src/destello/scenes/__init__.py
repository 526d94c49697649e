"""The built-in scenes: short Python programs, one function each.

>>> import destello as dl
>>> dl.render(dl.scenes.build("book1"), spp=64)

They are those of Peter Shirley's *Ray Tracing in One Weekend* books (with Trevor David Black and Steve Hollasch), with
the books' numbers, and the one that destello began with. A new scene is one function with ``@scene(name, doc)`` in one
of the modules below. Apart from them stand the scenes of `destello bench`, with ``@benchmark(name, doc)``.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING

from destello.scenes.registry import BENCHMARKS, REGISTRY

if TYPE_CHECKING:
    from destello.scene import Scene

# In the order in which the scenes are listed.
_MODULES = ("origin", "book1", "book2", "cornell", "book2_final", "book3", "volumes")
_BENCH_MODULES = ("benchmarks", "interior")


def _load(modules: tuple[str, ...] = _MODULES) -> None:
    for module in modules:
        import_module(f"{__name__}.{module}")


def names() -> list[str]:
    """The names of all built-in scenes but those for benchmarks."""
    _load()
    return list(REGISTRY)


def describe() -> dict[str, str]:
    """One line about each built-in scene, by name, but those for benchmarks."""
    _load()
    return {name: entry.doc for name, entry in REGISTRY.items()}


def describe_benchmarks() -> dict[str, str]:
    """One line about each scene that is there for benchmarks only, by name."""
    _load(_BENCH_MODULES)
    return {name: entry.doc for name, entry in BENCHMARKS.items()}


def build(name: str, detail: float = 1.0) -> Scene:
    """The built-in scene called `name`: a new one each time, always the same.

    Args:
        name: one of `names` or `describe_benchmarks`.
        detail: of scenes for benchmarks, how many triangles they get, as a factor above 0, up to 16; 1: as many as they
            say. Other scenes have no such choice and ignore it.

    Raises InputError, with the nearest name, if there is none.
    """
    from destello.errors import InputError, did_you_mean

    if not 0 < detail <= 16:
        raise InputError("out of range", place="detail", value=detail, expected="a number above 0, up to 16")
    _load()
    if name in REGISTRY:
        return REGISTRY[name].build()
    known = describe_benchmarks()
    if name not in known:
        everything = [*REGISTRY, *known]
        raise InputError("no built-in scene of this name", value=name, expected=did_you_mean(name, everything))
    return BENCHMARKS[name].build(detail)
