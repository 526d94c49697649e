"""The scene of the 2018 program that destello comes from."""

from __future__ import annotations

from typing import TYPE_CHECKING

from destello.scenes.registry import scene

if TYPE_CHECKING:
    from destello.scene import Scene


@scene("origin", "Glass, globe and moving mirror under a blue sky: the scene of destello's 2018 ancestor.")
def origin() -> Scene:
    """Glass of index 2.3, a globe, a mirror that moves while the shutter is open, a small white light."""
    import destello as dl

    made = dl.Scene("origin")
    made.film.width, made.film.height = 1280, 720
    made.film.filter = dl.filters.gaussian(sigma=0.3)
    made.render.spp, made.render.max_depth, made.render.shutter = 200, 20, (0.0, 0.5)
    made.camera = dl.cameras.perspective(origin=(0, 0, 1), target=(0, 0, -1), vfov=90)
    made.environment = dl.environments.gradient(bottom=(1, 1, 1), top=(0.5, 0.7, 1.0))

    ground = dl.materials.diffuse(reflectance=(0.8, 0.8, 0), name="ground")
    globe = dl.materials.diffuse(reflectance=dl.textures.planet(), name="globe")
    mirror = dl.materials.fuzzy_metal(albedo=(0.8, 0.6, 0.2), name="mirror")
    made.add(
        dl.shapes.sphere(center=(0, 0, -2), radius=0.5, material=dl.materials.dielectric(ior=2.3, name="glass")),
        dl.shapes.sphere(center=(0, -0.25, -1), radius=0.25, material=globe),
        dl.shapes.sphere(center=(0, -100.5, -1), radius=100, material=ground),
        dl.shapes.sphere(center=(-1, 0, -1), center1=(-1, 0.3, -1), radius=0.5, material=mirror),
        dl.shapes.sphere(center=(1, 2, -1), radius=0.25, material=dl.materials.emissive(radiance=1, name="light")),
    )
    return made
