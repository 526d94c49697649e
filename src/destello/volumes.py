"""Volumes: what varies a medium from place to place. Clouds, smoke, fire.

``dir()`` lists the types, ``help()`` explains them; `box` makes a shape that holds one.
"""

from __future__ import annotations

from typing import Any

from destello.errors import SceneError
from destello.factories import Factories
from destello.nodes import Node

_factories = Factories("volume", __name__)


def box(volume: Node, *, name: str | None = None, **medium: Any) -> Node:
    """The box of a `grid` as a shape with an invisible boundary, filled by a medium that the grid varies.

    Args:
        volume: the grid.
        name: label for people and scene files.
        **medium: of the medium: medium_density (collisions per metre where the grid's density is 1), medium_albedo,
            medium_absorption, medium_anisotropy, priority; as for `materials.interface`.

    Raises:
        SceneError: if a value is not accepted.
    """
    if volume.kind != "volume":
        raise SceneError("not a volume", place="volume", value=volume.kind, expected="a volume")
    material = Node("material", "interface", {**medium, "medium_volume": volume})
    place = {"min": volume["min"], "max": volume["max"], "transform": volume["transform"], "material": material}
    return Node("shape", "box", place, name=name)


__getattr__ = _factories.get
__dir__ = _factories.names
