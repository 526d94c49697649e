"""What the readers make of a file, seen in the picture: orientation, colours, front and back."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import destello as dl
from scene_files import QUAD, QUAD_UV, Gltf, corner_image, encode_image

CORNERS = ((1, 0, 0), (0, 1, 0), (0, 0, 1), (1, 1, 1))  # of corner_image: top left, right; bottom left, right
GREY = 0.0513  # 64 as sRGB


def picture(scene: dl.Scene, device: str) -> np.ndarray:
    """(32, 32, 3) seen from (0, 0, 5), the square from -1 to 1 filling it."""
    scene.camera = dl.cameras.orthographic(origin=(0, 0, 5), target=(0, 0, 0), height=2)
    scene.environment = dl.environments.constant(radiance=0)
    image: np.ndarray = dl.render(scene, spp=16, size=(32, 32), device=device, progress=False).array
    return image


def corners(image: np.ndarray) -> np.ndarray:
    """(4, 3): the four texels that corner_image marks."""
    return image[[4, 4, 27, 27], [4, 27, 4, 27]]


def unlit_quad(folder: Path, *, node: dict[str, Any] | None = None, copies: int = 1, **info: Any) -> dl.Scene:
    g = Gltf()
    texture = g.texture(encode_image(corner_image(), ".png", folder), magFilter=9728)
    pbr = {"baseColorTexture": {"index": texture, **info}}
    mesh = g.quad(material=g.add("materials", pbrMetallicRoughness=pbr, extensions={"KHR_materials_unlit": {}}))
    g.node(mesh=mesh, **(node or {}))
    for _ in range(copies - 1):
        g.node(mesh=mesh, translation=[100, 0, 0])
    return dl.load(g.glb(folder))


@pytest.mark.parametrize("copies", [1, 2])
def test_gltf_textures_stand_upright(copies: int, device: str, tmp_path: Path) -> None:
    image = picture(unlit_quad(tmp_path, copies=copies), device)
    np.testing.assert_allclose(corners(image), CORNERS, atol=1e-3)
    np.testing.assert_allclose(image[16, 16], GREY, atol=1e-3)


def test_gltf_second_set_of_coordinates(device: str, tmp_path: Path) -> None:
    """The glow reads TEXCOORD_1, which is mirrored; the base colour, of which nothing is lit, TEXCOORD_0."""
    g = Gltf()
    index = g.texture(encode_image(corner_image(), ".png", tmp_path), magFilter=9728)
    pbr = {"baseColorTexture": {"index": index}}
    look = {"emissiveTexture": {"index": index, "texCoord": 1}, "emissiveFactor": [1, 1, 1]}
    g.node(mesh=g.quad(material=g.add("materials", pbrMetallicRoughness=pbr, **look)))
    mirrored = QUAD_UV * np.float32((-1, 1)) + np.float32((1, 0))
    g.json["meshes"][0]["primitives"][0]["attributes"]["TEXCOORD_1"] = g.accessor(mirrored)
    top_left, top_right, bottom_left, bottom_right = CORNERS
    seen = corners(picture(dl.load(g.glb(tmp_path)), device))
    np.testing.assert_allclose(seen, [top_right, top_left, bottom_right, bottom_left], atol=1e-3)


def test_gltf_texture_transform_turns_the_picture(device: str, tmp_path: Path) -> None:
    """A quarter turn about the middle of the image: uv turn counter-clockwise, the picture clockwise."""
    turn = {"KHR_texture_transform": {"rotation": np.pi / 2, "offset": [0, 1]}}
    seen = corners(picture(unlit_quad(tmp_path, extensions=turn), device))
    top_left, top_right, bottom_left, bottom_right = CORNERS
    np.testing.assert_allclose(seen, [bottom_left, top_left, bottom_right, top_right], atol=1e-3)


@pytest.mark.parametrize("copies", [1, 2])
@pytest.mark.parametrize(
    ("node", "bright"),
    [
        ({}, True),
        ({"scale": [-1, 1, 1]}, True),  # mirrored: its front stays its front
        ({"scale": [1, -1, 1]}, True),
        ({"rotation": [0, 1, 0, 0]}, False),
        ({"rotation": [0, 1, 0, 0], "scale": [-1, 1, 1]}, False),
        ({"scale": [1, 1, -1]}, False),
    ],
)
def test_gltf_emission_leaves_by_the_front(
    node: dict[str, Any], bright: bool, copies: int, device: str, tmp_path: Path
) -> None:
    g = Gltf()
    pbr = {"baseColorFactor": [0, 0, 0, 1]}
    mesh = g.quad(material=g.add("materials", pbrMetallicRoughness=pbr, emissiveFactor=[1, 0.5, 0.25]))
    g.node(mesh=mesh, **node)
    for _ in range(copies - 1):
        g.node(mesh=mesh, translation=[100, 0, 0])
    seen = picture(dl.load(g.glb(tmp_path)), device)[16, 16]
    np.testing.assert_allclose(seen, (1, 0.5, 0.25) if bright else (0, 0, 0), atol=1e-5)


def test_gltf_mask_cuts_holes(device: str, tmp_path: Path) -> None:
    texels = np.full((2, 2, 4), 255, np.uint8)
    texels[..., 3] = [[255, 0], [120, 140]]
    g = Gltf()
    texture = g.texture(encode_image(texels, ".png", tmp_path), magFilter=9728)
    pbr = {"baseColorTexture": {"index": texture}}
    unlit = {"KHR_materials_unlit": {}}
    g.node(mesh=g.quad(material=g.add("materials", pbrMetallicRoughness=pbr, alphaMode="MASK", extensions=unlit)))
    image = picture(dl.load(g.glb(tmp_path)), device)
    np.testing.assert_allclose(corners(image)[:, 0], [1, 0, 0, 1], atol=1e-5)


@pytest.mark.parametrize("axis", [0, 1])
@pytest.mark.parametrize("mirror", ["none", "transform", "instance", "texture"])
def test_gltf_normal_map_leans_along_the_image(axis: int, mirror: str, device: str, tmp_path: Path) -> None:
    """Red is the way of u, green the way up: where they lean to the light, it is brighter."""
    seen = []
    for lean in (1, 0, -1):
        normal = np.array([0.0, 0.0, 1.0])
        normal[axis] = 0.6 * lean
        normal /= np.linalg.norm(normal)
        texels = np.tile(np.round(127.5 * normal + 127.5).astype(np.uint8), (2, 2, 1))
        g = Gltf()
        texture = g.texture(encode_image(texels, ".png", tmp_path))
        pbr = {"metallicFactor": 0, "baseColorFactor": [0.5, 0.5, 0.5, 1]}
        material = g.add("materials", pbrMetallicRoughness=pbr, normalTexture={"index": texture})
        uv = QUAD_UV * (-1, 1) if mirror == "texture" else QUAD_UV
        attributes = {"POSITION": g.accessor(QUAD), "TEXCOORD_0": g.accessor(uv.astype(np.float32))}
        mesh = g.mesh(attributes, g.accessor(np.array([0, 1, 2, 0, 2, 3], np.uint8)), material=material)
        g.node(mesh=mesh, scale=[-1 if mirror in ("transform", "instance") else 1, 1, 1])
        if mirror == "instance":
            g.node(mesh=mesh, translation=[100, 0, 0])
        scene = dl.load(g.glb(tmp_path))
        light = np.array([0.0, 0.0, -1.0])
        light[axis] = 1.0 if axis == 0 and mirror != "none" else -1.0  # u runs the other way in a mirror
        scene.add(dl.lights.directional(direction=light, irradiance=1))
        seen.append(float(picture(scene, device)[16, 16].mean()))
    assert seen[0] > 1.1 * seen[1] > 1.2 * seen[2]


def test_gltf_vertex_colours_are_linear(device: str, tmp_path: Path) -> None:
    g = Gltf()
    colors = np.tile(np.float32((0.5, 0.25, 1)), (4, 1))
    attributes = {"POSITION": g.accessor(QUAD), "COLOR_0": g.accessor(colors)}
    material = g.add("materials", extensions={"KHR_materials_unlit": {}})
    g.node(mesh=g.mesh(attributes, g.accessor(np.array([0, 1, 2, 0, 2, 3], np.uint8)), material=material))
    np.testing.assert_allclose(picture(dl.load(g.glb(tmp_path)), device)[16, 16], (0.5, 0.25, 1), atol=1e-5)


def test_obj_textures_stand_upright(device: str, tmp_path: Path) -> None:
    (tmp_path / "t.png").write_bytes(encode_image(corner_image(), ".png", tmp_path))
    (tmp_path / "q.mtl").write_text("newmtl m\nKd 0 0 0\nmap_Ke t.png\n")
    lines = ["mtllib q.mtl", *(f"v {x} {y} {z}" for x, y, z in QUAD), *(f"vt {u} {1 - v}" for u, v in QUAD_UV)]
    (tmp_path / "q.obj").write_text("\n".join([*lines, "usemtl m", "f 1/1 2/2 3/3 4/4", ""]))
    image = picture(dl.load(tmp_path / "q.obj"), device)
    assert corners(image).argmax(axis=1).tolist()[:3] == [0, 1, 2]
    assert (corners(image)[3] > 0.5).all()


def test_ply_with_coordinates_and_colours(device: str, tmp_path: Path) -> None:
    """A white sky on a square that is painted red on the left and blue on the right."""
    head = "ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z\n"
    head += "property uchar red\nproperty uchar green\nproperty uchar blue\n"
    head += "element face 1\nproperty list uchar int vertex_indices\nend_header\n"
    rows = [f"{x} {y} {z} {'255 0 0' if x < 0 else '0 0 255'}" for x, y, z in QUAD]
    (tmp_path / "q.ply").write_text(head + "\n".join([*rows, "4 0 1 2 3", ""]))
    scene = dl.load(tmp_path / "q.ply")
    scene.camera = dl.cameras.orthographic(origin=(0, 0, 5), target=(0, 0, 0), height=2)
    scene.environment = dl.environments.constant(radiance=1)
    image = dl.render(scene, spp=64, size=(32, 32), device=device, progress=False).array
    np.testing.assert_allclose(image[16, [1, 30]], [[0.95, 0, 0.05], [0.05, 0, 0.95]], atol=0.03)
