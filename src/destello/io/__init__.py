"""Reading scenes: by extension, or a built-in scene by its name."""

from __future__ import annotations

from importlib import import_module
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING

from destello.errors import FormatError, InputError, MissingFileError, did_you_mean
from destello.formats import READERS, LoadOptions, load_file

if TYPE_CHECKING:
    from destello.scene import Scene

__all__ = ["LoadOptions", "load"]


def load(
    path: str | PathLike[str],
    *,
    allow_missing: bool = False,
    allow_external: bool = False,
    variant: str | None = None,
) -> Scene:
    """Reads a scene file, or builds the built-in scene of that name if there is no such file.

    Args:
        path: a file (.yaml, .yml, .json, .gltf, .glb, .obj, .stl, .ply), or a name as `destello scenes` lists them.
        allow_missing: a visible stand-in replaces missing image files; otherwise they are an error.
        allow_external: the scene may read files outside its own directory tree.
        variant: name of one of a glTF file's material variants; None: as the file shows itself.

    Returns:
        The scene. What had to be added or was not understood is in its `notes`.

    Raises:
        MissingFileError: with all files that are missing. FormatError: for unknown formats and damaged files.
        SceneError: for wrong values. InputError: if there is no such variant.
    """
    path = Path(path)
    options = LoadOptions(allow_missing=allow_missing, allow_external=allow_external, variant=variant)
    try:
        is_file = path.is_file()
        exists = is_file or path.exists()
    except (OSError, ValueError):
        is_file = exists = False
    if is_file:
        return _load_existing(path, options)
    if variant is not None:
        raise InputError("only glTF files have variants", file=path, value=variant, expected="a .gltf or .glb file")
    if exists:
        raise FormatError("not a file", file=path, expected="a scene file")
    return _build(path)


def _load_existing(path: Path, options: LoadOptions) -> Scene:
    try:
        scene = load_file(path, options)
    except InputError as error:
        raise error.within(None, file=path) from error.__cause__
    except OSError as error:
        raise MissingFileError([path], reason=error.strerror or str(error), expected="a readable file") from error
    scene.source = path
    if scene.base_dir is None:
        scene.base_dir = path.parent
    return scene


def _build(path: Path) -> Scene:
    """The built-in scene that `path` names."""
    scenes = import_module("destello.scenes")
    names = [*scenes.names(), *scenes.describe_benchmarks()]
    if str(path) in names:
        scene: Scene = scenes.build(str(path))
        return scene
    if path.suffix.lower() in READERS or len(path.parts) > 1:
        raise MissingFileError([path], expected=f"an existing file ({', '.join(sorted(READERS))}) or a built-in scene")
    raise MissingFileError([path], expected=f"a scene file, or a built-in scene: {did_you_mean(path, names)}")
