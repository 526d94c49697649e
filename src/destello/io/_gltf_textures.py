"""glTF's textures, samplers and images as destello's image textures.

glTF's v runs from the top of an image to its bottom, destello's from the bottom to the top. Meshes therefore store
``1 - v``, and a KHR_texture_transform is rewritten for those coordinates here.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from urllib.parse import unquote

import numpy as np
from numpy.typing import NDArray

import destello.textures as make
from destello.errors import Error
from destello.images import read_texels, repaired
from destello.io._gltf_accessors import Buffers, data_uri
from destello.io._gltf_compression import can_decode
from destello.io._gltf_json import Document, Item
from destello.io._images import decode
from destello.nodes import Node

BASISU = "KHR_texture_basisu"
_WRAPS = {10497: "repeat", 33071: "clamp", 33648: "mirror"}
_NEAREST, LINEAR = 9728, 9729
NEAREST_WHEN_SMALL = (9728, 9984, 9986)  # minFilter: NEAREST, and with mip maps
_LONGEST_PATH = 1000

Curve = Callable[[NDArray[Any]], NDArray[Any]]


@dataclass(frozen=True)
class Line:
    """The curve offset + scale * x."""

    scale: float
    offset: float

    def __call__(self, x: NDArray[Any]) -> NDArray[Any]:
        return self.offset + self.scale * x


class Textures:
    """Makes image textures; each of a file's images is decoded once."""

    def __init__(self, document: Document, buffers: Buffers, notes: list[str], files: Mapping[str, Path]) -> None:
        """`files`: where the images that are no part of the document are, by URI; missing ones are not in it."""
        self.document = document
        self._files = files
        self._remapped: dict[tuple[int, str, Curve], Node] = {}
        self._buffers = buffers
        self._notes = notes
        self._sources: dict[int, Node] = {}
        self.readable: tuple[int | None, int | None] = (None, None)
        """Which TEXCOORD_n the mesh whose material is being made has."""
        self.second: int | None = None
        """Which of them is its second set."""

    def image(self, info: Item, color_space: str) -> Node | None:
        """The texture that a textureInfo object names, or None (with a note) if its image is of no known kind.

        Likewise if it reads a third set of texture coordinates. `color_space`: "srgb" for colours, "linear" for data.
        """
        if self._unreadable(info):
            return None
        texture = self.document.refer(info, "index", "textures", required=True)
        assert texture is not None
        image = self._image_of(texture)
        if image is None:
            self._notes.append(f"{texture.place}: no image that can be read; its factor alone is used")
            return None
        source = self._source(image)
        settings = {**self._sampler(texture), **self._place(info)}
        try:
            return source.replace(
                color_space=color_space, missing_channels="fill", name=self._name(texture, image), **settings
            )
        except Error as error:
            raise error.within(info.place, file=info.file) from None

    def remapped(self, info: Item, channel: str, curve: Curve) -> Node | None:
        """A grey texture of `curve` of a `channel` ("r", "g", "b" or "a") of a textureInfo's image, in [0, 1]."""
        if self._unreadable(info):
            return None
        texture = self.document.refer(info, "index", "textures", required=True)
        assert texture is not None
        image = self._image_of(texture)
        texels = None if image is None else self._texels(image)
        if image is None or texels is None:
            return None
        key = (image.index, channel, curve)
        if key not in self._remapped:
            values = texels.astype(np.float32)
            if texels.dtype.kind == "u":
                values /= np.float32(np.iinfo(texels.dtype).max)
            values = np.clip(curve(_channel(values, channel)), 0, 1)
            self._remapped[key] = make.image(np.rint(values * 65535).astype(np.uint16))
        settings = {**self._sampler(texture), **self._place(info)}
        return self._remapped[key].replace(color_space="linear", name=self._name(texture, image), **settings)

    def _unreadable(self, info: Item) -> bool:
        number = uv_set(info)
        if number in self.readable:
            return False
        others = " and ".join(f"TEXCOORD_{known}" for known in self.readable if known is not None)
        note = f"{info.place}: reads TEXCOORD_{number} where its material's other textures read {others}"
        if (note := f"{note}; its factor alone is used") not in self._notes:
            self._notes.append(note)
        return True

    def _place(self, info: Item) -> dict[str, object]:
        second = {"uv_set": "second"} if self.second is not None and uv_set(info) == self.second else {}
        return {**_uv_transform(info), **second}

    def _texels(self, image: Item) -> NDArray[Any] | None:
        """An image's texels; None if its file is missing."""
        source = self._source(image)
        if source["pixels"] is not None:
            texels: NDArray[Any] = source["pixels"]
            return texels
        path = self._files.get(image.text("uri"))
        if path is None:
            return None
        try:
            return repaired(read_texels(path))[0]
        except Error as error:
            raise error.within(image.at("uri"), file=image.file) from None

    def _image_of(self, texture: Item) -> Item | None:
        basis = texture.extension(BASISU)
        webp = texture.extension("EXT_texture_webp")
        plain = "source" in texture or webp is not None
        if (
            basis is not None
            and "source" in basis
            and can_decode(texture, self.document, BASISU, "alktx2", plain=plain)
        ):
            return self.document.refer(basis, "source", "images")
        if webp is not None and "source" in webp:
            return self.document.refer(webp, "source", "images")
        return self.document.refer(texture, "source", "images")

    def _source(self, image: Item) -> Node:
        if image.index not in self._sources:
            self._sources[image.index] = self._load(image)
        return self._sources[image.index]

    def _load(self, image: Item) -> Node:
        if "uri" in image:
            uri = image.text("uri")
            if not uri.startswith("data:"):
                return make.image(relative_path(image, uri))
            data = data_uri(image, uri)
        else:
            view = self.document.refer(image, "bufferView", "bufferViews", required=True)
            assert view is not None
            data = bytes(self._buffers.view(view))
        return make.image(decode(data, file=image.file, place=image.place))

    def _sampler(self, texture: Item) -> dict[str, str]:
        sampler = self.document.refer(texture, "sampler", "samplers")
        if sampler is None:
            return {}
        settings = {}
        for key, name in (("wrapS", "wrap_u"), ("wrapT", "wrap_v")):
            code = sampler.integer(key, 10497)
            if code not in _WRAPS:
                raise sampler.error(
                    "wrong value", key, value=code, expected="10497 (repeat), 33071 (clamp) or 33648 (mirrored)"
                )
            if code != 10497:
                settings[name] = _WRAPS[code]
        small = sampler.integer("minFilter", LINEAR)
        if sampler.integer("magFilter", _NEAREST if small in NEAREST_WHEN_SMALL else LINEAR) == _NEAREST:
            settings["filter"] = "nearest"
        return settings

    def _name(self, texture: Item, image: Item) -> str | None:
        return texture.text("name", "") or image.text("name", "") or None


def _channel(texels: NDArray[np.float32], channel: str) -> NDArray[np.float32]:
    """One channel of (H, W, 1 to 4) texels; grey has equal colours, and no alpha is an alpha of 1."""
    count = texels.shape[2]
    if channel == "a":
        alpha: NDArray[np.float32] = texels[..., -1] if count in (2, 4) else np.ones_like(texels[..., 0])
        return alpha
    return texels[..., 0 if count < 3 else "rgb".index(channel)]


def uv_set(info: Item) -> int:
    """Which TEXCOORD_n a textureInfo object reads."""
    transform = info.extension("KHR_texture_transform")
    if transform is not None and "texCoord" in transform:
        return transform.integer("texCoord")
    return info.integer("texCoord", 0)


def relative_path(item: Item, uri: str) -> str:
    """The path that a relative URI means; FormatError for other URIs."""
    scheme, colon, _ = uri.partition(":")
    if colon and len(scheme) > 1 and scheme.isalnum():
        raise item.error("not a file", "uri", value=uri, expected="a relative path or a data URI")
    path = unquote(uri.replace("\\", "/"))  # as browsers do: exporters on Windows write them
    if not path or "\0" in path or len(path) > _LONGEST_PATH:
        raise item.error("not a path", "uri", value=uri, expected="a relative path or a data URI")
    return path


def _uv_transform(info: Item) -> dict[str, object]:
    """KHR_texture_transform for coordinates whose v starts at the bottom.

    glTF has uv' = offset + R S uv with R = ((c, s), (-s, c)): counter-clockwise for the eye, v pointing down. (The
    extension's GLSL listing has the other sign; its example, its sample model and all viewers agree on this one.) With
    flip(u, v) = (u, 1 - v), flip R S flip is a counter-clockwise turn by the same angle, with another offset.
    """
    transform = info.extension("KHR_texture_transform")
    if transform is None:
        return {}
    u, v = transform.numbers("offset", 2, (0.0, 0.0))
    scale = transform.numbers("scale", 2, (1.0, 1.0))
    angle = transform.number("rotation", 0.0)
    offset = (u + math.sin(angle) * scale[1], 1.0 - v - math.cos(angle) * scale[1])
    settings: dict[str, object] = {}
    if scale != (1.0, 1.0):
        settings["uv_scale"] = scale
    if angle != 0.0:
        settings["uv_rotation"] = math.degrees(angle)
    if offset != (0.0, 0.0):
        settings["uv_offset"] = offset
    return settings
