"""Builds small scene files for the tests of the readers."""

from __future__ import annotations

import base64
import json
import struct
from pathlib import Path
from typing import Any

import numpy as np
import pytest

COMPONENTS = {"i1": 5120, "u1": 5121, "i2": 5122, "u2": 5123, "u4": 5125, "f4": 5126}
TYPES = {1: "SCALAR", 2: "VEC2", 3: "VEC3", 4: "VEC4", 16: "MAT4"}

QUAD = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]], np.float32)
QUAD_UV = np.array([[0, 1], [1, 1], [1, 0], [0, 0]], np.float32)  # glTF's: v = 0 is the top of the image
QUAD_INDICES = np.array([0, 1, 2, 0, 2, 3], np.uint16)


class Gltf:
    """A glTF file under construction. Every method that adds something returns its index."""

    def __init__(self) -> None:
        self.json: dict[str, Any] = {"asset": {"version": "2.0"}}
        self.data = bytearray()

    def add(self, table: str, **values: Any) -> int:
        """Appends an object to a table."""
        items: list[Any] = self.json.setdefault(table, [])
        items.append(values)
        return len(items) - 1

    def view(self, data: bytes, **values: Any) -> int:
        """A buffer view of its own bytes, 4-byte aligned."""
        self.data += b"\0" * (-len(self.data) % 4)
        start = len(self.data)
        self.data += data
        return self.add("bufferViews", buffer=0, byteOffset=start, byteLength=len(data), **values)

    def accessor(self, array: np.ndarray, *, stride: int = 0, **values: Any) -> int:
        """An accessor on a view of its own; `stride` pads each element."""
        array = array.reshape(len(array), -1)
        kind = f"{array.dtype.kind}{array.dtype.itemsize}"
        raw = array.astype(array.dtype.newbyteorder("<")).tobytes()
        size = array.shape[1] * array.dtype.itemsize
        view_values = {}
        if stride:
            raw = b"".join(raw[i : i + size].ljust(stride, b"\xee") for i in range(0, len(raw), size))
            view_values["byteStride"] = stride
        return self.add(
            "accessors",
            bufferView=self.view(raw, **view_values),
            componentType=COMPONENTS[kind],
            count=len(array),
            type=TYPES[array.shape[1]],
            **values,
        )

    def mesh(
        self, attributes: dict[str, int], indices: int | None = None, *, name: str | None = None, **primitive: Any
    ) -> int:
        """A mesh of one primitive."""
        made: dict[str, Any] = {"attributes": attributes, **primitive}
        if indices is not None:
            made["indices"] = indices
        return self.add("meshes", primitives=[made], **({"name": name} if name else {}))

    def quad(self, *, uv: bool = True, **primitive: Any) -> int:
        """A mesh: the square from (-1, -1, 0) to (1, 1, 0), facing +z, its image upright."""
        attributes = {"POSITION": self.accessor(QUAD)}
        if uv:
            attributes["TEXCOORD_0"] = self.accessor(QUAD_UV)
        return self.mesh(attributes, self.accessor(QUAD_INDICES), **primitive)

    def node(self, *, root: bool = True, **values: Any) -> int:
        """A node, at the root of scene 0 unless it is to be a child."""
        index = self.add("nodes", **values)
        if root:
            if "scenes" not in self.json:
                self.add("scenes", nodes=[])
            self.json["scenes"][0]["nodes"].append(index)
        return index

    def texture(self, image: bytes, **sampler: Any) -> int:
        """A texture from an encoded image in a buffer view."""
        source = self.add("images", bufferView=self.view(image), mimeType="image/png")
        values: dict[str, Any] = {"source": source}
        if sampler:
            values["sampler"] = self.add("samplers", **sampler)
        return self.add("textures", **values)

    def extend(self, name: str, *, required: bool = False, **root: Any) -> None:
        """Declares an extension, with what it keeps at the root."""
        self.json.setdefault("extensionsUsed", []).append(name)
        if required:
            self.json.setdefault("extensionsRequired", []).append(name)
        if root:
            self.json.setdefault("extensions", {})[name] = root

    def glb_bytes(self) -> bytes:
        """The .glb file."""
        if self.data:
            self.json["buffers"] = [{"byteLength": len(self.data)}, *self.json.get("buffers", [])[1:]]
        text = json.dumps(self.json).encode()
        chunks = _chunk(0x4E4F534A, text + b" " * (-len(text) % 4))
        if self.data:
            chunks += _chunk(0x004E4942, bytes(self.data) + b"\0" * (-len(self.data) % 4))
        return b"glTF" + struct.pack("<II", 2, 12 + len(chunks)) + chunks

    def glb(self, folder: Path, name: str = "scene.glb") -> Path:
        """Writes the .glb file."""
        path = folder / name
        path.write_bytes(self.glb_bytes())
        return path

    def gltf(self, folder: Path, *, buffer: str = "data", name: str = "scene.gltf") -> Path:
        """Writes the .gltf file; `buffer`: "data" for a data URI, else the name of the buffer's file."""
        if buffer == "data":
            uri = "data:application/octet-stream;base64," + base64.b64encode(self.data).decode()
        else:
            (folder / buffer).write_bytes(self.data)
            uri = buffer.replace(" ", "%20")
        if self.data:
            self.json["buffers"] = [{"byteLength": len(self.data), "uri": uri}]
        path = folder / name
        path.write_text(json.dumps(self.json, indent=1))
        return path


def _chunk(kind: int, data: bytes) -> bytes:
    return struct.pack("<II", len(data), kind) + data


def encode_image(texels: np.ndarray, suffix: str, folder: Path) -> bytes:
    """(H, W, C) uint8 or uint16 texels as the bytes of a .png, .jpg or .webp file; alpha unassociated."""
    import OpenImageIO as oiio

    path = folder / f"encoded{suffix}"
    height, width, channels = texels.shape
    spec = oiio.ImageSpec(width, height, channels, "uint8" if texels.dtype == np.uint8 else "uint16")
    spec.attribute("oiio:UnassociatedAlpha", 1)
    spec.attribute("compression", "lossless" if suffix == ".webp" else "jpeg:100" if suffix == ".jpg" else "zip")
    output = oiio.ImageOutput.create(str(path))
    assert output is not None, oiio.geterror()
    assert output.open(str(path), spec), output.geterror()
    assert output.write_image(np.ascontiguousarray(texels)), output.geterror()
    output.close()
    data = path.read_bytes()
    path.unlink()
    return data


def corner_image() -> np.ndarray:
    """(4, 4, 3) uint8: grey; corners red (top left), green (top right), blue (bottom left), white (bottom right)."""
    texels = np.full((4, 4, 3), 64, np.uint8)
    texels[0, 0], texels[0, -1], texels[-1, 0], texels[-1, -1] = (255, 0, 0), (0, 255, 0), (0, 0, 255), (255, 255, 255)
    return texels


def sphere(rings: int = 16, sectors: int = 32) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A unit sphere: positions (also its normals) (N, 3), glTF texture coordinates (N, 2), indices (M,)."""
    v, u = np.meshgrid(np.linspace(0, 1, rings + 1), np.linspace(0, 1, sectors + 1), indexing="ij")
    theta, phi = v * np.pi, u * 2 * np.pi
    points = np.stack([np.sin(theta) * np.sin(phi), np.cos(theta), np.sin(theta) * np.cos(phi)], -1)
    first = (np.arange(rings)[:, None] * (sectors + 1) + np.arange(sectors)).reshape(-1)
    below = first + sectors + 1
    triangles = np.stack([first, below, below + 1, first, below + 1, first + 1], axis=1)
    return (
        points.reshape(-1, 3).astype(np.float32),
        np.stack([u, v], -1).reshape(-1, 2).astype(np.float32),
        triangles.reshape(-1).astype(np.uint32),
    )


def write_image(
    path: Path, texels: np.ndarray[Any, Any], *, names: tuple[str, ...] = (), associated: bool = False
) -> Path:
    """Writes texels as they are, in their own type; `associated`: a TIFF that says that alpha is so."""
    oiio = pytest.importorskip("OpenImageIO")
    height, width, channels = texels.shape
    kinds = {"uint8": oiio.UINT8, "uint16": oiio.UINT16, "float16": oiio.HALF, "float32": oiio.FLOAT}
    spec = oiio.ImageSpec(width, height, channels, kinds[str(texels.dtype)])
    if names:
        spec.channelnames = names
    if not associated:
        spec.attribute("oiio:UnassociatedAlpha", 1)
    out = oiio.ImageOutput.create(str(path))
    assert out.open(str(path), spec), out.geterror()
    assert out.write_image(texels)
    out.close()
    return path
