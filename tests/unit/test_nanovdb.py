"""NanoVDB files: those of the reference implementation, packed ones, damaged and hostile ones."""

from __future__ import annotations

import contextlib
import sys

import numpy as np
import pytest

import destello as dl
import nvdb_file
import vdb_file
from destello import nanovdb_file, volume_files
from destello.errors import Error, FormatError, InputError
from fuzz_readers import BYTES, damaged


def load(tmp_path, data, **names):
    path = tmp_path / "x.nvdb"
    path.write_bytes(data)
    return dl.volumes.load(path, **names)


def cut(values):
    """The part of (x, y, z) where the density is not 0, as (z, y, x)."""
    x, y, z = np.nonzero(vdb_file.density())
    return values[x.min() : x.max() + 1, y.min() : y.max() + 1, z.min() : z.max() + 1].transpose(2, 1, 0)


def inside(voxels):
    """Without the border, which is empty."""
    border = np.array(voxels)
    border[1:-1, 1:-1, 1:-1] = 0
    assert not border.any()
    return voxels[1:-1, 1:-1, 1:-1]


# Half of a step of the quantisation within a leaf, whose values lie between 0 and 1.
@pytest.mark.parametrize(
    ("name", "error"),
    [("density", 0), ("double", 0), ("fp16", 2**-17), ("fp8", 2**-9), ("fp4", 1 / 30), ("fpn", 1e-3)],
)
def test_values_and_place(tmp_path, name, error):
    grid = load(tmp_path, nvdb_file.nvdb_bytes(), density=name)
    assert np.abs(inside(grid["density"])[..., 0] - cut(vdb_file.density())).max() <= error
    first = np.min(np.nonzero(vdb_file.density()), 1)
    corner = grid["transform"].matrix @ (
        *(np.array(grid["min"]) + 1.5),
        1,
    )  # the middle of the first voxel, in the world
    np.testing.assert_allclose(corner[:3], (first + np.array([-4, 3, 125])) * 0.5 + np.array([1, 2, 3]))


@pytest.mark.parametrize("minor", [7, 9])
def test_half_precision_and_newer_versions(tmp_path, minor):
    """32.9's PNanoVDB.h (of nanovdb-editor 0.1.6) was once compared with these grids: it reads the same numbers."""
    for name in ("density", "ball"):
        full = load(tmp_path, nvdb_file.nvdb_bytes(), density=name)
        for data in (nvdb_file.half(name), nvdb_file.newer(nvdb_file.half(name), minor)):
            grid = load(tmp_path, data, density=name)
            assert np.array_equal(grid["density"], full["density"].astype(np.float16))
            assert (grid["min"], grid["transform"]) == (full["min"], full["transform"])
        assert load(tmp_path, nvdb_file.newer(nvdb_file.grids()[name], minor), density=name) == full


@pytest.mark.parametrize("major", [31, 33])
def test_other_major_versions_are_refused(tmp_path, major):
    grid = nvdb_file.newer(nvdb_file.grids()["density"], 0)
    with pytest.raises(FormatError, match=rf"x\.nvdb.*major version {major}.*32"):
        load(tmp_path, grid[:16] + (major << 21).to_bytes(4, "little") + grid[20:])
    whole = nvdb_file.container("density")
    with pytest.raises(FormatError, match=rf"x\.nvdb.*major version {major}.*32"):
        load(tmp_path, whole[:8] + (major << 21).to_bytes(4, "little") + whole[12:])


def test_a_matrix_is_not_its_transpose(tmp_path):
    grid = load(tmp_path, nvdb_file.nvdb_bytes(), density="turned")
    z, y, x = np.unravel_index(grid["density"][..., 0].argmax(), grid["density"].shape[:3])
    index = np.array(grid["min"]) + np.array([x, y, z]) + 0.5
    assert np.array_equal(index, [1, 2, 3])
    np.testing.assert_allclose(grid["transform"].matrix @ (*index, 1), (2, 2.875, 6, 1))
    assert inside(grid["density"])[0, 0, 0, 0] == 0.5
    assert grid["density"].sum() == 1.25


def test_temperatures_and_colours(tmp_path):
    grid = load(tmp_path, nvdb_file.nvdb_bytes(), temperature="heat", emission_scale=4)
    np.testing.assert_array_equal(inside(grid["temperature"])[..., 0], cut(_where(1000 + 500 * vdb_file.density())))
    grid = load(tmp_path, nvdb_file.nvdb_bytes(), emission="color")
    density, x = vdb_file.density(), np.indices((10, 6, 9))[0]
    for channel, values in enumerate((density, density / 2, _where(x))):
        np.testing.assert_array_equal(inside(grid["emission"])[..., channel], cut(values))
    with pytest.raises(FormatError, match=r"x\.nvdb.*3 channels.*density.*one channel"):
        load(tmp_path, nvdb_file.nvdb_bytes(), density="color")


def _where(values):
    return np.where(vdb_file.density() > 0, values, 0)


def test_tiles_are_filled(tmp_path):
    grid = load(tmp_path, nvdb_file.nvdb_bytes(), density="ball")
    found = inside(grid["density"])[..., 0]
    z, y, x = np.indices(found.shape) - 17
    depth = (17 - np.sqrt(x * x + y * y + z * z)) / 3
    np.testing.assert_allclose(found, np.clip(depth, 0, 1), atol=1e-6)


@pytest.mark.parametrize("codec", [0, 1, 2])
def test_packed_grids_chosen_by_name(tmp_path, codec):
    data = nvdb_file.container("heat", "density", codec=codec) + nvdb_file.container("fp8", magic=b"NanoVDB0")
    grid = load(tmp_path, data, temperature="heat")
    assert np.array_equal(inside(grid["density"])[..., 0], cut(vdb_file.density()))
    assert grid["temperature"].max() == 1000 + 500 * vdb_file.density().max()
    second_segment = load(tmp_path, data, density="fp8")
    assert np.abs(inside(second_segment["density"])[..., 0] - cut(vdb_file.density())).max() <= 2**-9
    with pytest.raises(FormatError, match=r"x\.nvdb: no such grid.*densty.*density"):
        load(tmp_path, data, density="densty")


@pytest.mark.parametrize("magic", [b"NanoVDB0", b"NanoVDB1"])
def test_bare_grids(tmp_path, magic):
    data = b"".join(magic + nvdb_file.grids()[name][8:] for name in ("heat", "density"))
    assert np.array_equal(inside(load(tmp_path, data)["density"])[..., 0], cut(vdb_file.density()))


def test_without_the_package(tmp_path, monkeypatch):
    packed, zipped = (nvdb_file.container("density", codec=codec) for codec in (2, 1))
    monkeypatch.setitem(sys.modules, "blosc", None)
    with pytest.raises(InputError, match=r"x\.nvdb.*blosc.*destello\[volumes\]"):
        load(tmp_path, packed)
    load(tmp_path, zipped)


def changed(data, at, new):
    return data[:at] + new + data[at + len(new) :]


def test_hostile_sizes(tmp_path, monkeypatch):
    grid, tree = nvdb_file.grids()["density"], 672
    many = (1 << 62).to_bytes(8, "little")
    root = tree + int.from_bytes(grid[tree + 24 : tree + 32], "little")
    for data, said in (
        (b"", "not a NanoVDB file"),
        (b"NanoVDB2", "a segment ends too early"),
        (changed(grid, 32, many), "a grid ends too early"),
        (changed(grid, 32, bytes(8)), "a grid's size"),
        (changed(grid, 16, bytes(4)), "not a grid that is known"),
        (changed(grid, 636, b"\7"), r"fog volume of numbers: 'type 7, class 2'"),
        (changed(grid, 632, b"\1"), r"fog volume of numbers: 'type 1, class 1'"),
        (changed(grid, tree + 24, many), "data outside"),
        (changed(grid, root + 24, b"\xff\xff\xff\x7f"), "more tiles at the root than fit"),
        (changed(grid, root + 64 + 8, many), "an upper node outside"),
        (changed(grid, 296 + 88, bytes(72)), "transform without inverse"),
        (changed(nvdb_file.container("density"), 16 + 8, many), "grid density ends too early"),
        (changed(nvdb_file.container("density", codec=1), 16, many), "a grid's size"),
        (changed(nvdb_file.container("density"), 14, b"\3"), "a codec that is not known"),
    ):
        with pytest.raises(FormatError, match=rf"x\.nvdb: .*{said}"):
            load(tmp_path, data)
    for codec, said in ((1, "more data than the grid's size"), (2, "Blosc chunk's sizes")):
        small = changed(nvdb_file.container("density", codec=codec), 16, (2000).to_bytes(8, "little"))
        with pytest.raises(FormatError, match=said):
            load(tmp_path, small)
    monkeypatch.setattr(nanovdb_file, "MOST_BYTES", 10_000)
    with pytest.raises(FormatError, match="a grid's size"):
        load(tmp_path, grid)
    monkeypatch.undo()
    monkeypatch.setattr(volume_files, "MOST_VOXELS", 100)
    with pytest.raises(FormatError, match="too large"):
        load(tmp_path, grid)


def test_nodes_that_share_children_end(tmp_path):
    """Root tiles that all lead to one node would be walked for ever."""
    grid, tree = nvdb_file.grids()["density"], 672
    root = tree + int.from_bytes(grid[tree + 24 : tree + 32], "little")
    tile = grid[root + 64 : root + 96]
    with pytest.raises(FormatError, match="more upper nodes than fit"):
        load(tmp_path, changed(changed(grid, root + 24, (9).to_bytes(4, "little")), root + 64, tile * 9))
    upper = root + int.from_bytes(tile[8:16], "little")
    lower = int(np.flatnonzero(np.frombuffer(grid[upper + 4128 : upper + 8224], np.uint8))[0]) * 8
    lower += (grid[upper + 4128 + lower // 8] & -grid[upper + 4128 + lower // 8]).bit_length() - 1
    child = grid[upper + 8256 + 8 * lower :][:8]
    shared = changed(changed(grid, upper + 4128, b"\xff" * 4096), upper + 8256, child * 32768)
    with pytest.raises(FormatError, match="more children of an upper node than fit"):
        load(tmp_path, shared)


def test_values_must_be_finite(tmp_path):
    grid, value = nvdb_file.grids()["density"], vdb_file.density()[4, 2, 4]
    for bad in (np.float32(np.nan), np.float32(np.inf)):
        with pytest.raises(FormatError, match="not finite"):
            load(tmp_path, grid.replace(value.tobytes(), bad.tobytes()))


@pytest.mark.fuzz
@pytest.mark.parametrize("codec", [0, 1, 2])
def test_damaged_files(codec, tmp_path):
    """Only destello.Error comes out, and some are read. Half of the damage is where the file is not 0."""
    whole = nvdb_file.container("density", "fpn", codec=codec)
    places = np.flatnonzero(np.frombuffer(whole, np.uint8))
    read = 0
    for seed in range(300):
        rng = np.random.default_rng((seed, codec))
        data = bytearray(whole)
        if seed % 4 == 0:
            data = damaged(rng, whole)
        elif seed % 4 == 1:
            data = damaged(rng, whole[:1200]) + whole[1200:]
        else:
            for at in rng.choice(places, 3):
                word = BYTES[rng.integers(len(BYTES))]
                data[at : at + len(word)] = word
        with contextlib.suppress(Error):
            load(tmp_path, bytes(data), density=("density", "fpn")[seed % 3 == 0])
            read += 1
    assert 10 < read < 290
