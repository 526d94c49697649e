"""glTF: materials and textures."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import destello as dl
from destello.image_table import uv_transform
from destello.io import gltf, load
from gltf_scenes import BARE, material_of, scene_with
from scene_files import QUAD_UV, Gltf, corner_image, encode_image


def texture_of(g: Gltf, folder: Path, **sampler: Any) -> int:
    return g.texture(encode_image(corner_image(), ".png", folder), **sampler)


# --- factors ----------------------------------------------------------------------------------------------------------


def test_default_material(tmp_path: Path) -> None:
    g = Gltf()
    g.node(mesh=g.quad())
    node = gltf.load(g.glb(tmp_path), BARE).shapes[0]["material"]
    assert node.type == "metallic_roughness"
    assert (node["base_color"], node["metallic"], node["roughness"], node["opacity"]) == ((1, 1, 1), 1, 1, 1)


def test_factors(tmp_path: Path) -> None:
    node = material_of(
        Gltf(),
        tmp_path,
        name="Brass",
        pbrMetallicRoughness={"baseColorFactor": [0.1, 0.2, 0.3, 0.4], "metallicFactor": 0.5, "roughnessFactor": 0.25},
        emissiveFactor=[0, 0.5, 1],
        doubleSided=True,
    )
    assert node.name == "Brass"
    assert (node["base_color"], node["metallic"], node["roughness"]) == ((0.1, 0.2, 0.3), 0.5, 0.25)
    assert (node["emission"], node["emission_two_sided"]) == ((0, 0.5, 1), True)
    assert (node["opacity"], node["opacity_cutoff"]) == (1, 0)  # OPAQUE: alpha does not count


def test_emissive_strength_ior_specular_transmission(tmp_path: Path) -> None:
    node = material_of(
        Gltf(),
        tmp_path,
        emissiveFactor=[1, 0.5, 0],
        extensions={
            "KHR_materials_emissive_strength": {"emissiveStrength": 20},
            "KHR_materials_ior": {"ior": 1.33},
            "KHR_materials_transmission": {"transmissionFactor": 0.75},
            "KHR_materials_specular": {"specularFactor": 0.5, "specularColorFactor": [1, 0.9, 0.8]},
        },
    )
    assert (node["emission"], node["emission_two_sided"]) == ((20, 10, 0), False)
    assert (node["ior"], node["transmission"]) == (1.33, 0.75)
    assert (node["specular"], node["specular_color"]) == (0.5, (1, 0.9, 0.8))


def test_unlit_is_emission_alone(tmp_path: Path) -> None:
    node = material_of(
        Gltf(),
        tmp_path,
        pbrMetallicRoughness={"baseColorFactor": [0.1, 0.2, 0.3, 1]},
        emissiveFactor=[9, 9, 9],
        extensions={"KHR_materials_unlit": {}},
    )
    assert (node.type, node["radiance"], node["two_sided"]) == ("emissive", (0.1, 0.2, 0.3), True)


def test_volume_is_a_body_of_glass(tmp_path: Path) -> None:
    node = material_of(
        Gltf(),
        tmp_path,
        pbrMetallicRoughness={"metallicFactor": 0, "roughnessFactor": 0.1, "baseColorFactor": [1, 0.9, 0.8, 1]},
        extensions={
            "KHR_materials_transmission": {"transmissionFactor": 1},
            "KHR_materials_volume": {
                "thicknessFactor": 1,
                "attenuationColor": [0.5, 1, 0.25],
                "attenuationDistance": 2,
            },
            "KHR_materials_dispersion": {"dispersion": 0.5},
        },
    )
    assert (node.type, node["ior"], node["roughness"], node["tint"]) == ("dielectric", 1.5, 0.1, (1, 0.9, 0.8))
    np.testing.assert_allclose(node["medium_absorption"], [math.log(2) / 2, 0, math.log(4) / 2])
    assert node["abbe"] == 40


def test_partly_transmissive_volume_is_a_mix(tmp_path: Path) -> None:
    node = material_of(
        Gltf(),
        tmp_path,
        pbrMetallicRoughness={"metallicFactor": 0.5},
        extensions={
            "KHR_materials_transmission": {"transmissionFactor": 0.5},
            "KHR_materials_volume": {"thicknessFactor": 1},
        },
    )
    assert (node.type, node["amount"]) == ("mix", 0.25)
    assert (node["first"].type, node["second"].type) == ("metallic_roughness", "dielectric")
    assert node["first"]["transmission"] == 0


def test_metal_beside_glass_stays_metal(tmp_path: Path) -> None:
    """A jar with its lid in one material: where the texture says metal, nothing is transmitted."""
    g = Gltf()
    index = g.texture(encode_image(np.full((2, 2, 3), 255, np.uint8), ".png", tmp_path))
    extensions = {
        "KHR_materials_transmission": {"transmissionFactor": 1},
        "KHR_materials_volume": {"thicknessFactor": 1},
    }
    pbr = {"metallicRoughnessTexture": {"index": index}}
    node = material_of(g, tmp_path, pbrMetallicRoughness=pbr, extensions=extensions)
    assert (node.type, node["first"].type, node["second"].type) == ("mix", "mix", "metallic_roughness")
    assert (node["amount"]["channel"], node["first"]["amount"]) == ("b", 1)
    jar = dl.Scene()
    jar.environment = dl.environments.gradient()
    jar.add(dl.shapes.quad(corner=(-1, -1, 0), u=(2, 0, 0), v=(0, 2, 0), material=node))
    lid = jar.copy()
    lid.shapes[0] = lid.shapes[0].replace(material=node["second"])
    a, b = (dl.render(s, size=(8, 8), spp=64, device="cpu", progress=False).array for s in (jar, lid))
    np.testing.assert_allclose(a.mean(), b.mean(), rtol=0.02)


# --- alpha ------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("mode", "alpha", "cutoff", "opacity"),
    [
        ("BLEND", 0.25, None, 0.25),
        ("MASK", 0.6, None, 1),
        ("MASK", 0.4, None, 0),
        ("MASK", 0.4, 0.4, 1),
        ("MASK", 0, 0, 1),
    ],
)
def test_constant_alpha(mode: str, alpha: float, cutoff: float | None, opacity: float, tmp_path: Path) -> None:
    extra = {} if cutoff is None else {"alphaCutoff": cutoff}
    factor = {"baseColorFactor": [1, 1, 1, alpha]}
    node = material_of(Gltf(), tmp_path, pbrMetallicRoughness=factor, alphaMode=mode, **extra)
    assert (node["opacity"], node["opacity_cutoff"]) == (opacity, 0)


@pytest.mark.parametrize(("mode", "cutoff"), [("BLEND", 0.0), ("MASK", 0.5)])
def test_alpha_of_the_texture(mode: str, cutoff: float, tmp_path: Path) -> None:
    g = Gltf()
    pbr = {"baseColorFactor": [1, 1, 1, 0.5], "baseColorTexture": {"index": texture_of(g, tmp_path)}}
    node = material_of(g, tmp_path, pbrMetallicRoughness=pbr, alphaMode=mode)
    opacity = node["opacity"]
    assert (opacity.type, opacity["channel"], opacity["scale"]) == ("scaled", "a", (0.5, 0.5, 0.5))
    assert opacity["texture"].type == "image"
    assert node["opacity_cutoff"] == cutoff
    assert node["base_color"].type == "image"


def test_vertex_colours_multiply_base_colour_and_alpha(tmp_path: Path) -> None:
    color = np.full((4, 4), 0.5, np.float32)
    plain = scene_with(Gltf(), tmp_path, color=color, pbrMetallicRoughness={"baseColorFactor": [1, 0.5, 1, 1]})
    base = plain.shapes[0]["material"]["base_color"]
    assert (base.type, base["scale"]) == ("vertex_color", (1, 0.5, 1))
    g = Gltf()
    pbr = {"baseColorTexture": {"index": texture_of(g, tmp_path)}}
    node = scene_with(g, tmp_path, color=color, pbrMetallicRoughness=pbr, alphaMode="BLEND").shapes[0]["material"]
    assert (node["base_color"].type, node["base_color"]["vertex_color"]) == ("scaled", True)
    assert (node["opacity"]["channel"], node["opacity"]["vertex_color"]) == ("a", True)


# --- textures ---------------------------------------------------------------------------------------------------------


def test_texture_slots(tmp_path: Path) -> None:
    g = Gltf()
    index = texture_of(g, tmp_path)
    node = material_of(
        g,
        tmp_path,
        pbrMetallicRoughness={
            "baseColorTexture": {"index": index},
            "baseColorFactor": [0.5, 1, 1, 1],
            "metallicRoughnessTexture": {"index": index},
            "roughnessFactor": 0.5,
        },
        normalTexture={"index": index, "scale": 0.25},
        emissiveTexture={"index": index},
        emissiveFactor=[1, 1, 1],
        occlusionTexture={"index": index},
    )
    base, metallic, rough = node["base_color"], node["metallic"], node["roughness"]
    assert (base["scale"], base["texture"]["color_space"]) == ((0.5, 1, 1), "srgb")
    assert (metallic["channel"], metallic["scale"], metallic["texture"]["color_space"]) == ("b", (1, 1, 1), "linear")
    assert (rough["channel"], rough["scale"]) == ("g", (0.5, 0.5, 0.5))
    assert (node["normal_map"]["color_space"], node["normal_scale"]) == ("linear", 0.25)
    assert node["emission"]["color_space"] == "srgb"
    np.testing.assert_array_equal(node["emission"]["pixels"], corner_image())
    pixels = [texture["pixels"] for texture in (base["texture"], metallic["texture"], node["emission"])]
    assert all(np.shares_memory(pixels[0], other) for other in pixels)  # decoded once


def test_factor_zero_needs_no_texture(tmp_path: Path) -> None:
    g = Gltf()
    pbr = {"metallicRoughnessTexture": {"index": texture_of(g, tmp_path)}, "metallicFactor": 0}
    node = material_of(g, tmp_path, pbrMetallicRoughness=pbr, emissiveTexture={"index": 0})
    assert node["metallic"] == 0
    assert node["emission"] == (0, 0, 0)


def test_samplers(tmp_path: Path) -> None:
    g = Gltf()
    texture = texture_of(g, tmp_path, wrapS=33071, wrapT=33648, magFilter=9728, minFilter=9987)
    image = material_of(g, tmp_path, pbrMetallicRoughness={"baseColorTexture": {"index": texture}})["base_color"]
    assert (image["wrap_u"], image["wrap_v"], image["filter"]) == ("clamp", "mirror", "nearest")
    g = Gltf()
    image = material_of(g, tmp_path, pbrMetallicRoughness={"baseColorTexture": {"index": texture_of(g, tmp_path)}})
    assert [image["base_color"][key] for key in ("wrap_u", "wrap_v", "filter")] == ["repeat", "repeat", "bilinear"]


@pytest.mark.parametrize(
    "transform",
    [
        {"offset": [0.25, -0.5]},
        {"rotation": math.pi / 2},
        {"scale": [2, 3]},
        {"offset": [0, 1], "rotation": math.pi / 2, "scale": [0.5, 0.5]},
        {"offset": [0.1, 0.2], "rotation": 0.7, "scale": [2, -3]},
    ],
)
def test_texture_transform(transform: dict[str, Any], tmp_path: Path) -> None:
    """Against the extension's formula in glTF's own coordinates, v from the top."""
    g = Gltf()
    info = {"index": texture_of(g, tmp_path), "extensions": {"KHR_texture_transform": transform}}
    shape = scene_with(g, tmp_path, pbrMetallicRoughness={"baseColorTexture": info}).shapes[0]
    (su, sv), (ou, ov) = transform.get("scale", [1, 1]), transform.get("offset", [0, 0])
    angle = transform.get("rotation", 0)
    c, s = math.cos(angle), math.sin(angle)
    there = QUAD_UV * (su, sv) @ np.array([[c, s], [-s, c]]).T + (ou, ov)
    ours = np.array(uv_transform(shape["material"]["base_color"]))
    here = shape["uvs"] @ ours[:, :2].T + ours[:, 2]
    np.testing.assert_allclose(here, np.stack([there[:, 0], 1 - there[:, 1]], axis=1), atol=1e-6)


def test_texture_transform_takes_the_quarter_that_the_extension_names(tmp_path: Path) -> None:
    """Its example: "utilizes only the lower left quadrant of the source image, rotated clockwise 90 degrees"."""
    g = Gltf()
    transform = {"offset": [0, 1], "rotation": 1.57079632679, "scale": [0.5, 0.5]}
    info = {"index": texture_of(g, tmp_path), "extensions": {"KHR_texture_transform": transform}}
    shape = scene_with(g, tmp_path, pbrMetallicRoughness={"baseColorTexture": info}).shapes[0]
    ours = np.array(uv_transform(shape["material"]["base_color"]))
    here = shape["uvs"] @ ours[:, :2].T + ours[:, 2]
    np.testing.assert_allclose(here.min(0), [0, 0], atol=1e-6)  # v = 0 is the bottom
    np.testing.assert_allclose(here.max(0), [0.5, 0.5], atol=1e-6)


@pytest.mark.parametrize(
    ("sampler", "nearest"),
    [
        ({"magFilter": 9728, "minFilter": 9987}, True),
        ({"minFilter": 9728}, True),
        ({"minFilter": 9986}, True),
        ({"minFilter": 9987}, False),
        ({"magFilter": 9729, "minFilter": 9984}, False),
    ],
)
def test_filters(sampler: dict[str, int], nearest: bool, tmp_path: Path) -> None:
    """Near and far are looked up alike; a file that wants single texels from afar alone is told so."""
    g = Gltf()
    pbr = {"baseColorTexture": {"index": texture_of(g, tmp_path, **sampler)}}
    scene = scene_with(g, tmp_path, pbrMetallicRoughness=pbr)
    assert scene.shapes[0]["material"]["base_color"]["filter"] == ("nearest" if nearest else "bilinear")
    told = "magFilter" in sampler and not nearest
    assert [note for note in scene.notes if "minFilter" in note] == scene.notes[: int(told)]


def test_what_has_no_place_in_a_path_tracer_is_said_once(tmp_path: Path) -> None:
    g = Gltf()
    index = texture_of(g, tmp_path)
    volume = {"thicknessFactor": 1, "thicknessTexture": {"index": index}}
    for _ in range(2):
        g.add("materials", occlusionTexture={"index": index}, extensions={"KHR_materials_volume": volume})
    lamp = {"type": "point", "range": 3}
    g.extend("KHR_lights_punctual", lights=[lamp, {"type": "point"}])
    g.extend("KHR_materials_volume")
    g.extend("EXT_unheard_of")
    g.node(mesh=g.quad(material=0))
    path = g.glb(tmp_path)
    notes = load(path).info()["notes"]
    (told,) = [note for note in notes if note.startswith("not applied")]
    assert "occlusionTexture (2 times; what light does not reach is found by tracing)" in told
    assert "thicknessTexture (2 times; " in told
    assert "range of lights (1 times; " in told
    assert "minFilter" not in told
    assert "ignored extensions: EXT_unheard_of" in notes
    g.json["materials"] = [{}]
    g.json["extensions"]["KHR_lights_punctual"]["lights"] = [{"type": "point"}]
    assert not any("not applied" in note for note in load(g.glb(tmp_path)).notes)


def test_every_slot_has_its_texture_transform(tmp_path: Path) -> None:
    """Each texture of a material has a scale of its own, and comes out with it."""
    g = Gltf()
    index = texture_of(g, tmp_path)
    scales = iter(range(2, 100))

    def info(**more: Any) -> dict[str, Any]:
        return {"index": index, "extensions": {"KHR_texture_transform": {"scale": [next(scales), 1]}}, **more}

    node = material_of(
        g,
        tmp_path,
        pbrMetallicRoughness={"baseColorTexture": info(), "metallicRoughnessTexture": info()},
        normalTexture=info(),
        emissiveTexture=info(),
        emissiveFactor=[1, 1, 1],
        extensions={
            "KHR_materials_transmission": {"transmissionFactor": 1, "transmissionTexture": info()},
            "KHR_materials_specular": {"specularTexture": info(), "specularColorTexture": info()},
            "KHR_materials_clearcoat": {
                "clearcoatFactor": 1, "clearcoatTexture": info(),
                "clearcoatRoughnessFactor": 1, "clearcoatRoughnessTexture": info(),
                "clearcoatNormalTexture": info(),
            },
            "KHR_materials_sheen": {
                "sheenColorFactor": [1, 1, 1], "sheenColorTexture": info(),
                "sheenRoughnessFactor": 1, "sheenRoughnessTexture": info(),
            },
            "KHR_materials_iridescence": {
                "iridescenceFactor": 1, "iridescenceTexture": info(), "iridescenceThicknessTexture": info(),
            },
            "KHR_materials_anisotropy": {"anisotropyStrength": 1, "anisotropyTexture": info()},
            "KHR_materials_diffuse_transmission": {
                "diffuseTransmissionFactor": 1, "diffuseTransmissionTexture": info(),
                "diffuseTransmissionColorTexture": info(),
            },
        },
    )  # fmt: skip
    found = {image["uv_scale"][0] for image in node.walk() if image.type == "image"}
    assert found == set(range(2, next(scales)))
    g = Gltf()
    index = texture_of(g, tmp_path)
    old = {"diffuseTexture": info(), "specularGlossinessTexture": info()}
    node = material_of(g, tmp_path, extensions={"KHR_materials_pbrSpecularGlossiness": old})
    assert len({image["uv_scale"][0] for image in node.walk() if image.type == "image"} - {1}) == 2


@pytest.mark.parametrize(("strength", "sky"), [(None, True), (5.0, False)])
def test_small_lamps_do_not_light_a_scene(strength: float | None, sky: bool, tmp_path: Path) -> None:
    """An emissive texture is mostly black: without a sky as well, the picture would be."""
    g = Gltf()
    extra = {} if strength is None else {"KHR_materials_emissive_strength": {"emissiveStrength": strength}}
    values = {"emissiveTexture": {"index": texture_of(g, tmp_path)}, "emissiveFactor": [1, 1, 1], "extensions": extra}
    g.node(mesh=g.quad(material=g.add("materials", **values)))
    assert (load(g.glb(tmp_path)).environment is not None) == sky
