"""PLY, text and binary."""

from __future__ import annotations

import tracemalloc
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from destello.errors import FormatError
from destello.formats import LoadOptions
from destello.io import load, ply
from destello.nodes import Node
from destello.scene import Scene
from scene_files import sphere

BARE = LoadOptions(complete=False)
FORMATS = ("ascii", "binary_little_endian", "binary_big_endian")
Row = tuple[Any, ...]

SQUARE: list[Row] = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)]
XYZ = "property float x\nproperty float y\nproperty float z\n"
LIST = "property list uchar int vertex_indices\n"


def write(kind: str, *elements: tuple[str, str, list[Row]]) -> bytes:
    """A PLY file of elements (name, property lines, rows); a row's tuples are lists."""
    order = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}[kind]
    head, body = f"ply\nformat {kind} 1.0\ncomment by a test\n", b""
    numpy_types = {
        "float": "f4",
        "double": "f8",
        "uchar": "u1",
        "char": "i1",
        "ushort": "u2",
        "int": "i4",
        "uint": "u4",
    }
    for name, properties, rows in elements:
        head += f"element {name} {len(rows)}\n{properties}"
        kinds = [line.split()[1:-1] for line in properties.splitlines()]
        for row in rows:
            values: list[tuple[str, Any]] = []
            for kind_of, value in zip(kinds, row, strict=True):
                if kind_of[0] == "list":
                    values += [(kind_of[1], len(value)), *((kind_of[2], v) for v in value)]
                else:
                    values.append((kind_of[0], value))
            if order:
                body += b"".join(np.array(v, order + numpy_types[t]).tobytes() for t, v in values)
            else:
                body += " ".join(str(v) for _, v in values).encode() + b"\n"
    return head.encode() + b"end_header\n" + body


def read(folder: Path, data: bytes) -> Scene:
    path = folder / "scene.ply"
    path.write_bytes(data)
    return ply.load(path, BARE)


def triangles(shape: Node) -> np.ndarray:
    found: np.ndarray = shape["positions"][shape["indices"]]
    return found


# --- forms ------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", FORMATS)
@pytest.mark.parametrize("name", ["vertex_indices", "vertex_index"])
def test_faces_of_equal_and_of_mixed_size(kind: str, name: str, tmp_path: Path) -> None:
    lists = LIST.replace("vertex_indices", name)
    equal = write(kind, ("vertex", XYZ, SQUARE), ("face", lists, [((0, 1, 2),), ((0, 2, 3),)]))
    mixed = write(kind, ("vertex", XYZ, SQUARE), ("face", lists, [((0, 1, 2, 3),), ((3, 2, 1),), ((0, 1),)]))
    (shape,) = read(tmp_path, equal).shapes
    np.testing.assert_array_equal(shape["positions"], SQUARE)
    assert shape["indices"].tolist() == [[0, 1, 2], [0, 2, 3]]
    (shape,) = read(tmp_path, mixed).shapes
    assert shape["indices"].tolist() == [[0, 1, 2], [0, 2, 3], [3, 2, 1]]


@pytest.mark.parametrize("kind", FORMATS)
def test_everything_that_a_vertex_may_have(kind: str, tmp_path: Path) -> None:
    properties = "property uchar quality\n" + XYZ.replace("float", "double")
    properties += "property float nx\nproperty float ny\nproperty float nz\nproperty float s\nproperty float t\n"
    properties += "property uchar red\nproperty uchar green\nproperty uchar blue\nproperty uchar alpha\n"
    properties += "property list uchar ushort tags\n"
    rows = [
        (9, 0.5, 0, 0, 0, 0, 1, 0, 0.25, 255, 0, 0, 51, (1, 2)),
        (9, 1, 0, 0, 0, 0, 1, 1, 0.5, 0, 188, 0, 255, ()),
        (9, 0, 1, 0, 0, 1, 0, 0.5, 1, 0, 0, 255, 0, (5,)),
    ]
    faces = "property uchar flags\n" + LIST.replace("uchar int", "int uint") + "property float area\n"
    data = write(
        kind,
        ("camera", "property float f\n", [(1.5,)]),
        ("vertex", properties, rows),
        ("face", faces, [(1, (0, 1, 2), 0.5)]),
    )
    (shape,) = read(tmp_path, data).shapes
    np.testing.assert_array_equal(shape["positions"], [[0.5, 0, 0], [1, 0, 0], [0, 1, 0]])
    np.testing.assert_array_equal(shape["normals"], [[0, 0, 1], [0, 0, 1], [0, 1, 0]])
    np.testing.assert_array_equal(shape["uvs"], [[0, 0.25], [1, 0.5], [0.5, 1]])
    expected = [[1, 0, 0, 0.2], [0, 0.502886, 0, 1], [0, 0, 1, 0]]  # linear; alpha as it is
    np.testing.assert_allclose(shape["colors"], expected, atol=1e-5)
    assert shape["material"]["reflectance"].type == "vertex_color"
    assert shape["indices"].tolist() == [[0, 1, 2]]


@pytest.mark.parametrize("names", ["u v", "s t", "texture_u texture_v", "texture_s texture_t"])
def test_names_of_texture_coordinates(names: str, tmp_path: Path) -> None:
    properties = XYZ + "".join(f"property float {name}\n" for name in names.split())
    rows = [(*p, p[0] / 2, p[1]) for p in SQUARE]
    (shape,) = read(tmp_path, write("ascii", ("vertex", properties, rows), ("face", LIST, [((0, 1, 2),)]))).shapes
    np.testing.assert_array_equal(shape["uvs"], [[0, 0], [0.5, 0], [0.5, 1], [0, 1]])


def test_float_colours(tmp_path: Path) -> None:
    properties = XYZ + "property float red\nproperty float green\nproperty float blue\n"
    rows = [(*p, 1, 0.5, -1) for p in SQUARE]
    (shape,) = read(tmp_path, write("ascii", ("vertex", properties, rows), ("face", LIST, [((0, 1, 2),)]))).shapes
    np.testing.assert_allclose(shape["colors"], [[1, 0.214041, 0]] * 4, atol=1e-5)


@pytest.mark.parametrize("kind", FORMATS)
def test_triangle_strips(kind: str, tmp_path: Path) -> None:
    strips = [((0, 1, 3, 2, -1, 2, 3, 1),), ((1, 2),)]
    data = write(kind, ("vertex", XYZ, SQUARE), ("tristrips", LIST, strips))
    (shape,) = read(tmp_path, data).shapes
    assert shape["indices"].tolist() == [[0, 1, 3], [1, 2, 3], [2, 3, 1]]


@pytest.mark.parametrize("kind", FORMATS)
def test_concave_face(kind: str, tmp_path: Path) -> None:
    points: list[Row] = [(0, 0, 0), (4, 0, 0), (1, 1, 0), (0, 4, 0)]
    (shape,) = read(tmp_path, write(kind, ("vertex", XYZ, points), ("face", LIST, [((0, 1, 2, 3),)]))).shapes
    corners = triangles(shape)
    assert (np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])[:, 2] > 0).all()


def test_windows_line_ends(tmp_path: Path) -> None:
    data = write("ascii", ("vertex", XYZ, SQUARE), ("face", LIST, [((0, 1, 2),)])).replace(b"\n", b"\r\n")
    assert len(read(tmp_path, data).shapes) == 1
    data = write("binary_little_endian", ("vertex", XYZ, SQUARE), ("face", LIST, [((0, 1, 2),)]))
    head, body = data.split(b"end_header\n")
    assert len(read(tmp_path, head.replace(b"\n", b"\r\n") + b"end_header\r\n" + body).shapes) == 1


def test_scene_is_completed_and_says_so(tmp_path: Path) -> None:
    path = tmp_path / "scan.ply"
    path.write_bytes(write("ascii", ("vertex", XYZ, SQUARE), ("face", LIST, [((0, 1, 2),)])))
    scene = load(path)
    assert scene.camera is not None
    assert scene.environment is not None
    assert scene.shapes[0]["material"]["reflectance"] == (0.6, 0.6, 0.6)


def test_agrees_with_plyfile(tmp_path: Path) -> None:
    import plyfile

    positions, uvs, indices = sphere(9, 11)
    rng = np.random.default_rng(5)
    vertex = np.zeros(
        len(positions),
        [(n, "f4") for n in ("x", "y", "z", "u", "v")] + [("red", "u1"), ("green", "u1"), ("blue", "u1")],
    )
    for column, values in zip("xyzuv", [*positions.T, *uvs.T], strict=True):
        vertex[column] = values
    faces = np.empty(len(indices) // 3, [("vertex_indices", "O"), ("extra", "f8")])
    for i, triangle in enumerate(indices.reshape(-1, 3)):
        faces[i] = (np.append(triangle, triangle[:1]) if i % 3 == 0 else triangle, rng.random())
    for options in ({"text": True}, {"byte_order": "<"}, {"byte_order": ">"}):
        elements = [
            plyfile.PlyElement.describe(vertex, "vertex"),
            plyfile.PlyElement.describe(faces, "face", val_types={"vertex_indices": "i4"}),
        ]
        path = tmp_path / "theirs.ply"
        plyfile.PlyData(elements, **options).write(path)
        elements_read = ply.parse(path.read_bytes(), path)
        sizes, flat = elements_read["face"].lists["vertex_indices"]
        np.testing.assert_array_equal(flat, np.concatenate(list(faces["vertex_indices"])))
        assert sizes.tolist() == [len(f) for f in faces["vertex_indices"]]
        extra = plyfile.PlyData.read(path)["face"]["extra"]  # not `faces`: plyfile forgets to swap them when it writes
        np.testing.assert_array_equal(elements_read["face"].scalars["extra"], extra)
        (shape,) = ply.load(path, BARE).shapes
        np.testing.assert_array_equal(shape["positions"], positions)
        np.testing.assert_array_equal(shape["uvs"], uvs)


# --- errors -----------------------------------------------------------------------------------------------------------

GOOD = write("ascii", ("vertex", XYZ, SQUARE), ("face", LIST, [((0, 1, 2),)])).decode()


@pytest.mark.parametrize(
    ("data", "line", "message"),
    [
        ("", 1, "not a PLY file"),
        ("plx\n", 1, "not a PLY file: b'plx\\n'"),
        ("ply\nformat ascii 1.0\n", None, "the header does not end"),
        (GOOD.replace("format ascii 1.0\n", ""), 2, "no format line"),
        (GOOD.replace("ascii", "EBCDIC"), 2, "not understood: 'format EBCDIC 1.0'"),
        (GOOD.replace("vertex 4", "vertex many"), 4, "not understood: 'element vertex many'"),
        (GOOD.replace("vertex 4", "vertex -4"), 4, "not understood"),
        (GOOD.replace("float x", "half x"), 5, "not understood: 'property half x'"),
        (GOOD.replace("uchar int", "float int"), 9, "not understood"),
        (GOOD.replace("vertex 4", "vertex 9"), 4, "truncated: 5 of the rows of element vertex are there: 9"),
        (GOOD.replace("vertex 4", "vertex 999999999999999"), 4, "truncated"),
        (GOOD.replace("element vertex", "element vortex"), None, "no vertices: 'vortex, face'"),
        (GOOD.replace("float z", "float w"), None, "no vertices"),
        (GOOD.replace("vertex_indices", "corners"), 8, "no vertex numbers in element face: 'corners'"),
        (GOOD.replace("element face 1", "element face 0"), None, "no faces: 'vertex (4), face (0)'"),
        (
            GOOD.replace("3 0 1 2", "3 0 1 4"),
            None,
            "index 2 refers to a vertex that is not there: 4 (accepted: 0 to 3)",
        ),
        (GOOD.replace("3 0 1 2", "3 0 -1 2"), None, "index 1 refers to a vertex that is not there: -1"),
        (GOOD.replace("3 0 1 2", "3 0 1.5 2"), None, "index 1 is not whole: 1.5"),
        (GOOD.replace("3 0 1 2", "3 0 1"), 15, "wrong number of values: 3"),
        (GOOD.replace("3 0 1 2", "3 0 1 2 3"), 15, "wrong number of values: 5"),
        (GOOD.replace("3 0 1 2", "-3 0 1 2"), 15, "wrong number of values"),
        (GOOD.replace("3 0 1 2", "1e300 0 1 2"), 15, "wrong number of values"),
        (GOOD.replace("1 1 0", "1 one 0"), 13, "not a number: 'one'"),
        (GOOD.replace("1 1 0", "1 nan 0"), None, "vertex 2 is not finite"),
        (GOOD.replace("1 1 0", "1 1e39 0"), None, "vertex 2 is not finite"),
    ],
)
def test_errors_in_text(data: str, line: int | None, message: str, tmp_path: Path) -> None:
    with pytest.raises(FormatError) as caught:
        read(tmp_path, data.encode())
    assert message in str(caught.value)
    assert caught.value.line == line
    assert caught.value.file == str(tmp_path / "scene.ply")


@pytest.mark.parametrize("kind", FORMATS[1:])
@pytest.mark.parametrize("face", [[((0, 1, 2),)], [((0, 1, 2),), ((0, 1, 2, 3),)]])
def test_every_truncation_is_an_error(kind: str, face: list[Row], tmp_path: Path) -> None:
    data = write(kind, ("vertex", XYZ, SQUARE), ("face", LIST, face))
    for size in range(len(data)):
        with pytest.raises(FormatError):
            read(tmp_path, data[:size])


@pytest.mark.parametrize("kind", FORMATS)
@pytest.mark.parametrize("what", ["vertex 4", "face 1"])
def test_absurd_counts_take_no_memory(kind: str, what: str, tmp_path: Path) -> None:
    data = write(kind, ("vertex", XYZ, SQUARE), ("face", LIST, [((0, 1, 2),)]))
    name = what.split()[0]
    tracemalloc.start()
    try:
        with pytest.raises(FormatError, match="truncated"):
            read(tmp_path, data.replace(what.encode(), f"{name} 99999999999".encode()))
        assert tracemalloc.get_traced_memory()[1] < 10_000_000
    finally:
        tracemalloc.stop()


def test_absurd_list_lengths(tmp_path: Path) -> None:
    lists = LIST.replace("uchar int", "uint int")
    data = write("binary_little_endian", ("vertex", XYZ, SQUARE), ("face", lists, [((0, 1, 2),)]))
    broken = data[:-16] + b"\xff\xff\xff\xff" + data[-12:]
    with pytest.raises(FormatError, match="row 0 of element face reaches beyond the end"):
        read(tmp_path, broken)
    lists = LIST.replace("uchar int", "char int")
    data = write("binary_little_endian", ("vertex", XYZ, SQUARE), ("face", lists, [((0, 1, 2),)]))
    with pytest.raises(FormatError, match="a list of negative length: -1"):
        read(tmp_path, data[:-13] + b"\xff" + data[-12:])
