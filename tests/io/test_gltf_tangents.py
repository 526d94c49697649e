"""Tangents: those of the file, those that it leaves to MikkTSpace when the scene is compiled, those of a pose."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import destello as dl
import mikktspace_mesh
from core_meshes import core_arrays, core_meshes
from destello.nodes import Node
from gltf_scenes import loaded
from scene_files import Gltf, encode_image, write_image

FLAT = np.full((2, 2, 3), 128, np.uint8)  # a normal map
DOWN, BOTTOM = np.array((1, -1), np.float32), np.array((0, 1), np.float32)  # v to 1 - v


def material(g: Gltf, folder: Path) -> int:
    return g.add("materials", normalTexture={"index": g.texture(encode_image(FLAT, ".png", folder))})


def sheet(g: Gltf, *without: str, tangents: np.ndarray | None = None, **primitive: Any) -> int:
    """The crumpled sheet, as destello's tests of tangents have it, without shared vertices if tangents are given."""
    arrays = mikktspace_mesh.sheet()
    corners = arrays["indices"].reshape(-1)
    names = {"POSITION": "positions", "NORMAL": "normals", "TEXCOORD_0": "uvs"}
    attributes = {}
    for key, name in names.items():
        values = arrays[name] if tangents is None else arrays[name][corners]
        values = values * DOWN + BOTTOM if name == "uvs" else values
        if key not in without:
            attributes[key] = g.accessor(values.astype(np.float32))
    if tangents is not None:
        attributes["TANGENT"] = g.accessor(tangents.reshape(-1, 4).astype(np.float32))
    indices = g.accessor(corners) if tangents is None else None
    return g.mesh(attributes, indices, **primitive)


def shape_of(g: Gltf, folder: Path) -> Node:
    (shape,) = loaded(g, folder).shapes
    return shape


def corner_tangents(shape: Node) -> np.ndarray:
    arrays = core_arrays(shape)
    return np.asarray(arrays["tangents"][arrays["indices"]])


def has_tangents(shape: Node) -> bool:
    return core_arrays(shape)["tangents"] is not None


def test_left_out_and_given_ones_agree(tmp_path: Path) -> None:
    """The file's tangents are the reference implementation's, and come through; without them the same are made."""
    reference = mikktspace_mesh.reference()
    g = Gltf()
    g.node(mesh=sheet(g, tangents=reference, material=material(g, tmp_path)))
    given = corner_tangents(shape_of(g, tmp_path))
    np.testing.assert_array_equal(given, reference.astype(np.float32))
    g = Gltf()
    g.node(mesh=sheet(g, material=material(g, tmp_path)))
    made = corner_tangents(shape_of(g, tmp_path))
    off = np.abs(made - given).max(axis=(1, 2))
    assert np.quantile(off, 0.95) < 1e-4  # a few triangles whose texture is flat have a choice


def test_only_who_needs_them_gets_them(tmp_path: Path) -> None:
    for options in ({}, {"normals": 0}, {"material": 0}):
        g = Gltf()
        mat = material(g, tmp_path) if "material" not in options else g.add("materials")
        g.node(mesh=sheet(g, *(["NORMAL"] if "normals" in options else []), material=mat))
        assert (not has_tangents(shape_of(g, tmp_path))) == bool(options)
    g = Gltf()
    name = "KHR_materials_anisotropy"
    g.extend(name)
    brushed = {"pbrMetallicRoughness": {"roughnessFactor": 0.3}, "extensions": {name: {"anisotropyStrength": 0.5}}}
    g.node(mesh=sheet(g, material=g.add("materials", **brushed)))
    assert has_tangents(shape_of(g, tmp_path))


def test_given_ones_need_normals(tmp_path: Path) -> None:
    """glTF 2.0, 3.7.2.1: without normals triangles are flat, and tangents are ignored."""
    g = Gltf()
    g.node(mesh=sheet(g, "NORMAL", tangents=mikktspace_mesh.reference(), material=material(g, tmp_path)))
    assert not has_tangents(shape_of(g, tmp_path))


@pytest.mark.parametrize("given", [False, True])
def test_a_pose_turns_them(given: bool, tmp_path: Path) -> None:
    """All joints a quarter turn about x: (x, y, z) to (x, -z, y)."""
    turned = []
    for posed in (False, True):
        g = Gltf()
        reference = mikktspace_mesh.reference() if given else None
        mesh = sheet(g, tangents=reference, material=material(g, tmp_path))
        if posed:
            count = g.json["accessors"][g.json["meshes"][0]["primitives"][0]["attributes"]["POSITION"]]["count"]
            attributes = g.json["meshes"][0]["primitives"][0]["attributes"]
            attributes["JOINTS_0"] = g.accessor(np.zeros((count, 4), np.uint8))
            attributes["WEIGHTS_0"] = g.accessor(np.tile(np.float32((1, 0, 0, 0)), (count, 1)))
            joint = g.node(rotation=[0.5**0.5, 0, 0, 0.5**0.5])
            g.node(mesh=mesh, skin=g.add("skins", joints=[joint]))
        else:
            g.node(mesh=mesh)
        turned.append(corner_tangents(shape_of(g, tmp_path)))
    x, y, z, w = np.moveaxis(turned[0], -1, 0)
    np.testing.assert_allclose(turned[1], np.stack([x, -z, y, w], -1), atol=2e-6)


def test_morph_targets_move_them(tmp_path: Path) -> None:
    reference = mikktspace_mesh.reference()
    g = Gltf()
    step = np.tile(np.float32((0, 2, 0)), (reference.size // 4, 1))
    mesh = sheet(g, tangents=reference, material=material(g, tmp_path), targets=[{"TANGENT": g.accessor(step)}])
    g.node(mesh=mesh, weights=[0.5])
    np.testing.assert_allclose(corner_tangents(shape_of(g, tmp_path)), reference + np.array((0, 1, 0, 0)), atol=1e-6)


def test_normal_maps_of_obj_files(tmp_path: Path) -> None:
    arrays = mikktspace_mesh.sheet()
    lines = ["mtllib m.mtl", "usemtl m"]
    for word, name in (("v", "positions"), ("vt", "uvs"), ("vn", "normals")):
        lines += [" ".join([word, *map(repr, row)]) for row in arrays[name].tolist()]
    lines += [" ".join(["f", *(f"{k}/{k}/{k}" for k in row + 1)]) for row in arrays["indices"]]
    (tmp_path / "s.obj").write_text("\n".join(lines))
    write_image(tmp_path / "n.png", FLAT)
    for norm in ("", "\nnorm n.png"):
        (tmp_path / "m.mtl").write_text("newmtl m\nKd 1 1 1" + norm)
        (mesh,) = core_meshes(dl.load(tmp_path / "s.obj"))
        assert (mesh["tangents"] is not None) == bool(norm)
    off = np.abs(mesh["tangents"][mesh["indices"]] - mikktspace_mesh.reference()).max(axis=(1, 2))
    assert np.quantile(off, 0.95) < 1e-4
