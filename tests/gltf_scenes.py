"""What the tests of glTF share: reading what a test has made, and a quad with one material."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

import destello as dl
from destello.formats import LoadOptions
from destello.io import gltf
from destello.nodes import Node
from destello.scene import Scene
from scene_files import QUAD, QUAD_INDICES, QUAD_UV, Gltf

BARE = LoadOptions(complete=False)
TRIANGLE = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]], np.float32)


def loaded(g: Gltf, folder: Path) -> Scene:
    return gltf.load(g.glb(folder), BARE)


def only_mesh(g: Gltf, mesh: int, folder: Path) -> Node:
    g.node(mesh=mesh)
    (shape,) = loaded(g, folder).shapes
    return shape


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
    return loaded(g, folder)


def material_of(g: Gltf, folder: Path, **material: Any) -> Node:
    node = scene_with(g, folder, **material).shapes[0]["material"]
    assert isinstance(node, Node)
    return node


def picture(material: Node, *, spp: int = 256) -> np.ndarray:
    """A ball of the material under a sky of two colours."""
    scene = dl.Scene()
    scene.environment = dl.environments.gradient(bottom=0.2, top=(0.6, 0.8, 1))
    scene.camera = dl.cameras.perspective(origin=(0, 0, 4), target=(0, 0, 0), vfov=25)
    scene.add(dl.shapes.sphere(center=(0, 0, 0), radius=0.7, material=material))
    return dl.render(scene, size=(16, 16), spp=spp, device="cpu", progress=False).array
