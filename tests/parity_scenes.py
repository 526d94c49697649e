"""Scenes in which the backends have to agree: each part of the renderer is in one of them."""

from __future__ import annotations

from typing import Any

import numpy as np

import destello as dl
from destello import scenes


def opaque() -> dl.Scene:
    """Mixtures, a normal map, motion and every light in one small scene. Any hit ends a shadow ray."""
    s = dl.Scene(name="opaque")
    s.film.width, s.film.height = 160, 100
    s.camera = dl.cameras.perspective(origin=(0, 2, 9), target=(0, 0.6, 0), vfov=40, aperture_radius=0.05)
    checker = dl.textures.checker(even=(0.9, 0.9, 0.9), odd=(0.1, 0.3, 0.6), scale=0.5)
    red, metal = dl.materials.diffuse(reflectance=(0.7, 0.1, 0.1)), dl.materials.conductor(roughness=0.4)
    floor = dl.materials.diffuse(reflectance=checker)
    s.add(dl.shapes.quad(corner=(-9, 0, 9), u=(18, 0, 0), v=(0, 0, -18), material=floor))
    s.add(dl.shapes.sphere(center=(-2.5, 1, 0), radius=1, material=dl.materials.dielectric(abbe=20)))
    s.add(dl.shapes.sphere(center=(0, 1, 0), radius=1, material=dl.materials.mix(first=red, second=metal, amount=0.5)))
    s.add(dl.shapes.sphere(center=(0, 0.5, 2), radius=0.5, material=red, center1=(0.4, 0.6, 2)))
    bumps = 0.35 + 0.3 * np.random.default_rng(3).random((8, 8, 3), np.float32)
    bumps[..., 2] = 1
    bumpy = dl.materials.diffuse(reflectance=(0.3, 0.6, 0.3), normal_map=dl.textures.image(bumps, color_space="linear"))
    s.add(dl.shapes.sphere(center=(-1.3, 0.4, 2), radius=0.4, material=bumpy))
    s.add(dl.lights.point(position=(-3, 4, 3), intensity=(20, 18, 15)))
    s.add(dl.lights.spot(position=(4, 5, 2), target=(0, 0, 0), intensity=(60, 60, 80)))
    s.add(dl.lights.directional(direction=(1, -2, -1), irradiance=(0.5, 0.5, 0.4), angular_diameter=3))
    s.environment = dl.environments.image(np.linspace(0, 1, 16 * 32 * 3, dtype=np.float32).reshape(16, 32, 3))
    return s


def detailed() -> dl.Scene:
    """Bent horizons, lifted points, bump and tangent maps, mip maps of every format, tiles, tinted veils, uv sets."""
    rng = np.random.default_rng(4)
    s = dl.Scene(name="detailed")
    s.film.width, s.film.height = 160, 100
    s.camera = dl.cameras.perspective(origin=(0, 2, 9), target=(0, 0.6, 0), vfov=40)
    y, x = np.mgrid[0:256, 0:256] // 16
    checker = dl.textures.image(((x + y) % 2 * 200 + 30).astype(np.uint8), uv_scale=(8, 8))
    s.add(dl.shapes.quad((-9, 0, 9), (18, 0, 0), (0, 0, -18), material=dl.materials.diffuse(reflectance=checker)))
    v, u = np.meshgrid(np.linspace(0, np.pi, 7), np.linspace(0, 2 * np.pi, 13), indexing="ij")
    p = np.stack([np.sin(v) * np.cos(u), np.cos(v), -np.sin(v) * np.sin(u)], -1).reshape(-1, 3).astype(np.float32)
    i = (np.arange(6)[:, None] * 13 + np.arange(12)).ravel()
    t = np.concatenate([np.stack([i, i + 13, i + 1], 1), np.stack([i + 1, i + 13, i + 14], 1)])
    uvs = np.stack([u, np.pi - v], -1).reshape(-1, 2).astype(np.float32) / np.pi
    tangents = np.concatenate([np.stack([-p[:, 2], 0 * p[:, 0], p[:, 0]], 1), np.ones((len(p), 1))], 1)
    heights = rng.random((64, 64, 1)).astype(np.float16)
    bump = dl.textures.scaled(dl.textures.image(heights, uv_scale=(2, 2)), scale=0.02)
    brushed = dl.textures.image(rng.integers(0, 65535, (64, 64, 3), dtype=np.uint16), color_space="linear")
    normal = 0.3 + 0.4 * rng.random((64, 64, 3), np.float32)
    normal[..., 2] = 1
    materials = (
        dl.materials.diffuse(reflectance=0.8),
        dl.materials.conductor(roughness=0.4, anisotropy=0.7, tangent_map=brushed, bump=bump, tangent_rotation=30),
        dl.materials.dielectric(normal_map=dl.textures.image(normal, color_space="linear")),
    )
    for k, material in enumerate(materials):
        place = dl.translate(2.4 * k - 2.4, 1, 0)
        s.add(dl.shapes.mesh(p, t, normals=p, uvs=uvs, tangents=tangents, material=material, transform=place))
    noise = dl.textures.scaled(dl.textures.noise(scale=6), scale=0.05)
    s.add(dl.shapes.sphere((-1.2, 0.4, 2), 0.4, material=dl.materials.diffuse(reflectance=0.6, bump=noise)))
    veil = dl.materials.diffuse(reflectance=0.2, opacity=0.3, opacity_tint=(0.9, 0.5, 0.2))
    s.add(dl.shapes.quad((1, 0, 2), (1.5, 0, 0.5), (0, 2, 0), material=veil))
    sheet = np.float32([(-4, 0, 1), (-2.5, 0, 1), (-2.5, 1.5, 1), (-4, 1.5, 1)])
    first = np.float32([(0, 0), (1, 0), (1, 1), (0, 1)])
    glow = dl.textures.image(normal[:8, :8], color_space="linear", uv_set="second")
    both = dl.materials.diffuse(reflectance=dl.textures.image(normal, color_space="linear"), emission=glow)
    colors = np.float32([(1, 0.4, 0.2), (0.2, 1, 0.4), (0.4, 0.2, 1), (1, 1, 1)])
    fine = dl.textures.image(((x + y) % 2 * 200 + 30).astype(np.uint8), uv_set="second")
    ridges = dl.textures.scaled(dl.textures.image(heights, uv_set="second"), scale=0.02)
    third = dl.materials.diffuse(reflectance=dl.textures.scaled(fine, vertex_color=True), bump=ridges)
    for k, material in enumerate((both, third)):
        place = dl.translate(0, 0, 0.8 * k) @ dl.scale(1 - 0.5 * k)
        s.add(
            dl.shapes.mesh(
                sheet, [(0, 1, 2), (0, 2, 3)], uvs=first, second_uvs=3 * first[::-1], colors=colors, material=material,
                transform=place,
            )
        )  # fmt: skip
    s.add(dl.lights.point(position=(-3, 4, 3), intensity=(20, 18, 15)))
    s.environment = dl.environments.gradient()
    return s


def everything() -> dl.Scene:
    """The same with what shadow rays pass through: media, and holes in an instance."""
    s = opaque()
    fog = dl.materials.interface(medium_density=(0.8, 1.5, 2.5), medium_albedo=(0.9, 0.8, 0.6), medium_anisotropy=0.4)
    s.add(dl.shapes.sphere(center=(2.5, 1, 0), radius=1, material=fog))
    holes = dl.materials.diffuse(opacity=0.5)
    box = s.group("box", [dl.shapes.box(min=(-0.5, 0, -0.5), max=(0.5, 1, 0.5), material=holes)])
    s.add(dl.shapes.instance(box, transform=dl.translate(1.3, 0, 2) @ dl.rotate((0, 1, 0), 30) @ dl.scale(0.8)))
    return s


def clouds() -> dl.Scene:
    """Grids in 8, 16 and 32 bits: chromatic, tinted, glowing, turned, one in glass, one around the camera."""
    s = opaque()
    noise = np.random.default_rng(5).random((10, 17, 9), np.float32)
    puffs = np.where(noise < 0.4, 0, noise).astype(np.float32)
    wide = dl.volumes.grid(density=(puffs * 255).astype(np.uint8), min=(-8, -0.5, -8), max=(8, 5, 12))
    s.add(dl.volumes.box(wide, medium_density=(0.05, 0.1, 0.2), medium_albedo=0.9, priority=-1))
    tinted = dl.volumes.grid(
        density=puffs.astype(np.float16), albedo=np.stack([noise, noise**2, noise**0.5], -1),
        min=(-1, -1, -1), transform=dl.translate(2.5, 1.2, 0) @ dl.rotate((1, 1, 0), 35),
    )  # fmt: skip
    s.add(dl.volumes.box(tinted, medium_density=(3, 2, 4), medium_anisotropy=0.6))
    heat = {"temperature": 1500 * noise, "emission_scale": 30}
    fire = dl.volumes.grid(density=puffs, **heat, min=(-3.5, 0, 0), max=(-1.5, 2, 2.5))
    glass = dl.materials.dielectric(medium_density=1, medium_albedo=0.2, medium_volume=fire, priority=1)
    s.add(dl.shapes.sphere(center=(-2.5, 1, 1.6), radius=0.6, material=glass))
    return s


def placed_clouds() -> dl.Scene:
    """Grids that follow their shapes, and groups of them their instances: turned, sheared, in each other.

    None stands on the floor: which of two surfaces in one place a ray hits is anybody's guess.
    """
    s = opaque()
    noise = np.random.default_rng(6).random((9, 12, 10), np.float32)
    puffs = np.where(noise < 0.4, 0, noise).astype(np.float32)
    grid = dl.volumes.grid(density=(puffs * 255).astype(np.uint8), min=(-0.5, 0, -0.5), max=(0.5, 1, 0.5))
    glow = dl.volumes.grid(
        density=puffs.astype(np.float16), temperature=1600 * noise, emission_scale=3,
        min=(-1, -1, -1), transform=dl.rotate((0, 0, 1), 20),
    )  # fmt: skip
    smoke = dl.volumes.box(grid, medium_density=(4, 5, 7), medium_albedo=0.9, medium_anisotropy=0.3)
    inside = dl.materials.interface(medium_density=3, medium_albedo=0.5, medium_volume=glow, priority=1)
    core = dl.shapes.box((-1, -1, -1), (1, 1, 1), material=inside, transform=dl.translate(0, 0.5, 0) @ dl.scale(0.35))
    group = s.group("puff", [smoke, core, dl.shapes.sphere(center=(0, 1.3, 0), radius=0.15)])
    places = (
        dl.translate(-1.2, 0.05, 2.4),
        dl.translate(1.4, 0.1, 2) @ dl.rotate((0, 1, 1), 40) @ dl.shear(xy=0.4) @ dl.scale((1.2, 0.8, 1)),
        dl.translate(2.5, 0.05, 0) @ dl.scale(2),
    )
    s.add(*(dl.shapes.instance(group, transform=place) for place in places))
    s.add(core.replace(transform=dl.translate(-2.5, 2.6, 0) @ dl.rotate((1, 0, 0), 30)))
    return s


def in_a_row(name: str, *materials: dl.nodes.Node, vfov: float, floor: dl.nodes.Node | None = None) -> dl.Scene:
    """Spheres on a floor, below a lamp and a sky."""
    s = dl.Scene(name=name)
    s.film.width, s.film.height = 160, 60
    s.camera = dl.cameras.perspective(origin=(0, 1.5, 11), target=(0, 0.6, 0), vfov=vfov)
    ground = dl.materials.diffuse() if floor is None else floor
    s.add(dl.shapes.quad(corner=(-9, 0, 9), u=(18, 0, 0), v=(0, 0, -18), material=ground))
    for i, material in enumerate(materials):
        x = 1.4 * i - 0.7 * (len(materials) - 1)
        s.add(dl.shapes.sphere(center=(x, 0.6, 0), radius=0.6, material=material))
    s.add(dl.lights.point(position=(-3, 5, 4), intensity=(40, 38, 35)))
    s.environment = dl.environments.image(np.linspace(0, 1, 16 * 32 * 3, dtype=np.float32).reshape(16, 32, 3))
    return s


def layered() -> dl.Scene:
    """Every part of OpenPBR, on spheres in a row."""
    floor = dl.materials.diffuse(reflectance=dl.textures.checker(even=(0.8, 0.8, 0.8), odd=(0.2, 0.2, 0.3), scale=0.5))
    looks: list[dict[str, Any]] = [
        {
            "base_color": (0.7, 0.2, 0.1),
            "base_diffuse_roughness": 0.6,
            "coat_weight": 1.0,
            "coat_color": (0.9, 0.7, 0.5),
        },
        {"base_metalness": 1.0, "specular_roughness_anisotropy": 0.6, "thin_film_weight": 0.8},
        {"transmission_weight": 1.0, "specular_roughness": 0.1, "transmission_color": (0.5, 0.9, 0.6)}
        | {"transmission_depth": 1.0, "transmission_scatter": (0.2, 0.1, 0.1), "transmission_dispersion_scale": 0.5},
        {"subsurface_weight": 1.0, "subsurface_radius": 0.2, "subsurface_color": (0.9, 0.6, 0.4)},
        {
            "fuzz_weight": 0.8,
            "fuzz_color": (0.4, 0.5, 0.9),
            "emission_luminance": 50.0,
            "emission_color": (0.2, 0.1, 0.3),
        },
        {"geometry_thin_walled": True, "transmission_weight": 0.5, "subsurface_weight": 0.5, "geometry_opacity": 0.8},
    ]
    return in_a_row("layered", *(dl.materials.openpbr(**look) for look in looks), vfov=28, floor=floor)


def coats() -> dl.Scene:
    """Coats with normals of their own, over normal and bump maps, smooth and rough, on glass and thin sheets."""
    normals = 0.3 + 0.4 * np.random.default_rng(6).random((16, 16, 3), np.float32)
    normals[..., 2] = 1
    ripples = dl.textures.image(normals, color_space="linear", uv_scale=(2, 2))
    bump = dl.textures.scaled(dl.textures.noise(scale=6), scale=0.05)
    looks: list[dict[str, Any]] = [
        {"geometry_coat_normal": ripples, "base_metalness": 1.0},
        {"normal_map": ripples, "coat_roughness": 0.3, "fuzz_weight": 0.3},
        {"bump": bump, "geometry_coat_normal": ripples, "geometry_coat_normal_scale": 0.5, "coat_roughness": 0.5}
        | {"coat_roughness_anisotropy": 0.7, "geometry_coat_tangent": (0.8, 0.9, 0.5)},
        {"normal_map": ripples, "transmission_weight": 1.0, "specular_roughness": 0.2, "coat_color": (0.9, 0.6, 0.4)},
        {"geometry_coat_normal": (0.6, 0.7, 0.9), "geometry_thin_walled": True, "subsurface_weight": 0.7},
    ]
    common = {"coat_weight": 0.9, "base_color": (0.7, 0.2, 0.1)}
    return in_a_row("coats", *(dl.materials.openpbr(**common, **look) for look in looks), vfov=24)


def textured_insides() -> dl.Scene:
    """Skin, milk and glass coloured by textures where paths enter: nested, hidden, around a lamp, in a grid."""
    rng = np.random.default_rng(9)
    image = dl.textures.image(rng.random((64, 64, 3), np.float32), color_space="linear")
    checker = dl.textures.checker_uv(even=image, odd=(0.9, 0.4, 0.2), count_u=6, count_v=6)
    grey = dl.textures.scaled(image, scale=0.1, channel="g")
    grid = dl.volumes.grid(density=rng.random((6, 7, 8), np.float32), min=(2.2, 0, -0.6), max=(3.4, 1.2, 0.6))
    glass = {"transmission_weight": 1.0, "transmission_depth": 0.4, "specular_roughness": 0.1}
    looks: list[dict[str, Any]] = [
        {"subsurface_weight": 1.0, "subsurface_radius": 0.1, "subsurface_color": checker},
        {"transmission_color": image, "transmission_scatter": (0.2, 0.4, 0.6)} | glass,
        {"transmission_color": checker, "transmission_scatter": image} | glass,
        {"transmission_weight": 0.5, "subsurface_weight": 0.5, "subsurface_radius": grey, "subsurface_color": image},
        {"transmission_color": image, "medium_volume": grid, "priority": 1.0} | glass,
    ]
    s = in_a_row("textured insides", *(dl.materials.openpbr(**look) for look in looks), vfov=24)
    core = dl.materials.openpbr(subsurface_weight=1.0, subsurface_radius=grey, subsurface_color=checker)
    s.add(dl.shapes.sphere(center=(0, 0.5, 0), radius=0.3, material=core))  # in the glass
    s.add(dl.shapes.sphere(center=(2.0, 0.6, 0.3), radius=0.4, material=core))  # half in another, half hidden
    s.lights.insert(0, dl.lights.point(position=(-1.4, 0.7, 0.1), intensity=2))  # in the milk
    return s


def films() -> dl.Scene:
    """What the albedo tables hold besides: films over gloss, skin and sheets, stretched glass, glTF's own material."""
    film = {"thin_film_weight": 1.0, "thin_film_thickness": 0.5, "thin_film_ior": 1.7, "specular_roughness": 0.3}
    glass = {"transmission_weight": 1.0, "specular_roughness": 0.5}
    plain = dl.materials.metallic_roughness
    looks = [
        dl.materials.openpbr(**film),
        dl.materials.openpbr(**film, specular_roughness_anisotropy=0.8, subsurface_weight=1.0, subsurface_radius=0.1),
        dl.materials.openpbr(**film, geometry_thin_walled=True, subsurface_weight=0.5, transmission_weight=0.5),
        dl.materials.openpbr(**glass, specular_roughness_anisotropy=0.7),
        dl.materials.openpbr(**glass),
        plain(base_color=(0.9, 0.6, 0.3), metallic=1.0, roughness=0.3),
        plain(base_color=(0.6, 0.8, 0.9), metallic=0.2, roughness=0.5, transmission=0.7),
    ]
    return in_a_row("films", *looks, vfov=32)


def large() -> dl.Scene:
    """A tree in which the queue kernel keeps rays over turns, shadow rays too."""
    return scenes.build("interior", 0.05)


MADE = {
    "textures and media": everything,
    "normal maps and mixtures": opaque,
    "detailed": detailed,
    "layered": layered,
    "coats": coats,
    "films": films,
    "textured insides": textured_insides,
    "clouds": clouds,
    "placed clouds": placed_clouds,
    "a large tree": large,
}
