"""glTF: the hierarchy, poses, cameras, lights."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from destello.io import gltf
from destello.nodes import Node
from gltf_scenes import BARE, TRIANGLE, loaded, only_mesh
from scene_files import QUAD, QUAD_INDICES, Gltf, sphere


def matrix(shape: Node) -> np.ndarray:
    return np.eye(4) if shape["transform"] is None else shape["transform"].matrix


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
    assert loaded(g, tmp_path).notes == ["animation 1 of 1: nothing in it can be played"]


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
    g.extend("KHR_gaussian_splatting")
    g.node(mesh=g.quad())
    notes = [note for note in loaded(g, tmp_path).notes if "VENDOR_glitter" in note]
    assert notes == ["ignored extensions: KHR_gaussian_splatting, VENDOR_glitter"]


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
