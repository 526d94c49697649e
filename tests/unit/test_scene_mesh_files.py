"""Shapes that stand for the meshes of a file: placed, motioned, materials kept or replaced, files read once."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import destello as dl
from destello.errors import FormatError, InputError, MissingFileError

TRIANGLE = "v 0 0 0\nv 1 0 0\nv 0 2 0\nvt 0 0\nvt 1 0\nvt 0 1\nf 1/1 2/2 3/3\n"


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A scene's directory with models/: a triangle with a material whose texture is missing, and one that glows."""
    models = tmp_path / "models"
    models.mkdir()
    (models / "plain.obj").write_text(TRIANGLE)
    (models / "textured.obj").write_text("mtllib t.mtl\nusemtl skin\n" + TRIANGLE)
    (models / "t.mtl").write_text("newmtl skin\nKd 1 1 1\nmap_Kd skin.png\n")
    (models / "lamp.obj").write_text("mtllib lamp.mtl\nusemtl lamp\n" + TRIANGLE)
    (models / "lamp.mtl").write_text("newmtl lamp\nKd 0 0 0\nKe 5 5 5\n")
    return tmp_path


def scene_of(folder: Path, *shapes: dl.Node) -> dl.Scene:
    scene = dl.Scene()
    scene.base_dir = folder
    scene.add(*shapes)
    scene.environment = dl.environments.constant()
    return scene


def bounds(scene: dl.Scene) -> list[list[float]]:
    found = scene.compile().stats["bounds"]
    mine = scene.bounds()
    assert mine is not None
    assert np.allclose(found, mine, rtol=1e-5, atol=1e-6)
    return [[round(float(v), 5) for v in corner] for corner in mine]


def test_placement(folder: Path) -> None:
    shape = dl.shapes.mesh_file("models/plain.obj", material=dl.materials.diffuse(), transform=dl.translate(5, 0, 0))
    assert bounds(scene_of(folder, shape)) == [[5, 0, 0], [6, 2, 0]]
    moving = shape.replace(transform1=dl.translate(5, 0, 3))
    assert bounds(scene_of(folder, moving)) == [[5, 0, 0], [6, 2, 3]]


def test_in_a_group(folder: Path) -> None:
    scene = scene_of(folder)
    group = scene.group("g", [dl.shapes.mesh_file("models/plain.obj", transform=dl.scale(2))])
    scene.add(
        dl.shapes.instance(group, transform=dl.translate(0, 0, 1)),
        dl.shapes.instance(group, transform=dl.translate(0, 0, 9)),
    )
    assert bounds(scene) == [[0, 0, 1], [2, 4, 9]]
    assert scene.compile().stats["instances"] >= 2


def test_groups_within_the_file_are_spread_out(folder: Path) -> None:
    """A glTF file with two placed copies of one mesh, and a mesh_file that places both."""
    import base64
    import json

    positions = np.array([[0, 0, 0], [1, 0, 0], [0, 2, 0]], np.float32)
    data = base64.b64encode(positions.tobytes()).decode()
    document = {
        "asset": {"version": "2.0"},
        "scene": 0,
        "scenes": [{"nodes": [0, 1]}],
        "nodes": [{"mesh": 0, "translation": [0, 0, 1]}, {"mesh": 0, "translation": [0, 0, 2], "scale": [2, 2, 2]}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}}]}],
        "accessors": [
            {"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3", "min": [0, 0, 0], "max": [1, 2, 0]}
        ],
        "bufferViews": [{"buffer": 0, "byteLength": 36}],
        "buffers": [{"byteLength": 36, "uri": f"data:application/octet-stream;base64,{data}"}],
    }
    (folder / "two.gltf").write_text(json.dumps(document))
    scene = scene_of(folder, dl.shapes.mesh_file("two.gltf", transform=dl.translate(10, 0, 0)))
    assert bounds(scene) == [[10, 0, 1], [12, 4, 2]]
    assert scene.info()["triangles"] >= 1
    scene.shapes[0] = scene.shapes[0].replace(transform1=dl.translate(10, 0, 5))
    assert bounds(scene) == [[10, 0, 1], [12, 4, 7]]


def test_each_file_is_read_once(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from destello import assets

    read: list[Path] = []
    original = assets.load_file

    def spy(path: Path, options: Any) -> dl.Scene:
        read.append(path)
        return original(path, options)

    monkeypatch.setattr(assets, "load_file", spy)
    shapes = [dl.shapes.mesh_file("models/plain.obj", transform=dl.translate(i, 0, 0)) for i in range(3)]
    compiled = scene_of(folder, *shapes, dl.shapes.mesh_file("./models/plain.obj")).compile()
    assert len(read) == 1
    assert compiled.stats["triangles"] == 4
    assert [note for note in compiled.notes if "camera" in note] == [
        "no camera in the scene: added one that frames the scene"
    ]


def test_missing_textures_of_the_file_are_told_with_all_others(folder: Path) -> None:
    picture = dl.materials.diffuse(dl.textures.image("own.png"))
    scene = scene_of(
        folder,
        dl.shapes.sphere((0, 0, 0), 1, material=picture),
        dl.shapes.mesh_file("models/textured.obj"),
        dl.shapes.mesh_file("models/gone.ply"),
    )
    with pytest.raises(MissingFileError) as caught:
        scene.compile()
    assert len(caught.value.paths) == 3
    assert all(any(name in path for path in caught.value.paths) for name in ("own.png", "skin.png", "gone.ply"))
    notes = scene.compile(allow_missing=True).notes
    assert any("own.png" in note for note in notes)
    assert any("skin.png" in note for note in notes)
    assert "missing mesh file models/gone.ply: left out" in notes


def test_textures_of_the_file_are_found_beside_it(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (folder / "models" / "skin.png").write_bytes(b"")
    monkeypatch.setattr("destello.images.read_texels", lambda path: np.zeros((2, 2, 3), np.uint8))
    scene = scene_of(folder, dl.shapes.mesh_file("models/textured.obj"))
    scene.allow_external = False
    scene.compile()
    (folder / "models" / "t.mtl").write_text("newmtl skin\nmap_Kd ../../skin.png\n")
    with pytest.raises(InputError, match="--allow-external"):
        scene.compile()


def test_a_glowing_file_needs_no_sky(folder: Path) -> None:
    scene = scene_of(folder, dl.shapes.mesh_file("models/lamp.obj"))
    scene.environment = None
    assert not any("light" in note for note in scene.compile().notes)
    scene.shapes[0] = scene.shapes[0].replace(material=dl.materials.diffuse())
    assert any("no light" in note for note in scene.compile().notes)


def test_damaged_files(folder: Path) -> None:
    (folder / "bad.stl").write_bytes(b"solid")
    with pytest.raises(InputError) as caught:
        scene_of(folder, dl.shapes.mesh_file("bad.stl")).compile()
    assert caught.value.file == str((folder / "bad.stl").resolve())
    (folder / "bad.xyz").write_text("")
    with pytest.raises(FormatError, match="not a mesh file") as caught:
        scene_of(folder, dl.shapes.mesh_file("bad.xyz")).compile()
    assert caught.value.place == "shapes[0].path"
