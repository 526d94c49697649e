"""Scenes and random edits for tests of `destello.live`."""

from __future__ import annotations

from typing import Any

import numpy as np

import destello as dl
from destello.live import Edit, LiveScene

SIZE = (48, 32)


def studio() -> dl.Scene:
    """Every kind of shape, material, light and environment that edits treat in a way of its own."""
    s = dl.Scene("studio")
    s.film.width, s.film.height = SIZE
    s.render.max_depth = 6
    s.camera = dl.cameras.perspective(origin=(0, 3, 9), target=(0, 0.7, 0), vfov=45)
    white, red = dl.materials.diffuse(reflectance=(0.7, 0.7, 0.7)), dl.materials.diffuse(reflectance=(0.7, 0.1, 0.1))
    metal = dl.materials.conductor(roughness=0.3)
    lamp = dl.materials.emissive(power=60)
    floor = dl.materials.diffuse(reflectance=dl.textures.checker(even=(0.8, 0.8, 0.8), odd=(0.2, 0.3, 0.5)))
    s.add(dl.shapes.quad(corner=(-6, 0, 6), u=(12, 0, 0), v=(0, 0, -12), material=floor, name="floor"))
    s.add(dl.shapes.sphere(center=(-2, 1.01, 0), radius=1, material=white, name="ball"))
    s.add(dl.shapes.sphere(center=(2.2, 0.8, 1), radius=0.7, material=dl.materials.dielectric(), name="glass"))
    s.add(dl.shapes.box(min=(-0.4, 0, -0.4), max=(0.4, 1, 0.4), material=white, name="box",
                        transform=dl.translate(0, 0.01, 0.5) @ dl.rotate("y", 20)))  # fmt: skip
    s.add(dl.shapes.mesh([[0, 0, 0], [1, 0, 0], [0, 1.5, 0.3]], [[0, 1, 2]], material=red, name="mesh",
                         transform=dl.translate(0.4, 0.2, 2)))  # fmt: skip
    s.add(dl.shapes.spheres(centers=[[-1, 0.3, 2.5], [-0.3, 0.25, 3]], radii=[0.29, 0.24], material=metal, name="two"))
    group = s.group("pair", [
        dl.shapes.box(min=(0, 0, 0), max=(0.4, 0.8, 0.4), material=metal),
        dl.shapes.sphere(center=(0.2, 1, 0.2), radius=0.2, material=dl.materials.mix(first=red, second=metal)),
    ])  # fmt: skip
    for x in (-3.5, 3.5):
        s.add(dl.shapes.instance(group, transform=dl.translate(x, 0.02, -1), name=f"pair {x:+g}"))
    s.add(dl.shapes.quad(corner=(-1, 4, -1), u=(2, 0, 0), v=(0, 0, 2), material=lamp, name="lamp"))
    s.add(dl.shapes.sphere(center=(3, 2.5, -1), radius=0.3, material=lamp, name="bulb"))
    s.add(dl.lights.point(position=(-3, 4, 3), intensity=(9, 8, 7), name="point"))
    s.add(dl.lights.directional(direction=(1, -2, -1), irradiance=(0.4, 0.4, 0.3), angular_diameter=3, name="sun"))
    s.environment = dl.environments.image(np.linspace(0, 0.6, 8 * 16 * 3, dtype=np.float32).reshape(8, 16, 3))
    return s


def picture(live: LiveScene, samples: int = 4, size: tuple[int, int] = SIZE) -> Any:
    """(height, width, 3): the mean of so many samples."""
    film = live.film(*size)
    done = live.render(film, samples)
    assert not done.cancelled
    assert film.samples == samples
    return film.mean()


def random_edit(live: LiveScene, rng: np.random.Generator) -> tuple[str, Edit]:
    """One edit: its kind, and what it took."""
    kind = str(rng.choice(["move", "material", "type", "share", "everywhere", "light", "lights", "environment", "sky"]))
    scene = live.scene
    if kind == "move":
        movable = [i for i, shape in enumerate(scene.shapes) if shape.type != "spheres"]
        i = int(rng.choice(movable))
        turn = dl.rotate(tuple(rng.normal(size=3)), float(rng.uniform(0, 360)))
        place = dl.translate(*rng.uniform([-3, 0.3, -2], [3, 2, 3])) @ turn @ dl.scale(float(rng.uniform(0.4, 1.3)))
        edit = live.set_transform(i, place)
    elif kind in ("material", "type", "share"):
        painted = [i for i, shape in enumerate(scene.shapes) if shape.type != "instance"]
        i = int(rng.choice(painted))
        edit = live.set_material(i, random_material(live, i, kind, rng))
    elif kind == "everywhere":
        metal = next(m for m in scene.materials() if m.type == "conductor")
        edit = live.set_material(metal, {"roughness": float(rng.uniform(0.1, 0.9))})
    elif kind == "light":
        edit = live.set_light(
            int(rng.integers(len(scene.lights))), {"transform": dl.translate(*rng.uniform(-0.5, 0.5, 3))}
        )
    elif kind == "lights":
        changed = scene.copy()
        changed.lights = [dl.lights.point(position=rng.uniform(1, 4, 3), intensity=9) for _ in range(rng.integers(3))]
        changed.lights += scene.lights[:1]
        edit = live.update(changed)
    elif kind == "environment":
        edit = live.set_environment(
            None if rng.random() < 0.2 else {"type": "constant", "radiance": float(rng.uniform(0, 1))}
        )
    else:
        pixels = rng.uniform(0, 1, (4, 8, 3)).astype(np.float32)
        edit = live.set_environment(dl.environments.image(pixels, transform=dl.rotate("y", float(rng.uniform(0, 360)))))
    return kind, edit


def random_material(live: LiveScene, i: int, kind: str, rng: np.random.Generator) -> Any:
    """Values for shape i: a constant, another type, or another shape's material."""
    if kind == "share":
        other = [s["material"] for s in live.scene.shapes if s.type != "instance" and s["material"] is not None]
        return other[int(rng.integers(len(other)))]
    color = tuple(float(x) for x in rng.uniform(0.1, 0.9, 3))
    now = live.scene.shapes[i]["material"]
    if kind == "material" and now is not None and now.type == "mix":
        return {"amount": float(rng.uniform())}
    if kind == "material":
        return {"opacity": float(rng.choice([1.0, 0.5])), "emission": color if rng.random() < 0.3 else None}
    return [
        dl.materials.diffuse(reflectance=color),
        dl.materials.dielectric(ior=float(rng.uniform(1.2, 1.8))),
        dl.materials.emissive(power=float(rng.uniform(5, 50))),
        dl.materials.interface(medium_density=float(rng.uniform(0.2, 2)), medium_albedo=color),
        dl.materials.mix(first=dl.materials.diffuse(reflectance=color), second=dl.materials.conductor(roughness=0.2)),
        dl.materials.diffuse(reflectance=dl.textures.checker(even=color, odd=(0.1, 0.1, 0.1), scale=0.3)),
    ][int(rng.integers(6))]
