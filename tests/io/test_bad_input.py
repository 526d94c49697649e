"""Bad materials and textures, as whoever types `destello render` meets them: one line that says what is wrong."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

import destello as dl
from destello.cli import app
from scene_files import Gltf, write_image

SCENE = """shapes:
- type: mesh
  positions: [[0, 0, 0], [2, 0, 0], [2, 1, 0], [0, 1, 0]]
  uvs: [[0, 0], [2, 0], [2, 1], [0, 1]]
  indices: [[0, 1, 2], [0, 2, 3]]
  material: {MATERIAL}
camera: {type: orthographic, origin: [1, 0.5, 3], target: [1, 0.5, 0], height: 1}
"""


@pytest.fixture(autouse=True)
def elsewhere(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


def run(*arguments: str) -> Any:
    return CliRunner().invoke(app, [*arguments])


def render(file: str, *options: str) -> Any:
    return run("render", file, "--size", "8x4", "--spp", "1", "--tone", "raw", "-o", "o.png", *options)


def scene(material: str) -> str:
    Path("s.yaml").write_text(SCENE.replace("{MATERIAL}", material))
    return "s.yaml"


def grey(size: tuple[int, int] = (4, 4), channels: int = 3, kind: type = np.uint8) -> np.ndarray:
    return np.full((*size, channels), 100, kind)


def image(path: str) -> str:
    return f"{{type: diffuse, reflectance: {{type: image, path: {path}}}}}"


@pytest.mark.parametrize(
    ("material", "said"),
    [
        ("{type: metallic_roughness, roughness: 1.5}", ["s.yaml:6: ", ".roughness: out of range: 1.5", "from 0 to 1"]),
        ("{type: openpbr, specular_ior: 0}", [".specular_ior: out of range: 0", "0.001"]),
        ("{type: diffuse, reflectance: [0.5, 2, 0.1]}", [".reflectance: out of range: 2"]),
        ("{type: openpbr, specular_rougness: 0.2}", [".specular_rougness: ", "did you mean 'specular_roughness'?"]),
        ("{type: openbpr}", ["unknown material type: 'openbpr'", "did you mean 'openpbr'?"]),
        (
            "{type: diffuse, opacity: {type: scaled, texture: {type: image, path: grey.png}, channel: a}}",
            ["s.yaml: shapes[0].material.opacity: ", "no channel a: 'grey.png: r, g, b'", "missing_channels: fill"],
        ),
        (image("two.<UDIM>.png"), ["s.yaml: ", "other proportions: 'two.1002.png: 4 x 8'", "two.1001.png, 8 x 8"]),
        (image("kinds.<UDIM>.png"), ["another kind: 'kinds.1002.png: 1 channels of uint8'", "3 of uint8"]),
        (image("none.<UDIM>.png"), ["missing file: none.<UDIM>.png", "--allow-missing"]),
    ],
)
def test_errors(material: str, said: list[str]) -> None:
    write_image(Path("grey.png"), grey())
    for name, texels in (
        ("two.1001", grey((8, 8))),
        ("two.1002", grey((8, 4))),
        ("kinds.1001", grey()),
        ("kinds.1002", grey(channels=1)),
    ):
        write_image(Path(f"{name}.png"), texels)
    done = render(scene(material))
    assert done.exit_code == 2
    assert not Path("o.png").exists()
    (line,) = (line for line in done.stderr.splitlines() if not line.startswith(("device: ", "note: ")))
    assert line.startswith("destello: ")
    assert [words for words in said if words not in line] == []


def test_tiles_of_scene_files() -> None:
    """Two tiles beside each other, from a file: the left half dark, the right one light."""
    for number, value in ((1001, 0), (1002, 255)):
        write_image(Path(f"t.{number}.png"), np.full((4, 4, 3), value, np.uint8))
    file = scene("{type: emissive, radiance: {type: image, path: t.<UDIM>.png}, two_sided: true}")
    assert render(file).exit_code == 0
    array = dl.Image.load("o.png").array
    assert array[:, :3].max() < 0.01
    assert array[:, 5:].min() > 0.99
    dl.load(file).save("again.yaml")
    assert dl.load("again.yaml") == dl.load(file)


def test_tiles_of_obj_files() -> None:
    write_image(Path("t.1001.png"), grey())
    Path("m.mtl").write_text("newmtl m\nmap_Kd t.<UDIM>.png\n")
    Path("m.obj").write_text("mtllib m.mtl\nusemtl m\nv 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nf 1/1 2/1 3/1\n")
    assert render("m.obj").exit_code == 0
    Path("t.1001.png").unlink()
    missing = render("m.obj")
    assert (missing.exit_code, "missing file: t.<UDIM>.png" in missing.stderr) == (2, True)


def test_tiles_stay_below_the_scene() -> None:
    write_image(Path("t.1001.png"), grey())
    Path("in").mkdir()
    scene(image("../t.<UDIM>.png"))
    Path("s.yaml").rename("in/s.yaml")
    refused = render("in/s.yaml")
    assert (refused.exit_code, "--allow-external" in refused.stderr) == (2, True)
    assert render("in/s.yaml", "--allow-external").exit_code == 0


def test_what_is_no_number_is_counted_and_black() -> None:
    texels = np.full((4, 4, 3), 0.5, np.float32)
    texels[0, 0], texels[1, 1, 0] = np.nan, np.inf
    write_image(Path("n.exr"), texels)
    file = scene("{type: emissive, radiance: {type: image, path: n.exr, color_space: linear, filter: nearest}}")
    done = render(file)
    note = "n.exr: 4 values are infinite or not numbers: they count as 0"
    assert done.exit_code == 0
    assert done.stderr.count(note) == 1
    assert run("info", file).stdout.count(f"note         {note}") == 1
    array = dl.Image.load("o.png").array
    assert np.isfinite(array).all()
    assert (array[0, 0].max(), array[3, 7].min() > 0.1) == (0, True)


@pytest.mark.parametrize("kind", [np.float16, np.float32, np.float64])
def test_arrays_are_repaired_as_files_are(kind: type) -> None:
    """From a scene file's .npz, in Python, and around a scene."""
    texels = np.full((4, 4, 3), 0.5, kind)
    texels[0, 0], texels[1, 1, 0] = np.nan, -np.inf
    np.savez("n.npz", pixels=texels)
    file = scene(
        "{type: emissive, radiance: {type: image, data: n.npz, color_space: linear, filter: nearest, name: n}}"
    )
    done = render(file)
    note = "n: 4 values are infinite or not numbers: they count as 0"
    assert (done.exit_code, done.stderr.count(note)) == (0, 1)
    assert run("info", file).stdout.count(f"note         {note}") == 1
    array = dl.Image.load("o.png").array
    assert np.isfinite(array).all()
    assert (array[0, 0].max(), array[3, 7].min() > 0.1) == (0, True)
    dl.load(file).save("again.yaml")
    assert dl.load("again.yaml") == dl.load(file)

    sky = dl.Scene()
    sky.environment = dl.environments.image(image=texels)
    made = dl.render(sky, size=(8, 4), spp=1, device="cpu", progress=False)
    assert np.isfinite(made.array).all()
    assert "environment.image: 4 values are infinite or not numbers: they count as 0" in sky.compile().notes


def test_an_environment_by_its_path() -> None:
    """In place of an image texture its path will do, as the parameter says; a missing one is told."""
    write_image(Path("sky.exr"), np.full((4, 8, 3), 0.5, np.float32))
    shapes = "shapes: [{type: sphere, center: [0, 0, 0], radius: 1}]"
    Path("sky.yaml").write_text("destello: 1\nenvironment: {type: image, image: sky.exr}\n" + shapes)
    assert render("sky.yaml").exit_code == 0
    environment = dl.load("sky.yaml").environment
    assert environment is not None
    assert environment["image"]["path"] == "sky.exr"
    Path("sky.exr").unlink()
    missing = render("sky.yaml")
    assert (missing.exit_code, "missing file: sky.exr" in missing.stderr) == (2, True)


@pytest.mark.parametrize("required", [False, True])
def test_extensions(required: bool) -> None:
    g = Gltf()
    g.node(mesh=g.quad())
    for name in ("EXT_one", "EXT_two"):
        g.extend(name, required=required)
    g.glb(Path())
    done, info = render("scene.glb"), run("info", "scene.glb")
    if required:
        said = (
            "scene.glb: extensionsRequired: the file needs extensions that destello does not have: 'EXT_one, EXT_two'"
        )
        assert (done.exit_code, info.exit_code) == (2, 2)
        assert said in done.stderr
    else:
        assert (done.exit_code, done.stderr.count("ignored extensions: EXT_one, EXT_two")) == (0, 1)
        assert info.stdout.count("note         ignored extensions: EXT_one, EXT_two") == 1
