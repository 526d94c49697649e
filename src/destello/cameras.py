"""Cameras.

One function for each type that the core declares: ``dir()`` lists them, ``help()`` explains them.
"""

from __future__ import annotations

from destello.factories import Factories

_factories = Factories("camera", __name__)

__getattr__ = _factories.get
__dir__ = _factories.names
