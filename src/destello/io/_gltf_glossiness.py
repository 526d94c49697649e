"""KHR_materials_pbrSpecularGlossiness, the archived extension of old files, as `metallic_roughness`.

Its dielectric layer with an index of 1000 reflects `specular_color` head-on and everything at grazing angles, and
leaves to the diffuse colour what it does not reflect: the extension's model, with its energy kept at every angle.
"""

from __future__ import annotations

from destello.io._gltf_json import Item
from destello.io._gltf_slots import Value, slot
from destello.io._gltf_textures import Line, Textures
from destello.nodes import Node

EXTENSION = "KHR_materials_pbrSpecularGlossiness"
_IOR = 1000.0
_HEAD_ON = ((_IOR - 1) / (_IOR + 1)) ** 2


def params(old: Item, diffuse: Node | None, images: Textures, colored: bool) -> dict[str, Value]:
    """The parameters of `metallic_roughness`. `diffuse`: the diffuse texture. Raises FormatError."""
    color = old.shares("diffuseFactor", 4)[:3]
    specular = old.numbers("specularFactor", 3, (1.0, 1.0, 1.0), low=0)
    gloss = old.number("glossinessFactor", 1.0, low=0, high=1)
    info = old.item("specularGlossinessTexture")
    texture = None if info is None else images.image(info, "srgb")
    rough: Value = 1.0 - gloss
    if info is not None and texture is not None and gloss > 0:
        image = images.remapped(info, "a", Line(-gloss, 1.0))
        rough = rough if image is None else image
    return {
        "base_color": slot(color, diffuse, colored=colored),
        "metallic": 0.0,
        "roughness": rough,
        "ior": _IOR,
        "specular_color": slot(tuple(s / _HEAD_ON for s in specular), texture),
    }
