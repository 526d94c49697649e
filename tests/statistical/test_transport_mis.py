"""All ways of finding the light agree in the mean: light sampling, BSDF sampling, both, and what `auto` chooses."""

from __future__ import annotations

import numpy as np
import pytest

import destello as dl
from transport import assert_agree, estimate, floor

MODES = ["bsdf", "light", "auto"]


def stage(*extra):
    """A floor, a matt ball, a dull metal ball and a clear mirror, in view of a camera; lights are still to come."""
    scene = dl.Scene("stage")
    scene.camera = dl.cameras.perspective(origin=(0, 2, 2.6), target=(0, 0.2, -0.1), vfov=30)
    scene.add(floor(0.6, 4.0))
    scene.add(dl.shapes.sphere((-1.1, 0.5, 0), 0.5, material=dl.materials.diffuse(reflectance=0.8, roughness=0.5)))
    scene.add(dl.shapes.sphere((1.1, 0.5, 0), 0.5, material=dl.materials.conductor(reflectance=0.9, roughness=0.6)))
    scene.add(dl.shapes.sphere((0, 0.4, -0.9), 0.4, material=dl.materials.conductor(fresnel="none")))
    scene.add(*extra)
    return scene


def lamp(radiance=4.0, **more):
    return dl.materials.emissive(radiance=radiance, **more)


def ceiling(material, **placing):
    """A lamp of 2 x 2 that looks down from y = 2.5."""
    return dl.shapes.quad((-1, 2.5, -1), (2, 0, 0), (0, 0, 2), material=material, **placing)


def instanced(shape, transform, transform1=None):
    scene = stage()
    scene.group("lamp", [shape])
    scene.add(dl.shapes.instance("lamp", transform=transform, transform1=transform1))
    return scene


def picture_of_gradient(seed=0):
    """A lamp's picture: bright on one side, a black stripe, colours."""
    image = np.random.default_rng(seed).uniform(0.0, 4.0, (5, 7, 3)).astype(np.float32)
    image[:, 2] = 0
    image[:, 5] *= 3
    return dl.textures.image(image, color_space="linear")


def sky_image():
    rng = np.random.default_rng(5)
    image = rng.uniform(0.1, 1.0, (12, 24, 3)).astype(np.float32)
    image[2:5, 6:9] = (30, 20, 10)
    return image


def with_environment(environment):
    scene = stage()
    scene.environment = environment
    return scene


def many_lights():
    rng = np.random.default_rng(11)
    scene = stage()
    for _ in range(12):
        center = (rng.uniform(-2, 2), rng.uniform(1.8, 2.2), rng.uniform(-2, 1))
        scene.add(dl.shapes.sphere(center, 0.15 + 0.2 * rng.random(), material=lamp(rng.uniform(0.5, 12, 3))))
    scene.add(ceiling(lamp((0.4, 0.2, 0.9), two_sided=True)))
    scene.environment = dl.environments.constant(radiance=0.2)
    scene.add(dl.lights.directional(direction=(-1, -2, -1), irradiance=0.5, angular_diameter=40))
    return scene


def colored_mesh(**placing):
    positions = np.array([[-1, 2.5, -1], [1, 2.5, -1], [1, 2.5, 1], [-1, 2.5, 1]], np.float32)
    colors = np.array([[1, 0, 0, 1], [0, 0, 0, 1], [0, 1, 1, 1], [0.2, 0.1, 1, 1]], np.float32)
    glow = dl.textures.vertex_color(scale=6.0)
    material = dl.materials.diffuse(reflectance=0.1, emission=glow)
    return dl.shapes.mesh(positions, [[0, 1, 2], [0, 2, 3]], colors=colors, material=material, **placing)


def fog_box(density=0.3, **more):
    material = dl.materials.interface(medium_density=density, medium_albedo=0.8, **more)
    return dl.shapes.box((-3, 0.05, -3), (3, 2.2, 2), material=material)


def with_fog(scene):
    scene.add(fog_box())
    return scene


def glass_in_haze(priority, inner):
    """A slab inside haze. If the haze has the higher priority, the slab's boundary must not be there at all."""
    scene = stage(ceiling(lamp()))
    haze = dl.materials.interface(medium_density=0.25, medium_albedo=0.9, priority=priority)
    scene.add(dl.shapes.box((-3, 0.05, -3), (3, 2.2, 2), material=haze))
    scene.add(dl.shapes.box((-2, 1.2, -2), (2, 1.5, 1), material=inner))
    return scene


def see_through(opacity):
    return dl.materials.diffuse(reflectance=0.3, opacity=opacity)


def holes():
    return dl.textures.checker_uv(even=(1, 1, 1), odd=(0, 0, 0), count_u=6, count_v=6)


SCENES = {
    "sphere": lambda: stage(dl.shapes.sphere((0.5, 2.2, 0.5), 0.6, material=lamp())),
    "sphere from inside": lambda: stage(dl.shapes.sphere((0, 1, 0), -7, material=lamp(0.5))),
    "sphere seen from both sides": lambda: stage(
        dl.shapes.sphere((0, 1, 0), 7, material=lamp((0.5, 0.3, 0.2), two_sided=True))
    ),
    "quad": lambda: stage(ceiling(lamp())),
    "quad on both sides": lambda: stage(
        dl.shapes.quad((-0.2, 0.3, 1), (0, 0, -2), (0.2, 1.5, 0), material=lamp(two_sided=True))
    ),
    "quad by power": lambda: stage(ceiling(lamp((1, 0.5, 0.2), power=40))),
    "two shapes share a power": lambda: stage(
        ceiling(lamp(power=30)), dl.shapes.sphere((-2, 1.5, 1), 0.4, material=lamp(power=10, radiance=(1, 0, 1)))
    ),
    "glowing matt surface": lambda: stage(ceiling(dl.materials.diffuse(reflectance=0.5, emission=3))),
    "glowing rough metal": lambda: stage(ceiling(dl.materials.conductor(roughness=0.5, emission=3))),
    "textured quad": lambda: stage(ceiling(lamp(picture_of_gradient()))),
    "textured quad without light at the corners": lambda: stage(
        ceiling(lamp(dl.textures.checker_uv(even=(0, 0, 0), odd=(5, 5, 5), count_u=3, count_v=3)))
    ),
    "textured sphere": lambda: stage(dl.shapes.sphere((0.3, 2.2, 0.5), 0.7, material=lamp(picture_of_gradient(1)))),
    "solid checker on a lamp": lambda: stage(
        ceiling(lamp(dl.textures.checker(even=(6, 1, 1), odd=(0, 0.5, 0.5), scale=0.37)))
    ),
    "vertex colours": lambda: stage(colored_mesh()),
    "mesh placed by a mirror": lambda: stage(
        ceiling(lamp(picture_of_gradient()), transform=dl.scale(-1, 1, 1) @ dl.translate(0.4, 0, 0))
    ),
    "instance": lambda: instanced(
        ceiling(lamp(picture_of_gradient())), dl.translate(0.3, 0.2, 0) @ dl.rotate("x", 20) @ dl.scale(0.8, 1, 1.4)
    ),
    "mirrored instance": lambda: instanced(ceiling(lamp()), dl.scale(-1, 1, 1) @ dl.rotate("z", 15)),
    "instanced textured sphere": lambda: instanced(
        dl.shapes.sphere((0, 0, 0), 1, material=lamp(picture_of_gradient(2))),
        dl.translate(0.4, 2.1, 0.3) @ dl.rotate("y", 50) @ dl.scale(0.6),
    ),
    "stretched sphere": lambda: instanced(
        dl.shapes.sphere((0, 0, 0), 1, material=lamp(picture_of_gradient(2))),
        dl.translate(0.4, 2.1, 0.3) @ dl.rotate("z", 30) @ dl.scale(1.2, 0.25, 0.5),
    ),
    "stretched sphere from inside": lambda: instanced(
        dl.shapes.sphere((0, 0, 0), -1, material=lamp(0.5)), dl.translate(0, 1, 0) @ dl.scale(9, 4, 8)
    ),
    "turning sphere": lambda: instanced(
        dl.shapes.sphere((1, 0, 0), 0.6, material=lamp()),
        dl.translate(0, 2.2, 0.3),
        dl.translate(0, 2.2, 0.3) @ dl.rotate("y", 90),
    ),
    "growing sphere": lambda: instanced(
        dl.shapes.sphere((0, 0, 0), 1, material=lamp()),
        dl.translate(-0.5, 2.2, 0.3) @ dl.scale(0.2),
        dl.translate(0.5, 2.4, 0.3) @ dl.scale(0.8, 0.4, 0.6),
    ),
    "moving sphere": lambda: stage(dl.shapes.sphere((-1, 2.2, 0.5), 0.5, material=lamp(), center1=(1, 1.8, 0.5))),
    "moving quad": lambda: stage(
        ceiling(lamp(), transform=dl.translate(-1, 0, 0), transform1=dl.translate(1, -0.5, 0) @ dl.scale(0.5, 1, 1))
    ),
    "moving instance": lambda: instanced(
        ceiling(lamp()), dl.translate(-1, 0, 0), dl.translate(1, 0, 0) @ dl.rotate("z", 40)
    ),
    "many lights": many_lights,
    "wide sun": lambda: stage(dl.lights.directional(direction=(1, -2, -1), irradiance=2, angular_diameter=50)),
    "constant sky": lambda: with_environment(dl.environments.constant(radiance=0.7)),
    "gradient sky": lambda: with_environment(dl.environments.gradient(bottom=(0, 0, 0), top=(2, 1, 0.5))),
    "image sky": lambda: with_environment(dl.environments.image(sky_image(), strength=0.7)),
    "turned image sky": lambda: with_environment(
        dl.environments.image(sky_image(), transform=dl.rotate((1, 2, 3), 70) @ dl.scale(-1, 1, 1))
    ),
    "lamp behind a hole": lambda: stage(
        ceiling(lamp()),
        dl.shapes.quad((-2, 1.9, -2), (4, 0, 0), (0, 0, 4), material=see_through(holes())),
        dl.shapes.quad((-2, 1.8, -2), (4, 0, 0), (0, 0, 4), material=see_through(0.6)),
    ),
    "lamp behind a mixture": lambda: stage(
        ceiling(lamp()),
        dl.shapes.quad(
            (-2, 1.9, -2),
            (4, 0, 0),
            (0, 0, 4),
            material=dl.materials.mix(first=see_through(0.2), second=see_through(1.0), amount=holes()),
        ),
    ),
    "half-transparent lamp": lambda: stage(ceiling(dl.materials.diffuse(reflectance=0.3, emission=5, opacity=0.4))),
    "lamp with holes": lambda: stage(
        ceiling(dl.materials.diffuse(reflectance=0.3, emission=5, opacity=holes(), opacity_cutoff=0.5))
    ),
    "half-transparent ball lamp": lambda: stage(
        dl.shapes.sphere(
            (0.5, 2.2, 0.5),
            0.6,
            material=dl.materials.diffuse(reflectance=0.3, emission=5, emission_two_sided=True, opacity=0.5),
        )
    ),
    "lamp in a mixture": lambda: stage(
        ceiling(dl.materials.mix(first=lamp(6), second=dl.materials.diffuse(), amount=0.7))
    ),
    "glowing mirror": lambda: stage(ceiling(dl.materials.conductor(emission=3))),
    "lamp in rough glass": lambda: stage(
        dl.shapes.sphere((0.2, 2.2, 0.5), 0.4, material=lamp(6)),
        dl.shapes.sphere((0.2, 2.2, 0.5), 0.7, material=dl.materials.dielectric(roughness=0.6)),
    ),
    "fog": lambda: stage(ceiling(lamp()), fog_box()),
    "forward-scattering fog": lambda: stage(ceiling(lamp()), fog_box(medium_anisotropy=0.6, medium_absorption=0.1)),
    "fog under an image sky": lambda: with_fog(with_environment(dl.environments.image(sky_image()))),
    "boundary hidden by a higher priority": lambda: glass_in_haze(1, dl.materials.dielectric()),
    "smoke hidden by a higher priority": lambda: glass_in_haze(1, dl.materials.interface(medium_density=3)),
    "smoke that goes before the haze": lambda: glass_in_haze(
        -1, dl.materials.interface(medium_density=2, medium_albedo=0.3)
    ),
}


@pytest.mark.parametrize("name", SCENES)
def test_light_sampling_and_bsdf_sampling_agree(name, device):
    scene = SCENES[name]()
    both = estimate(scene, device, spp=512, size=(8, 8), sampling="mis", seed=1, max_depth=5)
    for i, mode in enumerate(MODES):
        spp = 2048 if mode == "bsdf" else 512
        other = estimate(scene, device, spp=spp, size=(8, 8), sampling=mode, seed=2 + i, max_depth=5)
        assert_agree(both, other, comparisons=len(MODES) * len(SCENES))


def test_points_and_beams_among_lamps(device):
    """Only light sampling finds lights without extent; both kinds of weights for the others agree beside them."""
    scene = many_lights()
    scene.add(dl.lights.point(position=(1, 3, 2), intensity=4))
    scene.add(dl.lights.spot(position=(-1, 3, 2), target=(0, 0, 0), intensity=20))
    scene.add(dl.lights.directional(direction=(0, -1, 0.2), irradiance=0.5))
    both = estimate(scene, device, spp=512, size=(8, 8), sampling="mis", seed=1, max_depth=5)
    for i, mode in enumerate(("light", "auto")):
        other = estimate(scene, device, spp=512, size=(8, 8), sampling=mode, seed=2 + i, max_depth=5)
        assert_agree(both, other, comparisons=2)


def test_hidden_boundaries_are_not_there(device):
    """Glass inside nothing that goes before it: neither paths, up to their last segment, nor shadow rays meet it."""
    empty = stage(ceiling(lamp()))
    hidden = stage(ceiling(lamp()))
    nothing = dl.materials.interface(priority=1)
    hidden.add(dl.shapes.box((-3, 0.05, -3), (3, 2.2, 2), material=nothing))
    hidden.add(dl.shapes.box((-2, 1.2, -2), (2, 1.5, 1), material=dl.materials.dielectric(priority=0)))
    for i, mode in enumerate(("bsdf", "light")):
        spp = 2048 if mode == "bsdf" else 512
        pictures = [
            estimate(scene, device, spp=spp, size=(8, 8), sampling=mode, seed=seed, max_depth=2)
            for seed, scene in ((2 * i, empty), (2 * i + 1, hidden))
        ]
        assert_agree(*pictures, comparisons=2)
