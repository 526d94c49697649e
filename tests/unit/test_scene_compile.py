"""From scenes to the core: what it is told, what is shared, what is refused and how it is said."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import destello as dl
from destello import _core, image_table
from destello.errors import Error, InputError, MissingFileError, SceneError

Call = tuple[str, dict[str, Any]]


class Spy:
    """A core builder that also keeps every call."""

    calls: list[Call]

    def __init__(self) -> None:
        self._builder = _core.SceneBuilder()
        Spy.calls = []

    def __getattr__(self, name: str) -> Any:
        method = getattr(self._builder, name)

        def call(*args: Any, **options: Any) -> Any:
            Spy.calls.append((name, {**{str(i): a for i, a in enumerate(args)}, **options}))
            return method(*args, **options)

        return call


@pytest.fixture
def spied(monkeypatch: pytest.MonkeyPatch) -> Any:
    """Compiles a scene through a Spy; gives the calls of one name."""

    class Core:
        SceneBuilder = Spy

    import destello

    monkeypatch.setattr(destello, "_core", Core, raising=False)

    def run(scene: dl.Scene, name: str, **options: Any) -> list[dict[str, Any]]:
        scene.compile(**options)
        return [args for called, args in Spy.calls if called == name]

    return run


def triangle(**params: Any) -> dl.Node:
    return dl.shapes.mesh(np.eye(3), [[0, 1, 2]], **params)


def scene_of(*nodes: dl.Node) -> dl.Scene:
    scene = dl.Scene()
    scene.add(*nodes)
    scene.environment = dl.environments.constant()
    scene.camera = dl.cameras.perspective(origin=(0, 0, 5))
    return scene


def problem(scene: dl.Scene, **options: Any) -> Error:
    with pytest.raises(Error) as caught:
        scene.compile(**options)
    assert "\n" not in str(caught.value)
    return caught.value


# --- what the core is told --------------------------------------------------------------------------------------------
def test_every_kind_of_thing_compiles() -> None:
    scene = scene_of(
        triangle(
            normals=np.eye(3),
            uvs=np.zeros((3, 2)),
            colors=np.ones((3, 3)),
            positions1=np.eye(3) * 2,
            normals1=np.eye(3),
        ),
        dl.shapes.sphere((0, 0, 0), 1, center1=(1, 0, 0)),
        dl.shapes.spheres([[0, 0, 3], [0, 0, 4]], [1, -0.5]),
        dl.shapes.quad((0, 0, 0), (1, 0, 0), (0, 1, 0)),
        dl.shapes.box((0, 0, 0), (1, 1, 1), transform=dl.rotate("y", 5), transform1=dl.rotate("y", 9)),
        dl.lights.spot(transform=dl.translate(0, 1, 0)),
        dl.lights.directional(),
    )
    group = scene.group("g", [dl.shapes.sphere((0, 0, 0), 1), triangle()])
    scene.add(dl.shapes.instance(group, transform=dl.scale(2)))
    scene.cameras["flat"] = dl.cameras.orthographic()
    scene.film.filter = dl.filters.tent()
    compiled = scene.compile()
    assert compiled.cameras == {"default": 0, "flat": 1}
    assert compiled.stats["triangles"] == 1 + 2 + 12 + 1
    assert compiled.stats["spheres"] == 4
    assert compiled.stats["instances"] >= 1
    assert compiled.filter["type"] == "tent"
    assert (compiled.width, compiled.height, compiled.notes) == (1280, 720, [])


def test_equal_materials_and_shared_arrays_are_added_once(spied: Any) -> None:
    positions = np.eye(3, dtype=np.float32)
    indices = np.array([[0, 1, 2]], np.uint32)
    shapes = [
        dl.shapes.mesh(positions, indices, material=dl.materials.diffuse(0.5), transform=dl.translate(i, 0, 0))
        for i in range(3)
    ]
    scene = scene_of(*shapes, triangle(material=dl.materials.diffuse(0.25)))
    assert len(spied(scene, "add_material")) == 2
    names = [name for name, _ in Spy.calls]
    assert names.count("place_mesh") == 4
    assert names.count("add_mesh") == 2 + (len({id(s["positions"]) for s in shapes}) - 1)


def test_spheres_of_one_material_go_together(spied: Any) -> None:
    red = dl.materials.diffuse((1, 0, 0))
    scene = scene_of(*(dl.shapes.sphere((i, 0, 0), 1, material=red) for i in range(5)), dl.shapes.sphere((9, 0, 0), 1))
    calls = spied(scene, "add_spheres")
    assert sorted(len(call["1"]) for call in calls) == [1, 5]
    assert next(call["1"][:, 0].tolist() for call in calls if len(call["1"]) == 5) == [0, 1, 2, 3, 4]


def test_values_and_textures(spied: Any) -> None:
    image = dl.textures.image(np.zeros((2, 2, 3), np.uint8), name="picture")
    material = dl.materials.diffuse(
        reflectance=dl.textures.scaled(image, (0.5, 1, 1), vertex_color=True),
        roughness=dl.textures.scaled(image, 0.5, channel="g"),
        opacity=dl.textures.vertex_color(channel="a"),
        emission_two_sided=True,
    )
    (call,) = spied(scene_of(triangle(material=material)), "add_material")
    params = call["1"]
    assert call["0"] == "diffuse"
    assert params["reflectance"]["scale"] == (0.5, 1.0, 1.0)
    assert params["reflectance"]["vertex_color"] is True
    assert (params["roughness"]["scale"], params["roughness"]["channel"]) == (0.5, "g")
    assert params["opacity"] == {"vertex_color": True, "scale": 1.0, "channel": "a"}
    assert params["emission_two_sided"] is True
    images = [args for name, args in Spy.calls if name == "add_image"]
    assert [args["srgb"] for args in images] == [True, False]  # looked at, and as numbers


def test_coloured_factor_for_a_number(spied: Any) -> None:
    image = dl.textures.image(np.zeros((2, 2, 3), np.uint8))
    by_channel = dl.textures.scaled(image, (1, 2, 3), channel="b")
    (call,) = spied(scene_of(triangle(material=dl.materials.diffuse(roughness=by_channel))), "add_material")
    assert call["1"]["roughness"]["scale"] == 3.0
    mean = dl.textures.scaled(image, (1, 2, 3), channel="mean")
    error = problem(scene_of(triangle(material=dl.materials.diffuse(roughness=mean))))
    assert error.place == "shapes[0].material.roughness.scale"


@pytest.mark.parametrize(
    ("texels", "space", "param", "srgb"),
    [
        (np.zeros((1, 1, 3), np.uint8), "auto", "reflectance", True),
        (np.zeros((1, 1, 3), np.uint16), "auto", "reflectance", True),
        (np.zeros((1, 1, 3), np.float32), "auto", "reflectance", False),
        (np.zeros((1, 1, 3), np.uint8), "auto", "normal_map", False),
        (np.zeros((1, 1, 3), np.uint8), "auto", "roughness", False),
        (np.zeros((1, 1, 3), np.uint8), "linear", "reflectance", False),
        (np.zeros((1, 1, 3), np.float32), "srgb", "reflectance", True),
    ],
)
def test_color_spaces(spied: Any, texels: Any, space: str, param: str, srgb: bool) -> None:
    texture = dl.textures.image(texels, color_space=space)
    (call,) = spied(scene_of(triangle(material=dl.materials.diffuse(**{param: texture}))), "add_image")
    assert call["srgb"] is srgb


def test_uv_transform() -> None:
    texture = dl.textures.image("a", uv_scale=(2, 3), uv_rotation=90, uv_offset=(0.5, 0.25))
    assert image_table.uv_transform(texture) == ((0.0, -3.0, 0.5), (2.0, 0.0, 0.25))
    assert image_table.uv_transform(dl.textures.image("a")) == ((1, 0, 0), (0, 1, 0))


def test_mix(spied: Any) -> None:
    a, b = dl.materials.diffuse(0.1), dl.materials.diffuse(0.2)
    calls = spied(scene_of(triangle(material=dl.materials.mix(a, dl.materials.mix(a, b), amount=0.25))), "add_material")
    assert [call["0"] for call in calls] == ["diffuse", "diffuse", "mix", "mix"]
    assert calls[-1]["1"] == {"amount": 0.25, "first": 0, "second": 2}


def test_a_lamp_within_a_mix_is_not_given_by_its_power() -> None:
    """It had a radiance of 1, whatever the power."""
    lamp = dl.materials.emissive(power=100)
    mixed = dl.materials.mix(dl.materials.diffuse(), dl.materials.mix(lamp, dl.materials.diffuse()))
    with pytest.raises(SceneError, match=r"second\.first\.power: a power within a mix: 100"):
        scene_of(triangle(material=mixed)).compile()


def test_vertex_colours_get_an_alpha(spied: Any) -> None:
    (call,) = spied(scene_of(triangle(colors=np.full((3, 3), 0.5))), "add_mesh")
    assert call["colors"].tolist() == [[0.5, 0.5, 0.5, 1.0]] * 3


def test_transforms_become_matrices(spied: Any) -> None:
    moving = triangle(transform=dl.translate(1, 2, 3), transform1=dl.translate(1, 2, 4))
    (call,) = spied(scene_of(moving), "place_mesh")
    assert call["transform"].dtype == np.float32
    assert call["transform"].tolist() == [[1, 0, 0, 1], [0, 1, 0, 2], [0, 0, 1, 3]]
    assert call["transform1"][2, 3] == 4


def test_quads_and_boxes_face_outwards(spied: Any) -> None:
    (call,) = spied(scene_of(dl.shapes.box((-1, -2, -3), (1, 2, 3))), "add_mesh")
    corners = call["positions"][call["indices"]]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    assert (np.sum(normals * corners.mean(axis=1), axis=1) > 0).all()
    area = np.linalg.norm(normals, axis=1).sum() / 2
    assert area == 2 * (2 * 4 + 4 * 6 + 2 * 6)
    (call,) = spied(scene_of(dl.shapes.quad((0, 0, 0), (2, 0, 0), (0, 3, 0))), "add_mesh")
    assert call["positions"].tolist() == [[0, 0, 0], [2, 0, 0], [2, 3, 0], [0, 3, 0]]
    assert call["uvs"].tolist() == [[0, 0], [1, 0], [1, 1], [0, 1]]


def test_environment_image(spied: Any) -> None:
    scene = scene_of(triangle())
    scene.environment = dl.environments.image(
        np.full((2, 4, 3), 255, np.uint8), strength=2, transform=dl.rotate("y", 90)
    )
    (call,) = spied(scene, "set_environment")
    assert call["image"].shape == (2, 4, 3)
    assert call["image"].dtype == np.float32
    assert (call["image"] == 1).all()
    assert call["1"] == {"strength": 2.0}


def test_a_scene_without_camera_and_light_gets_them_with_a_note() -> None:
    scene = dl.Scene()
    scene.add(triangle())
    compiled = scene.compile()
    assert compiled.cameras == {"default": 0}
    assert [note.split(":")[0] for note in compiled.notes] == ["no camera in the scene", "no light in the scene"]
    assert scene.cameras == {}
    assert scene.environment is None
    scene.add(triangle(material=dl.materials.emissive()))
    assert [note.split(":")[0] for note in scene.compile().notes] == ["no camera in the scene"]


@pytest.mark.parametrize("size", [(100, 100), (400, 100), (100, 400)])
def test_the_added_camera_frames_the_scene(size: tuple[int, int]) -> None:
    from destello.defaults import VFOV, ensure_camera

    scene = dl.Scene()
    scene.film.width, scene.film.height = size
    scene.add(dl.shapes.sphere((5, 6, 7), 2), dl.shapes.sphere((9, 6, 7), 1))
    ensure_camera(scene)
    camera = scene.camera
    assert camera is not None
    low, high = scene.bounds() or pytest.fail("no bounds")
    origin, target = np.array(camera["origin"]), np.array(camera["target"])
    assert np.allclose(target, (low + high) / 2)
    distance, radius = np.linalg.norm(target - origin), np.linalg.norm(high - low) / 2
    half = np.arctan(np.tan(np.radians(VFOV / 2)) * min(1, size[0] / size[1]))
    assert 1 < distance * np.sin(half) / radius < 1.1


def test_fingerprint() -> None:
    def scene(color: float) -> dl.Scene:
        return scene_of(triangle(material=dl.materials.diffuse(color)))

    assert scene(0.5).compile().fingerprint == scene(0.5).compile().fingerprint != scene(0.25).compile().fingerprint


# --- what is refused --------------------------------------------------------------------------------------------------
BAD_MESHES: list[tuple[dict[str, Any], str, str]] = [
    ({"positions": [[0, 0, 0], [1, 0, 0], [0, np.nan, 0]]}, ".positions[2]", "not a finite number"),
    ({"positions": [[np.inf, 0, 0], [1, 0, 0], [0, 1, 0]]}, ".positions[0]", "not a finite number"),
    ({"positions": [[1e39, 0, 0], [1, 0, 0], [0, 1, 0]]}, ".positions[0]", "not a finite number"),
    ({"indices": [[0, 1, 2], [0, 1, 3]]}, ".indices[1]", "does not exist"),
    ({"indices": np.zeros((0, 3), int)}, "", "empty"),
    ({"positions": np.zeros((0, 3))}, "", "empty"),
    ({"normals": np.eye(3)[:2]}, ".normals", "2 normals for 3 vertices"),
    ({"uvs": np.zeros((4, 2))}, ".uvs", "4 uvs for 3 vertices"),
    ({"uvs": [[0, 0], [0, np.nan], [0, 0]]}, ".uvs[1]", "not a finite number"),
    ({"positions1": np.zeros((2, 3))}, ".positions1", "2 positions1 for 3 vertices"),
    ({"normals1": np.eye(3)}, ".normals1", "without normals"),
    ({"colors": [[0, 0, 0, 0], [0, 0, 0, 0], [np.nan, 0, 0, 0]]}, ".colors[2]", "not a finite number"),
]


@pytest.mark.parametrize(("changes", "place", "said"), BAD_MESHES)
def test_bad_meshes(changes: dict[str, Any], place: str, said: str) -> None:
    mesh = dl.shapes.mesh(**({"positions": np.eye(3), "indices": [[0, 1, 2]]} | changes), name="wheel")
    error = problem(scene_of(triangle(), mesh))
    assert isinstance(error, SceneError)
    assert error.place == f"shapes[1] (wheel){place}"
    assert said in error.problem
    assert error.exit_code == 2


def test_degenerate_triangles_are_left_out_and_counted() -> None:
    positions = [[0, 0, 0], [1, 0, 0], [0, 1, 0], [2, 0, 0]]
    mesh = dl.shapes.mesh(positions, [[0, 1, 2], [0, 0, 1], [0, 1, 3]], name="bad")
    compiled = scene_of(mesh).compile()
    assert compiled.stats["triangles"] == 1
    assert compiled.notes == ["2 triangles without area left out (shapes[0] (bad))"]


def test_bad_spheres() -> None:
    assert problem(scene_of(dl.shapes.spheres(np.zeros((0, 3)), []))).place == "shapes[0]"
    assert problem(scene_of(dl.shapes.spheres(np.zeros((2, 3)), [1]))).place == "shapes[0].radii"
    assert problem(scene_of(dl.shapes.spheres(np.zeros((2, 3)), [1, 0]))).place == "shapes[0].radii[1]"
    assert problem(scene_of(dl.shapes.spheres([[0, 0, np.nan]], [1]))).place == "shapes[0].centers[0]"
    assert (
        problem(scene_of(dl.shapes.spheres([[0, 0, 0]], [1], centers1=np.zeros((2, 3))))).place == "shapes[0].centers1"
    )


def test_what_the_core_refuses_has_a_place() -> None:
    error = problem(scene_of(triangle(), dl.lights.spot(position=(0, 0, 0), target=(0, 0, 0), name="lamp")))
    assert isinstance(error, SceneError)
    assert error.place == "lights[0] (lamp)"


def test_validation_comes_first() -> None:
    assert problem(scene_of(dl.shapes.instance("gone"))).place == "shapes[0].group"


def test_errors_name_the_file_of_the_scene(tmp_path: Path) -> None:
    path = tmp_path / "s.yaml"
    scene_of(dl.shapes.mesh([[0, 0, 0], [1, 0, 0], [0, np.nan, 0]], [[0, 1, 2]])).save(path)
    error = problem(dl.load(path))
    assert str(error).startswith(f"{path}: shapes[0].positions[2]: not a finite number")


# --- files ------------------------------------------------------------------------------------------------------------
def test_missing_images_are_told_together_or_replaced(tmp_path: Path, spied: Any) -> None:
    scene = scene_of(
        triangle(material=dl.materials.diffuse(dl.textures.image("a.png"), roughness=dl.textures.image("b.png"))),
        triangle(material=dl.materials.diffuse(dl.textures.image("a.png"), normal_map=dl.textures.image("c.png"))),
    )
    scene.environment = dl.environments.image("sky.hdr")
    scene.base_dir = tmp_path
    error = problem(scene)
    assert isinstance(error, MissingFileError)
    assert error.paths == ["a.png", "b.png", "c.png", "sky.hdr"]
    (call,) = spied(scene, "add_image", allow_missing=True)
    assert call["0"][0, :2].tolist() == [[255, 0, 255], [0, 0, 0]]
    materials = [args["1"] for name, args in Spy.calls if name == "add_material"]
    assert all(
        "reflectance" in params and "roughness" not in params and "normal_map" not in params for params in materials
    )
    scene.allow_missing = True
    notes = scene.compile().notes
    assert [note.split(":")[0] for note in notes] == [
        f"missing image {n}" for n in ("a.png", "b.png", "c.png", "sky.hdr")
    ]


def test_images_are_read_once(tmp_path: Path, spied: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    read: list[Path] = []

    def fake(path: Path) -> Any:
        read.append(path)
        return np.zeros((2, 2, 3), np.uint8)

    monkeypatch.setattr("destello.images.read_texels", fake)
    (tmp_path / "a.png").write_bytes(b"")
    (tmp_path / "link.png").symlink_to(tmp_path / "a.png")
    materials = [
        dl.materials.diffuse(dl.textures.image(name), roughness=r)
        for name in ("a.png", "./a.png", "link.png")
        for r in (0, 1)
    ]
    scene = scene_of(*(triangle(material=m) for m in materials))
    assert len(spied(scene, "add_image", base_dir=tmp_path)) == 1
    assert read == [(tmp_path / "a.png").resolve()]


def test_external_files(tmp_path: Path) -> None:
    (tmp_path / "inner").mkdir()
    scene = scene_of(triangle(material=dl.materials.diffuse(dl.textures.image("../a.png"))))
    scene.base_dir = tmp_path / "inner"
    assert isinstance(problem(scene), MissingFileError)
    scene.allow_external = False
    error = problem(scene)
    assert isinstance(error, InputError)
    assert error.place == "shapes[0].material.reflectance.path"


def test_damaged_images(tmp_path: Path) -> None:
    (tmp_path / "a.png").write_text("no image")
    scene = scene_of(triangle(material=dl.materials.diffuse(dl.textures.image("a.png"))))
    error = problem(scene, base_dir=tmp_path)
    assert error.file == str(tmp_path / "a.png")
    assert error.place == "shapes[0].material.reflectance.path"
