"""The final scene of *The Next Week*: everything that the book has taught."""

from __future__ import annotations

from typing import TYPE_CHECKING

from destello.scenes.registry import Random, blank, scene

if TYPE_CHECKING:
    from collections.abc import Iterator

    from destello.nodes import Node
    from destello.scene import Scene

_SEED = 2


def _ground(random: Random) -> Iterator[Node]:
    """20 x 20 boxes of random height."""
    import destello as dl

    green = dl.materials.diffuse(reflectance=(0.48, 0.83, 0.53), name="ground")
    for i in range(20):
        for j in range(20):
            x, z = -1000.0 + 100.0 * i, -1000.0 + 100.0 * j
            yield dl.shapes.box((x, 0, z), (x + 100, random(1, 101), z + 100), material=green)


def _balls() -> Iterator[Node]:
    import destello as dl

    materials = dl.materials
    orange = materials.diffuse(reflectance=(0.7, 0.3, 0.1), name="orange")
    glass = materials.dielectric(ior=1.5, name="glass")
    metal = materials.fuzzy_metal(albedo=(0.8, 0.8, 0.9), fuzz=1.0, name="metal")
    # The glass is filled with blue: where it lies in the fog, the higher priority decides.
    blue = materials.dielectric(
        ior=1.5, medium_density=0.2, medium_albedo=(0.2, 0.4, 0.9), priority=1, name="blue under glass"
    )
    fog = materials.interface(medium_density=0.0001, medium_albedo=1, name="fog")
    globe = materials.diffuse(reflectance=dl.textures.planet(), name="globe")
    marble = materials.diffuse(reflectance=dl.textures.marble(scale=0.2), name="marble")
    yield dl.shapes.sphere(center=(400, 400, 200), center1=(430, 400, 200), radius=50, material=orange)
    yield dl.shapes.sphere(center=(260, 150, 45), radius=50, material=glass)
    yield dl.shapes.sphere(center=(0, 150, 145), radius=50, material=metal)
    yield dl.shapes.sphere(center=(360, 150, 145), radius=70, material=blue)
    yield dl.shapes.sphere(center=(0, 0, 0), radius=5000, material=fog)
    yield dl.shapes.sphere(center=(400, 200, 400), radius=100, material=globe)
    yield dl.shapes.sphere(center=(220, 280, 300), radius=80, material=marble)


@scene("book2", "Final scene of book 2: motion, glass, metal, fog, globe, marble, a cube of 1000 spheres.")
def book2() -> Scene:
    """The cover of the second book."""
    import destello as dl

    camera = dl.cameras.perspective(origin=(478, 278, -600), target=(278, 278, 0), vfov=40)
    made = blank("book2", size=(800, 800), spp=10000, max_depth=40, camera=camera, background=(0, 0, 0))
    random = Random(_SEED)
    made.add(*_ground(random))
    lamp = dl.materials.emissive(radiance=7, two_sided=True, name="lamp")
    made.add(dl.shapes.quad((123, 554, 147), (300, 0, 0), (0, 0, 265), material=lamp, name="light"))
    made.add(*_balls())

    white = dl.materials.diffuse(reflectance=0.73, name="white")
    centers = [random.triple(0, 165) for _ in range(1000)]
    cube = made.group("cube", [dl.shapes.spheres(centers=centers, radii=[10.0] * 1000, material=white)])
    made.add(dl.shapes.instance(cube.name, transform=dl.translate(-100, 270, 395) @ dl.rotate("y", 15)))
    return made
