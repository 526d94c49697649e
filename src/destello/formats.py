"""Which module reads and writes which kind of file. Modules are loaded by name when they are needed."""

from __future__ import annotations

from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from types import MappingProxyType, ModuleType
from typing import TYPE_CHECKING, cast

from destello.errors import FormatError, InputError

if TYPE_CHECKING:
    from destello.scene import Scene

# extension: module of destello.io with `load(path: Path, options: LoadOptions) -> Scene`
READERS = MappingProxyType(
    {
        ".yaml": "native",
        ".yml": "native",
        ".json": "native",
        ".gltf": "gltf",
        ".glb": "gltf",
        ".obj": "obj",
        ".stl": "stl",
        ".ply": "ply",
    }
)


@dataclass(frozen=True)
class LoadOptions:
    """How a scene file is read.

    Attributes:
        allow_missing: a visible stand-in replaces missing image files; otherwise they are an error.
        allow_external: the scene may read files outside its own directory tree.
        variant: name of one of the file's material variants (KHR_materials_variants); None: as the file shows itself.
        complete: a scene without a camera gets one that frames it, one without light a sky, both with a note.
    """

    allow_missing: bool = False
    allow_external: bool = False
    complete: bool = True
    variant: str | None = None


def reader(path: Path) -> ModuleType:
    """The module that reads `path`, by its extension. Raises FormatError, which lists the formats."""
    name = READERS.get(path.suffix.lower())
    if name is None:
        raise FormatError(
            "unknown scene format", file=path, value=path.suffix or None, expected=", ".join(sorted(READERS))
        )
    return import_module(f"destello.io.{name}")


def load_file(path: Path, options: LoadOptions) -> Scene:
    """Reads any known format. Raises InputError for a variant in a format that has none."""
    if options.variant is not None and READERS.get(path.suffix.lower(), "gltf") != "gltf":
        raise InputError("only glTF has variants", file=path, value=options.variant, expected="a .gltf or .glb file")
    return cast("Scene", reader(path).load(path, options))


def save_file(scene: Scene, path: Path) -> None:
    """Writes the native format."""
    if READERS.get(path.suffix.lower()) != "native":
        known = ", ".join(sorted(ext for ext, module in READERS.items() if module == "native"))
        raise FormatError("scenes are not written in this format", file=path, value=path.suffix or None, expected=known)
    import_module("destello.io.native").save(scene, path)
