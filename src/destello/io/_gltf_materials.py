"""glTF's materials as destello's.

The core material is `metallic_roughness`, with KHR_materials_ior, _specular, _transmission, _emissive_strength. Glass
with a volume (KHR_materials_volume, _dispersion) becomes `dielectric` with absorption inside; KHR_materials_unlit
becomes `emissive` in the base colour; what has other layers becomes `openpbr` (`_gltf_layers`).

Luminances are taken for radiances: 1 cd/m^2 is 1 W/(sr m^2).
"""

from __future__ import annotations

import math

import destello.materials as make
from destello.errors import Error, gather
from destello.io import _gltf_glossiness as glossiness
from destello.io import _gltf_layers as layers
from destello.io._gltf_json import ROUNDING, Document, Item
from destello.io._gltf_slots import Value, slot
from destello.io._gltf_textures import Curve, Textures, uv_set
from destello.io._gltf_variants import Variants
from destello.nodes import Node

EXTENSIONS = frozenset(
    {
        "KHR_materials_ior",
        "KHR_materials_specular",
        "KHR_materials_transmission",
        "KHR_materials_volume",
        "KHR_materials_dispersion",
        "KHR_materials_emissive_strength",
        "KHR_materials_unlit",
        "KHR_materials_pbrSpecularGlossiness",
        "KHR_texture_transform",
        "EXT_texture_webp",
    }
    | layers.EXTENSIONS
)
TEXTURED = (  # extension, member: where textures may stand
    ("pbrMetallicRoughness", "baseColorTexture"),
    ("pbrMetallicRoughness", "metallicRoughnessTexture"),
    ("", "emissiveTexture"),
    ("", "normalTexture"),
    ("KHR_materials_transmission", "transmissionTexture"),
    ("KHR_materials_specular", "specularTexture"),
    ("KHR_materials_specular", "specularColorTexture"),
    *layers.TEXTURED,
    (glossiness.EXTENSION, "diffuseTexture"),
    (glossiness.EXTENSION, "specularGlossinessTexture"),
)
_LEAST_ATTENUATION = 1e-6
_BY_TANGENTS = (  # with the normal map
    ("KHR_materials_anisotropy", "anisotropyTexture"),
    ("KHR_materials_clearcoat", "clearcoatNormalTexture"),
)


_MEMBERS = {  # what a parameter that is out of range is called in the file
    **dict.fromkeys(("base_color", "tint", "radiance", "opacity"), "pbrMetallicRoughness.baseColorFactor"),
    "transmission_color": "pbrMetallicRoughness.baseColorFactor",
    **dict.fromkeys(("roughness", "specular_roughness"), "pbrMetallicRoughness.roughnessFactor"),
    **dict.fromkeys(("metallic", "base_metalness"), "pbrMetallicRoughness.metallicFactor"),
    "emission": "emissiveFactor",
    "normal_scale": "normalTexture.scale",
    "ior": "extensions.KHR_materials_ior.ior",
    "specular_color": "extensions.KHR_materials_specular.specularColorFactor",
    "subsurface_color": "extensions.KHR_materials_diffuse_transmission.diffuseTransmissionColorFactor",
    "medium_absorption": "extensions.KHR_materials_volume.attenuationDistance",
    "thin_film_thickness": "extensions.KHR_materials_iridescence.iridescenceThicknessMaximum",
    "geometry_coat_normal_scale": "extensions.KHR_materials_clearcoat.clearcoatNormalTexture.scale",
}
_OLD_MEMBERS = _MEMBERS | {
    "base_color": f"extensions.{glossiness.EXTENSION}.diffuseFactor",
    "specular_color": f"extensions.{glossiness.EXTENSION}.specularFactor",
}


class Materials:
    """Makes each material of a document once for meshes with vertex colours and once for those without."""

    def __init__(self, document: Document, images: Textures, variants: Variants, notes: list[str]) -> None:
        self.document = document
        self._variants = variants
        self._images = images
        self._notes = notes
        self._made: dict[tuple[int, bool, bool], Node] = {}

    def of(self, primitive: Item) -> Item | None:
        """The material of a primitive in the chosen variant; None: glTF's default."""
        return self._variants.material(primitive)

    def node(self, item: Item | None, *, colored: bool, second: bool = False) -> Node:
        """The material (None: glTF's default).

        `colored`: vertex colours multiply its base colour. `second`: the mesh has both sets of texture coordinates.
        """
        key = (-1 if item is None else item.index, colored, second)
        if key not in self._made:
            source = item if item is not None else Item({}, self.document.file)
            first, other = self.uv_sets(item)
            self._images.readable, self._images.second = (first, other), other if second else None
            try:
                self._made[key] = self._convert(source, colored)
            except Error as error:
                raise error if error.file else _in_file(error, source) from None
        return self._made[key]

    def uv_sets(self, item: Item | None) -> tuple[int | None, int | None]:
        """Which two TEXCOORD_n the material's textures read; None: no (other) one. Textures of a third are left out.

        The first is that of what needs tangents, else of the base colour.
        """
        if item is None:
            return None, None
        bound = [item.item("normalTexture")]
        for name, key in _BY_TANGENTS:
            owner = item.extension(name)
            bound.append(None if owner is None else owner.item(key))
        sets = [uv_set(info) for info in (*bound, *_texture_infos(item)) if info is not None]
        first = sets[0] if sets else None
        second = next((number for number in sets if number != first), None)
        return first, second

    def _note(self, text: str) -> None:
        if text not in self._notes:
            self._notes.append(text)

    # --- materials ----------------------------------------------------------------------------------------------------

    def _convert(self, item: Item, colored: bool) -> Node:
        name = item.text("name", "") or None
        old = item.extension(glossiness.EXTENSION)
        if old is not None and item.extension("KHR_materials_unlit") is None:
            return self._old(item, old, colored, name)
        pbr = item.item("pbrMetallicRoughness") or Item({}, item.file, item.at("pbrMetallicRoughness"))
        red, green, blue, alpha = pbr.shares("baseColorFactor", 4)
        base_texture = self._texture(pbr, "baseColorTexture", "srgb")
        base = slot((red, green, blue), base_texture, colored=colored)
        surface = self._opacity(item, alpha, base_texture, colored)
        if item.extension("KHR_materials_unlit") is not None:
            return make.emissive(radiance=base, two_sided=True, name=name, **surface)
        surface.update(self._emission(item), **self._normal_map(item))
        rough = self._texture(pbr, "metallicRoughnessTexture", "linear")
        params: dict[str, Value] = {
            "base_color": base,
            "metallic": slot(pbr.number("metallicFactor", 1.0, low=0, high=1), rough, channel="b"),
            "roughness": slot(pbr.number("roughnessFactor", 1.0, low=0, high=1), rough, channel="g"),
            "ior": _ior(item),
            **self._specular(item),
        }
        transmission = self._transmission(item)
        layered = layers.Layers(item, self._texture, self._remapped, self._note)
        if layered.needed(transmission):
            return make.openpbr(name=name, **layered.params(params, transmission), **surface)
        volume = item.extension("KHR_materials_volume")
        if transmission != 0.0 and volume is not None and volume.number("thicknessFactor", 0.0, low=0) > 0:
            return _glass(item, volume, params, transmission, surface, name)
        if transmission != 0.0:
            params["transmission"] = transmission
        return make.metallic_roughness(name=name, **_without_defaults(params), **surface)

    def _old(self, item: Item, old: Item, colored: bool, name: str | None) -> Node:
        """KHR_materials_pbrSpecularGlossiness, which stands for the whole of pbrMetallicRoughness."""
        alpha = old.shares("diffuseFactor", 4)[3]
        texture = self._texture(old, "diffuseTexture", "srgb")
        surface = self._opacity(item, alpha, texture, colored) | self._emission(item) | self._normal_map(item)
        return make.metallic_roughness(name=name, **glossiness.params(old, texture, self._images, colored), **surface)

    def _opacity(self, item: Item, alpha: float, texture: Node | None, colored: bool) -> dict[str, Value]:
        mode = item.choice("alphaMode", ("OPAQUE", "MASK", "BLEND"), "OPAQUE")
        cutoff = item.number("alphaCutoff", 0.5, low=0) if mode == "MASK" else 0.0
        if mode == "OPAQUE" or (mode == "MASK" and cutoff == 0):
            return {}
        opacity = slot(alpha, texture, channel="a", colored=colored)
        if isinstance(opacity, float):
            opacity = min(opacity, 1.0)
            if mode == "MASK":
                opacity = 1.0 if opacity >= cutoff else 0.0
            return {} if opacity == 1.0 else {"opacity": opacity}
        if cutoff > 1:
            return {"opacity": 0.0}
        return {"opacity": opacity, "opacity_cutoff": cutoff} if cutoff else {"opacity": opacity}

    def _emission(self, item: Item) -> dict[str, Value]:
        factor = item.numbers("emissiveFactor", 3, (0.0, 0.0, 0.0), low=0)
        extension = item.extension("KHR_materials_emissive_strength")
        strength = 1.0 if extension is None else extension.number("emissiveStrength", 1.0, low=0)
        factor = tuple(f * strength for f in factor)
        if not any(factor):
            return {}
        params: dict[str, Value] = {"emission": slot(factor, self._texture(item, "emissiveTexture", "srgb"))}
        if item.flag("doubleSided"):
            params["emission_two_sided"] = True
        return params

    def _normal_map(self, item: Item) -> dict[str, Value]:
        texture = self._texture(item, "normalTexture", "linear")
        if texture is None:
            return {}
        info = item.item("normalTexture")
        scale = 1.0 if info is None else info.number("scale", 1.0)
        return {"normal_map": texture} if scale == 1.0 else {"normal_map": texture, "normal_scale": scale}

    def _specular(self, item: Item) -> dict[str, Value]:
        extension = item.extension("KHR_materials_specular")
        if extension is None:
            return {}
        strength = extension.number("specularFactor", 1.0, low=0, high=1)
        color = extension.numbers("specularColorFactor", 3, (1.0, 1.0, 1.0), low=0)
        return {
            "specular": slot(strength, self._texture(extension, "specularTexture", "linear"), channel="a"),
            "specular_color": slot(color, self._texture(extension, "specularColorTexture", "srgb")),
        }

    def _transmission(self, item: Item) -> Value:
        extension = item.extension("KHR_materials_transmission")
        if extension is None:
            return 0.0
        factor = extension.number("transmissionFactor", 0.0, low=0, high=1)
        if factor == 0.0:
            return 0.0
        return slot(factor, self._texture(extension, "transmissionTexture", "linear"), channel="r")

    def _texture(self, item: Item, key: str, color_space: str) -> Node | None:
        info = item.item(key)
        return None if info is None else self._images.image(info, color_space)

    def _remapped(self, item: Item, key: str, channel: str, curve: Curve) -> Node | None:
        info = item.item(key)
        return None if info is None else self._images.remapped(info, channel, curve)


def _in_file(error: Error, item: Item) -> Error:
    """What is wrong with a node's parameters as errors at the file's members."""
    members = _OLD_MEMBERS if item.extension(glossiness.EXTENSION) is not None else _MEMBERS
    problems = []
    for problem in error.problems:
        place = problem.place or ""
        member = members.get(place.rpartition(".")[2], place)
        problems.append(item.error(problem.problem, member, value=problem.value, expected=problem.expected))
    return gather(problems) or error


def _texture_infos(item: Item) -> list[Item]:
    found = []
    for holder, key in TEXTURED:
        owner = item if not holder else item.extension(holder) if holder.startswith("KHR") else item.item(holder)
        info = None if owner is None else owner.item(key)
        if info is not None:
            found.append(info)
    return found


def _without_defaults(params: dict[str, Value]) -> dict[str, Value]:
    return {key: value for key, value in params.items() if not (key == "ior" and value == 1.5)}


def _ior(item: Item) -> float:
    extension = item.extension("KHR_materials_ior")
    ior = 1.5 if extension is None else extension.number("ior", 1.5, low=0)
    if ior == 0.0:  # glTF's word for "reflects everything"
        return 1000.0
    if ior < 1.0 - ROUNDING and extension is not None:
        raise extension.error("out of range", "ior", value=ior, expected="0 or a number of at least 1")
    return min(max(ior, 1.0), 1000.0)


def _glass(
    item: Item, volume: Item, params: dict[str, Value], transmission: Value, surface: dict[str, Value], name: str | None
) -> Node:
    """A solid body: refraction and absorption by the way through it. A share that does not transmit is mixed in."""
    color = volume.numbers("attenuationColor", 3, (1.0, 1.0, 1.0), low=0)
    glass: dict[str, Value] = {
        "ior": params["ior"],
        "roughness": params["roughness"],
        "tint": params["base_color"],
        **surface,
    }
    if any(c < 1 for c in color) and "attenuationDistance" in volume:
        distance = volume.number("attenuationDistance", low=1e-30)
        glass["medium_absorption"] = tuple(-math.log(min(max(c, _LEAST_ATTENUATION), 1.0)) / distance for c in color)
    dispersion = item.extension("KHR_materials_dispersion")
    amount = 0.0 if dispersion is None else dispersion.number("dispersion", 0.0, low=0)
    if amount > 0:
        glass["abbe"] = layers.abbe_number(amount)
    if transmission == 1.0 and params["metallic"] == 0.0:
        return make.dielectric(name=name, **glass)
    opaque, clear = make.metallic_roughness(**_without_defaults(params), **surface), make.dielectric(**glass)
    metallic = params["metallic"]
    if isinstance(metallic, float) and isinstance(transmission, float):
        transmission, metallic = transmission * (1.0 - metallic), 0.0
    if metallic == 0.0:
        return make.mix(first=opaque, second=clear, amount=transmission, name=name)
    dielectric = make.mix(first=opaque, second=clear, amount=transmission)
    return make.mix(first=dielectric, second=opaque, amount=metallic, name=name)
