"""Volumes from files: OpenVDB and NumPy; damaged and hostile ones."""

from __future__ import annotations

import builtins
import contextlib
import sys
import types

import numpy as np
import pytest

import destello as dl
import vdb_file
from destello import volume_files
from destello.errors import Error, FormatError, InputError, MissingFileError, SceneError
from fuzz_readers import damaged

tinyvdb = pytest.importorskip("tinyvdb")


@pytest.fixture
def smoke(tmp_path):
    path = tmp_path / "smoke.vdb"
    path.write_bytes(vdb_file.vdb_bytes())
    return path


def test_vdb_density_and_place(smoke):
    grid = dl.volumes.load(smoke)
    values = vdb_file.density()
    x, y, z = np.nonzero(values)
    first = np.array([x.min(), y.min(), z.min()])
    found = grid["density"][..., 0]
    inside = values[x.min() : x.max() + 1, y.min() : y.max() + 1, z.min() : z.max() + 1]
    assert np.array_equal(found[1:-1, 1:-1, 1:-1].transpose(2, 1, 0), inside)
    border = found.copy()
    border[1:-1, 1:-1, 1:-1] = 0
    assert not border.any()
    # The middle of the first voxel that is not in the border, in the world.
    corner = grid["transform"].matrix @ (*(np.array(grid["min"]) + 1.5), 1)
    np.testing.assert_allclose(corner[:3], (first + np.array([-2, 3, 5])) * 0.5 + np.array([1, 2, 3]))
    assert dl.volumes.load(smoke, transform=dl.translate(1, 0, 0))["transform"].matrix[0, 3] == 2


@pytest.mark.parametrize("where", ["root", "upper", "lower"])
def test_vdb_active_tiles_are_refused(where, smoke, monkeypatch):
    """tinyvdb counts them but does not give them: nothing may be missing silently."""
    monkeypatch.setattr(volume_files, "_OWN_MODULES", ())
    smoke.write_bytes(vdb_file.with_tile(where))
    with pytest.raises(FormatError, match=r"smoke\.vdb: active tiles, which tinyvdb.*density.*python3-openvdb"):
        dl.volumes.load(smoke)


def check_tile(smoke, low, high):
    """The file has a tile of 0.25 there (indices), and all else that it had without."""
    smoke.write_bytes(vdb_file.vdb_bytes())
    plain = dl.volumes.load(smoke)
    smoke.write_bytes(vdb_file.with_tile("lower"))
    found = dl.volumes.load(smoke)
    values, before = found["density"][..., 0], plain["density"][..., 0]

    def at(first, last):
        x, y, z = np.round(np.array(first) - np.array(found["min"])).astype(int)
        nx, ny, nz = np.round(np.array(last) - np.array(first)).astype(int)
        return slice(z, z + nz), slice(y, y + ny), slice(x, x + nx)

    expected = np.zeros_like(values)
    expected[at(plain["min"], plain["max"])] = before
    expected[at(np.array(low) - 0.5, np.array(high) + 0.5)] = 0.25
    assert np.array_equal(values, expected)
    np.testing.assert_allclose(found["transform"].matrix, plain["transform"].matrix)


def test_vdb_active_tiles_by_openvdb_itself(smoke):
    if volume_files._own_module() is None:
        pytest.skip("neither openvdb nor pyopenvdb, which are not on PyPI")
    check_tile(smoke, (-128, 0, 8), (-121, 7, 15))
    smoke.write_bytes(vdb_file.with_tile("root"))
    with pytest.raises(FormatError, match="too large"):
        dl.volumes.load(smoke)


def test_vdb_active_tiles_by_a_stand_in(smoke, monkeypatch):
    """For OpenVDB's module, which is not on PyPI: the place, the order of axes, what is refused."""
    named = types.SimpleNamespace
    voxel, tile = named(min=(0, 4, 8), max=(0, 4, 8), count=1, value=7.0), {"min": (-3, 0, 5), "max": (-2, 2, 8)}

    def tiles(*found):
        vdb = named(read=lambda path, name: named(citerOnValues=lambda: iter(found)))
        monkeypatch.setitem(sys.modules, "a_vdb", vdb)

    monkeypatch.setattr(volume_files, "_OWN_MODULES", ("no_vdb", "a_vdb"))
    tiles(voxel, named(**tile, count=24, value=0.25))
    check_tile(smoke, tile["min"], tile["max"])
    tiles(named(**tile, count=24, value=np.nan))
    with pytest.raises(FormatError, match=r"smoke\.vdb: tiles whose values are not finite"):
        dl.volumes.load(smoke)
    tiles(named(**tile, count=24, value=-1.0))
    assert dl.volumes.load(smoke)["density"].min() == 0


def test_vdb_tiles_that_are_not_active_do_not_matter(smoke):
    plain = dl.volumes.load(smoke)
    smoke.write_bytes(vdb_file.with_tile("idle"))
    assert dl.volumes.load(smoke) == plain


def test_vdb_temperatures_share_the_box(smoke):
    grid = dl.volumes.load(smoke, temperature="heat", emission_scale=4)
    assert grid["temperature"].shape == grid["density"].shape
    assert grid["emission_scale"] == 4
    hot = grid["density"] > 0.5
    hot[..., 0] &= grid["temperature"][..., 0] > 0  # the first x is not in "heat"
    np.testing.assert_allclose(grid["temperature"][hot], 1000 + 500 * grid["density"][hot])
    assert set(np.unique(grid["temperature"])) == {0, *np.unique(vdb_file.heat())}


def test_scene_files_name_volume_files(smoke, tmp_path):
    scene = dl.Scene()
    scene.base_dir = tmp_path
    volume = dl.volumes.volume_file("smoke.vdb", temperature="heat")
    inside = dl.materials.interface(medium_density=3, medium_volume=volume)
    scene.add(dl.shapes.box((-5, -5, -5), (9, 9, 9), material=inside))
    scene.save(tmp_path / "s.yaml")
    again = dl.load(tmp_path / "s.yaml")
    assert again == scene
    assert again.compile().stats["volume_bytes"] > 1000
    assert again.info()["memory"] > 1000
    smoke.unlink()
    with pytest.raises(MissingFileError, match=r"smoke\.vdb"):
        again.compile()
    compiled = again.compile(allow_missing=True)
    assert any("missing volume smoke.vdb" in note for note in compiled.notes)
    with pytest.raises(MissingFileError, match=r"smoke\.vdb"):
        dl.volumes.load(smoke)


def test_temperature_or_emission(smoke):
    for make in (dl.volumes.load, dl.volumes.volume_file):
        with pytest.raises(SceneError, match=r"emission and temperature in .*smoke\.vdb.*heat.*fire.*one of them"):
            make(smoke, temperature="heat", emission="fire")


def test_errors_name_the_file_once(smoke, tmp_path):
    (tmp_path / "a.txt").write_text("x")
    np.save(tmp_path / "d.npy", np.ones(3))
    for path, grids in ((smoke, {"density": "x"}), (tmp_path / "a.txt", {}), (tmp_path / "d.npy", {})):
        with pytest.raises(Error) as caught:
            volume_files.read_volume(path, {"density": "density", **grids})
        assert caught.value.file == str(path)
        assert str(caught.value).count(path.name) == 1


def test_numpy_files(tmp_path):
    values = np.random.default_rng(1).random((3, 4, 5)).astype(np.float16)
    np.save(tmp_path / "d.npy", values)
    grid = dl.volumes.load(tmp_path / "d.npy")
    assert grid["density"].dtype == np.float16
    assert np.array_equal(grid["density"][..., 0], values)
    assert grid["transform"] is None
    for bad, said in ((np.ones(3), "not voxels"), (np.ones((2, 2, 2), int), r"\(2, 2, 2\) of int64.*uint8, float16")):
        np.save(tmp_path / "d.npy", bad)
        with pytest.raises(FormatError, match=said):
            dl.volumes.load(tmp_path / "d.npy")
    np.save(tmp_path / "d.npy", -np.ones((2, 2, 2)))
    with pytest.raises(SceneError, match="negative"):
        dl.volumes.load(tmp_path / "d.npy")
    np.save(tmp_path / "d.npy", np.array([{}], object), allow_pickle=True)
    with pytest.raises(FormatError, match="broken array file"):
        dl.volumes.load(tmp_path / "d.npy")


def test_wrong_names_and_kinds(smoke, tmp_path):
    with pytest.raises(FormatError, match=r"no such grid.*density"):
        dl.volumes.load(smoke, density="densty")
    (tmp_path / "a.txt").write_text("x")
    with pytest.raises(InputError, match=r"not a volume file.*\.npy or \.nvdb or \.vdb"):
        dl.volumes.load(tmp_path / "a.txt")
    np.save(tmp_path / "d.npy", np.ones((2, 2, 2)))
    with pytest.raises(InputError, match="no temperature"):
        dl.volumes.load(tmp_path / "d.npy", temperature="heat")


def test_without_the_package(smoke, monkeypatch):
    real = builtins.__import__

    def without(name, *args, **kwargs):
        if name == "tinyvdb":
            raise ImportError(name)
        return real(name, *args, **kwargs)

    monkeypatch.delitem(sys.modules, "tinyvdb", raising=False)
    monkeypatch.setattr(builtins, "__import__", without)
    with pytest.raises(InputError, match=r"destello\[volumes\]"):
        dl.volumes.load(smoke)


def test_sizes_are_checked_before_memory_is_taken(smoke, tmp_path, monkeypatch):
    monkeypatch.setattr(volume_files, "MOST_VOXELS", 100)
    with pytest.raises(FormatError, match="too large"):
        dl.volumes.load(smoke)
    np.save(tmp_path / "d.npy", np.ones((10, 10, 10), np.uint8))
    with pytest.raises(FormatError, match="too large"):
        dl.volumes.load(tmp_path / "d.npy")


@pytest.mark.fuzz
@pytest.mark.parametrize("kind", ["vdb", "npy"])
def test_damaged_files(kind, tmp_path):
    """Only destello.Error comes out, and some are read."""
    path = tmp_path / f"x.{kind}"
    np.save(tmp_path / "x.npy", vdb_file.density())
    whole = vdb_file.vdb_bytes() if kind == "vdb" else path.read_bytes()
    # Most of a .vdb file is values: the structure at its beginning gets half of the damage.
    head = min(len(whole), 2000)
    read = 0
    for seed in range(400):
        rng = np.random.default_rng(seed)
        front = seed % 2 == 0
        data = damaged(rng, whole[:head]) + whole[head:] if front else damaged(rng, whole)
        path.write_bytes(data)
        with contextlib.suppress(Error):
            dl.volumes.load(path)
            read += 1
    assert 20 < read < 380
