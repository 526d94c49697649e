"""glTF: which sets of texture coordinates a mesh keeps, and which one each texture reads."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from gltf_scenes import scene_with
from scene_files import QUAD_UV, Gltf, corner_image, encode_image


def texture_of(g: Gltf, folder: Path) -> int:
    return g.texture(encode_image(corner_image(), ".png", folder))


def set_of(node: Any) -> str:
    (image,) = (n for n in node.walk() if n.type == "image")
    return str(image["uv_set"])


def test_uv_set_of_the_base_colour(tmp_path: Path) -> None:
    g = Gltf()
    info = {"index": texture_of(g, tmp_path), "extensions": {"KHR_texture_transform": {"texCoord": 1}}}
    scene = scene_with(g, tmp_path, pbrMetallicRoughness={"baseColorTexture": info})
    np.testing.assert_array_equal(scene.shapes[0]["uvs"][0], [0, -1])
    assert scene.shapes[0]["second_uvs"] is None
    assert scene.notes == []


def test_two_uv_sets(tmp_path: Path) -> None:
    """The first one is the normal map's, on which tangents hang; textures say which one they read."""
    g = Gltf()
    index = texture_of(g, tmp_path)
    second, first = {"index": index, "texCoord": 1}, {"index": index}
    pbr = {"baseColorTexture": second, "metallicRoughnessTexture": first}
    look = {"emissiveTexture": second, "emissiveFactor": [1, 1, 1], "normalTexture": first}
    scene = scene_with(g, tmp_path, pbrMetallicRoughness=pbr, **look)
    shape = scene.shapes[0]
    upright = (1, -1), (0, 1)
    np.testing.assert_array_equal(shape["uvs"], QUAD_UV * upright[0] + upright[1])
    np.testing.assert_array_equal(shape["second_uvs"], QUAD_UV * 2 * upright[0] + upright[1])
    node = shape["material"]
    assert [set_of(node[name]) for name in ("base_color", "emission")] == ["second"] * 2
    assert [set_of(node[name]) for name in ("roughness", "metallic", "normal_map")] == ["first"] * 3
    assert scene.notes == []
    scene.compile()


@pytest.mark.parametrize(
    ("name", "values", "key"),
    [("anisotropy", {"anisotropyStrength": 1}, "anisotropyTexture"),
     ("clearcoat", {"clearcoatFactor": 1}, "clearcoatNormalTexture")],
)  # fmt: skip
def test_the_first_uv_set_is_where_tangents_are_needed(
    name: str, values: dict[str, Any], key: str, tmp_path: Path
) -> None:
    """The normal map goes before the others, they before the base colour."""
    for normal, first in ((0, 1), (1, -1)):
        g = Gltf()
        index = texture_of(g, tmp_path)
        other = {"index": index, "texCoord": 1}
        look: dict[str, Any] = {"normalTexture": {"index": index}} if normal else {}
        look["pbrMetallicRoughness"] = {"baseColorTexture": {"index": index}, "roughnessFactor": 0.5}
        look["extensions"] = {f"KHR_materials_{name}": {**values, key: other}}
        shape = scene_with(g, tmp_path, **look).shapes[0]
        assert (shape["uvs"][1, 0], shape["second_uvs"][1, 0]) == ((2, 1) if first > 0 else (1, 2))


def test_what_two_uv_sets_have_no_room_for_is_noted(tmp_path: Path) -> None:
    g = Gltf()
    index = texture_of(g, tmp_path)
    infos = [{"index": index, "texCoord": n} for n in range(3)]
    pbr = {"baseColorTexture": infos[0], "metallicRoughnessTexture": infos[1]}
    scene = scene_with(g, tmp_path, pbrMetallicRoughness=pbr, emissiveTexture=infos[2], emissiveFactor=[1, 1, 1])
    assert "materials[0]: its textures use 3 UV sets; TEXCOORD_0 stands for those after TEXCOORD_1" in scene.notes
    node = scene.shapes[0]["material"]
    assert [set_of(node[name]) for name in ("base_color", "roughness", "emission")] == ["first", "second", "first"]


def test_two_uv_sets_beside_vertex_colours(tmp_path: Path) -> None:
    g = Gltf()
    index = texture_of(g, tmp_path)
    pbr = {"baseColorTexture": {"index": index}, "metallicRoughnessTexture": {"index": index, "texCoord": 1}}
    scene = scene_with(g, tmp_path, color=np.ones((4, 3), np.float32), pbrMetallicRoughness=pbr)
    shape = scene.shapes[0]
    assert shape["second_uvs"] is not None
    assert shape["colors"] is not None
    assert set_of(shape["material"]["roughness"]) == "second"
    assert scene.notes == []
    scene.compile()


def test_missing_uv_set_is_noted(tmp_path: Path) -> None:
    g = Gltf()
    pbr = {"baseColorTexture": {"index": texture_of(g, tmp_path), "texCoord": 7}}
    scene = scene_with(g, tmp_path, pbrMetallicRoughness=pbr)
    assert scene.shapes[0]["uvs"] is None
    assert any("no TEXCOORD_7" in note for note in scene.notes)
