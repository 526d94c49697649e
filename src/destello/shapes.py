"""Shapes: spheres, meshes, boxes, instances of groups; ``dir()`` lists them, ``help()`` explains them."""

from __future__ import annotations

from destello.factories import Factories

_factories = Factories("shape", __name__)

__getattr__ = _factories.get
__dir__ = _factories.names
