"""Normal and tangent maps whose image is turned or mirrored on the surface: their directions go with it.

The same picture lies on a square once by the image's own transform, once by texture coordinates that have it already.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import destello as dl
from gltf_scenes import scene_with
from scene_files import Gltf, encode_image, write_image

SQUARE = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]], np.float32)
UV = np.array([[0, 0], [1, 0], [1, 1], [0, 1]], np.float32)
RNG = np.random.default_rng(5)
NORMALS = np.concatenate([0.3 + 0.4 * RNG.random((8, 8, 2)), np.ones((8, 8, 1))], 2).astype(np.float32)
TURNS = np.concatenate([RNG.random((8, 8, 2)), np.zeros((8, 8, 1))], 2).astype(np.float32)
COATED = {"coat_weight": 1.0, "coat_roughness": 0.3, "base_color": 0.2, "specular_weight": 0.0}
PLACES = [((1, 1), 90), ((1, 1), 180), ((1, 1), -90), ((1, 1), 30), ((-1, 1), 0), ((2, -2), 0), ((-1, -1), 135)]


def picture(material: Any, uvs: Any, device: str) -> np.ndarray:
    scene = dl.Scene()
    up = np.tile(np.array([[0, 0, 1]], np.float32), (4, 1))
    triangles = np.array([[0, 1, 2], [0, 2, 3]], np.uint32)
    scene.add(dl.shapes.mesh(SQUARE, triangles, uvs=uvs, normals=up, material=material))
    scene.camera = dl.cameras.orthographic(origin=(0, 0, 3), target=(0, 0, 0), height=2)
    scene.add(dl.lights.point(position=(0.7, 0.5, 1.5), intensity=2))
    scene.render.max_depth = 2  # from the lamp alone: nothing depends on directions that are drawn
    return np.asarray(dl.render(scene, spp=4, size=(24, 24), device=device, progress=False, seed=2).array)


def look(name: str, dtype: type = np.float32, **place: Any) -> Any:
    def image(texels: Any) -> Any:
        stored = texels if dtype is np.float32 else np.rint(texels * np.iinfo(dtype).max).astype(dtype)
        return dl.textures.image(stored, **place)

    if name == "normals":
        return dl.materials.diffuse(normal_map=image(NORMALS))
    if name == "turns":
        return dl.materials.conductor(roughness=0.4, anisotropy=0.8, tangent_map=image(TURNS))
    turns = {"coat_roughness_anisotropy": 0.9, "geometry_coat_tangent": image(TURNS)}
    return dl.materials.openpbr(**COATED, geometry_coat_normal=image(NORMALS), **turns)


def placed(uvs: Any, scale: tuple[float, float], degrees: float) -> Any:
    c, s = math.cos(math.radians(degrees)), math.sin(math.radians(degrees))
    return (uvs * scale @ np.array([[c, s], [-s, c]])).astype(np.float32)


@pytest.mark.parametrize(("scale", "degrees"), PLACES)
@pytest.mark.parametrize("name", ["normals", "turns", "coat"])
def test_directions_turn_with_their_image(name: str, scale: tuple[float, float], degrees: float, device: str) -> None:
    found = picture(look(name, uv_scale=scale, uv_rotation=degrees), UV, device)
    expected = picture(look(name), placed(UV, scale, degrees), device)
    np.testing.assert_allclose(found, expected, rtol=2e-3, atol=1e-3)


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
@pytest.mark.parametrize("degrees", [90.0000025, 40])
def test_integer_texels(degrees: float, dtype: type, device: str) -> None:
    """Files have right angles as rounded radians."""
    found = picture(look("normals", dtype, uv_rotation=degrees), UV, device)
    expected = picture(look("normals", dtype), placed(UV, (1, 1), degrees), device)
    np.testing.assert_allclose(found, expected, rtol=5e-3, atol=1e-3)


def test_tiles(tmp_path: Path, device: str) -> None:
    write_image(tmp_path / "n.1001.exr", NORMALS)
    place = {"uv_rotation": 90, "uv_offset": (1, 0)}
    material = dl.materials.diffuse(normal_map=dl.textures.image(str(tmp_path / "n.<UDIM>.exr"), **place))
    expected = picture(look("normals", wrap_u="clamp", wrap_v="clamp", **place), UV, device)
    np.testing.assert_allclose(picture(material, UV, device), expected, rtol=2e-3, atol=1e-3)


def test_the_same_image_as_a_colour_stays(device: str) -> None:
    turned = dl.textures.image(NORMALS, uv_rotation=90)
    alone = picture(dl.materials.diffuse(reflectance=turned), UV, device)
    map_too = dl.materials.diffuse(reflectance=turned, normal_map=turned, normal_scale=0)
    np.testing.assert_allclose(picture(map_too, UV, device), alone, rtol=1e-5)


def test_gltf_texture_transform(tmp_path: Path, device: str) -> None:
    """KHR_texture_transform on a normal map, as the Khronos sample renderer has it since December 2024."""
    lit = {}
    for angle in (0.0, math.pi / 2):
        g = Gltf()
        g.extend("KHR_texture_transform")
        slope = np.full((2, 2, 3), (200, 128, 230), np.uint8)  # falls along u
        info = {"index": g.texture(encode_image(slope, ".png", tmp_path))}
        info["extensions"] = {"KHR_texture_transform": {"rotation": angle}}
        scene = scene_with(g, tmp_path, normalTexture=info, pbrMetallicRoughness={"metallicFactor": 0})
        scene.camera = dl.cameras.perspective(origin=(0, 0, 3), target=(0, 0, 0), vfov=20)
        for side in ((1, 0, 1), (-1, 0, 1), (0, 1, 1), (0, -1, 1)):
            scene.lights[:] = [dl.lights.directional(direction=tuple(-x for x in side))]
            made = dl.render(scene, spp=4, size=(8, 8), device=device, progress=False)
            lit[angle, side[:2]] = made.array.mean()
    assert lit[0.0, (1, 0)] > 1.3 * lit[0.0, (0, 1)] > 1.3 * lit[0.0, (-1, 0)]
    # The image lies turned clockwise by 90 degrees (u' grows with -v, seen with v upwards): what faced +x faces -y.
    assert lit[math.pi / 2, (0, -1)] == pytest.approx(lit[0.0, (1, 0)], rel=0.02)
    assert lit[math.pi / 2, (0, 1)] == pytest.approx(lit[0.0, (-1, 0)], rel=0.02)
