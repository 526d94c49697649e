"""glTF: layered materials as OpenPBR, parameter by parameter and in pictures."""

from __future__ import annotations

import itertools
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import destello as dl
from destello.errors import FormatError
from destello.io._gltf_layers import single_scatter_albedo
from destello.nodes import Node
from gltf_scenes import material_of, picture, scene_with
from scene_files import Gltf, corner_image, encode_image


def layered(folder: Path, pbr: dict[str, Any] | None = None, g: Gltf | None = None, **extensions: Any) -> Node:
    """The material with these KHR_materials_ extensions."""
    named = {f"KHR_materials_{name}": values for name, values in extensions.items()}
    return material_of(g or Gltf(), folder, pbrMetallicRoughness=pbr or {}, extensions=named)


WHITE = {"metallicFactor": 0, "roughnessFactor": 0.5}
DIELECTRIC = {"metallicFactor": 0, "roughnessFactor": 0.5, "baseColorFactor": [0.8, 0.4, 0.2, 1]}


def test_only_layers_need_openpbr(tmp_path: Path) -> None:
    nothing = {
        "clearcoat": {"clearcoatRoughnessFactor": 0.5},
        "sheen": {"sheenRoughnessFactor": 0.5},
        "iridescence": {},
        "anisotropy": {"anisotropyRotation": 1},
        "diffuse_transmission": {},
        "volume_scatter": {"multiscatterColor": [1, 1, 1]},
    }
    assert layered(tmp_path, **nothing).type == "metallic_roughness"
    strengths = {
        "clearcoat": {"clearcoatFactor": 1},
        "sheen": {"sheenColorFactor": [0, 1, 0]},
        "iridescence": {"iridescenceFactor": 1},
        "anisotropy": {"anisotropyStrength": 1},
        "diffuse_transmission": {"diffuseTransmissionFactor": 1},
    }
    for name, values in strengths.items():
        assert layered(tmp_path, **{name: values}).type == "openpbr"


def test_clearcoat(tmp_path: Path) -> None:
    node = layered(tmp_path, DIELECTRIC, clearcoat={"clearcoatFactor": 0.75, "clearcoatRoughnessFactor": 0.25})
    assert (node["base_color"], node["base_metalness"], node["specular_roughness"]) == ((0.8, 0.4, 0.2), 0, 0.5)
    assert (node["coat_weight"], node["coat_roughness"], node["coat_ior"], node["coat_darkening"]) == (
        0.75,
        0.25,
        1.5,
        0,
    )
    assert (node["specular_ior"], node["specular_weight"], node["specular_color"]) == (1.5, 1, (1, 1, 1))


def test_textures_and_their_channels(tmp_path: Path) -> None:
    g = Gltf()
    info = {"index": g.texture(encode_image(corner_image(), ".png", tmp_path))}
    node = layered(
        tmp_path,
        DIELECTRIC,
        g,
        clearcoat={
            "clearcoatFactor": 0.5,
            "clearcoatTexture": info,
            "clearcoatRoughnessFactor": 1,
            "clearcoatRoughnessTexture": info,
        },
        sheen={
            "sheenColorFactor": [0.5, 0.25, 0],
            "sheenColorTexture": info,
            "sheenRoughnessFactor": 0.5,
            "sheenRoughnessTexture": info,
        },
        iridescence={"iridescenceFactor": 1, "iridescenceTexture": info},
        diffuse_transmission={
            "diffuseTransmissionFactor": 1,
            "diffuseTransmissionTexture": info,
            "diffuseTransmissionColorTexture": info,
        },
        specular={"specularFactor": 0.5, "specularTexture": info, "specularColorTexture": info},
    )
    picks = {name: (node[name]["channel"], node[name]["scale"]) for name in (
        "coat_roughness", "coat_weight", "fuzz_color", "fuzz_roughness", "subsurface_weight", "specular_weight"
    )}  # fmt: skip
    assert picks == {
        "coat_weight": ("r", (0.5,) * 3),
        "coat_roughness": ("g", (1,) * 3),
        "fuzz_color": ("r", (1, 0.5, 0)),
        "fuzz_roughness": ("a", (0.5,) * 3),
        "subsurface_weight": ("a", (1,) * 3),
        "specular_weight": ("a", (0.5,) * 3),
    }
    assert node["fuzz_weight"] == 0.5
    assert node["thin_film_weight"].type == "image"
    for name, space in (("subsurface_color", "srgb"), ("specular_color", "srgb"), ("thin_film_weight", "linear")):
        assert node[name]["color_space"] == space


def test_the_clearcoat_has_normals_of_its_own(tmp_path: Path) -> None:
    """Its map with scale and transform like the base's; without one the geometry's normals, whatever the base's map."""
    g = Gltf()
    index = g.texture(encode_image(corner_image(), ".png", tmp_path))
    info = {"index": index, "scale": 0.25, "extensions": {"KHR_texture_transform": {"scale": [2, 3]}}}
    values = {"clearcoatFactor": 1, "clearcoatNormalTexture": info}
    scene = scene_with(g, tmp_path, extensions={"KHR_materials_clearcoat": values})
    coat = scene.shapes[0]["material"]
    assert coat["geometry_coat_normal_scale"] == 0.25
    assert (coat["geometry_coat_normal"]["color_space"], coat["geometry_coat_normal"]["uv_scale"]) == ("linear", (2, 3))
    assert coat["normal_map"] == (0.5, 0.5, 1)
    assert not scene.notes
    g = Gltf()
    index = g.texture(encode_image(corner_image(), ".png", tmp_path))
    coat = material_of(
        g,
        tmp_path,
        normalTexture={"index": index, "scale": 0.5},
        extensions={"KHR_materials_clearcoat": {"clearcoatFactor": 1}},
    )
    assert coat["normal_scale"] == 0.5
    assert (coat["geometry_coat_normal"], coat["geometry_coat_normal_scale"]) == ((0.5, 0.5, 1), 1)


def test_iridescence(tmp_path: Path) -> None:
    """Nanometres become micrometres; without a texture the maximum holds; a texture lies between both."""
    film = {"iridescenceFactor": 0.5, "iridescenceIor": 1.33, "iridescenceThicknessMaximum": 550}
    node = layered(tmp_path, iridescence=film)
    assert (node["thin_film_weight"], node["thin_film_ior"]) == (0.5, 1.33)
    assert node["thin_film_thickness"] == pytest.approx(0.55)
    g = Gltf()
    scene = scene_with(
        g, tmp_path, extensions={"KHR_materials_iridescence": {"iridescenceFactor": 1, "iridescenceIor": 4}}
    )
    assert scene.shapes[0]["material"]["thin_film_ior"] == 3
    place = "materials[0].extensions.KHR_materials_iridescence.iridescenceIor"
    assert f"{place}: 4 counts as 3, the most that a film can have" in scene.notes
    for low, high in ((200, 800), (800, 200)):
        g = Gltf()
        index = g.texture(encode_image(corner_image(), ".png", tmp_path))
        film |= {"iridescenceThicknessMinimum": low, "iridescenceThicknessMaximum": high}
        thickness = layered(tmp_path, g=g, iridescence=film | {"iridescenceThicknessTexture": {"index": index}})[
            "thin_film_thickness"
        ]
        found = thickness["texture"]["pixels"][..., 0] / 65535 * thickness["scale"][0]
        expected = (low + (high - low) * (corner_image()[..., 1] / 255.0)) / 1000
        np.testing.assert_allclose(found, expected, atol=2e-5)


@pytest.mark.parametrize(("roughness", "strength"), [(0.5, 0.5), (0.2, 1.0), (0.8, 0.25), (1.0, 1.0)])
def test_anisotropy_has_the_widths_of_the_extension(roughness: float, strength: float, tmp_path: Path) -> None:
    node = layered(tmp_path, {"roughnessFactor": roughness}, anisotropy={"anisotropyStrength": strength})
    aspect = 1 - node["specular_roughness_anisotropy"]
    along = node["specular_roughness"] ** 2 * math.sqrt(2 / (1 + aspect**2))  # OpenPBR 1.1, "Microfacet model"
    alpha = roughness**2
    assert along == pytest.approx(alpha + (1 - alpha) * strength**2, abs=1e-6)
    assert along * aspect == pytest.approx(alpha, abs=1e-6)


def test_a_textured_strength_has_these_widths_in_every_texel(tmp_path: Path) -> None:
    """Where the texture's blue is 0, the surface has the roughness that the material says."""
    g, strength, alpha = Gltf(), 0.8, 0.3**2
    info = {"index": g.texture(encode_image(corner_image(), ".png", tmp_path))}
    values = {"anisotropyStrength": strength, "anisotropyTexture": info}
    node = layered(tmp_path, {"roughnessFactor": 0.3}, g, anisotropy=values)
    names = ("specular_roughness_anisotropy", "specular_roughness")
    aspect, rough = (node[name]["pixels"][..., 0] / 65535 for name in names)
    along = rough**2 * np.sqrt(2 / (1 + (1 - aspect) ** 2))
    blue = corner_image()[..., 2] / 255
    np.testing.assert_allclose(along, alpha + (1 - alpha) * (strength * blue) ** 2, atol=1e-4)
    np.testing.assert_allclose(along * (1 - aspect), alpha, atol=1e-4)
    assert rough[0, 0] == pytest.approx(0.3, abs=1e-4)


def test_anisotropy_has_a_direction(tmp_path: Path) -> None:
    """The extension's tangent and bitangent are along destello's u and v: both have normal maps with green upwards."""
    straight = layered(tmp_path, anisotropy={"anisotropyStrength": 0.5})
    assert straight["tangent_map"] == (1, 0.5, 0.5)
    turned = layered(tmp_path, anisotropy={"anisotropyStrength": 0.5, "anisotropyRotation": math.pi / 3})
    np.testing.assert_allclose(2 * np.array(turned["tangent_map"]) - 1, [0.5, math.sqrt(0.75), 0], atol=1e-6)
    assert turned["tangent_rotation"] == 0
    g = Gltf()
    info = {"index": g.texture(encode_image(corner_image(), ".png", tmp_path))}
    values = {"anisotropyStrength": 0.5, "anisotropyRotation": math.pi / 3, "anisotropyTexture": info}
    scene = scene_with(g, tmp_path, extensions={"KHR_materials_anisotropy": values})
    node = scene.shapes[0]["material"]
    assert (node["tangent_map"].type, node["tangent_map"]["color_space"]) == ("image", "linear")
    assert node["tangent_rotation"] == pytest.approx(60)
    assert not any("anisotropy" in note for note in scene.notes)


def test_sheen_is_the_strongest_component_times_a_colour(tmp_path: Path) -> None:
    node = layered(tmp_path, sheen={"sheenColorFactor": [0.1, 0.4, 0.2], "sheenRoughnessFactor": 0.3})
    np.testing.assert_allclose(np.multiply(node["fuzz_weight"], node["fuzz_color"]), [0.1, 0.4, 0.2])
    assert (node["fuzz_weight"], node["fuzz_roughness"]) == (0.4, 0.3)


def test_reflectances_beyond_openpbrs_ranges(tmp_path: Path) -> None:
    coat = {"clearcoatFactor": 1}
    node = layered(tmp_path, DIELECTRIC, clearcoat=coat, ior={"ior": 120}, specular={"specularColorFactor": [2, 1, 0]})
    head_on = node["specular_weight"] * ((node["specular_ior"] - 1) / (node["specular_ior"] + 1)) ** 2
    np.testing.assert_allclose(
        np.multiply(head_on, node["specular_color"]), np.array([2, 1, 0]) * (119 / 121) ** 2, atol=1e-6
    )
    assert node["specular_ior"] == 100
    metal = layered(tmp_path, clearcoat=coat, specular={"specularFactor": 0.25, "specularColorFactor": [1, 0, 0]})
    assert (metal["specular_weight"], metal["specular_color"]) == (1, (1, 1, 1))


# --- light that passes ------------------------------------------------------------------------------------------------


def test_thin_and_thick_transmission_below_a_coat(tmp_path: Path) -> None:
    glass = {"clearcoat": {"clearcoatFactor": 1}, "transmission": {"transmissionFactor": 0.5}}
    thin = layered(tmp_path, DIELECTRIC, **glass)
    assert (thin["transmission_weight"], thin["geometry_thin_walled"]) == (0.5, True)
    assert thin["transmission_color"] == (0.8, 0.4, 0.2)
    volume = {"thicknessFactor": 1, "attenuationColor": [0.5, 0.25, 1], "attenuationDistance": 2}
    thick = layered(tmp_path, WHITE, volume=volume, dispersion={"dispersion": 0.5}, **glass)
    assert (thick["transmission_color"], thick["transmission_depth"]) == ((0.5, 0.25, 1), 2)
    assert not thick["geometry_thin_walled"]
    assert (thick["transmission_dispersion_abbe_number"], thick["transmission_dispersion_scale"]) == (40, 1)


@pytest.mark.parametrize("color", [[0.9, 0.8, 0.7], [0.3, 0.01, 0.5]])
def test_volume_scatter_below_a_refracting_surface(color: list[float], tmp_path: Path) -> None:
    """Extinction -ln(c) / d as KHR_materials_volume has it, of which the albedo is scattering."""
    node = layered(
        tmp_path,
        transmission={"transmissionFactor": 1},
        volume={"thicknessFactor": 1, "attenuationColor": color, "attenuationDistance": 0.5},
        volume_scatter={"multiscatterColor": [0.9, 0.5, 0.2], "scatterAnisotropy": 0.3},
    )
    extinction = -np.log(node["transmission_color"]) / node["transmission_depth"]
    np.testing.assert_allclose(extinction, -np.log(color) / 0.5)
    albedo = np.array(node["transmission_scatter"]) / node["transmission_depth"] / extinction
    np.testing.assert_allclose(albedo, [single_scatter_albedo(c) for c in (0.9, 0.5, 0.2)])
    assert node["transmission_scatter_anisotropy"] == 0.3


def test_tinted_glass_with_attenuation(tmp_path: Path) -> None:
    """The base colour tints at the surface, as glTF has it; the medium is the one that all materials have."""
    node = layered(
        tmp_path,
        DIELECTRIC,
        clearcoat={"clearcoatFactor": 1},
        transmission={"transmissionFactor": 1},
        volume={"thicknessFactor": 1, "attenuationColor": [0.5, 0.25, 1], "attenuationDistance": 2},
    )
    assert (node["transmission_color"], node["transmission_depth"]) == ((0.8, 0.4, 0.2), 0)
    np.testing.assert_allclose(node["medium_absorption"], -np.log([0.5, 0.25, 1]) / 2, atol=1e-7)


def test_tinted_glass_that_scatters(tmp_path: Path) -> None:
    """What collides is absorbed or scattered: both together are the extinction."""
    volume = {"thicknessFactor": 1, "attenuationColor": [0.5, 0.25, 0.8], "attenuationDistance": 2}
    scatter = {"multiscatterColor": [0.9, 0.5, 0.2], "scatterAnisotropy": 0.3}
    glass = {"transmission": {"transmissionFactor": 1}, "volume": volume, "volume_scatter": scatter}
    node = layered(tmp_path, DIELECTRIC, **glass)
    scattering, extinction = np.array(node["medium_density"]), -np.log([0.5, 0.25, 0.8]) / 2
    np.testing.assert_allclose(np.add(node["medium_absorption"], scattering), extinction)
    np.testing.assert_allclose(scattering / extinction, [single_scatter_albedo(c) for c in (0.9, 0.5, 0.2)])
    assert (node["medium_anisotropy"], node["transmission_color"]) == (0.3, (0.8, 0.4, 0.2))


def test_single_scatter_albedo() -> None:
    assert single_scatter_albedo(0) == 0
    assert single_scatter_albedo(1) == pytest.approx(1, abs=1e-4)
    values = [single_scatter_albedo(c) for c in np.linspace(0, 1, 50)]
    assert all(a < b for a, b in itertools.pairwise(values))


def test_diffuse_transmission_thin_and_dense(tmp_path: Path) -> None:
    leaf = {"diffuseTransmissionFactor": 0.75, "diffuseTransmissionColorFactor": [0.1, 0.9, 0.2]}
    node = layered(tmp_path, DIELECTRIC, diffuse_transmission=leaf)
    assert (node["subsurface_weight"], node["subsurface_color"]) == (0.75, (0.1, 0.9, 0.2))
    assert (node["subsurface_scatter_anisotropy"], node["geometry_thin_walled"]) == (0.99, True)
    dense: dict[str, Any] = {
        "volume": {"thicknessFactor": 1, "attenuationColor": [math.exp(-1), math.exp(-2), math.exp(-4)],
                   "attenuationDistance": 0.01},
        "volume_scatter": {"multiscatterColor": [0.6, 0.2, 0.1], "scatterAnisotropy": 0.5},
    }  # fmt: skip
    skin = layered(tmp_path, DIELECTRIC, diffuse_transmission={"diffuseTransmissionFactor": 1}, **dense)
    assert not skin["geometry_thin_walled"]
    assert (skin["subsurface_weight"], skin["subsurface_color"]) == (1, (0.6, 0.2, 0.1))
    assert skin["subsurface_radius"] == pytest.approx(0.01)
    np.testing.assert_allclose(skin["subsurface_radius_scale"], [1, 0.5, 0.25])
    assert skin["subsurface_scatter_anisotropy"] == 0.5
    tinted = layered(tmp_path, DIELECTRIC, diffuse_transmission=leaf, **dense)
    np.testing.assert_allclose(tinted["subsurface_color"], (0.06, 0.18, 0.02))
    g = Gltf()
    info = {"index": g.texture(encode_image(corner_image(), ".png", tmp_path))}
    values = {"KHR_materials_diffuse_transmission": {**leaf, "diffuseTransmissionColorTexture": info}}
    scene = scene_with(g, tmp_path, extensions=values | {f"KHR_materials_{name}": v for name, v in dense.items()})
    scene.compile()
    color = scene.shapes[0]["material"]["subsurface_color"]
    np.testing.assert_allclose(color["scale"], (0.06, 0.18, 0.02))


# --- what is said -----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("name", "values"),
    [
        ("clearcoat", {"clearcoatFactor": 1.5}),
        ("clearcoat", {"clearcoatFactor": 1, "clearcoatRoughnessFactor": -1}),
        ("sheen", {"sheenColorFactor": [0, 1]}),
        ("iridescence", {"iridescenceFactor": 1, "iridescenceIor": 0.5}),
        ("anisotropy", {"anisotropyStrength": "much"}),
        ("diffuse_transmission", {"diffuseTransmissionFactor": -0.1}),
        ("iridescence", {"iridescenceFactor": 1, "iridescenceTexture": {"index": 3}}),
    ],
)
def test_out_of_range(name: str, values: dict[str, Any], tmp_path: Path) -> None:
    with pytest.raises(FormatError) as caught:
        layered(tmp_path, **{name: values})
    assert f"materials[0].extensions.KHR_materials_{name}." in str(caught.value)
    assert "accepted" in str(caught.value)


# --- pictures ---------------------------------------------------------------------------------------------------------


def test_a_leaf_in_even_light_shows_its_colours(tmp_path: Path) -> None:
    """Without reflection a sheet sends on (1 - f) base + f transmitted of the light that falls on it."""
    node = layered(
        tmp_path,
        DIELECTRIC,
        diffuse_transmission={"diffuseTransmissionFactor": 0.25, "diffuseTransmissionColorFactor": [0.1, 0.9, 0.2]},
        specular={"specularFactor": 0},
    )
    scene = dl.Scene()
    scene.environment = dl.environments.constant(radiance=1)
    scene.camera = dl.cameras.perspective(origin=(0, 0, 2), target=(0, 0, 0), vfov=20)
    scene.add(dl.shapes.quad(corner=(-1, -1, 0), u=(2, 0, 0), v=(0, 2, 0), material=node))
    found = dl.render(scene, size=(16, 16), spp=64, device="cpu", progress=False).array.mean(axis=(0, 1))
    expected = 0.75 * np.array([0.8, 0.4, 0.2]) + 0.25 * np.array([0.1, 0.9, 0.2])
    np.testing.assert_allclose(found, expected, rtol=0.02)


@pytest.mark.parametrize("roughness", [0.2, 0.4, 0.7, 1])
@pytest.mark.parametrize("metallic", [0, 0.5, 1])
def test_a_faint_layer_changes_little(metallic: float, roughness: float, tmp_path: Path) -> None:
    """The OpenPBR of a material is near the metallic-roughness material that it would be without its layer."""
    pbr = {**DIELECTRIC, "metallicFactor": metallic, "roughnessFactor": roughness}
    plain = picture(layered(tmp_path, pbr))
    faint = picture(layered(tmp_path, pbr, clearcoat={"clearcoatFactor": 1e-6}))
    np.testing.assert_allclose(faint.mean(axis=(0, 1)), plain.mean(axis=(0, 1)), rtol=0.02)
    coated = picture(layered(tmp_path, pbr, clearcoat={"clearcoatFactor": 1}))
    assert np.abs(coated - plain).max() > 0.02 * plain.max()
