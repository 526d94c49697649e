"""Materials, textures and images on their way into the core: equal ones are added once."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from destello.assets import Assets
from destello.color_spaces import converted
from destello.compile_errors import core_errors
from destello.errors import SceneError
from destello.files import MARK
from destello.image_table import ImageTable
from destello.images import linear_rgb, missing_image
from destello.mesh_checks import check_uv_sets, uv_reads
from destello.metals import in_space
from destello.nodes import Node
from destello.schema import NORMALS, TANGENTS, ParamDoc, Role, role_of
from destello.transform import Transform, scale, translate
from destello.udim import read_tiles

if TYPE_CHECKING:
    from numpy.typing import NDArray


_LEAST_LEFT = 1e-6  # of a channel's light, as in OpenPBR's media


class MaterialCompiler:
    """Adds the materials and textures of one scene. Equal nodes get one number."""

    def __init__(self, builder: Any, assets: Assets, images: ImageTable, outer: Transform | None = None) -> None:
        """`images` is shared between the scenes that go into one builder. `outer`: volumes stand in it."""
        self._builder = builder
        self._assets = assets
        self._images = images
        self._outer = outer or Transform()
        self._materials: dict[Node, int] = {}
        self._volumes: dict[Node, int] = {}
        self._textures: dict[tuple[Node, Role], int | None] = {}
        self._default: int | None = None
        self._channels: dict[Node, str] = {}  # of image textures
        self._placed: dict[Transform, MaterialCompiler] = {}
        self._read: dict[Node, frozenset[str]] = {}

    def placed(self, place: Transform) -> MaterialCompiler:
        """One for the same scene's materials with volumes: these stand in `place`, with voxels of their own."""
        if place not in self._placed:
            outer = self._outer @ place
            self._placed[place] = MaterialCompiler(self._builder, self._assets, self._images, outer)
        return self._placed[place]

    def material(self, node: Node | None, place: str) -> int:
        """The core's number of a material; None is the default one, grey and diffuse."""
        if node is None:
            if self._default is None:
                self._default = self._builder.add_material("diffuse", {})
            return self._default
        if node not in self._materials:
            where = f"{place} ({node.name})" if node.name else place
            params, grid = self.params(node, where, skip=("first", "second", "medium_volume")), None
            if node.type == "mix":
                for name in ("first", "second"):
                    params[name] = self._part(node[name], f"{where}.{name}")
            elif node["medium_volume"] is not None:
                grid = self.volume(node["medium_volume"], f"{where}.medium_volume")
            with core_errors(where):
                self._materials[node] = self._builder.add_material(node.type, params)
                if grid is not None:
                    self._builder.set_medium_grid(self._materials[node], grid)
        return self._materials[node]

    def _part(self, node: Node, place: str) -> int:
        """The core's number of one of the two materials of a mix."""
        if node.type == "emissive" and node["power"] > 0:
            expected = "radiance, since a part of a mix has no surface of its own"
            raise SceneError("a power within a mix", place=f"{place}.power", value=node["power"], expected=expected)
        return self.material(node, place)

    def check_uvs(self, shape: Node, place: str) -> None:
        """Whether the shape has the texture coordinates that its material's images want. Raises SceneError."""
        material = shape["material"]
        if material is not None:
            if material not in self._read:
                self._read[material] = uv_reads(material)
            check_uv_sets(shape, self._read[material], f"{place}.material")

    def volume(self, node: Node, place: str) -> int:
        """The core's number of a volume."""
        if node not in self._volumes and node.type == "volume_file":
            self._volumes[node] = self.volume(self._assets.volume(node, place), place)
        if node not in self._volumes:
            low, high = node["min"], node["max"]
            edges = [b - a for a, b in zip(low, high, strict=True)]
            cube = self._outer @ (node["transform"] or Transform()) @ translate(*low) @ scale(*edges)
            with core_errors(place):
                working = self._images.working
                albedo, emission = (voxel_colors(v, working) for v in (node["albedo"], emission_voxels(node)))
                self._volumes[node] = self._builder.add_grid(
                    node["density"], rows(cube), albedo=albedo, emission=emission
                )
        return self._volumes[node]

    def params(self, node: Node, place: str, skip: tuple[str, ...] = (), *, role: Role | None = None) -> dict[str, Any]:
        """The parameters of any node in the core's form but those in `skip`. `role`: of all; None: each its own."""
        docs, made = node.doc.params, {}
        for name, value in node.params.items():
            if name not in skip:
                doc, where = docs[name], f"{place}.{name}"
                plain = self._value(doc, value, role or role_of(doc), where) if isinstance(value, Node) else value
                if plain is not None:
                    made[name] = plain
        if role in (None, "color") and self._images.working != "rec709":
            self._bring_in(docs, made)
        return made

    def _bring_in(self, docs: Mapping[str, ParamDoc], made: dict[str, Any]) -> None:
        """Puts colours, defaults too, into the working space."""
        for name, doc in docs.items():
            if role_of(doc) == "color":
                value = made.get(name, doc.default)
                if isinstance(value, tuple):
                    inside = self._images.color(value)
                    if inside is not value:
                        made[name] = inside
        if "eta" in docs and "k" in docs:
            eta, k = (made.get(name, docs[name].default) for name in ("eta", "k"))
            if isinstance(eta, tuple) and isinstance(k, tuple):
                made["eta"], made["k"] = in_space(eta, k, self._images.working)
        rates = made.get("medium_absorption")
        if isinstance(rates, tuple) and len(set(rates)) > 1:
            made["medium_absorption"] = absorption_in(rates, self._images.working)

    def _value(self, doc: ParamDoc, texture: Node, role: Role, place: str) -> dict[str, Any] | None:
        """A texture in place of a value; None if its image is missing and the default must do."""
        made: dict[str, Any] = {}
        if texture.type in ("scaled", "vertex_color"):
            made = _factor(doc, texture, place)
            if role == "color":
                made["scale"] = self._images.color(made["scale"])
        if texture.type == "vertex_color":
            return {"vertex_color": True, **made}
        if texture.type == "scaled":
            made["vertex_color"] = texture["vertex_color"]
            texture = texture["texture"]
        number = self.texture(texture, role, place)
        if doc.name in NORMALS | TANGENTS:
            self._check_channel(texture, "rgb" if doc.name in NORMALS else "rg", place)
        elif doc.kind == "scalar" and made.get("channel", "r") in "rgba":
            self._check_channel(texture, made.get("channel", "r"), place)
        return None if number is None else {"texture": number, **made}

    def texture(self, node: Node, role: Role, place: str) -> int | None:
        """The core's number of a texture. `role`: of all that it is made of; 8-bit images of colours count as sRGB."""
        key = (node, role)
        if key not in self._textures:
            where = f"{place} ({node.name})" if node.name else place
            kind = node.type
            if kind == "image":
                kind, params = self.image(node, role, where)
            else:
                params = self.params(node, where, role=role)
            with core_errors(where):
                self._textures[key] = None if params is None else self._builder.add_texture(kind, params)
        return self._textures[key]

    def _check_channel(self, texture: Node, channel: str, place: str) -> None:
        """Whether an image has a channel that is asked for. Raises SceneError."""
        if texture.type != "image" or texture["missing_channels"] == "fill":
            return
        has = self._channels.get(texture, "")
        wanted = next((c for c in channel if has and c not in has), None)
        if wanted:
            raise SceneError(
                f"the image has no channel {wanted}",
                place=place,
                value=f"{texture['path'] or texture.name or 'array'}: {', '.join(has)}",
                expected="another image or channel, or missing_channels: fill",
            )

    def image(self, texture: Node, role: Role, place: str) -> tuple[str, dict[str, Any] | None]:
        """The core's texture for an image. A missing one gives the stand-in, or None where no colour shows."""
        path = texture["path"]
        if path is not None and MARK in path:
            return self._tiles(texture, role, place)
        if path is None:
            texels = self._assets.array(texture, place)
        else:
            found = self._assets.texels(path, f"{place}.path")
            if found is None:
                return "image", self._stand_in(texture, role, place)
            texels = found[1]
        self._channels[texture] = _CHANNELS[texels.shape[2]]
        texels, srgb = self._decoded(texels, texture, role)
        return "image", {"image": self._images.add(texels, srgb, _options(texture), place)}

    def _decoded(self, texels: NDArray[Any], texture: Node, role: Role) -> tuple[NDArray[Any], bool]:
        if role == "color" and texture["color_space"] != "raw" and self._assets.associated(texels):
            texels = self._images.straight(texels)
        texels, srgb = self._images.decoded(texels, texture["color_space"], role == "color")
        return (self._images.turned(texels, texture), srgb) if role == "directions" else (texels, srgb)

    def _tiles(self, texture: Node, role: Role, place: str) -> tuple[str, dict[str, Any] | None]:
        path = texture["path"]
        tiles = read_tiles(self._assets, path, f"{place}.path")
        if tiles is None:
            return "image", self._stand_in(texture, role, place)
        read = [None if tile is None else self._decoded(tile, texture, role) for tile in tiles.texels]
        kind, srgb = next(tile for tile in read if tile is not None)
        self._channels[texture] = _CHANNELS[kind.shape[2]]
        options = {**_options(texture), "wrap_u": "clamp", "wrap_v": "clamp"}
        first = self._images.add_tiles([tile and tile[0] for tile in read], srgb, options, place)
        return "udim", {"first": first, "columns": tiles.columns, "rows": tiles.rows}

    def _stand_in(self, texture: Node, role: Role, place: str) -> dict[str, Any] | None:
        self._note_missing(texture["path"], role == "color")
        if role != "color":
            return None
        options = {**_options(texture), "filter": "nearest"}
        return {"image": self._images.add(missing_image(), True, options, place)}

    def environment_texels(self, texture: Node, place: str) -> NDArray[np.float32]:
        """An environment's image as linear radiance, (height, width, 3) float32; a missing one gives the stand-in."""
        if texture["pixels"] is not None:
            texels = self._assets.array(texture, place)
        else:
            found = self._assets.texels(texture["path"], f"{place}.path")
            if found is None:
                self._note_missing(texture["path"], True)
            texels = missing_image() if found is None else found[1]
        return linear_rgb(texels, texture["color_space"], self._images.working)

    def _note_missing(self, path: str, color: bool) -> None:
        stand_in = "a magenta checker" if color else "the parameter's default"
        self._note(f"missing image {path}: replaced by {stand_in}")

    def _note(self, note: str) -> None:
        if note not in self._assets.notes:
            self._assets.notes.append(note)


_CHANNELS = {1: "r", 2: "ra", 3: "rgb", 4: "rgba"}


def _options(texture: Node) -> dict[str, Any]:
    """How an image is read: what an ImageTable asks for."""
    names = ("path", "wrap_u", "wrap_v", "uv_scale", "uv_offset", "uv_rotation", "filter", "mip_maps", "uv_set")
    return {name: texture[name] for name in names}


def rows(transform: Transform | None) -> NDArray[np.float32] | None:
    """The upper three rows of the matrix, (3, 4) float32, as the core takes it."""
    return None if transform is None else np.ascontiguousarray(transform.matrix[:3], dtype=np.float32)


def voxel_colors(voxels: NDArray[Any] | None, working: str) -> NDArray[Any] | None:
    """Voxels whose three channels are linear Rec.709, in the working space, nothing below 0; others as they are."""
    if voxels is None or working == "rec709" or voxels.shape[3] != 3:
        return voxels
    values = voxels.astype(np.float32) / np.float32(255 if voxels.dtype.kind == "u" else 1)
    return np.ascontiguousarray(np.maximum(converted(values, "rec709", working), 0), np.float32)


def absorption_in(rates: tuple[float, ...], working: str) -> tuple[float, ...]:
    """Absorption (1/m) by the channels of another space that leaves the same colour of white light after a mean way."""
    way = len(rates) / sum(rates)
    left = converted(np.exp(-np.array(rates) * way), "rec709", working)
    return tuple((-np.log(np.clip(left.astype(np.float64), _LEAST_LEFT, 1.0)) / way).tolist())


def emission_voxels(node: Node) -> NDArray[Any] | None:
    """The radiance of a grid's voxels, scaled: (depth, height, width, 1 or 3); None if nothing glows."""
    from destello.spectrum import blackbody_glow

    emission, factor = node["emission"], node["emission_scale"]
    if node["temperature"] is not None:
        emission = blackbody_glow(node["temperature"][..., 0])
    if emission is None or factor == 0:
        return None
    if emission.dtype.kind == "u":
        emission = emission / np.float32(255)
    return np.ascontiguousarray(emission * np.float32(factor), np.float32)


def _factor(doc: ParamDoc, texture: Node, place: str) -> dict[str, Any]:
    """Scale and channel of a `scaled` or `vertex_color` texture."""
    scale, channel = texture["scale"], texture["channel"]
    if doc.kind != "scalar":
        return {"scale": scale, "channel": channel}
    if len(set(scale)) == 1:
        return {"scale": scale[0], "channel": channel}
    if channel not in ("r", "g", "b"):
        raise SceneError(
            "a coloured factor for one number",
            place=f"{place}.scale",
            value=scale,
            expected=f"one number with {channel}",
        )
    return {"scale": scale["rgb".index(channel)], "channel": channel}
