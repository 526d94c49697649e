"""A camera and a light for scenes that have none."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from destello.geometry import MeshLoader, scene_bounds
from destello.nodes import Node

if TYPE_CHECKING:
    from destello.scene import Scene

VIEW = (1.0, 0.75, 1.5)  # from the scene's middle towards the camera: from the front, right and above
VFOV = 40.0
LARGEST = 1e36  # metres
_GLOWING = ("emissive",)


def ensure_camera(scene: Scene, load_file: MeshLoader | None = None) -> None:
    """Adds a camera that frames the whole scene, with a note, if the scene has none.

    It looks from the front, right and above at the middle of the bounding box, so that the bounding sphere fits.
    """
    if scene.cameras:
        return
    bounds = scene.bounds() if load_file is None else scene_bounds(scene, load_file)
    if bounds is None or not np.abs(bounds).max() < LARGEST:  # nothing, or meshes that will be refused
        low, high = np.full(3, -1.0), np.full(3, 1.0)
    else:
        low, high = bounds
    middle = (low + high) / 2
    radius = float(np.linalg.norm(high - low)) / 2
    if not radius > 0:
        radius = max(1e-3 * float(np.abs(middle).max()), 1e-3)
    aspect = scene.film.width / scene.film.height
    half = math.radians(VFOV) / 2
    narrow = math.atan(math.tan(half) * min(1.0, aspect))  # half the smaller of both fields of view
    direction = np.array(VIEW) / np.linalg.norm(VIEW)
    origin = middle + direction * (1.02 * radius / math.sin(narrow))
    scene.camera = Node("camera", "perspective", {"origin": origin, "target": middle, "vfov": VFOV})
    scene.notes.append("no camera in the scene: added one that frames the scene")


def ensure_light(scene: Scene, load_file: MeshLoader | None = None) -> None:
    """Adds a soft sky, with a note, if nothing in the scene gives light."""
    if scene.environment is not None or scene.lights or any(_glows(m) for m in scene.materials()):
        return
    if load_file is not None:
        own = ((place, s) for place, s in scene.all_shapes() if s.type == "mesh_file" and s["material"] is None)
        if any(_glows(material) for place, shape in own for material in load_file(shape, place).materials()):
            return
    scene.environment = Node("environment", "gradient", {"bottom": (0.6, 0.58, 0.55), "top": (0.75, 0.87, 1.0)})
    scene.notes.append("no light in the scene: added a soft sky")


def _glows(material: Node) -> bool:
    if material.type in _GLOWING:
        return True
    volume = material.params.get("medium_volume")
    if volume is not None and ("emission" in volume.params or "temperature" in volume.params):
        return True
    emission = material.params.get("emission")
    if isinstance(emission, Node):  # a texture: the lamps on an instrument, unless it is brighter than any image
        return emission.type == "scaled" and max(emission["scale"]) > 1
    return emission is not None and any(emission)
