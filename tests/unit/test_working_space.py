"""The working space: inputs are brought into it, and the picture comes back as Rec.709."""

from __future__ import annotations

import numpy as np
import pytest

import destello as dl
from destello import metals
from destello.color_spaces import converted

GREEN = (0.1, 0.7, 0.05)


def seen(scene: dl.Scene, **options) -> np.ndarray:
    """The colour in the middle of a picture."""
    image = dl.render(scene, size=(8, 8), spp=16, device="cpu", progress=False, **options)
    return image.array[3:5, 3:5].mean(axis=(0, 1))


def lit(reflectance, radiance=(1, 1, 1), depth=2) -> dl.Scene:
    """A wall under an even sky; with a depth of 2 it shows reflectance times radiance."""
    scene = dl.Scene()
    scene.render.max_depth = depth
    scene.camera = dl.cameras.perspective(origin=(0, 0, 2), target=(0, 0, 0), vfov=20)
    scene.environment = dl.environments.constant(radiance=radiance)
    wall = dl.materials.diffuse(reflectance=reflectance)
    scene.add(dl.shapes.quad(corner=(-1, -1, 0), u=(2, 0, 0), v=(0, 2, 0), material=wall))
    return scene


def test_colours_come_back_as_they_were():
    """One reflection of white light, or a light alone, is linear: the matrices there and back cancel."""
    for scene in (lit(GREEN), lit((1, 1, 1), GREEN)):
        np.testing.assert_allclose(seen(scene, working_space="acescg"), seen(scene), rtol=2e-3, atol=1e-4)


def test_products_are_those_of_the_working_space():
    scene = lit(GREEN, (0.2, 1.0, 0.3))
    aces = converted(GREEN, "rec709", "acescg") * converted((0.2, 1.0, 0.3), "rec709", "acescg")
    expected = converted(aces, "acescg", "rec709")
    found = seen(scene, working_space="acescg")
    np.testing.assert_allclose(found, expected, rtol=5e-3, atol=1e-3)
    assert np.abs(found - seen(scene)).max() > 0.02


@pytest.mark.parametrize("kind", ["srgb", "acescg", "vertex", "checker", "scaled"])
def test_textures_and_vertex_colours(kind):
    texels = np.full((2, 2, 3), GREEN, np.float32)
    if kind == "srgb":
        stored = np.rint(255 * dl.color.encode(texels)).astype(np.uint8)
        texture, expected = dl.textures.image(stored), dl.color.decode(stored[0, 0] / np.float32(255))
    elif kind == "acescg":
        texture, expected = dl.textures.image(converted(texels, "rec709", "acescg"), color_space="acescg"), GREEN
    elif kind == "scaled":
        texture, expected = dl.textures.scaled(dl.textures.image(np.ones((2, 2, 3), np.float32)), scale=GREEN), GREEN
    elif kind == "checker":
        texture, expected = dl.textures.checker(even=GREEN, odd=GREEN), GREEN
    else:
        texture, expected = dl.textures.vertex_color(), GREEN
    scene = lit(texture)
    if kind == "vertex":
        positions = np.array([[-1, -1, 0], [1, -1, 0], [0, 2, 0]], np.float32)
        scene.shapes[0] = dl.shapes.mesh(
            positions=positions, indices=[[0, 1, 2]], colors=[GREEN] * 3, material=scene.shapes[0]["material"]
        )
    for working in ("rec709", "acescg"):
        np.testing.assert_allclose(seen(scene, working_space=working), expected, rtol=3e-3, atol=1e-3)


def test_numbers_are_not_colours():
    """The same texture as a roughness is not touched."""
    texture = dl.textures.image(np.full((2, 2, 3), GREEN, np.float32))
    smooth = dl.textures.scaled(texture, channel="b")
    scene = lit(0.5)
    scene.shapes[0] = scene.shapes[0].replace(material=dl.materials.conductor(reflectance=0.5, roughness=smooth))
    np.testing.assert_array_equal(seen(scene, working_space="acescg"), seen(scene))


@pytest.mark.parametrize("name", ["gold", "copper", "iron"])
def test_metals_keep_their_colour(name):
    """Their indices are those of Rec.709's channels: in another space they reflect the same colour."""
    scene = lit(0.5)
    scene.shapes[0] = scene.shapes[0].replace(material=dl.materials.metal(name))
    plain = seen(scene)
    np.testing.assert_allclose(seen(scene, working_space="acescg"), plain, atol=0.005)
    np.testing.assert_allclose(plain, metals.color(name), atol=0.005)


def test_images_of_environments():
    sky = np.full((4, 8, 3), GREEN, np.float32)
    scene = lit(1.0)
    for space, texels in (("linear", sky), ("acescg", converted(sky, "rec709", "acescg"))):
        scene.environment = dl.environments.image(image=dl.textures.image(texels, color_space=space))
        for working in ("rec709", "acescg"):
            np.testing.assert_allclose(seen(scene, working_space=working), GREEN, rtol=5e-3, atol=1e-3)


def test_images_of_8_bits_are_srgb_in_environments_too():
    scene = lit(1.0)
    scene.environment = dl.environments.image(image=np.full((4, 8, 3), 188, np.uint8))
    np.testing.assert_allclose(seen(scene), 0.5029, rtol=5e-3)


def test_defaults_are_colours_too():
    scene = lit(1.0)
    scene.shapes.clear()
    scene.environment = dl.environments.gradient()  # white to (0.5, 0.7, 1)
    np.testing.assert_allclose(seen(scene, working_space="acescg"), seen(scene), rtol=1e-4)
    assert np.ptp(seen(scene)) > 0.1


@pytest.mark.parametrize("kind", ["dielectric", "openpbr"])
@pytest.mark.parametrize("way", [0.5, 1.0])
def test_absorption_keeps_its_colour(kind, way):
    """What is left of white light behind a slab, by rates or by a colour at a depth, near which both are the same."""
    left = np.array((0.3, 0.7, 0.4))
    if kind == "dielectric":
        inside = dl.materials.dielectric(ior=1, medium_absorption=-np.log(left))
    else:
        glass = {"specular_ior": 1, "specular_roughness": 0, "transmission_weight": 1}
        inside = dl.materials.openpbr(**glass, transmission_color=left, transmission_depth=1)
    scene = lit(1.0, depth=8)
    scene.shapes[0] = dl.shapes.box(min=(-2, -2, -way), max=(2, 2, 0), material=inside)
    np.testing.assert_allclose(seen(scene), left**way, rtol=2e-3)
    np.testing.assert_allclose(seen(scene, working_space="acescg"), left**way, atol=0.035)


def test_albedo_comes_back():
    image = dl.render(lit(GREEN), size=(8, 8), spp=4, progress=False, aov="albedo", working_space="acescg")
    np.testing.assert_allclose(image.aovs["albedo"][4, 4], GREEN, rtol=1e-3, atol=1e-4)


def test_films_of_other_spaces_do_not_mix(tmp_path):
    scene = lit(0.5)
    dl.render(scene, size=(4, 4), spp=2, progress=False, resume=tmp_path / "a.film")
    with pytest.raises(dl.InputError, match="working_space"):
        dl.render(scene, size=(4, 4), spp=4, progress=False, resume=tmp_path / "a.film", working_space="acescg")


def test_what_the_core_knows_in_rec709_alone_is_said():
    scene = lit(0.5)
    scene.shapes[0] = scene.shapes[0].replace(material=dl.materials.dielectric(abbe=30))
    image = dl.render(scene, size=(4, 4), spp=1, progress=False, working_space="acescg")
    assert any("dielectric" in note and "Rec.709" in note for note in image.metadata["notes"])


def test_unknown_space():
    with pytest.raises(dl.SceneError, match="working_space: unknown choice: 'rec2020'"):
        dl.render("cornell", working_space="rec2020")
