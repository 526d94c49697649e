"""glTF: KHR_materials_specular on glass that refracts."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from gltf_scenes import material_of, picture, scene_with
from scene_files import Gltf, encode_image


def glass(specular: dict[str, Any] | None, *, coat: bool = False) -> dict[str, Any]:
    """A material that refracts."""
    named = {
        "transmission": {"transmissionFactor": 1},
        "volume": {"thicknessFactor": 1},
        **({} if specular is None else {"specular": specular}),
        **({"clearcoat": {"clearcoatFactor": 1}} if coat else {}),
    }
    smooth = {"metallicFactor": 0, "roughnessFactor": 0}
    return {"pbrMetallicRoughness": smooth, "extensions": {f"KHR_materials_{k}": v for k, v in named.items()}}


@pytest.mark.parametrize("coat", [False, True])
def test_specular_on_glass_is_a_colour_and_no_other_index(coat: bool, tmp_path: Path) -> None:
    plain = material_of(Gltf(), tmp_path, **glass({}, coat=coat))
    assert plain.type == ("openpbr" if coat else "dielectric")
    node = material_of(
        Gltf(), tmp_path, **glass({"specularFactor": 0.5, "specularColorFactor": [1, 0.5, 0]}, coat=coat)
    )
    assert (node.type, node["specular_weight"], node["specular_ior"]) == ("openpbr", 1, 1.5)
    assert node["specular_color"] == (0.5, 0.25, 0)
    assert (node["transmission_weight"], node["geometry_thin_walled"]) == (1, False)
    assert node["coat_weight"] == coat


def test_textures_of_specular_on_glass(tmp_path: Path) -> None:
    texels = np.full((2, 2, 4), 255, np.uint8)
    texels[0, 0, 3] = 51
    g = Gltf()
    info = {"index": g.texture(encode_image(texels, ".png", tmp_path))}
    node = material_of(g, tmp_path, **glass({"specularFactor": 0.5, "specularTexture": info}))
    assert node["specular_color"]["scale"] == (0.5, 0.5, 0.5)
    np.testing.assert_allclose(
        node["specular_color"]["texture"]["pixels"][..., 0] / 65535, [[0.2, 1], [1, 1]], atol=1e-4
    )
    g = Gltf()
    info = {"index": g.texture(encode_image(texels, ".png", tmp_path))}
    scene = scene_with(
        g, tmp_path, **glass({"specularColorFactor": [2, 1, 1], "specularColorTexture": info, "specularTexture": info})
    )
    assert scene.shapes[0]["material"]["specular_color"]["color_space"] == "srgb"
    place = "materials[0].extensions.KHR_materials_specular"
    assert f"{place}.specularTexture: left out beside specularColorTexture on glass that refracts" in scene.notes
    assert f"{place}.specularColorFactor: glass that refracts reflects no more than its index does" in scene.notes


def test_glass_that_does_not_reflect_bends_light_all_the_same(tmp_path: Path) -> None:
    """A ball of glass shows the sky upside down; what it reflects comes on top."""
    plain, dull, red = (
        picture(material_of(Gltf(), tmp_path, **glass(specular)))
        for specular in (None, {"specularFactor": 0}, {"specularColorFactor": [1, 0, 0]})
    )
    above, below = (slice(3, 6), slice(7, 9)), (slice(10, 13), slice(7, 9))
    for image in (plain, dull):
        assert image[below].mean() > 1.3 * image[above].mean()
    np.testing.assert_allclose(dull[below], plain[below], rtol=0.12)
    assert dull.mean() < plain.mean()
    np.testing.assert_allclose(red[..., 0].mean(), plain[..., 0].mean(), rtol=0.02)
    np.testing.assert_allclose(red[..., 1:].mean(), dull[..., 1:].mean(), rtol=0.02)
