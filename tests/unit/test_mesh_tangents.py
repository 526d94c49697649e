"""Which meshes get tangents when a scene is compiled, wherever they come from."""

from __future__ import annotations

import gc
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import destello as dl
import mikktspace_mesh
from core_meshes import core_arrays, core_meshes
from destello import tangents
from destello.live import LiveScene

BUMPS = np.random.default_rng(3).random((8, 8, 3), np.float32) * 0.3 + (0.35, 0.35, 0.7)
MAPPED = dl.materials.diffuse(normal_map=dl.textures.image(BUMPS.astype(np.float32), color_space="linear"))
BRUSHED = dl.materials.conductor(roughness=0.4, anisotropy=0.6)
PLAIN = dl.materials.diffuse()


def sheet(*without: str, **params: Any) -> dl.Node:
    arrays = {name: np.asarray(a) for name, a in mikktspace_mesh.sheet().items()}
    floats = {name: a.astype(np.float32) for name, a in arrays.items() if name not in ("indices", *without)}
    return dl.shapes.mesh(indices=arrays["indices"], **{**floats, "material": MAPPED, **params})


def scene_of(*shapes: dl.Node) -> dl.Scene:
    s = dl.Scene("sheets")
    s.add(*shapes)
    return s


@pytest.mark.parametrize("material", [MAPPED, BRUSHED], ids=["normal map", "anisotropy"])
def test_a_mesh_made_in_python_gets_them(material: dl.Node) -> None:
    found = core_arrays(sheet(material=material))
    want = tangents.with_tangents(mikktspace_mesh.sheet())
    assert np.array_equal(found["tangents"], want["tangents"])
    assert np.array_equal(found["indices"], want["indices"])
    assert np.array_equal(found["uvs"], want["uvs"].astype(np.float32))


def test_only_where_they_are_of_use() -> None:
    own = np.tile(np.float32((1, 0, 0, 1)), (len(mikktspace_mesh.sheet()["positions"]), 1))
    assert np.array_equal(core_arrays(sheet(tangents=own))["tangents"], own)
    ends = mikktspace_mesh.sheet()["positions"].astype(np.float32) + np.float32(0.1)
    for shape in (
        sheet("normals"), sheet("uvs"), sheet(material=PLAIN), sheet(material=None),
        sheet(transform=dl.Transform(), transform1=dl.translate(1, 0, 0)), sheet(positions1=ends),
    ):  # fmt: skip
        assert core_arrays(shape)["tangents"] is None
    for shape in (dl.shapes.quad((0, 0, 0), (1, 0, 0), (0, 1, 0)), dl.shapes.box((0, 0, 0), (1, 1, 1))):
        assert core_arrays(shape.replace(material=MAPPED))["tangents"] is None  # flat: their triangles' own


def test_one_mesh_of_two_materials() -> None:
    first = sheet()
    scene = scene_of(first, first.replace(material=PLAIN), first.replace(material=BRUSHED))
    meshes = core_meshes(scene)
    assert [mesh["tangents"] is not None for mesh in meshes] == [True, False]
    group = scene.group("pair", [first.replace(material=PLAIN)])
    scene.add(dl.shapes.instance(group))
    assert len(core_meshes(scene)) == 2


def test_the_material_of_a_mesh_file_counts(tmp_path: Path) -> None:
    rows = ["0 0 0 0 0 1 0 0", "1 0 0 0 0 1 1 0", "0 1 0 0 0 1 0 1"]
    header = "ply\nformat ascii 1.0\nelement vertex 3\n"
    header += "".join(f"property float {name}\n" for name in ("x", "y", "z", "nx", "ny", "nz", "u", "v"))
    header += "element face 1\nproperty list uchar int vertex_indices\nend_header\n"
    (tmp_path / "m.ply").write_text(header + "\n".join([*rows, "3 0 1 2", ""]))
    for material in (None, PLAIN, MAPPED):
        scene = scene_of(dl.shapes.mesh_file(path="m.ply", material=material))
        scene.base_dir = tmp_path
        (mesh,) = core_meshes(scene)
        assert (mesh["tangents"] is not None) == (material is MAPPED)
        if material is MAPPED:
            np.testing.assert_allclose(mesh["tangents"], np.tile((1, 0, 0, 1), (3, 1)), atol=1e-6)


def test_made_and_given_ones_are_one_picture(device: str) -> None:
    made = sheet()
    core = core_arrays(made)
    given = made.replace(**{name: core[name] for name in ("positions", "normals", "uvs", "tangents", "indices")})
    pictures = []
    for shape in (made, given):
        scene = scene_of(shape)
        scene.add(dl.lights.point(position=(2, 3, 4), intensity=20))
        pictures.append(dl.render(scene, spp=2, size=(32, 24), device=device, progress=False).array)
    assert np.array_equal(*pictures)


def test_they_are_made_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """For all frames of an animation, and as long as the mesh lives."""
    calls: list[int] = []
    made = tangents.with_tangents

    def counting(arrays: Any, name: str) -> Any:
        calls.append(len(arrays["positions"]))
        return made(arrays, name)

    monkeypatch.setattr(tangents, "with_tangents", counting)
    kept = len(tangents._made)
    keys = {"translate": {"times": [0, 1], "values": [[0, 0, 0], [0, 0, 0]]}}
    scene = scene_of(sheet(animation=keys))
    for frame in (0, 5, 9):
        assert core_meshes(scene.at_frame(frame))[0]["tangents"] is not None
    scene.compile()
    assert len(calls) == 1
    assert len(tangents._made) == kept + 1
    del scene
    gc.collect()
    assert len(tangents._made) == kept


def test_edits_that_need_them_compile_anew(device: str) -> None:
    scene = scene_of(sheet(material=PLAIN, name="sheet"), sheet("normals", material=PLAIN, name="flat"))
    scene.add(dl.lights.point(position=(2, 3, 4), intensity=20))
    live = LiveScene(scene, device)
    assert not live.set_material("flat", MAPPED).recompiled
    assert "tangents" in live.set_material("sheet", MAPPED).recompiled
    assert not live.set_material("sheet", BRUSHED).recompiled
    assert "tangents" in live.set_material("sheet", PLAIN).recompiled
