"""glTF animations: keyframes of every kind, chains of nodes, what is not played, what is refused."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.interpolate import CubicHermiteSpline
from scipy.spatial.transform import Rotation, Slerp

import destello as dl
from destello.errors import FormatError, InputError
from destello.nodes import Node
from gltf_scenes import loaded
from scene_files import Gltf

TIMES = np.float32([0, 0.5, 2])
MOVES = np.float32([[0, 0, 0], [1, 2, 3], [-1, 5, 0]])
SIZES = np.float32([[1, 1, 1], [2, 1, 1], [1, 3, 1]])
TURNS = Rotation.from_euler("xyz", [[0, 0, 0], [90, 20, 0], [10, 0, 200]], degrees=True)


def animate(g: Gltf, *channels: tuple[int, str, Any, Any], kind: str | None = None, name: str | None = None) -> None:
    """Adds an animation of channels (node, path, times, values)."""
    samplers: list[dict[str, Any]] = []
    listed = []
    for node, path, times, values in channels:
        listed.append({"sampler": len(samplers), "target": {"node": node, "path": path}})
        made = {"input": g.accessor(np.float32(times)), "output": g.accessor(np.asarray(values, np.float32))}
        samplers.append({**made, **({"interpolation": kind} if kind else {})})
    g.add("animations", channels=listed, samplers=samplers, **({"name": name} if name else {}))


def matrix(shape: Node, time: float) -> np.ndarray:
    return shape["animation"].at(time).matrix


def posed(move: Any = (0, 0, 0), turn: Any = None, size: Any = (1, 1, 1)) -> np.ndarray:
    made = np.eye(4)
    made[:3, :3] = (np.eye(3) if turn is None else turn.as_matrix()) * np.asarray(size)
    made[:3, 3] = move
    return made


def at(values: np.ndarray, time: float) -> np.ndarray:
    return np.array([np.interp(time, TIMES, column) for column in values.T])


# --- channels ---------------------------------------------------------------------------------------------------------


def test_linear_translation_rotation_and_scale(tmp_path: Path) -> None:
    g = Gltf()
    node = g.node(mesh=g.quad(), translation=[9, 9, 9])
    channels = (("translation", MOVES), ("rotation", TURNS.as_quat()), ("scale", SIZES))
    animate(g, *((node, path, TIMES, values) for path, values in channels), kind="LINEAR", name="Walk")
    g.add("animations", channels=[], samplers=[])
    scene = loaded(g, tmp_path)
    (shape,) = scene.shapes
    turn = Slerp(TIMES, TURNS)
    for t in np.linspace(0, 2, 13):
        expected = posed(at(MOVES, t), turn(t), at(SIZES, t))
        np.testing.assert_allclose(matrix(shape, t), expected, atol=1e-6)
    assert scene.notes == ["animation 1 of 2 (Walk): 2 s long"]
    assert scene.info()["animation"] == {"frames": 48, "fps": 24, "animated": 1}
    assert scene.info()["notes"] == scene.notes


def test_step_and_a_channel_alone_leaves_the_rest_of_the_node(tmp_path: Path) -> None:
    g = Gltf()
    turn = TURNS[1]
    node = g.node(mesh=g.quad(), translation=[1, 2, 3], rotation=turn.as_quat().tolist(), scale=[1, 2, 1])
    animate(g, (node, "scale", TIMES, SIZES), kind="STEP")
    (shape,) = loaded(g, tmp_path).shapes
    for t, i in ((0, 0), (0.4, 0), (0.5, 1), (1.9, 1), (2, 2), (3, 2)):
        np.testing.assert_allclose(matrix(shape, t), posed((1, 2, 3), turn, SIZES[i]), atol=1e-12)


def test_cubic_spline_is_the_hermite_formula(tmp_path: Path, rng: np.random.Generator) -> None:
    g = Gltf()
    node = g.node(mesh=g.quad())
    moves, turns = rng.standard_normal((3, 3, 3)), rng.standard_normal((3, 3, 4))
    animate(g, (node, "translation", TIMES, moves.reshape(9, 3)), kind="CUBICSPLINE")
    g.json["animations"][0]["channels"].append({"sampler": 1, "target": {"node": node, "path": "rotation"}})
    extra = {"input": g.accessor(TIMES), "output": g.accessor(np.float32(turns.reshape(9, 4)))}
    g.json["animations"][0]["samplers"].append({**extra, "interpolation": "CUBICSPLINE"})
    (shape,) = loaded(g, tmp_path).shapes
    for i, t in ((0, 0.0), (0, 0.2), (0, 0.4), (1, 0.5), (1, 1.3), (1, 2.0)):
        move, turn = (
            CubicHermiteSpline(TIMES[i : i + 2], v[i : i + 2, 1], [v[i, 2], v[i + 1, 0]])(t) for v in (moves, turns)
        )
        np.testing.assert_allclose(matrix(shape, t), posed(move, Rotation(turn)), atol=1e-6)


def test_normalized_integers_are_rotations(tmp_path: Path) -> None:
    g = Gltf()
    node = g.node(mesh=g.quad())
    animate(g, (node, "rotation", [0], [[0, 0, 0, 1]]))
    half = round(32767 * math.sqrt(0.5))
    g.json["animations"][0]["samplers"][0]["output"] = g.accessor(np.int16([[0, half, 0, half]]), normalized=True)
    (shape,) = loaded(g, tmp_path).shapes
    np.testing.assert_allclose(matrix(shape, 0), dl.rotate("y", 90).matrix, atol=1e-4)


# --- chains -----------------------------------------------------------------------------------------------------------


def test_children_move_with_all_that_is_above_them(tmp_path: Path) -> None:
    """Static above animated above static above animated, with what does not move on both sides."""
    g = Gltf()
    leaf = g.node(root=False, mesh=g.quad(), translation=[0, 0, 1])
    hand = g.node(root=False, children=[leaf])
    fixed = g.node(root=False, children=[hand], scale=[1, 2, 1], translation=[3, 0, 0])
    arm = g.node(root=False, children=[fixed], scale=[2, 2, 2])
    g.node(children=[arm], translation=[0, 7, 0])
    g.node(mesh=g.quad(name="beside"), translation=[1, 1, 1])
    animate(g, (hand, "translation", TIMES, MOVES), (arm, "rotation", TIMES, TURNS.as_quat()))
    shapes = {shape.name: shape for shape in loaded(g, tmp_path).shapes}
    moving, turn = next(s for name, s in shapes.items() if name != "beside"), Slerp(TIMES, TURNS)
    for t in (0, 0.3, 1.1, 2):
        above = posed((0, 7, 0)) @ posed(turn=turn(t), size=(2, 2, 2)) @ posed((3, 0, 0), size=(1, 2, 1))
        np.testing.assert_allclose(matrix(moving, t), above @ posed(at(MOVES, t)) @ posed((0, 0, 1)), atol=1e-5)
    assert shapes["beside"]["animation"] is None
    assert np.array_equal(shapes["beside"]["transform"].matrix[:3, 3], [1, 1, 1])


def test_instances_cameras_and_lights_move(tmp_path: Path) -> None:
    g = Gltf()
    g.extend("KHR_lights_punctual", lights=[{"type": kind} for kind in ("point", "spot", "directional")])
    g.extend("EXT_mesh_gpu_instancing")
    mesh = g.quad()
    offsets = g.accessor(np.float32([[0, 0, 0], [0, 0, 5]]))
    instancing = {"EXT_mesh_gpu_instancing": {"attributes": {"TRANSLATION": offsets}}}
    below = [g.node(root=False, mesh=mesh, extensions=instancing)]
    below += [g.node(root=False, extensions={"KHR_lights_punctual": {"light": i}}) for i in range(3)]
    camera = g.add("cameras", type="perspective", perspective={"yfov": 0.5})
    below.append(g.node(root=False, camera=camera, translation=[0, 0, 2], name="Eye"))
    top = g.node(children=below)
    half = math.sqrt(0.5)
    animate(g, (top, "rotation", [0, 1], [[0, 0, 0, 1], [0, half, 0, half]]))
    scene = loaded(g, tmp_path)
    still = scene.at_frame(24)  # turned by 90 degrees about y
    centers = [shape["transform"].matrix[:3, 3] for shape in still.shapes]
    np.testing.assert_allclose(centers, [[0, 0, 0], [5, 0, 0]], atol=1e-6)
    assert [shape.type for shape in still.shapes] == ["instance"] * 2
    np.testing.assert_allclose(still.cameras["Eye"]["origin"], [2, 0, 0], atol=1e-6)
    np.testing.assert_allclose(still.cameras["Eye"]["target"], [1, 0, 0], atol=1e-6)
    directions = [light["transform"].matrix[:3, :3] @ (0, 0, -1) for light in still.lights]
    np.testing.assert_allclose(directions, [[-1, 0, 0]] * 3, atol=1e-6)
    assert [light["position"] for light in still.lights[:2]] == [(0, 0, 0)] * 2


def test_what_is_hidden_by_a_scale_of_0_may_appear(tmp_path: Path) -> None:
    g = Gltf()
    node = g.node(mesh=g.quad(), scale=[0, 0, 0])
    animate(g, (node, "scale", [0, 0.5], [[0, 0, 0], [1, 1, 1]]), kind="STEP")
    scene = loaded(g, tmp_path)
    assert [len(scene.at_frame(frame).shapes) for frame in (0, 11, 12)] == [0, 0, 1]


def test_it_reads_back_from_the_native_format(tmp_path: Path, rng: np.random.Generator) -> None:
    g = Gltf()
    node = g.node(mesh=g.quad())
    animate(g, (node, "translation", TIMES, rng.standard_normal((9, 3))), kind="CUBICSPLINE")
    scene = loaded(g, tmp_path)
    for name in ("a.yaml", "a.json"):
        scene.save(tmp_path / name)
        assert dl.load(tmp_path / name) == scene


# --- another program's file -------------------------------------------------------------------------------------------


def test_a_file_made_with_pygltflib_renders_where_it_should(tmp_path: Path) -> None:
    """A glowing square that moves by 5 m in a second, seen in frames 0 and 5 of 10."""
    p = pytest.importorskip("pygltflib")
    parts = [
        np.float32([[-0.5, -0.5, 0], [0.5, -0.5, 0], [0.5, 0.5, 0], [-0.5, 0.5, 0]]),
        np.uint16([0, 1, 2, 0, 2, 3]),
        np.float32([0, 1]),
        np.float32([[0, 0, 0], [5, 0, 0]]),
    ]
    kinds = [(p.FLOAT, p.VEC3), (p.UNSIGNED_SHORT, p.SCALAR), (p.FLOAT, p.SCALAR), (p.FLOAT, p.VEC3)]
    starts = np.cumsum([0, *(part.nbytes for part in parts)])
    file = p.GLTF2(
        asset=p.Asset(version="2.0"),
        scene=0,
        scenes=[p.Scene(nodes=[0])],
        nodes=[p.Node(mesh=0)],
        meshes=[p.Mesh(primitives=[p.Primitive(attributes=p.Attributes(POSITION=0), indices=1, material=0)])],
        materials=[p.Material(emissiveFactor=[1, 1, 1])],
        accessors=[
            p.Accessor(bufferView=i, componentType=component, count=len(part), type=kind)
            for i, (part, (component, kind)) in enumerate(zip(parts, kinds, strict=True))
        ],
        bufferViews=[
            p.BufferView(buffer=0, byteOffset=int(start), byteLength=part.nbytes)
            for start, part in zip(starts, parts, strict=False)
        ],
        buffers=[p.Buffer(byteLength=int(starts[-1]))],
        animations=[
            p.Animation(
                name="Slide",
                channels=[p.AnimationChannel(sampler=0, target=p.AnimationChannelTarget(node=0, path="translation"))],
                samplers=[p.AnimationSampler(input=2, output=3, interpolation="LINEAR")],
            )
        ],
    )
    file.set_binary_blob(b"".join(part.tobytes() for part in parts))
    file.save_binary(str(tmp_path / "slide.glb"))
    scene = dl.load(tmp_path / "slide.glb")
    scene.camera = dl.cameras.orthographic(origin=(2.5, 0, 10), target=(2.5, 0, 0), height=2)
    scene.environment = dl.environments.constant(0)
    scene.render.fps, scene.render.shutter, scene.film.filter = 10, (0, 0), dl.filters.box()
    for frame, lit in ((0, [2, 3]), (5, [7, 8])):
        image = dl.render(scene.at_frame(frame), size=(16, 4), spp=16, device="cpu", progress=False)
        columns = np.nonzero(image.array[1, :, 0] > 0.45)[0].tolist()
        assert columns == lit


# --- what is not played -----------------------------------------------------------------------------------------------


def test_what_is_not_played_is_said(tmp_path: Path) -> None:
    g = Gltf()
    node = g.node(mesh=g.quad())
    animate(g, (node, "translation", TIMES, MOVES))
    g.json["animations"][0]["channels"].append({"sampler": 0, "target": {"node": node, "path": "weights"}})
    g.json["animations"][0]["channels"].append({"sampler": 0, "target": {"path": "pointer"}})
    assert loaded(g, tmp_path).notes == ["animation 1 of 1: 2 s long; not animated: morph weights, pointer"]


def test_skinned_meshes_keep_their_pose(tmp_path: Path) -> None:
    g = Gltf()
    joint = g.node(translation=[1, 0, 0])
    attributes = {
        "POSITION": g.accessor(np.float32([[0, 0, 0], [1, 0, 0], [0, 1, 0]])),
        "JOINTS_0": g.accessor(np.zeros((3, 4), np.uint8)),
        "WEIGHTS_0": g.accessor(np.float32([[1, 0, 0, 0]] * 3)),
    }
    g.node(mesh=g.mesh(attributes), skin=g.add("skins", joints=[joint]))
    animate(g, (joint, "translation", TIMES, MOVES))
    scene = loaded(g, tmp_path)
    (shape,) = scene.shapes
    assert "animation" not in shape.params
    assert shape["positions"][0].tolist() == [1, 0, 0]
    assert "skins are not animated: skinned meshes keep the pose in the file" in scene.notes


# --- what is refused --------------------------------------------------------------------------------------------------


def set_in(table: str, key: str, value: Any) -> Any:
    return lambda g: g.json["animations"][0][table][0].__setitem__(key, value)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (
            set_in("channels", "sampler", 3),
            "animations[0].channels[0].sampler: index out of range: 3 (accepted: 0 to 0",
        ),
        (set_in("channels", "target", {"node": 9, "path": "scale"}), "channels[0].target.node: index out of range: 9"),
        (set_in("channels", "target", {"node": 0}), "animations[0].channels[0].target.path: missing"),
        (set_in("samplers", "interpolation", "SPLINE"), "samplers[0].interpolation: wrong value: 'SPLINE'"),
        (set_in("samplers", "interpolation", "CUBICSPLINE"), "output: wrong number of values: 3 (accepted: 9: 3 for"),
        (set_in("samplers", "input", 99), "animations[0].samplers[0].input: index out of range: 99"),
        (
            lambda g: g.json["animations"][0]["channels"].append(g.json["animations"][0]["channels"][0]),
            "animated twice",
        ),
        (lambda g: g.json["nodes"][0].update(matrix=np.eye(4).reshape(-1).tolist()), "a matrix cannot be animated"),
    ],
)
def test_broken_animations_name_their_place(change: Any, message: str, tmp_path: Path) -> None:
    g = Gltf()
    node = g.node(mesh=g.quad())
    animate(g, (node, "translation", TIMES, MOVES))
    change(g)
    with pytest.raises(FormatError) as caught:
        loaded(g, tmp_path)
    assert message in str(caught.value)
    assert caught.value.file is not None


@pytest.mark.parametrize(
    ("path", "times", "values", "message"),
    [
        ("translation", [0, 2, 1], MOVES, "animations[0].samplers[0].times[2]: times run backwards: 1.0"),
        ("translation", [0, 1, math.nan], MOVES, "animations[0].samplers[0].input: keyframe 2 is not finite"),
        ("translation", TIMES, TURNS.as_quat(), "type: wrong value: 'VEC4' (accepted: VEC3)"),
        ("rotation", [0], [[0, 0, 0, 0]], "animations[0].samplers[0].values[0]: a rotation without direction"),
    ],
)
def test_broken_keyframes_name_their_place(path: str, times: Any, values: Any, message: str, tmp_path: Path) -> None:
    g = Gltf()
    animate(g, (g.node(mesh=g.quad()), path, times, values))
    with pytest.raises(InputError) as caught:
        loaded(g, tmp_path)
    assert message in str(caught.value)
    assert caught.value.file is not None


def test_too_deep_chains_are_refused(tmp_path: Path) -> None:
    g = Gltf()
    last = g.node(root=False, mesh=g.quad())
    for _ in range(300):
        last = g.node(root=False, children=[last])
    g.json["scenes"] = [{"nodes": [last]}]
    animate(g, (last, "translation", TIMES, MOVES))
    with pytest.raises(FormatError, match=r"nodes\[0\]: too many animated nodes above it .accepted: at most 256"):
        loaded(g, tmp_path)
