"""Image files: round trips with known values, metadata, nothing half-written."""

from __future__ import annotations

import io
import os
import struct
import sys
import zlib
from pathlib import Path

import numpy as np
import pytest

import destello.image_file as image_file
from destello.color import Display, encode
from destello.errors import FormatError, InputError, MissingFileError, OutputError
from destello.image import Image
from destello.ocio import View

METADATA = {
    "scene": "cornell",
    "spp": 64,
    "seed": 3,
    "device": "cpu",
    "version": "1.2.3",
    "time": "2026-01-01T00:00:00Z",
}


@pytest.fixture
def picture() -> Image:
    """Not square, asymmetric, with values above 1, exact powers of two and black."""
    rng = np.random.default_rng(11)
    array = rng.random((13, 29, 3), dtype=np.float32) * 1.2
    array[0, 0] = [0.25, 0.5, 4.0]
    array[12, 28] = 0
    return Image(array, dict(METADATA))


def names_in(folder) -> list[str]:
    return sorted(path.name for path in folder.iterdir())


def layered(picture: Image) -> Image:
    rng = np.random.default_rng(12)
    shape = picture.array.shape
    picture.aovs = {
        "albedo": rng.random(shape, dtype=np.float32),
        "normal": rng.random(shape, dtype=np.float32) * 2 - 1,
        "depth": rng.random(shape[:2], dtype=np.float32) * 1e6,
    }
    return picture


@pytest.mark.parametrize(
    ("name", "bits"), [("a.png", 8), ("a.png", 16), ("a.ppm", 8), ("a.ppm", 16), ("a.tif", 8), ("a.TIFF", 16)]
)
@pytest.mark.parametrize("curve", ["srgb", "gamma2", "linear"])
def test_integer_formats_keep_every_code(tmp_path, picture, name, bits, curve):
    path = tmp_path / name
    picture.save(path, bits=bits, curve=curve)
    back = Image.load(path, curve=curve)
    top = 2**bits - 1
    expected = Display(curve=curve).quantise(picture.array, bits)
    assert np.array_equal(np.rint(encode(back.array, curve) * top), expected)
    assert expected[0, 0].tolist()[2] == top


def test_png_bytes_are_a_png_of_the_right_kind(tmp_path, picture):
    """Read without the library that wrote it: header, text chunks, checksums."""
    picture.save(tmp_path / "a.png")
    data = (tmp_path / "a.png").read_bytes()
    assert data[:8] == b"\x89PNG\r\n\x1a\n"
    chunks, at = [], 8
    while at < len(data):
        size, kind = struct.unpack(">I4s", data[at : at + 8])
        body = data[at + 8 : at + 8 + size]
        assert zlib.crc32(kind + body) == struct.unpack(">I", data[at + 8 + size : at + 12 + size])[0]
        chunks.append((kind, body))
        at += 12 + size
    assert chunks[0] == (b"IHDR", struct.pack(">IIBBBBB", 29, 13, 8, 2, 0, 0, 0))
    assert b"sRGB" in [kind for kind, _ in chunks]
    texts = dict(body.split(b"\0", 1) for kind, body in chunks if kind == b"tEXt")
    assert texts[b"Software"] == b"destello 1.2.3"
    for name in ("scene", "spp", "seed", "device", "version", "time"):
        assert texts[b"destello:" + name.encode()] == str(METADATA[name]).encode()


@pytest.mark.parametrize(
    ("look", "said"),
    [
        ({"curve": "srgb"}, {b"sRGB", b"gAMA", b"cHRM"}),
        ({"curve": "gamma2"}, {b"gAMA": 50000}),
        ({"curve": "gamma2.2"}, {b"gAMA": 45455}),
        ({"curve": "linear"}, {b"gAMA": 100000}),
        ({"tone": "raw"}, {b"gAMA": 100000}),
        ({"view": View("ocio://default", "sRGB - Display")}, {b"sRGB", b"gAMA", b"cHRM"}),
        ({"view": View("ocio://default", "Display P3 - Display")}, {b"cICP"}),
        ({"view": View("ocio://default", "sRGB - Display", "Raw")}, set()),
    ],
)
def test_png_says_what_its_numbers_are(tmp_path, picture, look, said):
    picture.save(tmp_path / "a.png", **look)
    data, at, found = (tmp_path / "a.png").read_bytes(), 8, {}
    while at < len(data):
        size, kind = struct.unpack(">I4s", data[at : at + 8])
        found[kind] = data[at + 8 : at + 8 + size]
        at += 12 + size
    assert found.keys() & {b"sRGB", b"gAMA", b"cHRM", b"cICP", b"iCCP"} == set(said)
    if isinstance(said, dict):
        assert struct.unpack(">I", found[b"gAMA"])[0] == said[b"gAMA"]


@pytest.mark.parametrize("bits", [16, 32])
def test_exr_keeps_linear_values_and_layers(tmp_path, picture, bits):
    import OpenImageIO as oiio

    layered(picture).save(tmp_path / "a.exr", bits=bits)
    back = Image.load(tmp_path / "a.exr")
    kind = np.float16 if bits == 16 else np.float32
    assert np.array_equal(back.array, picture.array.astype(kind).astype(np.float32))
    assert back.aovs.keys() == {"albedo", "normal", "depth"}
    for name in ("albedo", "normal"):
        assert np.array_equal(back.aovs[name], picture.aovs[name].astype(kind).astype(np.float32))
    assert np.array_equal(back.aovs["depth"], picture.aovs["depth"]), "depth is float even in a half file"
    names = oiio.ImageInput.open(str(tmp_path / "a.exr")).spec().channelnames
    assert {"R", "G", "B", "albedo.R", "normal.X", "depth.Z"} <= set(names)
    assert back.metadata["spp"] == 64
    assert back.metadata["scene"] == "cornell"


def test_half_exr_does_not_turn_bright_into_infinite(tmp_path, picture):
    picture.array[1, 1] = [1e6, -1e6, np.inf]
    picture.save(tmp_path / "a.exr")
    assert Image.load(tmp_path / "a.exr").array[1, 1].tolist() == [65504, -65504, np.inf]
    assert picture.array[1, 1, 0] == 1e6, "saving changes nothing in the picture"


def test_hdr_keeps_radiance_to_its_8_bit_mantissa(tmp_path, picture):
    picture.save(tmp_path / "a.hdr")
    back = Image.load(tmp_path / "a.hdr").array
    assert np.all(np.abs(back - picture.array) <= picture.array.max(axis=2, keepdims=True) / 128)
    assert back[0, 0].tolist() == [0.25, 0.5, 4.0]


def test_float_tiff_is_exact(tmp_path, picture):
    picture.save(tmp_path / "a.tif", bits=32)
    assert np.array_equal(Image.load(tmp_path / "a.tif").array, picture.array)


def test_jpeg_is_near_and_quality_matters(tmp_path):
    y, x = np.mgrid[0:64, 0:96].astype(np.float32) / 96
    smooth = Image(np.stack([x, y, 0.5 + 0 * x], axis=2), dict(METADATA))
    smooth.save(tmp_path / "a.jpg")
    smooth.save(tmp_path / "b.jpeg", quality=20)
    shown = smooth.to_uint8().astype(int)
    errors = [np.abs(Image.load(tmp_path / n).to_uint8() - shown).max() for n in ("a.jpg", "b.jpeg")]
    assert errors[0] <= 6
    assert (tmp_path / "b.jpeg").stat().st_size < (tmp_path / "a.jpg").stat().st_size
    assert (tmp_path / "a.jpg").read_bytes()[:3] == b"\xff\xd8\xff"


def test_ppm_p6_by_hand():
    picture = Image(np.array([[[0, 0.25, 1], [1, 1, 0]]], dtype=np.float32))
    out = io.BytesIO()
    picture.save(out, file_format="ppm", curve="gamma2")
    assert out.getvalue() == b"P6\n2 1\n255\n" + bytes([0, 128, 255, 255, 255, 0])
    out = io.BytesIO()
    picture.save(out, file_format="ppm", bits=16, curve="linear")
    assert out.getvalue() == b"P6\n2 1\n65535\n" + bytes([0, 0, 64, 0, 255, 255, 255, 255, 255, 255, 0, 0])


def test_ppm_p3_is_text_with_the_same_values(tmp_path, picture):
    picture.save(tmp_path / "a.ppm", plain=True)
    text = (tmp_path / "a.ppm").read_text()
    assert max(map(len, text.splitlines()[2:])) <= 70, "the format's limit"
    words = [word for line in text.splitlines() if not line.startswith("#") for word in line.split()]
    assert words[:4] == ["P3", "29", "13", "255"]
    assert np.array_equal(np.array(words[4:], dtype=int).reshape(13, 29, 3), picture.to_uint8())
    assert "cornell" in text.splitlines()[1]


def test_notebook_picture(picture):
    data = picture._repr_png_()
    assert data[:8] == b"\x89PNG\r\n\x1a\n"
    assert repr(picture) == "<destello.Image 29x13, 64 spp>"


@pytest.mark.parametrize("name", ["a.png", "a.exr", "a.ppm", "a.jpg"])
def test_a_failed_write_leaves_the_old_file_and_nothing_else(tmp_path, picture, name, monkeypatch):
    path = tmp_path / name
    picture.save(path)
    before = path.read_bytes()

    def full_disk(self, aside, *rest):
        aside.write_bytes(b"half a pict")
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(image_file.Target, "_write_to", full_disk)
    with pytest.raises(OutputError, match=f"{name}: cannot be written: No space left on device"):
        picture.save(path)
    assert path.read_bytes() == before
    assert names_in(tmp_path) == [name]


def test_the_old_file_is_whole_until_the_new_one_is(tmp_path, picture, monkeypatch):
    path = tmp_path / "a.png"
    path.write_bytes(b"old")
    seen = []
    write = image_file.Target._write_to

    def watch(self, aside, *rest):
        write(self, aside, *rest)
        seen.append(path.read_bytes())

    monkeypatch.setattr(image_file.Target, "_write_to", watch)
    picture.save(path)
    assert seen == [b"old"]
    assert path.read_bytes()[:4] == b"\x89PNG"
    assert names_in(tmp_path) == ["a.png"]
    umask = os.umask(0)
    os.umask(umask)
    assert path.stat().st_mode & 0o777 == 0o666 & ~umask


@pytest.mark.skipif(sys.platform == "win32", reason="symbolic links and devices")
def test_links_are_followed_and_devices_written_into(tmp_path, picture):
    (tmp_path / "real").mkdir()
    (tmp_path / "link.png").symlink_to(tmp_path / "real" / "a.png")
    picture.save(tmp_path / "link.png")
    assert (tmp_path / "link.png").is_symlink()
    assert (tmp_path / "real" / "a.png").is_file()
    picture.save("/dev/null", file_format="ppm")
    image_file.check_writable("/dev/null")
    assert not Path("/dev/null").is_file()


@pytest.mark.parametrize(
    ("name", "reason"),
    [("no/such/a.png", "no such folder"), ("folder.png", "is a folder"), ("file/a.png", "no such folder")],
)
def test_unwritable_is_known_before(tmp_path, name, reason):
    (tmp_path / "folder.png").mkdir()
    (tmp_path / "file").touch()
    target = image_file.Target.of(tmp_path / name)
    with pytest.raises(OutputError, match=reason):
        target.check_writable()
    assert names_in(tmp_path) == ["file", "folder.png"]


@pytest.mark.parametrize(
    ("name", "options", "message"),
    [
        ("a.bmp2", {}, r"unknown image format: '\.bmp2' \(accepted: \.png"),
        ("a", {}, "no extension"),
        ("a.png", {"bits": 32}, r"no such bits.*32 \(accepted: 8 or 16\)"),
        ("a.exr", {"bits": 8}, r"accepted: 16 or 32"),
        ("a.jpg", {"quality": 0}, "1 to 100"),
        ("a.png", {"plain": True}, "P3"),
        ("a.png", {"file_format": "gif"}, "unknown image format: 'gif'"),
        ("a.exr", {"tone": "agx"}, "linear radiance"),
        ("a.hdr", {"exposure": 1}, "linear radiance"),
        ("a.png", {"tone": "film"}, "unknown tone curve"),
    ],
)
def test_wrong_options(tmp_path, picture, name, options, message):
    with pytest.raises(InputError, match=message):
        picture.save(tmp_path / name, **options)
    assert names_in(tmp_path) == []


def test_a_format_by_name_beats_the_extension(tmp_path, picture):
    picture.save(tmp_path / "a.dat", file_format="exr")
    assert (tmp_path / "a.dat").read_bytes()[:4] == b"\x76\x2f\x31\x01"
    with pytest.raises(InputError, match="stream"):
        picture.save(io.BytesIO())


def test_jpeg_has_a_largest_size():
    with pytest.raises(InputError, match=r"70000x2.*65500"):
        image_file.Target.of("a.jpg").check_size(70000, 2)
    image_file.Target.of("a.png").check_size(70000, 2)


def test_loading_what_is_not_there_or_no_image(tmp_path):
    with pytest.raises(MissingFileError, match=r"a\.png"):
        Image.load(tmp_path / "a.png")
    (tmp_path / "b.png").write_bytes(b"not a picture")
    with pytest.raises(FormatError, match=r"b\.png: cannot be read as an image"):
        Image.load(tmp_path / "b.png")


def test_shape_is_checked_and_nonfinite_counted():
    with pytest.raises(InputError, match=r"\(2, 2\)"):
        Image(np.zeros((2, 2)))
    with pytest.raises(InputError, match="depth"):
        Image(np.zeros((2, 2, 3)), aovs={"depth": np.zeros((3, 2), dtype=np.float32)})
    picture = Image(np.zeros((2, 2, 3)))
    picture.array[0, 1, 2] = np.nan
    assert picture.nonfinite_pixels == 1


class TestDenoise:
    def test_removes_noise(self):
        pytest.importorskip("pyoidn")
        rng = np.random.default_rng(5)
        truth = np.zeros((96, 96, 3), dtype=np.float32)
        truth[:, 48:] = [0.8, 0.4, 0.2]
        noisy = (truth * rng.exponential(1, truth.shape)).astype(np.float32)
        noisy[3, 3] = np.nan
        clean = Image(noisy, dict(METADATA), {"albedo": truth, "normal": np.zeros_like(truth)}).denoised()
        assert np.isfinite(clean.array).all()
        assert np.mean((clean.array - truth) ** 2) < 0.1 * np.nanmean((noisy - truth) ** 2)
        assert clean.metadata["denoised"] is True

    def test_missing_package_is_named(self, monkeypatch):
        import importlib.util

        monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
        with pytest.raises(InputError, match=r"pip install 'destello\[denoise\]'"):
            Image(np.ones((4, 4, 3))).denoised()
