"""glTF: packages, accessors, primitives."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from destello.io import gltf, load
from gltf_scenes import BARE, TRIANGLE, loaded, only_mesh
from scene_files import QUAD, QUAD_INDICES, QUAD_UV, Gltf

TRIANGLES = np.array([[0, 1, 2], [0, 2, 3]], np.uint32)


# --- packages ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("package", ["glb", "data", "buffer.bin", "name with space.bin", "sub/buffer.bin"])
def test_packages_hold_the_same(package: str, tmp_path: Path) -> None:
    g = Gltf()
    g.node(mesh=g.quad())
    (tmp_path / "sub").mkdir()
    path = g.glb(tmp_path) if package == "glb" else g.gltf(tmp_path, buffer=package)
    (shape,) = gltf.load(path, BARE).shapes
    np.testing.assert_array_equal(shape["positions"], QUAD)
    np.testing.assert_array_equal(shape["indices"], TRIANGLES)
    assert shape["uvs"].tolist() == [[0, 0], [1, 0], [1, 1], [0, 1]]  # v = 0 at the bottom


def test_byte_order_mark_and_glb_named_gltf(tmp_path: Path) -> None:
    g = Gltf()
    g.node(mesh=g.quad())
    path = g.gltf(tmp_path)
    path.write_bytes(b"\xef\xbb\xbf" + path.read_bytes())
    assert len(gltf.load(path, BARE).shapes) == 1
    path.write_bytes(g.glb_bytes())
    assert len(gltf.load(path, BARE).shapes) == 1


def test_scene_is_completed_and_says_so(tmp_path: Path) -> None:
    g = Gltf()
    g.node(mesh=g.quad())
    scene = load(g.glb(tmp_path))
    assert scene.name == "scene"
    assert scene.camera is not None
    assert scene.environment is not None
    assert any("camera" in note for note in scene.notes)
    assert any("sky" in note for note in scene.notes)
    assert scene.base_dir == tmp_path


# --- accessors --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("stride", [0, 12, 20, 32])
def test_strides(stride: int, tmp_path: Path) -> None:
    g = Gltf()
    mesh = g.mesh({"POSITION": g.accessor(QUAD, stride=stride)}, g.accessor(QUAD_INDICES))
    np.testing.assert_array_equal(only_mesh(g, mesh, tmp_path)["positions"], QUAD)


def test_interleaved_vertices_share_one_view(tmp_path: Path) -> None:
    g = Gltf()
    view = g.view(np.hstack([QUAD, QUAD_UV]).astype("<f4").tobytes(), byteStride=20)
    attributes = {
        key: g.add("accessors", bufferView=view, byteOffset=at, componentType=5126, count=4, type=kind)
        for key, at, kind in (("POSITION", 0, "VEC3"), ("TEXCOORD_0", 12, "VEC2"))
    }
    shape = only_mesh(g, g.mesh(attributes, g.accessor(QUAD_INDICES)), tmp_path)
    np.testing.assert_array_equal(shape["positions"], QUAD)
    np.testing.assert_array_equal(shape["uvs"][:, 1], 1 - QUAD_UV[:, 1])


@pytest.mark.parametrize("kind", [np.uint8, np.uint16, np.uint32])
def test_index_types(kind: type, tmp_path: Path) -> None:
    g = Gltf()
    mesh = g.mesh({"POSITION": g.accessor(QUAD)}, g.accessor(QUAD_INDICES.astype(kind)))
    shape = only_mesh(g, mesh, tmp_path)
    np.testing.assert_array_equal(shape["indices"], TRIANGLES)
    assert shape["indices"].dtype == np.uint32


@pytest.mark.parametrize(("kind", "top"), [(np.uint8, 255), (np.uint16, 65535)])
def test_normalized_coordinates_and_colours(kind: type, top: int, tmp_path: Path) -> None:
    g = Gltf()
    uv = np.array([[0, top], [top, top], [top, 0], [top // 5, 0]], kind)
    color = np.array([[top, 0, 0, top], [0, top, 0, 0], [0, 0, top, top // 5], [top, top, top, top]], kind)
    attributes = {
        "POSITION": g.accessor(QUAD),
        "TEXCOORD_0": g.accessor(uv, normalized=True, stride=4 if kind is np.uint8 else 0),
        "COLOR_0": g.accessor(color, normalized=True),
    }
    shape = only_mesh(g, g.mesh(attributes, g.accessor(QUAD_INDICES)), tmp_path)
    np.testing.assert_allclose(shape["uvs"], np.stack([uv[:, 0] / top, 1 - uv[:, 1] / top], 1), atol=1e-7)
    np.testing.assert_allclose(shape["colors"], color / top, atol=1e-7)


@pytest.mark.parametrize(("kind", "top"), [(np.int8, 127), (np.int16, 32767)])
def test_normalized_signed_integers_reach_minus_one(kind: type, top: int, tmp_path: Path) -> None:
    g = Gltf()
    g.extend("KHR_mesh_quantization", required=True)
    points = np.array([[-top, -top - 1, 0], [top, -top, 0], [top, top, 0]], kind)
    stride = 4 if kind is np.int8 else 8
    mesh = g.mesh({"POSITION": g.accessor(points, normalized=True, stride=stride)})
    np.testing.assert_array_equal(only_mesh(g, mesh, tmp_path)["positions"], [[-1, -1, 0], [1, -1, 0], [1, 1, 0]])


def test_quantised_positions_without_normalisation(tmp_path: Path) -> None:
    g = Gltf()
    g.extend("KHR_mesh_quantization", required=True)
    mesh = g.mesh({"POSITION": g.accessor(np.array([[0, 0, 0], [300, 0, 0], [0, -7, 1]], np.int16), stride=8)})
    np.testing.assert_array_equal(only_mesh(g, mesh, tmp_path)["positions"], [[0, 0, 0], [300, 0, 0], [0, -7, 1]])


@pytest.mark.parametrize("based", [True, False])
def test_sparse_accessor(based: bool, tmp_path: Path) -> None:
    g = Gltf()
    values = np.array([[5, 6, 7], [8, 9, 10]], np.float32)
    sparse = {
        "count": 2,
        "indices": {"bufferView": g.view(np.array([1, 3], "<u2").tobytes()), "componentType": 5123},
        "values": {"bufferView": g.view(values.tobytes())},
    }
    base = {"bufferView": g.view(QUAD.tobytes())} if based else {}
    accessor = g.add("accessors", componentType=5126, count=4, type="VEC3", sparse=sparse, **base)
    expected = QUAD.copy() if based else np.zeros((4, 3), np.float32)
    expected[[1, 3]] = values
    shape = only_mesh(g, g.mesh({"POSITION": accessor}, g.accessor(QUAD_INDICES)), tmp_path)
    np.testing.assert_array_equal(shape["positions"], expected)


# --- primitives -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("indexed", [False, True])
@pytest.mark.parametrize(
    ("mode", "expected"),
    [
        (4, [[0, 1, 2], [3, 4, 5]]),
        (5, [[0, 1, 2], [1, 3, 2], [2, 3, 4], [3, 5, 4]]),
        (6, [[1, 2, 0], [2, 3, 0], [3, 4, 0], [4, 5, 0]]),
    ],
)
def test_modes(mode: int, expected: list[list[int]], indexed: bool, tmp_path: Path) -> None:
    g = Gltf()
    points = np.arange(18, dtype=np.float32).reshape(6, 3) ** 2
    indices = g.accessor(np.arange(6, dtype=np.uint8)) if indexed else None
    assert (
        only_mesh(g, g.mesh({"POSITION": g.accessor(points)}, indices, mode=mode), tmp_path)["indices"].tolist()
        == expected
    )


def test_strip_turns_every_second_triangle(tmp_path: Path) -> None:
    g = Gltf()
    points = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0], [0, 2, 0]], np.float32)
    shape = only_mesh(g, g.mesh({"POSITION": g.accessor(points)}, mode=5), tmp_path)
    a, b, c = (points[shape["indices"][:, i]] for i in range(3))
    assert (np.cross(b - a, c - a)[:, 2] > 0).all()


@pytest.mark.parametrize("mode", [0, 1, 2, 3])
def test_points_and_lines_are_noted(mode: int, tmp_path: Path) -> None:
    g = Gltf()
    g.node(mesh=g.mesh({"POSITION": g.accessor(QUAD)}, mode=mode))
    scene = loaded(g, tmp_path)
    assert scene.shapes == []
    assert any("points and lines" in note for note in scene.notes)


def test_instances_of_nothing_are_left_out(tmp_path: Path) -> None:
    g = Gltf()
    mesh = g.mesh({"POSITION": g.accessor(QUAD)}, mode=0)
    for _ in range(2):
        g.node(mesh=mesh)
    scene = loaded(g, tmp_path)
    assert scene.shapes == []
    assert scene.groups == {}
    assert len(scene.notes) == 1


def test_incomplete_triangle_is_noted(tmp_path: Path) -> None:
    g = Gltf()
    g.node(mesh=g.mesh({"POSITION": g.accessor(QUAD)}))
    scene = loaded(g, tmp_path)
    assert scene.shapes[0]["indices"].tolist() == [[0, 1, 2]]
    assert any("incomplete" in note for note in scene.notes)


def test_only_used_vertices_are_kept(tmp_path: Path) -> None:
    g = Gltf()
    points = np.arange(3000, dtype=np.float32).reshape(1000, 3)
    normals = np.tile(np.float32((0, 0, 1)), (1000, 1))
    normals[500] = (0, 1, 0)
    attributes = {"POSITION": g.accessor(points), "NORMAL": g.accessor(normals)}
    shape = only_mesh(g, g.mesh(attributes, g.accessor(np.array([900, 500, 10], np.uint16))), tmp_path)
    np.testing.assert_array_equal(shape["positions"], points[[10, 500, 900]])
    np.testing.assert_array_equal(shape["normals"], normals[[10, 500, 900]])
    assert shape["indices"].tolist() == [[2, 1, 0]]


def test_normals_without_direction_are_replaced(tmp_path: Path) -> None:
    g = Gltf()
    normals = np.array([[0, 1, 0], [0, 0, 0], [np.nan, 0, 0], [0, 1, 0]], np.float32)
    g.node(mesh=g.mesh({"POSITION": g.accessor(QUAD), "NORMAL": g.accessor(normals)}, g.accessor(QUAD_INDICES)))
    scene = loaded(g, tmp_path)
    assert scene.shapes[0]["normals"].tolist() == [[0, 1, 0], [0, 0, 1], [0, 0, 1], [0, 1, 0]]
    assert any("2 of its normals" in note for note in scene.notes)


def test_missing_normals_stay_missing(tmp_path: Path) -> None:
    g = Gltf()
    shape = only_mesh(g, g.quad(), tmp_path)
    assert shape["normals"] is None
    assert shape["colors"] is None


def test_colours_of_three_components(tmp_path: Path) -> None:
    g = Gltf()
    colors = np.array([[0, 0.5, 1], [2, -1, 0.25], [1, 1, 1]], np.float32)
    shape = only_mesh(g, g.mesh({"POSITION": g.accessor(TRIANGLE), "COLOR_0": g.accessor(colors)}), tmp_path)
    np.testing.assert_array_equal(shape["colors"], [[0, 0.5, 1], [1, 0, 0.25], [1, 1, 1]])
