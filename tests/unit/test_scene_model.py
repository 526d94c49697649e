"""Scenes as data: building, settings, validation, bounds, info, the package's own surface."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import destello as dl
from destello.errors import SceneError
from destello.settings import FilmSettings, RenderSettings


def problem(function: Any, *args: Any, **params: Any) -> SceneError:
    with pytest.raises(SceneError) as caught:
        function(*args, **params)
    assert "\n" not in str(caught.value)
    return caught.value


def full_scene() -> dl.Scene:
    scene = dl.Scene("full")
    scene.camera = dl.cameras.perspective(origin=(0, 1, 5))
    scene.film.width, scene.film.height = 64, 48
    red = dl.materials.diffuse((0.8, 0.1, 0.1), name="red")
    scene.add(dl.shapes.sphere((0, 0, 0), 1, material=red), dl.lights.point((0, 5, 0)))
    group = scene.group("boxes", [dl.shapes.box((0, 0, 0), (1, 1, 1), material=red)])
    scene.add(dl.shapes.instance(group, transform=dl.translate(3, 0, 0)))
    scene.environment = dl.environments.constant()
    return scene


# --- the package ------------------------------------------------------------------------------------------------------
def test_every_public_name_is_there() -> None:
    for name in dl.__all__:
        assert getattr(dl, name) is not None
    assert set(dl.__all__) == set(dir(dl))
    with pytest.raises(AttributeError, match="no attribute 'Scen'"):
        _ = dl.Scen  # type: ignore[attr-defined]


def test_import_loads_nothing_heavy() -> None:
    code = "import sys, destello; print(*sys.modules)"
    out = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout.split()
    assert not {"numpy", "yaml", "OpenImageIO", "typer", "rich", "destello._core", "trimesh"} & set(out)


def test_render_stays_a_function_when_its_module_is_imported() -> None:
    code = "import destello.render, destello; from destello.render import render; assert destello.render is render"
    subprocess.run([sys.executable, "-c", code], check=True)


# --- building ---------------------------------------------------------------------------------------------------------
def test_camera_is_the_default_or_the_first() -> None:
    scene = dl.Scene()
    assert scene.camera is None
    first, second = dl.cameras.perspective(vfov=10), dl.cameras.perspective(vfov=20)
    scene.cameras["side"] = first
    assert scene.camera is first
    scene.camera = second
    assert scene.camera is second
    assert list(scene.cameras) == ["side", "default"]
    assert problem(setattr, scene, "camera", dl.lights.point()).place == "camera"


def test_add_takes_shapes_and_lights_only() -> None:
    scene = full_scene()
    assert (len(scene.shapes), len(scene.lights)) == (2, 1)
    for bad in (dl.materials.diffuse(), 3, None, dl.environments.constant()):
        assert problem(scene.add, bad).expected == "shapes and lights"


def test_groups() -> None:
    scene = full_scene()
    assert problem(scene.group, "boxes", []).value == "boxes"
    assert problem(scene.group, "", []).place == "groups"
    assert problem(scene.group, "a", [dl.shapes.instance("boxes")]).place == "groups.a[0]"
    assert problem(scene.group, "a", [dl.lights.point()]).place == "groups.a[0]"


# --- settings ---------------------------------------------------------------------------------------------------------
def test_settings_have_defaults_and_ranges() -> None:
    film, render = FilmSettings(), RenderSettings(spp=5)
    assert (film.width, film.height, film.filter) == (1280, 720, None)
    assert (render.spp, render.shutter, render.light_sampling) == (5, (0.0, 1.0), "auto")
    render.spp = None  # type: ignore[assignment]
    assert render == RenderSettings()
    assert "spp" in dir(render)
    assert repr(RenderSettings(spp=2)) == "RenderSettings(spp=2)"
    with pytest.raises(AttributeError, match="did you mean 'spp'"):
        _ = render.sp  # type: ignore[attr-defined]


@pytest.mark.parametrize(
    ("name", "value", "place"),
    [
        ("spp", 0, "render.spp"),
        ("spp", -1, "render.spp"),
        ("spp", 1.5, "render.spp"),
        ("spp", "many", "render.spp"),
        ("max_depth", -1, "render.max_depth"),
        ("seed", 2**32, "render.seed"),
        ("shutter", (0, 2), "render.shutter"),
        ("shutter", 1, "render.shutter"),
        ("light_sampling", "all", "render.light_sampling"),
        ("tone", "film", "render.tone"),
        ("samples", 3, "render"),
    ],
)
def test_bad_settings(name: str, value: Any, place: str) -> None:
    error = problem(setattr, RenderSettings(), name, value)
    assert error.place == place
    assert error.expected


@pytest.mark.parametrize("size", [0, -5, 65537, 1.5, "wide"])
def test_bad_sizes(size: Any) -> None:
    assert problem(setattr, FilmSettings(), "width", size).place == "film.width"
    assert problem(setattr, FilmSettings(), "filter", dl.materials.diffuse()).place == "film.filter"


# --- validation and comparison ----------------------------------------------------------------------------------------
def test_validation_gathers_all_problems() -> None:
    scene = full_scene()
    scene.shapes.append(dl.lights.point())
    scene.shapes.append(dl.shapes.instance("boxs"))
    scene.lights.append(3)  # type: ignore[arg-type]
    scene.cameras["bad"] = dl.materials.diffuse()
    scene.environment = dl.lights.point()
    scene.render.shutter = (0.5, 0.2)
    scene.groups["other"] = scene.groups["boxes"]
    error = problem(scene.validate)
    assert sorted(p.place or "" for p in error.problems) == [
        "cameras.bad",
        "environment",
        "groups.other",
        "lights[0]" if not scene.lights else "lights[1]",
        "render.shutter",
        "shapes[2]",
        "shapes[3].group",
    ]
    assert "did you mean 'boxes'" in next(p for p in error.problems if p.place == "shapes[3].group").__str__()
    full_scene().validate()


def test_equality_and_copies() -> None:
    scene = full_scene()
    copy = scene.copy()
    assert copy == scene == full_scene()
    copy.add(dl.shapes.sphere((0, 0, 0), 2))
    copy.film.width = 10
    assert copy != scene
    assert scene == full_scene()
    assert scene != 3
    scene.base_dir, scene.notes = Path("elsewhere"), ["note"]
    assert scene == full_scene()
    for change in ("name", "environment"):
        other = full_scene()
        setattr(other, change, None)
        assert other != scene
    assert repr(scene) == "<Scene 'full': 2 shapes, 1 groups, 1 lights, 1 cameras>"


def test_nodes_are_listed_once() -> None:
    scene = full_scene()
    assert len(scene.materials()) == 1
    assert scene.textures() == []
    assert [node.kind for node in scene.nodes()].count("shape") == 3


# --- bounds -----------------------------------------------------------------------------------------------------------
def bounds(*shapes: dl.Node, **groups: list[dl.Node]) -> list[list[float]] | None:
    scene = dl.Scene()
    for name, members in groups.items():
        scene.group(name, members)
    scene.add(*shapes)
    box = scene.bounds()
    return None if box is None else [corner.tolist() for corner in box]


def test_bounds() -> None:
    assert bounds() is None
    assert bounds(dl.shapes.sphere((1, 0, 0), -2)) == [[-1, -2, -2], [3, 2, 2]]
    assert bounds(dl.shapes.sphere((0, 0, 0), 1, center1=(5, 0, 0))) == [[-1, -1, -1], [6, 1, 1]]
    assert bounds(dl.shapes.spheres([[0, 0, 0], [4, 0, 0]], [1, 2])) == [[-1, -2, -2], [6, 2, 2]]
    assert bounds(dl.shapes.quad((0, 0, 0), (1, 0, 0), (0, 2, 0))) == [[0, 0, 0], [1, 2, 0]]
    box = dl.shapes.box((0, 0, 0), (1, 2, 3))
    assert bounds(box) == [[0, 0, 0], [1, 2, 3]]
    assert bounds(box.replace(transform=dl.translate(1, 0, 0) @ dl.scale(2))) == [[1, 0, 0], [3, 4, 6]]
    moving = box.replace(transform=dl.Transform(), transform1=dl.translate(0, 9, 0))
    assert bounds(moving) == [[0, 0, 0], [1, 11, 3]]
    turned = dl.shapes.instance("g", transform=dl.rotate("z", 90))
    assert bounds(turned, g=[box]) == [[-2, 0, 0], [0, 1, 3]]
    assert bounds(turned, g=[]) is None
    mesh = dl.shapes.mesh(np.eye(3), [[0, 1, 2]], positions1=np.eye(3) * 3)
    assert bounds(mesh) == [[0, 0, 0], [3, 3, 3]]


# --- info -------------------------------------------------------------------------------------------------------------
def test_info() -> None:
    scene = full_scene()
    scene.notes.append("from somewhere")
    scene.add(
        dl.shapes.sphere((0, 0, 0), 1, material=dl.materials.diffuse(dl.textures.image(np.zeros((4, 8, 3), np.uint8))))
    )
    scene.add(dl.shapes.sphere((0, 0, 0), 1, material=dl.materials.diffuse(dl.textures.image("gone.png"))))
    info = scene.info()
    assert (info["triangles"], info["spheres"], info["instances"]) == (12, 3, 1)
    assert info["shapes"] == {"box": 1, "instance": 1, "sphere": 3}
    assert info["materials"] == {"diffuse": 3}
    assert info["textures"] == {"image": 2}
    assert info["bounds"] == [[-1, -1, -1], [4, 1, 1]]
    assert info["missing"] == ["gone.png"]
    assert info["notes"] == ["from somewhere"]
    assert (info["size"], info["cameras"], info["environment"]) == ([64, 48], {"default": "perspective"}, "constant")
    sizes = [(image["width"], image["height"], image["bytes"]) for image in info["images"].values()]
    assert (8, 4, 96) in sizes
    assert info["memory"] > 96


def test_memory_estimate_is_near_what_the_core_says() -> None:
    scene = dl.Scene()
    count = 30000
    rng = np.random.default_rng(3)
    corners = rng.random((count, 1, 3)) * 10 + rng.random((count, 3, 3)) * 0.1
    scene.add(dl.shapes.mesh(corners.reshape(-1, 3), np.arange(3 * count).reshape(-1, 3)))
    scene.add(dl.shapes.spheres(rng.random((count, 3)), np.full(count, 0.01)))
    stats = scene.compile().stats
    needed = stats["geometry_bytes"] + stats["bvh_bytes"]
    assert 0.75 * needed < scene.info()["memory"] < 1.33 * needed


@pytest.mark.parametrize("name", ["mesh1m", "terrain", "interior"])
def test_bytes_a_triangle_are_what_the_core_says(name) -> None:
    scene = dl.scenes.build(name, 0.05)
    stats, found = scene.compile().stats, scene.info()["triangle_bytes"]
    assert found["geometry"] == pytest.approx(stats["geometry_bytes"] / stats["triangles"], rel=0.05)
    assert found["tree"] == pytest.approx(stats["bvh_bytes"] / stats["triangles"], rel=0.4)
    assert dl.scenes.build("book1").info()["triangle_bytes"] is None
