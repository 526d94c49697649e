"""Wavefront OBJ and MTL."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from destello.errors import FormatError, InputError, MissingFileError
from destello.formats import LoadOptions
from destello.io import load, obj
from destello.nodes import Node
from destello.scene import Scene
from scene_files import corner_image, encode_image

BARE = LoadOptions(complete=False)
SQUARE = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\n"


def read(folder: Path, text: str, *, mtl: str | None = None, options: LoadOptions = BARE) -> Scene:
    if mtl is not None:
        (folder / "scene.mtl").write_text(mtl)
    path = folder / "scene.obj"
    path.write_text(text)
    return obj.load(path, options)


def triangles(shape: Node) -> np.ndarray:
    """(T, 3, 3) corner positions."""
    found: np.ndarray = shape["positions"][shape["indices"]]
    return found


def material(folder: Path, mtl: str) -> Node:
    node = read(folder, f"mtllib scene.mtl\n{SQUARE}usemtl m\nf 1 2 3\n", mtl=f"newmtl m\n{mtl}").shapes[0]["material"]
    assert isinstance(node, Node)
    return node


# --- geometry ---------------------------------------------------------------------------------------------------------


def test_square_becomes_two_triangles(tmp_path: Path) -> None:
    scene = load(read(tmp_path, SQUARE + "f 1 2 3 4\n").base_dir / "scene.obj")  # type: ignore[operator]
    (shape,) = scene.shapes
    np.testing.assert_array_equal(shape["positions"], [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])
    assert shape["indices"].tolist() == [[0, 1, 2], [0, 2, 3]]
    assert shape["normals"] is None
    assert shape["uvs"] is None
    assert shape["material"]["reflectance"] == (0.6, 0.6, 0.6)
    assert scene.camera is not None
    assert scene.environment is not None


def test_coordinates_and_normals_by_corner(tmp_path: Path) -> None:
    text = SQUARE + "vt 0 0\nvt 1 0.25\nvt 0.5\nvn 0 0 1\nvn 0 1 0\nf 1/1/1 2/2/1 3/3/2\nf 1/1/1 3/3/2 4/2/1\n"
    (shape,) = read(tmp_path, text).shapes
    np.testing.assert_array_equal(triangles(shape)[1], [[0, 0, 0], [1, 1, 0], [0, 1, 0]])
    np.testing.assert_array_equal(shape["uvs"][shape["indices"][0]], [[0, 0], [1, 0.25], [0.5, 0]])
    np.testing.assert_array_equal(shape["normals"][shape["indices"][0]], [[0, 0, 1], [0, 0, 1], [0, 1, 0]])
    assert len(shape["positions"]) == 4  # equal corners are shared


@pytest.mark.parametrize(
    "face",
    [
        "f 1 2 3",
        "f -4 -3 -2",
        "f 1/ 2/ 3/",
        "f 1// 2// 3//",
        "f\t1\t2\t3",
        "  f 1 2 3 # c",
        "f 1 \\\n 2 \\\n3",
        "f +1 2 3",
    ],
)
def test_ways_to_write_a_face(face: str, tmp_path: Path) -> None:
    (shape,) = read(tmp_path, SQUARE + face + "\n").shapes
    np.testing.assert_array_equal(triangles(shape), [[[0, 0, 0], [1, 0, 0], [1, 1, 0]]])


def test_negative_numbers_count_from_where_they_stand(tmp_path: Path) -> None:
    text = "v 0 0 0\nv 1 0 0\nv 0 1 0\nf -3 -2 -1\nv 5 0 0\nv 6 0 0\nv 5 1 0\nf -3 -2 -1\nf 1 2 3\n"
    (shape,) = read(tmp_path, text).shapes
    assert triangles(shape)[:, 0, 0].tolist() == [0, 5, 0]


def test_mixed_faces_and_line_ends(tmp_path: Path) -> None:
    text = SQUARE + "vt 0 0\nvn 0 0 1\nf 1 2 3\nf 1/1 2/1 3/1 4/1\nf 1//1 2//1 3//1\nf 1/1/1 2//1 3/1\n"
    for ends in ("\n", "\r\n", "\r"):
        (tmp_path / "scene.obj").write_bytes(text.replace("\n", ends).encode())
        shapes = obj.load(tmp_path / "scene.obj", BARE).shapes
        assert sorted(len(shape["indices"]) for shape in shapes) == [1, 4]


def test_concave_polygon(tmp_path: Path) -> None:
    points = np.array([[0, 0], [4, 0], [4, 4], [2, 1], [0, 4]], float)
    text = "".join(f"v {x} {y} 0\n" for x, y in points) + "f 1 2 3 4 5\nf 5 4 3 2 1\n"
    (shape,) = read(tmp_path, text).shapes
    corners = triangles(shape).astype(np.float64)
    area = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])[:, 2] / 2
    assert (area[:3] > 0).all()
    assert (area[3:] < 0).all()
    x, y = points.T
    shoelace = 0.5 * (x * np.roll(y, -1) - y * np.roll(x, -1)).sum()
    assert area[:3].sum() == pytest.approx(shoelace)
    assert area[3:].sum() == pytest.approx(-shoelace)


def test_concave_quad_is_split_at_the_right_corner(tmp_path: Path) -> None:
    text = "v 0 0 0\nv 4 0 0\nv 1 1 0\nv 0 4 0\nf 1 2 3 4\nf 2 3 4 1\n"
    corners = triangles(read(tmp_path, text).shapes[0])
    assert (np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])[:, 2] > 0).all()


def test_smoothing_group_gives_normals(tmp_path: Path) -> None:
    """A cube's corner: smooth within a group, hard between groups, flat without."""
    text = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\ns 1\nf 1 2 3\nf 1 3 4\ns 2\nf 1 4 2\ns off\nf 2 3 4\n"
    shapes = read(tmp_path, text).shapes
    flat, smooth = sorted(shapes, key=lambda shape: shape["normals"] is not None)
    assert (len(flat["indices"]), len(smooth["indices"])) == (1, 3)
    at_origin = smooth["normals"][(smooth["positions"] == 0).all(axis=1)]
    unit = at_origin / np.linalg.norm(at_origin, axis=1, keepdims=True)
    expected = sorted([[0, 1, 0], [2**-0.5, 0, 2**-0.5]])
    np.testing.assert_allclose(sorted(unit.tolist()), expected, atol=1e-6)


def test_vertex_colours(tmp_path: Path) -> None:
    text = "v 0 0 0 1 0 0\nv 1 0 0 0 1 0\nv 0 1 0 0 0 0.5\nf 1 2 3\n"
    (shape,) = read(tmp_path, text).shapes
    np.testing.assert_allclose(shape["colors"], [[1, 0, 0], [0, 1, 0], [0, 0, 0.21404]], atol=1e-5)
    assert shape["material"]["reflectance"].type == "vertex_color"


def test_weights_of_vertices_are_left_out(tmp_path: Path) -> None:
    (shape,) = read(tmp_path, "v 0 0 0 1\nv 1 0 0 1\nv 0 1 0\nf 1 2 3\n").shapes
    assert shape["colors"] is None
    assert shape["positions"][1].tolist() == [1, 0, 0]


def test_materials_by_face(tmp_path: Path) -> None:
    text = f"mtllib scene.mtl\n{SQUARE}o thing\ng a b\nusemtl red one\nf 1 2 3\nusemtl blue\nf 1 3 4\n"
    text += "usemtl red one\nf 2 3 4\n"
    scene = read(tmp_path, text, mtl="newmtl red one\nKd 1 0 0\nnewmtl blue\nKd 0 0 1\n")
    assert {s.name: (s["material"]["reflectance"], len(s["indices"])) for s in scene.shapes} == {
        "red one": ((1, 0, 0), 2),
        "blue": ((0, 0, 1), 1),
    }
    assert scene.notes == []


def test_missing_material_file_is_noted(tmp_path: Path) -> None:
    scene = read(tmp_path, f"mtllib no such.mtl\n{SQUARE}usemtl x\nf 1 2 3\n")
    assert any("no such.mtl" in note or "no" in note.split() for note in scene.notes)
    assert any("no material 'x'" in note for note in scene.notes)
    assert scene.shapes[0]["material"]["reflectance"] == (0.6, 0.6, 0.6)


def test_unknown_statements_are_noted_once(tmp_path: Path) -> None:
    scene = read(tmp_path, SQUARE + "curv 0 1\nl 1 2\nl 2 3\nf 1 2 3\n")
    assert scene.notes == ["scene.obj: statements not understood: l (2), curv (1)"]


# --- MTL --------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("mtl", "kind", "values"),
    [
        ("Kd 0.1 0.2 0.3", "diffuse", {"reflectance": (0.1, 0.2, 0.3)}),
        ("Kd 0.5", "diffuse", {"reflectance": (0.5, 0.5, 0.5)}),
        ("illum 1\nKs 1 1 1", "diffuse", {}),
        ("Ks 0.5 0.5 0.5\nNs 30", "metallic_roughness", {"specular_color": (1, 1, 1), "metallic": 0, "roughness": 0.5}),
        ("Kd 0.8 0.6 0.2\nPm 1\nPr 0.3", "metallic_roughness", {"metallic": 1, "roughness": 0.3}),
        ("illum 7\nNi 1.33\nTf 1 0.9 0.8", "dielectric", {"ior": 1.33, "tint": (1, 0.9, 0.8), "roughness": 0}),
        ("illum 4\nd 0.1", "dielectric", {"opacity": 1}),
        ("illum 3\nKd 0 0 0\nKs 0.9 0.8 0.7", "conductor", {"reflectance": (0.9, 0.8, 0.7), "fresnel": "none"}),
        ("illum 5\nKd 0.25 0.25 0.25\nKs 0.75 0.75 0.75", "mix", {"amount": 0.75}),
        ("Ke 5 4 3", "diffuse", {"emission": (5, 4, 3), "emission_two_sided": True}),
        ("d 0.25", "diffuse", {"opacity": 0.25}),
        ("Tr 0.25", "diffuse", {"opacity": 0.75}),
        ("d -halo 0.5", "diffuse", {"opacity": 0.5}),
        ("Kd 2 -1 0.5", "diffuse", {"reflectance": (1, 0, 0.5)}),
    ],
)
def test_materials(mtl: str, kind: str, values: dict[str, Any], tmp_path: Path) -> None:
    node = material(tmp_path, mtl)
    assert node.type == kind
    assert node.name == "m"
    for key, value in values.items():
        assert node[key] == (value if isinstance(value, (str, bool)) else pytest.approx(value)), key


def test_mirror_over_diffuse_keeps_both_reflectances(tmp_path: Path) -> None:
    node = material(tmp_path, "illum 3\nKd 0.3 0.2 0.1\nKs 0.6 0.5 0.4")
    amount = node["amount"]
    np.testing.assert_allclose(np.multiply(node["first"]["reflectance"], 1 - amount), (0.3, 0.2, 0.1))
    np.testing.assert_allclose(np.multiply(node["second"]["reflectance"], amount), (0.6, 0.5, 0.4))


def test_maps(tmp_path: Path) -> None:
    node = material(
        tmp_path,
        "Kd 0.5 1 1\nPr 0.5\nmap_Kd -s 2 3 1 -o 0.5 0.25 -clamp on tex\\my color.png\nmap_Ke glow.png\n"
        "map_Pr -imfchan g rough.png\nmap_Pm metal.png\nmap_d mask.png\nnorm -bm 0.5 normal.png",
    )
    base = node["base_color"]
    assert base["scale"] == (0.5, 1, 1)
    image = base["texture"]
    assert (image["path"], image["color_space"]) == ("tex/my color.png", "srgb")
    assert (image["uv_scale"], image["uv_offset"]) == ((2, 3), (0.5, 0.25))
    assert (image["wrap_u"], image["wrap_v"]) == ("clamp", "clamp")
    assert node["emission"]["path"] == "glow.png"
    rough, metal, mask = node["roughness"], node["metallic"], node["opacity"]
    assert (rough["channel"], rough["scale"], rough["texture"]["color_space"]) == ("g", (0.5,) * 3, "linear")
    assert (metal["channel"], metal["scale"]) == ("mean", (1, 1, 1))
    assert (mask["channel"], mask["texture"]["path"]) == ("mean", "mask.png")
    assert (node["normal_map"]["path"], node["normal_scale"]) == ("normal.png", 0.5)


def test_map_stands_alone_over_black(tmp_path: Path) -> None:
    assert material(tmp_path, "Kd 0 0 0\nmap_Kd a.png")["reflectance"].type == "image"


def test_mask_in_the_colour_map_is_its_alpha(tmp_path: Path) -> None:
    assert material(tmp_path, "map_Kd leaf.png\nmap_d leaf.png")["opacity"]["channel"] == "a"


def test_maps_are_relative_to_the_material_file(tmp_path: Path) -> None:
    (tmp_path / "mats").mkdir()
    (tmp_path / "mats" / "a.mtl").write_text("newmtl m\nmap_Kd t.png\n")
    scene = read(tmp_path, f"mtllib mats\\a.mtl\n{SQUARE}usemtl m\nf 1 2 3\n")
    assert scene.shapes[0]["material"]["reflectance"]["path"] == "mats/t.png"


def test_several_material_files_on_one_line(tmp_path: Path) -> None:
    for name, color in (("a", "1 0 0"), ("b", "0 1 0")):
        (tmp_path / f"{name}.mtl").write_text(f"newmtl {name}\nKd {color}\n")
    scene = read(tmp_path, f"mtllib a.mtl b.mtl\n{SQUARE}usemtl b\nf 1 2 3\nusemtl a\nf 1 3 4\n")
    assert [s["material"]["reflectance"] for s in scene.shapes] == [(0, 1, 0), (1, 0, 0)]


def test_missing_maps_are_listed_at_once(tmp_path: Path) -> None:
    mtl = "newmtl m\nmap_Kd one.png\nmap_Ke here.png\nnewmtl n\nmap_Kd two.png\nnewmtl unused\nmap_Kd three.png\n"
    (tmp_path / "here.png").write_bytes(encode_image(corner_image(), ".png", tmp_path))
    text = f"mtllib scene.mtl\n{SQUARE}usemtl m\nf 1 2 3\nusemtl n\nf 1 3 4\n"
    with pytest.raises(MissingFileError) as caught:
        read(tmp_path, text, mtl=mtl, options=LoadOptions())
    assert caught.value.paths == ["one.png", "two.png"]
    assert len(read(tmp_path, text, mtl=mtl, options=LoadOptions(allow_missing=True)).shapes) == 2


@pytest.mark.parametrize("what", ["mtllib ../x.mtl\n", "mtllib in.mtl\n"])
def test_files_outside_are_refused(what: str, tmp_path: Path) -> None:
    folder = tmp_path / "in"
    folder.mkdir()
    (tmp_path / "x.mtl").write_text("newmtl m\nKd 1 0 0\n")
    (folder / "in.mtl").write_text("newmtl m\nmap_Kd ../x.mtl\n")
    (folder / "scene.obj").write_text(f"{what}{SQUARE}usemtl m\nf 1 2 3\n")
    with pytest.raises(InputError, match="allow-external"):
        load(folder / "scene.obj")
    assert len(load(folder / "scene.obj", allow_external=True).shapes) == 1


# --- errors -----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("text", "line", "message"),
    [
        ("", None, "no faces"),
        ("\0\1\2" * 100, None, "no faces"),
        (SQUARE, None, "no faces"),
        (SQUARE + "f 1 2\n", 5, "f: too few corners: 2 (accepted: 3 or more)"),
        (SQUARE + "f 1 2 5\n", 5, "index of a vertex that is not there: 5 (accepted: 1 to 4 or -4 to -1)"),
        (SQUARE + "\n# c\nf 1 2 3\nf 1 2 0\n", 8, "index of a vertex that is not there: 0"),
        (SQUARE + "f 1 2 -5\n", 5, "not there: -5"),
        (SQUARE + "f 1 2 99999999999999999999\n", 5, "f: not a corner: '99999999999999999999'"),
        (SQUARE + "f 1/1 2/1 3/1\n", 5, "texture coordinate that is not there: 1 (accepted: none"),
        (SQUARE + "f 1//2 2//1 3//1\n", 5, "normal that is not there: 2"),
        (SQUARE + "f 1 2 x\n", 5, "f: not a corner: 'x' (accepted: v, v/vt, v//vn or v/vt/vn)"),
        (SQUARE + "f 1 2 3\nf 1/1/1/1 2 3\n", 6, "f: not a corner: '1/1/1/1'"),
        (SQUARE + "f 1.5 2 3\n", 5, "f: not a corner: '1.5'"),
        (SQUARE + "v 1 2 three\nf 1 2 3\n", 5, "v: not a number: 'three'"),
        (SQUARE + "v 1 2\nf 1 2 3\n", 5, "v: wrong number of values: 2 (accepted: 3 or 4 or 6 or 7)"),
        ("v 0 0 0\nv nan 0 0\nv 1 1 1\nf 1 2 3\n", 2, "vertex 2 is not finite: nan"),
        (SQUARE + "v 1 1 1e39\nf 1 2 3\n", 5, "vertex 5 is not finite: 1e+39"),
        (SQUARE + "vn 1 0\nf 1 2 3\n", 5, "vn: wrong number of values"),
        (SQUARE + "s x\nf 1 2 3\n", 5, "wrong smoothing group: 'x'"),
        ("v 0 0 0 \\\n\nv 0 0 x\n", 3, "v: not a number"),
    ],
)
def test_errors_name_the_line(text: str, line: int | None, message: str, tmp_path: Path) -> None:
    with pytest.raises(FormatError) as caught:
        read(tmp_path, text)
    assert message in str(caught.value)
    assert caught.value.line == line
    assert str(caught.value).startswith(f"{tmp_path / 'scene.obj'}:")


@pytest.mark.parametrize(
    ("mtl", "line", "message"),
    [
        ("Kd 1 0 0\n", 1, "kd before the first newmtl"),
        ("newmtl m\nKd 1 0\n", 2, "kd: wrong values: '1 0' (accepted: 1 or 3 finite numbers)"),
        ("newmtl m\n\nNs ten\n", 3, "ns: wrong values"),
        ("newmtl m\nKe nan 0 0\n", 2, "ke: wrong values"),
        ("newmtl m\nmap_Kd\n", 2, "a map without a file"),
        ("newmtl m\nillum 7\nNi 0.0005\n", 1, "newmtl m: out of range: 0.0005"),
    ],
)
def test_material_errors_name_the_line(mtl: str, line: int, message: str, tmp_path: Path) -> None:
    with pytest.raises(FormatError) as caught:
        read(tmp_path, f"mtllib scene.mtl\n{SQUARE}usemtl m\nf 1 2 3\n", mtl=mtl)
    assert message in str(caught.value)
    assert (caught.value.file, caught.value.line) == (str(tmp_path / "scene.mtl"), line)


# --- another reader ---------------------------------------------------------------------------------------------------


def test_agrees_with_tinyobjloader(tmp_path: Path) -> None:
    """A torus of quads and triangles with texture coordinates and normals."""
    import tinyobjloader

    rng = np.random.default_rng(7)
    n, m = 40, 30
    u, v = np.meshgrid(np.arange(n) / n, np.arange(m) / m, indexing="ij")
    a, b = 2 * np.pi * u, 2 * np.pi * v
    points = np.stack([(2 + np.cos(b)) * np.cos(a), (2 + np.cos(b)) * np.sin(a), np.sin(b)], -1).reshape(-1, 3)
    lines = [f"v {x:.6g} {y:.6g} {z:.6g}" for x, y, z in points]
    lines += [f"vt {s:.6g} {t:.6g}" for s, t in np.stack([u, v], -1).reshape(-1, 2)]
    lines += [f"vn {x:.6g} {y:.6g} {z:.6g}" for x, y, z in rng.normal(size=(50, 3))]
    number = np.arange(n * m).reshape(n, m) + 1
    for i in range(n):
        for j in range(m):
            quad = [number[i, j], number[(i + 1) % n, j], number[(i + 1) % n, (j + 1) % m], number[i, (j + 1) % m]]
            normals = rng.integers(1, 51, 4)
            corners = [f"{p}/{p}/{k}" for p, k in zip(quad, normals, strict=True)]
            lines += (
                [f"f {' '.join(corners)}"] if i % 2 else [f"f {' '.join(corners[:3])}", f"f {' '.join(corners[1:])}"]
            )
    text = "\n".join(lines) + "\n"
    reader = tinyobjloader.ObjReader()
    config = tinyobjloader.ObjReaderConfig()
    config.triangulate = False
    assert reader.ParseFromString(text, "", config)
    attributes, mesh = reader.GetAttrib(), reader.GetShapes()[0].mesh
    theirs = np.stack([mesh.vertex_indices(), mesh.texcoord_indices(), mesh.normal_indices()], axis=1)
    data = obj.parse(text.encode(), tmp_path / "torus.obj")
    np.testing.assert_array_equal(data.corners, theirs)
    np.testing.assert_array_equal(data.sizes, list(mesh.num_face_vertices))
    np.testing.assert_allclose(data.positions, np.array(attributes.vertices).reshape(-1, 3), atol=1e-6)
    (shape,) = read(tmp_path, text).shapes
    corners = triangles(shape).astype(np.float64)
    area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1).sum() / 2
    assert area == pytest.approx(4 * np.pi**2 * 2, rel=0.01)


def test_large_files_are_read_in_batches(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from destello.io import _obj_parse

    rng = np.random.default_rng(8)
    lines = [f"v {x} {y} {z}" for x, y, z in rng.random((300, 3))]
    for i in range(500):
        a, b, c = rng.integers(1, 301, 3)
        lines.append(f"f {a} {b} {c}" + (f" {a}" if i % 7 == 0 else ""))
        if i % 50 == 49:
            lines += ["# a comment", "v 0 0 0"]
    data = ("\n".join(lines) + "\n").encode()
    whole = _obj_parse.parse(data, tmp_path)
    monkeypatch.setattr(_obj_parse, "_BATCH", 64)
    parts = _obj_parse.parse(data, tmp_path)
    for name in ("positions", "corners", "sizes", "materials"):
        np.testing.assert_array_equal(getattr(whole, name), getattr(parts, name))
    broken = data.replace(lines[-1].encode(), b"v 0 0 z")
    with pytest.raises(FormatError) as caught:
        _obj_parse.parse(broken, tmp_path)
    assert caught.value.line == broken.split(b"\n").index(b"v 0 0 z") + 1
