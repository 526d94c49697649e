"""Scene files that mean harm, or mean nothing: only destello.Error comes out, quickly, and nothing is read or run."""

from __future__ import annotations

import io
import os
import random
import time
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import destello as dl
from destello.errors import Error, FormatError, InputError, MissingFileError
from destello.io import _yaml, native

ALIASES = "".join(f"a{i}: &a{i} [*a{i - 1}, *a{i - 1}]\n" for i in range(1, 60))
MIXES = "".join(f"  m{i}: {{type: mix, first: m{i - 1}, second: m{i - 1}}}\n" for i in range(1, 40))


def refused(path: Path, **options: Any) -> Error:
    start = time.perf_counter()
    with pytest.raises(Error) as caught:
        dl.load(path, **options)
    assert time.perf_counter() - start < 20
    assert "\n" not in str(caught.value)
    return caught.value


# --- bombs ------------------------------------------------------------------------------------------------------------
@pytest.mark.parametrize(
    ("source", "said"),
    [
        ("a0: &a0 [1, 1]\n" + ALIASES, "too many values"),
        ("shapes: " + "[" * 100_000, "nested too deeply"),
        ("shapes: " + "{a: " * 1000, "nested too deeply"),
        ("a: " + "- " * 1000, "broken YAML"),
        ("&a [*a]", "alias"),
        ("materials: &m {a: *m}", "alias"),
        (
            "materials:\n" + "".join(f"  m{i}: {{type: mix, first: m{i + 1}, second: m0}}\n" for i in range(5000)),
            "without end",
        ),
        ("shapes:\n- " + "x" * 1_000_000, "not a shape"),
        ("shapes:\n" + "- 1\n" * 20_000, "not a shape"),
        ("a: !!python/object/new:os.system [echo]", "YAML tag"),
        ("!!python/name:os.system x", "YAML tag"),
        ("%TAG ! tag:yaml.org,2002:\n---\n!python/none x", "YAML tag"),
    ],
)
def test_yaml_bombs(source: str, said: str, tmp_path: Path) -> None:
    path = tmp_path / "s.yaml"
    path.write_text(source)
    assert said in str(refused(path))


def test_json_bombs(tmp_path: Path) -> None:
    path = tmp_path / "s.json"
    for source, said in [("[" * 1_000_000, "nested too deeply"), ('{"a":' * 500, "nested too deeply")]:
        path.write_text(source + source.replace("[", "]").replace('{"a":', "}"))
        assert said in str(refused(path)) or "broken JSON" in str(refused(path))
    path.write_text('{"shapes": ' + "[" * 200 + "]" * 200 + "}")
    assert "nested too deeply" in str(refused(path))


def test_values_are_counted_before_they_are_kept(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(_yaml, "MOST_VALUES", 1000)
    path = tmp_path / "s.yaml"
    path.write_text("shapes: [" + "1, " * 2000 + "1]")
    assert "too many values" in str(refused(path))


def test_large_files_are_not_read(tmp_path: Path) -> None:
    path = tmp_path / "s.yaml"
    with path.open("wb") as file:
        file.truncate(native.MOST_BYTES + 1)
    assert "too large" in str(refused(path))


def test_shared_materials_cost_no_exponential_time(tmp_path: Path) -> None:
    path = tmp_path / "s.yaml"
    path.write_text(
        "materials:\n  m0: {type: diffuse}\n"
        + MIXES
        + "shapes:\n- {type: box, min: [0, 0, 0], max: [1, 1, 1], material: m39}"
    )
    scene = dl.load(path)
    assert len(scene.materials()) == 40
    scene.save(path)
    assert dl.load(path) == scene
    assert path.stat().st_size < 10_000


def test_no_text_reaches_the_terminal_unescaped(tmp_path: Path) -> None:
    path = tmp_path / "s.json"
    path.write_text('{"shapes": [{"type": "\\u001b[31m", "x": 1}], "\\u001b]0;t\\u0007": 3}')
    assert str(refused(path)).isprintable()


# --- other files ------------------------------------------------------------------------------------------------------
def test_nothing_outside_the_directory_is_opened(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "in").mkdir()
    secret = tmp_path / "secret.npz"
    np.savez(secret, positions=np.eye(3, dtype=np.float32), indices=np.array([[0, 1, 2]], np.uint32))
    (tmp_path / "in" / "link.npz").symlink_to(secret)
    path = tmp_path / "in" / "s.yaml"
    for name in ("../secret.npz", str(secret), "link.npz"):
        path.write_text(f"shapes:\n- {{type: mesh, data: {name}}}\n")
        error = refused(path)
        assert isinstance(error, InputError)
        assert (error.place, error.line) == ("shapes[0].data", 2)
        assert len(dl.load(path, allow_external=True).shapes) == 1
    path.write_text("shapes:\n- {type: mesh, data: /dev/zero}\n")
    assert isinstance(refused(path, allow_external=True), MissingFileError)


def npz(**members: bytes) -> bytes:
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w") as file:
        for name, data in members.items():
            file.writestr(f"{name}.npy", data)
    return out.getvalue()


def npy(shape: str, dtype: str = "'<f4'", data: bytes = b"") -> bytes:
    header = f"{{'descr': {dtype}, 'fortran_order': False, 'shape': {shape}, }}".ljust(117).encode() + b"\n"
    return b"\x93NUMPY\x01\x00" + len(header).to_bytes(2, "little") + header + data


def saved(save: Callable[..., None], **arrays: Any) -> bytes:
    out = io.BytesIO()
    save(out, **arrays)
    return out.getvalue()


TRIANGLE = {"positions": np.eye(3, dtype=np.float32), "indices": np.array([[0, 1, 2]], np.uint32)}
BAD_ARRAYS: list[tuple[bytes, str]] = [
    (b"", "not an array file"),
    (b"not a zip file", "not an array file"),
    (saved(np.savez, **TRIANGLE)[:-30], "not an array file"),
    (saved(np.savez_compressed, **TRIANGLE), "a compressed array"),
    (saved(np.savez, **TRIANGLE, other=np.zeros(3)), "an unknown array"),
    (saved(np.savez, **TRIANGLE, type=np.zeros(3)), "an unknown array"),
    (npz(positions=npy("(1000000000000, 3)"), indices=npy("(1, 3)", "'<u4'", bytes(12))), "wrong kind or size"),
    (npz(positions=npy("(3, 3)", data=bytes(10))), "cut off"),
    (npz(positions=npy("(-1, 3)", data=bytes(10))), "broken array file"),
    (npz(positions=npy("(1, 1)", "'|O'", b"\x80\x04.")), "wrong kind or size"),
    (npz(positions=npy("(1, 1)", "'|V9'", bytes(9))), "wrong kind or size"),
    (npz(positions=npy("__import__('os').system('touch /tmp/x')")), "broken array file"),
    (npz(positions=b"\x93NUMPY\x09\x00"), "broken array file"),
    (npz(positions=b"short"), "broken array file"),
    (npz(positions=npy("(1, 3)", data=bytes(12))), "indices is missing"),
    (saved(np.savez, positions=np.eye(2, dtype=np.float32), indices=TRIANGLE["indices"]), "wrong shape (2, 2)"),
    (saved(np.savez, positions=np.eye(3), indices=np.array([[0, 1, -2]])), "not whole numbers"),
]


@pytest.mark.parametrize(("content", "said"), BAD_ARRAYS, ids=[said for _, said in BAD_ARRAYS])
def test_bad_array_files(content: bytes, said: str, tmp_path: Path) -> None:
    (tmp_path / "a.npz").write_bytes(content)
    path = tmp_path / "s.yaml"
    path.write_text("shapes:\n- {type: mesh, data: a.npz}\n")
    error = refused(path)
    assert said in str(error)
    assert (error.place or "").startswith("shapes[0]")


def test_array_files_of_the_wrong_kind(tmp_path: Path) -> None:
    path = tmp_path / "s.yaml"
    np.savez(tmp_path / "a.npz", **TRIANGLE)
    path.write_text("shapes:\n- {type: mesh, data: a.npz, indices: [[0, 1, 2]]}\n")
    assert "given twice" in str(refused(path))
    path.write_text("shapes:\n- {type: mesh, data: gone.npz}\n")
    assert isinstance(refused(path, allow_missing=True), MissingFileError)
    path.write_text("shapes:\n- {type: mesh, data: 3}\n")
    assert "not the path of an array file" in str(refused(path))
    path.write_text("lights:\n- {type: point, data: a.npz}\n")
    assert "has no arrays" in str(refused(path))


def test_mesh_files_are_no_scene_files(tmp_path: Path) -> None:
    path = tmp_path / "s.yaml"
    path.write_text("shapes:\n- {type: mesh_file, path: s.yaml}\n")
    with pytest.raises(FormatError, match="not a mesh file") as caught:
        dl.load(path).compile()
    assert caught.value.place == "shapes[0].path"


# --- noise ------------------------------------------------------------------------------------------------------------
def sample(folder: Path) -> bytes:
    """A scene file with a bit of everything."""
    scene = dl.scenes.build("book2-light")
    scene.shapes.append(dl.shapes.mesh(np.eye(3), [[0, 1, 2]], transform=dl.rotate("x", 3) @ dl.matrix(np.eye(4))))
    scene.group("g", [dl.shapes.box((0, 0, 0), (1, 1, 1), material=scene.shapes[0]["material"])])
    scene.add(dl.shapes.instance("g", transform=dl.look_at((0, 0, 1), (1, 2, 3))), dl.lights.spot())
    scene.film.filter = dl.filters.mitchell()
    scene.save(folder / "sample.yaml")
    return (folder / "sample.yaml").read_bytes()


JUNK = (
    b"|[|{|*a|&a |: |- |\n|null|1e999|-1|! |'|\"|99999999999999999999|\xff\xfe|\x00|? |<<: |type|material|.nan".split(
        b"|"
    )
)


def damaged(data: bytes, rng: random.Random) -> bytes:
    """A few bytes, words or lines changed, gone, doubled or swapped."""
    out = bytearray(data)
    for _ in range(rng.randint(1, 6)):
        at, end = sorted(rng.randrange(len(out) + 1) for _ in range(2))
        end = min(end, at + rng.choice([1, 4, 40]))
        junk = rng.choice([bytes(rng.randrange(256) for _ in range(3)), *JUNK])
        out[at:end] = junk if rng.random() < 0.7 else out[at:end] * 2
    return bytes(out)


def try_to_load(path: Path, data: bytes) -> bool:
    """Whether it loads; only destello.Error may be raised."""
    path.write_bytes(data)
    told = ""
    try:
        dl.load(path).info()
    except Error as error:
        told = str(error)
    assert told.isprintable()
    return not told


@pytest.mark.fuzz
@pytest.mark.parametrize("suffix", [".yaml", ".json"])
def test_damaged_scenes(suffix: str, tmp_path: Path) -> None:
    data = sample(tmp_path)
    if suffix == ".json":
        dl.load(tmp_path / "sample.yaml").save(tmp_path / "sample.json")
        data = (tmp_path / "sample.json").read_bytes()
    assert try_to_load(tmp_path / f"s{suffix}", data)
    rng = random.Random(7)
    seconds = float(os.environ.get("DESTELLO_FUZZ_SECONDS", "5"))
    loaded = count = 0
    start = time.monotonic()
    while time.monotonic() - start < seconds or count < 50:
        loaded += try_to_load(tmp_path / f"s{suffix}", damaged(data, rng))
        count += 1
    assert loaded < count


@pytest.mark.fuzz
def test_noise(tmp_path: Path) -> None:
    rng = random.Random(11)
    for i in range(300):
        size = rng.choice([1, 10, 100, 1000])
        alphabet = b"[]{}:,-&*!|>'\"%@`?# \nabc019.~" if i % 2 else bytes(range(256))
        data = bytes(rng.choice(alphabet) for _ in range(size))
        for suffix in (".yaml", ".json"):
            try_to_load(tmp_path / f"s{suffix}", data)


@pytest.mark.fuzz
def test_damaged_array_files(tmp_path: Path) -> None:
    rng = random.Random(13)
    whole = saved(np.savez, **TRIANGLE)
    (tmp_path / "s.yaml").write_text("shapes:\n- {type: mesh, data: a.npz}\n")
    outcomes = set()
    for _ in range(400):
        data = bytearray(whole)
        for _ in range(rng.randint(1, 3)):
            data[rng.randrange(len(data))] = rng.randrange(256)
        (tmp_path / "a.npz").write_bytes(data)
        outcomes.add(try_to_load(tmp_path / "s.yaml", (tmp_path / "s.yaml").read_bytes()))
    assert outcomes == {True, False}
