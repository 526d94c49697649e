"""Scene files name metals and black bodies: what they stand for, what is refused, that they come back."""

from __future__ import annotations

from pathlib import Path

import jsonschema
import pytest

import destello as dl
from destello import metals, spectrum
from destello.errors import SceneError
from destello.io import _yaml
from destello.json_schema import json_schema
from destello.python_types import BLACK_BODY, METALS

VALIDATOR = jsonschema.Draft202012Validator(json_schema())


def read(text: str, folder: Path) -> dl.Scene:
    """The scene in a text, the same again after it was saved."""
    path = folder / "s.yaml"
    path.write_text(text)
    scene = dl.load(path)
    scene.save(folder / "again.yaml")
    assert dl.load(folder / "again.yaml") == scene
    return scene


def material(text: str, folder: Path) -> dl.Node:
    node = read(f"shapes: [{{type: sphere, center: [0, 0, 0], radius: 1, material: {text}}}]", folder).shapes[0]
    assert isinstance(node["material"], dl.Node)
    return node["material"]


def test_the_lists_are_those_of_the_functions() -> None:
    assert METALS == metals.NAMES
    low_high = BLACK_BODY.params["blackbody"].min, BLACK_BODY.params["blackbody"].max
    assert low_high == (spectrum.COLDEST, spectrum.HOTTEST)


@pytest.mark.parametrize("name", METALS)
def test_metals_by_name(name: str, tmp_path: Path) -> None:
    node = material(f"{{type: conductor, metal: {name}, roughness: 0.2}}", tmp_path)
    assert node == dl.materials.metal(name, roughness=0.2)
    assert (node["fresnel"], (node["eta"], node["k"]), node["roughness"]) == ("eta_k", metals.eta_k(name), 0.2)


@pytest.mark.parametrize(
    ("text", "place", "said"),
    [
        ("{type: conductor, metal: golt}", "metal", "did you mean 'gold'"),
        ("{type: conductor, metal: 3}", "metal", "wrong kind of value"),
        ("{type: conductor, metal: gold, eta: 1}", "metal", "metal and eta"),
        ("{type: conductor, metal: gold, k: 1}", "metal", "metal and k"),
        ("{type: conductor, metal: gold, fresnel: schlick}", "metal", "metal and fresnel"),
        ("{type: emissive, radiance: {blackbdy: 3000}}", "radiance.blackbdy", "did you mean 'blackbody'"),
        ("{type: emissive, radiance: {luminance: 3}}", "radiance", "blackbody is missing"),
        ("{type: emissive, radiance: {blackbody: 300}}", "radiance.blackbody", "from 500 to 1000000 K"),
        ("{type: emissive, radiance: {blackbody: hot}}", "radiance.blackbody", "wrong kind of value"),
        ("{type: emissive, radiance: {blackbody: 3000, luminance: -1}}", "radiance.luminance", "at least 0"),
        ("{type: emissive, radiance: {path: x.png}}", "radiance", "the texture has no type"),
        ("{type: emissive, normal_map: {blackbody: 3000}}", "normal_map", "the texture has no type"),
    ],
)
def test_what_is_refused(text: str, place: str, said: str, tmp_path: Path) -> None:
    with pytest.raises(SceneError) as caught:
        material(text, tmp_path)
    assert caught.value.place == f"shapes[0].material.{place}"
    assert (caught.value.line, said in str(caught.value)) == (1, True)


def test_black_bodies_in_place_of_colours(tmp_path: Path) -> None:
    text = """
destello: 1
environment: {type: gradient, bottom: {blackbody: 2000, luminance: 0.5}, top: {blackbody: 10000}}
textures: {glow: {type: checker, even: {blackbody: 1500}, odd: 0}}
materials:
  lamp: {type: emissive, radiance: {blackbody: 2700, luminance: 12}}
  tube: {type: openpbr, emission_luminance: 100, emission_color: {blackbody: 4000, luminance: 0.5}}
  hot: {type: diffuse, emission: glow}
  gold: {type: conductor, metal: gold}
shapes:
- {type: sphere, center: [0, 0, 0], radius: 1, material: lamp}
- {type: sphere, center: [3, 0, 0], radius: 1, material: hot}
lights: [{type: point, intensity: {blackbody: 3000, luminance: 40}}, {type: directional, irradiance: {blackbody: 5800}}]
"""
    VALIDATOR.validate(_yaml.parse_yaml(text))
    for wrong in ("{blackbody: 100}", "{blackbody: 3000, kelvin: 1}", "{luminance: 1}"):
        assert not VALIDATOR.is_valid(_yaml.parse_yaml(f"lights: [{{type: point, intensity: {wrong}}}]"))
    scene = read(text, tmp_path)
    assert scene.environment is not None
    assert scene.environment["bottom"] == dl.blackbody(2000, 0.5)
    assert scene.environment["top"] == dl.blackbody(10000)
    lamp, hot = (shape["material"] for shape in scene.shapes)
    assert lamp["radiance"] == dl.blackbody(2700, 12)
    assert hot["emission"]["even"] == dl.blackbody(1500)
    assert [light.params for light in scene.lights] == [
        {"intensity": dl.blackbody(3000, 40)},
        {"irradiance": dl.blackbody(5800)},
    ]
    assert dl.lights.point(intensity={"blackbody": 3000, "luminance": 40}) == scene.lights[0]
