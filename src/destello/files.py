"""Finds the files that a scene refers to, and keeps it from reaching anything else."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

from destello.errors import InputError, MissingFileError


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

    def finish(self) -> None:
        """Raises MissingFileError with all files that were not found, unless they may be missing."""
        if self.missing and not self.allow_missing:
            raise MissingFileError(self.missing, file=self.scene_file)
