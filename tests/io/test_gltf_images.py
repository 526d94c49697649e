"""glTF: image files and embedded images."""

from __future__ import annotations

import base64
from pathlib import Path

import numpy as np
import pytest

from destello.errors import FormatError, InputError, MissingFileError
from destello.io import load
from gltf_scenes import material_of
from scene_files import Gltf, corner_image, encode_image

# --- images -----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("suffix", [".png", ".webp"])
def test_embedded_images_are_exact_and_keep_alpha_apart(suffix: str, tmp_path: Path) -> None:
    texels = np.random.default_rng(1).integers(0, 256, (5, 7, 4), dtype=np.uint8)
    texels[0, 0] = (200, 100, 50, 0)
    g = Gltf()
    g.texture(encode_image(texels, suffix, tmp_path))
    if suffix == ".webp":
        g.json["textures"][0] = {"extensions": {"EXT_texture_webp": {"source": 0}}}
    image = material_of(g, tmp_path, pbrMetallicRoughness={"baseColorTexture": {"index": 0}})["base_color"]
    visible = texels[..., 3] > 0
    np.testing.assert_array_equal(image["pixels"][visible], texels[visible])
    if suffix == ".png":
        np.testing.assert_array_equal(image["pixels"], texels)


def test_embedded_jpeg_and_data_uri(tmp_path: Path) -> None:
    texels = np.full((16, 16, 3), 90, np.uint8)
    g = Gltf()
    data = base64.b64encode(encode_image(texels, ".jpg", tmp_path)).decode()
    g.add("textures", source=g.add("images", uri=f"data:image/jpeg;base64,{data}"))
    image = material_of(g, tmp_path, pbrMetallicRoughness={"baseColorTexture": {"index": 0}})["base_color"]
    np.testing.assert_allclose(image["pixels"], texels, atol=1)


def test_sixteen_bits(tmp_path: Path) -> None:
    texels = np.random.default_rng(2).integers(0, 65536, (3, 4, 3), dtype=np.uint16)
    g = Gltf()
    g.texture(encode_image(texels, ".png", tmp_path))
    image = material_of(g, tmp_path, pbrMetallicRoughness={"baseColorTexture": {"index": 0}})["base_color"]
    np.testing.assert_array_equal(image["pixels"], texels)


@pytest.mark.parametrize("uri", ["my%20tex/a%231.png", "my tex\\a%231.png"])  # the second as exporters on Windows do
def test_image_files_stay_paths(uri: str, tmp_path: Path) -> None:
    (tmp_path / "my tex").mkdir()
    (tmp_path / "my tex" / "a#1.png").write_bytes(encode_image(corner_image(), ".png", tmp_path))
    g = Gltf()
    g.add("textures", source=g.add("images", uri=uri))
    image = material_of(g, tmp_path, pbrMetallicRoughness={"baseColorTexture": {"index": 0}})["base_color"]
    assert image["path"] == "my tex/a#1.png"
    assert image["pixels"] is None


def with_images(*uris: str) -> Gltf:
    g = Gltf()
    for uri in uris:
        g.add("textures", source=g.add("images", uri=uri))
        pbr = {"baseColorTexture": {"index": len(g.json["textures"]) - 1}}
        g.node(mesh=g.quad(material=g.add("materials", pbrMetallicRoughness=pbr)))
    return g


def test_missing_images_are_listed_at_once(tmp_path: Path) -> None:
    g = with_images("one.png", "two.png")
    g.add("images", uri="unused.png")
    with pytest.raises(MissingFileError) as caught:
        load(g.glb(tmp_path))
    assert caught.value.paths == ["one.png", "two.png"]
    assert caught.value.file == str(tmp_path / "scene.glb")
    scene = load(g.glb(tmp_path), allow_missing=True)
    assert scene.allow_missing
    assert len(scene.shapes) == 2


@pytest.mark.parametrize("uri", ["../outside.png", "%2e%2e/outside.png", "/etc/hostname", "sub/../../outside.png"])
def test_files_outside_are_refused(uri: str, tmp_path: Path) -> None:
    (tmp_path / "outside.png").write_bytes(encode_image(corner_image(), ".png", tmp_path))
    (tmp_path / "in" / "sub").mkdir(parents=True)
    path = with_images(uri).glb(tmp_path / "in")
    with pytest.raises(InputError, match="allow-external"):
        load(path)
    if "etc" not in uri:
        assert load(path, allow_external=True).allow_external


def test_buffer_outside_is_refused(tmp_path: Path) -> None:
    (tmp_path / "in").mkdir()
    g = Gltf()
    g.node(mesh=g.quad())
    path = g.gltf(tmp_path / "in", buffer="../data.bin")
    with pytest.raises(InputError, match="allow-external") as caught:
        load(path)
    assert caught.value.place == "buffers[0].uri"
    assert len(load(path, allow_external=True).shapes) == 1


@pytest.mark.parametrize("uri", ["http://example.org/a.png", "file:///etc/hostname"])
def test_only_files_are_read(uri: str, tmp_path: Path) -> None:
    with pytest.raises(FormatError, match="not a file"):
        load(with_images(uri).glb(tmp_path))


@pytest.mark.parametrize(
    ("data", "message"), [(b"GIF89a..", "unknown kind of image"), (b"\x89PNG\r\n\x1a\nrubbish", "embedded image")]
)
def test_broken_embedded_image(data: bytes, message: str, tmp_path: Path) -> None:
    g = Gltf()
    g.texture(data)
    with pytest.raises(FormatError, match=message) as caught:
        material_of(g, tmp_path, pbrMetallicRoughness={"baseColorTexture": {"index": 0}})
    assert caught.value.place == "images[0]"


def test_truncated_image(tmp_path: Path) -> None:
    texels = np.random.default_rng(3).integers(0, 256, (64, 64, 3), dtype=np.uint8)
    g = Gltf()
    g.texture(encode_image(texels, ".png", tmp_path)[:3000])
    with pytest.raises(FormatError, match="embedded image") as caught:
        material_of(g, tmp_path, pbrMetallicRoughness={"baseColorTexture": {"index": 0}})
    assert "destello-" not in str(caught.value)  # no temporary file's name
