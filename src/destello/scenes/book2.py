"""The small scenes of *The Next Week*: textures, quads, lights."""

from __future__ import annotations

from typing import TYPE_CHECKING

from destello.scenes.registry import Color, Point, blank, scene

if TYPE_CHECKING:
    from destello.scene import Scene

_SKY = (0.70, 0.80, 1.00)


def _small(name: str, *, origin: Point, target: Point = (0, 0, 0), background: Color = _SKY) -> Scene:
    import destello as dl

    camera = dl.cameras.perspective(origin=origin, target=target, vfov=20)
    return blank(name, size=(400, 225), spp=100, max_depth=50, camera=camera, background=background)


@scene("book2-checkered", "Two large spheres with a solid checker.")
def checkered() -> Scene:
    """They touch in the centre of the picture."""
    import destello as dl

    made = _small("book2-checkered", origin=(13, 2, 3))
    checker = dl.textures.checker(scale=0.32, even=(0.2, 0.3, 0.1), odd=(0.9, 0.9, 0.9))
    matt = dl.materials.diffuse(reflectance=checker, name="checkered")
    made.add(dl.shapes.spheres(centers=[(0, -10, 0), (0, 10, 0)], radii=[10, 10], material=matt))
    return made


@scene("book2-earth", "A globe: the procedural planet in the place of the book's map.")
def earth() -> Scene:
    """An image mapped onto a sphere looks just so; put `textures.image` there."""
    import destello as dl

    made = _small("book2-earth", origin=(0, 0, 12))
    globe = dl.materials.diffuse(reflectance=dl.textures.planet(), name="globe")
    made.add(dl.shapes.sphere(center=(0, 0, 0), radius=2, material=globe))
    return made


def _add_marble(made: Scene) -> None:
    import destello as dl

    marble = dl.materials.diffuse(reflectance=dl.textures.marble(scale=4), name="marble")
    made.add(dl.shapes.sphere(center=(0, -1000, 0), radius=1000, material=marble))
    made.add(dl.shapes.sphere(center=(0, 2, 0), radius=2, material=marble))


@scene("book2-perlin", "A marble sphere on marble ground.")
def perlin() -> Scene:
    """Turbulence of Perlin noise moves the phase of a sine."""
    made = _small("book2-perlin", origin=(13, 2, 3))
    _add_marble(made)
    return made


@scene("book2-quads", "Five coloured parallelograms.")
def quads() -> Scene:
    """The inside of a box without a front."""
    import destello as dl

    camera = dl.cameras.perspective(origin=(0, 0, 9), target=(0, 0, 0), vfov=80)
    made = blank("book2-quads", size=(400, 400), spp=100, max_depth=50, camera=camera, background=_SKY)
    for name, corner, u, v, color in (
        ("left red", (-3, -2, 5), (0, 0, -4), (0, 4, 0), (1.0, 0.2, 0.2)),
        ("back green", (-2, -2, 0), (4, 0, 0), (0, 4, 0), (0.2, 1.0, 0.2)),
        ("right blue", (3, -2, 1), (0, 0, 4), (0, 4, 0), (0.2, 0.2, 1.0)),
        ("upper orange", (-2, 3, 1), (4, 0, 0), (0, 0, 4), (1.0, 0.5, 0.0)),
        ("lower teal", (-2, -3, 5), (4, 0, 0), (0, 0, -4), (0.2, 0.8, 0.8)),
    ):
        made.add(dl.shapes.quad(corner, u, v, material=dl.materials.diffuse(reflectance=color, name=name)))
    return made


@scene("book2-light", "The marble spheres in the dark, lit by a quad and a sphere.")
def light() -> Scene:
    """Emissive shapes are the only light."""
    import destello as dl

    made = _small("book2-light", origin=(26, 3, 6), target=(0, 2, 0), background=(0, 0, 0))
    _add_marble(made)
    lamp = dl.materials.emissive(radiance=4, two_sided=True, name="lamp")
    made.add(dl.shapes.sphere(center=(0, 7, 0), radius=2, material=lamp))
    made.add(dl.shapes.quad((3, 1, -2), (2, 0, 0), (0, 2, 0), material=lamp))
    return made
