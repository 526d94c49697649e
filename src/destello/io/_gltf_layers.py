"""glTF's layered materials as OpenPBR Surface 1.1: what `metallic_roughness` and `dielectric` do not have.

Clearcoat, sheen, iridescence, anisotropy, diffuse transmission, volume scatter, each by itself and together with what
the core material, specular, ior, transmission, volume and dispersion say. What is only near is told in docs/formats.md.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from destello.io._gltf_json import Item
from destello.io._gltf_slots import Value, slot
from destello.io._gltf_textures import Curve, Line
from destello.nodes import Node

EXTENSIONS = frozenset(
    {
        "KHR_materials_clearcoat",
        "KHR_materials_sheen",
        "KHR_materials_iridescence",
        "KHR_materials_anisotropy",
        "KHR_materials_diffuse_transmission",
        "KHR_materials_volume_scatter",
    }
)
TEXTURED = (  # extension, member: where textures may stand
    ("KHR_materials_clearcoat", "clearcoatTexture"),
    ("KHR_materials_clearcoat", "clearcoatRoughnessTexture"),
    ("KHR_materials_clearcoat", "clearcoatNormalTexture"),
    ("KHR_materials_sheen", "sheenColorTexture"),
    ("KHR_materials_sheen", "sheenRoughnessTexture"),
    ("KHR_materials_iridescence", "iridescenceTexture"),
    ("KHR_materials_iridescence", "iridescenceThicknessTexture"),
    ("KHR_materials_anisotropy", "anisotropyTexture"),
    ("KHR_materials_diffuse_transmission", "diffuseTransmissionTexture"),
    ("KHR_materials_diffuse_transmission", "diffuseTransmissionColorTexture"),
)
_LEAST_TRANSMITTANCE = 1e-6
_MOST_IOR, _MOST_FILM_IOR = 100.0, 3.0  # up to where OpenPBR tells indices, and films, apart
_STRAIGHT = 0.99  # the largest anisotropy: what a thin wall scatters back then is half a per cent
_NEVER = 1e30  # m: an attenuation distance that attenuates nothing

Texture = Callable[[Item, str, str], "Node | None"]
Remap = Callable[[Item, str, str, Curve], "Node | None"]


class Layers:
    """Reads the extensions of one material.

    `texture(item, key, color_space)` makes the texture at item[key], or None; `remap(item, key, channel, curve)`
    a curve of one of its channels as a grey image in [0, 1]; `note` tells people something.
    """

    def __init__(self, item: Item, texture: Texture, remap: Remap, note: Callable[[str], None]) -> None:
        self._item = item
        self._texture = texture
        self._remap = remap
        self._note = note

    def needed(self, transmission: Value) -> bool:
        """Whether the material has a layer that only OpenPBR has. `transmission`: KHR_materials_transmission's."""
        strengths = (
            ("KHR_materials_clearcoat", "clearcoatFactor"),
            ("KHR_materials_iridescence", "iridescenceFactor"),
            ("KHR_materials_anisotropy", "anisotropyStrength"),
            ("KHR_materials_diffuse_transmission", "diffuseTransmissionFactor"),
        )
        if any(self._factor(name, key) > 0 for name, key in strengths):
            return True
        return (self._refracts(transmission) and (any(self._scatter_color()) or self._tinted())) or any(
            self._sheen_color()
        )

    def params(self, core: dict[str, Value], transmission: Value) -> dict[str, Value]:
        """OpenPBR's parameters, from those of `metallic_roughness` (with the transmission apart) and the extensions."""
        made: dict[str, Value] = {
            "base_color": core["base_color"],
            "base_metalness": core["metallic"],
            "specular_roughness": core["roughness"],
            "specular_ior": min(core["ior"], _MOST_IOR),
        }
        if core["metallic"] != 1.0:  # OpenPBR's strength and colour would act on metal, too, and glTF's do not
            reflection = self._reflection if self._refracts(transmission) else self._specular
            made |= reflection(core["ior"])
        made |= self._coat() | self._fuzz() | self._film() | self._anisotropy(core["roughness"])
        if transmission != 0.0:
            made |= self._transmission(core["base_color"], transmission)
        return made | self._translucence(made.get("geometry_thin_walled", False), transmission)

    def _specular(self, ior: float) -> dict[str, Value]:
        """Strength and colour head-on. What exceeds the ranges of index and colour goes into the strength."""
        found = self._item.extension("KHR_materials_specular") or Item({}, self._item.file, self._item.place)
        strength, color = self._specular_factors(found)
        most = max(1.0, *color)
        strength *= most
        if ior > _MOST_IOR:
            strength *= head_on(ior) / head_on(_MOST_IOR)
        made = {
            "specular_weight": slot(strength, self._texture(found, "specularTexture", "linear"), channel="a"),
            "specular_color": slot(
                tuple(c / most for c in color), self._texture(found, "specularColorTexture", "srgb")
            ),
        }
        return {name: value for name, value in made.items() if value not in (1.0, (1.0, 1.0, 1.0))}

    def _tinted(self) -> bool:
        """Whether KHR_materials_specular changes what an index of refraction reflects."""
        found = self._item.extension("KHR_materials_specular")
        return found is not None and (
            "specularTexture" in found
            or "specularColorTexture" in found
            or self._specular_factors(found) != (1.0, (1.0, 1.0, 1.0))
        )

    @staticmethod
    def _specular_factors(found: Item) -> tuple[float, tuple[float, ...]]:
        strength = found.number("specularFactor", 1.0, low=0, high=1)
        return strength, found.numbers("specularColorFactor", 3, (1.0, 1.0, 1.0), low=0)

    def _reflection(self, ior: float) -> dict[str, Value]:
        """Strength and colour of what refracts, as a colour: OpenPBR's weight is another index, which bends light."""
        made: dict[str, Value] = {}
        if ior > _MOST_IOR:
            made["specular_weight"] = head_on(ior) / head_on(_MOST_IOR)
        found = self._item.extension("KHR_materials_specular")
        if found is None:
            return made
        strength, color = self._specular_factors(found)
        if max(color) * strength > 1:
            self._note(f"{found.at('specularColorFactor')}: glass that refracts reflects no more than its index does")
        tint = tuple(min(strength * c, 1.0) for c in color)
        image = self._texture(found, "specularColorTexture", "srgb")
        if image is None:
            image = self._remap(found, "specularTexture", "a", Line(1.0, 0.0))
        elif "specularTexture" in found:
            self._note(f"{found.at('specularTexture')}: left out beside specularColorTexture on glass that refracts")
        value = slot(tint, image)
        return made if value == (1.0, 1.0, 1.0) else made | {"specular_color": value}

    # --- layers -------------------------------------------------------------------------------------------------------

    def _coat(self) -> dict[str, Value]:
        """A coat of index 1.5 that does not darken what is below by reflecting within, as glTF's layering has it."""
        coat = self._item.extension("KHR_materials_clearcoat")
        factor = self._factor("KHR_materials_clearcoat", "clearcoatFactor")
        if coat is None or factor == 0:
            return {}
        rough = coat.number("clearcoatRoughnessFactor", 0.0, low=0, high=1)
        return {
            "coat_weight": slot(factor, self._texture(coat, "clearcoatTexture", "linear")),
            "coat_roughness": slot(rough, self._texture(coat, "clearcoatRoughnessTexture", "linear"), channel="g"),
            "coat_ior": 1.5,
            "coat_darkening": 0.0,
            **self._coat_normal(coat),
        }

    def _coat_normal(self, coat: Item) -> dict[str, Value]:
        """The coat's own normals; without them it has the geometry's, whatever the base's normal map."""
        texture, info = self._texture(coat, "clearcoatNormalTexture", "linear"), coat.item("clearcoatNormalTexture")
        if texture is None or info is None:
            return {}
        scale = info.number("scale", 1.0)
        made: dict[str, Value] = {"geometry_coat_normal": texture}
        return made if scale == 1.0 else made | {"geometry_coat_normal_scale": scale}

    def _fuzz(self) -> dict[str, Value]:
        sheen = self._item.extension("KHR_materials_sheen")
        color = self._sheen_color()
        if sheen is None or not any(color):
            return {}
        strongest = min(max(color), 1.0)
        tint = tuple(min(c / strongest, 1.0) for c in color)
        rough = sheen.number("sheenRoughnessFactor", 0.0, low=0, high=1)
        return {
            "fuzz_weight": strongest,
            "fuzz_color": slot(tint, self._texture(sheen, "sheenColorTexture", "srgb")),
            "fuzz_roughness": slot(rough, self._texture(sheen, "sheenRoughnessTexture", "linear"), channel="a"),
        }

    def _film(self) -> dict[str, Value]:
        """Thickness in micrometres, which glTF has in nanometres."""
        film = self._item.extension("KHR_materials_iridescence")
        factor = self._factor("KHR_materials_iridescence", "iridescenceFactor")
        if film is None or factor == 0:
            return {}
        low = film.number("iridescenceThicknessMinimum", 100.0, low=0)
        high = film.number("iridescenceThicknessMaximum", 400.0, low=0)
        most = max(low, high)
        thickness: Value = high * 1e-3
        if "iridescenceThicknessTexture" in film and most > 0:
            image = self._remap(film, "iridescenceThicknessTexture", "g", Line((high - low) / most, low / most))
            thickness = thickness if image is None else slot(most * 1e-3, image)
        index = film.number("iridescenceIor", 1.3, low=1)
        if index > _MOST_FILM_IOR:
            self._note(
                f"{film.at('iridescenceIor')}: {index:g} counts as {_MOST_FILM_IOR:g}, the most that a film can have"
            )
        return {
            "thin_film_weight": slot(factor, self._texture(film, "iridescenceTexture", "linear")),
            "thin_film_thickness": thickness,
            "thin_film_ior": min(index, _MOST_FILM_IOR),
        }

    def _anisotropy(self, roughness: Value) -> dict[str, Value]:
        """Widths of GGX along and across: glTF has (lerp(a, 1, s^2), a), OpenPBR r^2 sqrt(2 / (1 + q^2)) (1, q)."""
        found = self._item.extension("KHR_materials_anisotropy")
        strength = self._factor("KHR_materials_anisotropy", "anisotropyStrength")
        if found is None or strength == 0:
            return {}
        rough = roughness if isinstance(roughness, float) else 0.5  # a textured one: as if it were half
        across = max(rough * rough, 1e-4)

        def along(x: NDArray[Any]) -> NDArray[Any]:
            return across + (1.0 - across) * np.square(strength * x)

        def by_strength(curve: Curve) -> Value:
            image = self._remap(found, "anisotropyTexture", "b", curve)
            return float(curve(np.ones(()))) if image is None else image

        made: dict[str, Value] = {"specular_roughness_anisotropy": by_strength(lambda x: 1.0 - across / along(x))}
        if isinstance(roughness, float):
            made["specular_roughness"] = by_strength(
                lambda x: np.minimum(((np.square(along(x)) + across * across) / 2) ** 0.25, 1.0)
            )
        texture = self._texture(found, "anisotropyTexture", "linear")
        turn = found.number("anisotropyRotation", 0.0)
        if texture is not None:  # its red and green are the direction, which the angle turns
            return made | {"tangent_map": texture, "tangent_rotation": math.degrees(turn)}
        if turn != 0:  # towards the bitangent, also where that is on the other side as in mirrored coordinates
            made["tangent_map"] = (0.5 + 0.5 * math.cos(turn), 0.5 + 0.5 * math.sin(turn), 0.5)
        return made

    # --- light that passes --------------------------------------------------------------------------------------------

    def _transmission(self, base_color: Value, transmission: Value) -> dict[str, Value]:
        made: dict[str, Value] = {"transmission_weight": transmission}
        if not self._thick():
            return made | {"transmission_color": base_color, "geometry_thin_walled": True}
        if base_color == (1.0, 1.0, 1.0) or self._dense():
            made |= self._medium()
            if base_color != (1.0, 1.0, 1.0):
                self._note(f"{self._item.place}: the base colour does not tint light that enters the volume")
        else:
            made |= {"transmission_color": base_color} | self._common_medium()
        abbe = self.abbe()
        if abbe is not None:
            made |= {"transmission_dispersion_abbe_number": abbe, "transmission_dispersion_scale": 1.0}
        return made

    def _medium(self) -> dict[str, Value]:
        """What the surface encloses, by OpenPBR's own parameters."""
        (color, distance), multiple = self._attenuation(), self._scatter_color()
        if distance >= _NEVER or color == (1.0, 1.0, 1.0):
            return {}
        lost = [-math.log(c) for c in color]
        scattered = [single_scatter_albedo(m) * e for m, e in zip(multiple, lost, strict=True)]
        part = 1.0 / max(1.0, *scattered)  # scattering times depth is at most 1: said for a part of the distance
        made: dict[str, Value] = {"transmission_color": color, "transmission_depth": distance}
        if part < 1:
            made = {
                "transmission_color": tuple(math.exp(-e * part) for e in lost),
                "transmission_depth": distance * part,
            }
        if not any(scattered):
            return made
        return made | {
            "transmission_scatter": tuple(s * part for s in scattered),
            "transmission_scatter_anisotropy": self._scatter_anisotropy(),
        }

    def _common_medium(self) -> dict[str, Value]:
        """The same by the parameters that all materials have; the surface keeps its own tint then."""
        (color, distance), multiple = self._attenuation(), self._scatter_color()
        if distance >= _NEVER or color == (1.0, 1.0, 1.0):
            return {}
        extinction = [-math.log(c) / distance for c in color]
        scattering = [single_scatter_albedo(m) * e for m, e in zip(multiple, extinction, strict=True)]
        made: dict[str, Value] = {
            "medium_absorption": tuple(e - s for e, s in zip(extinction, scattering, strict=True))
        }
        if any(scattering):
            made |= {"medium_density": tuple(scattering), "medium_anisotropy": self._scatter_anisotropy()}
        return made

    def _refracts(self, transmission: Value) -> bool:
        """Whether light that passes clearly is bent: there is an inside."""
        return transmission != 0.0 and self._thick()

    def _dense(self) -> bool:
        """Whether light that passes diffusely walks through a scattering medium."""
        translucent = self._factor("KHR_materials_diffuse_transmission", "diffuseTransmissionFactor") > 0
        return translucent and self._thick() and any(self._scatter_color()) and self._attenuation()[1] < _NEVER

    def abbe(self) -> float | None:
        """The Abbe number of KHR_materials_dispersion, or None without dispersion."""
        amount = self._factor("KHR_materials_dispersion", "dispersion", high=math.inf)
        return abbe_number(amount) if amount > 0 else None

    def _translucence(self, thin: bool, transmission: Value) -> dict[str, Value]:
        """Diffuse transmission: a thin wall's subsurface scatters straight on; a volume's walks through its medium."""
        found = self._item.extension("KHR_materials_diffuse_transmission")
        factor = self._factor("KHR_materials_diffuse_transmission", "diffuseTransmissionFactor")
        if found is None or factor == 0:
            return {}
        color = found.shares("diffuseTransmissionColorFactor", 3)
        share = self._texture(found, "diffuseTransmissionTexture", "linear")
        tint = self._texture(found, "diffuseTransmissionColorTexture", "srgb")
        made: dict[str, Value] = {
            "subsurface_weight": slot(factor, share, channel="a"),
            "subsurface_color": slot(color, tint),
        }
        scatter, (attenuation, distance) = self._scatter_color(), self._attenuation()
        if not self._dense():
            if self._refracts(transmission) and not thin:
                self._note(f"{found.place}: diffuse transmission beside a refracting volume is left out")
                return {}
            return made | {"subsurface_scatter_anisotropy": _STRAIGHT, "geometry_thin_walled": True}
        paths = [distance / max(-math.log(c), 1e-9) for c in attenuation]  # mean free paths, m
        longest = max(paths)
        return made | {
            "subsurface_color": slot(tuple(min(s * c, 1.0) for s, c in zip(scatter, color, strict=True)), tint),
            "subsurface_radius": longest,
            "subsurface_radius_scale": tuple(path / longest for path in paths),
            "subsurface_scatter_anisotropy": self._scatter_anisotropy(),
        }

    # --- numbers ------------------------------------------------------------------------------------------------------

    def _factor(self, name: str, key: str, high: float = 1.0) -> float:
        found = self._item.extension(name)
        return 0.0 if found is None else found.number(key, 0.0, low=0, high=high)

    def _sheen_color(self) -> tuple[float, ...]:
        sheen = self._item.extension("KHR_materials_sheen")
        return (0.0,) * 3 if sheen is None else sheen.numbers("sheenColorFactor", 3, (0.0, 0.0, 0.0), low=0)

    def _scatter_color(self) -> tuple[float, ...]:
        found = self._item.extension("KHR_materials_volume_scatter")
        color = (0.0,) * 3 if found is None else found.numbers("multiscatterColor", 3, (0.0, 0.0, 0.0), low=0)
        return tuple(min(c, 1.0) for c in color)

    def _scatter_anisotropy(self) -> float:
        found = self._item.extension("KHR_materials_volume_scatter")
        value = 0.0 if found is None else found.number("scatterAnisotropy", 0.0, low=-1, high=1)
        return min(max(value, -_STRAIGHT), _STRAIGHT)

    def _thick(self) -> bool:
        """Whether the surface encloses a volume; without a thickness it is a thin wall."""
        return self._factor("KHR_materials_volume", "thicknessFactor", high=math.inf) > 0

    def _attenuation(self) -> tuple[tuple[float, ...], float]:
        """What is left of the light, by colour, after a distance in metres."""
        volume = self._item.extension("KHR_materials_volume")
        if volume is None or "attenuationDistance" not in volume:
            return (1.0, 1.0, 1.0), _NEVER
        color = volume.numbers("attenuationColor", 3, (1.0, 1.0, 1.0), low=0)
        distance = volume.number("attenuationDistance", low=1e-30)
        return tuple(min(max(c, _LEAST_TRANSMITTANCE), 1.0) for c in color), distance


def abbe_number(dispersion: float) -> float:
    """KHR_materials_dispersion's amount, above 0, as an Abbe number within OpenPBR's range."""
    return min(max(20.0 / dispersion, 1.0), 1000.0)


def head_on(ior: float) -> float:
    """The reflectance head-on of an index of refraction."""
    return ((ior - 1.0) / (ior + 1.0)) ** 2


def single_scatter_albedo(multiple: float) -> float:
    """The albedo of one scattering, from that of all of them together (C. Kulla, A. Conty 2017, as the extension)."""
    if multiple <= 0:
        return 0.0  # which the fit misses by 6e-6
    root = math.sqrt(9.59217 + 41.6808 * multiple + 17.7126 * multiple * multiple)
    return min(max(1.0 - (4.09712 + 4.20863 * multiple - root) ** 2, 0.0), 1.0)
