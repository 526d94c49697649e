"""What the tests of textured media share: a slab seen from above, coloured by halves."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

import destello as dl

Floats = NDArray[np.float64]
LEFT, RIGHT, TOP = (0.9, 0.5, 0.2), (0.3, 0.6, 0.8), (0.7, 0.7, 0.1)
CLEAR = {"specular_weight": 0.0, "transmission_weight": 1.0}  # neither refraction nor reflection


def halves(left: Any = LEFT, right: Any = RIGHT) -> Any:
    """An image of two texels: the left half of uv one colour, the right half another, with a sharp seam."""
    texels = np.float32([[left, right]])
    return dl.textures.image(texels, color_space="linear", filter="nearest", wrap_u="clamp", wrap_v="clamp")


def slab(material: Any, low: float = -1.0, high: float = 0.0, half: float = 1.0) -> Any:
    """A box from z = low to high, |x|, |y| <= half; u grows from 0 to 1 along x on every face that looks along z."""
    corners = [(x, y, z) for z in (low, high) for y in (-half, half) for x in (-half, half)]
    faces = [(4, 5, 7, 6), (1, 0, 2, 3), (0, 1, 5, 4), (3, 2, 6, 7), (5, 1, 3, 7), (0, 4, 6, 2)]
    triangles = [t for a, b, c, d in faces for t in ((a, b, c), (a, c, d))]
    uvs = [(0.5 + 0.5 * x / half, 0.5 + 0.5 * y / half) for x, y, _ in corners]
    return dl.shapes.mesh(np.float32(corners), triangles, uvs=np.float32(uvs), material=material)


def looking_down(*shapes: Any, sky: float = 1.0, x: float = 0.0, z: float = 5.0, height: float = 2.0) -> dl.Scene:
    s = dl.Scene()
    s.film.width = s.film.height = 8
    s.camera = dl.cameras.orthographic(origin=(x, 0, z), target=(x, 0, z - 1), height=height)
    s.environment = dl.environments.constant(radiance=sky)
    s.add(*shapes)
    s.render.max_depth = s.render.rr_depth = 2000
    return s


def columns(s: dl.Scene, device: str, spp: int = 4) -> Floats:
    """RGB of each column of a picture whose pixels share nothing (8, 3)."""
    s.film.filter = dl.filters.box()
    return np.asarray(dl.render(s, spp=spp, device=device, progress=False).array, np.float64).mean(axis=0)


def both(left: Any, right: Any) -> Floats:
    return np.repeat(np.array([left, right], np.float64), 4, axis=0)
