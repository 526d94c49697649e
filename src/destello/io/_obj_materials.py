"""The materials of MTL files as destello's.

Decisions where the format leaves room:
- With Pr, Pm or their maps the material is `metallic_roughness`, Kd its base colour; with Ps, Pc or aniso it is
  `openpbr` (see `_layers`).
- illum 4, 6, 7 and 9 are glass of index Ni, tinted by Tf, but where Ni is 1 and Tf white (Maya writes this for all
  that is opaque); illum 3, 5 and 8 mirror Ks over the diffuse Kd.
- Otherwise Ks is the strength of a dielectric's gloss, 0.5 being that of index 1.5, and Ns its Phong exponent
  (roughness is the fourth root of 2 / (Ns + 2)); without Ks, or with illum 0 or 1, the material is diffuse.
- Files that Blender wrote (they say so in their first comment) are read as it means them: Ns is 1000 (1 - roughness)^2,
  illum 3 and 6 are metals with Ka as the metallic share, illum 6 and 9 are see-through by d and no glass; Ks is the
  specular level beside Pr, too; Pc is four times the coat's weight, Tf the transmission's; map_Ns, map_refl and map_Ks
  are the images of roughness, metallic share and specular level themselves.
- Colours are linear; maps multiply their colour, and stand alone where that is black or not given.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import destello.materials as make
import destello.textures as textures
from destello.errors import Error, FormatError
from destello.io._obj_mtl import BLENDER_COAT, BLENDER_MAPS, DEFAULT_ILLUM, DEFAULT_INDEX, Map, Material
from destello.nodes import Node

_CHANNELS = {"r": "r", "g": "g", "b": "b", "m": "a", "l": "mean", "z": "mean"}
_GLASS, _MIRROR, _MATTE = (4, 6, 7, 9), (3, 5, 8), (0, 1)
_BLENDER_METAL, _BLENDER_CLEAR = (3, 6), (6, 9)

Value = Any  # a number, three numbers or a texture node


def convert(material: Material, file: Path) -> Node:
    """The material as a node. Raises FormatError."""
    try:
        return _convert(material)
    except Error as error:
        place = f"newmtl {material.name}"
        raise FormatError(
            error.problem, file=file, line=material.line, place=place, value=error.value, expected=error.expected
        ) from None


def _convert(material: Material) -> Node:
    numbers, maps, name = material.numbers, material.maps, material.name or None
    illum = numbers.get("illum", DEFAULT_ILLUM)
    base = _color(material, "kd", (0.6, 0.6, 0.6) if "map_kd" not in maps else (1.0, 1.0, 1.0))
    glass = illum in _GLASS and not _opaque(material, illum)
    surface = _surface(material, glass=glass)
    ks = material.colors.get("ks", (0.0, 0.0, 0.0))
    layers = _layers(material)
    if layers:
        core = {"base_color": base, "base_metalness": _number(material, "pm", 0.0)}
        if "transmission_weight" in layers:
            core["transmission_color"] = base if isinstance(base, Node) else tuple(math.sqrt(c) for c in base)
        return make.openpbr(name=name, **core, **layers, **surface)
    if {"pr", "pm"} & numbers.keys() or {"map_pr", "map_pm"} & maps.keys():
        metallic = _number(material, "pm", 0.0)
        roughness = _number(material, "pr", _roughness(material))
        looks = {"metallic": metallic, "roughness": roughness, **_blender_gloss(material)}
        return make.metallic_roughness(base_color=base, name=name, **looks, **surface)
    if material.blender and (illum in _BLENDER_METAL or any(key in maps for key in BLENDER_MAPS)):
        return make.metallic_roughness(base_color=base, name=name, **_blender_looks(material, illum), **surface)
    if glass:
        ior, tint = numbers.get("ni", DEFAULT_INDEX), material.colors.get("tf", (1.0, 1.0, 1.0))
        roughness = 0.0 if "ns" not in numbers else _smooth(_roughness(material))
        return make.dielectric(ior=ior, tint=tint, roughness=roughness, name=name, **surface)
    if illum in _MIRROR and any(ks):
        return _mirror(material, base, ks, surface, name)
    if illum in _MATTE or not any(ks):
        return make.diffuse(reflectance=base, name=name, **surface)
    strength = tuple(2.0 * k for k in ks)  # 0.5 is the reflectance of index 1.5
    return make.metallic_roughness(
        base_color=base,
        metallic=0.0,
        roughness=_roughness(material),
        specular_color=strength,
        name=name,
        **surface,
    )


def _blender_looks(material: Material, illum: float) -> dict[str, Value]:
    """Metallic share, roughness and specular level of one of Blender's; its images stand for them as they are."""
    share = min(max(material.colors.get("ka", (1.0, 1.0, 1.0))[0], 0.0), 1.0) if illum in _BLENDER_METAL else 0.0
    made: dict[str, Value] = {"metallic": share, "roughness": _roughness(material)}
    if share == 0.0:
        made |= _blender_gloss(material)
    images = {key: _image(material.maps[key], "linear") for key in BLENDER_MAPS if key in material.maps}
    for key, name in (("map_refl", "metallic"), ("map_ns", "roughness")):
        if key in images:
            made[name] = textures.scaled(images[key], channel="mean", scale=1.0)
    if "map_ks" in images:
        made["specular_color"] = textures.scaled(images["map_ks"], scale=2.0)
    return made


def _blender_gloss(material: Material) -> dict[str, Value]:
    """Blender's specular level, 0.5 being that of its index."""
    if not material.blender or "ks" not in material.colors:
        return {}
    return {"specular_color": tuple(2.0 * k for k in material.colors["ks"])}


def _opaque(material: Material, illum: float) -> bool:
    """Is what `illum` calls glass none? Blender's, and what would not be seen at all: Maya writes that everywhere."""
    unseen = material.numbers.get("ni") == 1.0 and material.colors.get("tf", (1.0, 1.0, 1.0)) == (1.0, 1.0, 1.0)
    return unseen or (material.blender and illum in _BLENDER_CLEAR)


def _mirror(
    material: Material, base: Value, ks: tuple[float, ...], surface: dict[str, Value], name: str | None
) -> Node:
    """Ks reflected as by a metal, the rest diffuse."""
    shine = _smooth(_roughness(material)) if "ns" in material.numbers else 0.0
    textured = isinstance(base, Node)
    kd = max(material.colors.get("kd", (0.0, 0.0, 0.0)))
    if kd == 0 and not textured:
        return make.conductor(reflectance=ks, fresnel="none", roughness=shine, name=name, **surface)
    share = max(ks) / (max(ks) + kd) if kd > 0 else max(ks)
    mirror = make.conductor(
        reflectance=tuple(min(k / share, 1.0) for k in ks), fresnel="none", roughness=shine, **surface
    )
    if not textured:
        base = tuple(min(b / (1.0 - share), 1.0) for b in base)
    return make.mix(first=make.diffuse(reflectance=base, **surface), second=mirror, amount=min(share, 1.0), name=name)


def _layers(material: Material) -> dict[str, Value]:
    """The PBR extension's sheen (Ps), clearcoat (Pc, Pcr) and anisotropy as OpenPBR's, with its roughness; {}: none.

    GGX's widths are alpha / q and alpha q, q^2 = 1 - 0.9 aniso, as in Disney's material, which the extension follows
    (B. Burley, "Physically-Based Shading at Disney", 2012); the coat has index 1.5. anisor counts whole turns, as in
    Blender.
    """
    sheen, coat, aniso = (_number(material, key, 0.0) for key in ("ps", "pc", "aniso"))
    through = max(material.colors.get("tf", (0.0,))) if material.blender else 0.0
    if (sheen, coat, aniso, through) == (0.0, 0.0, 0.0, 0.0):
        return {}
    roughness = _number(material, "pr", _roughness(material))
    made: dict[str, Value] = {"specular_roughness": roughness}
    if "specular_color" in (gloss := _blender_gloss(material)):
        made["specular_color"] = tuple(min(k, 1.0) for k in gloss["specular_color"])
    if through != 0.0:
        made |= {"transmission_weight": through, "specular_ior": material.numbers.get("ni", DEFAULT_INDEX)}
    if sheen != 0.0:
        made["fuzz_weight"] = sheen
    if coat != 0.0:
        coat = coat / BLENDER_COAT if material.blender and isinstance(coat, float) else coat
        made |= {"coat_weight": coat, "coat_roughness": _number(material, "pcr", 0.0), "coat_ior": 1.5}
        made["coat_darkening"] = 0.0
    if aniso != 0.0:
        made["specular_roughness_anisotropy"] = aniso
        turns = material.numbers.get("anisor", 0.0)
        if turns % 1.0 != 0.0:
            made["tangent_rotation"] = 360.0 * (turns % 1.0)
        if isinstance(aniso, float):
            square = 1.0 - 0.9 * aniso
            made["specular_roughness_anisotropy"] = 0.9 * aniso
            if isinstance(roughness, float):
                made["specular_roughness"] = min(roughness * ((1 / square + square) / 2) ** 0.25, 1.0)
    return made


def _roughness(material: Material) -> float:
    """From Ns: Blender's own formula, else that of a Phong lobe as wide."""
    if material.blender:
        return float(1.0 - (min(material.numbers.get("ns", 250.0), 1000.0) / 1000.0) ** 0.5)
    return float((2.0 / (material.numbers.get("ns", 10.0) + 2.0)) ** 0.25)


def _smooth(roughness: float) -> float:
    """Exponents from 1000 on mean a perfectly smooth surface: the format's way to say so."""
    return 0.0 if roughness <= (2.0 / 1002.0) ** 0.25 else roughness


def _surface(material: Material, *, glass: bool) -> dict[str, Value]:
    """Emission, opacity, normal map."""
    surface: dict[str, Value] = {}
    emission = _color(material, "ke", (0.0, 0.0, 0.0) if "map_ke" not in material.maps else (1.0, 1.0, 1.0))
    if isinstance(emission, Node) or any(emission):
        surface.update(emission=emission, emission_two_sided=True)
    opacity = _number(material, "d", material.opacity, given=material.opacity)
    if not glass and opacity != 1.0:
        surface["opacity"] = opacity
    normal = material.maps.get("norm")
    if normal is not None:
        surface["normal_map"] = _image(normal, "linear")
        if "-bm" in normal.numbers:
            surface["normal_scale"] = normal.numbers["-bm"][0]
    return surface


def _color(material: Material, key: str, default: tuple[float, ...]) -> Value:
    color = material.colors.get(key, default)
    image = material.maps.get(f"map_{key}")
    if image is None:
        return color
    texture = _image(image, "srgb")
    return texture if color == (1.0, 1.0, 1.0) or not any(color) else textures.scaled(texture, scale=color)


def _number(material: Material, key: str, default: float, given: float | None = None) -> Value:
    """A number in [0, 1] or its map; a map stands alone where the number is 0 or not given."""
    value = material.numbers.get(key, default) if given is None else given
    image = material.maps.get(f"map_{key}")
    if image is None:
        return value
    same = material.maps.get("map_kd")
    channel = "a" if key == "d" and same is not None and same.path == image.path else "mean"
    channel = _CHANNELS.get(image.words.get("-imfchan", ""), channel)
    alone = key not in material.numbers or value == 0.0
    return textures.scaled(_image(image, "linear"), channel=channel, scale=1.0 if alone else value)


def _image(image: Map, color_space: str) -> Node:
    settings: dict[str, Value] = {}
    if image.words.get("-clamp") == "on":
        settings.update(wrap_u="clamp", wrap_v="clamp")
    for option, name, default in (("-s", "uv_scale", 1.0), ("-o", "uv_offset", 0.0)):
        if option in image.numbers:
            settings[name] = tuple((image.numbers[option] + [default])[:2])
    return textures.image(image.path, color_space=color_space, **settings)
