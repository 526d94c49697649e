"""Finds the files that a scene refers to, and keeps it from reaching anything else."""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from pathlib import Path, PurePosixPath

from destello.errors import InputError, MissingFileError

MARK = "<UDIM>"  # in a name: the number of a tile, FIRST_TILE + column + TILE_COLUMNS row
FIRST_TILE, TILE_COLUMNS = 1001, 10
_MOST_ROWS = 1000


@dataclass
class ResolvedFiles:
    """Resolves the paths in one scene and gathers the missing ones, so that all are reported at once.

    Attributes:
        base: the directory to which relative paths refer: the scene file's own.
        root: the directory that holds everything the scene may read; None: `base`.
        allow_external: paths may lead out of `root`, by "..", absolutely or through symbolic links.
        allow_missing: `finish` does not raise; the caller puts a stand-in in place.
        scene_file: named in errors.
        missing: paths that were not found, in order, each once.
    """

    base: Path
    allow_external: bool = False
    allow_missing: bool = False
    scene_file: Path | None = None
    root: Path | None = None
    missing: list[str] = field(default_factory=list)

    def find(self, path: str | Path, place: str | None = None) -> Path | None:
        """The file's real path, or None if it is missing (see `finish`). Raises InputError if it is out of bounds.

        `path` is relative to `base` or absolute; `place` says where in the scene it stands.
        """
        try:
            real = (self.base.resolve() / path).resolve()
            inside = real.is_relative_to((self.root or self.base).resolve())
            found = (inside or self.allow_external) and real.is_file()
        except (OSError, RuntimeError, ValueError):  # too long, a loop of links, a character no path may have
            inside, found = True, False
        if not inside and not self.allow_external:
            raise InputError(
                "the path leads out of the scene's directory",
                file=self.scene_file,
                place=place,
                value=str(path),
                expected=f"a file below {self.root or self.base}, or --allow-external",
            )
        if not found:
            if str(path) not in self.missing:
                self.missing.append(str(path))
            return None
        return real

    def find_any(self, path: str, place: str | None = None) -> Path | None:
        """As `find`; a path with MARK is there if one of its tiles is, and this is found."""
        numbers = self.tiles(path) if MARK in path else []
        return self.find(path.replace(MARK, str(numbers[0])) if numbers else path, place)

    def tiles(self, path: str) -> list[int]:
        """The numbers of the files beside each other that could be tiles of a path with MARK."""
        name = PurePosixPath(path.replace("\\", "/")).name
        head, _, tail = name.partition(MARK)
        pattern = re.compile(rf"{re.escape(head)}(\d{{4}}){re.escape(tail)}")
        try:
            folder = (self.base.resolve() / path).parent
            matches = [pattern.fullmatch(entry.name) for entry in folder.iterdir()]
        except (OSError, RuntimeError, ValueError):
            return []
        numbers = sorted(int(match[1]) for match in matches if match)
        return [number for number in numbers if FIRST_TILE <= number < FIRST_TILE + TILE_COLUMNS * _MOST_ROWS]

    def finish(self) -> None:
        """Raises MissingFileError with all files that were not found, unless they may be missing."""
        if self.missing and not self.allow_missing:
            raise MissingFileError(self.missing, file=self.scene_file)
