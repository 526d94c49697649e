"""MTL files, the materials of OBJ: parsed, and turned into destello's.

Decisions where the format leaves room:
- With Pr, Pm or their maps the material is `metallic_roughness`, Kd its base colour; with Ps, Pc or aniso it is
  `openpbr` (see `_layers`).
- illum 4, 6, 7 and 9 are glass of index Ni, tinted by Tf, but where Ni is 1 and Tf white (Maya writes this for all
  that is opaque); illum 3, 5 and 8 mirror Ks over the diffuse Kd.
- Otherwise Ks is the strength of a dielectric's gloss, 0.5 being that of index 1.5, and Ns its Phong exponent
  (roughness is the fourth root of 2 / (Ns + 2)); without Ks, or with illum 0 or 1, the material is diffuse.
- Files that Blender wrote (they say so in their first comment) are read as it means them: Ns is 1000 (1 - roughness)^2,
  illum 3 and 6 are metals with Ka as the metallic share, illum 6 and 9 are see-through by d and no glass, and map_Ns,
  map_refl and map_Ks are the images of roughness, metallic share and specular level themselves.
- Bump maps are kept as `maps["bump"]`, for `_obj_bump` to tell what they are.
- Colours are linear; maps multiply their colour, and stand alone where that is black or not given.
"""

from __future__ import annotations

import codecs
import math
from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import destello.materials as make
import destello.textures as textures
from destello.errors import Error, FormatError
from destello.io._text import numbered_lines, printable, unquoted
from destello.nodes import Node

_COLORS = ("ka", "kd", "ks", "ke", "tf")
_NUMBERS = ("ns", "ni", "d", "tr", "pr", "pm", "ps", "pc", "pcr", "aniso", "anisor", "illum")
_MAPS = ("map_kd", "map_ke", "map_d", "map_pr", "map_pm", "map_ps", "map_pc", "map_pcr", "map_aniso", "norm")
_BLENDER_MAPS = ("map_ns", "map_refl", "map_ks")
_BUMPS = ("bump", "map_bump")
_UNSEEN = ("map_ka", "sharpness")  # ambient light and the like: nothing that a path tracer misses
_OPTIONS = {"-o": 3, "-s": 3, "-t": 3, "-mm": 2, "-bm": 1, "-boost": 1, "-texres": 1}  # numbers at most
_WORDS = ("-clamp", "-blendu", "-blendv", "-imfchan", "-type", "-cc")
_CHANNELS = {"r": "r", "g": "g", "b": "b", "m": "a", "l": "mean", "z": "mean"}
_GLASS, _MIRROR, _MATTE = (4, 6, 7, 9), (3, 5, 8), (0, 1)
_BLENDER_METAL, _BLENDER_CLEAR = (3, 6), (6, 9)
_ACCEPTED = {  # least and most
    **dict.fromkeys(("kd", "ks", "tf", "d", "tr", "pr", "pm", "ps", "pc", "pcr", "aniso"), (0.0, 1.0)),
    **dict.fromkeys(("ke", "ns"), (0.0, math.inf)),
}
_ILLUMS, _DEFAULT_ILLUM, _DEFAULT_INDEX = range(11), 2.0, 1.5

Value = Any  # a number, three numbers or a texture node


@dataclass
class Map:
    """A texture map: its file (relative to the scene) and its options."""

    path: str
    line: int
    numbers: dict[str, list[float]] = field(default_factory=dict)
    words: dict[str, str] = field(default_factory=dict)


@dataclass
class Material:
    """One newmtl block, keywords in lower case. `opacity`: d, or 1 - Tr; `blender`: that program wrote it."""

    name: str
    line: int
    colors: dict[str, tuple[float, float, float]] = field(default_factory=dict)
    numbers: dict[str, float] = field(default_factory=dict)
    maps: dict[str, Map] = field(default_factory=dict)
    opacity: float = 1.0
    blender: bool = False


def parse(data: bytes, file: Path, folder: str) -> tuple[list[Material], Counter[str], list[str]]:
    """The materials of an MTL file, how often statements were not understood, what else to say. Raises FormatError.

    `folder`: the file's directory relative to the scene's, "" if it is the same; map paths are prefixed with it.
    """
    parser = _Parser(file, folder)
    for number, line in numbered_lines(data.removeprefix(codecs.BOM_UTF8)):
        words = printable(line).split()
        if words[:2] == ["#", "Blender"] and not parser.materials:
            parser.blender = True
        if words and not words[0].startswith("#"):
            parser.statement(words[0].lower(), words[1:], printable(line), number)
    return parser.materials, parser.ignored, parser.notes()


class _Parser:
    def __init__(self, file: Path, folder: str) -> None:
        self.file = file
        self.folder = folder
        self.blender = False
        self.materials: list[Material] = []
        self.ignored: Counter[str] = Counter()
        self._said: dict[str, str] = {}  # by keyword: what was the matter with it first
        self._times: Counter[str] = Counter()

    def notes(self) -> list[str]:
        """What was not taken as it stands, once for each keyword."""
        more = {keyword: count - 1 for keyword, count in self._times.items()}
        return [text + (f"; {more[keyword]} more" if more[keyword] else "") for keyword, text in self._said.items()]

    def _say(self, keyword: str, line: int, text: str) -> None:
        name = self.materials[-1].name
        self._said.setdefault(keyword, f"{self.file.name}:{line}: newmtl {name}: {text}")
        self._times[keyword] += 1

    def _accepted(self, keyword: str, values: list[float], line: int) -> list[float]:
        """The values in their range."""
        if keyword == "illum":
            made, known = [v if v in _ILLUMS else _DEFAULT_ILLUM for v in values], f"0 to {_ILLUMS[-1]}"
        elif keyword == "ni":
            made, known = [v if v > 0 else _DEFAULT_INDEX for v in values], "above 0"
        else:
            low, high = _ACCEPTED.get(keyword, (-math.inf, math.inf))
            made = [min(max(v, low), high) for v in values]
            known = f"{low:g} to {high:g}" if high < math.inf else f"at least {low:g}"
        if made != values:
            was, counts = (" ".join(f"{v:g}" for v in numbers) for numbers in (values, made))
            self._say(keyword, line, f"{_spelled(keyword)} {was} counts as {counts} (accepted: {known})")
        return made

    def statement(self, keyword: str, words: list[str], line: str, number: int) -> None:
        """Takes in one line."""
        if keyword == "newmtl":
            name = line.partition(line.split()[0])[2].strip()
            self.materials.append(Material(name, number, blender=self.blender))
            return
        if not self.materials:
            raise FormatError(f"{keyword} before the first newmtl", file=self.file, line=number, expected="newmtl")
        material = self.materials[-1]
        if keyword in _COLORS and words[:1] not in (["spectral"], ["xyz"]):
            red, *others = self._accepted(keyword, self._numbers(keyword, words, number, (1, 3)), number)
            material.colors[keyword] = (red, others[0], others[1]) if others else (red, red, red)
        elif keyword in _NUMBERS:
            values = self._numbers(keyword, words[1:] if words[:1] == ["-halo"] else words, number, (1,))
            (value,) = self._accepted(keyword, values, number)
            material.numbers[keyword] = value
            if keyword in ("d", "tr"):
                self._opacity(material, number)
        elif keyword in _MAPS or (self.blender and keyword in _BLENDER_MAPS):
            material.maps[keyword] = self._map(words, line, number)
        elif keyword in _BUMPS:
            material.maps["bump"] = self._map(words, line, number)
        elif keyword not in _UNSEEN:
            self.ignored[keyword[:20]] += 1

    def _opacity(self, material: Material, line: int) -> None:
        """MTL has d; Tr is 1 - d to most programs that add it, but d again to some, so d decides."""
        d, tr = (material.numbers.get(key) for key in ("d", "tr"))
        if d is None:
            material.opacity = 1.0 - (tr or 0.0)
            return
        material.opacity = d
        if tr is not None and abs(1.0 - tr - d) > 0.01:
            self._say("d beside tr", line, f"d {d:g} and Tr {tr:g} differ: d counts (accepted: Tr = 1 - d)")

    def _numbers(self, keyword: str, words: list[str], line: int, counts: tuple[int, ...]) -> list[float]:
        try:
            before = next((at for at, word in enumerate(words) if word.startswith("#")), len(words))
            values = [float(word) for word in words[:before]][: max(counts)]
            if len(values) not in counts or not all(abs(v) < 1e30 for v in values):
                raise ValueError
        except ValueError:
            wanted = " or ".join(map(str, counts))
            raise FormatError(
                f"{keyword}: wrong values",
                file=self.file,
                line=line,
                value=" ".join(words),
                expected=f"{wanted} finite numbers",
            ) from None
        return values

    def _map(self, words: list[str], line: str, number: int) -> Map:
        found = Map("", number)
        at = 0
        while at < len(words) - 1 and words[at].lower() in (*_OPTIONS, *_WORDS):
            option = words[at].lower()
            at += 1
            if option in _WORDS:
                found.words[option] = words[at].lower()
                at += 1
                continue
            values: list[str] = []
            while at < len(words) - 1 and len(values) < _OPTIONS[option] and _is_number(words[at]):
                values.append(words[at])
                at += 1
            found.numbers[option] = self._numbers(option, values or words[at : at + 1], number, (1, 2, 3))
        name = line.split(maxsplit=at + 1)[at + 1].strip() if at < len(words) else ""
        if not name or "\0" in name:
            raise FormatError("a map without a file", file=self.file, line=number, value=line, expected="a path")
        name = unquoted(name).replace("\\", "/")
        found.path = f"{self.folder}/{name}" if self.folder and not name.startswith("/") else name
        return found


def _spelled(keyword: str) -> str:
    """As MTL writes it."""
    return keyword if keyword in ("d", "illum", "aniso") else keyword.capitalize()


def _is_number(word: str) -> bool:
    try:
        float(word)
    except ValueError:
        return False
    return True


# --- destello's materials ---------------------------------------------------------------------------------------------


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
    illum = numbers.get("illum", _DEFAULT_ILLUM)
    base = _color(material, "kd", (0.6, 0.6, 0.6) if "map_kd" not in maps else (1.0, 1.0, 1.0))
    glass = illum in _GLASS and not _opaque(material, illum)
    surface = _surface(material, glass=glass)
    ks = material.colors.get("ks", (0.0, 0.0, 0.0))
    layers = _layers(material)
    if layers:
        core = {"base_color": base, "base_metalness": _number(material, "pm", 0.0)}
        return make.openpbr(name=name, **core, **layers, **surface)
    if {"pr", "pm"} & numbers.keys() or {"map_pr", "map_pm"} & maps.keys():
        metallic = _number(material, "pm", 0.0)
        roughness = _number(material, "pr", _roughness(material))
        return make.metallic_roughness(base_color=base, metallic=metallic, roughness=roughness, name=name, **surface)
    if material.blender and (illum in _BLENDER_METAL or any(key in maps for key in _BLENDER_MAPS)):
        return make.metallic_roughness(base_color=base, name=name, **_blender_looks(material, illum), **surface)
    if glass:
        ior, tint = numbers.get("ni", _DEFAULT_INDEX), material.colors.get("tf", (1.0, 1.0, 1.0))
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
        made["specular_color"] = tuple(2.0 * k for k in material.colors.get("ks", (0.5, 0.5, 0.5)))
    images = {key: _image(material.maps[key], "linear") for key in _BLENDER_MAPS if key in material.maps}
    for key, name in (("map_refl", "metallic"), ("map_ns", "roughness")):
        if key in images:
            made[name] = textures.scaled(images[key], channel="mean", scale=1.0)
    if "map_ks" in images:
        made["specular_color"] = textures.scaled(images["map_ks"], scale=2.0)
    return made


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
    if (sheen, coat, aniso) == (0.0, 0.0, 0.0):
        return {}
    roughness = _number(material, "pr", _roughness(material))
    made: dict[str, Value] = {"specular_roughness": roughness}
    if sheen != 0.0:
        made["fuzz_weight"] = sheen
    if coat != 0.0:
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
