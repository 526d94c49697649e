"""A quad with one material, as glTF: what the tests of materials and of images share."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from destello.formats import LoadOptions
from destello.io import gltf
from destello.nodes import Node
from destello.scene import Scene
from scene_files import QUAD, QUAD_INDICES, QUAD_UV, Gltf

BARE = LoadOptions(complete=False)


def scene_with(g: Gltf, folder: Path, *, color: np.ndarray | None = None, **material: Any) -> Scene:
    attributes = {
        "POSITION": g.accessor(QUAD),
        "TEXCOORD_0": g.accessor(QUAD_UV),
        "TEXCOORD_1": g.accessor(QUAD_UV * 2),
    }
    if color is not None:
        attributes["COLOR_0"] = g.accessor(color)
    mesh = g.mesh(attributes, g.accessor(QUAD_INDICES), material=g.add("materials", **material))
    g.node(mesh=mesh)
    return gltf.load(g.glb(folder), BARE)


def material_of(g: Gltf, folder: Path, **material: Any) -> Node:
    node = scene_with(g, folder, **material).shapes[0]["material"]
    assert isinstance(node, Node)
    return node
