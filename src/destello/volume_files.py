"""Reading volumes: OpenVDB's .vdb through the package `tinyvdb`, and NumPy's .npy."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from destello.errors import Error, FormatError, InputError, did_you_mean

if TYPE_CHECKING:
    import numpy.typing as npt

    Voxels = npt.NDArray[Any]
    Points = tuple[npt.NDArray[np.int64], npt.NDArray[np.float32], Voxels]

MOST_VOXELS = 1 << 29  # of the box around what a file holds
EXTENSIONS = (".npy", ".vdb")
_HOW_TO_INSTALL = "pip install 'destello[volumes]'"


def read_volume(path: Path, grids: Mapping[str, str]) -> dict[str, Any]:
    """The parameters of a `grid` volume from a file: arrays, box and transform.

    Args:
        path: .vdb, or .npy with the densities alone, (depth, height, width) in the unit cube.
        grids: from the parameter ("density", "temperature") to the name of the file's grid.

    Raises:
        FormatError: if the file is damaged, lacks a grid, or would take too much memory. InputError: another kind of
            file, or the package that reads it is not installed.
    """
    kind = path.suffix.lower()
    if kind == ".vdb":
        return _read_vdb(path, grids)
    if kind != ".npy":
        raise InputError("not a volume file", file=path, value=path.suffix, expected=" or ".join(EXTENSIONS))
    if "temperature" in grids:
        raise InputError("a .npy file has no temperatures", file=path, expected="a .vdb file")
    try:
        array = np.load(path, mmap_mode="r", allow_pickle=False)  # its size is checked against the file's
    except Exception as error:  # its header is read as Python's source: anything may come out
        raise FormatError(_one_line("a broken array file", error), file=path, expected="a .npy file") from error
    if not isinstance(array, np.ndarray) or array.ndim not in (3, 4) or array.dtype.kind not in "uf" or array.size == 0:
        raise FormatError("not voxels", file=path, value=str(getattr(array, "shape", "")), expected="three dimensions")
    _check_size(path, array.shape[:3])
    return {"density": np.array(array)}


def _check_size(path: Path, shape: tuple[int, ...]) -> None:
    count = 1
    for n in shape:
        count *= int(n)
    if count > MOST_VOXELS or max(shape) > 65536:
        expected = f"at most {MOST_VOXELS} voxels, 65536 along an axis"
        raise FormatError("the box around the volume is too large", file=path, value=shape, expected=expected)


# --- OpenVDB ----------------------------------------------------------------------------------------------------------


def _read_vdb(path: Path, grids: Mapping[str, str]) -> dict[str, Any]:
    try:
        import tinyvdb  # type: ignore[import-not-found,unused-ignore]
    except ImportError:
        raise InputError("tinyvdb, which reads .vdb files, is not installed", expected=_HOW_TO_INSTALL) from None
    try:
        file = tinyvdb.from_bytes(path.read_bytes())
        file.read_grids()
        names = [str(file.grid_name(i)) for i in range(_value(file.grid_count))]
        found = {}
        for param, name in grids.items():
            if name not in names:
                raise FormatError("no such grid in the file", file=path, value=name, expected=did_you_mean(name, names))
            found[param] = _points(file.grid(names.index(name)), path, name)
    except Error:
        raise
    except Exception as error:  # the package's own errors, and what its C code leaves to the interpreter
        raise FormatError(_one_line("a broken .vdb file", error), file=path, expected="an OpenVDB file") from error
    return _dense(path, found)


def _one_line(problem: str, error: Exception) -> str:
    return " ".join(f"{problem} ({str(error) or type(error).__name__})".split())[:300]


def _value(member: Any) -> Any:
    """The package has some members as properties, some as methods."""
    return member() if callable(member) else member


def _points(grid: Any, path: Path, name: str) -> Points:
    """Index coordinates (N, 3) and values (N,) of a grid's voxels, and its matrix from index space to the world."""
    kind = str(_value(grid.type_name))
    if "float" not in kind or _value(grid.metadata).get("class") == "level set":
        raise FormatError("not a fog volume of floats", file=path, value=f"{name}: {kind}", expected="a fog volume")
    tree = _value(grid.tree)
    nodes = (tree.node(i) for i in range(_value(tree.num_nodes)))
    if any(node.type == "internal" and node.active_voxel_count for node in nodes):
        raise FormatError("active tiles, which are not read", file=path, value=name, expected="voxels alone")
    sparse = grid.to_sparse()
    points = np.frombuffer(sparse["coords"], np.int32).reshape(-1, 3).astype(np.int64)
    values = np.frombuffer(sparse["values"], np.float32)
    if not (len(values) and np.isfinite(values).all()):
        raise FormatError("no voxels, or values that are not finite", file=path, value=name, expected="a fog volume")
    return points, np.maximum(values, np.float32(0)), _index_to_world(_value(grid.transform), path, name)


def _index_to_world(transform: Mapping[str, Any], path: Path, name: str) -> Voxels:
    kind = str(transform["type"])
    matrix = np.eye(4)
    if "affine" in kind or "unitary" in kind:
        matrix = np.array(transform["matrix"], np.float64).T  # OpenVDB's vectors are rows
    elif "scale" in kind or "translat" in kind:
        matrix[:3, :3] = np.diag(np.array(transform["scale"], np.float64))
        matrix[:3, 3] = transform["translation"]
    else:
        raise FormatError("a transform that is not affine", file=path, value=f"{name}: {kind}", expected="a linear one")
    if not (np.isfinite(matrix).all() and abs(np.linalg.det(matrix)) > 0):
        raise FormatError("a transform without inverse", file=path, value=name, expected="an affine one")
    return matrix


def _dense(path: Path, found: Mapping[str, Points]) -> dict[str, Any]:
    """All grids in one box, with a border of empty voxels: towards what is not there values fall to 0 over a voxel."""
    matrix = found["density"][2]
    low = np.min([points.min(0) for points, _, _ in found.values()], 0) - 1
    high = np.max([points.max(0) for points, _, _ in found.values()], 0) + 1
    shape = tuple(int(n) for n in (high - low + 1)[::-1])
    _check_size(path, shape)
    made: dict[str, Any] = {}
    for param, (points, values, placed) in found.items():
        if not np.allclose(placed, matrix):
            raise FormatError("grids with different transforms", file=path, value=param, expected="one transform")
        made[param] = np.zeros(shape, np.float32)
        x, y, z = (points - low).T
        made[param][z, y, x] = values
    box = {"min": tuple((low - 0.5).tolist()), "max": tuple((high + 0.5).tolist())}
    return {**made, **box, "transform": matrix.tolist()}
