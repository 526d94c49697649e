"""Environments: the light that comes from all around.

One function for each type that the core declares: ``dir()`` lists them, ``help()`` explains them.
"""

from __future__ import annotations

from destello.factories import Factories, Factory

_factories = Factories("environment", __name__)


def __getattr__(name: str) -> Factory:
    return _factories.get(name)


def __dir__() -> list[str]:
    return _factories.names()
