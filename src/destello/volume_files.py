"""Reading volumes: NanoVDB's .nvdb, OpenVDB's .vdb through the package `tinyvdb`, and NumPy's .npy.

tinyvdb comes by pip, and gives a grid's voxels but not its tiles (blocks of one value). Those OpenVDB's own Python
module gives, which is not on PyPI and is only asked where a grid has active ones.
"""

from __future__ import annotations

import contextlib
import importlib
import io
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from destello.errors import Error, FormatError, InputError, did_you_mean
from destello.nanovdb import NanoGrid
from destello.nanovdb_file import grid_bytes

if TYPE_CHECKING:
    import numpy.typing as npt

    Voxels = npt.NDArray[Any]

MOST_VOXELS = 1 << 29  # of the box around what a file holds
EXTENSIONS = (".npy", ".nvdb", ".vdb")
_HOW_TO_INSTALL = "pip install 'destello[volumes]'"
_OWN_MODULES = ("openvdb", "pyopenvdb")  # OpenVDB's own: conda-forge's name and Debian's


class SparseGrid(Protocol):
    """A grid of a file: voxels from index `low` to `high`, both (3,) for x, y, z; all others are 0."""

    low: Voxels
    high: Voxels
    matrix: Voxels  # (4, 4), from indices to the file's world
    channels: int

    def fill(self, target: Voxels, low: Voxels) -> None:
        """Writes the values into zeros (z, y, x, channels), whose first voxel has the indices `low`."""


def read_volume(path: Path, grids: Mapping[str, str]) -> dict[str, Any]:
    """The parameters of a `grid` volume from a file: arrays, box and transform.

    Args:
        path: .nvdb, .vdb, or .npy with the densities alone, (depth, height, width) in the unit cube.
        grids: from the parameter ("density", "temperature", "emission") to the name of the file's grid.

    Raises:
        FormatError: if the file is damaged, lacks a grid, or would take too much memory. InputError: another kind of
            file, or the package that reads it is not installed.
    """
    read = {".vdb": _read_vdb, ".nvdb": _read_nanovdb, ".npy": _read_array}.get(path.suffix.lower())
    try:
        if read is None:
            raise InputError("not a volume file", value=path.suffix, expected=" or ".join(EXTENSIONS))
        return read(path, grids)
    except Error as error:
        raise error.within(None, file=path) from error.__cause__


def _read_array(path: Path, grids: Mapping[str, str]) -> dict[str, Any]:
    for param in ("temperature", "emission"):
        if param in grids:
            raise InputError(f"a .npy file has no {param}", expected="a .nvdb or .vdb file")
    try:
        array = np.load(path, mmap_mode="r", allow_pickle=False)  # its size is checked against the file's
    except Exception as error:  # its header is read as Python's source: anything may come out
        raise FormatError(_one_line("a broken array file", error), expected="a .npy file") from error
    if not isinstance(array, np.ndarray) or array.ndim not in (3, 4) or array.dtype.kind not in "uf" or array.size == 0:
        found = f"{getattr(array, 'shape', '')} of {getattr(array, 'dtype', type(array).__name__)}"
        raise FormatError("not voxels", value=found, expected="three dimensions of uint8, float16 or float32")
    _check_size(array.shape[:3])
    return {"density": np.array(array)}


def _check_size(shape: tuple[int, ...]) -> None:
    count = 1
    for n in shape:
        count *= int(n)
    if count > MOST_VOXELS or max(shape) > 65536:
        expected = f"at most {MOST_VOXELS} voxels, 65536 along an axis"
        raise FormatError("the box around the volume is too large", value=shape, expected=expected)


def _read_nanovdb(path: Path, grids: Mapping[str, str]) -> dict[str, Any]:
    data = path.read_bytes()
    return _dense({param: NanoGrid(grid_bytes(data, name), name) for param, name in grids.items()})


def _dense(found: Mapping[str, SparseGrid]) -> dict[str, Any]:
    """All grids in one box, with a border of empty voxels: towards what is not there values fall to 0 over a voxel."""
    matrix = found["density"].matrix
    if not (np.isfinite(matrix).all() and abs(np.linalg.det(matrix)) > 0):
        raise FormatError("a transform without inverse", value=matrix[:3].tolist(), expected="an affine one")
    low = np.min([grid.low for grid in found.values()], 0) - 1
    high = np.max([grid.high for grid in found.values()], 0) + 1
    shape = tuple(int(n) for n in (high - low + 1)[::-1])
    _check_size(shape)
    made: dict[str, Any] = {}
    for param, grid in found.items():
        if not np.allclose(grid.matrix, matrix):
            raise FormatError("grids with different transforms", value=param, expected="one transform")
        if grid.channels != 1 and param != "emission":
            raise FormatError(f"a grid of {grid.channels} channels", value=param, expected="one channel")
        made[param] = np.zeros((*shape, grid.channels), np.float32)
        grid.fill(made[param], low)
    box = {"min": tuple((low - 0.5).tolist()), "max": tuple((high + 0.5).tolist())}
    return {**made, **box, "transform": matrix.tolist()}


# --- OpenVDB ----------------------------------------------------------------------------------------------------------


@dataclass
class _Tile:
    """A block of one value: its first index and its last, (3,), and the value."""

    low: Voxels
    high: Voxels
    value: float


class _Points:
    """Voxels one by one: index coordinates (N, 3) and values (N,); and tiles."""

    channels = 1

    def __init__(self, points: Voxels, values: Voxels, tiles: list[_Tile], matrix: Voxels) -> None:
        self._points, self._values, self._tiles, self.matrix = points, values, tiles, matrix
        self.low = np.min([points.min(0), *(tile.low for tile in tiles)], 0)
        self.high = np.max([points.max(0), *(tile.high for tile in tiles)], 0)

    def fill(self, target: Voxels, low: Voxels) -> None:
        for tile in self._tiles:
            first, end = tile.low - low, tile.high - low + 1
            target[first[2] : end[2], first[1] : end[1], first[0] : end[0], 0] = tile.value
        x, y, z = (self._points - low).T
        target[z, y, x, 0] = self._values


def _read_vdb(path: Path, grids: Mapping[str, str]) -> dict[str, Any]:
    try:
        import tinyvdb  # type: ignore[import-not-found,unused-ignore]
    except ImportError:
        raise InputError("tinyvdb, which reads .vdb files, is not installed", expected=_HOW_TO_INSTALL) from None
    try:
        file = tinyvdb.from_bytes(path.read_bytes())
        file.read_grids()
        names = [str(file.grid_name(i)) for i in range(_value(file.grid_count))]
        found: dict[str, SparseGrid] = {}
        for param, name in grids.items():
            if name not in names:
                raise FormatError("no such grid in the file", value=name, expected=did_you_mean(name, names))
            found[param] = _points(file.grid(names.index(name)), name, path)
    except Error:
        raise
    except Exception as error:  # the package's own errors, and what its C code leaves to the interpreter
        raise FormatError(_one_line("a broken .vdb file", error), expected="an OpenVDB file") from error
    return _dense(found)


def _one_line(problem: str, error: Exception) -> str:
    return " ".join(f"{problem} ({str(error) or type(error).__name__})".split())[:300]


def _value(member: Any) -> Any:
    """The package has some members as properties, some as methods."""
    return member() if callable(member) else member


def _points(grid: Any, name: str, path: Path) -> _Points:
    kind = str(_value(grid.type_name))
    if "float" not in kind or _value(grid.metadata).get("class") == "level set":
        raise FormatError("not a fog volume of floats", value=f"{name}: {kind}", expected="a fog volume")
    sparse = grid.to_sparse()
    points = np.frombuffer(sparse["coords"], np.int32).reshape(-1, 3).astype(np.int64)
    values = np.frombuffer(sparse["values"], np.float32)
    if not (len(values) and np.isfinite(values).all()):
        raise FormatError("no voxels, or values that are not finite", value=name, expected="a fog volume")
    tiles = _tiles(path, name) if _active_tiles(grid, points) else []
    return _Points(points, np.maximum(values, np.float32(0)), tiles, _index_to_world(_value(grid.transform), name))


def _active_tiles(grid: Any, points: Voxels) -> int:
    """How many there are.

    Of those at the root the package counts all. Then the file's own box, if it lies within that of the voxels, says
    that none is active.
    """
    tree, metadata = _value(grid.tree), _value(grid.metadata)
    nodes = [tree.node(i) for i in range(_value(tree.num_nodes))]
    active = sum(node.active_voxel_count for node in nodes if node.type == "internal")
    at_root = sum(node.active_voxel_count for node in nodes if node.type == "root") - sum(n.level == 1 for n in nodes)
    low, high = metadata.get("file_bbox_min"), metadata.get("file_bbox_max")
    if at_root and (low is None or high is None or (points.min(0) > low).any() or (points.max(0) < high).any()):
        active += at_root
    return int(active)


def _tiles(path: Path, name: str) -> list[_Tile]:
    """A grid's active tiles, by OpenVDB's own module. Raises FormatError if there is none."""
    module = _own_module()
    if module is None:
        expected = (
            "OpenVDB's Python module (conda-forge's openvdb, Debian's python3-openvdb), a .nvdb file, or voxels alone"
            " (voxelizeActiveTiles makes them so)"
        )
        raise FormatError("active tiles, which tinyvdb does not read", value=name, expected=expected)
    values = module.read(str(path), name).citerOnValues()
    found = [(tile.min, tile.max, float(tile.value)) for tile in values if tile.count > 1]
    if not np.isfinite([value for _, _, value in found]).all():
        raise FormatError("tiles whose values are not finite", value=name, expected="a fog volume")
    return [_Tile(np.array(low), np.array(high), max(value, 0.0)) for low, high, value in found]


def _own_module() -> Any:
    for name in _OWN_MODULES:
        try:
            # NumPy 2 complains of modules made for NumPy 1. Only what has nothing to do with NumPy is called here.
            with contextlib.redirect_stderr(io.StringIO()):
                return importlib.import_module(name)
        except ImportError:
            continue
    return None


def _index_to_world(transform: Mapping[str, Any], name: str) -> Voxels:
    kind = str(transform["type"])
    matrix = np.eye(4)
    if "affine" in kind or "unitary" in kind:
        matrix = np.array(transform["matrix"], np.float64).T  # OpenVDB's vectors are rows
    elif "scale" in kind or "translat" in kind:
        matrix[:3, :3] = np.diag(np.array(transform["scale"], np.float64))
        matrix[:3, 3] = transform["translation"]
    else:
        raise FormatError("a transform that is not affine", value=f"{name}: {kind}", expected="a linear one")
    return matrix
