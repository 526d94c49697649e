"""The built-in scenes: short Python programs, one function each.

>>> import destello as dl
>>> dl.render(dl.scenes.build("book1"), spp=64)

They are those of Peter Shirley's *Ray Tracing in One Weekend* books (with Trevor David Black and Steve Hollasch), with
the books' numbers, and the one that destello began with. A new scene is one function with ``@scene(name, doc)`` in one
of the modules below.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING

from destello.scenes.registry import REGISTRY

if TYPE_CHECKING:
    from destello.scene import Scene

# In the order in which the scenes are listed.
_MODULES = ("origin", "book1", "book2", "cornell", "book2_final", "book3")


def _load() -> None:
    for module in _MODULES:
        import_module(f"{__name__}.{module}")


def names() -> list[str]:
    """The names of all built-in scenes."""
    _load()
    return list(REGISTRY)


def describe() -> dict[str, str]:
    """One line about each built-in scene, by name."""
    _load()
    return {name: entry.doc for name, entry in REGISTRY.items()}


def build(name: str) -> Scene:
    """The built-in scene called `name`: a new one each time, always the same.

    Raises InputError, with the nearest name, if there is none.
    """
    _load()
    if name not in REGISTRY:
        from destello.errors import InputError, did_you_mean

        raise InputError("no built-in scene of this name", value=name, expected=did_you_mean(name, REGISTRY))
    return REGISTRY[name].build()
