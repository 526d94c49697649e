"""Scenes of single frames: where things are in them, how they blur, what cannot be shown."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import destello as dl
from destello.errors import InputError, SceneError

GLOW = dl.materials.emissive(emission=1)
RIGHT = dl.keyframes("translate", {0: (0, 0, 0), 1: (10, 0, 0)})
SPIN = dl.keyframes("rotate", {0: {"axis": "z", "angle": 0}, 1: {"axis": "z", "angle": 90}})


def empty(**render: Any) -> dl.Scene:
    """Nothing but a camera that sees x from -1 to 11 and y from -4 to 4, 10 frames a second, black."""
    scene = dl.Scene("frames")
    scene.camera = dl.cameras.orthographic(origin=(5, 0, 10), target=(5, 0, 0), height=8)
    scene.environment = dl.environments.constant(0)
    scene.film.width, scene.film.height, scene.film.filter = 24, 16, dl.filters.box()
    scene.render.fps = 10
    for name, value in render.items():
        setattr(scene.render, name, value)
    return scene


def square(**more: Any) -> dl.Node:
    """A glowing square of 1 m around the origin, seen as 2 x 2 pixels."""
    return dl.shapes.quad((-0.5, -0.5, 0), (1, 0, 0), (0, 1, 0), material=GLOW, **more)


def pixels(scene: dl.Scene, **more: Any) -> np.ndarray:
    return dl.render(scene, spp=16, device="cpu", progress=False, **more).array


def lit(scene: dl.Scene) -> tuple[list[int], list[int]]:
    """Columns and rows of the pixels that something glows in."""
    rows, columns = np.nonzero(pixels(scene)[..., 0] > 0.5)
    return sorted(set(columns.tolist())), sorted(set(rows.tolist()))


# --- where things are -------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("frame", "column"), [(0, 1), (5, 11), (10, 21), (400, 21)])
def test_things_are_where_they_should_be(frame: int, column: int) -> None:
    scene = empty(shutter=(0, 0))
    scene.group("square", [square()])
    scene.add(
        square(animation=RIGHT),
        dl.shapes.instance("square", transform=dl.translate(0, 2, 0), animation=RIGHT),
        dl.shapes.sphere((0, -2, 0), 0.6, material=GLOW, animation=RIGHT),
    )
    assert lit(scene.at_frame(frame)) == ([column, column + 1], [3, 4, 7, 8, 11, 12])


def test_an_animation_comes_after_the_transform() -> None:
    scene = empty()
    scene.add(square(transform=dl.translate(2, 0, 0), animation=dl.translate(1, 0, 0) @ SPIN))
    (shape,) = scene.at_frame(10).shapes
    np.testing.assert_allclose(shape["transform"].matrix[:3, 3], [1, 2, 0], atol=1e-12)
    assert shape["transform1"] is None, "it moves no more"


def test_cameras_and_lights_move_from_frame_to_frame() -> None:
    scene = empty()
    scene.camera = scene.camera.replace(animation=SPIN)
    move = dl.keyframes("translate", {0: (0, 0, 0), 1: (0, 0, 4)})
    scene.add(
        dl.lights.point((1, 0, 0), transform=dl.translate(0, 1, 0), animation=move @ SPIN),
        dl.lights.spot((1, 0, 0), target=(2, 0, 0), animation=SPIN),
        dl.lights.directional((1, 0, 0), animation=SPIN),
    )
    still = scene.at_frame(10)
    camera, (point, spot, sun) = still.camera, still.lights
    np.testing.assert_allclose(camera["origin"], [0, 5, 10], atol=1e-12)
    np.testing.assert_allclose(camera["target"], [0, 5, 0], atol=1e-12)
    np.testing.assert_allclose(camera["up"], [-1, 0, 0], atol=1e-12)
    np.testing.assert_allclose((point["transform"].matrix @ (1, 0, 0, 1))[:3], [-1, 1, 4], atol=1e-12)
    assert spot["transform"] == sun["transform"] == dl.rotate("z", 90)
    assert not [node for node in (camera, point, spot, sun) if "animation" in node.params]


def test_shapes_in_groups_move_too() -> None:
    scene = empty(shutter=(0, 0))
    scene.group("pair", [square(animation=RIGHT), square(transform=dl.translate(0, 2, 0))])
    scene.add(dl.shapes.instance("pair"))
    assert lit(scene.at_frame(5)) == ([1, 2, 11, 12], [3, 4, 7, 8])


def test_an_animated_scene_renders_as_its_frame_0() -> None:
    scene = empty()
    scene.add(square(animation=RIGHT))
    assert np.array_equal(pixels(scene), pixels(scene.at_frame(0)))
    assert scene.compile().fingerprint == scene.at_frame(0).compile().fingerprint
    assert scene.compile().fingerprint != scene.at_frame(1).compile().fingerprint


def test_a_frame_is_a_scene_of_its_own(tmp_path: Path) -> None:
    scene = empty()
    scene.add(square(animation=RIGHT), square())
    still = scene.at_frame(3)
    assert still.frames == 0
    assert still.shapes[1] is scene.shapes[1]
    assert "animation" in scene.shapes[0].params, "the animated scene is as it was"
    assert still.at_frame(7) == still
    still.save(tmp_path / "still.yaml")
    assert dl.load(tmp_path / "still.yaml") == still


# --- blur -------------------------------------------------------------------------------------------------------------


def test_blur_is_that_of_the_same_transforms_made_by_hand() -> None:
    moved = RIGHT @ SPIN
    first, last = (dl.translate(v, 0, 0) @ dl.rotate("z", 9 * v) for v in (3.0, 4.0))
    animated, by_hand = empty(shutter=(0.25, 0.75)), empty(shutter=(0.25, 0.75))
    for scene in (animated, by_hand):
        scene.group("square", [square()])
    animated.add(square(animation=moved), dl.shapes.instance("square", animation=moved))
    by_hand.add(
        square(transform=first, transform1=last),
        dl.shapes.instance("square", transform=first, transform1=last),
    )
    animated.add(dl.shapes.sphere((0, 2, 0), 0.5, material=GLOW, animation=RIGHT))
    by_hand.add(dl.shapes.sphere((3, 2, 0), 0.5, center1=(4, 2, 0), material=GLOW))
    assert np.array_equal(pixels(animated.at_frame(3)), pixels(by_hand))
    assert not np.array_equal(pixels(animated.at_frame(3)), pixels(animated.at_frame(4)))


def test_the_shutter_is_a_part_of_the_frame() -> None:
    """At 10 frames a second a square of 2 px moves 2 px a frame: with half a frame's shutter, one."""
    scene = empty(shutter=(0, 0.5))
    scene.add(square(animation=RIGHT))
    row = dl.render(scene.at_frame(5), spp=256, device="cpu", progress=False).array[7, 10:16, 0]
    np.testing.assert_allclose(row, [0, 0.5, 1, 0.5, 0, 0], atol=0.1)


def test_what_steps_or_rests_does_not_blur() -> None:
    scene = empty()
    keys = {0: (0, 0, 0), 0.45: (4, 0, 0), 0.5: (8, 0, 0)}
    scene.add(square(animation=dl.keyframes("translate", keys, "step")))
    for frame, x in ((0, 0), (4, 0), (5, 8), (9, 8)):
        assert scene.at_frame(frame).shapes == [square(transform=dl.translate(x, 0, 0))]


def test_what_is_scaled_to_nothing_is_not_there() -> None:
    scene = empty()
    grow = dl.keyframes("scale", {0: 0, 0.5: 0, 0.6: 1})
    blink = dl.keyframes("scale", {0: 1, 0.5: 0}, "step")
    scene.add(square(animation=grow), square(animation=blink), dl.lights.point((0, 0, 0), animation=blink))
    scene.group("grows", [square(animation=grow)])
    scene.add(dl.shapes.instance("grows"))
    counts = [(len(s.shapes), len(s.lights), len(s.groups["grows"].shapes)) for s in map(scene.at_frame, (4, 5, 6))]
    assert counts == [(2, 1, 0), (1, 0, 0), (2, 0, 1)]
    assert all(scene.at_frame(frame).notes == [] for frame in (4, 5, 6))
    assert pixels(scene.at_frame(5)).max() == 0, "a group may be empty"


def test_what_would_turn_flat_on_its_way_stands_still_and_it_is_said() -> None:
    scene = empty()
    half = dl.keyframes("rotate", {0: {"axis": "z", "angle": 0}, 0.1: {"axis": "z", "angle": 180}})
    scene.add(square(animation=half, name="wheel"), square(animation=dl.keyframes("scale", {0: 1, 0.1: 0})))
    still = scene.at_frame(0)
    assert [shape["transform1"] for shape in still.shapes] == [None, None]
    assert still.notes == [
        "shapes[0] (wheel) is not blurred in frame 0: on the way it would be flat",
        "shapes[1] is not blurred in frame 0: on the way it would be flat",
    ]
    scene = empty()
    scene.add(square(animation=dl.keyframes("scale", {0: (1, 1, 0), 1: (2, 1, 0)})))
    assert scene.at_frame(2).notes == ["shapes[0] is not shown in frame 2: its transform is flat"]


# --- how long, and what is around -------------------------------------------------------------------------------------


@pytest.mark.parametrize(("last", "fps", "frames"), [(0, 24, 1), (1, 24, 24), (2, 12.5, 25), (1.01, 24, 25)])
def test_frames_reach_to_the_last_keyframe(last: float, fps: float, frames: int) -> None:
    scene = empty(fps=fps)
    assert scene.frames == 0
    scene.add(square(animation=dl.keyframes("scale", {0: 1, last: 2})), square())
    assert scene.frames == frames
    assert scene.info()["animation"] == {"frames": frames, "fps": fps, "animated": 1}
    assert empty().info()["animation"] is None
    assert empty().render.fps == 10
    assert dl.Scene().render.fps == 24


def test_bounds_are_over_the_animation_and_the_added_camera_is_the_same_in_all_frames() -> None:
    scene = empty()
    scene.cameras.clear()
    scene.add(square(animation=RIGHT))
    low, high = scene.bounds()
    np.testing.assert_allclose([low, high], [[-0.5, -0.5, 0], [10.5, 0.5, 0]], atol=1e-6)
    first, last = scene.at_frame(0), scene.at_frame(9)
    assert first.cameras == last.cameras
    assert scene.cameras == {}
    assert first.notes == ["no camera in the scene: added one that frames the scene"]


@pytest.mark.parametrize("frame", [-1, 1.5, "0", None, True, 2**31])
def test_no_such_frame(frame: Any) -> None:
    with pytest.raises(InputError, match=r"frame: no such frame.*accepted: a whole number from 0"):
        empty().at_frame(frame)


def test_numpy_counts_frames_too() -> None:
    assert empty().at_frame(np.int64(3)) == empty()


def test_refusals_name_the_place() -> None:
    scene = empty()
    scene.camera = scene.camera.replace(animation=dl.keyframes("scale", {0: 1, 1: 0}))
    with pytest.raises(SceneError, match=r"^cameras.default.animation at frame 10: the transform cannot be inverted"):
        scene.at_frame(10)
    scene = empty()
    scene.add(square(animation=dl.keyframes("scale", {0: 1, 1: 1e38}) @ dl.scale(1e38), name="big"))
    with pytest.raises(SceneError, match=r"^shapes\[0\] \(big\).animation at frame 10: the transform leaves the range"):
        scene.at_frame(10)


@pytest.mark.parametrize(
    ("params", "message"),
    [
        ({"transform": dl.scale(2), "transform1": dl.scale(3)}, "quad.animation: animation and transform1"),
        ({"animation": {"translate": {"times": [0], "values": [[1, 2]]}}}, "quad.animation.translate.values"),
    ],
)
def test_nodes_refuse_what_cannot_be(params: dict[str, Any], message: str) -> None:
    with pytest.raises(SceneError) as caught:
        square(**{"animation": RIGHT, **params})
    assert message in str(caught.value)


def test_spheres_can_only_be_shifted() -> None:
    with pytest.raises(SceneError, match=r"sphere.animation: a sphere can only be shifted: \['rotate'\]"):
        dl.shapes.sphere((0, 0, 0), 1, animation=SPIN)
    with pytest.raises(SceneError, match="animation and center1"):
        dl.shapes.sphere((0, 0, 0), 1, center1=(1, 0, 0), animation=RIGHT)


def test_mesh_files_stand_still(tmp_path: Path) -> None:
    from scene_files import Gltf

    g = Gltf()
    g.node(mesh=g.quad())
    times, moves = g.accessor(np.float32([0, 1])), g.accessor(np.float32([[3, 0, 0], [4, 0, 0]]))
    channel = {"sampler": 0, "target": {"node": 0, "path": "translation"}}
    g.add("animations", channels=[channel], samplers=[{"input": times, "output": moves}])
    g.glb(tmp_path, "moving.glb")
    scene = empty()
    scene.base_dir = tmp_path
    scene.add(dl.shapes.mesh_file("moving.glb", animation=RIGHT))
    low, high = scene.at_frame(2).bounds()
    np.testing.assert_allclose([low[0], high[0]], [4, 7], atol=1e-5)
    assert "moving.glb: as a mesh_file it is not animated, it is as at its time 0" in scene.info()["notes"]
