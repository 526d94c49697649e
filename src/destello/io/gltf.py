"""Reads glTF 2.0: .gltf with its buffers and images, and .glb.

What becomes of it: the default scene's nodes with their world transforms; a mesh that several nodes use becomes a group
with instances; materials, see `_gltf_materials`; cameras; KHR_lights_punctual. Units are metres, y is up, as here.
Photometric units are taken for radiometric ones, as renderers commonly do: 1 cd is 1 W/sr, 1 lx is 1 W/m^2, 1 cd/m^2 is
1 W/(sr m^2), so that lights and glowing surfaces keep their proportions. The first animation moves nodes; joints and
morph weights keep their pose in the file.
"""

from __future__ import annotations

from pathlib import Path

from destello.errors import MissingFileError
from destello.io import _gltf_container
from destello.io._defaults import LoadOptions, ResolvedFiles, ensure_camera, ensure_light
from destello.io._gltf_accessors import Buffers
from destello.io._gltf_animation import Motions
from destello.io._gltf_compression import COMPRESSIONS
from destello.io._gltf_json import Document, Item
from destello.io._gltf_materials import EXTENSIONS, Materials
from destello.io._gltf_meshes import Meshes
from destello.io._gltf_nodes import NODE_EXTENSIONS, Placer
from destello.io._gltf_textures import BASISU, Textures, relative_path
from destello.io._gltf_unapplied import unapplied
from destello.io._gltf_variants import EXTENSION as VARIANTS
from destello.io._gltf_variants import Variants
from destello.scene import Scene

_SUPPORTED = EXTENSIONS | NODE_EXTENSIONS | COMPRESSIONS | {"KHR_mesh_quantization", BASISU, VARIANTS}
_HARMLESS = frozenset({"KHR_xmp", "KHR_xmp_json_ld", "KHR_animation_pointer"})  # nothing that a picture shows


def load(path: Path, options: LoadOptions) -> Scene:
    """The scene in a .gltf or .glb file.

    Raises:
        FormatError: for anything that is wrong in the file, with its place: ``meshes[2].primitives[0].indices``.
        InputError: if there is no such variant. MissingFileError: with all buffers and images that do not exist.
    """
    root, binary = _gltf_container.read(path)
    document = Document(root)
    _check_version(root)
    scene = Scene(name=path.stem)
    scene.base_dir, scene.allow_external, scene.allow_missing = (
        path.parent,
        options.allow_external,
        options.allow_missing,
    )
    _check_extensions(root, scene.notes)
    files = ResolvedFiles(
        path.parent, allow_external=options.allow_external, allow_missing=options.allow_missing, scene_file=path
    )
    found = _find_buffers(document, files)
    buffers = Buffers(document, binary, lambda item, uri: _read_buffer(found[uri], item))
    textures = Textures(document, buffers, scene.notes, found)
    variants = Variants(document, options.variant, scene.notes)
    materials = Materials(document, textures, variants, scene.notes)
    motions = Motions(document, buffers)
    Placer(document, scene, Meshes(document, buffers, materials, scene.notes), buffers, motions).place()
    scene.notes += unapplied(document)
    if motions.note:
        scene.notes.append(motions.note)
    if options.complete:
        _check_images(scene, files)
        ensure_camera(scene)
        ensure_light(scene)
    return scene


def _check_version(root: Item) -> None:
    asset = root.item("asset")
    if asset is None:
        raise root.error("not glTF 2.0", "asset", expected="an object with version 2.0")
    for key in ("version", "minVersion"):
        version = asset.text(key, "2.0") if key == "minVersion" else asset.text(key)
        if version.partition(".")[0] != "2":
            raise asset.error("not glTF 2.0", key, value=version, expected="2.0")


def _check_extensions(root: Item, notes: list[str]) -> None:
    unsupported = [name for name in root.texts("extensionsRequired") if name not in _SUPPORTED]
    if unsupported:
        raise root.error(
            f"the file needs {'an extension' if len(unsupported) == 1 else 'extensions'} that destello does not have",
            "extensionsRequired",
            value=", ".join(unsupported),
            expected=", ".join(sorted(_SUPPORTED)),
        )
    ignored = sorted(set(root.texts("extensionsUsed")) - _SUPPORTED - _HARMLESS)
    if ignored:
        notes.append(f"ignored extensions: {', '.join(ignored)}")


def _find_buffers(document: Document, files: ResolvedFiles) -> dict[str, Path]:
    """The files of the buffers by their URIs; MissingFileError with all that are missing, images too."""
    found = {}
    missing: list[str] = []
    for table in ("buffers", "images"):
        for item in document.table(table):
            uri = item.text("uri") if "uri" in item else "data:"
            if uri.startswith("data:"):
                continue
            path = relative_path(item, uri)
            real = files.find(path, item.at("uri"))
            if real is None and (table == "buffers" or missing):
                missing.append(path)
            elif real is not None:
                found[uri] = real
    if missing:
        raise MissingFileError(missing, file=document.file, expected="existing files: a mesh has no stand-in")
    files.missing.clear()  # images that no material uses do not matter
    return found


def _read_buffer(path: Path, item: Item) -> bytes:
    try:
        return path.read_bytes()
    except OSError as error:
        raise MissingFileError(
            [path], file=item.file, place=item.at("uri"), reason=error.strerror or "", expected="a readable file"
        ) from None


def _check_images(scene: Scene, files: ResolvedFiles) -> None:
    for texture in scene.textures():
        if texture.type == "image" and texture["path"] is not None:
            files.find(texture["path"])
    files.finish()
