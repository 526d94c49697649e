"""Lights that are no surfaces.

One function for each type that the core declares: ``dir()`` lists them, ``help()`` explains them.
"""

from __future__ import annotations

from destello.factories import Factories, Factory

_factories = Factories("light", __name__)


def __getattr__(name: str) -> Factory:
    return _factories.get(name)


def __dir__() -> list[str]:
    return _factories.names()
