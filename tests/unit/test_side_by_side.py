"""The CPU backend shades Lambertian surfaces side by side (core/backend/lambert_batch.h) and all others one by one.

`mix(m, m)` looks like m and draws none of its random numbers, but is shaded one by one: so a scene of such mixes is the
slow twin, and must give the same bits.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

import destello as dl
from destello import _core

if TYPE_CHECKING:
    from destello.nodes import Node

SIZE = (40, 30)


def one_by_one(scene: dl.Scene) -> dl.Scene:
    def slow(shape: Node) -> Node:
        material = shape.params.get("material")
        if material is None or material.type != "diffuse":
            return shape
        return shape.replace(material=dl.materials.mix(first=material, second=material, amount=0.5))

    scene.shapes[:] = [slow(shape) for shape in scene.shapes]
    for name, group in scene.groups.items():
        scene.groups[name] = replace(group, shapes=tuple(slow(shape) for shape in group.shapes))
    return scene


def rendered(scene: dl.Scene, *, aovs: bool = False, **settings: Any) -> dict[str, Any]:
    renderer = _core.Renderer(scene.compile(device="cpu").core, "cpu", 0)
    film = _core.Film(*SIZE, aovs)
    counts = renderer.render(film, 0, 0, 7, {"max_depth": 6, "rr_depth": 3, "seed": 5, **settings})
    return {**film.state(), "rays": counts["rays"]}


def assert_same(make: Any, **settings: Any) -> None:
    fast, slow = rendered(make(), **settings), rendered(one_by_one(make()), **settings)
    assert fast.keys() == slow.keys()
    assert np.count_nonzero(fast["sums"]) > 100
    for name, values in fast.items():
        np.testing.assert_array_equal(values, slow[name], name)


@pytest.mark.parametrize("light_sampling", ["auto", "mis", "light", "bsdf"])
@pytest.mark.parametrize("name", ["cornell", "mesh1m", "interior", "instances-100", "book1", "cornell-smoke"])
def test_scenes_of_many_kinds(name, light_sampling):
    """Few triangles and trees of them, smooth normals, instances, spheres; area lights, an even sky, smoke."""
    assert_same(lambda: dl.scenes.build(name, 0.01), light_sampling=light_sampling)


def wave(offset: float, material: Any, **more: Any) -> Node:
    """A bent sheet with normals of its own, some of them none, and uvs that turn over in the middle."""
    x, z = np.meshgrid(np.linspace(-1, 1, 9), np.linspace(-1, 1, 7))
    positions = np.stack([x, 0.3 * np.sin(3 * x) + offset, z], -1).reshape(-1, 3)
    normals = np.stack([-0.9 * np.cos(3 * x), np.ones_like(x), 0 * x], -1).reshape(-1, 3)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    normals[::11] = 0
    uvs = np.stack([np.abs(x), z], -1).reshape(-1, 2)
    i = np.arange(6 * 8).reshape(6, 8) + np.arange(6)[:, None]
    faces = np.concatenate([np.stack([i, i + 9, i + 1], -1), np.stack([i + 1, i + 9, i + 10], -1)]).reshape(-1, 3)
    return dl.shapes.mesh(positions, faces, normals=normals, uvs=uvs, material=material, **more)


def everything() -> dl.Scene:
    """All that lanes can meet at once: what they take, what they leave, and lights of every kind."""
    s = dl.Scene("everything")
    s.film.width, s.film.height = SIZE
    s.camera = dl.cameras.perspective(
        origin=(0, 3, 8), target=(0, 0.7, 0), vfov=50, aperture_radius=0.1, focus_distance=8
    )
    white, red = dl.materials.diffuse(reflectance=(0.8, 0.8, 0.7)), dl.materials.diffuse(reflectance=(0.7, 0.1, 0))
    black, rough = dl.materials.diffuse(reflectance=0), dl.materials.diffuse(reflectance=0.6, roughness=0.5)
    checked = dl.materials.diffuse(reflectance=dl.textures.checker(even=(0.8, 0.8, 0.8), odd=(0.2, 0.3, 0.5)))
    lamp = dl.materials.emissive(radiance=(4, 4, 3))
    s.add(dl.shapes.quad(corner=(-6, -1, 6), u=(12, 0, 0), v=(0, 0, -12), material=checked))
    s.add(wave(0, white, transform=dl.translate(-2, 0.2, 0) @ dl.rotate("z", 40)))
    s.add(wave(0.5, red, transform=dl.scale(-1, 1, 1)))
    s.add(wave(1, white, transform=dl.translate(-4, 1, 1), transform1=dl.translate(-4, 1.5, 1)))
    s.add(dl.shapes.box(min=(0, 0, 0), max=(0.5, 0.5, 0.5), material=red, transform=dl.translate(2, 1.5, 1),
                        transform1=dl.translate(2.3, 1.6, 1) @ dl.rotate("y", 10)))  # fmt: skip
    s.add(dl.shapes.sphere(center=(2, 0.5, 1), radius=0.7, material=white))
    s.add(dl.shapes.sphere(center=(1, 0, 3), center1=(1.2, 0.3, 3), radius=0.4, material=red))
    s.add(dl.shapes.sphere(center=(-3, 0, 2), radius=0.5, material=rough))
    s.add(dl.shapes.sphere(center=(3.4, 0.2, 2), radius=0.6, material=dl.materials.dielectric()))
    s.add(dl.shapes.sphere(center=(-1.2, -0.4, 3.4), radius=0.4, material=black))
    skin = dl.materials.openpbr(subsurface_weight=1, subsurface_radius=0.3, subsurface_color=dl.textures.checker())
    s.add(dl.shapes.sphere(center=(0.4, 0.2, 3), radius=0.4, material=skin))  # with a part of the mesh in it
    group = s.group("pair", [wave(0, red), dl.shapes.box(min=(0, -1, 0), max=(0.5, 1, 0.5), material=white)])
    s.add(dl.shapes.instance(group, transform=dl.translate(0, 1.3, -2) @ dl.rotate("x", 70) @ dl.scale(1, 2, 0.5)))
    s.add(dl.shapes.instance(group, transform=dl.translate(4, 0, -2), transform1=dl.translate(4, 1, -2)))
    s.add(dl.shapes.instance(group, transform=dl.translate(-4, 0, -2) @ dl.scale(1, -1, 1)))
    s.add(dl.shapes.quad(corner=(-1, 4, -1), u=(2, 0, 0), v=(0, 0, 2), material=lamp))
    s.add(dl.shapes.quad(corner=(-4, 3, 1), u=(0, 1, 0), v=(0, 0, 1),
                         material=dl.materials.emissive(radiance=(2, 3, 4), two_sided=True)))  # fmt: skip
    s.add(dl.shapes.sphere(center=(3, 3.5, -1), radius=0.3, material=lamp))
    s.add(dl.lights.point(position=(-3, 4, 3), intensity=(9, 8, 7)))
    s.add(dl.lights.directional(direction=(1, -2, -1), irradiance=(0.4, 0.4, 0.3), angular_diameter=3))
    s.environment = dl.environments.image(np.linspace(0, 0.6, 8 * 16 * 3, dtype=np.float32).reshape(8, 16, 3))
    return s


@pytest.mark.parametrize("max_depth", [1, 2, 6])
@pytest.mark.parametrize("aovs", [False, True])
@pytest.mark.parametrize("light_sampling", ["auto", "mis", "light", "bsdf"])
def test_everything_at_once(light_sampling, aovs, max_depth):
    assert_same(everything, light_sampling=light_sampling, aovs=aovs, max_depth=max_depth)
