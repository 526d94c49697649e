"""Texels on CUDA, read through texture objects, are the host's: every format, channel count, wrap mode, level, tile."""

from __future__ import annotations

import itertools
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import destello as dl
from destello import _core
from destello.live import LiveScene
from scene_files import write_image

WIDTH, HEIGHT, SPP = 192, 128, 16
KINDS = (np.uint8, np.uint16, np.float16, np.float32)
DEVICES = ("cpu", "cuda:0")


def texels(kind: Any, channels: int, shape: tuple[int, int], seed: int) -> NDArray[Any]:
    x = np.random.default_rng(seed).random((*shape, channels), np.float32)
    return x.astype(kind) if np.issubdtype(kind, np.floating) else (x * np.iinfo(kind).max).astype(kind)


def wall(pictures: list[Any], parameter: str) -> dl.Scene:
    """Squares in rows of four, each with its picture, lit by themselves or by an even sky."""
    s = dl.Scene(name="wall")
    rows = len(pictures) // 4
    s.film.width, s.film.height = WIDTH, HEIGHT
    s.camera = dl.cameras.perspective(origin=(2, rows / 2, 4), target=(2, rows / 2, 0), vfov=60)
    for i, picture in enumerate(pictures):
        material = dl.materials.diffuse(**{"reflectance": 0.0, parameter: picture})
        s.add(dl.shapes.quad((i % 4, i // 4, 0), (0.9, 0, 0), (0, 0.9, 0), material=material))
    s.environment = dl.environments.constant() if parameter == "reflectance" else None
    return s


def rendered(scene: dl.Scene, device: str, **settings: Any) -> NDArray[np.float64]:
    film = _core.Film(WIDTH, HEIGHT)
    _core.Renderer(scene.compile().core, device).render(film, 0, 0, SPP, {"seed": 3, "max_depth": 2, **settings})
    return np.asarray(film.mean())


def assert_same(scene: dl.Scene, **settings: Any) -> None:
    a, b = (rendered(scene, device, **settings) for device in DEVICES)
    assert a.std() > 0.05
    assert np.mean(np.abs(a - b) > 2e-6) < 0.02  # rays on the edge of a square, or of a texel without filter


@pytest.mark.cuda
@pytest.mark.parametrize("execution", ["fused", "queues"])
@pytest.mark.parametrize("space", ["srgb", "linear"])
@pytest.mark.parametrize("wrap", ["repeat", "clamp", "mirror"])
def test_formats_and_wraps(wrap: str, space: str, execution: str) -> None:
    looks = {"color_space": space, "wrap_u": wrap, "wrap_v": wrap, "uv_scale": (2.5, 2.2), "uv_offset": (-0.7, -0.6)}
    pictures = [
        dl.textures.image(texels(kind, n, (7, 5), 4 * i + n), filter=("bilinear", "nearest")[(i + n) % 2], **looks)
        for i, (kind, n) in enumerate(itertools.product(KINDS, (1, 2, 3, 4)))
    ]
    assert_same(wall(pictures, "emission"), execution=execution)


@pytest.mark.cuda
@pytest.mark.parametrize("shape", [(256, 256), (300, 77)])
def test_mip_maps(shape: tuple[int, int]) -> None:
    """Seen from afar: 8 and more texels a pixel."""
    pictures = [
        dl.textures.image(texels(kind, n, shape, n), uv_scale=(4, 3))
        for kind, n in itertools.product(KINDS, (1, 2, 3, 4))
    ]
    assert_same(wall(pictures, "reflectance"), light_sampling="bsdf")


@pytest.mark.cuda
def test_pictures_that_share_texels_and_tiles(tmp_path: Path) -> None:
    """One picture read in five ways; tiles of different sizes, one missing."""
    shared = texels(np.uint8, 3, (128, 64), 1)
    ways: list[dict[str, Any]] = [{}, {"filter": "nearest"}, {"wrap_u": "clamp"}, {"uv_scale": (3, 3)}]
    pictures = [dl.textures.image(shared, **way) for way in ways]
    pictures += [dl.textures.image(texels(np.uint8, 3, (9, 9), 2)), dl.textures.image(shared, color_space="linear")]
    tiles = [texels(np.uint8, 3, shape, shape[0]) for shape in ((16, 16), (80, 80), (4, 4))]
    s = wall([*pictures, *pictures[:2]], "emission")
    for number, tile in zip((1001, 1002, 1011), tiles, strict=True):
        write_image(tmp_path / f"tile.{number}.png", tile)
    udim = dl.textures.image(str(tmp_path / "tile.<UDIM>.png"))
    square = dl.shapes.mesh(
        [(0, 2, 0), (2, 2, 0), (2, 4, 0), (0, 4, 0)], [(0, 1, 2), (0, 2, 3)],
        uvs=np.array([(0, 0), (2, 0), (2, 2), (0, 2)], np.float32),
        material=dl.materials.diffuse(reflectance=0.0, emission=udim),
    )  # fmt: skip
    s.add(square)
    s.camera = dl.cameras.perspective(origin=(2, 2, 5), target=(2, 2, 0), vfov=60)
    assert_same(s)


@pytest.mark.cuda
def test_pictures_that_come_while_it_renders() -> None:
    pictures = [dl.textures.image(texels(np.uint8, 3, (16, 16), i)) for i in range(4)]
    films = []
    for device in DEVICES:
        live = LiveScene(wall(pictures, "emission"), device)
        film = live.film(WIDTH, HEIGHT)
        live.render(film, 1)
        late = dl.textures.image(texels(np.uint16, 4, (70, 90), 9))
        live.set_material(live.scene.shapes[1], dl.materials.diffuse(reflectance=0.0, emission=late))
        film = live.film(WIDTH, HEIGHT)
        live.render(film, SPP)
        films.append(np.asarray(film.mean()))
    assert np.quantile(np.abs(films[0] - films[1]), 0.99) < 2e-6


@pytest.mark.cuda
def test_texels_take_no_more_memory_than_on_the_host() -> None:
    picture = texels(np.uint8, 3, (1024, 2048), 1)
    counts = []
    for image in (picture[:4, :4], picture):
        scene = wall([dl.textures.image(image)] * 4, "emission").compile().core
        _core.device_memory(forget_peak=True)
        renderer = _core.Renderer(scene, "cuda:0")
        counts.append(_core.device_memory()["device"])
        del renderer
    assert counts[1] - counts[0] == pytest.approx(picture.nbytes * 4 / 3, rel=0.01)


@pytest.mark.cuda
def test_too_wide_for_the_device() -> None:
    wide = dl.textures.image(np.zeros((1, 140_000), np.uint8), filter="nearest")
    with pytest.raises(RuntimeError, match=r"140000 x 1 texels: .* at most, these need 1 rows.*--device cpu"):
        rendered(wall([wide] * 4, "emission"), "cuda:0")
