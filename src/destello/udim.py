"""Textures in tiles (UDIM): `<UDIM>` in a file name stands for 1001 + column + 10 row, one file a unit square of uv."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from destello.errors import FormatError
from destello.files import FIRST_TILE, MARK, TILE_COLUMNS

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from destello.assets import Assets


@dataclass(frozen=True)
class Tiles:
    """The tiles of one texture.

    Attributes:
        columns, rows: of the rectangle from u = v = 0 on that holds all of them.
        texels: of each, row by row; None: there is no such file.
    """

    columns: int
    rows: int
    texels: tuple[NDArray[Any] | None, ...]


def read_tiles(assets: Assets, path: str, place: str) -> Tiles | None:
    """All tiles that are there; None, as for any missing file, if there are none. `assets` notes which are missing.

    Tiles may differ in resolution, but neither in proportions nor in channels nor in their type of number: FormatError,
    which names the tile.
    """
    found: dict[int, NDArray[Any]] = {}
    first = ""
    for number in assets.files.tiles(path):
        name = path.replace(MARK, str(number))
        read = assets.texels(name, place)
        if read is None:
            continue
        texels = read[1]
        if found:
            _check_alike(found[min(found)], first, texels, name, place)
        else:
            first = name
        found[number] = texels
    if not found:
        assets.files.find(path, place)  # counts as missing
        return None
    at = [((number - FIRST_TILE) % TILE_COLUMNS, (number - FIRST_TILE) // TILE_COLUMNS) for number in found]
    columns, rows = (1 + max(place_) for place_ in zip(*at, strict=True))
    numbers = [FIRST_TILE + column + TILE_COLUMNS * row for row in range(rows) for column in range(columns)]
    missing = ", ".join(str(number) for number in numbers if number not in found)
    note = f"{path}: no tile {missing}: black and transparent there"
    if missing and note not in assets.notes:
        assets.notes.append(note)
    return Tiles(columns, rows, tuple(found.get(number) for number in numbers))


def _check_alike(first: NDArray[Any], first_name: str, texels: NDArray[Any], name: str, place: str) -> None:
    if texels.dtype != first.dtype or texels.shape[2] != first.shape[2]:
        raise FormatError(
            "a tile of another kind",
            place=place,
            value=f"{name}: {texels.shape[2]} channels of {texels.dtype}",
            expected=f"{first.shape[2]} of {first.dtype}, as {first_name} has",
        )
    if texels.shape[0] * first.shape[1] != texels.shape[1] * first.shape[0]:
        raise FormatError(
            "a tile of other proportions",
            place=place,
            value=f"{name}: {texels.shape[1]} x {texels.shape[0]}",
            expected=f"those of {first_name}, {first.shape[1]} x {first.shape[0]}",
        )
