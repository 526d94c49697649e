"""glTF's numbers that rounding to single precision has put just outside of their limits."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from destello.errors import FormatError
from gltf_scenes import material_of
from scene_files import Gltf


def test_what_rounding_has_put_just_outside_counts_as_the_limit(tmp_path: Path) -> None:
    """1.0000001192092896 is the next number after 1 in single precision, and in many files."""
    above, below = float(np.nextafter(np.float32(1), np.float32(2))), float(np.nextafter(np.float32(1), np.float32(0)))
    names = ("clearcoat", "ior", "diffuse_transmission")
    g = Gltf()
    for name in names:
        g.extend(f"KHR_materials_{name}")
    node = material_of(
        g,
        tmp_path,
        pbrMetallicRoughness={"baseColorFactor": [above] * 4, "metallicFactor": -1e-9, "roughnessFactor": above},
        alphaMode="BLEND",
        extensions={
            "KHR_materials_clearcoat": {"clearcoatFactor": above},
            "KHR_materials_ior": {"ior": below},
            "KHR_materials_diffuse_transmission": {
                "diffuseTransmissionFactor": above, "diffuseTransmissionColorFactor": [above, -1e-9, 1],
            },
        },
    )  # fmt: skip
    found = {"base_color": (1, 1, 1), "base_metalness": 0, "specular_roughness": 1, "coat_weight": 1, "specular_ior": 1}
    assert {name: node[name] for name in found} == found
    assert (node["subsurface_weight"], node["subsurface_color"], node["opacity"]) == (1, (1, 0, 1), 1)
    with pytest.raises(FormatError, match="metallicFactor"):
        material_of(Gltf(), tmp_path, pbrMetallicRoughness={"metallicFactor": 1.00001})


@pytest.mark.parametrize("layer", ["clearcoatFactor", "sheenColorFactor", "iridescenceFactor", "anisotropyStrength"])
def test_an_index_of_1_under_layers(layer: str, tmp_path: Path) -> None:
    """It reflects nothing, which is no division by zero."""
    extension = f"KHR_materials_{layer.removesuffix('Factor').removesuffix('Strength').removesuffix('Color')}"
    g = Gltf()
    for name in (extension, "KHR_materials_ior"):
        g.extend(name)
    value = [0.5, 0.5, 0.5] if layer == "sheenColorFactor" else 0.5
    extensions = {extension: {layer: value}, "KHR_materials_ior": {"ior": 1.0}}
    node = material_of(g, tmp_path, pbrMetallicRoughness={"metallicFactor": 0}, extensions=extensions)
    assert (node.type, node["specular_ior"], node["specular_weight"]) == ("openpbr", 1.0, 1.0)


@pytest.mark.parametrize("sheen", [0.0, 0.5])
def test_dispersion_beyond_all_glass(sheen: float, tmp_path: Path) -> None:
    """The extension has no limit; OpenPBR's Abbe number is at least 1, and so is that of plain glass."""
    g = Gltf()
    extensions = {
        "KHR_materials_transmission": {"transmissionFactor": 1},
        "KHR_materials_volume": {"thicknessFactor": 1},
        "KHR_materials_dispersion": {"dispersion": 100},
        "KHR_materials_sheen": {"sheenColorFactor": [sheen] * 3},
    }
    for name in extensions:
        g.extend(name)
    node = material_of(g, tmp_path, pbrMetallicRoughness={"metallicFactor": 0}, extensions=extensions)
    assert node["transmission_dispersion_abbe_number" if sheen else "abbe"] == 1
