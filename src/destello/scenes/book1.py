"""The final scene of *Ray Tracing in One Weekend*, and its moving twin from *The Next Week*."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from destello.scenes.registry import Color, Point, Random, blank, scene

if TYPE_CHECKING:
    from destello.nodes import Node
    from destello.scene import Scene

_SEED = 1


def _camera() -> Node:
    """The books' defocus angle is that of the cone from the point in focus to the lens."""
    import destello as dl

    focus, defocus_angle = 10.0, 0.6
    return dl.cameras.perspective(
        origin=(13, 2, 3),
        target=(0, 0, 0),
        vfov=20,
        aperture_radius=focus * math.tan(math.radians(defocus_angle / 2)),
        focus_distance=focus,
    )


def _add_spheres(made: Scene, ground: Node | Color, jump: float) -> None:
    """Ground, 22 x 22 places for small spheres, three large ones; diffuse small ones rise by up to `jump` metres."""
    import destello as dl

    random = Random(_SEED)
    glass = dl.materials.dielectric(ior=1.5, name="glass")
    bubbles: list[Point] = []
    made.add(dl.shapes.sphere(center=(0, -1000, 0), radius=1000, material=dl.materials.diffuse(reflectance=ground)))
    for a in range(-11, 11):
        for b in range(-11, 11):
            choice = random()
            center = (a + 0.9 * random(), 0.2, b + 0.9 * random())
            if math.dist(center, (4, 0.2, 0)) <= 0.9:
                continue
            if choice < 0.8:
                color = tuple(x * y for x, y in zip(random.triple(), random.triple(), strict=True))
                center1 = (center[0], center[1] + random(0, jump), center[2]) if jump else None
                matt = dl.materials.diffuse(reflectance=color)
                made.add(dl.shapes.sphere(center=center, center1=center1, radius=0.2, material=matt))
            elif choice < 0.95:
                metal = dl.materials.fuzzy_metal(albedo=random.triple(0.5, 1), fuzz=random(0, 0.5))
                made.add(dl.shapes.sphere(center=center, radius=0.2, material=metal))
            else:
                bubbles.append(center)
    made.add(dl.shapes.spheres(centers=bubbles, radii=[0.2] * len(bubbles), material=glass))
    matt = dl.materials.diffuse(reflectance=(0.4, 0.2, 0.1), name="brown")
    metal = dl.materials.fuzzy_metal(albedo=(0.7, 0.6, 0.5), fuzz=0, name="metal")
    for center, material in (((0, 1, 0), glass), ((-4, 1, 0), matt), ((4, 1, 0), metal)):
        made.add(dl.shapes.sphere(center=center, radius=1, material=material))


@scene("book1", "Final scene of book 1: hundreds of small spheres and three large ones, with defocus blur.")
def book1() -> Scene:
    """The cover of the first book."""
    import destello as dl

    made = blank("book1", size=(1200, 675), spp=500, max_depth=50, camera=_camera(), background=(0, 0, 0))
    made.environment = dl.environments.gradient(bottom=(1, 1, 1), top=(0.5, 0.7, 1.0))
    _add_spheres(made, (0.5, 0.5, 0.5), jump=0)
    return made


@scene("book2-bouncing", "The cover of book 1 with bouncing spheres on a chequered ground.")
def bouncing() -> Scene:
    """Motion blur and a solid checker."""
    import destello as dl

    sky = (0.70, 0.80, 1.00)
    made = blank("book2-bouncing", size=(400, 225), spp=100, max_depth=50, camera=_camera(), background=sky)
    checker = dl.textures.checker(scale=0.32, even=(0.2, 0.3, 0.1), odd=(0.9, 0.9, 0.9))
    _add_spheres(made, checker, jump=0.5)
    return made
