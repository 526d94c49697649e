"""The image and mesh files of one scene, each read once."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from destello.errors import Error, FormatError, MissingFileError
from destello.files import ResolvedFiles
from destello.formats import READERS, LoadOptions, load_file
from destello.frames import at_time
from destello.nodes import Node
from destello.scene import Scene

if TYPE_CHECKING:
    from numpy.typing import NDArray


@dataclass(frozen=True)
class MeshFile:
    """What a mesh_file shape stands for: the file's scene, and the assets to which its own paths refer."""

    scene: Scene
    assets: Assets


class Assets:
    """Reads what a scene refers to. Missing files gather in `files`; `files.finish()` raises for all of them.

    Attributes:
        files: resolves paths.
        notes: what was left out or replaced, one line each.
    """

    def __init__(self, scene: Scene, *, allow_missing: bool | None = None, base_dir: Path | None = None) -> None:
        """`allow_missing` and `base_dir` stand in for the scene's own where given."""
        self.files = ResolvedFiles(
            base=base_dir or scene.base_dir or Path(),
            allow_external=scene.allow_external,
            allow_missing=scene.allow_missing if allow_missing is None else allow_missing,
        )
        self.notes: list[str] = []
        self._images: dict[Path, NDArray[Any]] = {}
        self._associated: set[int] = set()  # ids of those of them whose colours are multiplied by alpha
        self._arrays: dict[
            int, tuple[NDArray[Any], NDArray[Any]]
        ] = {}  # by id: the array, which stays alive; its texels
        self._volumes: dict[Node, Node] = {}
        self._meshes: dict[Path, MeshFile | None] = {}

    def texels(self, path: str, place: str) -> tuple[Path, NDArray[Any]] | None:
        """The real path and the texels of an image file; None if it is missing. Raises FormatError if it is damaged."""
        from destello.images import alpha_is_associated, read_texels, repaired

        real = self.files.find(path, place)
        if real is None:
            return None
        if real not in self._images:
            texels, bad = repaired(self._read(read_texels, real, place))
            self._images[real] = texels
            self._note_bad(path, bad)
            if texels.shape[2] in (2, 4) and alpha_is_associated(real):
                self._associated.add(id(texels))
        return real, self._images[real]

    def associated(self, texels: NDArray[Any]) -> bool:
        """Whether what `texels` gave has colours that are multiplied by their alpha."""
        return id(texels) in self._associated

    def array(self, texture: Node, place: str) -> NDArray[Any]:
        """The texels of an image texture given as an array."""
        from destello.images import repaired

        pixels: NDArray[Any] = texture["pixels"]
        if id(pixels) not in self._arrays:
            kept, bad = repaired(pixels)
            self._arrays[id(pixels)] = (pixels, kept)
            self._note_bad(texture.name or place, bad)
        return self._arrays[id(pixels)][1]

    def _note_bad(self, name: str, count: int) -> None:
        if count:
            self.notes.append(f"{name}: {count} values are infinite or not numbers: they count as 0")

    def volume(self, node: Node, place: str) -> Node:
        """The `grid` in the file of a volume_file; an empty one if it is missing. Raises FormatError, InputError."""
        from destello.volumes import from_file

        real = self.files.find(node["path"], f"{place}.path")
        if real is None:
            self.notes.append(f"missing volume {node['path']}: left out")
            return Node("volume", "grid", {"density": [[[0.0]]]})
        if node not in self._volumes:
            self._volumes[node] = self._read(lambda path: from_file(path, node), real, f"{place}.path")
        return self._volumes[node]

    def mesh_file(self, shape: Node, place: str = "mesh_file") -> MeshFile | None:
        """The scene in the file of a mesh_file shape; None if it is missing."""
        real = self.files.find(shape["path"], f"{place}.path")
        if real is None:
            return None
        if real not in self._meshes:
            self._meshes[real] = self._load_mesh(real, f"{place}.path")
        return self._meshes[real]

    def _load_mesh(self, real: Path, place: str) -> MeshFile | None:
        known = sorted(ext for ext, module in READERS.items() if module != "native")
        if real.suffix.lower() not in known:
            raise FormatError("not a mesh file", place=place, value=real.name, expected=", ".join(known))
        files = self.files
        options = LoadOptions(files.allow_missing, files.allow_external, complete=False)
        try:
            scene = self._read(lambda path: load_file(path, options), real, place)
        except MissingFileError as error:
            files.missing.extend(path for path in error.paths if path not in files.missing)
            return None
        inner = Assets(scene, base_dir=real.parent)
        inner.files = replace(
            files, base=real.parent, root=files.root or files.base
        )  # shares the list of missing files
        inner.notes, inner._images, inner._associated = self.notes, self._images, self._associated
        self.notes.extend(f"{real.name}: {note}" for note in scene.notes)
        if scene.frames:
            self.notes.append(f"{real.name}: as a mesh_file it is not animated, it is as at its time 0")
            scene = at_time(scene, 0.0)
        return MeshFile(scene, inner)

    @staticmethod
    def _read(reader: Any, path: Path, place: str) -> Any:
        try:
            return reader(path)
        except Error as error:
            raise error.within(place, file=path) from error.__cause__
        except OSError as error:
            raise FormatError(f"cannot be read ({error.strerror or error})", file=path, place=place) from error

    def mesh_scene(self, shape: Node, place: str) -> Scene:
        """The scene in the file of a mesh_file shape, empty if it is missing: what `geometry.scene_bounds` asks for."""
        found = self.mesh_file(shape, place)
        return Scene() if found is None else found.scene
