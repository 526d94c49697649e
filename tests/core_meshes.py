"""What the core is told of meshes."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import destello as dl
from destello import _core
from destello.nodes import Node


def core_meshes(scene: dl.Scene) -> list[dict[str, Any]]:
    """The arguments of each call of the core's add_mesh while the scene is compiled."""
    told: list[dict[str, Any]] = []

    class Listening(_core.SceneBuilder):
        def add_mesh(self, **arrays: Any) -> Any:
            told.append({name: None if a is None else np.array(a) for name, a in arrays.items()})
            return super().add_mesh(**arrays)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(_core, "SceneBuilder", Listening)
        scene.compile()
    return told


def core_arrays(shape: Node) -> dict[str, Any]:
    """The arrays that the core gets for a scene of this shape alone."""
    scene = dl.Scene()
    scene.add(shape)
    (arrays,) = core_meshes(scene)
    return arrays
