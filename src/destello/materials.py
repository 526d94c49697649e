"""Materials: what surfaces and volumes are made of.

One function for each type that the core declares: ``dir()`` lists them, ``help()`` explains them.
"""

from __future__ import annotations

from destello.factories import Factories

_factories = Factories("material", __name__)

__getattr__ = _factories.get
__dir__ = _factories.names
