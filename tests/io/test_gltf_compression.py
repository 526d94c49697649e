"""Compressed glTF: files that the packages themselves write, broken ones, and files read without the packages."""

from __future__ import annotations

import contextlib
import importlib.util
import struct
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import destello as dl
from destello import ktx2
from destello.errors import FormatError, ImageTooLarge
from scene_files import QUAD, QUAD_INDICES, Gltf

DRACO, MESHOPT, BASISU = "KHR_draco_mesh_compression", "EXT_meshopt_compression", "KHR_texture_basisu"


def grid(n: int, rng: np.random.Generator) -> tuple[Any, Any]:
    """A bumpy (n + 1)^2 grid: positions and triangles."""
    y, x = np.mgrid[0 : n + 1, 0 : n + 1] / n
    p = np.stack([x, y, 0.1 * rng.random(x.shape)], -1).reshape(-1, 3).astype(np.float32)
    i = (np.arange(n)[:, None] * (n + 1) + np.arange(n)).ravel()
    t = np.concatenate([np.stack([i, i + 1, i + n + 1], 1), np.stack([i + 1, i + n + 2, i + n + 1], 1)])
    return p, t.astype(np.uint32)


def only_mesh(path: Path) -> Any:
    scene = dl.load(path)
    (shape,) = [shape for _, shape in scene.all_shapes()]
    return shape


def corners(shape: Any, name: str = "positions") -> Any:
    """The triangles' corners, in an order that depends on nothing but where they are."""
    rows = shape[name][shape["indices"]].reshape(len(shape["indices"]), -1)
    order = np.round(shape["positions"][shape["indices"]].mean(axis=1), 2)
    return rows[np.lexsort(order.T)]


# --- Draco ------------------------------------------------------------------------------------------------------------
def draco(positions: Any, triangles: Any, **changes: Any) -> Gltf:
    draco_package = pytest.importorskip("DracoPy")
    data = draco_package.encode(
        positions, triangles, quantization_bits=16, preserve_order=changes.pop("preserve_order", False),
        tex_coord=positions[:, :2].astype(np.float64),
    )  # fmt: skip
    decoded = draco_package.decode(data)
    numbers = {a["attribute_type"]: a["unique_id"] for a in decoded.attributes}
    count = len(decoded.points)
    g = Gltf()
    view = g.view(changes.pop("data", data))
    attributes = {
        "POSITION": g.add("accessors", componentType=5126, count=changes.pop("vertices", count), type="VEC3"),
        "TEXCOORD_0": g.add("accessors", componentType=5126, count=count, type="VEC2"),
    }
    indices = g.add("accessors", componentType=5125, count=changes.pop("corners", triangles.size), type="SCALAR")
    extension = {"bufferView": view, "attributes": {"POSITION": numbers[0], "TEXCOORD_0": numbers[3]}, **changes}
    g.node(mesh=g.mesh(attributes, indices, extensions={DRACO: extension}))
    g.json["extensionsUsed"] = g.json["extensionsRequired"] = [DRACO]
    return g


@pytest.mark.parametrize("preserve_order", [False, True])
def test_draco_meshes_come_back(preserve_order: bool, rng: np.random.Generator, tmp_path: Path) -> None:
    p, t = grid(6, rng)
    shape = only_mesh(draco(p, t, preserve_order=preserve_order).glb(tmp_path))
    assert shape["indices"].shape == t.shape
    want = dl.shapes.mesh(p, t, uvs=p[:, :2] * (1, -1) + (0, 1))
    for name in ("positions", "uvs"):
        got, expected = corners(shape, name), corners(want, name)
        # A triangle may start with another corner.
        np.testing.assert_allclose(np.sort(got, axis=1), np.sort(expected, axis=1), atol=2e-4)


@pytest.mark.parametrize(
    ("changes", "problem"),
    [
        ({"data": b"DRACO"}, "not a Draco mesh"),
        ({"data": b"garbage in place of a mesh"}, "not a Draco mesh"),
        ({"corners": 3}, "other triangles in the compressed data"),
        ({"vertices": 3}, "other elements in the compressed data"),
        ({"attributes": {"POSITION": 77}}, "no such attribute"),
        ({"data": b"DRACO\x02\x02\x01\x01\0\0\0\x04\xff\xff\xff\x7f" + bytes(40)}, "other triangles"),
    ],
)
def test_broken_draco(changes: dict[str, Any], problem: str, rng: np.random.Generator, tmp_path: Path) -> None:
    p, t = grid(3, rng)
    with pytest.raises(FormatError, match=problem):
        dl.load(draco(p, t, **changes).glb(tmp_path))


def test_draco_cut_short_or_changed_is_an_error_or_a_mesh(rng: np.random.Generator, tmp_path: Path) -> None:
    draco_package = pytest.importorskip("DracoPy")
    p, t = grid(4, rng)
    data = draco_package.encode(p, t, tex_coord=p[:, :2].astype(np.float64))
    for k in range(60):
        broken = bytearray(data)
        if k % 2:
            broken[rng.integers(16, len(data))] ^= 1 << rng.integers(8)
        else:
            broken = broken[: rng.integers(16, len(data))]
        with contextlib.suppress(FormatError):  # and nothing else
            dl.load(draco(p, t, data=bytes(broken)).glb(tmp_path))


# --- meshopt ----------------------------------------------------------------------------------------------------------
def packed(g: Gltf, data: bytes, count: int, stride: int, mode: str, more: dict[str, Any] | None = None) -> int:
    """A buffer view whose bytes are compressed; its own buffer is a stand-in without data."""
    if "buffers" not in g.json:
        g.json["buffers"] = []
    inner = g.view(data)
    real = g.json["bufferViews"].pop(inner)
    extension = {**real, "byteStride": stride, "count": count, "mode": mode, **(more or {})}
    stride_of_view = {"byteStride": stride} if mode == "ATTRIBUTES" else {}
    return g.add(
        "bufferViews", buffer=0, byteOffset=0, byteLength=count * stride, **stride_of_view,
        extensions={MESHOPT: extension},
    )  # fmt: skip


def meshopt(positions: Any, triangles: Any, **changes: Any) -> Gltf:
    package = pytest.importorskip("almeshopt")
    g = Gltf()
    vertices = changes.pop("vertices", package.encode_vertex_buffer(positions, version=0))
    view = packed(g, vertices, len(positions), 12, "ATTRIBUTES", changes.pop("of_vertices", None))
    position = g.add("accessors", bufferView=view, componentType=5126, count=len(positions), type="VEC3")
    indices = package.encode_index_buffer(triangles.ravel(), len(positions))
    view = packed(g, indices, triangles.size, 2, "TRIANGLES", changes.pop("of_indices", None))
    index = g.add("accessors", bufferView=view, componentType=5123, count=triangles.size, type="SCALAR")
    g.node(mesh=g.mesh({"POSITION": position}, index))
    g.json["extensionsUsed"] = g.json["extensionsRequired"] = [MESHOPT]
    return g


def test_meshopt_meshes_come_back(rng: np.random.Generator, tmp_path: Path) -> None:
    p, t = grid(7, rng)
    shape = only_mesh(meshopt(p, t).glb(tmp_path))
    want = dl.shapes.mesh(p, t)
    np.testing.assert_array_equal(np.sort(corners(shape), axis=1), np.sort(corners(want), axis=1))


@pytest.mark.parametrize(
    ("changes", "problem"),
    [
        ({"vertices": b"\xa0" + bytes(30)}, "broken meshopt data"),
        ({"vertices": b"nonsense that is long enough for a header"}, "broken meshopt data"),
        ({"of_vertices": {"count": 2**31}}, "cannot be in"),
        ({"of_vertices": {"byteStride": 6}}, "multiple of 4"),
        ({"of_vertices": {"filter": "MAGIC"}}, "OCTAHEDRAL"),
        ({"of_vertices": {"filter": "QUATERNION"}}, "byteStride"),
        ({"of_indices": {"mode": "INDICES"}}, "no package decodes this"),
        ({"of_indices": {"count": 4}}, "multiple of 3"),
        ({"of_indices": {"byteStride": 1}}, "2 or 4"),
        ({"of_indices": {"count": 30}}, "broken meshopt data|larger than its buffer view"),
        ({"of_indices": {"byteLength": 10**9}}, "reaches beyond its buffer"),
    ],
)
def test_broken_meshopt(changes: dict[str, Any], problem: str, rng: np.random.Generator, tmp_path: Path) -> None:
    p, t = grid(4, rng)
    with pytest.raises(FormatError, match=problem):
        dl.load(meshopt(p, t, **changes).glb(tmp_path))


def through_filter(values: Any, kind: str) -> Any:
    from destello.io._gltf_compression import _filtered
    from destello.io._gltf_json import Item

    raw = np.ascontiguousarray(values).view(np.uint8).reshape(len(values), -1)
    return _filtered(Item({}, Path("f")), raw, kind)


def test_meshopt_filters(rng: np.random.Generator) -> None:
    """Octahedral normals as the package encodes them; exponents and quaternions as the extension defines them."""
    package = pytest.importorskip("almeshopt")
    n = rng.normal(size=(500, 3))
    n = (n / np.linalg.norm(n, axis=1, keepdims=True)).astype(np.float32)
    octahedral = np.asarray(package.encode_filter_oct(n)).reshape(-1, 4).view(np.int8)
    got = through_filter(octahedral, "OCTAHEDRAL")[:, :3] / 127
    assert np.abs(got - n).max() < 0.02
    numbers = np.float32([0, 1, -1, 0.375, -1e-20, 3e20, 123456])
    exponent = np.where(numbers == 0, 0, np.floor(np.log2(np.abs(np.where(numbers == 0, 1, numbers)))) - 22).astype(int)
    mantissa = np.round(numbers / 2.0**exponent).astype(int)
    words = ((exponent & 0xFF) << 24 | (mantissa & 0xFFFFFF)).astype(np.uint32)
    np.testing.assert_allclose(through_filter(words[:, None], "EXPONENTIAL")[:, 0], numbers, rtol=1e-6)
    q = rng.normal(size=(300, 4))
    q /= np.linalg.norm(q, axis=1, keepdims=True)
    largest = np.argmax(np.abs(q), axis=1)
    rows = np.arange(len(q))
    q *= np.sign(q[rows, largest])[:, None]
    three = np.stack([q[rows, (largest + k) % 4] for k in (1, 2, 3)], 1) * np.sqrt(2)
    one = 2047
    stored = np.concatenate([np.round(three * one), ((one & ~3) | largest)[:, None]], 1).astype(np.int16)
    got = through_filter(stored, "QUATERNION") / 32767
    assert np.abs(got - q).max() < 2e-3


# --- KTX2, WebP -------------------------------------------------------------------------------------------------------
def basis(texels: Any, codec: str = "uastc") -> bytes:
    package = pytest.importorskip("alktx2")
    height, width, _ = texels.shape
    return bytes(package.encode_raw_rgba_to_ktx2(texels.tobytes(), width, height, codec=codec, quality=100))


def gradient() -> Any:
    y, x = np.mgrid[0:16, 0:24]
    return np.stack([10 * x, 15 * y, 0 * x + 99, 0 * x + 255], -1).astype(np.uint8)


def textured(data: bytes, *, fallback: bytes | None = None, required: bool = True) -> Gltf:
    g = Gltf()
    image = g.add("images", bufferView=g.view(data), mimeType="image/ktx2")
    texture: dict[str, Any] = {"extensions": {BASISU: {"source": image}}}
    if fallback is not None:
        texture["source"] = g.add("images", bufferView=g.view(fallback), mimeType="image/png")
    index = g.add("textures", **texture)
    material = g.add("materials", pbrMetallicRoughness={"baseColorTexture": {"index": index}})
    g.node(mesh=g.quad(material=material))
    g.json["extensionsUsed"] = [BASISU]
    if required:
        g.json["extensionsRequired"] = [BASISU]
    return g


def base_texels(scene: dl.Scene) -> Any:
    (image,) = [node for node in scene.textures() if node.type == "image"]
    return image["pixels"]


@pytest.mark.parametrize("codec", ["etc1s", "uastc"])
def test_ktx2_textures(codec: str, tmp_path: Path) -> None:
    texels = gradient()
    data = basis(texels, codec)
    got = base_texels(dl.load(textured(data).glb(tmp_path)))
    assert got.dtype == np.uint8
    assert got.shape[:2] == texels.shape[:2]
    assert np.abs(got[..., :3].astype(int) - texels[..., :3]).mean() < (12 if codec == "etc1s" else 4)
    (tmp_path / "a.ktx2").write_bytes(data)
    from destello.images import read_texels

    np.testing.assert_array_equal(read_texels(tmp_path / "a.ktx2"), got)


def header(**changes: int) -> bytes:
    names = ("kind", "type", "width", "height", "depth", "layers", "faces", "levels", "scheme")
    values = {
        "kind": 0,
        "type": 1,
        "width": 8,
        "height": 8,
        "depth": 0,
        "layers": 0,
        "faces": 1,
        "levels": 1,
        "scheme": 0,
    }
    values.update(changes)
    return ktx2.MAGIC + struct.pack("<9I", *(values[name] for name in names)) + bytes(64)


@pytest.mark.parametrize(
    ("data", "problem", "error"),
    [
        (ktx2.MAGIC, "not a KTX2 file", FormatError),
        (header(kind=37), "not a Basis Universal texture", FormatError),
        (header(scheme=3), "unknown supercompression", FormatError),
        (header(faces=6), "not one flat picture", FormatError),
        (header(depth=4), "not one flat picture", FormatError),
        (header(width=10**9), "image size", ImageTooLarge),
        (header(height=0), "image size", ImageTooLarge),
        (header(width=16384, height=16384), "cannot be in", FormatError),
        (header(), "damaged", FormatError),
    ],
)
def test_broken_ktx2(data: bytes, problem: str, error: Any, tmp_path: Path) -> None:
    with pytest.raises(error, match=problem) as caught:
        dl.load(textured(data).glb(tmp_path))
    assert "images[0]" in str(caught.value)


def test_ktx2_cut_short_is_an_error_or_a_picture(rng: np.random.Generator) -> None:
    data = basis(gradient())
    for k in range(60):
        broken = bytearray(data)
        if k % 2:
            broken[rng.integers(48, len(data))] ^= 1 << rng.integers(8)
        else:
            broken = broken[: rng.integers(48, len(data))]
        with contextlib.suppress(FormatError):  # and nothing else
            ktx2.to_png(bytes(broken))


# --- without the packages ---------------------------------------------------------------------------------------------
@pytest.fixture
def no_packages(monkeypatch: pytest.MonkeyPatch) -> None:
    find = importlib.util.find_spec

    def without(name: str, *rest: Any) -> Any:
        return None if name in ("DracoPy", "almeshopt", "alktx2") else find(name, *rest)

    monkeypatch.setattr(importlib.util, "find_spec", without)


@pytest.mark.usefixtures("no_packages")
def test_missing_packages_are_named(rng: np.random.Generator, tmp_path: Path) -> None:
    p, t = grid(2, rng)
    files = {"DracoPy": draco(p, t), "almeshopt": meshopt(p, t), "alktx2": textured(basis(gradient()))}
    for package, g in files.items():
        with pytest.raises(FormatError, match=rf"needs the package {package}.*destello\[gltf\]"):
            dl.load(g.glb(tmp_path))


@pytest.mark.usefixtures("no_packages")
def test_missing_packages_are_named_where_nothing_stands_in(rng: np.random.Generator, tmp_path: Path) -> None:
    """Also if the file does not say that it requires the extension."""
    files = {
        "DracoPy": draco(*grid(2, rng)),
        "almeshopt": without_fallback(meshopt(*grid(2, rng))),
        "alktx2": textured(basis(gradient())),
    }
    for package, g in files.items():
        del g.json["extensionsRequired"]
        with pytest.raises(FormatError, match=f"needs the package {package}"):
            dl.load(g.glb(tmp_path))


def without_fallback(g: Gltf) -> Gltf:
    """The same file with compressed views whose own buffer has no data, as encoders write it."""
    g.json["buffers"] = [{}, {"byteLength": 1 << 20, "extensions": {MESHOPT: {"fallback": True}}}]
    for view in g.json["bufferViews"]:
        if MESHOPT in view.get("extensions", {}):
            view["buffer"] = 1
    return g


def test_meshopt_buffers_without_data_need_none(rng: np.random.Generator, tmp_path: Path) -> None:
    positions, triangles = grid(2, rng)
    mesh = only_mesh(without_fallback(meshopt(positions, triangles)).glb(tmp_path))
    np.testing.assert_array_equal(mesh["indices"].ravel().shape, triangles.ravel().shape)


@pytest.mark.usefixtures("no_packages")
def test_without_packages_the_fallback_holds(tmp_path: Path) -> None:
    """Where the extension is only used, not required, the file's plain data are taken."""
    from scene_files import encode_image

    plain = encode_image(gradient(), ".png", tmp_path)
    got = base_texels(dl.load(textured(b"no KTX2 at all", fallback=plain, required=False).glb(tmp_path)))
    np.testing.assert_array_equal(got, gradient())
    g = Gltf()
    attributes = {"POSITION": g.accessor(QUAD)}
    extension = {"bufferView": g.view(b"nothing"), "attributes": {"POSITION": 0}}
    g.node(mesh=g.mesh(attributes, g.accessor(QUAD_INDICES), extensions={DRACO: extension}))
    assert len(only_mesh(g.glb(tmp_path))["indices"]) == 2
