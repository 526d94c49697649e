"""glTF: which sets of texture coordinates a mesh keeps, and which one each texture reads."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from destello.geometry import mesh_arrays
from destello.io._gltf_materials import TEXTURED
from destello.tangents import kept_tangents, wanted_tangents
from gltf_scenes import loaded, scene_with
from scene_files import QUAD, QUAD_INDICES, QUAD_UV, Gltf, corner_image, encode_image


def texture_of(g: Gltf, folder: Path) -> int:
    return g.texture(encode_image(corner_image(), ".png", folder))


def set_of(node: Any) -> str:
    (image,) = (n for n in node.walk() if n.type == "image")
    return str(image["uv_set"])


def only_shape(g: Gltf, mesh: int, folder: Path) -> Any:
    g.node(mesh=mesh)
    return loaded(g, folder).shapes


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


@pytest.mark.parametrize("number", [2, 5])
def test_a_texture_of_a_third_uv_set_is_left_out(number: int, tmp_path: Path) -> None:
    """With a note: which texture, which set. Two sets of any numbers are read."""
    g = Gltf()
    index = texture_of(g, tmp_path)
    infos = [{"index": index, "texCoord": n} for n in (0, 1, number)]
    pbr = {"baseColorTexture": infos[0], "metallicRoughnessTexture": infos[1]}
    scene = scene_with(g, tmp_path, pbrMetallicRoughness=pbr, emissiveTexture=infos[2], emissiveFactor=[1, 0.5, 0])
    material = scene.shapes[0]["material"]
    assert (material["emission"], material["roughness"].type) == ((1, 0.5, 0), "scaled")
    others = "its material's other textures read TEXCOORD_0 and TEXCOORD_1; its factor alone is used"
    assert scene.notes == [f"materials[0].emissiveTexture: reads TEXCOORD_{number} where {others}"]


def test_two_sets_of_any_numbers(tmp_path: Path) -> None:
    g = Gltf()
    index = texture_of(g, tmp_path)
    sets = {f"TEXCOORD_{n}": g.accessor(QUAD_UV * (n + 1)) for n in range(4)}
    look = {
        "pbrMetallicRoughness": {"baseColorTexture": {"index": index, "texCoord": 3}},
        "emissiveTexture": {"index": index, "texCoord": 2},
        "emissiveFactor": [1, 1, 1],
    }
    mesh = g.mesh({"POSITION": g.accessor(QUAD), **sets}, g.accessor(QUAD_INDICES), material=g.add("materials", **look))
    (shape,) = only_shape(g, mesh, tmp_path)
    assert (shape["uvs"][1, 0], shape["second_uvs"][1, 0]) == (4, 3)
    assert [set_of(shape["material"][name]) for name in ("base_color", "emission")] == ["first", "second"]


GLOSSINESS = "KHR_materials_pbrSpecularGlossiness"
FACTORS: dict[str, dict[str, Any]] = {
    "pbrMetallicRoughness": {"roughnessFactor": 0.5, "metallicFactor": 0.5},
    "KHR_materials_transmission": {"transmissionFactor": 1},
    "KHR_materials_specular": {"specularFactor": 0.5},
    "KHR_materials_clearcoat": {"clearcoatFactor": 1, "clearcoatRoughnessFactor": 0.5},
    "KHR_materials_sheen": {"sheenColorFactor": [1, 1, 1], "sheenRoughnessFactor": 0.5},
    "KHR_materials_iridescence": {"iridescenceFactor": 1},
    "KHR_materials_anisotropy": {"anisotropyStrength": 0.5},
    "KHR_materials_diffuse_transmission": {"diffuseTransmissionFactor": 0.5},
    GLOSSINESS: {},
}


@pytest.mark.parametrize("number", [0, 1])
@pytest.mark.parametrize(("holder", "key"), TEXTURED)
def test_every_slot_reads_its_set(holder: str, key: str, number: int, tmp_path: Path) -> None:
    """Beside a texture of the other set, whichever of the two the mesh has for its first."""
    g = Gltf()
    index = g.texture(encode_image(np.full((3, 5, 4), 200, np.uint8), ".png", tmp_path))
    info = {"index": index, "texCoord": number}
    other = {"index": texture_of(g, tmp_path), "texCoord": 1 - number}
    look: dict[str, Any] = {"emissiveFactor": [1, 1, 1]}
    if not holder:
        look[key] = info
    elif holder.startswith("KHR"):
        look["extensions"] = {holder: {**FACTORS[holder], key: info}}
    else:
        look[holder] = {**FACTORS[holder], key: info}
    if key == "emissiveTexture":
        look["pbrMetallicRoughness"] = {"baseColorTexture": other}
    else:
        look["emissiveTexture"] = other
    scene = scene_with(g, tmp_path, **look)
    shape = scene.shapes[0]
    width = {"first": shape["uvs"][1, 0], "second": shape["second_uvs"][1, 0]}  # 1: TEXCOORD_0, 2: TEXCOORD_1
    images = [node for node in shape["material"].walk() if node.type == "image"]
    slots = [node for node in images if node["pixels"].shape[:2] == (3, 5)]
    assert slots, "the slot's texture is in use"
    assert {width[node["uv_set"]] for node in slots} == {number + 1}
    assert {width[node["uv_set"]] for node in images if node not in slots} == {2 - number}
    assert scene.notes == []
    scene.compile()


def test_directions_of_two_sets_beside_the_files_tangents(tmp_path: Path) -> None:
    """The file's tangents are the normal map's; the coat's normals by another set get tangents of that one."""
    g = Gltf()
    index = texture_of(g, tmp_path)
    coat = {"clearcoatFactor": 1, "clearcoatNormalTexture": {"index": index}}
    look = {
        "normalTexture": {"index": index, "texCoord": 1},
        "extensions": {"KHR_materials_clearcoat": coat},
    }
    attributes = {
        "POSITION": g.accessor(QUAD),
        "NORMAL": g.accessor(np.tile(np.float32([0, 0, 1]), (4, 1))),
        "TANGENT": g.accessor(np.tile(np.float32([1, 0, 0, 1]), (4, 1))),
        "TEXCOORD_0": g.accessor(np.ascontiguousarray(QUAD_UV[:, ::-1])),  # u and v exchanged
        "TEXCOORD_1": g.accessor(QUAD_UV * 2),
    }
    mesh = g.mesh(attributes, g.accessor(QUAD_INDICES), material=g.add("materials", **look))
    (shape,) = only_shape(g, mesh, tmp_path)
    assert (set_of(shape["material"]["normal_map"]), set_of(shape["material"]["geometry_coat_normal"])) == (
        "first",
        "second",
    )
    arrays = mesh_arrays(shape)
    assert wanted_tangents(arrays, shape["material"]) == ("second_tangents",)
    made = kept_tangents(arrays, ("second_tangents",))
    np.testing.assert_array_equal(made["tangents"], shape["tangents"])
    along = np.abs(made["second_tangents"][:, :3])
    np.testing.assert_allclose(along, np.tile([0, 1, 0], (4, 1)), atol=1e-6)


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
