"""The benchmark's closed room, where light comes through a small window and from an up-light: hard for path tracers."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from destello.scenes.benchmarks import bench_scene, mesh, scaled
from destello.scenes.registry import Color, Point, benchmark

if TYPE_CHECKING:
    from destello.nodes import Node
    from destello.scene import Scene
    from destello.scenes.meshes import Floats, Mesh

# The room is 6 by 3 by 4 metres; its window is a hole in the wall at z = -2, 35 cm deep.
_X, _Y, _Z = 3.0, 3.0, 2.0
_LEFT, _RIGHT, _SILL, _LINTEL, _DEEP = 0.6, 1.5, 1.1, 2.1, 0.35
_LAMP_X, _LAMP_Z = 2.3, -1.4


@benchmark("interior", "A closed room with glossy, diffuse and glass things, lit by a small window and an up-light.")
def interior(detail: float = 1.0) -> Scene:
    """245,076 triangles, most of them in the glass balls, the torus and the rock; those become fewer with detail."""
    import destello as dl

    camera = dl.cameras.perspective(origin=(-2.7, 1.55, 1.75), target=(1, 1, -0.9), vfov=52)
    made = bench_scene("interior", camera)
    wall = dl.materials.diffuse(reflectance=(0.78, 0.76, 0.72), name="wall")
    made.add(*_room(wall), *_window(wall), *_lamp(wall), *_furniture(), *_things(wall, detail))
    return made


def _metal(color: Color, alpha: float, name: str) -> Node:
    """GGX without a Fresnel term."""
    import destello as dl

    return dl.materials.conductor(reflectance=color, roughness=alpha**0.5, fresnel="none", name=name)


def _room(wall: Node) -> list[Node]:
    """Floor, ceiling and walls; the wall with the window in four parts."""
    import destello as dl

    quad = dl.shapes.quad
    accent = dl.materials.diffuse(reflectance=(0.55, 0.18, 0.12), name="accent")
    floor = _metal((0.45, 0.40, 0.36), 0.15, "floor")
    return [
        quad((-_X, 0, _Z), (2 * _X, 0, 0), (0, 0, -2 * _Z), material=floor, name="floor"),
        quad((-_X, _Y, -_Z), (2 * _X, 0, 0), (0, 0, 2 * _Z), material=wall, name="ceiling"),
        quad((-_X, 0, _Z), (0, _Y, 0), (2 * _X, 0, 0), material=wall, name="wall behind"),
        quad((-_X, 0, -_Z), (0, _Y, 0), (0, 0, 2 * _Z), material=wall, name="left wall"),
        quad((_X, 0, -_Z), (0, 0, 2 * _Z), (0, _Y, 0), material=accent, name="right wall"),
        quad((-_X, 0, -_Z), (_LEFT + _X, 0, 0), (0, _Y, 0), material=wall, name="beside the window"),
        quad((_RIGHT, 0, -_Z), (_X - _RIGHT, 0, 0), (0, _Y, 0), material=wall, name="beside the window"),
        quad((_LEFT, 0, -_Z), (_RIGHT - _LEFT, 0, 0), (0, _SILL, 0), material=wall, name="below the window"),
        quad((_LEFT, _LINTEL, -_Z), (_RIGHT - _LEFT, 0, 0), (0, _Y - _LINTEL, 0), material=wall, name="above it"),
    ]


def _window(wall: Node) -> list[Node]:
    """The sides of the hole, six slats, and the sky: a light that shines inwards."""
    import destello as dl

    quad = dl.shapes.quad
    wide, high, out = (_RIGHT - _LEFT, 0, 0), (0, _LINTEL - _SILL, 0), (0, 0, -_DEEP)
    sky = dl.materials.emissive(radiance=(60, 66, 75), name="sky")
    parts = [
        quad((_LEFT, _SILL, -_Z - _DEEP), wide, (0, 0, _DEEP), material=wall, name="sill"),
        quad((_LEFT, _LINTEL, -_Z), wide, out, material=wall, name="lintel"),
        quad((_LEFT, _SILL, -_Z), high, out, material=wall, name="left jamb"),
        quad((_RIGHT, _SILL, -_Z - _DEEP), high, (0, 0, _DEEP), material=wall, name="right jamb"),
        quad((_LEFT, _SILL, -_Z - _DEEP), wide, high, material=sky, name="sky"),
    ]
    for i in range(6):
        y = _SILL + (i + 0.5) * (_LINTEL - _SILL) / 6
        low, top = (_LEFT, y - 0.01, -_Z - _DEEP + 0.02), (_RIGHT, y + 0.01, -_Z - _DEEP + 0.14)
        parts.append(dl.shapes.box(low, top, material=wall, name="slat"))
    return parts


def _lamp(wall: Node) -> list[Node]:
    """A pole with an open cone, in which a disk shines upwards."""
    import destello as dl

    around = 48
    angle = np.arange(around) * (2 * np.pi / around)

    def ring(radius: float, y: float) -> Floats:
        return np.stack(
            [_LAMP_X + radius * np.cos(angle), np.full(around, y), _LAMP_Z + radius * np.sin(angle)], axis=1
        )

    k, k1 = np.arange(around), (np.arange(around) + 1) % around
    cone = np.concatenate([np.stack([k, k + around, k1], 1), np.stack([k1, k + around, k1 + around], 1)])
    shade = np.concatenate([ring(0.10, 1.75), ring(0.24, 2.05)])
    disk = np.concatenate([[[_LAMP_X, 1.78, _LAMP_Z]], ring(0.09, 1.78)])
    bulb = dl.materials.emissive(radiance=(60, 42, 24), name="bulb")
    low, high = (_LAMP_X - 0.015, 0, _LAMP_Z - 0.015), (_LAMP_X + 0.015, 1.76, _LAMP_Z + 0.015)
    return [
        mesh((shade, cone), wall, "shade"),
        mesh((disk, np.stack([0 * k, 1 + k1, 1 + k], 1)), bulb, "bulb"),
        dl.shapes.box(low, high, material=wall, name="pole"),
    ]


def _furniture() -> list[Node]:
    """A table, a cupboard and a stool, all of boxes."""
    import destello as dl

    wood = dl.materials.diffuse(reflectance=(0.42, 0.27, 0.15), name="wood")

    def block(low: Point, high: Point, name: str, **more: object) -> Node:
        return dl.shapes.box(low, high, material=wood, name=name, **more)

    legs = [(x, z) for x in (0.25, 1.79) for z in (-1.05, -0.21)]
    turned = dl.translate(-1.9, 0, -0.2) @ dl.rotate("y", 20) @ dl.translate(1.9, 0, 0.2)
    return [
        block((0.2, 0.70, -1.1), (1.9, 0.75, -0.1), "table"),
        *(block((x, 0, z), (x + 0.06, 0.70, z + 0.06), "leg") for x, z in legs),
        block((-1.4, 0, -1.9), (-0.5, 1.9, -1.55), "cupboard"),
        block((-2.2, 0, -0.5), (-1.6, 0.45, 0.1), "stool", transform=turned),
    ]


def _things(wall: Node, detail: float) -> list[Node]:
    """Two glass balls, one of chrome, a golden ring and a rock."""
    import destello as dl
    from destello.scenes.meshes import icosphere, rock, torus

    glass = dl.materials.dielectric(ior=1.5, name="glass")
    chrome = _metal((0.9, 0.9, 0.9), 0.02, "chrome")
    gold = _metal((0.95, 0.70, 0.35), 0.12, "gold")
    ball = icosphere(scaled(48, detail))

    def placed(made: Mesh, size: float, place: Point, material: Node, name: str, *, smooth: bool = True) -> Node:
        points, triangles = made
        return mesh((points * size + np.array(place), triangles), material, name, smooth=smooth)

    ring = torus(0.28, 0.09, max(3, scaled(192, detail)), max(3, scaled(64, detail)))
    stone = rock(scaled(64, detail), 5, height=0.35, scale=1.8)
    return [
        placed(ball, 0.17, (0.75, 0.921, -0.45), glass, "glass ball"),
        placed(ball, 0.35, (-0.3, 0.351, 0.2), glass, "large glass ball"),
        placed(ball, 0.16, (1.35, 0.911, -0.7), chrome, "chrome ball"),
        placed(ring, 1.0, (1.0, 0.0905, 0.55), gold, "gold ring"),
        placed(stone, 0.2, (-1.9, 0.66, -0.2), wall, "rock", smooth=False),
    ]
