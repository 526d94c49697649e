"""Shapes: spheres, meshes, boxes, instances of groups; ``dir()`` lists them, ``help()`` explains them."""

from __future__ import annotations

from destello.factories import Factories, Factory

_factories = Factories("shape", __name__)


def __getattr__(name: str) -> Factory:
    return _factories.get(name)


def __dir__() -> list[str]:
    return _factories.names()
