"""STL, binary and text."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
import pytest

from destello.errors import FormatError
from destello.formats import LoadOptions
from destello.io import load, stl
from destello.nodes import Node
from scene_files import sphere

BARE = LoadOptions(complete=False)
CORNERS = np.array([[[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[1, 0, 0], [1, 1, 0], [0, 1, 0]]], np.float32)


def binary(corners: np.ndarray, *, header: bytes = b"made by a test", count: int | None = None) -> bytes:
    records = b"".join(struct.pack("<12fH", 0, 0, 1, *triangle.reshape(-1), 7) for triangle in corners)
    return header.ljust(80, b"\0") + struct.pack("<I", len(corners) if count is None else count) + records


def text(corners: np.ndarray, *, ends: str = "\n") -> bytes:
    lines = ["solid made by a test"]
    for triangle in corners:
        lines += ["  facet normal 0 0 1", "    outer loop"]
        lines += [f"      vertex {x!r} {y!r} {z!r}" for x, y, z in triangle.tolist()]
        lines += ["    endloop", "  endfacet"]
    return ends.join([*lines, "endsolid made by a test", ""]).encode()


def read(folder: Path, data: bytes) -> Node:
    path = folder / "scene.stl"
    path.write_bytes(data)
    (shape,) = stl.load(path, BARE).shapes
    return shape


def triangles(shape: Node) -> np.ndarray:
    found: np.ndarray = shape["positions"][shape["indices"]]
    return found


FILES = {
    "binary": binary(CORNERS),
    "binary that begins with solid": binary(CORNERS, header=b"solid or so they say"),
    "text": text(CORNERS),
    "text with windows line ends": text(CORNERS, ends="\r\n"),
    "text in capitals": text(CORNERS).upper(),
    "text with a colour": text(CORNERS).replace(b"    outer", b"    color 1 0 0\n    outer", 1),
    "two solids": text(CORNERS[:1]) + text(CORNERS[1:]),
    "text without end": text(CORNERS).replace(b"endsolid made by a test\n", b""),
}


@pytest.mark.parametrize("data", FILES.values(), ids=FILES.keys())
def test_forms(data: bytes, tmp_path: Path) -> None:
    shape = read(tmp_path, data)
    np.testing.assert_array_equal(triangles(shape), CORNERS)
    assert len(shape["positions"]) == 4  # equal vertices are merged
    assert shape["normals"] is None


def test_quick_and_thorough_reading_agree(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    corners = np.random.default_rng(4).normal(size=(200, 3, 3)).astype(np.float32)
    data = text(corners)
    monkeypatch.setattr(stl, "_CHUNK", 500)
    quick = stl._regular_corners(data)
    assert quick is not None
    np.testing.assert_array_equal(quick.reshape(-1, 3, 3), corners)
    np.testing.assert_array_equal(stl._any_corners(data, tmp_path), quick)


def test_scene_is_completed_and_says_so(tmp_path: Path) -> None:
    path = tmp_path / "part.stl"
    path.write_bytes(binary(CORNERS))
    scene = load(path)
    assert scene.name == "part"
    assert scene.camera is not None
    assert scene.environment is not None
    assert scene.shapes[0]["material"].type == "diffuse"
    assert any("y is up" in note for note in scene.notes)


def test_minus_zero_is_zero(tmp_path: Path) -> None:
    corners = np.array([[[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[-0.0, 0, -0.0], [0, 1, 0], [-1, 0, 0]]], np.float32)
    assert len(read(tmp_path, binary(corners))["positions"]) == 4


def test_bytes_after_the_end_are_noted(tmp_path: Path) -> None:
    path = tmp_path / "scene.stl"
    path.write_bytes(binary(CORNERS) + b"more")
    assert stl.load(path, BARE).notes == ["4 bytes after the last triangle left out"]


def test_text_without_end_is_noted(tmp_path: Path) -> None:
    path = tmp_path / "scene.stl"
    path.write_bytes(FILES["text without end"])
    assert stl.load(path, BARE).notes == ["no endsolid: the file may be truncated"]


def test_agrees_with_trimesh(tmp_path: Path) -> None:
    import trimesh

    positions, _, indices = sphere(10, 14)
    ball = trimesh.Trimesh(positions, indices.reshape(-1, 3), process=False)
    for kind in ("stl", "stl_ascii"):
        path = tmp_path / "ball.stl"
        ball.export(path, file_type=kind)
        shape = read(tmp_path, path.read_bytes())
        theirs = trimesh.load(path, process=False)
        np.testing.assert_array_equal(triangles(shape), theirs.triangles.astype(np.float32))


@pytest.mark.parametrize(
    ("data", "line", "message"),
    [
        (b"", None, "no room for the header: 0"),
        (b"solid\n", None, "no triangles: 0"),
        (b"solid x\nendsolid x\n", None, "no triangles: 0"),
        (binary(CORNERS, count=0), None, "no triangles: 0"),
        (binary(CORNERS)[:-1], None, "the header announces more triangles than the file has: 2 (accepted: at most 1"),
        (
            binary(CORNERS, count=4_000_000_000),
            None,
            "more triangles than the file has: 4000000000 (accepted: at most 2",
        ),
        (binary(CORNERS * [1, 1, np.nan]), None, "corner 0 is not finite"),
        (text(CORNERS).replace(b"1.0 1.0 0.0", b"1.0 inf 0.0"), None, "corner 4 is not finite"),
        (text(CORNERS).replace(b"1.0 1.0 0.0", b"1.0 one 0.0"), 12, "vertex: not a number: 'one'"),
        (text(CORNERS).replace(b"1.0 1.0 0.0", b"1.0 0.0"), 12, "vertex: wrong number of values: 2 (accepted: 3)"),
        (text(CORNERS).replace(b"      vertex 1.0 1.0 0.0\n", b""), 13, "a loop of 2 vertices"),
        (text(CORNERS).replace(b"    endloop\n", b"", 1), 9, "a loop inside a loop"),
        (text(CORNERS)[:150], 8, "unknown word: 'end"),
        (text(CORNERS)[:100], 5, "the last loop does not end"),
        (text(CORNERS).replace(b"endfacet", b"hello there", 1), 8, "unknown word: 'hello there'"),
    ],
)
def test_errors(data: bytes, line: int | None, message: str, tmp_path: Path) -> None:
    with pytest.raises(FormatError) as caught:
        read(tmp_path, data)
    assert message in str(caught.value)
    assert caught.value.line == line
    assert caught.value.file == str(tmp_path / "scene.stl")
