"""The scene of *The Rest of Your Life*."""

from __future__ import annotations

from typing import TYPE_CHECKING

from destello.scenes.cornell import TALL_SIZE, empty_box, tall_place, white
from destello.scenes.registry import scene

if TYPE_CHECKING:
    from destello.scene import Scene


@scene("book3", "Cornell box with a tall block and a glass ball, the scene of book 3.")
def book3() -> Scene:
    """Its light shines only downwards, and is sampled directly."""
    import destello as dl

    made = empty_box("book3", spp=1000)
    lamp = dl.materials.emissive(radiance=15, name="lamp")
    glass = dl.materials.dielectric(ior=1.5, name="glass")
    made.add(
        dl.shapes.quad((213, 554, 227), (130, 0, 0), (0, 0, 105), material=lamp, name="light"),
        dl.shapes.box((0, 0, 0), TALL_SIZE, material=white(), transform=tall_place(), name="tall box"),
        dl.shapes.sphere(center=(190, 90, 190), radius=90, material=glass),
    )
    return made
