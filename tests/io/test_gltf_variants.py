"""glTF: material variants, and the specular-glossiness materials of old files."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

import destello as dl
from destello.cli import app
from destello.errors import FormatError, InputError
from destello.io import load
from gltf_scenes import material_of
from scene_files import Gltf, corner_image, encode_image


def two_variants(folder: Path, **mapping: Any) -> Path:
    """A quad that is red by itself, green in "Forest" and "Meadow", blue in "Sea"."""
    g = Gltf()
    colors = ([1, 0, 0, 1], [0, 1, 0, 1], [0, 0, 1, 1])
    red, green, blue = (g.add("materials", pbrMetallicRoughness={"baseColorFactor": c}) for c in colors)
    g.extend("KHR_materials_variants", variants=[{"name": n} for n in ("Forest", "Sea", "Meadow", "Night")])
    mappings = [{"material": green, "variants": [0, 2]}, {"material": blue, "variants": [1], **mapping}]
    g.node(mesh=g.quad(material=red, extensions={"KHR_materials_variants": {"mappings": mappings}}))
    return g.glb(folder)


@pytest.mark.parametrize(
    ("variant", "color"),
    [(None, (1, 0, 0)), ("Forest", (0, 1, 0)), ("Meadow", (0, 1, 0)), ("Sea", (0, 0, 1)), ("Night", (1, 0, 0))],
)
def test_variants(variant: str | None, color: tuple[float, ...], tmp_path: Path) -> None:
    scene = dl.load(two_variants(tmp_path), variant=variant)
    assert scene.shapes[0]["material"]["base_color"] == color
    assert any("Forest, Sea, Meadow, Night" in note for note in scene.notes) == (variant is None)


def test_wrong_variants(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"unknown variant: 'forest' .*did you mean 'Forest'"):
        load(two_variants(tmp_path), variant="forest")
    (tmp_path / "a.stl").write_text("solid a\nendsolid a\n")
    for other in (tmp_path / "a.stl", "cornell"):
        with pytest.raises(InputError, match="only glTF"):
            load(other, variant="Forest")
    with pytest.raises(FormatError, match=r"mappings\[1\].material: index out of range: 9"):
        load(two_variants(tmp_path, material=9), variant="Sea")
    with pytest.raises(FormatError, match=r"mappings\[1\].variants\[0\]: index out of range: 4"):
        load(two_variants(tmp_path, variants=[4]), variant="Sea")


def test_variants_on_the_command_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    two_variants(tmp_path)
    run = CliRunner().invoke
    assert "Forest, Sea" in run(app, ["info", "scene.glb"]).stdout
    assert run(app, ["convert", "scene.glb", "--variant", "Sea", "-o", "a.yaml"]).exit_code == 0
    assert load("a.yaml").shapes[0]["material"]["base_color"] == (0, 0, 1)
    small = ["--size", "8x8", "--spp", "4", "-q", "--tone", "raw", "--device", "cpu"]
    assert run(app, ["render", "scene.glb", "--variant", "Sea", "-o", "a.png", *small]).exit_code == 0
    middle = dl.Image.load("a.png").array[4, 4]
    assert middle[2] > 2 * middle[0]
    wrong = run(app, ["render", "scene.glb", "--variant", "See", *small])
    assert (wrong.exit_code, "did you mean 'Sea'" in wrong.stderr) == (2, True)


# --- specular and glossiness ------------------------------------------------------------------------------------------

NAME = "KHR_materials_pbrSpecularGlossiness"


def test_factors(tmp_path: Path) -> None:
    old = {"diffuseFactor": [0.2, 0.3, 0.4, 0.5], "specularFactor": [0.04, 0.05, 0.06], "glossinessFactor": 0.75}
    node = material_of(
        Gltf(), tmp_path, name="Old", alphaMode="BLEND", emissiveFactor=[0, 1, 0], extensions={NAME: old}
    )
    assert (node.type, node.name, node["metallic"]) == ("metallic_roughness", "Old", 0)
    assert (node["base_color"], node["roughness"], node["opacity"]) == ((0.2, 0.3, 0.4), 0.25, 0.5)
    assert node["emission"] == (0, 1, 0)
    head_on = np.multiply(node["specular_color"], ((node["ior"] - 1) / (node["ior"] + 1)) ** 2)
    np.testing.assert_allclose(head_on, old["specularFactor"])


@pytest.mark.parametrize("embedded", [True, False])
def test_glossiness_is_turned_round(embedded: bool, tmp_path: Path) -> None:
    """Roughness is 1 - factor * alpha, texel by texel; specular the texture's colours."""
    texels = np.dstack([corner_image(), np.arange(corner_image().shape[0] * corner_image().shape[1]).reshape(
        corner_image().shape[:2]
    )]).astype(np.uint8)  # fmt: skip
    g = Gltf()
    data = encode_image(texels, ".png", tmp_path)
    if embedded:
        index = g.texture(data, wrapS=33071)
    else:
        (tmp_path / "gloss.png").write_bytes(data)
        index = g.add("textures", source=g.add("images", uri="gloss.png"), sampler=g.add("samplers", wrapS=33071))
    old = {"glossinessFactor": 0.5, "specularGlossinessTexture": {"index": index}, "diffuseTexture": {"index": index}}
    node = material_of(g, tmp_path, extensions={NAME: old})
    rough = node["roughness"]
    assert (rough["color_space"], rough["wrap_u"]) == ("linear", "clamp")
    np.testing.assert_allclose(rough["pixels"][..., 0] / 65535, 1 - 0.5 * texels[..., 3] / 255, atol=1e-5)
    assert node["specular_color"]["texture"]["color_space"] == "srgb"
    assert node["base_color"].type == "image"


def test_old_materials_look_like_new_ones(tmp_path: Path) -> None:
    """A dielectric of reflectance 0.04 said both ways; and a mirror."""
    pbr = {"baseColorFactor": [0.5, 0.2, 0.1, 1], "metallicFactor": 0, "roughnessFactor": 0.5}
    new = material_of(Gltf(), tmp_path, pbrMetallicRoughness=pbr)
    old = {"diffuseFactor": [0.5, 0.2, 0.1, 1], "specularFactor": [0.04] * 3, "glossinessFactor": 0.5}
    was = material_of(Gltf(), tmp_path, extensions={NAME: old})
    pictures = []
    for node in (new, was):
        scene = dl.Scene()
        scene.environment = dl.environments.gradient()
        scene.add(dl.shapes.sphere(center=(0, 0, 0), radius=1, material=node))
        pictures.append(dl.render(scene, size=(24, 24), spp=64, device="cpu", progress=False).array)
    np.testing.assert_allclose(pictures[0], pictures[1], rtol=2e-3, atol=2e-3)
