"""Normals, tangents and heights by images of the second uv set: as if the same coordinates were the first."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import destello as dl
from destello.live import LiveScene

N = 9
RNG = np.random.default_rng(8)
NORMALS = np.concatenate([0.35 + 0.3 * RNG.random((8, 8, 2)), np.ones((8, 8, 1))], 2).astype(np.float32)
TURNS = np.concatenate([RNG.random((6, 6, 2)), np.zeros((6, 6, 1))], 2).astype(np.float32)
GLOSSY = {"specular_roughness": 0.3, "base_color": 0.2}
COATED = {"coat_weight": 1.0, "coat_roughness": 0.3, "base_color": 0.2, "specular_weight": 0.0}


def hill(uvs: Any, *, smooth: bool = True, **more: Any) -> Any:
    """A bumpy square, (-1, -1) to (1, 1), seen from above."""
    y, x = np.mgrid[0:N, 0:N] / (N - 1) * 2 - 1
    z = 0.2 * np.cos(2 * x + 0.5) * np.cos(1.5 * y)
    normals = np.stack([0.4 * np.sin(2 * x + 0.5) * np.cos(1.5 * y), 0.3 * np.cos(2 * x + 0.5) * np.sin(1.5 * y),
                        np.ones_like(x)], -1)  # fmt: skip
    positions = np.stack([x, y, z], -1).reshape(-1, 3).astype(np.float32)
    i = (np.arange(N - 1)[:, None] * N + np.arange(N - 1)).ravel()
    triangles = np.concatenate([np.stack([i, i + 1, i + N + 1], 1), np.stack([i, i + N + 1, i + N], 1)])
    if smooth:
        more["normals"] = normals.reshape(-1, 3).astype(np.float32)
    return dl.shapes.mesh(positions, triangles, uvs=uvs, **more)


def straight() -> Any:
    y, x = np.mgrid[0:N, 0:N] / (N - 1)
    return np.stack([x, y], -1).reshape(-1, 2).astype(np.float32)


def bent() -> Any:
    """Turned and curved, and mirrored in one half."""
    u, v = straight().astype(np.float64).T
    return np.stack([0.8 * v + 0.3 * u * u, 1.5 * abs(u - 0.5) + 0.2 * v], 1).astype(np.float32)


def image(texels: Any, uv_set: str) -> Any:
    return dl.textures.image(texels, color_space="linear", uv_set=uv_set, mip_maps=False)


def picture(shape: Any, device: str, **options: Any) -> np.ndarray:
    scene = dl.Scene()
    scene.add(shape)
    scene.camera = dl.cameras.orthographic(origin=(0, 0, 3), target=(0, 0, 0), height=2)
    scene.add(dl.lights.point(position=(0.7, 0.5, 1.5), intensity=2))
    scene.render.max_depth = 2  # from the lamp alone: nothing depends on directions that are drawn
    return np.asarray(dl.render(scene, spp=4, size=(24, 24), device=device, progress=False, seed=2, **options).array)


def maps(uv_set: str) -> dict[str, Any]:
    normals, turns = image(NORMALS, uv_set), image(TURNS, uv_set)
    return {
        "normals": dl.materials.openpbr(**GLOSSY, normal_map=normals, normal_scale=0.8),
        "turns": dl.materials.conductor(roughness=0.4, anisotropy=0.8, tangent_map=turns, tangent_rotation=20),
        "normals and turns": dl.materials.conductor(
            roughness=0.4, anisotropy=0.8, normal_map=normals, tangent_map=turns
        ),
        "coat": dl.materials.openpbr(**COATED, geometry_coat_normal=normals, geometry_coat_normal_scale=0.8),
        "coat's turns": dl.materials.openpbr(
            **COATED, coat_roughness_anisotropy=0.9, geometry_coat_tangent=turns, geometry_coat_normal=normals
        ),
    }


@pytest.mark.parametrize("smooth", [True, False])
@pytest.mark.parametrize("look", list(maps("first")))
def test_directions_are_those_of_the_same_uvs_as_first_set(look: str, smooth: bool, device: str) -> None:
    """With tangents at the vertices and without, and in mirrored coordinates."""
    first = picture(hill(bent(), smooth=smooth, material=maps("first")[look]), device)
    shape = hill(straight(), smooth=smooth, second_uvs=bent(), material=maps("second")[look])
    np.testing.assert_allclose(picture(shape, device), first, rtol=2e-3, atol=1e-4)
    by_first = picture(hill(straight(), smooth=smooth, material=maps("first")[look]), device)
    assert np.abs(by_first - first).max() > 0.05  # the two sets differ


@pytest.mark.parametrize("look", ["normals", "coat's turns"])
def test_placed_and_mirrored(look: str, device: str) -> None:
    """By instances, and by transforms of their own that turn the mesh inside out."""
    place = dl.rotate((0, 0, 1), 70) @ dl.scale((-1, 0.8, 1))
    found = []
    for uv_set in ("first", "second"):
        arrays = {"uvs": bent()} if uv_set == "first" else {"uvs": straight(), "second_uvs": bent()}
        shape = hill(**arrays, material=maps(uv_set)[look])
        own = picture(shape.replace(transform=place), device)
        scene = dl.Scene()
        group = scene.group("hill", [shape])
        scene.add(dl.shapes.instance(group, transform=place))
        scene.camera = dl.cameras.orthographic(origin=(0, 0, 3), target=(0, 0, 0), height=2)
        scene.add(dl.lights.point(position=(0.7, 0.5, 1.5), intensity=2))
        scene.render.max_depth = 2
        placed = dl.render(scene, spp=4, size=(24, 24), device=device, progress=False, seed=2).array
        np.testing.assert_allclose(placed, own, rtol=5e-3, atol=1e-3)
        found.append(own)
    np.testing.assert_allclose(*found, rtol=2e-3, atol=1e-4)


def test_each_map_has_its_own_set(device: str) -> None:
    """Base by one set, coat by the other; and the same the other way round."""
    found = []
    for base, coat in (("first", "second"), ("second", "first")):
        uvs = (bent(), straight()) if base == "first" else (straight(), bent())
        material = dl.materials.openpbr(
            **GLOSSY, coat_weight=1.0, coat_roughness=0.2, normal_map=image(NORMALS, base),
            geometry_coat_normal=image(NORMALS[::-1].copy(), coat),
        )  # fmt: skip
        found.append(picture(hill(uvs[0], second_uvs=uvs[1], material=material), device))
    np.testing.assert_allclose(*found, rtol=2e-3, atol=1e-4)


def test_heights_by_both_sets(device: str) -> None:
    """A pattern of two images of heights, one a set: slopes are those of the same image placed alike in the first."""
    y, x = np.mgrid[0:32, 0:32] / 32
    heights = (0.03 * np.sin(7 * x + 3) * np.cos(5 * y)).astype(np.float32)[..., None]
    scale, offset = (1.5, -0.7), (0.2, 0.9)
    placed = dl.textures.image(heights, color_space="linear", uv_scale=scale, uv_offset=offset, wrap_v="mirror")
    moved = dl.textures.image(heights, color_space="linear", uv_set="second", wrap_v="mirror")
    plain = dl.textures.image(heights[::-1].copy(), color_space="linear")
    found = []
    for other in (placed, moved):
        pattern = dl.textures.checker_uv(even=other, odd=plain, count_u=3, count_v=2)
        matt = dl.materials.diffuse(reflectance=0.8, bump=pattern)
        second = straight() * np.float32(scale) + np.float32(offset)
        found.append(picture(hill(straight(), second_uvs=second, material=matt), device))
    # Steps are lengths, or parts of an image: as long as these meet the same texels the slopes are the same.
    difference = np.abs(found[0] - found[1])
    assert np.quantile(difference, 0.95) < 2e-3 * found[0].max()
    flat = picture(hill(straight(), material=dl.materials.diffuse(reflectance=0.8)), device)
    assert np.abs(found[0] - flat).max() > 0.02


def test_an_edit_that_asks_for_other_tangents_compiles_anew(device: str) -> None:
    scene = dl.Scene()
    scene.add(hill(straight(), second_uvs=bent(), name="hill", material=maps("first")["normals"]))
    scene.add(dl.lights.point(position=(0.7, 0.5, 1.5), intensity=2))
    live = LiveScene(scene, device)
    assert not live.set_material("hill", {"normal_scale": 0.5}).recompiled
    assert "other tangents" in live.set_material("hill", maps("second")["normals"]).recompiled
