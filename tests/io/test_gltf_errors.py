"""glTF: what is wrong with a file is said in one line, with its place."""

from __future__ import annotations

import json
import struct
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from destello.errors import FormatError, MissingFileError
from destello.io import load
from scene_files import QUAD, QUAD_INDICES, Gltf, encode_image

Change = Callable[[dict[str, Any]], Any]


def quad_file(change: Change, folder: Path) -> Path:
    """A .glb with a textured-less quad, its JSON changed. Accessors: 0 positions, 1 texture coordinates, 2 indices."""
    g = Gltf()
    g.node(mesh=g.quad(material=g.add("materials", pbrMetallicRoughness={})))
    change(g.json)
    return g.glb(folder)


def put(*path: Any) -> Change:
    """Sets what the keys before the last lead to: ``put("nodes", 0, "mesh", 7)``."""
    *keys, last, value = path

    def change(data: dict[str, Any]) -> None:
        for key in keys:
            data = data[key]
        data[last] = value

    return change


PRIMITIVE = ("meshes", 0, "primitives", 0)
CASES: list[tuple[Change, str | None, str]] = [
    (put("asset", {}), "asset.version", "missing"),
    (put("asset", "version", "1.0"), "asset.version", "not glTF 2.0: '1.0' (accepted: 2.0)"),
    (put("asset", "minVersion", "3.1"), "asset.minVersion", "not glTF 2.0"),
    (put("scene", 3), "scene", "index out of range: 3 (accepted: 0 to 0)"),
    (
        put("scenes", 0, "nodes", [5]),
        "scenes[0].nodes[0]",
        "index out of range: 5 (accepted: a whole number from 0 to 0)",
    ),
    (put("scenes", 0, "nodes", "all"), "scenes[0].nodes", "wrong value: 'all'"),
    (put("nodes", {}), "nodes", "a list of JSON objects"),
    (put("nodes", 0, "mesh", None), "nodes[0].mesh", "wrong value: 'null'"),
    (put("nodes", [7]), "nodes[0]", "wrong value: 7 (accepted: a JSON object)"),
    (put("nodes", 0, "children", [0]), "nodes[0]", "is its own ancestor"),
    (put("nodes", 0, "mesh", 1), "nodes[0].mesh", "index out of range: 1 (accepted: 0 to 0: there are 1 meshes)"),
    (put("nodes", 0, "mesh", True), "nodes[0].mesh", "wrong value: True"),
    (put("nodes", 0, "mesh", -1), "nodes[0].mesh", "wrong value: -1 (accepted: a whole number of at least 0)"),
    (put("nodes", 0, "rotation", [0, 0, 0, 0]), "nodes[0].rotation", "without direction"),
    (put("nodes", 0, "translation", [0, 0]), "nodes[0].translation", "accepted: 3 numbers"),
    (put("nodes", 0, "translation", [0, 0, 1e39]), "nodes[0].translation", "accepted: 3 numbers"),
    (put("nodes", 0, "matrix", [1] * 15), "nodes[0].matrix", "accepted: 16 numbers"),
    (put("nodes", 0, "matrix", [1] * 16), "nodes[0].matrix", "not an affine matrix"),
    (put("nodes", 0, "camera", 0), "nodes[0].camera", "none: there are no cameras"),
    (put("meshes", 0, "primitives", []), "meshes[0].primitives", "accepted: at least one"),
    (put(*PRIMITIVE, "attributes", None), "meshes[0].primitives[0].attributes", "accepted: a JSON object"),
    (
        put(*PRIMITIVE, "attributes", "POSITION", 9),
        "meshes[0].primitives[0].attributes.POSITION",
        "index out of range: 9",
    ),
    (put(*PRIMITIVE, "attributes", "POSITION", 1), "accessors[1].type", "wrong value: 'VEC2' (accepted: VEC3)"),
    (put(*PRIMITIVE, "attributes", "NORMAL", 2), "accessors[2].type", "accepted: VEC3"),
    (put(*PRIMITIVE, "indices", 0), "accessors[0].componentType", "wrong value: 5126 (accepted: 5121 (u8)"),
    (put(*PRIMITIVE, "mode", 7), "meshes[0].primitives[0].mode", "accepted: a whole number from 0 to 6"),
    (put(*PRIMITIVE, "material", 1), "meshes[0].primitives[0].material", "index out of range: 1"),
    (put("accessors", 0, "count", 5), "accessors[0]", "larger than its buffer view of 48 bytes: 60"),
    (put("accessors", 0, "count", 10**15), "accessors[0]", "larger than its buffer view"),
    (put("accessors", 0, "count", 10**400), "accessors[0]", "larger than its buffer view"),
    (put("accessors", 0, "count", 0), "accessors[0].count", "wrong value: 0"),
    (put("accessors", 0, "count", 3.5), "accessors[0].count", "wrong value: 3.5"),
    (put("accessors", 0, "byteOffset", 4), "accessors[0]", "larger than its buffer view"),
    (put("accessors", 0, "componentType", 5124), "accessors[0].componentType", "5126 (f32)"),
    (put("accessors", 0, "bufferView", 3), "accessors[0].bufferView", "index out of range: 3"),
    (
        put("accessors", 1, "count", 3),
        "meshes[0].primitives[0].attributes.TEXCOORD_0",
        "3 (accepted: 4, as many as POSITION",
    ),
    (put("bufferViews", 0, "byteLength", 10**9), "bufferViews[0].byteLength", "reaches beyond its buffer: 1000000000"),
    (put("bufferViews", 0, "byteOffset", 10**9), "bufferViews[0].byteOffset", "wrong value: 1000000000"),
    (put("bufferViews", 0, "byteStride", 4), "accessors[0].bufferView", "its elements overlap"),
    (put("bufferViews", 0, "buffer", 1), "bufferViews[0].buffer", "index out of range: 1"),
    (put("materials", 0, "alphaMode", "GLASS"), "materials[0].alphaMode", "accepted: OPAQUE or MASK or BLEND"),
    (
        put("materials", 0, "pbrMetallicRoughness", "metallicFactor", 1.5),
        "materials[0].pbrMetallicRoughness.metallicFactor",
        "wrong value: 1.5 (accepted: a number of at least 0 and at most 1)",
    ),
    (
        put("materials", 0, "pbrMetallicRoughness", "baseColorFactor", [3, 0, 0, 1]),
        "materials[0].pbrMetallicRoughness.baseColorFactor",
        "from 0 to 1",
    ),
    (
        put("materials", 0, "extensions", {"KHR_materials_pbrSpecularGlossiness": {"diffuseFactor": [3, 0, 0, 1]}}),
        "materials[0].extensions.KHR_materials_pbrSpecularGlossiness.diffuseFactor",
        "out of range: 3",
    ),
    (
        put(
            "materials",
            0,
            "extensions",
            {
                "KHR_materials_diffuse_transmission": {
                    "diffuseTransmissionFactor": 1,
                    "diffuseTransmissionColorFactor": [0, 2, 0],
                }
            },
        ),
        "materials[0].extensions.KHR_materials_diffuse_transmission.diffuseTransmissionColorFactor",
        "out of range: 2",
    ),
    (
        put("materials", 0, "normalTexture", {"index": 0}),
        "materials[0].normalTexture.index",
        "none: there are no textures",
    ),
    (put("materials", 0, "extensions", []), "materials[0].extensions", "accepted: a JSON object"),
    (
        put("materials", 0, "extensions", {"KHR_materials_ior": {"ior": 0.5}}),
        "materials[0].extensions.KHR_materials_ior.ior",
        "out of range: 0.5",
    ),
    (
        put("extensionsRequired", ["EXT_a", "KHR_mesh_quantization", "EXT_b"]),
        "extensionsRequired",
        "'EXT_a, EXT_b'",
    ),
    (put("extensionsUsed", "KHR"), "extensionsUsed", "accepted: a list of texts"),
]


@pytest.mark.parametrize(("change", "place", "message"), CASES, ids=[f"{i}-{case[1]}" for i, case in enumerate(CASES)])
def test_wrong_values(change: Change, place: str | None, message: str, tmp_path: Path) -> None:
    path = quad_file(change, tmp_path)
    with pytest.raises(FormatError) as caught:
        load(path)
    text = str(caught.value)
    assert text.startswith(f"{path}: ")
    assert (caught.value.place or "").endswith(place or "")
    assert message in text
    assert "\n" not in text
    assert caught.value.exit_code == 2


def test_required_extensions_are_named(tmp_path: Path) -> None:
    with pytest.raises(FormatError, match="an extension that destello does not have: 'MSFT_lod'"):
        load(quad_file(put("extensionsRequired", ["MSFT_lod"]), tmp_path))


def test_nan_vertex_is_named(tmp_path: Path) -> None:
    g = Gltf()
    points = QUAD.copy()
    points[2, 1] = np.nan
    points[3, 0] = np.inf
    g.node(mesh=g.mesh({"POSITION": g.accessor(points)}, g.accessor(QUAD_INDICES)))
    with pytest.raises(FormatError, match=r"vertex 2 is not finite: \[1.0, nan, 0.0\]") as caught:
        load(g.glb(tmp_path))
    assert caught.value.place == "meshes[0].primitives[0].attributes.POSITION"


def test_index_out_of_range_is_named(tmp_path: Path) -> None:
    g = Gltf()
    g.node(mesh=g.mesh({"POSITION": g.accessor(QUAD)}, g.accessor(np.array([0, 1, 2, 0, 65535, 3], np.uint16))))
    with pytest.raises(FormatError, match=r"index 4 refers to .* not there: 65535 \(accepted: 0 to 3\)") as caught:
        load(g.glb(tmp_path))
    assert caught.value.place == "meshes[0].primitives[0].indices"


def test_node_with_two_parents(tmp_path: Path) -> None:
    g = Gltf()
    child = g.node(root=False, mesh=g.quad())
    g.node(children=[child])
    g.node(children=[child])
    with pytest.raises(FormatError, match="two parents"):
        load(g.glb(tmp_path))


def test_ring_of_nodes(tmp_path: Path) -> None:
    g = Gltf()
    g.node(children=[1])
    g.node(root=False, children=[2])
    g.node(root=False, children=[0])
    with pytest.raises(FormatError, match="its own ancestor"):
        load(g.glb(tmp_path))


def test_transform_that_overflows(tmp_path: Path) -> None:
    g = Gltf()
    last = g.node(root=False, mesh=g.quad())
    for _ in range(20):
        last = g.node(root=False, children=[last], scale=[1e30, 1e30, 1e30])
    g.json["scenes"] = [{"nodes": [last]}]
    with pytest.raises(FormatError, match="leaves the range of numbers"):
        load(g.glb(tmp_path))


# --- packages ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("text", "line", "message"),
    [
        ('{"asset": {"version": "2.0"},\n "nodes": [}', 2, "line 2, column 12"),
        ('{"asset": ', 1, "line 1, column 11"),
        ("", 1, "broken JSON"),
        ("[1, 2]", None, "not glTF: the JSON is no object"),
        ('{"asset": {"version": "2.0"}, "x": NaN}', None, "NaN is not a JSON value"),
        ("[" * 100000, None, "nested too deeply"),
        ('{"a": ' + "1" * 10000 + "}", None, "broken JSON"),
    ],
)
def test_broken_json(text: str, line: int | None, message: str, tmp_path: Path) -> None:
    path = tmp_path / "scene.gltf"
    path.write_text(text)
    with pytest.raises(FormatError) as caught:
        load(path)
    assert message in str(caught.value)
    assert caught.value.line == line


def test_text_that_is_not_utf8(tmp_path: Path) -> None:
    path = tmp_path / "scene.gltf"
    path.write_bytes(b'{"asset":\n "\xff\xfe"}')
    with pytest.raises(FormatError, match="not UTF-8") as caught:
        load(path)
    assert caught.value.line == 2


def glb_of(chunks: list[tuple[int, bytes]], *, version: int = 2, extra: int = 0) -> bytes:
    body = b"".join(struct.pack("<II", len(data), kind) + data for kind, data in chunks)
    return b"glTF" + struct.pack("<II", version, 12 + len(body) + extra) + body


JSON = b'{"asset":{"version":"2.0"}} '


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (b"", "not a .glb file"),
        (b"glT", "not a .glb file"),
        (b"glTF\2\0\0\0", "no room for the header: 8"),
        (glb_of([(0x4E4F534A, JSON)], version=1), "unknown version of .glb: 1 (accepted: 2)"),
        (glb_of([(0x4E4F534A, JSON)], extra=1), "the header announces more bytes"),
        (glb_of([(0x004E4942, b"1234")]), "no JSON chunk"),
        (
            b"glTF" + struct.pack("<IIII", 2, 24, 1000, 0x4E4F534A) + b"{}  ",
            "the chunk at byte 12 reaches beyond the end: 1000",
        ),
    ],
)
def test_broken_glb(data: bytes, message: str, tmp_path: Path) -> None:
    path = tmp_path / "scene.glb"
    path.write_bytes(data)
    with pytest.raises(FormatError) as caught:
        load(path)
    assert message in str(caught.value)


def test_every_truncation_is_an_error(tmp_path: Path) -> None:
    g = Gltf()
    g.node(mesh=g.quad())
    data = g.glb_bytes()
    path = tmp_path / "scene.glb"
    for size in range(len(data)):
        path.write_bytes(data[:size])
        with pytest.raises(FormatError):
            load(path)


def test_missing_buffers_are_listed_at_once(tmp_path: Path) -> None:
    data = {
        "asset": {"version": "2.0"},
        "buffers": [{"byteLength": 4, "uri": "a.bin"}, {"byteLength": 4, "uri": "b%20c.bin"}],
    }
    path = tmp_path / "scene.gltf"
    path.write_text(json.dumps(data))
    with pytest.raises(MissingFileError) as caught:
        load(path)
    assert caught.value.paths == ["a.bin", "b c.bin"]


def test_buffer_shorter_than_it_says(tmp_path: Path) -> None:
    g = Gltf()
    g.node(mesh=g.quad())
    path = g.gltf(tmp_path, buffer="buffer.bin")
    (tmp_path / "buffer.bin").write_bytes(bytes(50))
    with pytest.raises(FormatError, match="at most the 50 bytes there are") as caught:
        load(path)
    assert caught.value.place == "buffers[0].byteLength"


@pytest.mark.parametrize("uri", ["data:application/octet-stream,abcd", "data:;base64,a$b", "data:;base64,abc"])
def test_broken_data_uri(uri: str, tmp_path: Path) -> None:
    g = Gltf()
    g.node(mesh=g.quad())
    path = g.gltf(tmp_path)
    data = json.loads(path.read_text())
    data["buffers"][0]["uri"] = uri
    path.write_text(json.dumps(data))
    with pytest.raises(FormatError, match="base64") as caught:
        load(path)
    assert caught.value.place == "buffers[0].uri"


# --- files that would take more than they are -------------------------------------------------------------------------


def test_accessor_without_data_must_be_small(tmp_path: Path) -> None:
    g = Gltf()
    accessor = g.add("accessors", componentType=5126, count=1 << 40, type="VEC3")
    g.node(mesh=g.mesh({"POSITION": accessor}))
    with pytest.raises(FormatError, match="too many elements without data"):
        load(g.glb(tmp_path))


def test_sparse_accessor_is_checked(tmp_path: Path) -> None:
    for count, where, message in (
        (5, [0], "wrong value: 5"),
        (1, [9], "index out of range: 9"),
        (2, [0], "larger than"),
    ):
        g = Gltf()
        sparse = {
            "count": count,
            "indices": {"bufferView": g.view(bytes(where)), "componentType": 5121},
            "values": {"bufferView": g.view(bytes(12))},
        }
        accessor = g.add("accessors", componentType=5126, count=4, type="VEC3", sparse=sparse)
        g.node(mesh=g.mesh({"POSITION": accessor}, g.accessor(QUAD_INDICES)))
        with pytest.raises(FormatError, match=message):
            load(g.glb(tmp_path))


def test_data_used_a_thousand_times_over(tmp_path: Path) -> None:
    g = Gltf()
    attributes = {"POSITION": g.accessor(np.zeros((20000, 3), np.float32))}
    for _ in range(1500):
        g.node(mesh=g.mesh(attributes))
    with pytest.raises(FormatError, match="use the same data too often"):
        load(g.glb(tmp_path))


def test_image_too_large_for_its_bytes(tmp_path: Path) -> None:
    """A WebP whose header announces as many texels as it can. (OpenImageIO itself refuses such PNG and JPEG files.)"""
    data = bytearray(encode_image(np.full((16, 16, 3), 90, np.uint8), ".webp", tmp_path))
    at = data.index(b"VP8L") + 9
    (bits,) = struct.unpack_from("<I", data, at)
    struct.pack_into("<I", data, at, bits >> 28 << 28 | 16382 << 14 | 16382)
    g = Gltf()
    g.texture(bytes(data))
    material = g.add("materials", pbrMetallicRoughness={"baseColorTexture": {"index": 0}})
    g.node(mesh=g.quad(material=material))
    with pytest.raises(FormatError, match="16383 x 16383 texels cannot be in") as caught:
        load(g.glb(tmp_path))
    assert caught.value.place == "images[0]"


def test_pose_that_overflows(tmp_path: Path) -> None:
    g = Gltf()
    targets = [{"POSITION": g.accessor(np.full((4, 3), 3e38, np.float32))}]
    mesh = g.mesh({"POSITION": g.accessor(QUAD)}, g.accessor(QUAD_INDICES), targets=targets)
    g.node(mesh=mesh, weights=[2])
    with pytest.raises(FormatError, match="posed vertex 0 is not finite") as caught:
        load(g.glb(tmp_path))
    assert caught.value.place == "meshes[0].primitives[0]"
