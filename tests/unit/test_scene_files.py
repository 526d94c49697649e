"""Files that a scene refers to: where they may be, what is missing, images in every number type."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import destello as dl
from destello.errors import FormatError, ImageTooLarge, InputError, MissingFileError
from destello.files import ResolvedFiles
from destello.images import alpha_is_associated, linear_rgb, missing_image, read_texels, repaired, unassociated
from scene_files import write_image


# --- paths ------------------------------------------------------------------------------------------------------------
def test_paths_inside(tmp_path: Path) -> None:
    inner = tmp_path / "scene" / "maps"
    inner.mkdir(parents=True)
    (inner / "a.png").write_bytes(b"x")
    files = ResolvedFiles(tmp_path / "scene")
    for name in ("maps/a.png", "./maps/../maps/a.png", str(inner / "a.png")):
        assert files.find(name) == (inner / "a.png").resolve()
    files.finish()


def test_paths_outside(tmp_path: Path) -> None:
    base = tmp_path / "scene"
    base.mkdir()
    (tmp_path / "secret.txt").write_text("x")
    (base / "link.txt").symlink_to(tmp_path / "secret.txt")
    (base / "folder").symlink_to(tmp_path)
    files = ResolvedFiles(base, scene_file=base / "s.yaml")
    outside = ["../secret.txt", str(tmp_path / "secret.txt"), "link.txt", "folder/secret.txt", "/etc/passwd", "../gone"]
    for name in outside:
        with pytest.raises(InputError) as caught:
            files.find(name, "shapes[0].path")
        assert caught.value.place == "shapes[0].path"
        assert caught.value.file == str(base / "s.yaml")
        assert caught.value.value == name
        assert "--allow-external" in str(caught.value)
    external = ResolvedFiles(base, allow_external=True)
    for name in outside[:4]:
        assert external.find(name) == (tmp_path / "secret.txt").resolve()


def test_missing_files_are_told_together(tmp_path: Path) -> None:
    (tmp_path / "loop1").symlink_to(tmp_path / "loop2")
    (tmp_path / "loop2").symlink_to(tmp_path / "loop1")
    files = ResolvedFiles(tmp_path)
    names = ["a.png", "b.png", "", "x" * 5000, "nul\0.png", "loop1", "\ud800"]
    for name in [*names, "a.png"]:
        assert files.find(name) is None
    assert files.missing == names
    with pytest.raises(MissingFileError) as caught:
        files.finish()
    assert caught.value.paths == names
    assert "7 missing files: a.png, b.png" in str(caught.value)
    ResolvedFiles(tmp_path, allow_missing=True, missing=["a"]).finish()


def test_special_files_are_no_files(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    assert ResolvedFiles(tmp_path).find("pipe") is None
    assert ResolvedFiles(tmp_path, allow_external=True).find("/dev/zero") is None


# --- images -----------------------------------------------------------------------------------------------------------
@pytest.mark.parametrize("channels", [1, 2, 3, 4])
@pytest.mark.parametrize("kind", ["uint8", "uint16"])
def test_integer_images_keep_their_numbers(tmp_path: Path, kind: str, channels: int, rng: np.random.Generator) -> None:
    texels = rng.integers(0, np.iinfo(kind).max, (5, 7, channels), dtype=kind, endpoint=True)
    read = read_texels(write_image(tmp_path / "a.png", texels))
    assert read.dtype == kind
    assert np.array_equal(read, texels)


def test_float_images(tmp_path: Path, rng: np.random.Generator) -> None:
    texels = rng.random((4, 6, 3), dtype=np.float32) * 100
    assert np.array_equal(read_texels(write_image(tmp_path / "a.exr", texels)), texels)
    half = texels.astype(np.float16)
    assert np.array_equal(read_texels(write_image(tmp_path / "b.exr", half)), half.astype(np.float32))
    hdr = read_texels(write_image(tmp_path / "c.hdr", texels))
    assert np.allclose(hdr, texels, atol=1)


def test_exr_channels_go_by_name(tmp_path: Path) -> None:
    texels = np.zeros((2, 2, 5), np.float32)
    texels[:] = [1, 2, 3, 4, 5]
    read = read_texels(write_image(tmp_path / "a.exr", texels, names=("A", "B", "G", "R", "Z")))
    assert read.shape == (2, 2, 4)
    assert read[0, 0].tolist() == [4, 3, 2, 1]


LAYERS = ("AO.R", "AO.G", "AO.B", "All.R", "All.G", "All.B", "All.A", "Depth.Z", "Normal.X", "Normal.Y", "Normal.Z")


@pytest.mark.parametrize(
    ("names", "taken"),
    [
        (LAYERS, (3, 4, 5, 6)),  # Blender's: each layer a pass
        (("Z", "diffuse.R", "diffuse.G", "diffuse.B"), (1, 2, 3)),
        ((*LAYERS[:3], "R", "G", "B"), (3, 4, 5)),
        ((*LAYERS[:3], "Y"), (3,)),
        (("X", "Y", "Z"), (0, 1, 2)),
    ],
)
def test_exr_layers_are_not_mixed(tmp_path: Path, names: tuple[str, ...], taken: tuple[int, ...]) -> None:
    texels = np.zeros((2, 2, len(names)), np.float32)
    texels[:] = np.arange(len(names))
    assert read_texels(write_image(tmp_path / "a.exr", texels, names=names))[0, 0].tolist() == list(taken)


@pytest.mark.parametrize("corner", [(1, 2), (-2, -1), (0, 3), (9, 9), (-9, 0)])
def test_an_exr_is_as_large_as_its_display_window(tmp_path: Path, corner: tuple[int, int]) -> None:
    oiio = pytest.importorskip("OpenImageIO")
    spec = oiio.ImageSpec(4, 3, 1, "float")
    spec.x, spec.y = corner
    spec.full_width, spec.full_height = 6, 5
    out = oiio.ImageOutput.create(str(tmp_path / "a.exr"))
    assert out.open(str(tmp_path / "a.exr"), spec)
    texels = np.arange(1, 13, dtype=np.float32).reshape(3, 4)
    assert out.write_image(texels[..., np.newaxis])
    out.close()
    want = np.zeros((40, 40), np.float32)
    want[20 + corner[1] :, 20 + corner[0] :][:3, :4] = texels
    assert np.array_equal(read_texels(tmp_path / "a.exr")[..., 0], want[20:25, 20:26])


def test_dividing_by_alpha() -> None:
    texels = np.array([[[0.25, 0.5, 1, 0.5], [0.125, 0, 0, 0], [3, 2, 1, 1], [1e4, 1, 1, 1e-4]]], np.float16)
    divided = [[[0.5, 1, 2, 0.5], [0.125, 0, 0, 0], [3, 2, 1, 1], [65504, 1e4, 1e4, 1e-4]]]
    np.testing.assert_allclose(unassociated(texels), np.array(divided, np.float16), rtol=2e-3)
    codes = np.array([[[50, 128], [10, 0], [200, 100], [7, 255]]], np.uint8)
    assert unassociated(codes).tolist() == [[[100, 128], [10, 0], [255, 100], [7, 255]]]


def shown(folder: Path, *, environment: bool = False, **emissive: Any) -> float:
    """What a camera sees that looks at nothing but a glowing square, or at the sky."""
    scene = dl.Scene()
    scene.camera = dl.cameras.perspective(origin=(0.5, 0.5, 1), target=(0.5, 0.5, 0), vfov=10)
    scene.environment = dl.environments.constant(0)
    if environment:
        scene.environment = dl.environments.image(image=dl.textures.image("a.exr"))
    else:
        square = dl.shapes.quad(corner=(0, 0, 0), u=(1, 0, 0), v=(0, 1, 0), material=dl.materials.emissive(**emissive))
        scene.add(square)
    scene.base_dir = folder
    picture = dl.render(scene, size=(8, 8), spp=256, device="cpu", progress=False).array
    return float(picture.mean())


def test_colors_of_associated_files_are_divided_by_alpha(tmp_path: Path) -> None:
    write_image(tmp_path / "a.exr", np.full((2, 2, 4), (0.25, 0.25, 0.25, 0.5), np.float32))
    image = dl.textures.image("a.exr")
    assert shown(tmp_path, radiance=image) == pytest.approx(0.5)
    opacity = dl.textures.scaled(image, channel="a")
    assert shown(tmp_path, radiance=image, opacity=opacity) == pytest.approx(0.25, abs=0.005)
    assert shown(tmp_path, radiance=dl.textures.image("a.exr", color_space="raw")) == pytest.approx(0.25)
    assert shown(tmp_path, environment=True) == pytest.approx(0.25)  # light from all around has no cover


def test_only_exr_and_tiff_may_have_associated_alpha(tmp_path: Path) -> None:
    texels = np.full((2, 2, 4), (50, 50, 50, 128), np.uint8)
    for name, associated in (("a.png", False), ("a.tif", False), ("a.exr", True), ("a.tga", False)):
        path = write_image(tmp_path / name, texels.astype(np.float16) / 255 if associated else texels)
        assert alpha_is_associated(path) == associated, name
    path = write_image(tmp_path / "b.tif", texels, associated=True)
    assert alpha_is_associated(path)
    assert not alpha_is_associated(write_image(tmp_path / "c.exr", np.ones((2, 2, 3), np.float16)))


def test_bad_images(tmp_path: Path) -> None:
    (tmp_path / "text.png").write_text("not an image")
    (tmp_path / "empty.exr").write_bytes(b"")
    whole = write_image(tmp_path / "whole.png", np.zeros((64, 64, 3), np.uint8)).read_bytes()
    (tmp_path / "cut.png").write_bytes(whole[: len(whole) // 2])
    for name in ("text.png", "empty.exr", "cut.png"):
        with pytest.raises(FormatError) as caught:
            read_texels(tmp_path / name)
        assert caught.value.file == str(tmp_path / name)
        assert "\n" not in str(caught.value)


def test_size_is_checked_before_memory_is_taken(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = write_image(tmp_path / "a.png", np.zeros((8, 4, 3), np.uint8))
    monkeypatch.setattr("destello.images.LARGEST_BYTES", 8 * 4 * 3)
    read_texels(path)
    monkeypatch.setattr("destello.images.LARGEST_BYTES", 8 * 4 * 3 - 1)
    with pytest.raises(ImageTooLarge) as caught:
        read_texels(path)
    assert (caught.value.file, caught.value.value) == (str(path), (4, 8))
    monkeypatch.setattr("destello.images.LARGEST_SIDE", 7)
    with pytest.raises(ImageTooLarge):
        read_texels(path)
    (tmp_path / "bomb.ppm").write_bytes(b"P6\n60000 60000\n255\n" + b"\0" * 100)
    with pytest.raises(FormatError):
        read_texels(tmp_path / "bomb.ppm")


def test_repair_and_linear() -> None:
    for kind in (np.float16, np.float32):
        fixed, bad = repaired(np.array([[[np.nan, np.inf, -np.inf], [1, -2, 3]]], kind))
        assert bad == 3
        assert fixed.dtype == kind
        assert fixed.tolist() == [[[0, 0, 0], [1, -2, 3]]]
        assert linear_rgb(fixed, "auto").tolist() == [[[0, 0, 0], [1, 0, 3]]]
    grey = np.array([[[255, 7]]], np.uint8)
    assert linear_rgb(grey, "auto").tolist() == [[[1, 1, 1]]]
    half = np.full((1, 1, 3), 128, np.uint8)
    assert np.allclose(linear_rgb(half, "auto"), 0.2158605)
    assert np.allclose(linear_rgb(half, "linear"), 128 / 255)
    assert np.allclose(linear_rgb(half.astype(np.uint16) * 257, "srgb"), 0.2158605, atol=1e-6)
    assert missing_image()[0, :2].tolist() == [[255, 0, 255], [0, 0, 0]]


# --- load() -----------------------------------------------------------------------------------------------------------
def test_load_says_what_it_knows(tmp_path: Path) -> None:
    (tmp_path / "a.xyz").write_text("")
    cases: list[tuple[Any, type[Exception], str]] = [
        (tmp_path / "a.xyz", FormatError, "unknown scene format: '.xyz' (accepted: .glb"),
        (tmp_path / "gone.yaml", MissingFileError, "missing file"),
        ("gone", MissingFileError, "built-in scene"),
        ("book", MissingFileError, "did you mean 'book"),
        (tmp_path, FormatError, "not a file"),
        ("nul\0.yaml", MissingFileError, "missing file"),
        ("x" * 5000, MissingFileError, "missing file"),
    ]
    for path, kind, said in cases:
        with pytest.raises(kind) as caught:
            dl.load(path)
        assert said in str(caught.value)
        assert caught.value.exit_code == 2  # type: ignore[attr-defined]


def test_load_builds_scenes_by_name(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert dl.load("cornell") == dl.scenes.build("cornell")
    monkeypatch.chdir(tmp_path)
    dl.Scene("mine").save("cornell.yaml")
    (tmp_path / "cornell").write_text("a file goes before a built-in scene")
    with pytest.raises(FormatError):
        dl.load("cornell")
    assert dl.load("cornell.yaml").name == "mine"


@pytest.mark.skipif(os.geteuid() == 0, reason="root may read everything")
def test_unreadable_files(tmp_path: Path) -> None:
    path = tmp_path / "a.yaml"
    dl.Scene().save(path)
    path.chmod(0)
    with pytest.raises(MissingFileError, match="ermission"):
        dl.load(path)
