"""The Cornell boxes of *The Next Week* (after Goral et al. 1984)."""

from __future__ import annotations

from functools import cache
from typing import TYPE_CHECKING

from destello.scenes.registry import Point, blank, scene

if TYPE_CHECKING:
    from destello.nodes import Node
    from destello.scene import Scene
    from destello.transform import Transform

TALL_SIZE: Point = (165, 330, 165)
SHORT_SIZE: Point = (165, 165, 165)


def camera() -> Node:
    """The camera of every Cornell box."""
    import destello as dl

    return dl.cameras.perspective(origin=(278, 278, -800), target=(278, 278, 0), vfov=40)


@cache
def white() -> Node:
    """The material of walls and boxes."""
    import destello as dl

    return dl.materials.diffuse(reflectance=0.73, name="white")


def empty_box(name: str, spp: int) -> Scene:
    """Five walls, no light, 555 units in each direction: green on the left of the picture, red on the right."""
    import destello as dl

    made = blank(name, size=(600, 600), spp=spp, max_depth=50, camera=camera(), background=(0, 0, 0))
    green = dl.materials.diffuse(reflectance=(0.12, 0.45, 0.15), name="green")
    red = dl.materials.diffuse(reflectance=(0.65, 0.05, 0.05), name="red")
    made.add(
        dl.shapes.quad((555, 0, 0), (0, 0, 555), (0, 555, 0), material=green, name="left wall"),
        dl.shapes.quad((0, 0, 555), (0, 0, -555), (0, 555, 0), material=red, name="right wall"),
        dl.shapes.quad((0, 555, 0), (555, 0, 0), (0, 0, 555), material=white(), name="ceiling"),
        dl.shapes.quad((0, 0, 555), (555, 0, 0), (0, 0, -555), material=white(), name="floor"),
        dl.shapes.quad((555, 0, 555), (-555, 0, 0), (0, 555, 0), material=white(), name="back wall"),
    )
    return made


def tall_place() -> Transform:
    """Where the tall box stands."""
    import destello as dl

    return dl.translate(265, 0, 295) @ dl.rotate("y", 15)


def short_place() -> Transform:
    """Where the short box stands."""
    import destello as dl

    return dl.translate(130, 0, 65) @ dl.rotate("y", -18)


@scene("cornell", "Cornell box with two blocks.")
def cornell() -> Scene:
    """The standard test of global illumination.

    The light shines downwards only (book 3's improvement): its other side is 1 unit from the ceiling, where it would
    light nothing but the gap, and make noise.
    """
    import destello as dl

    made = empty_box("cornell", spp=200)
    lamp = dl.materials.emissive(radiance=15, name="lamp")
    made.add(
        dl.shapes.quad((343, 554, 332), (-130, 0, 0), (0, 0, -105), material=lamp, name="light"),
        dl.shapes.box((0, 0, 0), TALL_SIZE, material=white(), transform=tall_place(), name="tall box"),
        dl.shapes.box((0, 0, 0), SHORT_SIZE, material=white(), transform=short_place(), name="short box"),
    )
    return made


@scene("cornell-smoke", "Cornell box whose blocks are made of smoke and fog.")
def cornell_smoke() -> Scene:
    """A black and a white medium with invisible boundaries, which reach a little below the floor."""
    import destello as dl

    made = empty_box("cornell-smoke", spp=200)
    lamp = dl.materials.emissive(radiance=7, name="lamp")
    smoke = dl.materials.interface(medium_density=0.01, medium_albedo=0, name="smoke")
    fog = dl.materials.interface(medium_density=0.01, medium_albedo=1, name="fog")
    made.add(
        dl.shapes.quad((113, 554, 127), (330, 0, 0), (0, 0, 305), material=lamp, name="light"),
        dl.shapes.box((0, -1, 0), TALL_SIZE, material=smoke, transform=tall_place(), name="tall box"),
        dl.shapes.box((0, -1, 0), SHORT_SIZE, material=fog, transform=short_place(), name="short box"),
    )
    return made
