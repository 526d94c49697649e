"""A second set of texture coordinates: images that read it, seen by the camera and by lights; what is wrong with it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import destello as dl
from destello.errors import SceneError
from destello.live import LiveScene
from scene_files import write_image

CORNERS = np.float32([(0, 0, 0), (2, 0, 0), (2, 1, 0), (0, 1, 0)])
FIRST = np.float32([(0, 0), (1, 0), (1, 1), (0, 1)])
SECOND = np.float32([(1, 1), (0, 1), (0, 0), (1, 0)])  # half a turn
IMAGE = np.float32([[(1, 0, 0), (0, 1, 0)], [(0, 0, 1), (0.5, 0.5, 0.5)]])


def image(uv_set: str, **more: Any) -> Any:
    return dl.textures.image(IMAGE, color_space="linear", filter="nearest", uv_set=uv_set, **more)


def sheet(material: Any, **more: Any) -> Any:
    arrays = {"uvs": FIRST, "second_uvs": SECOND, **more}
    return dl.shapes.mesh(CORNERS, [(0, 1, 2), (0, 2, 3)], material=material, **arrays)


def scene_of(shape: Any, working_space: str = "rec709") -> dl.Scene:
    scene = dl.Scene("sheet")
    scene.add(shape)
    scene.camera = dl.cameras.orthographic(origin=(1, 0.5, 3), target=(1, 0.5, 0), height=1)
    scene.render.working_space = working_space
    return scene


def seen(scene: dl.Scene, device: str) -> np.ndarray:
    """The middles of the picture's four quarters."""
    array = dl.render(scene, spp=4, size=(16, 8), device=device, progress=False).array
    return np.asarray(array.reshape(2, 4, 2, 8, 3)[:, 1:3, :, 2:6].mean(axis=(1, 3)))


@pytest.mark.parametrize("working_space", ["rec709", "acescg"])
def test_each_image_reads_its_set(working_space: str, device: str) -> None:
    for name, want in (("first", IMAGE), ("second", IMAGE[::-1, ::-1])):
        glow = dl.materials.emissive(radiance=image(name), two_sided=True)
        np.testing.assert_allclose(seen(scene_of(sheet(glow), working_space), device), want, atol=2e-3)


def test_transforms_and_tiles(tmp_path: Path, device: str) -> None:
    shifted = dl.materials.emissive(radiance=image("second", uv_offset=(0.5, 0)), two_sided=True)
    np.testing.assert_allclose(seen(scene_of(sheet(shifted)), device), IMAGE[::-1], atol=2e-3)
    for number, value in ((1001, 0.25), (1002, 0.75)):
        write_image(tmp_path / f"t.{number}.exr", np.full((4, 4, 3), value, np.float32))
    tiles = dl.textures.image("t.<UDIM>.exr", color_space="linear", uv_set="second")
    wide = sheet(dl.materials.emissive(radiance=tiles, two_sided=True), second_uvs=SECOND * np.float32((2, 1)))
    scene = scene_of(wide)
    scene.base_dir = tmp_path
    np.testing.assert_allclose(seen(scene, device)[0, :, 0], [0.75, 0.25], atol=1e-3)


def test_light_sampling_sees_the_same_emission(device: str) -> None:
    """A wall beside a lamp whose image is of the second set: paths and light sampling agree, and not mirrored."""
    half = np.zeros((1, 2, 3), np.float32)
    half[0, 0] = 5
    lamp = dl.textures.image(half, color_space="linear", filter="nearest", uv_set="second")
    scene = scene_of(sheet(dl.materials.emissive(radiance=lamp, two_sided=True)))
    white = dl.materials.diffuse(reflectance=0.8)
    scene.add(dl.shapes.quad((0, 0, -0.5), (2, 0, 0), (0, 1, 0), material=white))
    scene.camera = dl.cameras.orthographic(origin=(1, 0.5, -0.1), target=(1, 0.5, -0.4), height=1)
    found = []
    for sampling in ("bsdf", "light"):
        scene.render.light_sampling = sampling
        array = dl.render(scene, spp=4096, size=(2, 1), device=device, progress=False, seed=3).array
        found.append(array[0, :, 0])
    np.testing.assert_allclose(found[0], found[1], rtol=0.03)
    assert max(found[0]) > 1.5 * min(found[0])


def test_vertex_colours_beside_it(device: str) -> None:
    """Each in its place: a texture of the second set times the colours, in mixtures too."""
    colors = np.float32([(1, 0.5, 0.25, 1)]).repeat(4, 0)
    tinted = dl.textures.scaled(image("second"), vertex_color=True)
    for radiance, want in ((tinted, IMAGE[::-1, ::-1] * colors[0, :3]), (image("first"), IMAGE)):
        glow = dl.materials.emissive(radiance=radiance, two_sided=True)
        np.testing.assert_allclose(seen(scene_of(sheet(glow, colors=colors)), device), want, atol=2e-3)


def smooth(size: int = 256) -> np.ndarray:
    """A picture of much detail whose mean differs from place to place (size, size, 1)."""
    y, x = np.mgrid[0:size, 0:size] / size
    noise = np.random.default_rng(5).random((size, size))
    return (0.1 + 0.2 * x + 0.1 * y + 0.6 * noise).astype(np.float32)[..., None]


@pytest.mark.parametrize("scale", [(1, 1), (3, 0.5)])
def test_mip_maps_are_those_of_the_same_uvs_as_first_set(scale: tuple[float, float], device: str) -> None:
    """Seen from afar: an image of the second set is filtered as if that set were the first, whatever the first is."""
    pictures = []
    for second in (False, True):
        options = {"uv_set": "second"} if second else {}
        texture = dl.textures.image(smooth(), color_space="linear", **options)
        arrays = {"uvs": FIRST * np.float32(scale), "second_uvs": SECOND} if second else {"uvs": SECOND}
        white = dl.materials.diffuse(reflectance=texture)
        scene = scene_of(dl.shapes.mesh(CORNERS, [(0, 1, 2), (0, 2, 3)], material=white, **arrays))
        scene.environment = dl.environments.constant(radiance=1)
        scene.render.max_depth = 2
        pictures.append(dl.render(scene, spp=1, size=(16, 8), device=device, progress=False, seed=2).array)
    np.testing.assert_allclose(*pictures, rtol=2e-4)
    sharp = dl.textures.image(smooth(), color_space="linear", mip_maps=False)
    scene = scene_of(sheet(dl.materials.diffuse(reflectance=sharp), uvs=SECOND))
    scene.environment = dl.environments.constant(radiance=1)
    scene.render.max_depth = 2
    without = dl.render(scene, spp=1, size=(16, 8), device=device, progress=False, seed=2).array
    assert np.abs(without - pictures[1]).max() > 0.1  # there is something to filter


def test_bump_maps_read_it(device: str) -> None:
    """Slopes are those that the same coordinates give as the first set: turned, stretched, under a moved image."""
    y, x = np.mgrid[0:32, 0:32] / 32
    heights = (0.02 * np.sin(7 * x + 3) * np.cos(5 * y)).astype(np.float32)[..., None]
    turned = SECOND @ np.float32([(0.8, 0.6), (-1.2, 1.6)])
    pictures = []
    for options, arrays in (({}, {"uvs": turned}), ({"uv_set": "second"}, {"uvs": FIRST, "second_uvs": turned})):
        bump = dl.textures.image(heights, color_space="linear", uv_scale=(0.5, 0.7), wrap_u="mirror", **options)
        matt = dl.materials.diffuse(reflectance=0.8, bump=bump)
        scene = scene_of(dl.shapes.mesh(CORNERS, [(0, 1, 2), (0, 2, 3)], material=matt, **arrays))
        scene.add(dl.lights.point(position=(0.5, 0.2, 1), intensity=1))
        pictures.append(dl.render(scene, spp=4, size=(16, 8), device=device, progress=False, seed=2).array)
    np.testing.assert_allclose(*pictures, rtol=1e-3)
    assert pictures[0].std() > 0.01


def test_what_is_wrong_with_it() -> None:
    second = dl.materials.diffuse(reflectance=image("second"))
    mixed = dl.textures.checker_uv(even=image("second"), odd=image("first"))
    for shape, said in (
        (sheet(second, second_uvs=None), r"shapes\[0\]\.material: an image of the second uv set.*uv_set: first"),
        (dl.shapes.quad((0, 0, 0), (1, 0, 0), (0, 1, 0), material=second), "an image of the second uv set"),
        (dl.shapes.sphere((0, 0, 0), 1, material=second), "an image of the second uv set"),
        (sheet(dl.materials.diffuse(normal_map=mixed)), r"material\.normal_map: directions by two uv sets"),
        (sheet(dl.materials.openpbr(geometry_coat_normal=image("first"), geometry_coat_tangent=image("second"))),
         r"geometry_coat_normal: directions by two uv sets"),
        (sheet(second, second_uvs=SECOND[:3]), "3 second_uvs for 4 vertices"),
        (sheet(second, second_uvs=SECOND * np.nan), "not a finite number"),
    ):  # fmt: skip
        with pytest.raises(SceneError, match=said):
            scene_of(shape).compile()
    scene_of(sheet(dl.materials.diffuse(bump=mixed))).compile()  # heights may
    with pytest.raises(SceneError, match="uv_set: unknown choice"):
        image("third")


def test_edited_materials_are_checked_too(device: str) -> None:
    scene = scene_of(sheet(dl.materials.diffuse(), second_uvs=None))
    live = LiveScene(scene, device)
    with pytest.raises(SceneError, match="an image of the second uv set"):
        live.set_material(scene.shapes[0], dl.materials.diffuse(reflectance=image("second")))


def test_files_keep_it(tmp_path: Path) -> None:
    scene = scene_of(sheet(dl.materials.diffuse(reflectance=image("second"))))
    scene.save(tmp_path / "s.yaml")
    again = dl.load(tmp_path / "s.yaml")
    assert again == scene
    assert again.compile().fingerprint == scene.compile().fingerprint
