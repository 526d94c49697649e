"""glTF: nodes, meshes, accessors, cameras, lights."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from destello.formats import LoadOptions
from destello.io import gltf, load
from destello.nodes import Node
from destello.scene import Scene
from scene_files import QUAD, QUAD_INDICES, QUAD_UV, Gltf, sphere

BARE = LoadOptions(complete=False)
TRIANGLE = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]], np.float32)
TRIANGLES = np.array([[0, 1, 2], [0, 2, 3]], np.uint32)


def loaded(g: Gltf, folder: Path) -> Scene:
    return gltf.load(g.glb(folder), BARE)


def only_mesh(g: Gltf, mesh: int, folder: Path) -> Node:
    g.node(mesh=mesh)
    (shape,) = loaded(g, folder).shapes
    return shape


def matrix(shape: Node) -> np.ndarray:
    return np.eye(4) if shape["transform"] is None else shape["transform"].matrix


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


# --- hierarchy --------------------------------------------------------------------------------------------------------


def test_transforms_multiply_down_the_tree(tmp_path: Path) -> None:
    g = Gltf()
    half = math.sqrt(0.5)
    leaf = g.node(root=False, mesh=g.quad(), translation=[1, 0, 0])
    middle = g.node(root=False, children=[leaf], rotation=[0, 0, half, half], scale=[2, 3, 4])
    rows = np.array([[1, 0, 0, 10], [0, 1, 0, 20], [0, 0, 1, 30], [0, 0, 0, 1]])
    g.node(children=[middle], matrix=rows.T.reshape(-1).tolist())
    (shape,) = loaded(g, tmp_path).shapes
    expected = [[0, -3, 0, 10], [2, 0, 0, 22], [0, 0, 4, 30], [0, 0, 0, 1]]
    np.testing.assert_allclose(matrix(shape), expected, atol=1e-12)


def test_identity_is_no_transform(tmp_path: Path) -> None:
    g = Gltf()
    assert only_mesh(g, g.quad(), tmp_path)["transform"] is None


def test_shared_mesh_becomes_instances_and_single_ones_are_placed(tmp_path: Path) -> None:
    g = Gltf()
    shared, single = g.quad(name="shared"), g.quad(name="single")
    for x in range(3):
        g.node(mesh=shared, translation=[x, 0, 0], name=f"copy {x}")
    g.node(mesh=single, translation=[0, 5, 0])
    scene = loaded(g, tmp_path)
    assert [s.type for s in scene.shapes] == ["instance", "instance", "instance", "mesh"]
    assert [s.name for s in scene.shapes] == ["copy 0", "copy 1", "copy 2", "single"]
    assert [matrix(s)[0, 3] for s in scene.shapes[:3]] == [0, 1, 2]
    assert list(scene.groups) == ["shared"]
    assert scene.groups["shared"].shapes[0]["transform"] is None
    assert matrix(scene.shapes[3])[1, 3] == 5
    scene.validate()


def test_mesh_of_several_primitives(tmp_path: Path) -> None:
    g = Gltf()
    primitive = {"attributes": {"POSITION": g.accessor(QUAD)}, "indices": g.accessor(QUAD_INDICES)}
    mesh = g.add("meshes", primitives=[primitive, {**primitive, "mode": 1}, primitive], name="both")
    g.node(mesh=mesh, translation=[1, 0, 0])
    scene = loaded(g, tmp_path)
    assert [s.name for s in scene.shapes] == ["both 0", "both 2"]
    assert all(matrix(s)[0, 3] == 1 for s in scene.shapes)


def test_only_the_default_scene_is_shown(tmp_path: Path) -> None:
    g = Gltf()
    hidden = g.node(root=False, mesh=g.quad(name="hidden"))
    shown = g.node(root=False, mesh=g.quad(name="shown"))
    g.json["scenes"] = [{"nodes": [hidden]}, {"nodes": [shown]}]
    g.json["scene"] = 1
    scene = loaded(g, tmp_path)
    assert [s.name for s in scene.shapes] == ["shown"]
    assert any("2 scenes" in note for note in scene.notes)


def test_file_without_scenes_shows_all_nodes(tmp_path: Path) -> None:
    g = Gltf()
    child = g.node(root=False, mesh=g.quad(name="child"))
    g.node(root=False, children=[child], translation=[0, 0, 1])
    (shape,) = loaded(g, tmp_path).shapes
    assert matrix(shape)[2, 3] == 1


def test_nothing_of_scale_zero_and_flat_ones_are_baked(tmp_path: Path) -> None:
    g = Gltf()
    mesh = g.quad(name="quad")
    g.node(mesh=mesh, scale=[0, 0, 0])
    g.node(mesh=mesh, scale=[2, 3, 0], translation=[0, 0, 7], name="flat")
    g.node(mesh=mesh, translation=[0, 0, 1], name="whole")
    scene = loaded(g, tmp_path)
    assert [(s.type, s.name) for s in scene.shapes] == [("mesh", "flat: quad"), ("instance", "whole")]
    np.testing.assert_array_equal(scene.shapes[0]["positions"], QUAD * np.float32((2, 3, 0)) + np.float32((0, 0, 7)))
    assert scene.shapes[0]["transform"] is None


def test_invisible_nodes(tmp_path: Path) -> None:
    g = Gltf()
    g.extend("KHR_node_visibility")
    child = g.node(root=False, mesh=g.quad(name="child"))
    g.node(children=[child], extensions={"KHR_node_visibility": {"visible": False}})
    g.node(mesh=g.quad(name="seen"), extensions={"KHR_node_visibility": {"visible": True}})
    assert [s.name for s in loaded(g, tmp_path).shapes] == ["seen"]


def test_deep_hierarchy(tmp_path: Path) -> None:
    g = Gltf()
    last = g.node(root=False, mesh=g.quad(), translation=[1, 0, 0])
    for _ in range(5000):
        last = g.node(root=False, children=[last], translation=[1, 0, 0])
    g.json["scenes"] = [{"nodes": [last]}]
    (shape,) = loaded(g, tmp_path).shapes
    assert matrix(shape)[0, 3] == 5001


def test_gpu_instancing(tmp_path: Path) -> None:
    g = Gltf()
    g.extend("EXT_mesh_gpu_instancing", required=True)
    attributes = {
        "TRANSLATION": g.accessor(np.array([[1, 0, 0], [0, 2, 0]], np.float32)),
        "SCALE": g.accessor(np.array([[1, 1, 1], [3, 3, 3]], np.float32)),
    }
    g.node(mesh=g.quad(), translation=[0, 0, 9], extensions={"EXT_mesh_gpu_instancing": {"attributes": attributes}})
    shapes = loaded(g, tmp_path).shapes
    assert [s.type for s in shapes] == ["instance", "instance"]
    np.testing.assert_array_equal(matrix(shapes[0])[:3, 3], [1, 0, 9])
    np.testing.assert_array_equal(matrix(shapes[1]), [[3, 0, 0, 0], [0, 3, 0, 2], [0, 0, 3, 9], [0, 0, 0, 1]])


# --- poses ------------------------------------------------------------------------------------------------------------


def test_morph_weights_of_mesh_and_node(tmp_path: Path) -> None:
    g = Gltf()
    step = g.accessor(np.tile(np.float32((0, 0, 4)), (3, 1)))
    primitive = {"attributes": {"POSITION": g.accessor(TRIANGLE)}, "targets": [{"POSITION": step}]}
    mesh = g.add("meshes", primitives=[primitive], weights=[0.5])
    g.node(mesh=mesh)
    g.node(mesh=mesh, weights=[0.25])
    scene = loaded(g, tmp_path)
    own, bent = scene.groups["mesh 0"].shapes[0], scene.shapes[1]
    np.testing.assert_array_equal(own["positions"], TRIANGLE + np.float32((0, 0, 2)))
    np.testing.assert_array_equal(bent["positions"], TRIANGLE + np.float32((0, 0, 1)))


def test_skin_moves_vertices_with_their_joints(tmp_path: Path) -> None:
    g = Gltf()
    joints = np.array([[0, 0, 0, 0], [1, 0, 0, 0], [0, 1, 0, 0]], np.uint8)
    weights = np.array([[1, 0, 0, 0], [1, 0, 0, 0], [0.5, 0.5, 0, 0]], np.float32)
    attributes = {"POSITION": g.accessor(TRIANGLE), "JOINTS_0": g.accessor(joints), "WEIGHTS_0": g.accessor(weights)}
    inverse = np.tile(np.eye(4, dtype=np.float32), (2, 1, 1))
    inverse[1, 3, 2] = -1  # column-major: translation by -1 along z
    a = g.node(translation=[10, 0, 0])
    b = g.node(translation=[0, 0, 5])
    skin = g.add("skins", joints=[a, b], inverseBindMatrices=g.accessor(inverse.reshape(2, 16)))
    g.node(
        mesh=g.mesh(attributes), skin=skin, translation=[100, 100, 100]
    )  # a skinned node's own place does not matter
    (shape,) = loaded(g, tmp_path).shapes
    np.testing.assert_allclose(shape["positions"], [[10, 0, 0], [1, 0, 4], [5, 1, 2]], atol=1e-6)
    assert shape["transform"] is None


def test_animations_are_noted(tmp_path: Path) -> None:
    g = Gltf()
    g.node(mesh=g.quad())
    g.add("animations", channels=[], samplers=[])
    assert any("animations" in note for note in loaded(g, tmp_path).notes)


# --- cameras and lights -----------------------------------------------------------------------------------------------


def test_perspective_camera(tmp_path: Path) -> None:
    g = Gltf()
    camera = g.add("cameras", type="perspective", perspective={"yfov": 0.5, "aspectRatio": 2.0, "znear": 0.1})
    half = math.sqrt(0.5)
    g.node(camera=camera, name="Eye", translation=[1, 2, 3], rotation=[0, half, 0, half], scale=[5, 5, 5])
    scene = loaded(g, tmp_path)
    eye = scene.cameras["Eye"]
    assert eye.type == "perspective"
    np.testing.assert_allclose(eye["origin"], [1, 2, 3])
    np.testing.assert_allclose(eye["target"], [0, 2, 3], atol=1e-12)  # turned by 90 degrees about y: looks along -x
    np.testing.assert_allclose(eye["up"], [0, 1, 0], atol=1e-12)
    assert eye["vfov"] == pytest.approx(math.degrees(0.5))
    assert (scene.film.width, scene.film.height) == (1280, 640)


def test_orthographic_camera_and_unique_names(tmp_path: Path) -> None:
    g = Gltf()
    camera = g.add("cameras", type="orthographic", orthographic={"xmag": 1, "ymag": 4, "znear": 0.1, "zfar": 9})
    g.node(camera=camera, name="cam")
    g.node(camera=camera, name="cam")
    g.node(camera=camera)
    scene = loaded(g, tmp_path)
    assert list(scene.cameras) == ["cam", "cam 2", "camera 0"]
    assert scene.cameras["cam"].type == "orthographic"
    assert scene.cameras["cam"]["height"] == 8
    assert (scene.film.width, scene.film.height) == (320, 1280)


def test_punctual_lights(tmp_path: Path) -> None:
    g = Gltf()
    g.extend(
        "KHR_lights_punctual",
        lights=[
            {"type": "point", "color": [1, 0.5, 0], "intensity": 8, "range": 3},
            {"type": "directional", "intensity": 3},
            {"type": "spot", "intensity": 2, "spot": {"innerConeAngle": 0.25, "outerConeAngle": 0.5}},
        ],
    )
    for i in range(3):
        g.node(translation=[i, 1, 0], name=f"light {i}", extensions={"KHR_lights_punctual": {"light": i}})
    scene = loaded(g, tmp_path)
    point, sun, spot = scene.lights
    assert [light.name for light in scene.lights] == ["light 0", "light 1", "light 2"]
    assert (point["position"], point["intensity"]) == ((0, 1, 0), (8, 4, 0))
    assert (sun["direction"], sun["irradiance"]) == ((0, 0, -1), (3, 3, 3))
    assert (spot["position"], spot["target"]) == ((2, 1, 0), (2, 1, -1))
    assert spot["cone_angle"] == pytest.approx(math.degrees(0.5))
    assert spot["edge"] == pytest.approx(0.5)
    assert sum("1 cd" in note for note in scene.notes) == 1


def test_unknown_optional_extension_is_noted_once(tmp_path: Path) -> None:
    g = Gltf()
    g.extend("VENDOR_glitter")
    g.extend("KHR_materials_sheen")
    g.node(mesh=g.quad())
    notes = [note for note in loaded(g, tmp_path).notes if "VENDOR_glitter" in note]
    assert notes == ["ignored extensions: KHR_materials_sheen, VENDOR_glitter"]


def test_agrees_with_trimesh(tmp_path: Path) -> None:
    """An independent exporter, and an independent reader of what it wrote."""
    import trimesh

    positions, _, indices = sphere(8, 12)
    ball = trimesh.Trimesh(positions, indices.reshape(-1, 3), process=False)
    tree = trimesh.Scene()
    moves = [
        trimesh.transformations.compose_matrix(scale=(1, 2, 3), angles=(0.1, 0.2, 0.3), translate=(i, 0, 0))
        for i in range(2)
    ]
    tree.add_geometry(ball, geom_name="ball", transform=moves[0])
    tree.add_geometry(trimesh.creation.box((1, 2, 3)), geom_name="box", transform=moves[1])
    path = tmp_path / "tree.glb"
    tree.export(path)
    theirs = dict(trimesh.load(path).geometry)
    shapes = {shape.name.split(": ")[-1]: shape for shape in gltf.load(path, BARE).shapes if shape.name}
    assert set(shapes) == set(theirs) == {"ball", "box"}
    for name, move in zip(("ball", "box"), moves, strict=True):
        np.testing.assert_array_equal(shapes[name]["positions"], theirs[name].vertices.astype(np.float32))
        np.testing.assert_array_equal(shapes[name]["indices"], theirs[name].faces)
        np.testing.assert_allclose(matrix(shapes[name]), move, atol=1e-9)
