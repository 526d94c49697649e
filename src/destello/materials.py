"""Materials: what surfaces and volumes are made of.

One function for each type that the core declares: ``dir()`` lists them, ``help()`` explains them.
"""

from __future__ import annotations

from typing import Any

from destello.factories import Factories
from destello.nodes import Node

_factories = Factories("material", __name__)


def metal(metal: str, *, name: str | None = None, **params: Any) -> Node:
    """A `conductor` with the measured colour of a metal.

    Args:
        metal: aluminium, brass, chrome, copper, gold, iron, nickel, silver or titanium (`destello.metals`).
        name: label for people and scene files.
        **params: of the conductor: roughness, anisotropy and what every material has.

    Raises:
        SceneError: for another metal, or if a value is not accepted.
    """
    return Node("material", "conductor", {"metal": metal, **params}, name=name)


__getattr__ = _factories.get
__dir__ = _factories.names
