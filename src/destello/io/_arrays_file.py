"""Files of arrays beside a scene: NumPy's .npz, uncompressed, so that nothing grows when it is read."""

from __future__ import annotations

import hashlib
import math
import zipfile
from collections.abc import Collection, Mapping
from pathlib import Path
from typing import IO, TYPE_CHECKING, Any

from destello.errors import FormatError
from destello.image_file import replacing

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Arrays = Mapping[str, NDArray[Any]]

_KINDS = "uif"
_BROKEN = (
    ValueError,
    OSError,
    EOFError,
    KeyError,
    RuntimeError,
    NotImplementedError,
    OverflowError,
    TypeError,
    SyntaxError,
)


def write_arrays(folder: Path, arrays: Arrays) -> str:
    """Writes arrays into `folder` under a name made of their content, unless it is there; returns the file's name.

    Raises OutputError.
    """
    import numpy as np

    digest = hashlib.sha256()
    for name, array in sorted(arrays.items()):
        digest.update(f"{name} {array.dtype.str} {array.shape};".encode())
        digest.update(np.ascontiguousarray(array).data)
    path = folder / f"{digest.hexdigest()[:24]}.npz"
    if not path.exists():
        with replacing(path) as aside:
            folder.mkdir(exist_ok=True)
            np.savez(aside, **dict(sorted(arrays.items())))  # type: ignore[arg-type]
    return path.name


def read_arrays(path: Path, known: Collection[str]) -> dict[str, NDArray[Any]]:
    """The arrays of a file. Raises FormatError for any but those called `known`, and for what is not a plain array."""
    try:
        with zipfile.ZipFile(path) as file:
            return {name: _read(file, info, path) for name, info in _members(file, known, path).items()}
    except zipfile.BadZipFile as error:
        raise FormatError(f"not an array file: {error}", file=path, expected="an uncompressed .npz file") from error
    except _BROKEN as error:
        raise FormatError(f"a broken array file: {error}", file=path, expected="an uncompressed .npz file") from error


def _members(file: zipfile.ZipFile, known: Collection[str], path: Path) -> dict[str, zipfile.ZipInfo]:
    found: dict[str, zipfile.ZipInfo] = {}
    for info in file.infolist():
        name = info.filename.removesuffix(".npy")
        if name not in known or name in found:
            raise FormatError("an unknown array", file=path, value=info.filename, expected=", ".join(sorted(known)))
        if info.compress_type != zipfile.ZIP_STORED or info.file_size != info.compress_size:
            raise FormatError(
                "a compressed array", file=path, value=info.filename, expected="numpy.savez, not savez_compressed"
            )
        found[name] = info
    return found


def _read(file: zipfile.ZipFile, info: zipfile.ZipInfo, path: Path) -> NDArray[Any]:
    """One array; its header must agree with the number of bytes that are there."""
    import numpy as np

    size = path.stat().st_size
    with file.open(info) as stream:
        shape, fortran, dtype = _header(stream)
        needed = math.prod(shape) * dtype.itemsize
        if dtype.kind not in _KINDS or dtype.hasobject or needed > min(size, info.file_size) or len(shape) > 4:
            raise FormatError(
                "an array of the wrong kind or size",
                file=path,
                value=f"{info.filename}: {dtype} {shape}"[:80],
                expected="numbers",
            )
        raw = stream.read(needed)
    if len(raw) != needed:
        raise FormatError("an array is cut off", file=path, value=info.filename, expected=f"{needed} bytes")
    return np.frombuffer(raw, dtype).reshape(shape, order="F" if fortran else "C")


def _header(stream: IO[bytes]) -> tuple[tuple[int, ...], bool, Any]:
    from numpy.lib import format as npy

    version = npy.read_magic(stream)
    if version != (1, 0):
        raise ValueError(f"unknown version {version}")
    shape, fortran, dtype = npy.read_array_header_1_0(stream)
    if any(n < 0 for n in shape):
        raise ValueError("negative size")
    return shape, fortran, dtype
