"""Volumes as data: checks, files, and what the core refuses."""

from __future__ import annotations

import numpy as np
import pytest

import destello as dl
from destello.errors import Error, FormatError, SceneError

ONES = np.ones((2, 3, 4), np.float32)


def scene_with(**volume):
    scene = dl.Scene("volume")
    grid = dl.volumes.grid(**{"density": ONES, **volume})
    scene.add(dl.volumes.box(grid, medium_density=(1, 2, 3), medium_anisotropy=0.5, name="smoke"))
    scene.camera = dl.cameras.perspective(origin=(0, 0, 5), target=(0, 0, 0))
    return scene


def test_a_box_holds_its_grid():
    place = dl.translate(1, 2, 3)
    grid = dl.volumes.grid(density=ONES, min=(-1, 0, 0), max=(1, 2, 3), transform=place)
    shape = dl.volumes.box(grid, medium_density=2, name="smoke")
    assert (shape.type, shape.name, shape["min"], shape["max"]) == ("box", "smoke", (-1, 0, 0), (1, 2, 3))
    assert shape["transform"] == place
    assert shape["material"].type == "interface"
    assert shape["material"]["medium_volume"] == grid.replace(transform=None)  # it follows its shape
    assert grid["density"].shape == (2, 3, 4, 1)
    assert not grid["density"].flags.writeable


@pytest.mark.parametrize("dtype", [np.uint8, np.float16, np.float32])
def test_numbers_stay_as_compact_as_they_are(dtype):
    grid = dl.volumes.grid(density=ONES.astype(dtype), albedo=np.ones((2, 3, 4, 3), dtype))
    assert grid["density"].dtype == grid["albedo"].dtype == dtype
    scene = scene_with(density=ONES.astype(dtype), albedo=np.ones((2, 3, 4, 3), dtype))
    stats = scene.compile().stats
    # Arrays start at multiples of 16 bytes; one majorant.
    size = np.dtype(dtype).itemsize
    assert stats["volume_bytes"] == -(-24 * size // 16) * 16 + 72 * size + 4
    assert scene.info()["memory"] >= 96 * size


@pytest.mark.parametrize(
    ("arrays", "said"),
    [
        ({"density": np.ones((2, 2), np.float32)}, "wrong shape"),
        ({"density": np.ones((2, 2, 2, 3), np.float32)}, "wrong shape"),
        ({"density": np.ones((0, 2, 2), np.float32)}, "wrong shape"),
        ({"density": -ONES}, "negative or not finite"),
        ({"density": ONES * np.nan}, "negative or not finite"),
        ({"density": ONES.astype(np.float64) * 1e300}, "negative or not finite"),
        ({"density": ONES.astype(np.int32)}, "wrong kind of voxels"),
        ({"density": "smoke.npy"}, "density"),
        ({"density": None}, "density is missing"),
        ({"albedo": np.ones((2, 3, 5), np.float32)}, "different sizes"),
        ({"emission": ONES, "temperature": ONES}, "one of them"),
        ({"temperature": np.ones((2, 3, 4, 3), np.float32)}, "wrong shape"),
        ({"max": (0, 1, 1)}, "the box is empty"),
        ({"emission_scale": -1}, "out of range"),
        ({"heat": ONES}, "no parameter"),
    ],
)
def test_wrong_grids(arrays, said):
    with pytest.raises(SceneError, match=said):
        scene_with(**arrays)


def test_a_volume_needs_a_medium_and_a_place_in_the_world():
    grid = dl.volumes.grid(density=ONES)
    scene = dl.Scene()
    scene.add(dl.volumes.box(grid))
    with pytest.raises(SceneError, match="medium_density or medium_absorption above 0"):
        scene.compile()
    scene = dl.Scene()
    group = scene.group("clouds", [dl.volumes.box(grid, medium_density=1)])
    scene.add(dl.shapes.instance(group), dl.shapes.instance(group, transform=dl.translate(9, 0, 0)))
    assert scene.compile().stats["volume_bytes"] == 2 * scene_with().compile().stats["volume_bytes"]
    moves = {"transform": dl.Transform(), "transform1": dl.translate(1, 0, 0)}
    scene.add(dl.shapes.instance(group, **moves))
    with pytest.raises(SceneError, match=r"shapes\[2\].*a volume in a group that moves.*clouds.*rest"):
        scene.compile()
    scene = dl.Scene()
    scene.add(dl.volumes.box(grid, medium_density=1).replace(**moves))
    with pytest.raises(SceneError, match=r"shapes\[0\].*a volume in a shape that moves.*rests"):
        scene.compile()
    scene = dl.Scene()
    scene.add(dl.volumes.box(grid, medium_density=1e7))
    with pytest.raises(SceneError, match="at most a million"):
        scene.compile()
    with pytest.raises(SceneError, match="not a grid"):
        dl.volumes.box(dl.materials.diffuse())
    with pytest.raises(SceneError, match="a texture where volume"):
        dl.materials.interface(medium_volume=dl.textures.solid())


def test_a_fire_is_a_light_of_its_own():
    scene = scene_with(temperature=1200 * ONES)
    scene.compile()
    assert scene.environment is None
    assert not any("sky" in note for note in scene.compile().notes)
    assert any("sky" in note for note in scene_with().compile().notes)


def test_files_keep_volumes(tmp_path):
    rng = np.random.default_rng(1)
    scene = scene_with(
        density=rng.random((3, 4, 5)).astype(np.float16),
        albedo=rng.random((3, 4, 5, 3)).astype(np.float32),
        temperature=(1000 * rng.random((3, 4, 5))).astype(np.float32),
        emission_scale=3.0,
        min=(0, 0, -1),
        transform=dl.rotate("y", 30),
    )
    scene.save(tmp_path / "smoke.yaml")
    again = dl.load(tmp_path / "smoke.yaml")
    assert again == scene
    assert again.compile().fingerprint == scene.compile().fingerprint
    again.shapes[0] = dl.volumes.box(dl.volumes.grid(density=ONES), medium_density=1)
    assert again.compile().fingerprint != scene.compile().fingerprint


def test_scene_files_by_hand(tmp_path):
    np.savez(tmp_path / "smoke.npz", density=ONES)
    text = (
        "shapes:\n- type: box\n  min: [0, 0, 0]\n  max: [1, 1, 1]\n  material:\n    type: interface\n"
        "    medium_density: 3\n"
        "    medium_volume: {type: grid, data: smoke.npz}\n"
    )
    (tmp_path / "s.yaml").write_text(text)
    volume = dl.load(tmp_path / "s.yaml").shapes[0]["material"]["medium_volume"]
    assert np.array_equal(volume["density"][..., 0], ONES)
    for change, said in (("../smoke.npz", "leads out of"), ("none.npz", "none.npz")):
        (tmp_path / "sub").mkdir(exist_ok=True)
        (tmp_path / "sub" / "s.yaml").write_text(text.replace("smoke.npz", change))
        with pytest.raises(Error, match=said):
            dl.load(tmp_path / "sub" / "s.yaml")
    np.savez(tmp_path / "smoke.npz", density=ONES, pressure=ONES)
    with pytest.raises(FormatError, match="an unknown array"):
        dl.load(tmp_path / "s.yaml")
    (tmp_path / "s.yaml").write_text(text.replace("type: grid", "type: gird"))
    with pytest.raises(SceneError, match="grid"):
        dl.load(tmp_path / "s.yaml")
