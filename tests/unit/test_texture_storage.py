"""Images in the core: mip maps, half precision, sharing, UDIM tiles, budgets, and what is wrong with them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import destello as dl
from destello import _core
from destello.errors import FormatError, InputError, MissingFileError, RenderError, SceneError
from destello.image_table import StoredImage
from destello.texture_memory import fit, read_size
from scene_files import write_image

IDENTITY = np.array([[1, 0, 0], [0, 1, 0]], np.float32)


def lookup(
    texels: Any, uv: Any, footprint: float, *, srgb: bool = False, wrap: str = "repeat", mips: bool = True
) -> Any:
    """(N, 3) linear values of an image at uv (N, 2)."""
    textures = _core.testing.TextureSet()
    image = textures.add_image(
        np.ascontiguousarray(texels), srgb=srgb, wrap_u=wrap, wrap_v=wrap, bilinear=True, uv_transform=IDENTITY,
        mip_maps=mips,
    )  # fmt: skip
    texture = textures.add_texture("image", {"image": float(image)})
    uv = np.ascontiguousarray(uv, np.float32)
    n = len(uv)
    return textures.eval(
        {"texture": texture}, positions=np.zeros((n, 3), np.float32), uvs=uv, colors=np.ones((n, 4), np.float32),
        as_scalar=False, footprint=footprint,
    )  # fmt: skip


def decoded(texels: Any) -> Any:
    x = texels / np.iinfo(texels.dtype).max
    return np.where(x <= 0.04045, x / 12.92, ((x + 0.055) / 1.055) ** 2.4)


@pytest.mark.parametrize("srgb", [False, True])
@pytest.mark.parametrize("kind", [np.uint8, np.uint16, np.float16, np.float32])
@pytest.mark.parametrize("shape", [(64, 64), (37, 101), (1, 9), (5, 1)])
def test_mip_maps_of_a_constant_are_constant(
    shape: tuple[int, int], kind: Any, srgb: bool, rng: np.random.Generator
) -> None:
    value = np.array([3, 77, 200, 255], np.uint8)
    texel = (value if kind == np.uint8 else value.astype(np.uint16) * 257 if kind == np.uint16 else value / 255).astype(
        kind
    )
    texels = np.broadcast_to(texel, (*shape, 4))
    uv = rng.random((200, 2))
    want = lookup(texels, uv, 0, srgb=srgb)
    for footprint in (0.01, 0.1, 0.37, 1, 50):
        got = lookup(texels, uv, footprint, srgb=srgb)
        np.testing.assert_allclose(got, want, rtol=2e-6 if kind in (np.uint8, np.float32) else 2e-3, atol=1e-6)


@pytest.mark.parametrize("shape", [(64, 32), (37, 101)])
def test_the_coarsest_level_is_the_mean_in_linear_light(shape: tuple[int, int], rng: np.random.Generator) -> None:
    for kind, srgb, tolerance in ((np.float32, False, 1e-5), (np.uint16, True, 2e-4), (np.uint8, True, 5e-3)):
        if kind == np.float32:
            texels = rng.random((*shape, 3), np.float32)
            mean = texels.astype(np.float64).mean(axis=(0, 1))
        else:
            texels = rng.integers(0, np.iinfo(kind).max, (*shape, 3), dtype=kind, endpoint=True)
            mean = decoded(texels).mean(axis=(0, 1))
        got = lookup(texels, [(0.3, 0.8)], 100, srgb=srgb)[0]
        np.testing.assert_allclose(got, mean, atol=tolerance)


def test_levels_are_means_of_their_texels(rng: np.random.Generator) -> None:
    """At footprints of 2, 4 ... texels: bilinear between box means, against NumPy; between them a straight mixture."""
    texels = rng.random((32, 32, 1), np.float32)
    uv = rng.random((500, 2)).astype(np.float32)
    levels = {1: texels}
    for k in (2, 4, 8):
        levels[k] = texels.reshape(32 // k, k, 32 // k, k, 1).mean(axis=(1, 3)).astype(np.float32)
        np.testing.assert_allclose(lookup(texels, uv, k / 32), lookup(levels[k], uv, 0, mips=False), atol=1e-5)
    between = 0.5 * (lookup(levels[2], uv, 0, mips=False) + lookup(levels[4], uv, 0, mips=False))
    np.testing.assert_allclose(lookup(texels, uv, 3 / 32), between, atol=1e-5)


@pytest.mark.parametrize("wrap", ["repeat", "clamp", "mirror"])
def test_levels_wrap_as_the_image_does(wrap: str, rng: np.random.Generator) -> None:
    texels = rng.random((16, 16, 3), np.float32)
    uv = rng.uniform(-2, 3, (500, 2)).astype(np.float32)
    half = texels.reshape(8, 2, 8, 2, 3).mean(axis=(1, 3)).astype(np.float32)
    np.testing.assert_allclose(
        lookup(texels, uv, 2 / 16, wrap=wrap), lookup(half, uv, 0, wrap=wrap, mips=False), atol=1e-5
    )


def test_magnified_images_are_what_they_were(rng: np.random.Generator) -> None:
    texels = rng.integers(0, 255, (16, 16, 3)).astype(np.uint8)
    uv = rng.uniform(-1, 2, (500, 2))
    plain = lookup(texels, uv, 0, srgb=True, mips=False)
    for footprint in (0, 1e-9, 0.03, 1 / 16, np.nan):
        np.testing.assert_array_equal(lookup(texels, uv, footprint, srgb=True), plain)


def test_all_half_precision_numbers_are_read(rng: np.random.Generator) -> None:
    values = np.arange(65536, dtype=np.uint16).view(np.float16)
    values = values[np.isfinite(values)].reshape(1, -1, 1)
    uv = np.stack([(np.arange(values.size) + 0.5) / values.size, np.full(values.size, 0.5)], 1)
    textures = _core.testing.TextureSet()
    image = textures.add_image(
        values, srgb=False, wrap_u="clamp", wrap_v="clamp", bilinear=False, uv_transform=IDENTITY
    )
    texture = textures.add_texture("image", {"image": float(image)})
    n = values.size
    got = textures.eval(
        {"texture": texture}, positions=np.zeros((n, 3), np.float32), uvs=np.ascontiguousarray(uv, np.float32),
        colors=np.ones((n, 4), np.float32), as_scalar=True,
    )[:, 0]  # fmt: skip
    np.testing.assert_array_equal(np.sort(got), np.sort(values.ravel().astype(np.float32)))


# --- pictures ---------------------------------------------------------------------------------------------------------
def horizon(texels: Any, mip_maps: bool) -> dl.Scene:
    scene = dl.Scene("horizon")
    image = dl.textures.image(texels, uv_scale=(100, 100), color_space="linear", mip_maps=mip_maps)
    floor = dl.materials.diffuse(reflectance=image)
    scene.add(dl.shapes.quad((-400, 0, 400), (800, 0, 0), (0, 0, -800), material=floor))
    scene.environment = dl.environments.constant(radiance=1)
    scene.camera = dl.cameras.perspective(origin=(0, 1.5, 0), target=(0, 1.2, -3), vfov=50)
    return scene


def test_a_checker_to_the_horizon_is_grey_sooner(device: str) -> None:
    """4 samples with mip maps are nearer to the truth than 4 without; many converge to nearly the same."""
    y, x = np.mgrid[0:512, 0:512] // 32
    checker = (((x + y) % 2) * 200 + 30).astype(np.uint8)[..., None]

    def picture(mip_maps: bool, spp: int) -> Any:
        scene = horizon(checker, mip_maps)
        return dl.render(scene, spp=spp, size=(80, 90), device=device, progress=False, max_depth=2).array[36:42, :, 0]

    truth = picture(False, 512)
    plain, filtered, many = (np.mean((picture(*how) - truth) ** 2) for how in ((False, 4), (True, 4), (True, 256)))
    assert filtered < plain / 8
    assert many < 5e-4


def test_compiled_images_share_texels(tmp_path: Path) -> None:
    texels = np.random.default_rng(1).integers(0, 255, (128, 128, 3), dtype=np.uint8)
    write_image(tmp_path / "a.png", texels)
    write_image(tmp_path / "b.png", texels)

    def size(*images: Any) -> int:
        scene = dl.Scene("shared")
        scene.base_dir = tmp_path
        for i, image in enumerate(images):
            scene.add(dl.shapes.sphere((i, 0, 0), 0.4, material=dl.materials.diffuse(reflectance=image)))
        return int(scene.compile().stats["texture_bytes"])

    one = size(dl.textures.image("a.png"))
    assert 1.33 * texels.nbytes < one < 1.34 * texels.nbytes  # no expansion: bytes stay bytes
    same = [
        dl.textures.image("a.png", wrap_u="clamp"),
        dl.textures.image("b.png"),
        dl.textures.image(texels, uv_scale=(2, 2)),
    ]
    assert size(dl.textures.image("a.png"), *same) == one
    assert size(dl.textures.image("a.png", mip_maps=False)) < texels.nbytes + 64
    half = dl.textures.image((texels / 255).astype(np.float16), mip_maps=False)
    assert size(half) < 2 * texels.nbytes + 64


# --- tiles ------------------------------------------------------------------------------------------------------------
def tiled(folder: Path, name: str = "t.<UDIM>.png") -> dl.Scene:
    scene = dl.Scene("tiles")
    scene.base_dir = folder
    quad = [(0, 0, 0), (3, 0, 0), (3, 2, 0), (0, 2, 0)]
    light = dl.materials.emissive(radiance=dl.textures.image(name, color_space="linear"), two_sided=True)
    uvs = np.array([(0, 0), (3, 0), (3, 2), (0, 2)], np.float32)
    scene.add(dl.shapes.mesh(np.float32(quad), [(0, 1, 2), (0, 2, 3)], uvs=uvs, material=light))
    scene.camera = dl.cameras.orthographic(origin=(1.5, 1, 5), target=(1.5, 1, 0), height=2)
    return scene


def tile(value: int, size: int = 4) -> Any:
    return np.full((size, size, 3), value, np.uint8)


def test_tiles_lie_where_their_numbers_say(tmp_path: Path, device: str) -> None:
    for number, size in ((1001, 4), (1002, 8), (1011, 4), (1013, 2)):
        write_image(tmp_path / f"t.{number}.png", tile(number - 1000, size))
    scene = tiled(tmp_path)
    compiled = scene.compile()
    assert any("no tile 1003, 1012" in note for note in compiled.notes)
    assert sum("no tile 1003, 1012" in note for note in scene.info()["notes"]) == 1
    got = dl.render(scene, spp=4, size=(12, 8), device=device, progress=False).array[..., 0] * 255
    cells = got.reshape(2, 4, 3, 4)[:, 1:3, :, 1:3].mean(axis=(1, 3))
    np.testing.assert_allclose(cells, [[11, 0, 13], [1, 2, 0]], atol=1e-3)
    info = scene.info()
    assert info["images"]["t.<UDIM>.png"]["tiles"] == 4


def test_tiles_lie_where_the_transform_takes_them(tmp_path: Path, device: str) -> None:
    """Also where the first tile, by which the others are found, is missing."""
    write_image(tmp_path / "t.1002.png", tile(51))
    scene = tiled(tmp_path)
    (shape,) = scene.shapes
    image = shape["material"]["radiance"].replace(uv_scale=(1.5, 1))
    scene.shapes[0] = shape.replace(material=shape["material"].replace(radiance=image))
    got = dl.render(scene, spp=4, size=(18, 12), device=device, progress=False).array[8, :, 0]
    np.testing.assert_allclose(got[1::2] * 5, [0, 0, 1, 1, 0, 0, 0, 0, 0], atol=1e-3)


def test_tiles_that_do_not_fit_are_named(tmp_path: Path) -> None:
    with pytest.raises(MissingFileError, match="UDIM"):
        tiled(tmp_path).compile()
    write_image(tmp_path / "t.1001.png", tile(1))
    write_image(tmp_path / "t.1002.png", np.full((4, 8, 3), 1, np.uint8))
    with pytest.raises(FormatError, match=r"t.1002.png: 8 x 4.*t.1001.png, 4 x 4"):
        tiled(tmp_path).compile()
    write_image(tmp_path / "t.1002.png", np.full((4, 4, 1), 1, np.uint8))
    with pytest.raises(FormatError, match=r"t.1002.png: 1 channels of uint8"):
        tiled(tmp_path).compile()


# --- budgets ----------------------------------------------------------------------------------------------------------
def test_budgets_take_from_the_largest() -> None:
    images = [StoredImage("big", "a", 1024, 512, 4, True), StoredImage("small", "b", 256, 256, 3, False)]
    total = sum(image.bytes() for image in images)
    assert fit(images, total) == {}
    assert fit(images, total - 1) == {"a": 1}
    halvings = fit(images, 100_000)
    assert sum(image.bytes(halvings.get(image.digest, 0)) for image in images) <= 100_000
    assert halvings["a"] > halvings.get("b", 0)
    with pytest.raises(InputError, match="at least"):
        fit(images, 3)


def test_a_budget_holds_in_the_core_and_is_told(tmp_path: Path) -> None:
    texels = np.random.default_rng(1).random((256, 256, 3), np.float32)
    scene = horizon(texels, True)
    scene.add(dl.shapes.sphere((0, 9, 0), 1, material=dl.materials.diffuse(reflectance=dl.textures.image(texels[:64]))))
    full = scene.compile().stats["texture_bytes"]
    assert full > 2**20
    compiled = scene.compile(texture_budget="300k")
    assert compiled.stats["texture_bytes"] <= 300 * 1024 + 64
    assert any(
        note.startswith("texture budget of 300.0 KiB: ") and "from 256x256 to " in note for note in compiled.notes
    )
    assert compiled.fingerprint != scene.compile().fingerprint
    converted = scene.copy()
    converted.render.working_space = "acescg"
    assert converted.compile(texture_budget="300k").stats["texture_bytes"] <= 300 * 1024 + 64
    assert scene.info()["texture_bytes"] == pytest.approx(full, abs=64)
    assert "256x256 1024.0 KiB" in scene.info()["largest_textures"]


def test_a_device_without_room_names_what_is_large(monkeypatch: pytest.MonkeyPatch) -> None:
    def full(*_args: Any, **_options: Any) -> None:
        raise RuntimeError("out of memory: 1.0 GiB asked for, 0.5 GiB free")

    monkeypatch.setattr(_core, "Renderer", full)
    with pytest.raises(RenderError, match=r"0.5 GiB free.*textures need.*256x256.*--texture-budget"):
        dl.render(horizon(np.zeros((256, 256, 3), np.uint8), True), spp=1, size=(4, 4), device="cpu", progress=False)


def test_sizes_are_read() -> None:
    for text, size in {"512": 512, "1k": 1024, "1.5 MiB": 1572864, "2G": 2**31, 7: 7, "3MB": 3 << 20}.items():
        assert read_size(text) == size
    for text in ("", "-1", "0", "many", "1x", True):
        with pytest.raises(InputError, match="512M"):
            read_size(text)
    assert read_size(None) is None


# --- bad input --------------------------------------------------------------------------------------------------------
@pytest.mark.parametrize(("channels", "asked", "missing"), [(3, "a", "a"), (1, "g", "g"), (2, "b", "b"), (1, "a", "a")])
def test_a_channel_that_is_not_there_is_named(channels: int, asked: str, missing: str) -> None:
    image = dl.textures.image(np.zeros((2, 2, channels), np.uint8), name="pic")
    scene = dl.Scene("channels")
    rough = dl.textures.scaled(image, channel=asked)
    scene.add(dl.shapes.sphere((0, 0, 0), 1, material=dl.materials.diffuse(roughness=rough)))
    with pytest.raises(SceneError, match=f"no channel {missing}.*pic: r"):
        scene.compile()
    filled = dl.textures.image(np.zeros((2, 2, channels), np.uint8), missing_channels="fill")
    scene = dl.Scene("channels")
    rough = dl.textures.scaled(filled, channel=asked)
    scene.add(dl.shapes.sphere((0, 0, 0), 1, material=dl.materials.diffuse(roughness=rough)))
    scene.compile()


@pytest.mark.parametrize(
    ("kind", "params"),
    [("image", {"image": 1}), ("udim", {"first": 0, "columns": 2, "rows": 1}), ("udim", {"first": 1})],
)
def test_the_core_reads_only_images_that_there_are(kind: str, params: dict[str, float]) -> None:
    builder = _core.SceneBuilder()
    builder.add_image(np.zeros((2, 2, 3), np.uint8), srgb=False)
    with pytest.raises(ValueError, match="expected an index below 1"):
        builder.add_texture(kind, params)
    builder.add_texture(kind, {})


def test_a_grey_normal_map_is_refused() -> None:
    image = dl.textures.image(np.zeros((2, 2, 1), np.uint8))
    scene = dl.Scene("grey")
    scene.add(dl.shapes.sphere((0, 0, 0), 1, material=dl.materials.diffuse(normal_map=image)))
    with pytest.raises(SceneError, match="no channel g"):
        scene.compile()


def test_numbers_that_are_none_are_counted_once_a_file(tmp_path: Path) -> None:
    texels = np.full((4, 4, 3), 0.5, np.float32)
    texels[0, 0] = np.nan, np.inf, -np.inf
    write_image(tmp_path / "n.exr", texels)
    scene = dl.Scene("nan")
    scene.base_dir = tmp_path
    for i in range(2):
        image = dl.textures.image("n.exr", uv_scale=(i + 1, 1))
        scene.add(dl.shapes.sphere((i, 0, 0), 0.4, material=dl.materials.diffuse(reflectance=image)))
    for notes in (scene.compile().notes, scene.info()["notes"]):
        assert [note for note in notes if "n.exr" in note] == [
            "n.exr: 3 values are infinite or not numbers: they count as 0"
        ]
